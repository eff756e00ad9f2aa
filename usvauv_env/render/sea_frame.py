"""Frames that show a mission in perspective only: title, the sea, figures below it."""

from __future__ import annotations

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render.frame_layout import Layout, Rectangle, design_unit
from usvauv.env.render.panel_elements import draw_card, draw_clock, fill_tiles, name_tiles, write_title
from usvauv.env.render.perspective import PerspectiveView
from usvauv.env.render.running_metrics import RunningMetrics, figures
from usvauv.env.render.style import Theme


class SeaFrame:
    """Draws world 0 of a trace of one world.

    Args:
        size: width and height of a frame, pixels.
        speed_up: play speed that the title tells, s of mission in a second.
    """

    def __init__(self, trace: Trace, size: tuple[int, int], theme: Theme, speed_up: float) -> None:
        width, height = size
        unit = design_unit(width, height)
        margin, title, tiles = round(10 * unit), round(56 * unit), round(54 * unit)
        across = width - 2 * margin
        self._title = Rectangle(margin, margin // 2, across, title)
        self._tiles = Rectangle(margin, height - margin - tiles, across, tiles)
        top = self._title.bottom + margin // 2
        room = Rectangle(margin, top, across, self._tiles.top - margin // 2 - top)
        self._layout = Layout(width, height, unit, room, room, None, theme)
        self._trace, self._running = trace, RunningMetrics.of(trace)
        self._still = np.full((height, width, 3), theme.background, np.uint8)
        self._picture = np.empty_like(self._still)
        draw_card(self._still, self._tiles, self._layout)
        names = [name for name, _, _ in figures(trace, self._running, 0)]
        name_tiles(self._still, self._tiles, self._layout, names)
        name = f"Scenario “{trace.scenario.name}”"
        run = f"policy {trace.policy} · boat {trace.usv} · seed {trace.seed}"
        write_title(self._still, self._title, self._layout, name, run, float(trace.time[-1]), speed_up)
        self._view = PerspectiveView(trace, self._running, room, self._layout)

    def frame(self, t: int) -> np.ndarray:
        """Picture (height, width, 3) BGR of step t; overwritten by the next."""
        trace = self._trace
        np.copyto(self._picture, self._still)
        self._view.draw(self._picture, t)
        draw_clock(self._picture, self._title, self._layout, float(trace.time[t]), (t + 1) / len(trace.time))
        shown = [f"{value:{form}}" for _, value, form in figures(trace, self._running, t)]
        fill_tiles(self._picture, self._tiles, self._layout, shown)
        return self._picture
