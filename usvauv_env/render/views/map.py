"""The map of a mission, seen from above, with the axes and scales around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_metrics import letter
from usvauv.env.render import shapes, style
from usvauv.env.render.layout import Layout, nice, nice_above
from usvauv.env.render.mission import RHYTHM, TRAIL, Playback, Series, Vehicle, error_axes, step_of
from usvauv.env.render.shapes import Overlay
from usvauv.env.render.style import text_width, write
from usvauv.env.render.views.sea_surface import CurrentStreaks, MapView, SeaSurface, colour_scale
from usvauv.kernels.flow.vortex import Eddies
from usvauv.kernels.types import Level

TRAIL_PIECES = 6  # of one opacity each
AROUND = 1.25  # sides of a map of where targets get over how far that is
FOLLOWED = 3.0  # magnification of a map that goes along with a vehicle
LEAST_DATA = 0.005  # Mbit, that begin words at an AUV
CERTAIN = 40.0  # pixels of the design, radius from which on ellipses are fainter, the larger they are
ARC = 55.0  # pixels of the design, half the length of a range's arc
WORDLESS = 240.0  # shorter side in pixels of the design of a map with smaller vehicles and no words over nodes


class MissionMap:
    """Draws world 0 of a trace.

    Attributes:
        view: metres to pixels. surface, streaks: layers, whose scales `draw_map_axes` draws.
    """

    def __init__(
        self,
        play: Playback,
        layout: Layout,
        limit: float | None = None,
        follow: Vehicle | None = None,
        near: Sequence[Playback] = (),
    ) -> None:
        """`limit`: end of the sea's colour scale, m; None for one that fits the trace. `near`: where targets move, show
        the part of the area where they and the vehicles of these missions get, not the whole.
        """
        self._play, self._trace, self._layout = play, play.trace, layout
        trace, scenario = play.trace, play.trace.scenario
        self._looked_at, zoom = (follow.way(trace), FOLLOWED) if follow else (None, 1.0)
        if near and play.moving and not follow:
            self._looked_at, zoom = where_it_happens(near)
        self.view = MapView(scenario.area, layout.map, zoom)
        self.surface = SeaSurface(trace.surface, self.view, limit=limit)
        self.streaks = CurrentStreaks(
            trace.vortex[0, 0], trace.stream_at(0.0), scenario.area.width, scenario.area.length, self.view, layout.unit,
            Eddies(scenario.current.period, cruise=scenario.eddies_at_cruise), Level.cruise,
        )  # fmt: skip
        # Streaks drift at the true speed, up to a thirtieth of their length a frame, which the eye can follow.
        self._streak_step = min(scenario.mission.step * play.pace, self.streaks.tail / 30)
        self._overlay, self._corner = Overlay(*layout.map), np.array(layout.map[:2])
        self._label = np.array([14, -12]) * layout.unit
        self._popups = Popups(play, layout.unit)
        shorter = min(layout.map.width, layout.map.height) / layout.unit
        self._wordless = shorter < WORDLESS
        self._size = layout.unit * float(np.clip(shorter / WORDLESS, 0.6, 1.0))  # of vehicles
        spacing = self.view.zoom * np.sqrt(layout.map.width * layout.map.height / trace.node_position.shape[1])
        self._node_radius = float(np.clip(spacing / 7, 3.0 * layout.unit, 9.5 * layout.unit))
        self._gauges = shapes.NodeGauges(self._node_radius)
        self._hover_radius = max(scenario.service_radius * self.view.per_metre, self._node_radius + 5 * layout.unit)

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw a moment over the map's rectangle, and with a followed vehicle the axes around it."""
        if not self._looked_at:
            self._draw(picture, t)
            return
        around, box = picture.copy(), self._layout.map
        self.view.look(self._looked_at.at(t))
        self._draw(picture, t)
        box.of(around)[:] = box.of(picture)
        np.copyto(picture, around)
        draw_ticks(picture, self.view, self._layout)

    def _draw(self, picture: np.ndarray, t: float) -> None:
        step, view, play = step_of(t), self.view, self._play
        self.surface.paint(picture, play.sea.on(t, *view.grid()) if self._looked_at else play.sea.at(t))
        self._overlay.clear()
        self.streaks.update(self._trace.vortex[step, 0], self._trace.stream_at(float(self._trace.time[step])))
        self.streaks.draw(self._overlay, t / self._play.pace * self._streak_step, self._layout.px(1.2))
        auvs, boats, nodes, estimated = (
            view.pixel(series.at(t)) for series in (play.auvs, play.boats, play.nodes, play.estimated)
        )
        self._draw_field(step)
        self._draw_ellipses(t, estimated)
        self._draw_pings(t, auvs, boats)
        self._draw_trails(t)
        self._draw_links(t, auvs, nodes)
        self._draw_goals(t, boats)
        self._draw_ranges(t)
        self._overlay.blend(picture)
        # Symbols end at the border of the map: they are drawn on that part of the picture alone, in its own pixels.
        picture = self._layout.map.of(picture)
        auvs, boats, nodes, estimated = (places - self._corner for places in (auvs, boats, nodes, estimated))
        self._draw_nodes(picture, t, nodes)
        for boat, place in enumerate(boats):
            self._draw_boat(picture, t, boat, place)
        for auv, place in enumerate(auvs):
            self._draw_auv(picture, t, auv, place, estimated[auv], nodes)
        if not self._wordless:
            places = view.pixel(play.auvs.values[self._popups.begin(t)]) - self._corner
            self._popups.draw(picture, t, places, auvs + self._label)

    def _draw_trails(self, t: float) -> None:
        width, steps = self._layout.px(2), self._play.track(t, 120)
        boats, auvs = (self.view.pixel(series.until(t, steps)) for series in (self._play.boats, self._play.auvs))
        for boat in range(boats.shape[1]):
            self._fade(boats[:, boat], t - steps[0], style.BOAT, 0.45, width)
        for auv in range(auvs.shape[1]):
            self._fade(auvs[:, auv], t - steps[0], style.auv_colour(auv), 0.85, width)
        targets = self.view.pixel(self._play.nodes.until(t, steps)) if self._play.moving else auvs[:, :0]
        for target in range(targets.shape[1]):
            self._fade(targets[:, target], t - steps[0], style.TARGET, 0.7, width)

    def _fade(self, points: np.ndarray, steps: float, colour: style.Colour, opacity: float, width: int) -> None:
        length = max(2, len(points) // TRAIL_PIECES + 1)
        pieces = [points[begin : begin + length + 1] for begin in range(0, len(points) - 1, length)]
        full = min(1.0, steps * self._trace.scenario.mission.step / TRAIL)  # a shorter trail fades less
        for place, piece in enumerate(pieces):
            share = (place + 1) / len(pieces)
            self._overlay.strokes([piece], colour, opacity * (1 - full * (1 - share**1.3)), width)

    def _draw_field(self, step: int) -> None:
        """Contour lines of the value of replies received at a place, brighter if larger; none if all are received."""
        for level, lines in self._play.field.lines(step):
            self._overlay.strokes(
                [self.view.pixel(line) for line in lines], style.FIELD, 0.1 + 0.4 * level, self._layout.px(1.2)
            )

    def _draw_ellipses(self, t: float, estimated: np.ndarray) -> None:
        for auv, axes in enumerate(self.view.vector(error_axes(self._play.covariance.at(t)))):
            radius = np.abs(axes).max() / self._layout.unit
            if radius > 2:
                outline = shapes.ellipse_points(estimated[auv], axes)
                line = np.concatenate([outline, outline[:1]])
                opacity = float(np.clip(0.5 * CERTAIN / radius, 0.15, 0.5))
                self._overlay.strokes([line], style.auv_colour(auv), opacity, self._layout.px(1.3))

    def _draw_tracks(self, picture: np.ndarray, t: float, nodes: np.ndarray) -> None:
        """The targets that move, with their letters, and where the AUVs take them to be.

        Letters are at the lower left, as an AUV near its target has its number at the upper right.
        """
        unit, zoom = self._layout.unit, self._layout.zoom
        tracked = self.view.pixel(self._play.tracked.at(t)) - self._corner
        axes = error_axes(self._play.track_covariance.at(t))
        for place, each in zip(tracked, self.view.vector(axes), strict=True):
            outline = shapes.ellipse_points(place, each)
            shapes.stroke(picture, outline, style.TARGET, self._layout.px(1.3), closed=True)
            shapes.fix(picture, place, 3.5 * unit, style.TARGET, 1.4 * unit, zoom)
        for number, place in enumerate(nodes):
            shapes.target(picture, place, 6 * self._size, style.TARGET, zoom)
            if within(picture, place):
                shapes.badge(picture, letter(number), place - self._label, 11 * unit, style.TARGET)

    def _draw_ranges(self, t: float) -> None:
        """Arcs through targets around the AUVs that have measured their ranges: where they cross, a target is."""
        targets = self.view.pixel(self._play.nodes.at(t))
        for auv, target, place, across, fresh in self._play.ranges(t):
            centre, radius = self.view.pixel(place), across * self.view.per_metre
            half = min(ARC * self._layout.unit / max(radius, 1.0), math.pi)
            x, y = targets[target] - centre
            turns = math.atan2(y, x) + np.linspace(-half, half, 25)
            line = centre + radius * np.stack([np.cos(turns), np.sin(turns)], 1)
            self._overlay.strokes([line], style.auv_colour(auv), 0.8 * fresh, self._layout.px(1.3))

    def _draw_pings(self, t: float, auvs: np.ndarray, boats: np.ndarray) -> None:
        """A ring from each boat that has interrogated, and lines from the boats to the AUVs that have replied."""
        for boat, share in zip(boats, self._play.ping(t), strict=True):
            if share is not None:
                reach = np.hypot(*(auvs - boat).T).max()
                self._overlay.ring(boat, share * reach, style.BOAT, 0.13 * (1 - 0.7 * share), self._layout.px(1.3))
        for auv, position in enumerate(auvs):
            boat, fresh = self._play.heard(t, auv)
            if 0.5 * fresh > 0.03:  # later drawing replaces earlier drawing
                ends = np.stack([boats[boat], position])
                self._overlay.strokes([ends], style.auv_colour(auv), 0.5 * fresh, self._layout.px(1.2))

    def _draw_links(self, t: float, auvs: np.ndarray, nodes: np.ndarray) -> None:
        """Dashed lines to the targets, and lines on to the nodes after them."""
        unit, step = self._layout.unit, step_of(t)
        for auv, position in enumerate(auvs):
            colour = style.auv_colour(auv)
            stops = nodes[self._play.stops(step, auv)]
            node = stops[0]
            for place, leg in enumerate(pairwise(stops)):
                self._overlay.strokes([np.stack(leg)], colour, 0.55 - 0.12 * place, self._layout.px(1.3))
            if not self._play.hovering[step, auv]:
                self._overlay.strokes(shapes.dashes(node, position, 5 * unit), colour, 0.7, self._layout.px(1.3))

    def _draw_goals(self, t: float, boats: np.ndarray) -> None:
        """Crosses where the boats head, and the ways there; a goal below its boat has none."""
        unit = self._layout.unit
        goals = self.view.pixel(self._play.goals.at(t))
        for boat, goal in zip(boats, goals, strict=True):
            if np.hypot(*(goal - boat)) > 20 * unit:
                self._overlay.strokes([np.stack([goal, boat])], style.BOAT, 0.35, self._layout.px(1))
                self._overlay.strokes(list(shapes.diagonals(goal, 4.5 * unit)), style.BOAT, 0.75, self._layout.px(2))

    def _draw_nodes(self, picture: np.ndarray, t: float, nodes: np.ndarray) -> None:
        if self._play.moving:
            self._draw_tracks(picture, t, nodes)
            return
        if self._play.stations:
            for auv, centre in enumerate(nodes):
                shapes.station(picture, centre, self._node_radius, style.auv_colour(auv), self._layout.zoom)
            return
        pulse, step = 0.5 + 0.5 * math.sin(0.15 * t / self._play.pace), step_of(t)
        for centre, share, old in zip(nodes, self._play.fill[step], self._play.age[step], strict=True):
            self._gauges.draw(picture, centre, share, old, pulse)

    def _draw_boat(self, picture: np.ndarray, t: float, boat: int, position: np.ndarray) -> None:
        heading = float(self._play.boat_headings.at(t)[boat])
        shapes.boat(picture, position, heading, 29 * self._size, self._layout.zoom)

    def _draw_auv(
        self, picture: np.ndarray, t: float, auv: int, position: np.ndarray, fix: np.ndarray, nodes: np.ndarray
    ) -> None:
        layout, colour, step = self._layout, style.auv_colour(auv), step_of(t)
        if self._play.hovering[step, auv]:
            node = nodes[self._play.stops(step, auv)[0]]
            share = self._play.service_share[step, auv]
            shapes.progress_ring(picture, node, self._hover_radius, share, colour, 3.4 * layout.unit, layout.zoom)
        foreseen = self.view.pixel(self._play.foreseen.at(t)[auv]) - self._corner
        if np.hypot(*(foreseen - fix)) > 5 * layout.unit:
            way = shapes.dashes(foreseen, position, 3 * layout.unit)
            shapes.strokes(picture, way, style.mix(colour, style.EDGE, 0.5), layout.px(1))
            shapes.foreseen(picture, foreseen, 5 * layout.unit, colour, 1.4 * layout.unit, layout.zoom)
        shapes.auv(picture, position, float(self._play.attitude.at(t)[auv, 0]), 26 * self._size, colour, layout.zoom)
        if np.hypot(*(fix - position)) > 5 * layout.unit:  # smaller errors are visible in the inset only
            shapes.fix(picture, fix, 4 * layout.unit, colour, 1.5 * layout.unit, layout.zoom)
        if within(picture, position):
            shapes.badge(picture, str(auv + 1), position + self._label, 11 * layout.unit, colour, 0.75)


def where_it_happens(plays: Sequence[Playback]) -> tuple[Series, float]:
    """Middle (2,), m, of where vehicles and targets get in missions in equal areas, and the magnification of a map of
    it, at most `FOLLOWED`.
    """
    play = max(plays, key=lambda each: len(each.trace.time))
    series = [series for each in plays for series in (each.auvs, each.boats, each.nodes)]
    ways = np.concatenate([each.values.reshape(-1, 2) for each in series])
    low, high = ways.min(axis=0), ways.max(axis=0)
    area = play.trace.scenario.area
    zoom = min(area.width, area.length) / max(AROUND * float((high - low).max()), 1.0)
    return Series(np.broadcast_to(0.5 * (low + high), (len(play.trace.time), 2))), float(np.clip(zoom, 1.01, FOLLOWED))


class MapLayers(Protocol):
    """A map: metres to pixels, and the layers whose scales are drawn above it."""

    view: MapView
    surface: SeaSurface
    streaks: CurrentStreaks


def draw_map_axes(picture: np.ndarray, layers: MapLayers, layout: Layout, note: str) -> None:
    """Draw axes and scales on a picture, and a note below the map if there is room."""
    unit, box = layout.unit, layout.map
    (left, below), (right, above) = layers.view.bounds
    corners = layers.view.pixel(np.array([(left, below), (right, below), (right, above), (left, above)]))
    frame = corners + np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)]) * unit
    shapes.stroke(picture, frame, layout.theme.line, layout.px(1.5), closed=True)
    size = 11 * unit
    if layers.view.zoom == 1:
        draw_ticks(picture, layers.view, layout)
    below = box.bottom + 32 * unit
    free = box.right - 8 * unit - _scale_bar(picture, layers, layout, below) - box.left
    right = float(box.right)
    for words in ("metres east →", note):  # the more important one first
        if text_width(words, size) <= free:
            write(picture, words, (right, below), size, layout.theme.muted, anchor="right")
            right -= text_width(words, size) + 15 * unit
            free -= text_width(words, size) + 15 * unit
    free = _scales(picture, layers, layout) - box.left + 8 * unit
    if text_width("metres north ↑", size) + 12 * unit < free:
        write(picture, "metres north ↑", (box.left - 8 * unit, box.top - 8 * unit), size, layout.theme.muted)


