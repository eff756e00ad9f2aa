"""Frames of a mission's video, drawn from a trace: map, perspective or both, and two missions side by side."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import cv2
import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_metrics import settled
from usvauv.env.render import shapes, style
from usvauv.env.render.layout import (
    AXES,
    Arrangement,
    Head,
    Layout,
    Rectangle,
    draw_card,
    fitting,
    within_margins,
    write_heading,
)
from usvauv.env.render.mission import Playback, Series, Vehicle, step_of
from usvauv.env.render.panel.insets import FixInsets, TargetInsets
from usvauv.env.render.panel.legend import Legend
from usvauv.env.render.panel.plots import RecordedPlot, RewardBars, depth_plot, error_plot
from usvauv.env.render.panel.section import DepthSection
from usvauv.env.render.style import Colour, Theme, shorten, text_width, write
from usvauv.env.render.views.boat_view import BoatView
from usvauv.env.render.views.map import MissionMap, draw_map_axes, view_note
from usvauv.env.render.views.perspective import PerspectiveView
from usvauv.env.render.views.sea_surface import elevation_limit
from usvauv.env.scenario.environment import Area
from usvauv.kernels.errors import UserError

VIEWS = ("map", "sea", "both")


class Part(Protocol):
    """A part of a frame that is drawn anew each time."""

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw a moment."""


class Frames(ABC):
    """Draws frames in order of time: still parts once, plots step by step, the others on each frame.

    Attributes:
        layout: of the frame, with its boxes.
    """

    layout: Layout

    def __init__(self, plays: Sequence[Playback], size: tuple[int, int], theme: Theme) -> None:
        self._plays = plays
        self._still = np.full((size[1], size[0], 3), theme.background, np.uint8)
        self._picture = np.empty_like(self._still)
        self._parts: list[Part] = []
        self._plots: list[RecordedPlot] = []

    def frame(self, t: float) -> np.ndarray:
        """Picture (height, width, 3) BGR of a moment, in steps from the first; overwritten by the next."""
        time = float(self._plays[0].time.at(t))
        for plot in self._plots:
            plot.show_until(time)
        np.copyto(self._picture, self._still)
        for part in self._parts:
            part.draw(self._picture, t)
        told = self._plays[0].told(t)
        self._draw_figures(self._picture, told, float(self._plays[0].time.at(told)))
        for plot in self._plots:
            plot.draw_cursor(self._picture, time)
        return self._picture

    @abstractmethod
    def _draw_figures(self, picture: np.ndarray, t: float, time: float) -> None:
        """Write the time in s and the figures of a moment."""


def frames_of(
    traces: Sequence[Trace],
    size: tuple[int, int],
    view: str = "map",
    theme: str = "dark",
    speed_up: float = 1.0,
    pace: float = 1.0,
    follow: str = "",
    end: float | None = None,
) -> Frames:
    """Frames of world 0 of a trace, or of two traces side by side.

    Args:
        traces: one, or two that are compared; each of at least one step.
        size: width and height of a frame, pixels.
        view: one of `VIEWS`: the map from above with plots, the sea in perspective, or both side by side.
        theme: name of one of `style.THEMES`.
        speed_up: play speed that the title states, s of mission in a second.
        pace: steps of the mission from one frame to the next.
        follow: a vehicle that views go along with: usv, usv:N or auv:N; "" for all of the area.
        end: moment of the last frame, by default the last step; what is written there is of that moment.

    Raises:
        UserError: more than two traces, two of other mission steps or tasks, or no such vehicle.
    """
    if len(traces) > 2:
        raise UserError(f"{len(traces)} traces: at most two can be compared")
    vehicle = None
    for trace in traces if follow else ():
        vehicle = Vehicle.parse(follow, trace.scenario)
    one, other = traces[0].scenario, traces[-1].scenario
    if one.mission.step != other.mission.step:
        raise UserError(f"mission steps of {one.mission.step:g} s and {other.mission.step:g} s cannot be compared")
    if one.task != other.task:
        raise UserError(f"tasks {one.task} and {other.task} cannot be compared")
    plays, look = [Playback(trace.episode(0), pace, speed_up, end) for trace in traces], style.THEMES[theme]
    if len(plays) == 2:
        return ComparisonFrames(plays, size, look, speed_up, vehicle)
    return MissionFrames(plays, size, look, speed_up, view, vehicle)


