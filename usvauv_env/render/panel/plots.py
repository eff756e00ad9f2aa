"""Plots of a panel: series over time, and the terms of the reward as bars."""

from __future__ import annotations

import math
from functools import cached_property

import cv2
import numpy as np

from usvauv.env.record.tracking_metrics import number, settled
from usvauv.env.render import shapes, style
from usvauv.env.render.layout import (
    SMALLEST_LETTERS,
    Layout,
    Rectangle,
    fitting,
    nice,
    nice_above,
    within_margins,
    write_heading,
)
from usvauv.env.render.mission import Playback, step_of
from usvauv.env.render.style import Colour, clock, text_width, write

LOG_STEPS = (1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)
FEWEST_TICKS, MOST_TICKS = 3, 6
TIME_TICKS = (5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600, 7200)  # s


class Plot:
    """Axes of a plot on a still picture: values at the left, times below.

    Args:
        still: picture (height, width, 3) that the axes are drawn on.
        box: of the plot, without the numbers at its axes.
        low, high: lower and upper end of the value axis; above 0 where it is logarithmic.
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
        low, high = sorted(self._values)
        if self._log:
            powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
            for steps in LOG_STEPS:
                ticks = [step * 10.0**power for power in powers for step in steps]
                ticks = [tick for tick in ticks if low <= tick <= high]
                if len(ticks) >= FEWEST_TICKS:
                    return ticks
        most = min(max(5 if self._log else 2, self.box.height // (18 * self._unit)), MOST_TICKS)
        ticks: list[float] = []
        for rounded in (nice_above, nice):
            spacing = rounded((high - low) / most)
            ticks = [i * spacing for i in range(math.ceil(low / spacing), math.floor(high / spacing) + 1)]
            if len(ticks) > 1:
                break
        return ticks

    def _draw_axes(self) -> None:
        """Grid lines, the values at the left, the times below."""
        box, size, unit, still = self.box, 10.5 * self._unit, self._unit, self._still
        above = math.inf
        for tick in self._value_ticks():
            row = float(self.y(tick))
            if abs(above - row) < size:  # no room for the number
                continue
            above = row
            shapes.stroke(still, np.array([(box.left, row), (box.right, row)]), self._theme.line)
            words = f"{tick:g}".replace("-", "−")
            write(still, words, (box.left - 5 * unit, row + 0.36 * size), size, self._theme.muted, anchor="right")
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

    First `dots` and `curve`, then `show_until` in order of time.
    """

    _shown = 0  # columns

    def dots(self, time: np.ndarray, values: np.ndarray, colour: Colour) -> None:
        for point in self._points(time, values):
            shapes.disc(self._fine, point, 0.9 * self._unit * self._zoom, colour)

    def curve(
        self, time: np.ndarray, values: np.ndarray, colour: Colour, dash: float = 0.0, thick: float = 1.0
    ) -> None:
        """A line, or dashes of a length in pixels, between which other curves are seen; `thick` times as usual."""
        points = self._points(time, values)
        for piece in shapes.dashed(points, dash * self._zoom) if dash else [points]:
            shapes.stroke(self._fine, piece, colour, round(thick * self._line_width))

    @cached_property
    def _whole(self) -> np.ndarray:
        return cv2.resize(self._fine, (self.box.width, self.box.height), interpolation=cv2.INTER_AREA)

    def show_until(self, time: float) -> None:
        """Show the curves up to a time on the still picture."""
        upto = min(round(float(self.x(time))) - self.box.left + 1, self.box.width)
        self.box.of(self._still)[:, self._shown : upto] = self._whole[:, self._shown : upto]
        self._shown = max(upto, self._shown)

    def draw_cursor(self, picture: np.ndarray, time: float) -> None:
        """Draw a vertical line at a time."""
        column = round(float(self.x(time)))
        picture[self.box.top : self.box.bottom, column : column + max(1, round(self._unit))] = self._theme.muted


TERMS = 5  # of the reward that are shown at most, the largest


