"""Frames of a mission's video, drawn from a trace: map, perspective or both, and two missions side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import shapes, style
from usvauv.env.render.arrangement import Sheet
from usvauv.env.render.between import Series, Vehicle, step_of
from usvauv.env.render.comparison import ComparisonFrames
from usvauv.env.render.layout import (
    AXES,
    SMALLEST_LETTERS,
    Head,
    Layout,
    Rectangle,
    draw_card,
    fitting,
    within_margins,
    write_heading,
)
from usvauv.env.render.legend import draw_legend
from usvauv.env.render.map import MissionMap, draw_map_axes, view_note
from usvauv.env.render.mission import RunningMetrics, figures
from usvauv.env.render.perspective import PerspectiveView
from usvauv.env.render.plots import DepthSection, FixInsets, RecordedPlot
from usvauv.env.render.style import Theme, text_width, write
from usvauv.env.site.site import Site
from usvauv.kernels.errors import UserError

VIEWS = ("map", "sea", "both")


class Frames(Protocol):
    """Draws frames in order of time."""

    def frame(self, t: float) -> np.ndarray:
        """Picture (height, width, 3) BGR of a moment, in steps from the first; overwritten by the next."""
        ...


def frames_of(
    traces: Sequence[Trace],
    size: tuple[int, int],
    view: str = "map",
    theme: str = "dark",
    speed_up: float = 1.0,
    pace: float = 1.0,
    follow: str = "",
) -> Frames:
    """Frames of world 0 of a trace, or of two traces side by side.

    Args:
        traces: one, or two that are compared; each of at least one step.
        size: width and height of a frame, pixels.
        view: one of `VIEWS`: the map from above with plots, the sea in perspective, or the map with it beside.
        theme: name of one of `style.THEMES`.
        speed_up: play speed that the title states, s of mission in a second.
        pace: steps of the mission from one frame to the next.
        follow: a vehicle that views go along with: usv, usv:N or auv:N; "" for all of the area.

    Raises:
        UserError: more than two traces, two that cannot be compared, or no such vehicle.
    """
    if len(traces) > 2:
        raise UserError(f"{len(traces)} traces: at most two can be compared")
    shown = [trace.episode(0) for trace in traces]
    vehicle = None
    for trace in shown if follow else ():
        vehicle = Vehicle.parse(follow, trace.scenario)
    if len(shown) == 2:
        return ComparisonFrames(shown[0], shown[1], size, style.THEMES[theme], speed_up, pace, vehicle)
    return MissionFrames(shown[0], size, style.THEMES[theme], speed_up, view, pace, vehicle)


def title_of(trace: Trace) -> tuple[str, str]:
    """Both lines of the title."""
    return f"Scenario “{trace.scenario.name}”", f"policy {trace.policy} · boat {trace.usv} · seed {trace.seed}"


TERMS = 5  # of the reward that are shown at most, the largest


class MissionFrames:
    """One mission: a map, a perspective or both, with figures, plots and a legend as there is room for.

    Still parts are drawn once on the picture `_still`, plots step by step, the rest on each frame.

    Attributes:
        layout: of the frame, with its boxes. map: of a view that has one.
    """

    map: MissionMap

    def __init__(
        self,
        trace: Trace,
        size: tuple[int, int],
        theme: Theme,
        speed_up: float,
        view: str = "map",
        pace: float = 1.0,
        follow: Vehicle | None = None,
    ) -> None:
        self._trace, self._running, self._time = trace, RunningMetrics.of(trace, pace), Series(trace.time)
        scenario, names = trace.scenario, [name for name, _, _ in figures(trace, self._running, 0)]
        sheet = Sheet.of(size, scenario.area, names)
        boxes = sheet.boxes(view, trace.auv_depth.size > 0)
        left = max(0, boxes["map"].left - round(AXES[0] * sheet.unit)) if "map" in boxes else 0
        self.layout = layout = Layout(*size, sheet.unit, boxes, theme, left)
        self._still = still = np.full((size[1], size[0], 3), theme.background, np.uint8)
        self._picture = np.empty_like(still)
        for name in boxes.keys() & {"reward", "fixes", "errors", "section", "depth"}:
            draw_card(still, boxes[name], layout)
        self._parts: list[Part] = []
        if "map" in boxes:
            self.map = MissionMap(trace, self._running, layout, follow=follow)
            draw_map_axes(still, self.map, layout, view_note(trace))
            self._parts.append(self.map)
        if "perspective" in boxes:
            self._parts.append(PerspectiveView(trace, self._running, boxes["perspective"], layout, follow))
        if "fixes" in boxes:
            self._parts.append(self._insets(boxes["fixes"]))
        if "section" in boxes:
            self._parts.append(DepthSection(still, trace, self._running, boxes["section"], layout))
        if "reward" in boxes:
            self._parts.append(RewardBars(still, trace, self._running, boxes["reward"], layout))
        if "legend" in boxes:
            foresees = not np.array_equal(trace.foreseen_position, trace.estimate)
            draw_legend(still, boxes["legend"], layout, scenario, foresees, "map" in boxes)
        duration = max(float(trace.time[-1]), scenario.mission.step)
        self._plots: list[RecordedPlot] = []
        if "errors" in boxes:
            self._plots.append(error_plot(still, trace, self._running, boxes["errors"], layout, duration))
        if "depth" in boxes:
            self._plots.append(depth_plot(still, trace, boxes["depth"], layout, duration))
        seen = max(
            (boxes[name] for name in boxes.keys() & {"map", "perspective"}), key=lambda box: box.width * box.height
        )
        if follow and follow.kind == "auv" and trace.auv_fins.size:
            self._parts.append(Instruments(trace, follow.index, seen, layout))
        end, words = float(trace.time[-1]), title_of(trace)
        self._head = Head(still, boxes["title"], boxes.get("tiles"), layout, words, names, end, speed_up)

    def _insets(self, box: Rectangle) -> FixInsets:
        layout, view = self.layout, self.map.view
        room = within_margins(box, layout.unit, top=30, sides=8, bottom=2)
        insets = FixInsets(self._trace, self._running, layout, room, view)
        scale = insets.magnification
        shown = f"{scale:.0f} × magnified" if scale >= 1 else f"{1 / scale:.0f} × smaller than on the map"
        write_heading(
            self._still, layout, box, "Fixes around the true position", f"{shown}, inner ring {insets.ring:g} m"
        )
        insets.draw_still(self._still)
        return insets

    def frame(self, t: float) -> np.ndarray:
        time = float(self._time.at(t))
        for plot in self._plots:
            plot.show_until(time)
        np.copyto(self._picture, self._still)
        for part in self._parts:
            part.draw(self._picture, t)
        values = [f"{value:{form}}" for _, value, form in figures(self._trace, self._running, t)]
        self._head.draw(self._picture, time, (t + 1) / len(self._trace.time), values)
        for plot in self._plots:
            plot.draw_cursor(self._picture, time)
        return self._picture


class Part(Protocol):
    """A part of a frame that is drawn anew each time."""

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw a moment."""
        ...