def _named(trace: Trace) -> dict[str, str]:
    """The names that distinguish runs."""
    return {
        "policy": trace.policy,
        "boat": trace.usv,
        "targets": trace.scenario.nodes.target_rule,
        "seed": str(trace.seed),
        "scenario": f"“{trace.scenario.name}”{', changed' if trace.scenario.change else ''}",
    }


def title_of(first: Trace, second: Trace) -> tuple[str, str]:
    """Both lines of the title: what two runs have in common, which may be one."""
    one, other = _named(first), _named(second)
    shared = [f"{name} {one[name]}" for name in ("policy", "boat", "seed") if one[name] == other[name]]
    same = one["scenario"] == other["scenario"]
    return f"Scenario {one['scenario']}" if same else "Two scenarios", " · ".join(shared)


def differences(first: Trace, second: Trace) -> tuple[str, str]:
    """Differences of two runs, for each in a few words."""
    one, other = _named(first), _named(second)
    differ = [name for name in one if one[name] != other[name]] or ["policy"]
    first_words, second_words = (" · ".join(f"{name} {which[name]}" for name in differ) for which in (one, other))
    return first_words, second_words


class MissionFrames(Frames):
    """One mission: a map, a perspective or both, with figures, plots and a legend as there is room for.

    Attributes:
        map: of a view that has one.
    """

    map: MissionMap

    def __init__(
        self,
        plays: Sequence[Playback],
        size: tuple[int, int],
        theme: Theme,
        speed_up: float,
        view: str,
        follow: Vehicle | None,
    ) -> None:
        super().__init__(plays, size, theme)
        (play,) = plays
        trace = play.trace
        scenario, names = trace.scenario, [name for name, _, _ in play.figures(0)]
        arrangement = Arrangement(size, scenario.area, names)
        boxes, still = arrangement.boxes(view, trace.auv_depth.size > 0), self._still
        left = max(0, boxes["map"].left - round(AXES[0] * arrangement.unit)) if "map" in boxes else 0
        self.layout = layout = Layout(*size, arrangement.unit, boxes, theme, left)
        for name in boxes.keys() & {"reward", "fixes", "errors", "section", "depth"}:
            draw_card(still, boxes[name], layout)
        if "map" in boxes:
            self.map = MissionMap(play, layout, follow=follow, near=(play,))
            draw_map_axes(still, self.map, layout, view_note(trace))
            self._parts.append(self.map)
        scale = self.map.view.per_metre if "map" in boxes else 0.0
        if "perspective" in boxes and follow and follow.kind == "usv":
            self._parts.append(BoatView(play, boxes["perspective"], layout, follow.index))
        elif "perspective" in boxes:
            perspective = PerspectiveView(play, boxes["perspective"], layout, follow)
            self._parts.append(perspective)
            scale = scale or perspective.per_metre
        if "fixes" in boxes:
            insets = TargetInsets if play.tracks else FixInsets
            self._parts.append(insets(still, play, boxes["fixes"], layout, self.map.view))
        if "section" in boxes:
            self._parts.append(DepthSection(still, play, boxes["section"], layout))
        if "reward" in boxes:
            self._parts.append(RewardBars(still, play, boxes["reward"], layout))
        if "legend" in boxes and scale:  # beside a boat there is none of what it names
            self._parts.append(Legend(play, boxes["legend"], layout, scale, "map" in boxes, "fixes" in boxes))
        if "errors" in boxes:
            self._plots.append(error_plot(still, play, boxes["errors"], layout))
        if "depth" in boxes:
            self._plots.append(depth_plot(still, play, boxes["depth"], layout))
        seen = max(
            (boxes[name] for name in boxes.keys() & {"map", "perspective"}), key=lambda box: box.width * box.height
        )
        if follow and follow.kind == "auv" and trace.auv_fins.size:
            self._parts.append(Instruments(play, follow.index, seen, layout))
        end, words = float(trace.time[-1]), title_of(trace, trace)
        self._head = Head(
            still, boxes["title"], boxes.get("tiles"), layout, words, names, end, speed_up, play.sea.slow > 1
        )

    def _draw_figures(self, picture: np.ndarray, t: float, time: float) -> None:
        (play,) = self._plays
        values = [f"{value:{form}}" for _, value, form in play.figures(t)]
        self._head.draw(picture, time, (t + 1) / len(play.trace.time), values)


