"""Frames that show two missions side by side, and how far they are apart."""

from __future__ import annotations

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render.frame_layout import Layout, Rectangle, design_unit
from usvauv.env.render.map import MissionMap
from usvauv.env.render.map_axes import draw_map_axes
from usvauv.env.render.panel_elements import (
    draw_card,
    draw_clock,
    fill_tiles,
    name_tiles,
    within_margins,
    write_heading,
    write_title,
)
from usvauv.env.render.plots import RecordedPlot
from usvauv.env.render.running_metrics import RunningMetrics, figures
from usvauv.env.render.style import Colour, Theme
from usvauv.kernels.errors import UserError

LOWEST = 1e-3  # m, of the error plot


class Comparison:
    """Draws two traces of one world each, up to the end of the shorter one.

    Args:
        size: width and height of a frame, pixels.
        speed_up: play speed that the title tells, s of mission in a second.
    """

    def __init__(self, first: Trace, second: Trace, size: tuple[int, int], theme: Theme, speed_up: float) -> None:
        width, height = size
        check(first, second)
        unit, self._traces = design_unit(width, height), (first, second)
        self._running = [RunningMetrics.of(trace) for trace in self._traces]
        self._colours: tuple[Colour, Colour] = theme.vehicles[0], theme.vehicles[1]
        self._still = np.full((height, width, 3), theme.background, np.uint8)
        self._picture = np.empty_like(self._still)
        margin, gap = round(10 * unit), round(7 * unit)
        plots, tiles, title = round(130 * unit), round(54 * unit), round(56 * unit)
        self._titles, self._tiles, self._maps, self._layouts = [], [], [], []
        about = differences(first, second)
        steps = min(len(trace.time) for trace in self._traces)
        self._end = float(first.time[steps - 1])
        half = width // 2
        for side, trace in enumerate(self._traces):
            left = side * half + margin
            across = half - 2 * margin
            self._titles.append(Rectangle(left, margin // 2, across, title))
            row = height - margin - plots - gap - tiles
            self._tiles.append(Rectangle(left, row, across, tiles))
            room = Rectangle(left + round(36 * unit), margin + title + round(28 * unit), across - round(40 * unit), 0)
            room = room._replace(height=row - gap - round(40 * unit) - room.top)
            layout = Layout(width, height, unit, _fitted(room, trace), room, None, theme, left)
            self._layouts.append(layout)
            view = MissionMap(trace, self._running[side], layout)
            self._maps.append(view)
            draw_map_axes(self._still, view, layout, trace.scenario.area, "")
            draw_card(self._still, self._tiles[side], layout)
            names = [name for name, _, _ in figures(trace, self._running[side], 0)]
            name_tiles(self._still, self._tiles[side], layout, names)
            write_title(
                self._still,
                self._titles[side],
                layout,
                about[side],
                f"scenario {trace.scenario.name} · seed {trace.seed}",
                self._end,
                speed_up,
            )
        boxes = [Rectangle(side * half + margin, height - margin - plots, half - 2 * margin, plots) for side in (0, 1)]
        for box in boxes:
            draw_card(self._still, box, self._layouts[0])
        self._plots = [self._plot_yield(boxes[0], about), self._plot_errors(boxes[1])]

    def _plot_yield(self, box: Rectangle, about: tuple[str, str]) -> RecordedPlot:
        """What both have brought in so far, or how far both are off station."""
        stations = self._traces[0].scenario.task == "station-keeping"
        series = [running.off_target if stations else running.delivered for running in self._running]
        title = "Distance of the AUVs to their stations, m" if stations else "Data delivered, Mbit"
        write_heading(self._still, self._layouts[0], box, title, " · ".join(about))
        return self._plot(box, series, 0.0, max(float(values.max()) for values in series) or 1.0)

    def _plot_errors(self, box: Rectangle) -> RecordedPlot:
        """Errors of the boat's estimates, rms over AUVs, median of 30 s each."""
        series = [np.sqrt(np.square(running.error_median).mean(axis=1)) for running in self._running]
        write_heading(self._still, self._layouts[0], box, "Position error, m", "rms over AUVs of medians of 30 s")
        high = max(float(values.max()) for values in series)
        low = max(min(float(np.quantile(values, 0.02)) for values in series), LOWEST)
        return self._plot(box, series, low, max(high, 1.5 * low), log=True)

    def _plot(
        self, box: Rectangle, series: list[np.ndarray], low: float, high: float, log: bool = False
    ) -> RecordedPlot:
        layout = self._layouts[0]
        room = within_margins(box, layout.unit, top=28, sides=18, bottom=20, left=42)
        plot = RecordedPlot(self._still, room, low, high, self._end, layout, log=log)
        for trace, values, colour in zip(self._traces, series, self._colours, strict=True):
            plot.curve(trace.time, values, colour)
        plot.finish()
        return plot

    def frame(self, t: int) -> np.ndarray:
        """Picture (height, width, 3) BGR of step t; overwritten by the next."""
        time = float(self._traces[0].time[t])
        for plot in self._plots:
            plot.show_until(time)
        np.copyto(self._picture, self._still)
        shown = [figures(trace, running, t) for trace, running in zip(self._traces, self._running, strict=True)]
        for side, layout in enumerate(self._layouts):
            self._maps[side].draw(self._picture, t)
            draw_clock(self._picture, self._titles[side], layout, time, time / self._end)
            tiles = []
            for (_, value, form), (_, other, _) in zip(shown[side], shown[1 - side], strict=True):
                more = f" ({value - other:+{form}})" if side == 1 else ""
                tiles.append(f"{value:{form}}{more}".replace("-", "−"))
            fill_tiles(self._picture, self._tiles[side], layout, tiles)
            mark = self._tiles[side]
            self._picture[mark.top : mark.bottom, mark.left : mark.left + layout.px(4)] = self._colours[side]
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


def check(first: Trace, second: Trace) -> None:
    """Refuse two traces that cannot be shown in step.

    Raises:
        UserError: another mission step or another task.
    """
    one, other = first.scenario, second.scenario
    if one.mission.step != other.mission.step:
        raise UserError(f"mission steps of {one.mission.step:g} s and {other.mission.step:g} s cannot be compared")
    if one.task != other.task:
        raise UserError(f"tasks {one.task} and {other.task} cannot be compared")
