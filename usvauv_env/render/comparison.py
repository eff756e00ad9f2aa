"""Two missions of one world, or of two like ones, side by side, and how far they are apart."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import shapes
from usvauv.env.render.arrangement import Sheet
from usvauv.env.render.between import Series, Vehicle, step_of
from usvauv.env.render.layout import AXES, Head, Layout, Rectangle, draw_card, fitting, within_margins, write_heading
from usvauv.env.render.map import MissionMap, draw_map_axes
from usvauv.env.render.mission import RunningMetrics, figures
from usvauv.env.render.plots import RecordedPlot
from usvauv.env.render.sea import elevation_limit
from usvauv.env.render.style import Colour, Theme, shorten, text_width, write
from usvauv.env.scenario.sea import Area
from usvauv.kernels.errors import UserError

LOWEST = 1e-3  # m, of the error plot
DASH = 5.0  # pixels of the design, of the second one's curves
LOW = 130.0  # height in pixels of the design of plots that have no lines for a legend
SAMPLE = 26.0  # pixels of the design, length of a line in the legend


class Entry(NamedTuple):
    """An entry of the legend: words, colour, and length of the dashes of its curves in pixels of the design."""

    words: str
    colour: Colour
    dash: float


def entries(first: Trace, second: Trace, theme: Theme) -> tuple[Entry, Entry]:
    """The legend of curves: a solid line for the first mission, dashes, which may lie on it, for the second one."""
    one, other = differences(first, second)
    return Entry(one, theme.runs[0], 0.0), Entry(other, theme.runs[1], DASH)


def difference(value: float, other: float, form: str) -> str:
    """How much more a value is than another one, both as a format writes them; "same" where it writes them alike."""
    more = float(f"{value:{form}}") - float(f"{other:{form}}")
    return f"{more:+{form}}".replace("-", "−") if more else "same"


class ComparisonFrames:
    """Two traces side by side, up to the end of the shorter one: both maps have one scale of lengths and of colours.

    Attributes:
        maps: of both. layout: of the frame, with its boxes.
    """

    def __init__(
        self,
        first: Trace,
        second: Trace,
        size: tuple[int, int],
        theme: Theme,
        speed_up: float,
        pace: float = 1.0,
        follow: Vehicle | None = None,
    ) -> None:
        check_comparable(first, second)
        self._traces = first, second
        self._running = [RunningMetrics.of(trace, pace) for trace in self._traces]
        self._follow, self._time = follow, Series(first.time)
        self._entries = entries(first, second, theme)
        self._still = np.full((size[1], size[0], 3), theme.background, np.uint8)
        self._picture = np.empty_like(self._still)
        self._end = float(first.time[min(len(trace.time) for trace in self._traces) - 1])
        self._errors = [np.sqrt(np.square(running.error_median).mean(axis=1)) for running in self._running]
        self._names = [name for name, _, _ in self._figures(0, 0)]
        sides = [(trace.scenario.area.width, trace.scenario.area.length) for trace in self._traces]
        width, length = map(max, *sides)
        area = first.scenario.area.model_copy(update={"width": width, "length": length})
        sheet = Sheet.of(size, area, self._names)
        boxes = sheet.compared()
        self.layout = layout = Layout(*size, sheet.unit, boxes, theme)
        limit = max(elevation_limit(trace.surface) for trace in self._traces)
        self.maps = [self._map(side, boxes[name], limit, area) for side, name in enumerate(("first", "second"))]
        self._head = Head(self._still, boxes["title"], None, layout, common(first, second), [], self._end, speed_up)
        for name in boxes.keys() & {"table", "yield", "errors"}:
            draw_card(self._still, boxes[name], layout)
        self._rows = self._table_rows(boxes["table"])
        self._plots = [self._plot_yield(boxes["yield"]), self._plot_errors(boxes["errors"])] if "yield" in boxes else []

    def _map(self, side: int, box: Rectangle, limit: float, largest: Area) -> MissionMap:
        """A map with its name; of the larger area it fills the box."""
        trace, entry, layout = self._traces[side], self._entries[side], self.layout
        area, unit = trace.scenario.area, layout.unit
        across, up = round(box.width * area.width / largest.width), round(box.height * area.length / largest.length)
        box = Rectangle(box.left + (box.width - across) // 2, box.bottom - up, across, up)
        layout = replace(layout, boxes={"map": box}, left=max(0, box.left - round(AXES[0] * unit)))
        shown = MissionMap(trace, self._running[side], layout, limit, self._follow)
        draw_map_axes(self._still, shown, layout, "")
        self._sample(entry, box.left, box.top - 33 * unit)
        left, room = box.left + (SAMPLE + 8) * unit, box.width - (SAMPLE + 8 - AXES[1]) * unit
        size = max(fitting(entry.words, 14 * unit, room, bold=True), 11 * unit)
        words = shorten(entry.words, size, room, bold=True)
        write(self._still, words, (left, box.top - 28 * unit), size, entry.colour, bold=True)
        return shown

    def _sample(self, entry: Entry, left: float, row: float) -> None:
        """A piece of a curve as the legend shows it."""
        unit = self.layout.unit
        ends = np.array([(left, row), (left + SAMPLE * unit, row)])
        pieces = shapes.dashes(ends[0], ends[1], entry.dash * unit) if entry.dash else [ends]
        for piece in pieces:
            shapes.stroke(self._still, piece, entry.colour, self.layout.px(2.2))

    def _table_rows(self, box: Rectangle) -> list[tuple[float, float, float]]:
        """Write the names of the figures; for each the left end, the right end and the baseline of its values."""
        unit = self.layout.unit
        down = min((box.height - 8 * unit) / len(self._names), 72 * unit)
        top = box.top + (box.height - len(self._names) * down) / 2
        left, right = box.left + 10 * unit, box.right - 10 * unit
        rows = []
        for place, name in enumerate(self._names):
            line = top + (place + 0.5) * down
            write(self._still, name, (left, line - 7 * unit), 11 * unit, self.layout.theme.muted)
            rows.append((left, right, line + 15 * unit))
        return rows

    def _draw_figures(self, picture: np.ndarray, t: float) -> None:
        """Values of both missions in their colours, and how much more the second one has."""
        unit, theme = self.layout.unit, self.layout.theme
        one, other = self._figures(0, t), self._figures(1, t)
        for (left, right, line), (_, value, form), (_, second, _) in zip(self._rows, one, other, strict=True):
            across = 0.36 * (right - left)
            for place, (number, entry) in enumerate(zip((value, second), self._entries, strict=True)):
                words = f"{number:{form}}".replace("-", "−")
                size = fitting(words, 18 * unit, across - 8 * unit, bold=True)
                write(picture, words, (left + place * across, line), size, entry.colour, bold=True)
            write(picture, difference(second, value, form), (right, line), 12 * unit, theme.muted, anchor="right")

    def _figures(self, side: int, t: float) -> list[tuple[str, float, str]]:
        """Those of a mission, and its position error as it is plotted."""
        error = "position error, m", float(self._errors[side][step_of(t)]), ".2f"
        return [*figures(self._traces[side], self._running[side], t), error]

    def _plot_yield(self, box: Rectangle) -> RecordedPlot:
        """What both have brought in so far, or how far both are off station."""
        stations = self._traces[0].scenario.task == "station-keeping"
        series = [running.off_target if stations else running.delivered for running in self._running]
        title = "Distance of the AUVs to their stations, m" if stations else "Data delivered, Mbit"
        return self._plot(box, title, series, 0.0, 1.05 * max(float(values.max()) for values in series) or 1.0)

    def _plot_errors(self, box: Rectangle) -> RecordedPlot:
        """Errors of the boat's estimates, rms over AUVs, median of 30 s each."""
        series = self._errors
        high = 1.1 * max(float(values.max()) for values in series)
        low = max(min(float(np.quantile(values, 0.02)) for values in series), LOWEST)
        return self._plot(box, "Position error, m", series, low, max(high, 1.5 * low), log=True)

    def _plot(
        self, box: Rectangle, title: str, series: list[np.ndarray], low: float, high: float, log: bool = False
    ) -> RecordedPlot:
        layout = self.layout
        lines = self._write_legend(box, title, series)
        room = within_margins(box, layout.unit, top=28 + 15 * lines, sides=18, bottom=20, left=42)
        plot = RecordedPlot(self._still, room, low, high, self._end, layout, log=log)
        for trace, values, entry in zip(self._traces, series, self._entries, strict=True):
            plot.curve(trace.time, values, entry.colour, entry.dash * layout.unit)
        plot.finish()
        return plot

    def _write_legend(self, box: Rectangle, title: str, series: list[np.ndarray]) -> int:
        """Title and legend of a plot; returns the number of lines that the legend takes below the title.

        A low plot has the names above the maps alone.
        """
        layout, unit = self.layout, self.layout.unit
        shown = min(map(len, series))
        same = np.array_equal(series[0][:shown], series[1][:shown])
        words, room = [entry.words for entry in self._entries], box.width - 20 * unit
        widths = [(SAMPLE + 6) * unit + text_width(each, 11 * unit) for each in words]
        heading = title + ": the same" if same else title
        beside = text_width(heading, 12 * unit, bold=True) + sum(widths) + 34 * unit <= room
        below = not beside and box.height >= LOW * unit
        write_heading(self._still, layout, box, title if below else heading)
        if same and below:
            words[1] += ", the same"
        if not (beside or below):
            return 0
        left = box.right - 10 * unit - sum(widths) - 16 * unit if beside else box.left + 10 * unit
        for place, (entry, text, width) in enumerate(zip(self._entries, words, widths, strict=True)):
            line = box.top + (18 if beside else 34 + 15 * place) * unit
            self._sample(entry, left, line - 4 * unit)
            text = shorten(text, 11 * unit, room - (SAMPLE + 6) * unit)
            write(self._still, text, (left + (SAMPLE + 6) * unit, line), 11 * unit, layout.theme.text)
            left += (width + 16 * unit) if beside else 0
        return 0 if beside else 2

    def frame(self, t: float) -> np.ndarray:
        time = float(self._time.at(t))
        for plot in self._plots:
            plot.show_until(time)
        np.copyto(self._picture, self._still)
        for shown in self.maps:
            shown.draw(self._picture, t)
        self._head.draw(self._picture, time, time / self._end, [])
        self._draw_figures(self._picture, t)
        for plot in self._plots:
            plot.draw_cursor(self._picture, time)
        return self._picture


