"""The perspective view of a mission: the sea, the boats that ride it, the water below with AUVs and nodes."""

from __future__ import annotations

import math

import cv2
import numpy as np

from usvauv_env.record.collection import age
from usvauv_env.record.trace import Trace
from usvauv_env.render import bodies, shapes, style, symbols
from usvauv_env.render.camera import Camera, Swing
from usvauv_env.render.exchanges import Exchanges
from usvauv_env.render.frame_layout import Layout, Rectangle
from usvauv_env.render.glass_box import Frame, paint_water
from usvauv_env.render.map import HEARD_FRAMES, OLD, PING_FRAMES, TRAIL, error_axes
from usvauv_env.render.running_metrics import RunningMetrics
from usvauv_env.render.scene import Scene
from usvauv_env.render.sea_layers import colour_scale, elevation_limit
from usvauv_env.render.sea_shading import SeaShading
from usvauv_env.render.text import shorten, text_width, write
from usvauv_env.render.wave_sheet import Columns, Sheet, look

OPACITY = 0.78  # of the surface before what is below
TRAIL_PIECES = 5  # of one colour each
BOAT_LENGTH, AUV_LENGTH = 0.085, 0.06  # as drawn, of the area's longer side
WATER = style.colour("#123b56")  # to which lines in the water fade


