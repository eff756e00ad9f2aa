"""Plots of a panel: of recorded series over time, of series that are still growing, and along a section."""

from __future__ import annotations

import math

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.frame_layout import Layout, Rectangle, nice_above
from usvauv.env.render.style import Colour
from usvauv.env.render.text import clock, write

LOG_STEPS = (1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)
FEWEST_TICKS = 3
TIME_TICKS = (5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600, 7200)  # s


class Plot:
    """Axes of a plot on a still picture: values at the left, times below.

    Args:
        still: picture (height, width, 3) that the axes are drawn on.
        box: of the plot, without the numbers at its axes.
        low, high: ends of the value axis; above 0 where it is logarithmic.
        duration: right end of the time axis, s.
        layout: of the frame.
        log: whether the value axis is logarithmic.
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
        self.box, self._theme = box, layout.theme
        unit = layout.unit
        self._unit, self._log, self._duration, self._values = unit, log, duration, (low, high)
        self._low, self._high = (math.log(low), math.log(high)) if log else (low, high)
        self._still = still
        self._draw_axes()
        self._zoom = layout.zoom  # curves are drawn magnified and averaged, see `shapes.smooth`
        self._fine = cv2.resize(box.of(still), None, fx=self._zoom, fy=self._zoom, interpolation=cv2.INTER_NEAREST)
        self._line_width = max(1, round(1.7 * unit * self._zoom))

    def y(self, values: np.ndarray | float) -> np.ndarray:
        """Rows of values in the frame, clipped to the plot."""
        values = np.log(np.maximum(values, 1e-12)) if self._log else np.asarray(values, float)
        share = np.clip((values - self._low) / (self._high - self._low), 0, 1)
        return self.box.bottom - 1 - share * (self.box.height - 1)

    def x(self, time: np.ndarray | float) -> np.ndarray:
        """Columns of times (s) in the frame."""
        return self.box.left + np.asarray(time, float) / self._duration * (self.box.width - 1)

    def _value_ticks(self) -> list[float]:
        low, high = self._values
        if self._log:
            powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
            for steps in LOG_STEPS:
                ticks = [step * 10.0**power for power in powers for step in steps]
                ticks = [tick for tick in ticks if low <= tick <= high]
                if len(ticks) >= FEWEST_TICKS:
                    return ticks
        spacing = nice_above((high - low) / max(5 if self._log else 2, self.box.height // (18 * self._unit)))
        return [i * spacing for i in range(math.ceil(low / spacing), math.floor(high / spacing) + 1)]

    def _draw_axes(self) -> None:
        """Grid lines, the values at the left, the times below."""
        box, size, unit, still = self.box, 10.5 * self._unit, self._unit, self._still
        above = math.inf
        for tick in self._value_ticks():
            row = float(self.y(tick))
            if above - row < size:  # no room for the number
                continue
            above = row
            shapes.stroke(still, np.array([(box.left, row), (box.right, row)]), self._theme.line)
            write(still, f"{tick:g}", (box.left - 5 * unit, row + 0.36 * size), size, self._theme.muted, anchor="right")
        for time, words in self._time_ticks():
            column = float(self.x(time))
            shapes.stroke(still, np.array([(column, box.bottom), (column, box.bottom + 3 * unit)]), self._theme.line)
            write(still, words, (column, box.bottom + 14 * unit), size, self._theme.muted, anchor="centre")

    def _time_ticks(self) -> list[tuple[float, str]]:
        """Positions on the time axis and their labels."""
        few = max(2.0, self.box.width / (56 * self._unit))
        spacing = next((s for s in TIME_TICKS if self._duration / s <= few), nice_above(self._duration / few))
        return [(time, clock(time)) for time in np.arange(0, self._duration * 1.0001, spacing)]

    def _points(self, time: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Points of a curve in the magnified plot, (P, 2) pixels."""
        points = np.stack([self.x(time) - self.box.left, self.y(values) - self.box.top], 1)
        return (points + 0.5) * self._zoom - 0.5


