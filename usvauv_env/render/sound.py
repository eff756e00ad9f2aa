"""The sound between boats and AUVs in perspective: pings as spheres, lines to the AUVs that were heard."""

from __future__ import annotations

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import style
from usvauv.env.render.canvas import Canvas
from usvauv.env.render.exchanges import Exchanges
from usvauv.env.render.scene import WATER, Scene

FAINTEST = 0.1  # share of its colour to which a line fades


class Sound:
    """That of world 0, with the places of boats (T, B, 3) and AUVs (T, K, 3) in the scene."""

    def __init__(self, trace: Trace, scene: Scene, boats: np.ndarray, auvs: np.ndarray) -> None:
        self._scene, self._boats, self._auvs = scene, boats, auvs
        self._exchanges = Exchanges(trace)

    def _pings(self, t: int) -> list[tuple[np.ndarray, float, float]]:
        """Place (3,) of each boat whose ping runs, its radius in m, and the share of its way."""
        running = []
        for boat, share in zip(self._boats[t], self._exchanges.ping(t), strict=True):
            if share:
                reach = np.linalg.norm((self._auvs[t] - boat) / (1.0, 1.0, self._scene.depths), axis=1).max()
                running.append((boat, float(share * reach), share))
        return running

    def draw_below(self, canvas: Canvas, t: int, width: int) -> None:
        """Lines to the AUVs, and two half circles of each ping's sphere, down to the bed."""
        for auv, place in enumerate(self._auvs[t]):
            boat, fresh = self._exchanges.heard(t, auv)
            lit = 0.85 * fresh
            if lit > FAINTEST:
                canvas.line(
                    np.stack([self._boats[t, boat], place]), style.mix(WATER, style.auv_colour(auv), lit), width
                )
        turn = np.linspace(0, np.pi, 40)[:, None]
        for boat, radius, share in self._pings(t):
            ink = style.mix(WATER, style.BOAT, 0.75 * (1 - share))
            for across in (canvas.camera.right, canvas.camera.forward):
                arc = np.concatenate([np.cos(turn) * across, -np.sin(turn) * self._scene.depths], 1) * radius + boat
                for line in self._scene.inside(arc):
                    canvas.line(line, ink, width)

    def draw_afloat(self, canvas: Canvas, t: int, heights: np.ndarray, width: int) -> None:
        """The circles in which the spheres meet the surface."""
        turn = np.linspace(0, 2 * np.pi, 73)
        for boat, radius, share in self._pings(t):
            circle = boat[:2] + radius * np.stack([np.cos(turn), np.sin(turn)], 1)
            for line in self._scene.inside(self._scene.afloat(circle, heights)):
                canvas.line(line, style.mix(style.BOAT, style.SEA[3], share), width)