def _named(trace: Trace) -> dict[str, str]:
    """What tells runs apart."""
    return {
        "policy": trace.policy,
        "boat": trace.usv,
        "targets": trace.scenario.nodes.target_rule,
        "seed": str(trace.seed),
        "scenario": trace.scenario.name,
    }


def differences(first: Trace, second: Trace) -> tuple[str, str]:
    """What each of two runs has that the other has not, in a few words."""
    one, other = _named(first), _named(second)
    differ = [name for name in one if one[name] != other[name]] or ["policy"]
    first_words, second_words = (" · ".join(f"{name} {which[name]}" for name in differ) for which in (one, other))
    return first_words, second_words


def common(first: Trace, second: Trace) -> tuple[str, str]:
    """Both lines of the title: what two runs have in common."""
    one, other = _named(first), _named(second)
    shared = [f"{name} {one[name]}" for name in ("policy", "boat", "seed") if one[name] == other[name]]
    same = one["scenario"] == other["scenario"]
    return f"Scenario “{one['scenario']}”" if same else "Two scenarios", " · ".join(shared)


def check_comparable(first: Trace, second: Trace) -> None:
    """Refuse two traces that cannot be shown in step.

    Raises:
        UserError: another mission step or another task.
    """
    one, other = first.scenario, second.scenario
    if one.mission.step != other.mission.step:
        raise UserError(f"mission steps of {one.mission.step:g} s and {other.mission.step:g} s cannot be compared")
    if one.task != other.task:
        raise UserError(f"tasks {one.task} and {other.task} cannot be compared")
