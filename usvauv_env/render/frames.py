"""Frames of a mission's video, drawn from a trace: map, perspective or both, and two missions side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import style
from usvauv.env.render.layout import (
    Bars,
    Head,
    Layout,
    MapView,
    Rectangle,
    design_unit,
    draw_card,
    draw_legend,
    within_margins,
    write_heading,
)
from usvauv.env.render.map import MissionMap, draw_map_axes, view_note
from usvauv.env.render.mission import RunningMetrics, figures
from usvauv.env.render.perspective import PerspectiveView
from usvauv.env.render.plots import DepthSection, FixInsets, RecordedPlot
from usvauv.env.render.style import Colour, Theme
from usvauv.kernels.errors import UserError

VIEWS = ("map", "sea", "both")


class Frames(Protocol):
    """Draws frames in order of time."""

    def frame(self, t: int) -> np.ndarray:
        """Picture (height, width, 3) BGR of step t; overwritten by the next."""
        ...


def frames_of(
    traces: Sequence[Trace], size: tuple[int, int], view: str = "map", theme: str = "dark", speed_up: float = 1.0
) -> Frames:
    """Frames of world 0 of a trace, or of two traces side by side.

    Args:
        traces: one, or two that are compared; each of at least one step.
        size: width and height of a frame, pixels.
        view: one of `VIEWS`: the map from above with plots, the sea in perspective, or the map with it beside.
        theme: name of one of `style.THEMES`.
        speed_up: play speed that the title states, s of mission in a second.

    Raises:
        UserError: more than two traces, or two that cannot be compared.
    """
    if len(traces) > 2:
        raise UserError(f"{len(traces)} traces: at most two can be compared")
    shown = [trace.episode(0) for trace in traces]
    if len(shown) == 2:
        return ComparisonFrames(shown[0], shown[1], size, style.THEMES[theme], speed_up)
    if view == "sea":
        return SeaFrames(shown[0], size, style.THEMES[theme], speed_up)
    return MapFrames(shown[0], size, style.THEMES[theme], speed_up, perspective=view == "both")


def blank(size: tuple[int, int], theme: Theme) -> np.ndarray:
    """An empty picture of a width and height."""
    return np.full((size[1], size[0], 3), theme.background, np.uint8)


def title_of(trace: Trace) -> tuple[str, str]:
    """Both lines of the title."""
    return f"Scenario “{trace.scenario.name}”", f"policy {trace.policy} · boat {trace.usv} · seed {trace.seed}"


class MapFrames:
    """The map beside a panel."""

    def __init__(
        self, trace: Trace, size: tuple[int, int], theme: Theme, speed_up: float, perspective: bool = False
    ) -> None:
        area, running = trace.scenario.area, RunningMetrics.of(trace)
        self.layout = Layout.fit(*size, area, theme=theme)
        self._still = blank(size, theme)
        self._picture = np.empty_like(self._still)
        self.map = MissionMap(trace, running, self.layout)
        draw_map_axes(self._still, self.map, self.layout, area, view_note(trace.scenario))
        if self.layout.legend:
            foresees = not np.array_equal(trace.foreseen_position, trace.estimate)
            draw_legend(self._still, self.layout.legend, self.layout, trace.scenario.task, foresees)
        self.panel = SidePanel(self._still, trace, running, self.map.view, self.layout, perspective, speed_up)

    def frame(self, t: int) -> np.ndarray:
        self.panel.advance(t)
        np.copyto(self._picture, self._still)
        self.map.draw(self._picture, t)
        self.panel.draw(self._picture, t)
        return self._picture


class SeaFrames:
    """The sea in perspective between title and figures."""

    def __init__(self, trace: Trace, size: tuple[int, int], theme: Theme, speed_up: float) -> None:
        unit = design_unit(*size)
        margin, title_height, tiles_height = round(10 * unit), round(56 * unit), round(54 * unit)
        title = Rectangle(margin, margin // 2, size[0] - 2 * margin, title_height)
        tiles = Rectangle(margin, size[1] - margin - tiles_height, title.width, tiles_height)
        top = title.bottom + margin // 2
        room = Rectangle(margin, top, title.width, tiles.top - margin // 2 - top)
        layout = Layout(*size, unit, room, room, None, theme)
        self._trace, self._running = trace, RunningMetrics.of(trace)
        self._still = blank(size, theme)
        self._picture = np.empty_like(self._still)
        names = [name for name, _, _ in figures(trace, self._running, 0)]
        self._head = Head(self._still, title, tiles, layout, title_of(trace), names, float(trace.time[-1]), speed_up)
        self._view = PerspectiveView(trace, self._running, room, layout)

    def frame(self, t: int) -> np.ndarray:
        time, shown = self._trace.time, figures(self._trace, self._running, t)
        np.copyto(self._picture, self._still)
        self._view.draw(self._picture, t)
        values = [f"{value:{form}}" for _, value, form in shown]
        self._head.draw(self._picture, float(time[t]), (t + 1) / len(time), values)
        return self._picture


LOWEST = 1e-3  # m, of the error plot


class ComparisonFrames:
    """Two traces of one world each side by side, up to the end of the shorter one, and how far they are apart."""

    def __init__(self, first: Trace, second: Trace, size: tuple[int, int], theme: Theme, speed_up: float) -> None:
        check_comparable(first, second)
        (width, height), unit = size, design_unit(*size)
        self._traces = first, second
        self._running = [RunningMetrics.of(trace) for trace in self._traces]
        self._colours: tuple[Colour, Colour] = theme.vehicles[0], theme.vehicles[1]
        self._still = blank(size, theme)
        self._picture = np.empty_like(self._still)
        margin, gap = round(10 * unit), round(7 * unit)
        plots_height, tiles_height, title_height = round(130 * unit), round(54 * unit), round(56 * unit)
        about = differences(first, second)
        self._end = float(first.time[min(len(trace.time) for trace in self._traces) - 1])
        self._heads, self._maps = [], []
        across, row = width // 2 - 2 * margin, height - margin - plots_height - gap - tiles_height
        for side, (trace, running) in enumerate(zip(self._traces, self._running, strict=True)):
            left = side * (width // 2) + margin
            title, tiles = (
                Rectangle(left, margin // 2, across, title_height),
                Rectangle(left, row, across, tiles_height),
            )
            room = Rectangle(
                left + round(36 * unit), margin + title_height + round(28 * unit), across - round(40 * unit), 0
            )
            room = room._replace(height=row - gap - round(40 * unit) - room.top)
            layout = Layout(width, height, unit, _fitted(room, trace), room, None, theme, left)
            self._maps.append(MissionMap(trace, running, layout))
            draw_map_axes(self._still, self._maps[side], layout, trace.scenario.area, "")
            names = [name for name, _, _ in figures(trace, running, 0)]
            words = about[side], f"scenario {trace.scenario.name} · seed {trace.seed}"
            self._heads.append(Head(self._still, title, tiles, layout, words, names, self._end, speed_up))
        self._layout = layout
        top = height - margin - plots_height
        boxes = [Rectangle(head.tiles.left, top, across, plots_height) for head in self._heads]
        for box in boxes:
            draw_card(self._still, box, layout)
        self._plots = [self._plot_yield(boxes[0], about), self._plot_errors(boxes[1])]

    def _plot_yield(self, box: Rectangle, about: tuple[str, str]) -> RecordedPlot:
        """What both have brought in so far, or how far both are off station."""
        stations = self._traces[0].scenario.task == "station-keeping"
        series = [running.off_target if stations else running.delivered for running in self._running]
        title = "Distance of the AUVs to their stations, m" if stations else "Data delivered, Mbit"
        write_heading(self._still, self._layout, box, title, " · ".join(about))
        return self._plot(box, series, 0.0, max(float(values.max()) for values in series) or 1.0)

    def _plot_errors(self, box: Rectangle) -> RecordedPlot:
        """Errors of the boat's estimates, rms over AUVs, median of 30 s each."""
        series = [np.sqrt(np.square(running.error_median).mean(axis=1)) for running in self._running]
        write_heading(self._still, self._layout, box, "Position error, m", "rms over AUVs of medians of 30 s")
        high = max(float(values.max()) for values in series)
        low = max(min(float(np.quantile(values, 0.02)) for values in series), LOWEST)
        return self._plot(box, series, low, max(high, 1.5 * low), log=True)

    def _plot(
        self, box: Rectangle, series: list[np.ndarray], low: float, high: float, log: bool = False
    ) -> RecordedPlot:
        layout = self._layout
        room = within_margins(box, layout.unit, top=28, sides=18, bottom=20, left=42)
        plot = RecordedPlot(self._still, room, low, high, self._end, layout, log=log)
        for trace, values, colour in zip(self._traces, series, self._colours, strict=True):
            plot.curve(trace.time, values, colour)
        plot.finish()
        return plot

    def frame(self, t: int) -> np.ndarray:
        time = float(self._traces[0].time[t])
        for plot in self._plots:
            plot.show_until(time)
        np.copyto(self._picture, self._still)
        shown = [figures(trace, running, t) for trace, running in zip(self._traces, self._running, strict=True)]
        for side, head in enumerate(self._heads):
            self._maps[side].draw(self._picture, t)
            values = []
            for (_, value, form), (_, other, _) in zip(shown[side], shown[1 - side], strict=True):
                more = f" ({value - other:+{form}})" if side == 1 else ""
                values.append(f"{value:{form}}{more}".replace("-", "−"))
            head.draw(self._picture, time, time / self._end, values)
            head.tiles._replace(width=self._layout.px(4)).of(self._picture)[:] = self._colours[side]
        for plot in self._plots:
            plot.draw_cursor(self._picture, time)
        return self._picture


