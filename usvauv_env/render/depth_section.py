"""A section of the water seen from the south: the sea above the boat, who is heard, AUVs and nodes at their depths."""

from __future__ import annotations

import math

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import shapes, style
from usvauv.env.render.exchanges import Exchanges
from usvauv.env.render.frame_layout import Layout, Rectangle
from usvauv.env.render.panel_elements import within_margins, write_heading
from usvauv.env.render.text import write
from usvauv.env.storage.memory import extremes

FAINTEST = 0.05  # of the way of a sound
SEA_PART = 0.5  # of the height, for the sea between its highest crest and its deepest trough
POINTS = 96  # of the line of the surface
HULL = np.array([(-1.0, 0.45), (1.0, 0.45), (0.62, -0.3), (-0.62, -0.3)])  # half lengths, z up


class DepthSection:
    """Draws world 0 of a trace; widths, heights of the sea and depths have scales of their own."""

    def __init__(self, still: np.ndarray, trace: Trace, box: Rectangle, layout: Layout) -> None:
        self._trace, self._layout, self._card = trace, layout, box
        unit, scenario = layout.unit, trace.scenario
        self._box = room = within_margins(box, unit, top=28, sides=12, bottom=8)
        elevation = trace.boat_surface[:, 0, :, 0]
        lowest, highest = extremes(trace.surface)
        above = max(1.0, float(np.abs(elevation).max()), -lowest, highest)
        self._depth = scenario.auv.depth
        below = max(scenario.area.depth, self._depth)
        # Heights of the sea have the upper part of the section, depths below its troughs the rest.
        middle = room.top + SEA_PART * room.height
        self._rows = np.array([room.top, middle, room.bottom - 1.0])
        self._heights = np.array([above, -above, -max(below, 1.01 * above)])
        self._across = room.width / scenario.area.width
        self._water = style.mix(layout.theme.card, style.SEA[2], 0.55)
        self._bed = room.bottom - 1.0
        self._upright = (2 * above * self._across) / (middle - room.top)
        nodes = self._column(trace.node_position[0, :, 0])
        self._nodes = np.stack([nodes, np.full(len(nodes), self._bed - 1.0)], 1)
        self._auvs, self._boats = trace.auv_position[:, 0], trace.boat_position[:, 0]
        self._exchanges = Exchanges(trace)
        boats = "boat" if self._boats.shape[1] == 1 else "boats"
        write_heading(still, layout, box, f"Section from the south: {boats}, AUVs, nodes")
        self._x = np.linspace(0.0, scenario.area.width, POINTS)

    def draw(self, picture: np.ndarray, t: int) -> None:
        """Draw step t."""
        layout, unit, theme = self._layout, self._layout.unit, self._layout.theme
        surface = np.stack([self._column(self._x), self._row(self._elevation(t))], 1)
        foot = np.array([(self._box.right, self._bed), (self._box.left, self._bed)])
        shapes.fill(picture, np.concatenate([surface, foot]), self._water)
        shapes.stroke(picture, foot, theme.muted, layout.px(1.5))
        shapes.dots(picture, self._nodes, 2.0 * unit, np.broadcast_to(np.array(theme.muted), (len(self._nodes), 3)))
        lines = self._boat_outlines(t)
        places = np.stack([self._column(self._auvs[t, :, 0]), np.full(self._auvs.shape[1], self._row(-self._depth))], 1)
        for auv, place in enumerate(places):
            boat, fresh = self._exchanges.heard(t, auv)
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

    def _elevation(self, t: int) -> np.ndarray:
        """The sea from west to east through the first boat, (POINTS,) m; level there if it was not recorded."""
        if not self._trace.surface.size:
            return np.full(POINTS, self._trace.boat_surface[t, 0, 0, 0])
        field = self._trace.surface[t]
        row = int(np.clip(self._boats[t, 0, 1] / self._trace.scenario.area.length * len(field), 0, len(field) - 1))
        along = np.linspace(0.0, self._trace.scenario.area.width, field.shape[1])
        return np.interp(self._x, along, field[row])

    def _boat_outlines(self, t: int) -> list[np.ndarray]:
        """Hulls on their sea, tilted as the surface is from west to east, pixels."""
        size = 9.0 * self._layout.unit
        outlines = []
        for (x, _), (elevation, slope, _) in zip(self._boats[t], self._trace.boat_surface[t, 0], strict=True):
            angle = math.atan(slope / self._upright)  # as steep as the drawn sea
            turn = np.array([(math.cos(angle), -math.sin(angle)), (-math.sin(angle), -math.cos(angle))])
            outlines.append(np.array([self._column(x), self._row(elevation)]) + size * HULL @ turn.T)
        return outlines

    def _write_motion(self, picture: np.ndarray, t: int) -> None:
        """Heave and tilt of the first boat at the right of the heading."""
        unit = self._layout.unit
        elevation, *slope = self._trace.boat_surface[t, 0, 0].tolist()
        tilt = math.degrees(math.atan(math.hypot(*slope)))
        words = f"heave {elevation:+.2f} m · tilt {tilt:.1f}°".replace("-", "−")
        corner = self._card.right - 10 * unit, self._card.top + 18 * unit
        write(picture, words, corner, 12 * unit, self._layout.theme.water, bold=True, anchor="right")

    def _column(self, x: np.ndarray | float) -> np.ndarray:
        return self._box.left + np.asarray(x) * self._across

    def _row(self, z: np.ndarray | float) -> np.ndarray:
        return np.interp(-np.asarray(z), -self._heights, self._rows)
