"""Side panel of a mission: title, clock, figures, reward, fixes or the sea in perspective, errors, a section."""

from __future__ import annotations

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import style
from usvauv.env.render.depth_section import DepthSection
from usvauv.env.render.fix_insets import FixInsets
from usvauv.env.render.frame_layout import Layout, MapView, Rectangle
from usvauv.env.render.panel_elements import (
    Bars,
    draw_card,
    draw_clock,
    fill_tiles,
    name_tiles,
    within_margins,
    write_heading,
    write_title,
)
from usvauv.env.render.perspective import PerspectiveView
from usvauv.env.render.plots import RecordedPlot
from usvauv.env.render.running_metrics import RunningMetrics, figures

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
        speed_up: play speed that the title tells.
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
        self._boxes = boxes = self._divide(perspective)
        for name, box in boxes.items():
            if name != "title":
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
        name_tiles(still, boxes["tiles"], layout, [name for name, _, _ in figures(trace, running, 0)])
        duration = max(float(trace.time[-1]), trace.scenario.mission.step)
        self._error_plot = error_plot(still, trace, running, boxes["errors"], layout, duration)
        name = f"Scenario “{trace.scenario.name}”"
        run = f"policy {trace.policy} · boat {trace.usv} · seed {trace.seed}"
        write_title(still, boxes["title"], layout, name, run, float(trace.time[-1]), speed_up)

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
        layout, time, trace = self._layout, float(self._trace.time[t]), self._trace
        draw_clock(picture, self._boxes["title"], layout, time, (t + 1) / len(trace.time))
        shown = [f"{value:{form}}" for _, value, form in figures(trace, self._running, t)]
        fill_tiles(picture, self._boxes["tiles"], layout, shown)
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
