"""The data of each AUV's latest service, in words that rise from its node."""

from __future__ import annotations

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import style
from usvauv.env.render.frame_layout import Rectangle
from usvauv.env.render.itinerary import Itinerary
from usvauv.env.render.text import text_width, write

FRAMES = 45  # for which the data of a completed service is shown


class Popups:
    """Of world 0 of a trace; `unit` is a pixel of the design."""

    def __init__(self, trace: Trace, itinerary: Itinerary, unit: float) -> None:
        self._delivered, self._itinerary, self._unit = trace.delivered[:, 0], itinerary, unit

    def draw(
        self, picture: np.ndarray, box: Rectangle, t: int, nodes: np.ndarray, above: float, badges: np.ndarray
    ) -> None:
        """Write them within a box, apart from each other and from the AUVs' numbers at `badges` (K, 2), each from
        `above` pixels over its node (M, 2) on.
        """
        unit = self._unit
        first, size = max(0, t - FRAMES + 1), 13 * unit
        taken = [(x, y + 4 * unit, 10 * unit) for x, y in badges]  # middle, baseline and half the width
        for auv in range(self._delivered.shape[1]):
            recent = np.flatnonzero(self._delivered[first : t + 1, auv] > 0)
            if not recent.size:
                continue
            done = first + int(recent[-1])
            age = (t - done) / FRAMES
            text = f"+{self._delivered[done, auv]:.2f} Mbit"
            half = text_width(text, size, bold=True) / 2
            x, y = nodes[self._itinerary.node(done, auv)]
            x = np.clip(x, box.left + half, max(box.right - half, box.left + half))
            y = max(y - above - (5 + 16 * age) * unit, box.top + 1.2 * size)
            while any(abs(x - at) < half + other and abs(y - row) < 1.15 * size for at, row, other in taken):
                y += -1.15 * size if y - 2.3 * size > box.top else 1.15 * size * (len(taken) + 1)
            taken.append((x, y, half))
            for shift, ink in ((unit, style.OUTLINE), (0, style.auv_colour(auv))):
                write(picture, text, (x + shift, y + shift), size, ink, bold=True, anchor="centre", opacity=1 - age**3)
