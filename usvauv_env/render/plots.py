"""Plots of a panel: series over time, fixes around the true positions, a section of the water."""

from __future__ import annotations

import math
from functools import cached_property

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.layout import (
    SMALLEST_LETTERS,
    Layout,
    Rectangle,
    fitting,
    nice,
    nice_above,
    within_margins,
    write_heading,
)
from usvauv.env.render.mission import Playback, Series, error_axes, step_of
from usvauv.env.render.sea_surface import MapView
from usvauv.env.render.style import Colour, clock, text_width, write
from usvauv.env.storage.memory import extremes

LOG_STEPS = (1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)
FEWEST_TICKS, MOST_TICKS = 3, 6
TIME_TICKS = (5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600, 7200)  # s


class Plot:
    """Axes of a plot on a still picture: values at the left, times below.

    Args:
        still: picture (height, width, 3) that the axes are drawn on.
        box: of the plot, without the numbers at its axes.
        low, high: lower and upper end of the value axis; above 0 where it is logarithmic.
        duration: right end of the time axis, s.
        layout: of the frame.
        log: whether the value axis is logarithmic.
    """

    def __init__(
        self,
        still: np.ndarray,
        box: Rectangle,
        low: float,
        high: float,
        duration: float,
        layout: Layout,
        log: bool = False,
    ) -> None:
        self.box, self._theme = box, layout.theme
        unit = layout.unit
        self._unit, self._log, self._duration, self._values = unit, log, duration, (low, high)
        self._low, self._high = (math.log(low), math.log(high)) if log else (low, high)
        self._still = still
        self._draw_axes()
        self._zoom = layout.zoom  # curves are drawn magnified and averaged, see `shapes.smooth`
        self._fine = cv2.resize(box.of(still), None, fx=self._zoom, fy=self._zoom, interpolation=cv2.INTER_NEAREST)
        self._line_width = max(1, round(1.7 * unit * self._zoom))

    def y(self, values: np.ndarray | float) -> np.ndarray:
        """Rows of values in the frame, clipped to the plot."""
        values = np.log(np.maximum(values, 1e-12)) if self._log else np.asarray(values, float)
        share = np.clip((values - self._low) / (self._high - self._low), 0, 1)
        return self.box.bottom - 1 - share * (self.box.height - 1)

    def x(self, time: np.ndarray | float) -> np.ndarray:
        """Columns of times (s) in the frame."""
        return self.box.left + np.asarray(time, float) / self._duration * (self.box.width - 1)

    def _value_ticks(self) -> list[float]:
        low, high = sorted(self._values)
        if self._log:
            powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
            for steps in LOG_STEPS:
                ticks = [step * 10.0**power for power in powers for step in steps]
                ticks = [tick for tick in ticks if low <= tick <= high]
                if len(ticks) >= FEWEST_TICKS:
                    return ticks
        most = min(max(5 if self._log else 2, self.box.height // (18 * self._unit)), MOST_TICKS)
        ticks: list[float] = []
        for rounded in (nice_above, nice):
            spacing = rounded((high - low) / most)
            ticks = [i * spacing for i in range(math.ceil(low / spacing), math.floor(high / spacing) + 1)]
            if len(ticks) > 1:
                break
        return ticks

    def _draw_axes(self) -> None:
        """Grid lines, the values at the left, the times below."""
        box, size, unit, still = self.box, 10.5 * self._unit, self._unit, self._still
        above = math.inf
        for tick in self._value_ticks():
            row = float(self.y(tick))
            if abs(above - row) < size:  # no room for the number
                continue
            above = row
            shapes.stroke(still, np.array([(box.left, row), (box.right, row)]), self._theme.line)
            words = f"{tick:g}".replace("-", "−")
            write(still, words, (box.left - 5 * unit, row + 0.36 * size), size, self._theme.muted, anchor="right")
        for time, words in self._time_ticks():
            column = float(self.x(time))
            shapes.stroke(still, np.array([(column, box.bottom), (column, box.bottom + 3 * unit)]), self._theme.line)
            write(still, words, (column, box.bottom + 14 * unit), size, self._theme.muted, anchor="centre")

    def _time_ticks(self) -> list[tuple[float, str]]:
        """Positions on the time axis and their labels."""
        few = max(2.0, self.box.width / (56 * self._unit))
        spacing = next((s for s in TIME_TICKS if self._duration / s <= few), nice_above(self._duration / few))
        return [(time, clock(time)) for time in np.arange(0, self._duration * 1.0001, spacing)]

    def _points(self, time: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Points of a curve in the magnified plot, (P, 2) pixels."""
        points = np.stack([self.x(time) - self.box.left, self.y(values) - self.box.top], 1)
        return (points + 0.5) * self._zoom - 0.5


class RecordedPlot(Plot):
    """A plot of whole series, drawn beforehand and shown from left to right as time passes.

    First `dots` and `curve`, then `show_until` in order of time.
    """

    _shown = 0  # columns

    def dots(self, time: np.ndarray, values: np.ndarray, colour: Colour) -> None:
        for point in self._points(time, values):
            shapes.disc(self._fine, point, 0.9 * self._unit * self._zoom, colour)

    def curve(self, time: np.ndarray, values: np.ndarray, colour: Colour, dash: float = 0.0) -> None:
        """A line, or dashes of a length in pixels, between which other curves are seen."""
        points = self._points(time, values)
        for piece in shapes.dashed(points, dash * self._zoom) if dash else [points]:
            shapes.stroke(self._fine, piece, colour, self._line_width)

    @cached_property
    def _whole(self) -> np.ndarray:
        return cv2.resize(self._fine, (self.box.width, self.box.height), interpolation=cv2.INTER_AREA)

    def show_until(self, time: float) -> None:
        """Show the curves up to a time on the still picture."""
        upto = min(round(float(self.x(time))) - self.box.left + 1, self.box.width)
        self.box.of(self._still)[:, self._shown : upto] = self._whole[:, self._shown : upto]
        self._shown = max(upto, self._shown)

    def draw_cursor(self, picture: np.ndarray, time: float) -> None:
        """Draw a vertical line at a time."""
        column = round(float(self.x(time)))
        picture[self.box.top : self.box.bottom, column : column + max(1, round(self._unit))] = self._theme.muted


TERMS = 5  # of the reward that are shown at most, the largest


class RewardBars:
    """The largest terms of the reward side by side, means of the last 30 s, each with a bar from the middle."""

    TITLE = "reward a step,", "last 30 s"

    def __init__(self, still: np.ndarray, play: Playback, box: Rectangle, layout: Layout) -> None:
        self._play, self._layout, self._row, unit, muted = play, layout, box.top, layout.unit, layout.theme.muted
        size = np.abs(play.reward).max(axis=0)
        largest = [term for term in np.argsort(-size)[:TERMS].tolist() if size[term] > 0] or [0]
        start = box.left + max(text_width(words, 11 * unit) for words in self.TITLE) + 26 * unit
        # As many of them, from the largest one on, as are legible side by side.
        forms = [f"{play.trace.reward_names[term]} +00.00" for term in largest]
        widths = [text_width(form, SMALLEST_LETTERS) + 10 * unit for form in forms]
        fitting_ones = (n for n in range(1, len(widths) + 1) if n * max(widths[:n]) <= box.right - start)
        terms = sorted(largest[: max(fitting_ones, default=1)])
        self._values = play.reward[:, terms]
        self._scale = max(float(np.quantile(np.abs(self._values), 0.98)), 1e-9)
        across = (box.right - start) / len(terms)
        self._left, self._room = [start + place * across for place in range(len(terms))], across - 10 * unit
        names, row = [play.trace.reward_names[term] for term in terms], box.top + 30 * unit
        self._size = min(fitting(f"{name} +00.00", 11 * unit, self._room) for name in names)
        for line, words in enumerate(self.TITLE):
            write(still, words, (box.left + 10 * unit, box.top + (18 + 15 * line) * unit), 11 * unit, muted)
        for left, name in zip(self._left, names, strict=True):
            write(still, name, (left, box.top + 18 * unit), self._size, muted)
            ends = np.array([(left, row), (left + self._room, row)])
            shapes.stroke(still, ends, layout.theme.line, layout.px(2))

    def draw(self, picture: np.ndarray, t: float) -> None:
        layout, unit, room = self._layout, self._layout.unit, self._room
        for left, value in zip(self._left, self._values[step_of(self._play.told(t))].tolist(), strict=True):
            number, row = f"{value:+.2f}".replace("-", "−"), self._row + 30 * unit
            position = left + room, self._row + 18 * unit
            write(picture, number, position, self._size, layout.theme.text, anchor="right")
            middle, length = left + room / 2, room / 2 * min(max(value / self._scale, -1.0), 1.0)
            ink = style.GAUGE[0] if value > 0 else style.GAUGE[2]
            shapes.stroke(picture, np.array([(middle, row), (middle + length, row)]), ink, layout.px(4))


FIXES = 60  # shown at a time


class FixInsets:
    """Circular insets in up to three rows, all at one scale."""

    def __init__(self, still: np.ndarray, play: Playback, card: Rectangle, layout: Layout, view: MapView) -> None:
        """`view`: of the map, whose scale is compared with theirs."""
        self._play, self._layout, trace = play, layout, play.trace
        box = within_margins(card, layout.unit, top=30, sides=8, bottom=2)
        truth = trace.auv_position[:, 0]
        self._fix_error = (trace.fix[:, 0] - trace.heard_position[:, 0]).astype(float)
        self._error = Series((trace.estimate[:, 0] - truth).astype(float))
        count = truth.shape[1]
        label = 30 * layout.unit
        diameters = [min(box.height / rows - label, 0.94 * box.width / -(-count // rows)) for rows in (1, 2, 3)]
        self._radius = max(*diameters, 8.0) / 2
        rows = 1 + int(np.argmax(diameters))
        columns = -(-count // rows)
        self._across = across = box.width / columns
        down = box.height / rows
        above = min(max(down - 2 * self._radius - label, 0.0) / 2, 0.5 * down) + self._radius
        self._centres = [
            np.array([box.left + (k % columns + 0.5) * across, box.top + (k // columns) * down + above])
            for k in range(count)
        ]
        shades = [0.2 + 0.6 * (age + 1) / FIXES for age in range(FIXES)]
        inks = [style.auv_colour(auv) for auv in range(count)]
        self._tints = np.array([[style.mix(style.SEA[0], ink, shade) for shade in shades] for ink in inks])
        longest = np.linalg.norm(error_axes(trace.estimate_covariance[:, 0]), axis=-1).max(-1)
        reach = max(
            float(np.quantile(np.nan_to_num(np.linalg.norm(self._fix_error, axis=-1)), 0.96)),
            float(np.quantile(longest, 0.95)),
        )
        self._scale = self._radius / max(1.1 * reach, 1e-6)
        ring = nice(0.75 * self._radius / self._scale)
        scale = self._scale / view.per_metre
        magnified = f"{scale:.0f} × magnified, " if scale >= 1.5 else ""
        note = f"{magnified}inner ring {ring:g} m"
        write_heading(still, layout, card, "Fixes around the true position", note)
        unit, zoom = layout.unit, layout.zoom
        for centre, ink in zip(self._centres, inks, strict=True):
            with shapes.smooth(still, centre, self._radius + 2 * unit, zoom) as (fine, middle):
                shapes.disc(fine, middle, self._radius * zoom, style.SEA[0])
                shapes.ring(fine, middle, ring * self._scale * zoom, style.DARK.line, round(1.2 * unit * zoom))
                shapes.ring(fine, middle, self._radius * zoom, ink, round(1.8 * unit * zoom))
            shapes.plus(still, centre, 5 * unit, style.WHITE, layout.px(1))

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw the latest fixes, older ones fainter; the estimate as a diamond, beyond the inset as an arrow
        at its rim, with its predicted ellipse.
        """
        layout, unit, step = self._layout, self._layout.unit, step_of(t)
        first, errors, axes_of = max(0, step - FIXES + 1), self._error.at(t), error_axes(self._play.covariance.at(t))
        for auv, centre in enumerate(self._centres):
            offsets = self._fix_error[first : step + 1, auv] * (self._scale, -self._scale)
            shown = self._inside(offsets)
            tints = self._tints[auv, FIXES - len(offsets) :][shown]
            shapes.dots(picture, centre + offsets[shown], 1.5 * unit, tints)
            axes = axes_of[auv] * (self._scale, -self._scale)
            outline = shapes.ellipse_points(np.zeros(2), axes)
            distance = np.hypot(outline[:, :1], outline[:, 1:])
            outline *= np.minimum(1.0, self._radius / np.maximum(distance, 1e-9))  # parts outside are drawn on the rim
            shapes.stroke(picture, centre + outline, style.WHITE, layout.px(1.2), closed=True)
            shapes.plus(picture, centre, 5 * unit, style.WHITE, layout.px(1))
            estimate = errors[auv] * (self._scale, -self._scale)
            if self._inside(estimate):
                shapes.fix(picture, centre + estimate, 4.5 * unit, style.WHITE, 1.5 * unit, layout.zoom)
            else:
                heading = math.atan2(-estimate[1], estimate[0])
                rim = centre + (self._radius - 5 * unit) * np.array([math.cos(heading), -math.sin(heading)])
                shapes.arrow(picture, rim, heading, 14 * unit, style.WHITE, layout.zoom)
            self._caption(picture, step_of(self._play.told(t)), auv)

    def _inside(self, offsets: np.ndarray) -> np.ndarray:
        """Whether points (..., 2), pixels from the centre, lie in an inset; false for NaN, a fix without detection."""
        return np.hypot(offsets[..., 0], offsets[..., 1]) < self._radius - 2 * self._layout.unit

    def _caption(self, picture: np.ndarray, step: int, auv: int) -> None:
        unit, centre = self._layout.unit, self._centres[auv]
        error = self._play.position_error[step, auv]
        digits = sum(error < limit for limit in (9.995, 99.95))  # three in all, so that captions are of one size
        text, room = f"{auv + 1}: {error:.{digits}f} m", 0.93 * self._across
        texts = [f"AUV {text} off"] * (self._radius >= 42 * unit) + [text, f"{auv + 1}"]
        fits = [text for text in texts if text_width(text, SMALLEST_LETTERS, bold=True) <= room]
        text = (fits or texts[-1:])[0]
        size = fitting(text, 12.5 * unit, room, bold=True)
        below = centre[1] + self._radius + 16 * unit
        write(picture, text, (centre[0], below), size, self._layout.theme.auv(auv), bold=True, anchor="centre")


FAINTEST = 0.05  # of the way of a sound
SEA_PART, OF_DIVES = 0.5, 0.2  # of the height, for the sea between crests and troughs; where AUVs dive
POINTS = 96  # of the line of the surface
HULL = np.array([(-1.0, 0.45), (1.0, 0.45), (0.62, -0.3), (-0.62, -0.3)])  # half lengths, z up


class DepthSection:
    """Draws world 0 of a trace; widths, heights of the sea and depths have scales of their own."""

    def __init__(self, still: np.ndarray, play: Playback, box: Rectangle, layout: Layout) -> None:
        self._play, self._trace, self._layout, self._card = play, play.trace, layout, box
        unit, trace, scenario = layout.unit, play.trace, play.trace.scenario
        self._box = room = within_margins(box, unit, top=28, sides=12, bottom=8)
        elevation = trace.boat_surface[:, 0, :, 0]
        lowest, highest = extremes(trace.surface)
        above = max(1.0, float(np.abs(elevation).max()), -lowest, highest)
        bed = play.site.bed[0, :, :, 0]
        below = max(float(bed.max()), scenario.auv.depth)
        # Heights of the sea have the upper part of the section, depths below its troughs the rest.
        middle = room.top + (OF_DIVES if trace.auv_depth.size else SEA_PART) * room.height
        self._rows = np.array([room.top, middle, room.bottom - 1.0])
        self._heights = np.array([above, -above, -max(below, 1.01 * above)])
        self._across = room.width / scenario.area.width
        self._water = style.mix(layout.theme.card, style.SEA[2], 0.55)
        self._upright = (2 * above * self._across) / (middle - room.top)
        self._x = np.linspace(0.0, scenario.area.width, POINTS)
        self._slope = self._foot = np.array([(room.right, room.bottom - 1.0), (room.left, room.bottom - 1.0)])
        if np.ptp(bed):
            along = np.linspace(0.0, scenario.area.width, bed.shape[1])
            highest, lowest = (np.interp(self._x[::-1], along, ends) for ends in (bed.min(axis=0), bed.max(axis=0)))
            self._slope, self._foot = (
                np.stack([self._column(self._x[::-1]), self._row(-ends)], 1) for ends in (highest, lowest)
            )
        nodes, deep = play.node_way, below - float(bed.max())  # nodes of the demonstration lie below its bed
        at = np.full(nodes.shape[:-1], -play.target_depth) if play.moving else -play.site.depth_at(nodes) - deep
        self._moving = play.moving
        self._nodes = play.of_nodes(np.stack([self._column(nodes[..., 0]), self._row(at) - 1.0], -1))
        self._floating = play.floating
        boats = "boat" if trace.boat_position.shape[2] == 1 else "boats"
        titles = f"Section from the south: {boats}, AUVs, nodes", "Section from the south", "Section"
        room_left = box.width - 32 * unit - text_width("heave −0.00 m · tilt 00.0°", 12 * unit, bold=True)
        fits = [title for title in titles if text_width(title, 12 * unit, bold=True) <= room_left]
        write_heading(still, layout, box, (fits or [""])[0])

    def draw(self, picture: np.ndarray, t: float) -> None:
        layout, unit, theme = self._layout, self._layout.unit, self._layout.theme
        surface = np.stack([self._column(self._x), self._row(self._elevation(t))], 1)
        shapes.fill(picture, np.concatenate([surface, self._foot]), self._water)
        if self._slope is not self._foot:
            between = np.concatenate([self._slope, self._foot[::-1]])
            shapes.fill(picture, between, style.mix(self._water, theme.muted, 0.4))
        shapes.stroke(picture, self._foot, theme.muted, layout.px(1.5))
        nodes, ink = self._nodes.at(t), style.TARGET if self._moving else theme.muted
        shapes.dots(picture, nodes, 2.0 * unit, np.broadcast_to(np.array(ink), (len(nodes), 3)))
        lines = self._boat_outlines(t)
        places = np.stack([self._column(self._play.auvs.at(t)[:, 0]), self._row(-self._play.depths.at(t))], 1)
        for auv, place in enumerate(places):
            if self._trace.auv_depth.size:
                steps = self._play.track(t, 60)
                across, down = self._play.auvs.until(t, steps)[:, auv, 0], self._play.depths.until(t, steps)[:, auv]
                way = np.stack([self._column(across), self._row(-down)], 1)
                shapes.stroke(picture, way, style.mix(self._water, theme.auv(auv), 0.6), layout.px(1.5))
            boat, fresh = self._play.heard(t, auv)
            if fresh > FAINTEST:
                ends = np.stack([lines[boat].mean(axis=0), place])
                shapes.stroke(picture, ends, style.mix(self._water, theme.auv(auv), 0.7 * fresh), layout.px(1.2))
        for outline in lines:
            shapes.fill(picture, outline, theme.text)
            shapes.stroke(picture, outline, style.BOAT_DECK, layout.px(1), closed=True)
        for auv, place in enumerate(places):
            shapes.disc(picture, place, 4.2 * unit, style.OUTLINE)
            shapes.disc(picture, place, 3.2 * unit, theme.auv(auv))
        self._write_motion(picture, t)

    def _elevation(self, t: float) -> np.ndarray:
        """The sea from west to east through the first boat, (POINTS,) m; level there if it was not recorded."""
        if not self._trace.surface.size:
            return np.full(POINTS, self._floating.at(t)[0, 0])
        field, area = self._play.sea.at(t), self._trace.scenario.area
        row = int(np.clip(self._play.boats.at(t)[0, 1] / area.length * len(field), 0, len(field) - 1))
        return np.interp(self._x, np.linspace(0.0, area.width, field.shape[1]), field[row])

    def _boat_outlines(self, t: float) -> list[np.ndarray]:
        """Hulls on their sea, tilted as the surface is from west to east, pixels."""
        size = 9.0 * self._layout.unit
        outlines = []
        for (x, _), (elevation, slope, _) in zip(self._play.boats.at(t), self._floating.at(t), strict=True):
            angle = math.atan(slope / self._upright)  # as steep as the drawn sea
            turn = np.array([(math.cos(angle), -math.sin(angle)), (-math.sin(angle), -math.cos(angle))])
            outlines.append(np.array([self._column(x), self._row(elevation)]) + size * HULL @ turn.T)
        return outlines

    def _write_motion(self, picture: np.ndarray, t: float) -> None:
        """Heave and tilt of the first boat at the right of the heading."""
        unit = self._layout.unit
        elevation, *slope = self._floating.at(self._play.told(t))[0].tolist()
        tilt = math.degrees(math.atan(math.hypot(*slope)))
        words = f"heave {elevation:+.2f} m · tilt {tilt:.1f}°".replace("-", "−")
        corner = self._card.right - 10 * unit, self._card.top + 18 * unit
        write(picture, words, corner, 12 * unit, self._layout.theme.water, bold=True, anchor="right")

    def _column(self, x: np.ndarray | float) -> np.ndarray:
        return self._box.left + np.asarray(x) * self._across

    def _row(self, z: np.ndarray | float) -> np.ndarray:
        return np.interp(-np.asarray(z), -self._heights, self._rows)
