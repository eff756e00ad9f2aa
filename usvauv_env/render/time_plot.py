"""Plots over time: drawn whole beforehand and uncovered from left to right, or drawn as the time comes.

And plots over a distance, drawn anew in each frame.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np

from usvauv_env.render import shapes, style
from usvauv_env.render.frame_layout import Layout, Rectangle, nice_above
from usvauv_env.render.style import Colour
from usvauv_env.render.text import write

TIME_TICKS = (5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600, 7200)  # s


def clock(seconds: float) -> str:
    """Minutes and seconds, with hours when there are any."""
    whole = int(seconds)
    if whole >= 3600:
        return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
    return f"{whole // 60}:{whole % 60:02d}"


class TimePlot:
    """Axes on a still picture and, hidden until their time comes, curves.

    A logarithmic axis runs from `low` to `high` (both above 0).
    """

    def __init__(
        self,
        still: np.ndarray,
        box: Rectangle,
        low: float,
        high: float,
        duration: float,
        layout: Layout,
        log: bool = False,
    ) -> None:
        unit = layout.unit
        self.box = box
        self._unit, self._log, self._duration, self._values = unit, log, duration, (low, high)
        self._low, self._high = (math.log(low), math.log(high)) if log else (low, high)
        self._still = still
        self._draw_axes()
        self._zoom = layout.zoom  # curves are drawn magnified and averaged, see `shapes.smooth`
        self._fine = cv2.resize(box.of(still), None, fx=self._zoom, fy=self._zoom, interpolation=cv2.INTER_NEAREST)
        self._shown = 0

    def y(self, values: np.ndarray | float) -> np.ndarray:
        """Row of values in the frame, kept inside the plot."""
        values = np.log(np.maximum(values, 1e-12)) if self._log else np.asarray(values, float)
        share = np.clip((values - self._low) / (self._high - self._low), 0, 1)
        return self.box.bottom - 1 - share * (self.box.height - 1)

    def x(self, time: np.ndarray | float) -> np.ndarray:
        """Column of times in s in the frame."""
        return self.box.left + np.asarray(time, float) / self._duration * (self.box.width - 1)

    def _value_ticks(self) -> list[float]:
        low, high = self._values
        if self._log:
            powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
            steps = (1, 2, 5) if high / low < 60 else (1,)
            ticks = [step * 10.0**power for power in powers for step in steps]
            return [tick for tick in ticks if low <= tick <= high]
        spacing = nice_above((high - low) / max(2, self.box.height // (18 * self._unit)))
        return [i * spacing for i in range(math.ceil(low / spacing), math.floor(high / spacing) + 1)]

    def _draw_axes(self) -> None:
        """Grid lines, the values at the left, the times below."""
        box, size, unit, still = self.box, 10.5 * self._unit, self._unit, self._still
        for tick in self._value_ticks():
            row = float(self.y(tick))
            shapes.stroke(still, np.array([(box.left, row), (box.right, row)]), style.LINE)
            write(still, f"{tick:g}", (box.left - 5 * unit, row + 0.36 * size), size, style.MUTED, anchor="right")
        for time, words in self._time_ticks():
            column = float(self.x(time))
            shapes.stroke(still, np.array([(column, box.bottom), (column, box.bottom + 3 * unit)]), style.LINE)
            write(still, words, (column, box.bottom + 14 * unit), size, style.MUTED, anchor="centre")

    def _time_ticks(self) -> list[tuple[float, str]]:
        """Where the axis below has a mark, and what it says there."""
        few = max(2.0, self.box.width / (56 * self._unit))
        spacing = next((s for s in TIME_TICKS if self._duration / s <= few), nice_above(self._duration / few))
        return [(time, clock(time)) for time in np.arange(0, self._duration * 1.0001, spacing)]

    def _points(self, time: np.ndarray, values: np.ndarray) -> np.ndarray:
        inside = np.stack([self.x(time) - self.box.left, self.y(values) - self.box.top], 1)
        return (inside + 0.5) * self._zoom - 0.5

    def dots(self, time: np.ndarray, values: np.ndarray, colour: Colour) -> None:
        for point in self._points(time, values):
            shapes.disc(self._fine, point, 0.9 * self._unit * self._zoom, colour)

    def curve(self, time: np.ndarray, values: np.ndarray, colour: Colour) -> None:
        width = max(1, round(1.7 * self._unit * self._zoom))
        shapes.stroke(self._fine, self._points(time, values), colour, width)

    def area(self, time: np.ndarray, values: np.ndarray, colour: Colour) -> None:
        """Fill between a curve and zero."""
        points = self._points(time, values)
        zero = self._points(time[[-1, 0]], np.zeros(2))
        shapes.fill(self._fine, np.concatenate([points, zero]), colour)

    def finish(self) -> None:
        """All curves are drawn: hide them."""
        self._whole = cv2.resize(self._fine, (self.box.width, self.box.height), interpolation=cv2.INTER_AREA)
        del self._fine

    def uncover(self, time: float) -> None:
        """Show the curves up to a time on the still picture."""
        upto = min(round(float(self.x(time))) - self.box.left + 1, self.box.width)
        self.box.of(self._still)[:, self._shown : upto] = self._whole[:, self._shown : upto]
        self._shown = max(upto, self._shown)

    def draw_cursor(self, picture: np.ndarray, time: float) -> None:
        """A vertical line at the present."""
        column = round(float(self.x(time)))
        picture[self.box.top : self.box.bottom, column : column + max(1, round(self._unit))] = style.MUTED


class LivePlot(TimePlot):
    """A plot whose curves grow as the time comes."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._ends: dict[Colour, np.ndarray] = {}

    def extend(self, time: float, value: float, colour: Colour) -> None:
        """Go on with the curve of a colour to a value, on the still picture."""
        end = self._points(np.array([time]), np.array([value]))[0]
        begin = self._ends.get(colour, end)
        width, zoom = max(1, round(1.7 * self._unit * self._zoom)), self._zoom
        shapes.stroke(self._fine, np.stack([begin, end]), colour, width)
        self._ends[colour] = end
        first = max(0, int((begin[0] - 2 * width) / zoom))
        last = min(self.box.width, int((end[0] + 2 * width) / zoom) + 1)
        fine = self._fine[:, first * zoom : last * zoom]
        size = last - first, self.box.height
        self.box.of(self._still)[:, first:last] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)


class SectionPlot(TimePlot):
    """A plot over a distance in m: what the base calls time is the distance."""

    def _time_ticks(self) -> list[tuple[float, str]]:
        spacing = nice_above(self._duration / max(2.0, self.box.width / (64 * self._unit)))
        return [(x, f"{x:g}") for x in np.arange(0, self._duration * 1.0001, spacing)]

    def draw(self, picture: np.ndarray, distance: np.ndarray, level: np.ndarray, bounds: np.ndarray) -> None:
        """The water up to its level (P,) m; thin lines at the lowest and the highest one, `bounds` (2, P) m."""
        fine, width = self._fine.copy(), max(1, round(1.7 * self._unit * self._zoom))
        points = self._points(distance, level)
        bottom = [(points[-1, 0], fine.shape[0]), (points[0, 0], fine.shape[0])]
        shapes.fill(fine, np.concatenate([points, bottom]), style.mix(style.CARD, style.SEA[3], 0.55))
        for edge in bounds:
            shapes.stroke(fine, self._points(distance, edge), style.mix(style.CARD, style.MUTED, 0.7), width // 2)
        shapes.stroke(fine, points, style.SEA[4], width)
        size = self.box.width, self.box.height
        self.box.of(picture)[:] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