class RewardBars:
    """The largest terms of the reward side by side, means of the last 30 s, each with a bar from the middle."""

    TITLE = "reward a step,", "last 30 s"

    def __init__(
        self, still: np.ndarray, trace: Trace, running: RunningMetrics, box: Rectangle, layout: Layout
    ) -> None:
        self._layout, self._row, unit, muted = layout, box.top, layout.unit, layout.theme.muted
        size = np.abs(running.reward).max(axis=0)
        largest = [term for term in np.argsort(-size)[:TERMS].tolist() if size[term] > 0] or [0]
        start = box.left + max(text_width(words, 11 * unit) for words in self.TITLE) + 26 * unit
        # As many of them, from the largest one on, as are legible side by side.
        forms = [f"{trace.reward_names[term]} +00.00" for term in largest]
        widths = [text_width(form, SMALLEST_LETTERS) + 10 * unit for form in forms]
        fitting_ones = (n for n in range(1, len(widths) + 1) if n * max(widths[:n]) <= box.right - start)
        terms = sorted(largest[: max(fitting_ones, default=1)])
        self._values = running.reward[:, terms]
        self._scale = max(float(np.quantile(np.abs(self._values), 0.98)), 1e-9)
        across = (box.right - start) / len(terms)
        self._left, self._room = [start + place * across for place in range(len(terms))], across - 10 * unit
        names, row = [trace.reward_names[term] for term in terms], box.top + 30 * unit
        self._size = min(fitting(f"{name} +00.00", 11 * unit, self._room) for name in names)
        for line, words in enumerate(self.TITLE):
            write(still, words, (box.left + 10 * unit, box.top + (18 + 15 * line) * unit), 11 * unit, muted)
        for left, name in zip(self._left, names, strict=True):
            write(still, name, (left, box.top + 18 * unit), self._size, muted)
            ends = np.array([(left, row), (left + self._room, row)])
            shapes.stroke(still, ends, layout.theme.line, layout.px(2))

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw a moment."""
        layout, unit, room = self._layout, self._layout.unit, self._room
        for left, value in zip(self._left, self._values[step_of(t)].tolist(), strict=True):
            number, row = f"{value:+.2f}".replace("-", "−"), self._row + 30 * unit
            position = left + room, self._row + 18 * unit
            write(picture, number, position, self._size, layout.theme.text, anchor="right")
            middle, length = left + room / 2, room / 2 * min(max(value / self._scale, -1.0), 1.0)
            ink = style.GAUGE[0] if value > 0 else style.GAUGE[2]
            shapes.stroke(picture, np.array([(middle, row), (middle + length, row)]), ink, layout.px(4))


class Instruments:
    """What an AUV's instruments say, in the upper left corner of a view that follows it."""

    def __init__(self, trace: Trace, auv: int, view: Rectangle, layout: Layout) -> None:
        heading, pitch, _ = np.degrees(trace.attitude[:, 0, auv]).T
        rudder, stern, propeller = trace.auv_fins[:, 0, auv].astype(float).T
        depth = trace.depth[:, 0, auv]
        self._readings = {
            "heading": (Series(90.0 - heading), "03.0f", "°"),
            "pitch": (Series(pitch), "+.1f", "°"),
            "depth": (Series(depth), ".1f", " m"),
            "altitude": (
                Series(Site.recorded(trace.scenario).depth_at(trace.auv_position[:, 0, auv]) - depth),
                ".1f",
                " m",
            ),
            "speed": (Series(np.hypot(*trace.auv_velocity[:, 0, auv].T)), ".2f", " m/s"),
            "rudder": (Series(np.degrees(rudder)), "+.1f", "°"),
            "stern plane": (Series(np.degrees(stern)), "+.1f", "°"),
            "propeller": (Series(60.0 * propeller), ".0f", " rpm"),
        }
        unit, rows = layout.unit, len(self._readings)
        inset = Rectangle(
            view.left, view.top, min(round(142 * unit), view.width), min(round((15 * rows + 9) * unit), view.height)
        )
        self._box, self._layout = inset, layout

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw a moment."""
        unit, box = self._layout.unit, self._box
        region = box.of(picture)
        region[:] = cv2.addWeighted(region, 0.3, np.full_like(region, style.DARK.card), 0.7, 0)
        for row, (name, (series, form, of)) in enumerate(self._readings.items()):
            value, line = float(series.at(t)), box.top + (15 * row + 15) * unit
            words = f"{value % 360.0 if name == 'heading' else value:{form}}{of}".replace("-", "−")
            write(picture, name, (box.left + 8 * unit, line), 11 * unit, style.DARK.muted)
            write(picture, words, (box.right - 8 * unit, line), 11 * unit, style.DARK.text, bold=True, anchor="right")


def depth_plot(still: np.ndarray, trace: Trace, box: Rectangle, layout: Layout, duration: float) -> RecordedPlot:
    """Plot of the AUVs' depths, each in its colour, over the bed below it."""
    depth, bed = trace.depth[:, 0], Site.recorded(trace.scenario).depth_at(trace.auv_position[:, 0])
    room = within_margins(box, layout.unit, top=28, sides=18, bottom=20, left=42)
    lowest, highest = max(float(bed.max()), float(depth.max())), float(depth.min())
    margin = 0.15 * (lowest - highest)
    plot = RecordedPlot(still, room, lowest + margin, max(highest - margin, 0.0), duration, layout)
    write_heading(still, layout, box, "Depth, m", "dashed: the bed below")
    for auv in range(depth.shape[1]):
        plot.curve(trace.time, bed[:, auv], style.mix(layout.theme.card, layout.theme.auv(auv), 0.6), 5 * layout.unit)
        plot.curve(trace.time, depth[:, auv], layout.theme.auv(auv))
    plot.finish()
    return plot


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