def draw_ticks(picture: np.ndarray, view: MapView, layout: Layout) -> None:
    """Metres along the western and southern border of the shown part of the area."""
    unit, box, size = layout.unit, layout.map, 11 * layout.unit
    low, high = view.bounds
    apart = max(text_width(f"{float(high.max()):g}", size) + 8 * unit, 0.2 * max(box.width, box.height))
    spacing = nice_above(apart / view.per_metre)
    first, last = np.ceil(low / spacing - 1e-9) + 0.0, high / spacing * 1.0001  # 0, not −0
    across, up = (np.arange(a, b) * spacing for a, b in zip(first, last, strict=True))
    for x, at in zip(across, view.pixel(np.column_stack([across, 0 * across]))[:, 0], strict=True):
        shapes.stroke(picture, np.array([(at, box.bottom + unit), (at, box.bottom + 5 * unit)]), layout.theme.muted)
        write(picture, f"{x:g}", (at, box.bottom + 17 * unit), size, layout.theme.muted, anchor="centre")
    for y, at in zip(up, view.pixel(np.column_stack([0 * up, up]))[:, 1], strict=True):
        shapes.stroke(picture, np.array([(box.left - unit, at), (box.left - 5 * unit, at)]), layout.theme.muted)
        write(picture, f"{y:g}", (box.left - 8 * unit, at + 0.36 * size), size, layout.theme.muted, anchor="right")