def _fitted(room: Rectangle, trace: Trace) -> Rectangle:
    """The largest map of the area, true to scale, in the middle of a rectangle."""
    area = trace.scenario.area
    scale = min(room.width / area.width, room.height / area.length)
    across, up = max(round(scale * area.width), 8), max(round(scale * area.length), 8)
    return Rectangle(room.left + (room.width - across) // 2, room.top + (room.height - up) // 2, across, up)


def differences(first: Trace, second: Trace) -> tuple[str, str]:
    """What each of two runs has that the other has not, in a few words."""
    named = [
        {
            "policy": trace.policy,
            "boat": trace.usv,
            "targets": trace.scenario.nodes.target_rule,
            "seed": str(trace.seed),
            "scenario": trace.scenario.name,
        }
        for trace in (first, second)
    ]
    differ = [name for name in named[0] if named[0][name] != named[1][name]] or ["policy"]
    one, other = (" · ".join(f"{name} {which[name]}" for name in differ) for which in named)
    return one, other


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


GAP = 7.0  # pixels of the design between cards
HEIGHTS = {"title": 56.0, "tiles": 54.0, "reward": 44.0}
SHARES = {"fixes": 0.42, "perspective": 0.64, "errors": 0.33, "section": 0.25}  # of the rest of the height
TERMS = 5  # of the reward that are shown, the largest
ROOMY = 500.0  # pixels of the design, height from which on a panel has all cards


class SidePanel:
    """Draws still parts once and plots step by step on the picture `still`, the rest on each frame.

    Args:
        still: picture that frames are copied from.
        view: of the map.
        perspective: show the sea in perspective in place of fixes and section.
        speed_up: play speed that the title states.
    """

    def __init__(
        self,
        still: np.ndarray,
        trace: Trace,
        running: RunningMetrics,
        view: MapView,
        layout: Layout,
        perspective: bool,
        speed_up: float,
    ) -> None:
        self._still, self._trace, self._running, self._layout = still, trace, running, layout
        boxes = self._divide(perspective)
        for name, box in boxes.items():
            if name not in ("title", "tiles"):
                draw_card(still, box, layout)
        self._insets = self._section = self._perspective = self._bars = None
        if "fixes" in boxes:
            self._insets = self._place_insets(boxes["fixes"], view)
        if "section" in boxes:
            self._section = DepthSection(still, trace, boxes["section"], layout)
        if "perspective" in boxes:
            room = within_margins(boxes["perspective"], layout.unit, top=4, sides=4, bottom=4)
            self._perspective = PerspectiveView(trace, running, room, layout)
        size = np.abs(running.reward).max(axis=0)
        self._terms = sorted(np.argsort(-size)[:TERMS].tolist()) if len(size) > TERMS else list(range(len(size)))
        self._terms = [term for term in self._terms if size[term] > 0] or self._terms[:1]
        if "reward" in boxes:
            scale = max(float(np.quantile(np.abs(running.reward[:, self._terms]), 0.98)), 1e-9)
            names = [trace.reward_names[term] for term in self._terms]
            self._bars = Bars(still, boxes["reward"], layout, ("reward a step,", "last 30 s"), names, scale)
        duration = max(float(trace.time[-1]), trace.scenario.mission.step)
        self._error_plot = error_plot(still, trace, running, boxes["errors"], layout, duration)
        names = [name for name, _, _ in figures(trace, running, 0)]
        end = float(trace.time[-1])
        self._head = Head(still, boxes["title"], boxes["tiles"], layout, title_of(trace), names, end, speed_up)

    def _divide(self, perspective: bool) -> dict[str, Rectangle]:
        """The cards from the top to the bottom, by name."""
        box, unit = self._layout.panel, self._layout.unit
        roomy = box.height >= ROOMY * unit
        fixed = ["title", "tiles", *(["reward"] if roomy else [])]
        rest = ["perspective", "errors"] if perspective else ["fixes", "errors", *(["section"] if roomy else [])]
        names, gap = [*fixed, *rest], round(GAP * unit)
        heights = {name: round(HEIGHTS[name] * unit) for name in fixed}
        left = box.height - sum(heights.values()) - gap * (len(names) - 1)
        shared = sum(SHARES[name] for name in rest)
        for name in rest[:-1]:
            heights[name] = round(SHARES[name] / shared * left)
        heights[rest[-1]] = left - sum(heights[name] for name in rest[:-1])
        boxes, top = {}, box.top
        for name in names:
            boxes[name] = Rectangle(box.left, top, box.width, heights[name])
            top += heights[name] + gap
        return boxes

    def _place_insets(self, box: Rectangle, view: MapView) -> FixInsets:
        layout = self._layout
        room = within_margins(box, layout.unit, top=30, sides=8, bottom=2)
        insets = FixInsets(self._trace, self._running, layout, room, view)
        scale = insets.magnification
        shown = f"{scale:.0f} × magnified" if scale >= 1 else f"{1 / scale:.0f} × smaller than on the map"
        heading = f"Fixes around the true position, {shown}"
        write_heading(self._still, layout, box, heading, f"inner ring {insets.ring:g} m")
        insets.draw_still(self._still)
        return insets

    def advance(self, t: int) -> None:
        """Show the plots up to step t on the still picture."""
        self._error_plot.show_until(float(self._trace.time[t]))

    def draw(self, picture: np.ndarray, t: int) -> None:
        """Draw the moving parts of step t over a copy of the still picture."""
        time, trace = float(self._trace.time[t]), self._trace
        values = [f"{value:{form}}" for _, value, form in figures(trace, self._running, t)]
        self._head.draw(picture, time, (t + 1) / len(trace.time), values)
        if self._bars:
            self._bars.draw(picture, self._running.reward[t, self._terms].tolist())
        if self._insets:
            self._insets.draw(picture, t)
        if self._section:
            self._section.draw(picture, t)
        if self._perspective:
            self._perspective.draw(picture, t)
        self._error_plot.draw_cursor(picture, time)


def error_plot(
    still: np.ndarray, trace: Trace, running: RunningMetrics, box: Rectangle, layout: Layout, duration: float
) -> RecordedPlot:
    """Plot of the errors of the boat's estimates, each AUV in its colour."""
    unit, theme, error = layout.unit, layout.theme, running.position_error
    low, high = np.quantile(error, (0.03, 0.998))
    low = max(float(low), 1e-9)
    room = within_margins(box, unit, top=28, sides=18, bottom=20, left=42)
    plot = RecordedPlot(still, room, low, max(float(high), 1.5 * low), duration, layout, log=True)
    scenario = trace.scenario
    filtered = scenario.tracker.enabled or scenario.navigation.sensor != "none"
    of, dots = ("estimates", "step") if filtered else ("fixes", "fix")
    write_heading(still, layout, box, f"Position error of the {of}, m", f"dots: each {dots} · line: median of 30 s")
    for auv in range(error.shape[1]):
        plot.dots(trace.time, error[:, auv], style.mix(theme.card, theme.auv(auv), 0.45))
    for auv in range(error.shape[1]):
        plot.curve(trace.time, running.error_median[:, auv], theme.auv(auv))
    plot.finish()
    return plot
