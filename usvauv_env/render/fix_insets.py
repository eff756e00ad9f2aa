"""Magnified insets, one for each AUV: its fixes around its true position, and the estimate with its error ellipse."""

from __future__ import annotations

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import shapes, style, symbols
from usvauv.env.render.frame_layout import Layout, MapView, Rectangle, nice
from usvauv.env.render.map import error_axes
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.env.render.text import text_width, write

FIXES = 60  # shown at a time


class FixInsets:
    """Circular insets in up to three rows, all at one scale.

    Attributes:
        magnification: scale of the insets over that of the map.
        ring: radius of the inner ring, m.
    """

    def __init__(self, trace: Trace, running: RunningMetrics, layout: Layout, box: Rectangle, view: MapView) -> None:
        self._running, self._layout = running, layout
        truth = trace.auv_position[:, 0]
        self._fix_error = (trace.fix[:, 0] - trace.heard_position[:, 0]).astype(float)
        self._error = (trace.estimate[:, 0] - truth).astype(float)
        self._axes = error_axes(trace.estimate_covariance[:, 0])
        count = self._error.shape[1]
        label = 30 * layout.unit
        rows = min((1, 2, 3), key=lambda rows: -self._diameter(box, count, rows, label))
        columns = -(-count // rows)
        self._radius = max(self._diameter(box, count, rows, label) / 2, 4.0)
        self._across = across = box.width / columns
        down = box.height / rows
        self._centres = [
            np.array([box.left + (k % columns + 0.5) * across, box.top + (k // columns) * down + self._radius])
            for k in range(count)
        ]
        self._tints = np.array(
            [
                [style.mix(style.SEA[0], style.auv_colour(auv), 0.2 + 0.6 * (age + 1) / FIXES) for age in range(FIXES)]
                for auv in range(count)
            ]
        )
        longest = np.linalg.norm(self._axes, axis=-1).max(-1)
        reach = max(
            float(np.quantile(np.nan_to_num(np.linalg.norm(self._fix_error, axis=-1)), 0.96)),
            float(np.quantile(longest, 0.95)),
        )
        self._scale = self._radius / max(1.1 * reach, 1e-6)
        self.ring = nice(0.75 * self._radius / self._scale)
        self.magnification = self._scale / view.per_metre

    @staticmethod
    def _diameter(box: Rectangle, count: int, rows: int, label: float) -> float:
        return min(box.height / rows - label, 0.94 * box.width / -(-count // rows))

    def draw_still(self, picture: np.ndarray) -> None:
        """Backgrounds, rings and true positions."""
        layout = self._layout
        for auv, centre in enumerate(self._centres):
            self._draw_background(picture, centre, style.auv_colour(auv))
            symbols.plus(picture, centre, 5 * layout.unit, style.WHITE, layout.px(1))

    def _draw_background(self, picture: np.ndarray, centre: np.ndarray, colour: style.Colour) -> None:
        unit = self._layout.unit

        def draw(fine: np.ndarray, middle: np.ndarray, zoom: int) -> None:
            shapes.disc(fine, middle, self._radius * zoom, style.SEA[0])
            shapes.ring(fine, middle, self.ring * self._scale * zoom, style.DARK.line, round(1.2 * unit * zoom))
            shapes.ring(fine, middle, self._radius * zoom, colour, round(1.8 * unit * zoom))

        shapes.smooth(picture, centre, self._radius + 2 * unit, self._layout.zoom, draw)

    def draw(self, picture: np.ndarray, t: int) -> None:
        """Draw the latest fixes, older ones fainter; the estimate as a diamond with its predicted ellipse."""
        layout, unit = self._layout, self._layout.unit
        first = max(0, t - FIXES + 1)
        for auv, centre in enumerate(self._centres):
            offsets = self._fix_error[first : t + 1, auv] * (self._scale, -self._scale)
            shown = self._inside(offsets)
            tints = self._tints[auv, FIXES - len(offsets) :][shown]
            shapes.dots(picture, centre + offsets[shown], 1.5 * unit, tints)
            axes = self._axes[t, auv] * (self._scale, -self._scale)
            outline = shapes.ellipse_points(np.zeros(2), axes)
            distance = np.hypot(outline[:, :1], outline[:, 1:])
            outline *= np.minimum(1.0, self._radius / np.maximum(distance, 1e-9))  # parts outside are drawn on the rim
            shapes.stroke(picture, centre + outline, style.WHITE, layout.px(1.2), closed=True)
            symbols.plus(picture, centre, 5 * unit, style.WHITE, layout.px(1))
            estimate = self._error[t, auv] * (self._scale, -self._scale)
            if self._inside(estimate):
                symbols.fix(picture, centre + estimate, 4.5 * unit, style.WHITE, 1.5 * unit, layout.zoom)
            self._caption(picture, t, auv)

    def _inside(self, offsets: np.ndarray) -> np.ndarray:
        """Whether points (..., 2), pixels from the centre, lie in an inset; false for NaN, a fix without detection."""
        return np.hypot(offsets[..., 0], offsets[..., 1]) < self._radius - 2 * self._layout.unit

    def _caption(self, picture: np.ndarray, t: int, auv: int) -> None:
        unit, centre = self._layout.unit, self._centres[auv]
        error = self._running.position_error[t, auv]
        digits = sum(error < limit for limit in (9.995, 99.95))  # three in all, so that captions are of one size
        text = f"{auv + 1}: {error:.{digits}f} m"
        if self._radius >= 42 * unit:
            text = f"AUV {text} off"
        size = 12.5 * unit * min(1.0, 0.93 * self._across / text_width(text, 12.5 * unit, bold=True))
        below = centre[1] + self._radius + 16 * unit
        write(picture, text, (centre[0], below), size, self._layout.theme.auv(auv), bold=True, anchor="centre")