def view_note(trace: Trace) -> str:
    """Point of view, and the depth of the AUVs."""
    least, most = trace.depth.min(), trace.depth.max()
    depths = f"{least:.0f} to {most:.0f}" if least < most else f"{most:g}"
    return f"seen from above, AUVs {depths} m below the boat"


def _scale_bar(picture: np.ndarray, layers: MapLayers, layout: Layout, below: float) -> float:
    """Draw a scale bar at the left; returns its width including the text, pixels."""
    unit, box = layout.unit, layout.map
    length = nice(0.25 * box.width / layers.view.per_metre)
    bar = length * layers.view.per_metre
    left, level = box.left, below - 4 * unit
    ends = np.array([(left, level - 4 * unit), (left, level), (left + bar, level), (left + bar, level - 4 * unit)])
    shapes.stroke(picture, ends, layout.theme.text, layout.px(1.5))
    text = f"{length:g} m"
    write(picture, text, (left + bar + 8 * unit, below), 11 * unit, layout.theme.text)
    return bar + 8 * unit + text_width(text, 11 * unit)


def _scales(picture: np.ndarray, layers: MapLayers, layout: Layout) -> float:
    """Draw colour scale and, where there is room, speed scale above the map; returns their left end, pixels."""
    unit, size = layout.unit, 11 * layout.unit
    right, line = layout.map.right, layout.map.top - 8 * unit

    def words(text: str, gap: float) -> None:
        nonlocal right
        write(picture, text, (right, line), size, layout.theme.muted, anchor="right")
        right -= text_width(text, size) + round(gap * unit)

    limit, streaks = layers.surface.limit, layers.streaks
    start = f"−{limit:g}" if limit else "flat sea"
    if limit:
        words(f"+{limit:g} m", 6)
        room = right - layout.left - text_width(start, size) - 12 * unit
        width, height = max(round(min(90 * unit, room)), layout.px(8)), round(9 * unit)
        top = round(line - height)
        picture[top : top + height, right - width : right] = colour_scale(width, height)
        right -= width + round(6 * unit)
        if right - text_width(f"sea surface  {start}", size) >= layout.left:
            start = f"sea surface  {start}"
    words(start, 18)
    if streaks.fastest == 0.0:
        words("no current", 0)
        return right
    speed = nice(streaks.fastest)
    tail, middle = speed * streaks.tail * layers.view.per_metre, line - 4 * unit
    text = f"current {speed:g} m/s"
    if right - text_width(text, size) - 6 * unit - tail < layout.left:
        return right
    words(text, 6)
    shapes.stroke(picture, np.array([(right - tail, middle), (right, middle)]), layout.theme.muted, layout.px(1.5))
    shapes.stroke(picture, np.array([(right - tail / 2, middle), (right, middle)]), layout.theme.text, layout.px(1.5))
    return right - tail