class Instruments:
    """An AUV's instruments, in the upper left corner of a view that follows it."""

    def __init__(self, play: Playback, auv: int, view: Rectangle, layout: Layout) -> None:
        trace = play.trace
        heading, pitch, _ = np.degrees(trace.attitude[:, 0, auv]).T
        rudder, stern, propeller = trace.auv_fins[:, 0, auv].astype(float).T
        depth, bed = trace.depth[:, 0, auv], play.bed[:, auv]
        self._readings = {
            "heading": (Series(90.0 - heading), "03.0f", "°"),
            "pitch": (Series(pitch), "+.1f", "°"),
            "depth": (Series(depth), ".1f", " m"),
            "altitude": (Series(bed - depth), ".1f", " m"),
            "speed": (Series(np.hypot(*trace.auv_velocity[:, 0, auv].T)), ".2f", " m/s"),
            "rudder": (Series(np.degrees(rudder)), "+.1f", "°"),
            "stern plane": (Series(np.degrees(stern)), "+.1f", "°"),
            "propeller": (Series(60.0 * propeller), ".0f", " rpm"),
        }
        unit, rows = layout.unit, len(self._readings)
        width, height = min(round(142 * unit), view.width), min(round((15 * rows + 9) * unit), view.height)
        self._box, self._layout = view._replace(width=width, height=height), layout

    def draw(self, picture: np.ndarray, t: float) -> None:
        unit, box = self._layout.unit, self._box
        region = box.of(picture)
        region[:] = cv2.addWeighted(region, 0.3, np.full_like(region, style.DARK.card), 0.7, 0)
        for row, (name, (series, form, of)) in enumerate(self._readings.items()):
            value, line = float(series.at(t)), box.top + (15 * row + 15) * unit
            words = f"{value % 360.0 if name == 'heading' else value:{form}}{of}".replace("-", "−")
            write(picture, name, (box.left + 8 * unit, line), 11 * unit, style.DARK.muted)
            write(picture, words, (box.right - 8 * unit, line), 11 * unit, style.DARK.text, bold=True, anchor="right")


LOWEST = 1e-3  # m, of the error plot
DASH = 5.0  # pixels of the design, of the second one's curves
LOW = 130.0  # height in pixels of the design of plots that have no lines for a legend
SAMPLE = 26.0  # pixels of the design, length of a line in the legend


class Entry(NamedTuple):
    """An entry of the legend: words, colour, and length of the dashes of its curves in pixels of the design."""

    words: str
    colour: Colour
    dash: float


def difference(value: float, other: float, form: str) -> str:
    """How much more a value is than another one, both as a format writes them; "same" where it writes them alike."""
    more = float(f"{value:{form}}") - float(f"{other:{form}}")
    return f"{more:+{form}}".replace("-", "−") if more else "same"


