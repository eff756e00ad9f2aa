"""Side panel of a mission: title, clock, figures so far, insets with the fixes, plots."""

from __future__ import annotations

import numpy as np

from usvauv_env.record.trace import Trace
from usvauv_env.render import style
from usvauv_env.render.fix_insets import FixInsets
from usvauv_env.render.frame_layout import Layout, MapView, Rectangle, nice_above
from usvauv_env.render.panel_elements import (
    draw_card,
    draw_clock,
    draw_tiles,
    within_margins,
    write_heading,
    write_title,
)
from usvauv_env.render.plots import RecordedPlot
from usvauv_env.render.running_metrics import RunningMetrics
from usvauv_env.render.text import write


class SidePanel:
    """Draws still parts once and plots step by step on the picture `still`, the rest on each frame."""

    def __init__(
        self, still: np.ndarray, trace: Trace, running: RunningMetrics, layout: Layout, view: MapView, speed_up: float
    ) -> None:
        self._still, self._trace, self._running, self._layout = still, trace, running, layout
        self._elevation = trace.boat_surface[:, 0, :, 0]
        self._speed_up = speed_up
        box = layout.panel
        gap, heights = round(7 * layout.unit), self._heights()
        tops = [box.top + sum(heights[:place]) + place * gap for place in range(len(heights))]
        boxes = [Rectangle(box.left, top, box.width, height) for top, height in zip(tops, heights, strict=True)]
        self._title, self._tiles, inset_box, error_box, heave_box = boxes
        for card in boxes[1:]:
            draw_card(still, card, layout)
        self._insets = FixInsets(
            trace, running, layout, within_margins(inset_box, layout.unit, top=30, sides=8, bottom=2), view
        )
        scale = self._insets.magnification
        shown = f"{scale:.0f} × magnified" if scale >= 1 else f"{1 / scale:.0f} × smaller than on the map"
        magnified = f"Fixes around the true position, {shown}"
        write_heading(self._still, layout, inset_box, magnified, f"inner ring {self._insets.ring:g} m")
        self._insets.draw_still(still)
        duration = max(float(trace.time[-1]), trace.scenario.mission.step)
        self._error_plot = self._plot_errors(error_box, duration)
        self._heave_plot = self._plot_heave(heave_box, duration)
        self._write_title()

    def _heights(self) -> list[int]:
        """Heights of title, figures, insets, fix errors and heave, pixels."""
        layout = self._layout
        fixed = [round(height * layout.unit) for height in (56, 54)]
        rest = layout.panel.height - sum(fixed) - 4 * round(7 * layout.unit)
        insets, errors = round(0.42 * rest), round(0.35 * rest)
        return [*fixed, insets, errors, rest - insets - errors]

    def _plot_errors(self, box: Rectangle, duration: float) -> RecordedPlot:
        layout, error = self._layout, self._running.position_error
        unit, theme = layout.unit, layout.theme
        low, high = np.quantile(error, (0.03, 0.998))
        low = max(float(low), 1e-9)
        plot = RecordedPlot(
            self._still,
            within_margins(box, unit, top=28, sides=18, bottom=20, left=42),
            low,
            max(float(high), 1.5 * low),
            duration,
            layout,
            log=True,
        )
        scenario = self._trace.scenario
        filtered = scenario.tracker.enabled or scenario.navigation.sensor != "none"
        of, dots = ("estimates", "step") if filtered else ("fixes", "fix")
        write_heading(
            self._still, layout, box, f"Position error of the {of}, m", f"dots: each {dots} · line: median of 30 s"
        )
        time, auvs = self._trace.time, range(error.shape[1])
        for auv in auvs:
            plot.dots(time, error[:, auv], style.mix(theme.card, theme.auv(auv), 0.45))
        for auv in auvs:
            plot.curve(time, self._running.error_median[:, auv], theme.auv(auv))
        plot.finish()
        return plot

    def _plot_heave(self, box: Rectangle, duration: float) -> RecordedPlot:
        layout = self._layout
        unit, theme = layout.unit, layout.theme
        limit = nice_above(max(float(np.abs(self._elevation).max()), 1.0))
        room = within_margins(box, unit, top=28, sides=18, bottom=20, left=42)
        plot = RecordedPlot(self._still, room, -limit, limit, duration, layout)
        boats = "boat" if self._elevation.shape[1] == 1 else "boats"
        write_heading(self._still, layout, box, f"Sea surface η under the {boats}, m")
        plot.area(self._trace.time, self._elevation[:, 0], style.mix(theme.card, style.SEA[3], 0.55))
        for elevation in self._elevation.T:
            plot.curve(self._trace.time, elevation, theme.water)
        plot.finish()
        return plot

    def _write_title(self) -> None:
        trace = self._trace
        name = f"Scenario “{trace.scenario.name}”"
        run = f"policy {trace.policy} · boat {trace.usv} · seed {trace.seed}"
        write_title(self._still, self._title, self._layout, name, run, float(trace.time[-1]), self._speed_up)

    def figures(self, t: int) -> list[tuple[str, str]]:
        """Contents of the tiles at step t: name with unit, and value."""
        running = self._running
        if self._trace.scenario.task == "station-keeping":
            return [
                ("off station, m", f"{running.off_target[t]:.2f}"),
                ("in the mean, m", f"{running.off_target[: t + 1].mean():.2f}"),
                ("power now, W", f"{running.power[t]:.0f}"),
                ("EC, W", f"{running.ec[t]:.1f}"),
                ("AUVs too close", f"{self._trace.collisions[: t + 1, 0].sum()}"),
            ]
        return [
            ("SDR, Mbit/s", f"{running.sdr[t]:.2f}"),
            ("EC, W", f"{running.ec[t]:.1f}"),
            ("services", f"{running.services[t]}"),
            ("delivered, Mbit", f"{running.delivered[t]:.1f}"),
            ("full nodes", f"{running.full_now[t]} of {self._trace.node_rate.shape[1]}"),
        ]

    def advance(self, t: int) -> None:
        """Show the plots up to step t on the still picture."""
        for plot in (self._error_plot, self._heave_plot):
            plot.show_until(float(self._trace.time[t]))

    def draw(self, picture: np.ndarray, t: int) -> None:
        """Draw the moving parts of step t over a copy of the still picture."""
        unit, time = self._layout.unit, float(self._trace.time[t])
        draw_clock(picture, self._title, self._layout, time, (t + 1) / len(self._trace.time))
        draw_tiles(picture, self._tiles, self._layout, self.figures(t))
        self._insets.draw(picture, t)
        for plot in (self._error_plot, self._heave_plot):
            plot.draw_cursor(picture, time)
        box = self._heave_plot.box
        corner = box.right, box.top - 10 * unit
        height = f"{', '.join(f'{elevation:+.2f}' for elevation in self._elevation[t])} m"
        write(picture, height, corner, 12 * unit, self._layout.theme.water, bold=True, anchor="right")