class RecordedPlot(Plot):
    """A plot of whole series, drawn beforehand and shown from left to right as time passes.

    First `dots`, `curve` and `area`, then `finish`, then `show_until` in order of time.
    """

    _whole: np.ndarray
    _shown = 0  # columns

    def dots(self, time: np.ndarray, values: np.ndarray, colour: Colour) -> None:
        for point in self._points(time, values):
            shapes.disc(self._fine, point, 0.9 * self._unit * self._zoom, colour)

    def curve(self, time: np.ndarray, values: np.ndarray, colour: Colour) -> None:
        shapes.stroke(self._fine, self._points(time, values), colour, self._line_width)

    def area(self, time: np.ndarray, values: np.ndarray, colour: Colour) -> None:
        """Fill between a curve and zero."""
        points = self._points(time, values)
        zero = self._points(time[[-1, 0]], np.zeros(2))
        shapes.fill(self._fine, np.concatenate([points, zero]), colour)

    def finish(self) -> None:
        """Render the curves; nothing can be added any more."""
        self._whole = cv2.resize(self._fine, (self.box.width, self.box.height), interpolation=cv2.INTER_AREA)
        del self._fine

    def show_until(self, time: float) -> None:
        """Show the curves up to a time on the still picture."""
        upto = min(round(float(self.x(time))) - self.box.left + 1, self.box.width)
        self.box.of(self._still)[:, self._shown : upto] = self._whole[:, self._shown : upto]
        self._shown = max(upto, self._shown)

    def draw_cursor(self, picture: np.ndarray, time: float) -> None:
        """Draw a vertical line at a time."""
        column = round(float(self.x(time)))
        picture[self.box.top : self.box.bottom, column : column + max(1, round(self._unit))] = self._theme.muted


class LivePlot(Plot):
    """A plot whose curves grow step by step."""

    def __init__(
        self, still: np.ndarray, box: Rectangle, low: float, high: float, duration: float, layout: Layout
    ) -> None:
        super().__init__(still, box, low, high, duration, layout)
        self._ends: dict[Colour, np.ndarray] = {}

    def extend(self, time: float, value: float, colour: Colour) -> None:
        """Extend the curve of a colour to a value, on the still picture."""
        end = self._points(np.array([time]), np.array([value]))[0]
        begin = self._ends.setdefault(colour, end)
        width, zoom = self._line_width, self._zoom
        shapes.stroke(self._fine, np.stack([begin, end]), colour, width)
        self._ends[colour] = end
        first = max(0, int((begin[0] - 2 * width) / zoom))
        last = min(self.box.width, int((end[0] + 2 * width) / zoom) + 1)
        fine = self._fine[:, first * zoom : last * zoom]
        size = last - first, self.box.height
        self.box.of(self._still)[:, first:last] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)


class SectionPlot(Plot):
    """A plot of elevation along a section, drawn anew in each frame: its time axis is the distance, m."""

    def _time_ticks(self) -> list[tuple[float, str]]:
        spacing = nice_above(self._duration / max(2.0, self.box.width / (64 * self._unit)))
        return [(x, f"{x:g}") for x in np.arange(0, self._duration * 1.0001, spacing)]

    def draw(self, picture: np.ndarray, distance: np.ndarray, level: np.ndarray, bounds: np.ndarray) -> None:
        """Draw the water up to its level (P,) m at distances (P,) m, and thin lines at its `bounds` (2, P) m."""
        fine, width = self._fine.copy(), self._line_width
        points = self._points(distance, level)
        bottom = [(points[-1, 0], fine.shape[0]), (points[0, 0], fine.shape[0])]
        shapes.fill(fine, np.concatenate([points, bottom]), style.mix(self._theme.card, style.SEA[3], 0.55))
        for bound in bounds:
            shapes.stroke(
                fine, self._points(distance, bound), style.mix(self._theme.card, self._theme.muted, 0.7), width // 2
            )
        shapes.stroke(fine, points, self._theme.water, width)
        size = self.box.width, self.box.height
        self.box.of(picture)[:] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
