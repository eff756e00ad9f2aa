"""The map of a mission: sea surface, current, vehicles, nodes and fixes, seen from above."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from usvauv.env.record.collection import age
from usvauv.env.record.trace import Trace
from usvauv.env.render import shapes, style, symbols
from usvauv.env.render.exchanges import Exchanges
from usvauv.env.render.frame_layout import Layout, MapView
from usvauv.env.render.itinerary import Itinerary
from usvauv.env.render.popups import Popups
from usvauv.env.render.reply_field import ReplyField
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.env.render.sea_layers import CurrentStreaks, SeaSurface
from usvauv.env.render.shapes import Overlay

TRAIL = 120.0  # s
TRAIL_PIECES = 6  # of one opacity each
OLD = 300.0  # s, age from which on a node's ring is brightest
REFRESH = 3  # steps from which on streaks, which change slowly, are made anew
SIGMAS = 2.0  # semi-axes of error ellipses; in two dimensions they enclose 86 % of the errors


def error_axes(covariance: np.ndarray) -> np.ndarray:
    """Semi-axes (..., 2, 2) of error ellipses, one a row, m, of covariances (..., 3) xx, xy, yy in m²."""
    variances, directions = np.linalg.eigh(np.asarray(covariance, float)[..., [[0, 1], [1, 2]]])
    return SIGMAS * np.sqrt(np.maximum(variances, 0.0))[..., None] * np.swapaxes(directions, -1, -2)


class MissionMap:
    """Draws world 0 of a trace.

    Attributes:
        view: metres to pixels. surface, streaks: layers, whose scales `map_axes` draws.
    """

    def __init__(self, trace: Trace, running: RunningMetrics, layout: Layout) -> None:
        scenario = trace.scenario
        self._trace, self._running, self._layout = trace, running, layout
        self.view = MapView(scenario.area, layout.map)
        self.surface = SeaSurface(trace.surface, self.view)
        self.streaks = CurrentStreaks(
            trace.vortex[0, 0], trace.stream_at(0.0), scenario.area.width, scenario.area.length, self.view, layout.unit
        )
        self._step = scenario.mission.step
        # Streaks drift at the true speed, up to a quarter of their length a step.
        self._streak_step = min(self._step, 0.25 * self.streaks.tail)
        self._overlay = Overlay(*layout.map)
        self._boats = self.view.pixel(trace.boat_position[:, 0])
        self._auvs = self.view.pixel(trace.auv_position[:, 0])
        self._labels = self._auvs + np.array([14, -12]) * layout.unit
        self._nodes = self.view.pixel(trace.node_position[0])
        self._exchanges, self._itinerary = Exchanges(trace), Itinerary(trace)
        self._popups = Popups(trace, self._itinerary, layout.unit)
        self._fill = trace.backlog[:, 0] / scenario.nodes.buffer
        # Stations have no data that could be old.
        self._age = age(trace)[:, 0] / OLD * (scenario.task == "data-collection")
        spacing = np.sqrt(layout.map.width * layout.map.height / len(self._nodes))
        self._node_radius = float(np.clip(spacing / 7, 3.0 * layout.unit, 9.5 * layout.unit))
        self._estimated = self.view.pixel(trace.estimate[:, 0])
        self._error_axes = self.view.vector(error_axes(trace.estimate_covariance[:, 0]))
        self._foreseen = self.view.pixel(trace.foreseen_position[:, 0])
        self._field = ReplyField(trace)
        self._made = -REFRESH
        self._gauges = symbols.NodeGauges(self._node_radius)
        self._hover_radius = max(scenario.auv.hover_radius * self.view.per_metre, self._node_radius + 5 * layout.unit)

    def draw(self, picture: np.ndarray, t: int) -> None:
        """Draw step t over the map's rectangle."""
        self.surface.paint(picture, t)
        self._overlay.clear()
        if not self._made <= t < self._made + REFRESH:
            self._made = t
            self.streaks.update(self._trace.vortex[t, 0], self._trace.stream_at(float(self._trace.time[t])))
        self.streaks.draw(self._overlay, t * self._streak_step, self._layout.px(1.2))
        self._draw_field(t)
        self._draw_ellipses(t)
        self._draw_pings(t)
        self._draw_trails(t)
        self._draw_links(t)
        self._overlay.blend(picture)
        self._draw_nodes(picture, t)
        for boat in range(self._boats.shape[1]):
            self._draw_boat(picture, t, boat)
        for auv in range(self._auvs.shape[1]):
            self._draw_auv(picture, t, auv)
        self._popups.draw(picture, self._layout.map, t, self._nodes, self._hover_radius, self._labels[t])

    def _draw_trails(self, t: int) -> None:
        width = self._layout.px(2)
        for boat in range(self._boats.shape[1]):
            self._fade(self._boats[:, boat], t, style.BOAT, 0.45, width)
        for auv in range(self._auvs.shape[1]):
            self._fade(self._auvs[:, auv], t, style.auv_colour(auv), 0.85, width)

    def _fade(self, track: np.ndarray, t: int, colour: style.Colour, opacity: float, width: int) -> None:
        first = max(0, t - round(TRAIL / self._step))
        # At most 120 points: with a short mission step the trail would have thousands.
        points = track[np.unique(np.linspace(first, t, min(t - first, 120) + 1).astype(int))]
        length = max(2, len(points) // TRAIL_PIECES + 1)
        pieces = [points[begin : begin + length + 1] for begin in range(0, len(points) - 1, length)]
        for place, piece in enumerate(pieces):
            share = (place + 1) / len(pieces)
            # A trail shorter than TRAIL fades less.
            full = min(1.0, (t - first) * self._step / TRAIL)
            self._overlay.strokes([piece], colour, opacity * (1 - full * (1 - share**1.3)), width)

    def _draw_field(self, t: int) -> None:
        """Lines of what replies heard at a place are worth, brighter where it is more; none where all is heard."""
        for level, lines in self._field.lines(t):
            self._overlay.strokes(
                [self.view.pixel(line) for line in lines], style.FIELD, 0.15 + 0.6 * level, self._layout.px(1.2)
            )

    def _draw_ellipses(self, t: int) -> None:
        for auv, position in enumerate(self._estimated[t]):
            axes = self._error_axes[t, auv]
            if np.abs(axes).max() > 2 * self._layout.unit:
                outline = shapes.ellipse_points(position, axes)
                line = np.concatenate([outline, outline[:1]])
                self._overlay.strokes([line], style.auv_colour(auv), 0.8, self._layout.px(1))

    def _draw_pings(self, t: int) -> None:
        """A ring from each boat that has asked, and lines from the boats to the AUVs they have heard."""
        for boat, share in zip(self._boats[t], self._exchanges.ping(t), strict=True):
            if share is not None:
                reach = np.hypot(*(self._auvs[t] - boat).T).max()
                self._overlay.ring(boat, share * reach, style.BOAT, 0.45 * (1 - 0.7 * share), self._layout.px(1.3))
        for auv, position in enumerate(self._auvs[t]):
            boat, fresh = self._exchanges.heard(t, auv)
            lit = 0.5 * fresh
            if lit > 0.03:  # what is drawn later replaces what is there
                boat = self._boats[t, boat]
                self._overlay.strokes([np.stack([boat, position])], style.auv_colour(auv), lit, self._layout.px(1.2))

    def _draw_links(self, t: int) -> None:
        """Dashed lines to the targets, rings around services."""
        unit, phase = self._layout.unit, (t % 24) / 24
        for auv, position in enumerate(self._auvs[t]):
            colour = style.auv_colour(auv)
            node = self._nodes[self._itinerary.node(t, auv)]
            stops = self._nodes[[self._itinerary.node(t, auv), *self._itinerary.after(t, auv)]]
            for place, leg in enumerate(pairwise(stops)):
                self._overlay.strokes([np.stack(leg)], colour, 0.55 - 0.12 * place, self._layout.px(1.3))
            if self._trace.hovering[t, 0, auv]:
                self._overlay.disc(node, self._hover_radius, colour, 0.16)
                self._overlay.ring(node, self._hover_radius * (0.35 + 0.65 * phase), colour, 0.8 * (1 - phase))
            else:
                pieces = shapes.dashes(position, node, 5 * unit)
                if pieces:
                    self._overlay.strokes(pieces, colour, 0.7, self._layout.px(1.3))

    def _draw_nodes(self, picture: np.ndarray, t: int) -> None:
        if self._trace.scenario.task == "station-keeping":
            for auv, centre in enumerate(self._nodes):
                symbols.station(picture, centre, self._node_radius, style.auv_colour(auv), self._layout.zoom)
            return
        pulse = 0.5 + 0.5 * math.sin(0.35 * t)
        for centre, share, old in zip(self._nodes, self._fill[t], self._age[t], strict=True):
            self._gauges.draw(picture, centre, share, old, pulse)

    def _draw_boat(self, picture: np.ndarray, t: int, boat: int) -> None:
        layout, goal = self._layout, self.view.pixel(self._trace.boat_goal[t, 0, boat])
        position = self._boats[t, boat]
        if np.hypot(*(goal - position)) > 20 * layout.unit:  # nearer goals are below the boat
            for piece in shapes.dashes(position, goal, 3 * layout.unit):
                shapes.stroke(picture, piece, style.BOAT, layout.px(1))
            symbols.cross(picture, goal, 5 * layout.unit, style.BOAT, layout.px(2))
        symbols.boat(picture, position, self._running.boat_heading[t, boat], 34 * layout.unit, layout.zoom)

    def _draw_auv(self, picture: np.ndarray, t: int, auv: int) -> None:
        layout, position, colour = self._layout, self._auvs[t, auv], style.auv_colour(auv)
        if self._trace.hovering[t, 0, auv]:
            node = self._nodes[self._itinerary.node(t, auv)]
            share = self._running.service_share[t, auv]
            symbols.progress_ring(picture, node, self._hover_radius, share, colour, 3.4 * layout.unit, layout.zoom)
        fix, foreseen = self._estimated[t, auv], self._foreseen[t, auv]
        if np.hypot(*(foreseen - fix)) > 5 * layout.unit:
            for piece in shapes.dashes(foreseen, position, 3 * layout.unit):
                shapes.stroke(picture, piece, style.mix(colour, style.OUTLINE, 0.5), layout.px(1))
            symbols.foreseen(picture, foreseen, 6 * layout.unit, colour, 1.6 * layout.unit, layout.zoom)
        symbols.auv(picture, position, self._running.heading[t, auv], 29 * layout.unit, colour, layout.zoom)
        if np.hypot(*(fix - position)) > 5 * layout.unit:  # smaller errors are visible in the inset only
            symbols.fix(picture, fix, 4 * layout.unit, style.WHITE, 1.5 * layout.unit, layout.zoom)
        symbols.badge(picture, str(auv + 1), self._labels[t, auv], 11 * layout.unit, colour)
