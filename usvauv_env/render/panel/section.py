"""Section of the water, seen from the south: sea, bed, boats, AUVs and nodes."""

from __future__ import annotations

import math

import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.layout import (
    Layout,
    Rectangle,
    within_margins,
    write_heading,
)
from usvauv.env.render.mission import Playback
from usvauv.env.render.style import text_width, write
from usvauv.env.storage.memory import extremes

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