FRAMES = 60  # of the video, over which data of an AUV are added up and shown
FADING = 10  # frames in which they vanish


class Popups:
    """Words at AUVs with the data that each has collected in some seconds of video; `unit` is a pixel of the design.

    They appear where an AUV delivers data, count what comes within `FRAMES`, and fade then: words that went along with
    it or changed in each frame could hardly be read in fast motion.
    """

    def __init__(self, play: Playback, unit: float) -> None:
        self._play, self._unit = play, unit
        delivered = play.trace.delivered[:, 0].astype(float)
        self._steps = max(math.ceil(FRAMES * play.pace), 1)
        self._rhythm = max(round(RHYTHM * play.pace), 1)
        self._begin = np.full(delivered.shape, -self._steps)  # step from which on data are added up, < 0 before
        self._sum = np.zeros_like(delivered)
        for t, now in enumerate(delivered):
            before = self._begin[t - 1] if t else self._begin[0]
            goes_on = t - before < self._steps
            self._begin[t] = np.where(goes_on | (now < LEAST_DATA), before, t)
            self._sum[t] = now + np.where(goes_on & (t > 0), self._sum[t - 1], 0.0)

    def begin(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Index of what the words of a moment stand at, in values (T, K, …): the step when they appeared, the AUV."""
        begin = np.maximum(self._begin[step_of(t)], 0)
        return begin, np.arange(len(begin))

    def draw(self, picture: np.ndarray, t: float, places: np.ndarray, badges: np.ndarray) -> None:
        """Write them within a picture above places (K, 2), apart from each other and from numbers at `badges`.

        Those of places outside the picture are left out.
        """
        unit, size, step, width = self._unit, 13 * self._unit, step_of(t), picture.shape[1]
        taken = [(x, y, 10 * unit) for x, y in badges]  # middle and half the width
        for auv, ((x, y), inside) in enumerate(zip(places, within(picture, places), strict=True)):
            since = t - self._begin[step, auv]
            if since >= self._steps or not inside:
                continue
            text = f"+{self._sum[step - step_of(since) % self._rhythm, auv]:.2f} Mbit"
            opacity = min((self._steps - since) / (FADING * self._play.pace), 1.0)
            half = text_width(text, size, bold=True) / 2 + 0.4 * size
            x = np.clip(x, half, max(width - half, half))
            y = max(y - 34 * unit, size)
            while any(abs(x - at) < half + other and abs(y - row) < 1.5 * size for at, row, other in taken):
                y += -1.5 * size if y > 2.5 * size else 1.5 * size * (len(taken) + 1)
            taken.append((x, y, half))
            shapes.badge(picture, text, np.array([x, y]), size, style.auv_colour(auv), opacity)


def within(picture: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Whether places (..., 2) lie in a picture."""
    return np.all((places >= 0) & (places < picture.shape[1::-1]), axis=-1)