class ComparisonFrames(Frames):
    """Two missions side by side, up to the end of the shorter one: both maps have one scale of lengths and of colours.

    Attributes:
        maps: of both.
    """

    def __init__(
        self,
        plays: Sequence[Playback],
        size: tuple[int, int],
        theme: Theme,
        speed_up: float,
        follow: Vehicle | None,
    ) -> None:
        super().__init__(plays, size, theme)
        first, second = traces = [play.trace for play in plays]
        # Dashes of the second one may lie on the solid line of the first.
        self._entries = list(map(Entry, differences(first, second), theme.runs, (0.0, DASH)))
        self._end = float(first.time[min(len(trace.time) for trace in traces) - 1])
        self._errors = [np.sqrt(np.square(play.error_median).mean(axis=1)) for play in self._plays]
        self._names = [name for name, _, _ in self._figures(0, 0)]
        sides = [(trace.scenario.area.width, trace.scenario.area.length) for trace in traces]
        width, length = map(max, *sides)
        area = first.scenario.area.model_copy(update={"width": width, "length": length})
        arrangement = Arrangement(size, area, self._names)
        boxes = arrangement.compared()
        self.layout = layout = Layout(*size, arrangement.unit, boxes, theme)
        limit = max(elevation_limit(trace.surface) for trace in traces)
        self.maps = [self._map(side, boxes[name], limit, area, follow) for side, name in enumerate(("first", "second"))]
        self._parts += self.maps
        slow = any(play.sea.slow > 1 for play in plays)
        self._head = Head(
            self._still, boxes["title"], None, layout, title_of(first, second), [], self._end, speed_up, slow
        )
        for name in boxes.keys() & {"table", "yield", "errors"}:
            draw_card(self._still, boxes[name], layout)
        self._rows = self._table_rows(boxes["table"])
        if "yield" in boxes:
            self._plots += self._plot_yield(boxes["yield"]), self._plot_errors(boxes["errors"])

    def _map(self, side: int, box: Rectangle, limit: float, largest: Area, follow: Vehicle | None) -> MissionMap:
        """A map with its name; of the larger area it fills the box."""
        play, entry, layout = self._plays[side], self._entries[side], self.layout
        area, unit = play.trace.scenario.area, layout.unit
        across, up = round(box.width * area.width / largest.width), round(box.height * area.length / largest.length)
        box = Rectangle(box.left + (box.width - across) // 2, box.bottom - up, across, up)
        layout = replace(layout, boxes={"map": box}, left=max(0, box.left - round(AXES[0] * unit)))
        areas = [(each.trace.scenario.area.width, each.trace.scenario.area.length) for each in self._plays]
        shown = MissionMap(play, layout, limit, follow, self._plays if areas[0] == areas[1] else ())
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
        shapes.strokes(self._still, pieces, entry.colour, self.layout.px(2.2))

    def _table_rows(self, box: Rectangle) -> list[float]:
        """Write the names of the figures; for each the baseline of its values."""
        unit = self.layout.unit
        down = min((box.height - 8 * unit) / len(self._names), 72 * unit)
        top = box.top + (box.height - len(self._names) * down) / 2
        lines = [top + (place + 0.5) * down for place in range(len(self._names))]
        for line, name in zip(lines, self._names, strict=True):
            write(self._still, name, (box.left + 10 * unit, line - 7 * unit), 11 * unit, self.layout.theme.muted)
        return [line + 15 * unit for line in lines]

    def _draw_figures(self, picture: np.ndarray, t: float, time: float) -> None:
        """Values of both missions in their colours, and how much more the second one has."""
        self._head.draw(picture, time, time / self._end, [])
        unit, theme = self.layout.unit, self.layout.theme
        one, other, box = self._figures(0, t), self._figures(1, t), self.layout.boxes["table"]
        left, right = box.left + 10 * unit, box.right - 10 * unit
        across = 0.36 * (right - left)
        for line, (_, value, form), (_, second, _) in zip(self._rows, one, other, strict=True):
            for place, (number, entry) in enumerate(zip((value, second), self._entries, strict=True)):
                words = f"{number:{form}}".replace("-", "−")
                size = fitting(words, 18 * unit, across - 8 * unit, bold=True)
                write(picture, words, (left + place * across, line), size, entry.colour, bold=True)
            write(picture, difference(second, value, form), (right, line), 12 * unit, theme.muted, anchor="right")

    def _figures(self, side: int, t: float) -> list[tuple[str, float, str]]:
        """Figures of a mission, and its position error as it is plotted."""
        error = "position error, m", float(self._errors[side][step_of(t)]), ".2f"
        return [*self._plays[side].figures(t), error]

    def _plot_yield(self, box: Rectangle) -> RecordedPlot:
        """Data collected by both so far, or their distances from the stations, or the errors of their targets."""
        title, series = "Data delivered, Mbit", [play.delivered for play in self._plays]
        if self._plays[0].stations:
            title, series = "Distance of the AUVs to their stations, m", [play.off_target for play in self._plays]
        if self._plays[0].tracks:
            title, series = "Error of the targets, m", [play.track_error for play in self._plays]
            late = np.concatenate([play.track_error[settled(play.trace)] for play in self._plays])
            low, high = np.quantile(late, (0.01, 0.998)).tolist()
            return self._plot(box, title, series, max(low, LOWEST), max(high, 1.5 * low, 2 * LOWEST), log=True)
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
        for play, values, entry in zip(self._plays, series, self._entries, strict=True):
            plot.curve(play.trace.time, values, entry.colour, entry.dash * layout.unit)
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
