"""The side panel: what is shown, the clock, the figures so far, lenses on the fixes, plots, legend."""

from __future__ import annotations

import cv2
import numpy as np

from usvauv_cli import style
from usvauv_cli.layout import Layout, MapView, Rectangle, nice_above
from usvauv_cli.lens import Lenses
from usvauv_cli.plot import TimePlot, clock
from usvauv_cli.running import Running
from usvauv_cli.text import shorten, text_width, write
from usvauv_env.trace import Trace


class Panel:
    """Draws its still parts once and its plots step by step on `still`, and the rest on each frame."""

    def __init__(
        self, still: np.ndarray, trace: Trace, running: Running, layout: Layout, view: MapView, speed_up: float
    ) -> None:
        self._still, self._trace, self._running, self._layout = still, trace, running, layout
        self._elevation = trace.boat_surface[:, 0, 0]
        self._speed_up = speed_up
        unit, box = layout.unit, layout.panel
        gap, heights = round(7 * unit), self._heights()
        tops = [box.top + sum(heights[:place]) + place * gap for place in range(len(heights))]
        boxes = [Rectangle(box.left, top, box.width, height) for top, height in zip(tops, heights, strict=True)]
        self._title, self._tiles, lens_box, error_box, heave_box = boxes
        for card in boxes[1:]:
            draw_card(still, card, unit)
        self._lenses = Lenses(trace, running, layout, _inside(lens_box, unit, top=30, sides=8, bottom=2), view)
        magnified = f"Fixes around the true position, {self._lenses.magnification:.0f} × magnified"
        self._heading(lens_box, magnified, f"inner ring {self._lenses.ring:g} m")
        self._lenses.draw_still(still)
        duration = float(trace.time[-1])
        self._error_plot = self._plot_errors(error_box, duration)
        self._heave_plot = self._plot_heave(heave_box, duration)
        self._write_title()

    def _heights(self) -> list[int]:
        """Heights of title, figures, lenses, fix errors and heave, pixels."""
        layout = self._layout
        fixed = [round(height * layout.unit) for height in (56, 54)]
        rest = layout.panel.height - sum(fixed) - 4 * round(7 * layout.unit)
        lenses, errors = round(0.42 * rest), round(0.35 * rest)
        return [*fixed, lenses, errors, rest - lenses - errors]

    def _heading(self, box: Rectangle, text: str, note: str = "") -> None:
        """Title of a card, and a note at the right if there is room for both."""
        unit, line = self._layout.unit, box.top + 18 * self._layout.unit
        room = box.width - 20 * unit
        text = shorten(text, 12 * unit, room, bold=True)
        write(self._still, text, (box.left + 10 * unit, line), 12 * unit, style.TEXT, bold=True)
        if text_width(text, 12 * unit, bold=True) + 12 * unit + text_width(note, 11 * unit) < room:
            write(self._still, note, (box.right - 10 * unit, line), 11 * unit, style.MUTED, anchor="right")

    def _plot_errors(self, box: Rectangle, duration: float) -> TimePlot:
        unit, error = self._layout.unit, self._running.fix_error
        low, high = np.quantile(error, (0.03, 0.998))
        low = max(float(low), 1e-9)
        plot = TimePlot(
            self._still,
            _inside(box, unit, top=28, sides=18, bottom=20, left=42),
            low,
            max(float(high), 1.5 * low),
            duration,
            self._layout,
            log=True,
        )
        self._heading(box, "Position error of the fixes, m", "dots: each fix · line: median of 30 s")
        time, auvs = self._trace.time, range(error.shape[1])
        for auv in auvs:
            plot.dots(time, error[:, auv], style.mix(style.CARD, style.auv_colour(auv), 0.45))
        for auv in auvs:
            plot.curve(time, self._running.fix_median[:, auv], style.auv_colour(auv))
        plot.finish()
        return plot

    def _plot_heave(self, box: Rectangle, duration: float) -> TimePlot:
        unit = self._layout.unit
        limit = nice_above(max(float(np.abs(self._elevation).max()), 1.0))
        inside = _inside(box, unit, top=28, sides=18, bottom=20, left=42)
        plot = TimePlot(self._still, inside, -limit, limit, duration, self._layout)
        self._heading(box, "Sea surface η under the boat, m")
        plot.area(self._trace.time, self._elevation, style.mix(style.CARD, style.SEA[3], 0.55))
        plot.curve(self._trace.time, self._elevation, style.SEA[4])
        plot.finish()
        return plot

    def _write_title(self) -> None:
        trace, unit, box = self._trace, self._layout.unit, self._title
        end, edge = clock(float(trace.time[-1])), 2 * unit
        room = box.width - text_width(end, 24 * unit, bold=True) - 14 * unit
        name = shorten(f"Scenario “{trace.scenario.name}”", 21 * unit, room, bold=True)
        write(self._still, name, (box.left + edge, box.top + 24 * unit), 21 * unit, style.TEXT, bold=True)
        line, size = box.top + 44 * unit, 12 * unit
        pace = f"of {end} · {self._speed_up:g} × speed"
        run = f"policy {trace.policy} · boat {trace.usv} · seed {trace.seed}"
        run = shorten(run, size, box.width - text_width(pace, size) - 14 * unit)
        write(self._still, run, (box.left + edge, line), size, style.MUTED)
        write(self._still, pace, (box.right - edge, line), size, style.MUTED, anchor="right")

    def figures(self, t: int) -> list[tuple[str, str]]:
        """What the tiles say at step t: name with unit, and value."""
        running = self._running
        return [
            ("SDR, Mbit/s", f"{running.sdr[t]:.2f}"),
            ("EC, W", f"{running.ec[t]:.1f}"),
            ("services", f"{running.services[t]}"),
            ("delivered, Mbit", f"{running.delivered[t]:.1f}"),
            ("full nodes", f"{running.full_now[t]} of {self._trace.node_rate.shape[1]}"),
        ]

    def advance(self, t: int) -> None:
        """Uncover the plots up to step t on the still picture."""
        for plot in (self._error_plot, self._heave_plot):
            plot.uncover(float(self._trace.time[t]))

    def draw(self, picture: np.ndarray, t: int) -> None:
        """Draw what changes in each frame over a copy of the still picture."""
        unit, layout, box = self._layout.unit, self._layout, self._title
        now, corner = clock(float(self._trace.time[t])), (box.right - 2 * unit, box.top + 24 * unit)
        write(picture, now, corner, 24 * unit, style.TEXT, bold=True, anchor="right")
        top, done = round(box.bottom - 2 * unit), round(box.width * (t + 1) / len(self._trace.time))
        bar = picture[top : top + layout.px(3), box.left : box.right]
        bar[:], bar[:, :done] = style.LINE, style.MUTED
        self._write_tiles(picture, t)
        self._lenses.draw(picture, t)
        for plot in (self._error_plot, self._heave_plot):
            plot.draw_cursor(picture, float(self._trace.time[t]))
        box = self._heave_plot.box
        corner = box.right, box.top - 10 * unit
        height = f"{self._elevation[t]:+.2f} m"
        write(picture, height, corner, 12 * unit, style.SEA[4], bold=True, anchor="right")

    def _write_tiles(self, picture: np.ndarray, t: int) -> None:
        unit, box = self._layout.unit, self._tiles
        figures = self.figures(t)
        across = box.width / len(figures)
        for place, (name, value) in enumerate(figures):
            left, room = box.left + place * across + 10 * unit, across - 14 * unit
            write(picture, name, (left, box.top + 17 * unit), self._fitting(name, 11 * unit, room), style.MUTED)
            size = self._fitting(value, 20 * unit, room, bold=True)
            write(picture, value, (left, box.top + 42 * unit), size, style.TEXT, bold=True)

    @staticmethod
    def _fitting(text: str, size: float, room: float, bold: bool = False) -> float:
        """The size, or a smaller one at which the text is no wider than `room`."""
        width = text_width(text, size, bold)
        return size if width <= room else size * max(room, 1.0) / width


def draw_card(picture: np.ndarray, box: Rectangle, unit: float) -> None:
    """A rounded background."""
    radius = max(1, round(5 * unit))
    left, top, right, bottom = box.left, box.top, box.right - 1, box.bottom - 1
    cv2.rectangle(picture, (left + radius, top), (right - radius, bottom), style.CARD, -1)
    cv2.rectangle(picture, (left, top + radius), (right, bottom - radius), style.CARD, -1)
    for x in (left + radius, right - radius):
        for y in (top + radius, bottom - radius):
            cv2.circle(picture, (x, y), radius, style.CARD, -1, cv2.LINE_AA)


def _inside(
    box: Rectangle, unit: float, top: float, sides: float, bottom: float, left: float | None = None
) -> Rectangle:
    """The box less margins of the design."""
    a, b, c = round((sides if left is None else left) * unit), round(sides * unit), round(top * unit)
    return Rectangle(
        box.left + a, box.top + c, max(box.width - a - b, 8), max(box.height - c - round(bottom * unit), 8)
    )
