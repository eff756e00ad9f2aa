"""Frames of a mission's video, drawn from a trace: map, perspective or both, and two missions side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import style
from usvauv.env.render.comparison import Comparison
from usvauv.env.render.frame_layout import Layout
from usvauv.env.render.legend import draw_legend
from usvauv.env.render.map import MissionMap
from usvauv.env.render.map_axes import draw_map_axes, view_note
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.env.render.sea_frame import SeaFrame
from usvauv.env.render.side_panel import SidePanel

VIEWS = ("map", "sea", "both")


@dataclass(frozen=True)
class Look:
    """What a frame shows, and in which colours.

    Attributes:
        view: one of `VIEWS`: the map from above with plots, the sea in perspective, or the map with it beside.
        theme: name of one of `style.THEMES`.
    """

    view: str = "map"
    theme: str = "dark"


class Frames(Protocol):
    """Draws frames in order of time."""

    def frame(self, t: int) -> np.ndarray:
        """Picture (height, width, 3) BGR of step t; overwritten by the next."""
        ...


def painter_of(traces: Sequence[Trace], size: tuple[int, int], look: Look, speed_up: float) -> Frames:
    """What draws world 0 of a trace, or of two traces side by side.

    Args:
        traces: one, or two that are compared; each of at least one step.
        size: width and height of a frame, pixels.
        speed_up: play speed that the title tells, s of mission in a second.
    """
    if len(traces) == 2:
        return Comparison(traces[0].episode(0), traces[1].episode(0), size, style.THEMES[look.theme], speed_up)
    if look.view == "sea":
        return SeaFrame(traces[0].episode(0), size, style.THEMES[look.theme], speed_up)
    return Painter(traces[0], size, look, speed_up)


class Painter:
    """Draws the map of world 0 of a trace beside a panel.

    Args:
        trace: of at least one step.
        size: width and height of a frame, pixels.
        look: view "map" or "both".
        speed_up: play speed that the title tells, s of mission in a second.
    """

    def __init__(self, trace: Trace, size: tuple[int, int], look: Look = Look(), speed_up: float = 1.0) -> None:
        trace = trace.episode(0)
        width, height = size
        area, running, theme = trace.scenario.area, RunningMetrics.of(trace), style.THEMES[look.theme]
        self.layout = Layout.fit(width, height, area, theme=theme)
        self._still = np.full((height, width, 3), theme.background, np.uint8)
        self._picture = np.empty_like(self._still)
        self.map = MissionMap(trace, running, self.layout)
        draw_map_axes(self._still, self.map, self.layout, area, view_note(trace.scenario))
        if self.layout.legend:
            foresees = not np.array_equal(trace.foreseen_position, trace.estimate)
            draw_legend(self._still, self.layout.legend, self.layout, trace.scenario.task, foresees)
        self.panel = SidePanel(self._still, trace, running, self.map.view, self.layout, look.view == "both", speed_up)

    def frame(self, t: int) -> np.ndarray:
        """Picture (height, width, 3) BGR of step t; overwritten by the next."""
        self.panel.advance(t)
        np.copyto(self._picture, self._still)
        self.map.draw(self._picture, t)
        self.panel.draw(self._picture, t)
        return self._picture
