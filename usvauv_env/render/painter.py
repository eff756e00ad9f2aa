"""Frames of a mission's video, drawn from a trace."""

from __future__ import annotations

import numpy as np

from usvauv_env.record.trace import Trace
from usvauv_env.render.frame_layout import Layout
from usvauv_env.render.legend import draw_legend
from usvauv_env.render.map import MissionMap
from usvauv_env.render.map_axes import draw_map_axes, view_note
from usvauv_env.render.running_metrics import RunningMetrics
from usvauv_env.render.side_panel import SidePanel


class Painter:
    """Draws the frames of world 0 of a trace, in order.

    Args:
        trace: of at least one step.
        size: width and height of a frame, pixels.
        fps: frames a second, for the play speed that the title tells.
    """

    def __init__(self, trace: Trace, size: tuple[int, int], fps: int = 30) -> None:
        trace = trace.episode(0)
        width, height = size
        area, running = trace.scenario.area, RunningMetrics.of(trace)
        self.layout = Layout.fit(width, height, area)
        self._still = np.full((height, width, 3), self.layout.theme.background, np.uint8)
        self._picture = np.empty_like(self._still)
        self.map = MissionMap(trace, running, self.layout)
        draw_map_axes(self._still, self.map, self.layout, area, view_note(trace.scenario))
        if self.layout.legend:
            foresees = not np.array_equal(trace.foreseen_position, trace.estimate)
            draw_legend(self._still, self.layout.legend, self.layout, trace.scenario.task, foresees)
        speed_up = fps * trace.scenario.mission.step
        self.panel = SidePanel(self._still, trace, running, self.layout, self.map.view, speed_up)

    def frame(self, t: int) -> np.ndarray:
        """Picture (height, width, 3) BGR of step t; overwritten by the next."""
        self.panel.advance(t)
        np.copyto(self._picture, self._still)
        self.map.draw(self._picture, t)
        self.panel.draw(self._picture, t)
        return self._picture