class RewardBars:
    """The largest terms of the reward side by side, means of the last 30 s, each with a bar from the middle."""

    TITLE = "reward a step,", "last 30 s"

    def __init__(self, still: np.ndarray, play: Playback, box: Rectangle, layout: Layout) -> None:
        self._play, self._layout, self._row, unit, muted = play, layout, box.top, layout.unit, layout.theme.muted
        size = np.abs(play.reward).max(axis=0)
        largest = [term for term in np.argsort(-size)[:TERMS].tolist() if size[term] > 0] or [0]
        start = box.left + max(text_width(words, 11 * unit) for words in self.TITLE) + 26 * unit
        # As many of them, from the largest one on, as are legible side by side.
        forms = [f"{play.trace.reward_names[term]} +00.00" for term in largest]
        widths = [text_width(form, SMALLEST_LETTERS) + 10 * unit for form in forms]
        fitting_ones = (n for n in range(1, len(widths) + 1) if n * max(widths[:n]) <= box.right - start)
        terms = sorted(largest[: max(fitting_ones, default=1)])
        self._values = play.reward[:, terms]
        self._scale = max(float(np.quantile(np.abs(self._values), 0.98)), 1e-9)
        across = (box.right - start) / len(terms)
        self._left, self._room = [start + place * across for place in range(len(terms))], across - 10 * unit
        names, row = [play.trace.reward_names[term] for term in terms], box.top + 30 * unit
        self._size = min(fitting(f"{name} +00.00", 11 * unit, self._room) for name in names)
        for line, words in enumerate(self.TITLE):
            write(still, words, (box.left + 10 * unit, box.top + (18 + 15 * line) * unit), 11 * unit, muted)
        for left, name in zip(self._left, names, strict=True):
            write(still, name, (left, box.top + 18 * unit), self._size, muted)
            ends = np.array([(left, row), (left + self._room, row)])
            shapes.stroke(still, ends, layout.theme.line, layout.px(2))

    def draw(self, picture: np.ndarray, t: float) -> None:
        layout, unit, room = self._layout, self._layout.unit, self._room
        for left, value in zip(self._left, self._values[step_of(self._play.told(t))].tolist(), strict=True):
            number, row = f"{value:+.2f}".replace("-", "−"), self._row + 30 * unit
            position = left + room, self._row + 18 * unit
            write(picture, number, position, self._size, layout.theme.text, anchor="right")
            middle, length = left + room / 2, room / 2 * min(max(value / self._scale, -1.0), 1.0)
            ink = style.GAUGE[0] if value > 0 else style.GAUGE[2]
            shapes.stroke(picture, np.array([(middle, row), (middle + length, row)]), ink, layout.px(4))


def depth_plot(still: np.ndarray, play: Playback, box: Rectangle, layout: Layout) -> RecordedPlot:
    """Plot of the AUVs' depths, each in its colour, over the bed below it."""
    trace = play.trace
    depth, bed = trace.depth[:, 0], play.bed
    room = within_margins(box, layout.unit, top=28, sides=18, bottom=20, left=42)
    lowest, highest = max(float(bed.max()), float(depth.max())), float(depth.min())
    margin = 0.15 * (lowest - highest)
    plot = RecordedPlot(still, room, lowest + margin, max(highest - margin, 0.0), play.duration, layout)
    write_heading(still, layout, box, "Depth, m", "dashed: the bed below")
    for auv in range(depth.shape[1]):
        plot.curve(trace.time, bed[:, auv], style.mix(layout.theme.card, layout.theme.auv(auv), 0.6), 5 * layout.unit)
        plot.curve(trace.time, depth[:, auv], layout.theme.auv(auv))
    return plot


def error_plot(still: np.ndarray, play: Playback, box: Rectangle, layout: Layout) -> RecordedPlot:
    """Plot of the errors of the boat's estimates, each AUV in its colour, and of the team's estimates of targets.

    AUVs that know exactly where they are have none.
    """
    trace, unit, theme, error = play.trace, layout.unit, layout.theme, play.position_error
    of, dots = ("estimates", "step") if trace.scenario.navigation.sensor != "none" else ("fixes", "fix")
    title, note, shown = f"Position error of the {of}, m", f"dots: each {dots} · line: median of 30 s", error
    if play.tracks:
        title, note = "Position error, m", "thick: targets, mean · thin: AUVs"
        if number(trace, "places_known") > 0:
            title, note, error = "Error of the targets, m", "mean of all", error[:, :0]
        first = min(settled(trace).start, len(trace.time) // 2)  # a short mission has not settled
        shown = np.concatenate([error, play.track_error[:, None]], axis=1)[first:]
    low, high = np.quantile(shown, (0.03, 0.998))
    low = max(float(low), 1e-9)
    room = within_margins(box, unit, top=28, sides=18, bottom=20, left=42)
    plot = RecordedPlot(still, room, low, max(float(high), 1.5 * low), play.duration, layout, log=True)
    write_heading(still, layout, box, title, note)
    for auv in range(error.shape[1]):
        plot.dots(trace.time, error[:, auv], style.mix(theme.card, theme.auv(auv), 0.45))
    for auv in range(error.shape[1]):
        plot.curve(trace.time, play.error_median[:, auv], theme.auv(auv))
    if play.tracks:
        plot.curve(trace.time, play.track_error, theme.text, thick=2.0)
    return plot