class PerspectiveView:
    """Draws world 0 of a trace.

    Attributes:
        scene: where things are drawn and at which scales.
        boats: (T, B, 3) places of their waterlines in it.
    """

    def __init__(self, trace: Trace, running: RunningMetrics, box: Rectangle, layout: Layout) -> None:
        scenario, unit = trace.scenario, layout.unit
        self._trace, self._running, self._box, self._layout = trace, running, box, layout
        margin = min(unit, box.width / 300, box.height / 150)
        left, right, top, bottom = (round(margin * size) for size in (54, 38, 16, 30))
        sides = scenario.area.width, scenario.area.length
        limit = elevation_limit(trace.surface)
        self.scene = scene = Scene.of(scenario, limit)
        room = box.width - left - right, box.height - top - bottom
        crest = 0.8 * limit * scene.heights
        self._swing = Swing.around(sides, crest, scene.bed, room).shifted(left, top)
        self._shading = SeaShading(trace.surface, limit, sides, self._swing.middle, scene.heights)
        self._frame = Frame(scene, layout)
        self._backdrop = _backdrop(box.width, box.height)
        self._write_still(limit)
        self._size = max(sides)
        self._auvs = scene.place(trace.auv_position[:, 0], scene.auvs)
        self._estimated = scene.place(trace.estimate[:, 0], scene.auvs)
        self._nodes = scene.place(trace.node_position[0], scene.nodes)
        floating = trace.boat_surface[:, 0] * (scene.heights if trace.surface.size else 0.0)
        self.boats = scene.place(trace.boat_position[:, 0], floating[..., 0])
        self._slopes = floating[..., 1:]
        self._exchanges = Exchanges.of(trace)
        self._fill = trace.backlog[:, 0] / scenario.nodes.buffer
        # Stations have no data that could be old.
        self._age = age(trace)[:, 0] / OLD * (scenario.task == "data-collection")
        spacing = math.sqrt(sides[0] * sides[1] / len(self._nodes)) * self._swing.middle.focal
        radius = float(np.clip(spacing / self._swing.middle.distance / 8, 3.0 * unit, 9.0 * unit))
        self._gauges = [(symbols.NodeGauges(radius * zoom), radius * zoom) for zoom in (0.85, 1.0, 1.15)]
        # In the last step of a service the target is already the next node.
        serving = trace.hovering[:, 0].astype(bool)
        before = np.roll(trace.target[:, 0], 1, axis=0)
        before[0] = trace.target[0, 0]
        self._target = np.where(serving, before, trace.target[:, 0])
        self._serving = serving
        self._bodies = [bodies.auv(style.auv_colour(k)) for k in range(self._auvs.shape[1])]

    def camera(self, t: int) -> Camera:
        """The camera of step t; its pixels are those of the box."""
        return self._swing.at(t)

    def surface(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """Heights (Y, X) m as drawn and colours (Y, X, 3) of the sea in step t, row 0 in the south."""
        return self._shading.at(t)

    def draw(self, picture: np.ndarray, t: int) -> None:
        """Draw step t inside the box of a BGR picture."""
        region, camera = self._box.of(picture), self.camera(t)
        np.copyto(region, self._backdrop)
        columns = Columns.of(camera, self.scene.sides, self._box.width)
        heights, colours = self.surface(t)
        sheet = look(camera, columns, self.scene.sides, heights, self._box.height)
        paint_water(region, camera, columns, self.scene.bed, sheet)
        self._frame.draw_bed(region, camera, columns, sheet)
        self._draw_nodes(region, camera, t)
        self._draw_sound(region, camera, t)
        for auv in np.argsort(-camera.away(self._auvs[t])):
            self._draw_auv(region, camera, t, int(auv))
        _paint_surface(region, columns, sheet, colours)
        self._frame.draw_edges(region, camera, columns, sheet)
        self._draw_afloat(region, camera, t, heights)
        self._frame.write_lengths(region, camera)
        self._frame.draw_compass(region, camera)
        for auv, place in enumerate(camera.pixel(self._auvs[t])):
            label = place + np.array([14, -13]) * self._layout.unit
            symbols.badge(region, str(auv + 1), label, 11 * self._layout.unit, style.auv_colour(auv))

    def _write_still(self, limit: float) -> None:
        """Words and scale that do not move, on the backdrop."""
        unit, size, picture = self._layout.unit, 11 * self._layout.unit, self._backdrop
        height, width = picture.shape[:2]
        text = f"{self.scene.note}, vehicles enlarged"
        write(
            picture,
            shorten(text, size, width - 20 * unit),
            (width - 10 * unit, height - 9 * unit),
            size,
            style.DARK.muted,
            anchor="right",
        )
        line, right = round(18 * unit), width - 10 * unit
        high, low = (f"+{limit:g} m", f"sea surface  −{limit:g}") if limit else ("flat sea", "")
        across, up, gap = round(90 * unit), round(9 * unit), 6 * unit
        if text_width(high + low, size) + across + 2 * gap > right or line > height:
            return
        write(picture, high, (right, line), size, style.DARK.muted, anchor="right")
        if limit:
            left = round(right - text_width(high, size) - gap) - across
            picture[line - up : line, left : left + across] = colour_scale(across, up)
            write(picture, low, (left - gap, line), size, style.DARK.muted, anchor="right")

    def _draw_nodes(self, picture: np.ndarray, camera: Camera, t: int) -> None:
        away, feet = camera.away(self._nodes), camera.pixel(self._nodes)
        zoom = np.digitize(camera.distance / away, (0.93, 1.07))
        radii = np.array([radius for _, radius in self._gauges])[zoom]
        heads = feet - np.stack([0 * radii, 1.5 * radii], 1)
        stalks = list(shapes.fixed(np.stack([feet, heads], 1)))
        cv2.polylines(picture, stalks, False, style.OUTLINE, self._layout.px(2), cv2.LINE_AA, shapes.SHIFT)
        pulse = 0.5 + 0.5 * math.sin(0.35 * t)
        for node in np.argsort(-away):
            gauges = self._gauges[zoom[node]][0]
            gauges.draw(picture, heads[node], self._fill[t, node], self._age[t, node], pulse)

    def _draw_sound(self, picture: np.ndarray, camera: Camera, t: int) -> None:
        """Lines from the boats to the AUVs they have heard, and spheres around boats that have asked."""
        heard = self._exchanges.heard[t]
        for auv, last in enumerate(heard):
            lit = 0.85 * math.exp((last - t) / HEARD_FRAMES)
            if last >= 0 and lit > 0.1:
                boat = self.boats[t, self._trace.fix_boat[last, 0, auv]]
                ink = style.mix(WATER, style.auv_colour(auv), lit)
                shapes.stroke(picture, camera.pixel(np.stack([boat, self._auvs[t, auv]])), ink, self._layout.px(1.2))
        turn = np.linspace(0, np.pi, 40)[:, None]
        for boat, radius, share in self._pings(t):
            ink = style.mix(WATER, style.BOAT, 0.75 * (1 - share))
            for across in (camera.right, camera.forward):
                arc = np.concatenate([np.cos(turn) * across, -np.sin(turn) * self.scene.depths], 1) * radius + boat
                arc = np.where(arc[:, 2:] < self.scene.bed, np.nan, arc)
                for line in self.scene.inside(arc):
                    shapes.stroke(picture, camera.pixel(line), ink, self._layout.px(1))

    def _pings(self, t: int) -> list[tuple[np.ndarray, float, float]]:
        """Place (3,) of each boat whose ping runs, its radius in m, and the share of its way."""
        running = []
        for boat, began in zip(self.boats[t], self._exchanges.pinged[t], strict=True):
            share = (t - began) / PING_FRAMES
            if began >= 0 and 0 < share < 1:
                reach = np.linalg.norm((self._auvs[t] - boat) / (1.0, 1.0, self.scene.depths), axis=1).max()
                running.append((boat, float(share * reach), share))
        return running

    def _fade(
        self, picture: np.ndarray, pixels: np.ndarray, ink: style.Colour, faded: style.Colour, width: int
    ) -> None:
        """A trail (N, 2) of pixels, oldest first."""
        length = max(2, len(pixels) // TRAIL_PIECES + 1)
        begins = range(0, len(pixels) - 1, length)
        for place, begin in enumerate(begins):
            share = (place + 1) / len(begins)
            shapes.stroke(picture, pixels[begin : begin + length + 1], style.mix(faded, ink, share), width)

    def _track(self, t: int) -> np.ndarray:
        """Steps of a trail that ends at t, at most 60."""
        first = max(0, t - round(TRAIL / self._trace.scenario.mission.step))
        return np.unique(np.linspace(first, t, min(t - first, 60) + 1).astype(int))

    def _draw_auv(self, picture: np.ndarray, camera: Camera, t: int, auv: int) -> None:
        """Trail, drop line, error ellipse, the way to its node, and the body."""
        colour, place, layout = style.auv_colour(auv), self._auvs[t, auv], self._layout
        dim = style.mix(WATER, colour, 0.6)
        self._fade(picture, camera.pixel(self._auvs[self._track(t), auv]), colour, WATER, layout.px(2))
        foot = np.array([*place[:2], self.scene.bed])
        shapes.stroke(picture, camera.pixel(np.stack([place, foot])), dim, layout.px(1))
        self._ring(picture, camera, foot, 0.012 * self._size, 1.0, dim)
        node = self._nodes[self._target[t, auv]]
        ends = camera.pixel(np.stack([place, node]))
        if self._serving[t, auv]:
            reach = max(self._trace.scenario.auv.hover_radius, 0.04 * self._size)
            self._ring(picture, camera, node, reach, 1.0, dim)
            self._ring(picture, camera, node, reach, self._running.service_share[t, auv], colour, layout.px(3))
        pieces = shapes.dashes(ends[0], ends[1], 4 * layout.unit)
        if pieces:
            cv2.polylines(
                picture, list(shapes.fixed(np.array(pieces))), False, dim, layout.px(1.3), cv2.LINE_AA, shapes.SHIFT
            )
        axes = error_axes(self._trace.estimate_covariance[t, 0, auv])
        outline = shapes.ellipse_points(self._estimated[t, auv, :2], axes, 64)
        outline = np.concatenate([outline, outline[:1]])
        for line in self.scene.inside(np.column_stack([outline, np.full(len(outline), place[2])])):
            shapes.stroke(picture, camera.pixel(line), style.mix(colour, style.WHITE, 0.3), layout.px(1.2))
        fix, here = camera.pixel(np.stack([self._estimated[t, auv], place]))
        if np.hypot(*(fix - here)) > 5 * layout.unit:
            symbols.fix(picture, fix, 4 * layout.unit, style.WHITE, 1.5 * layout.unit, layout.zoom)
        turned = bodies.turned(self._running.heading[t, auv], np.zeros(2))
        self._bodies[auv].draw(picture, camera, place, turned, AUV_LENGTH * self._size)

    def _ring(
        self,
        picture: np.ndarray,
        camera: Camera,
        centre: np.ndarray,
        radius: float,
        share: float,
        ink: style.Colour,
        width: int = 1,
    ) -> None:
        """The part `share` of a level circle, clockwise from the north."""
        turn = np.linspace(0, 2 * np.pi * share, max(3, round(40 * share)))
        line = centre + radius * np.stack([np.sin(turn), np.cos(turn), 0 * turn], 1)
        shapes.stroke(picture, camera.pixel(line), ink, width)

    def _on_surface(self, flat: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """Places (N, 3) on the surface above or below places (N, 2 or 3)."""
        texels = (flat[:, :2] / self.scene.sides + 0.5) * heights.shape[::-1] - 0.5
        x, y = texels.astype(np.float32).T
        up = cv2.remap(heights, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.column_stack([flat[:, :2], up.ravel()])

    def _draw_afloat(self, picture: np.ndarray, camera: Camera, t: int, heights: np.ndarray) -> None:
        """Pings on the surface, the boats, their wakes and goals."""
        layout, width = self._layout, self._layout.px(1.3)
        turn = np.linspace(0, 2 * np.pi, 73)
        for boat, radius, share in self._pings(t):
            circle = boat[:2] + radius * np.stack([np.cos(turn), np.sin(turn)], 1)
            ink = style.mix(style.BOAT, style.SEA[3], share)
            for line in self.scene.inside(self._on_surface(circle, heights)):
                shapes.stroke(picture, camera.pixel(line), ink, width)
        goals = self.scene.place(self._trace.boat_goal[t, 0], 0.0)
        for boat in np.argsort(-camera.away(self.boats[t])):
            place = self.boats[t, boat]
            wake = self._on_surface(self.boats[self._track(t), boat], heights)
            self._fade(picture, camera.pixel(wake), style.BOAT, style.SEA[3], width)
            way = place[:2] + np.linspace(0, 1, 24)[:, None] * (goals[boat, :2] - place[:2])
            way = camera.pixel(self._on_surface(way, heights))
            cv2.polylines(
                picture, list(shapes.fixed(way.reshape(-1, 2, 2))), False, style.BOAT, 1, cv2.LINE_AA, shapes.SHIFT
            )
            symbols.cross(picture, way[-1], 5 * layout.unit, style.BOAT, layout.px(2))
            turned = bodies.turned(self._running.boat_heading[t, boat], self._slopes[t, boat])
            bodies.BOAT.draw(picture, camera, place, turned, BOAT_LENGTH * self._size)


def _backdrop(width: int, height: int) -> np.ndarray:
    """A dark room, a little lighter in the middle."""
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    glow = np.exp(-1.4 * (x * x + (y + 0.25) ** 2))[:, :, None]
    low, high = np.array(style.DARK.background, float), np.array(style.colour("#1d3346"), float)
    grain = np.random.default_rng(0).uniform(-0.5, 0.5, (height, width, 1))  # against bands
    return np.clip(low + (high - low) * glow + grain, 0, 255).round().astype(np.uint8)


def _paint_surface(picture: np.ndarray, columns: Columns, sheet: Sheet, colours: np.ndarray) -> None:
    small = cv2.remap(colours, sheet.texel_x, sheet.texel_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    size = 2 * small.shape[1], 2 * small.shape[0]
    region = picture[sheet.top : sheet.top + size[1], 2 * columns.first : 2 * columns.first + size[0]]
    large, shown = cv2.resize(small, size), cv2.resize(sheet.covered, size)
    cv2.threshold(shown, 127, 255, cv2.THRESH_BINARY, shown)
    below = region.copy()
    cv2.copyTo(cv2.addWeighted(below, 1 - OPACITY, large, OPACITY, 0), shown, region)
