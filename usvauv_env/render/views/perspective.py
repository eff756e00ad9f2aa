"""The perspective view of a mission: the sea with the boats on it, the water below with AUVs and nodes."""

from __future__ import annotations

import math
from itertools import pairwise

import cv2
import numpy as np

from usvauv.env.record.tracking_metrics import letter
from usvauv.env.render import shapes, style
from usvauv.env.render.layout import Layout, Rectangle, nice_above
from usvauv.env.render.mission import Playback, Series, Vehicle, error_axes, step_of
from usvauv.env.render.style import Theme, shorten, text_width, write
from usvauv.env.render.views.map import Popups, within
from usvauv.env.render.views.scene import (
    BOAT_BODY,
    WATER,
    Canvas,
    Columns,
    PinholeCamera,
    Scene,
    Sheet,
    auv_body,
    look,
    turned,
)
from usvauv.env.render.views.sea_surface import TEXELS, MapView, SeaShading, colour_scale, elevation_limit

OPACITY = 0.65  # of the surface over the scene below
LEAST_WITH_WORDS = 150  # height in pixels of the design; pictures below it have no scale and no note
FINE = 320  # cells along the longer side, of the sea in a view that goes along with a vehicle
BOAT_LENGTH = 0.085  # as drawn, of the area's longer side
FAINTEST = 0.1  # share of its colour to which the line to an AUV fades after a reply


class PerspectiveView:
    """Draws world 0 of a trace, with `follow` from nearer that AUV.

    Attributes:
        scene: where things are drawn and at which scales.
        boats: places (B, 3) of their waterlines in it.
    """

    def __init__(self, play: Playback, box: Rectangle, layout: Layout, follow: Vehicle | None = None) -> None:
        self._play, self._box, self._layout, trace = play, box, layout, play.trace
        sides, limit = (trace.scenario.area.width, trace.scenario.area.length), elevation_limit(trace.surface)
        self.scene = scene = Scene.of(trace.scenario, limit)
        margin = min(layout.unit, box.width / 300, box.height / 150)
        left, right, top, bottom = (round(margin * size) for size in (54, 38, 16, 30))
        room = box.width - left - right, box.height - top - bottom
        self._middle = PinholeCamera.around(sides, 0.8 * limit * scene.heights, scene.bed, left, top, room)
        self._followed = self._grid = None
        texels, self._enlarged = TEXELS, 1.0
        if follow:
            up = -scene.depths * trace.depth[:, 0, follow.index]
            self._followed = Series(scene.place(follow.way(trace).values, up), smooth=True)
            self._grid = MapView(trace.scenario.area, box).grid(FINE)
            texels, self._enlarged = FINE, 1 / 2
        self._shading = SeaShading(limit, sides, self._middle, scene.heights, texels)
        self._glass = GlassBox(scene, layout)
        self._backdrop = _backdrop(box.width, box.height, layout.theme)
        self._write_still(limit)
        floating = play.floating.values * (scene.heights if trace.surface.size else 0.0)
        self.boats = Series(scene.place(play.boats.values, floating[..., 0]), smooth=True)
        self._slopes = Series(floating[..., 1:], smooth=True)
        self._below = BelowSurface(play, scene, layout, self._middle, self._enlarged)

    @property
    def per_metre(self) -> float:
        """Pixels a metre in the middle of the area."""
        return self._middle.focal / self._middle.distance / self._enlarged

    def camera(self, t: float) -> PinholeCamera:
        """The camera of a moment; its pixels are those of the box."""
        camera = self._middle.swung(t / self._play.pace)
        if self._followed is None:
            return camera
        return camera.along(self._followed.at(t), (0.5 * self._box.width, 0.5 * self._box.height))

    def surface(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Heights (Y, X) m as drawn and colours (Y, X, 3) of the sea at a moment, row 0 in the south."""
        sea = self._play.sea
        return self._shading.of(sea.on(t, *self._grid) if self._grid else sea.at(t))

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw a moment inside the box of a BGR picture."""
        canvas = Canvas(self._box.of(picture), self.camera(t))
        np.copyto(canvas.picture, self._backdrop)
        columns = Columns.of(canvas.camera, self.scene.sides, self._box.width)
        heights, colours = self.surface(t)
        sheet = look(canvas.camera, columns, self.scene.sides, heights, self._box.height)
        paint_water(canvas, columns, self.scene.bed, sheet)
        self._glass.draw_bed(canvas, columns, sheet)
        self._below.draw_nodes(canvas, t)
        self._draw_sound(canvas, t)
        for auv in np.argsort(-canvas.camera.away(self._below.auvs.at(t))):
            self._below.draw_auv(canvas, t, int(auv))
        _paint_surface(canvas.picture, columns, sheet, colours)
        self._glass.draw_edges(canvas, columns, sheet)
        self._draw_field(canvas, step_of(t), heights)
        self._draw_pings(canvas, t, heights)
        for boat in np.argsort(-canvas.camera.away(self.boats.at(t))):
            self._draw_boat(canvas, t, int(boat), heights)
        self._glass.write_lengths(canvas)
        self._glass.draw_compass(canvas)
        self._below.draw_words(canvas, t)

    def _write_still(self, limit: float) -> None:
        """Words and scale that do not move, on the backdrop."""
        unit, size, picture = self._layout.unit, 11 * self._layout.unit, self._backdrop
        height, width = picture.shape[:2]
        if height < LEAST_WITH_WORDS * unit:
            return
        line, right, muted = round(18 * unit), width - 10 * unit, self._layout.theme.muted
        note = shorten(f"{self.scene.note}, vehicles enlarged", size, width - 20 * unit)
        write(picture, note, (right, height - 9 * unit), size, muted, anchor="right")
        high, low = (f"+{limit:g} m", f"sea surface  −{limit:g}") if limit else ("flat sea", "")
        across, up, gap = round(90 * unit), round(9 * unit), 6 * unit
        if text_width(high + low, size) + across + 2 * gap > right:
            return
        write(picture, high, (right, line), size, muted, anchor="right")
        if limit:
            left = round(right - text_width(high, size) - gap) - across
            picture[line - up : line, left : left + across] = colour_scale(across, up)
            write(picture, low, (left - gap, line), size, muted, anchor="right")

    def _draw_sound(self, canvas: Canvas, t: float) -> None:
        """Lines to the AUVs that have replied, and two half circles of each ping's sphere, down to the bed."""
        auvs, boats, width = self._below.auvs.at(t), self.boats.at(t), self._layout.px(1.2)
        for auv, place in enumerate(auvs):
            boat, fresh = self._play.heard(t, auv)
            if 0.85 * fresh > FAINTEST:
                ink = style.mix(WATER, style.auv_colour(auv), 0.85 * fresh)
                canvas.line(np.stack([boats[boat], place]), ink, width)
        turn = np.linspace(0, np.pi, 40)[:, None]
        for boat, radius, share in self._pings(t):
            ink = style.mix(WATER, style.BOAT, 0.75 * (1 - share))
            for across in (canvas.camera.right, canvas.camera.forward):
                arc = np.concatenate([np.cos(turn) * across, -np.sin(turn) * self.scene.depths], 1) * radius + boat
                for line in self.scene.inside(arc):
                    canvas.line(line, ink, width)

    def _draw_pings(self, canvas: Canvas, t: float, heights: np.ndarray) -> None:
        """The circles in which the spheres of pings meet the surface."""
        turn = np.linspace(0, 2 * np.pi, 73)
        for boat, radius, share in self._pings(t):
            circle = boat[:2] + radius * np.stack([np.cos(turn), np.sin(turn)], 1)
            for line in self.scene.inside(self.scene.afloat(circle, heights)):
                canvas.line(line, style.mix(style.BOAT, style.SEA[3], 0.4 + 0.6 * share), self._layout.px(1.3))

    def _pings(self, t: float) -> list[tuple[np.ndarray, float, float]]:
        """Place (3,) of each boat whose ping runs, its radius in m, and the share of its way."""
        running = []
        for boat, share in zip(self.boats.at(t), self._play.ping(t), strict=True):
            if share:
                way = (self._below.auvs.at(t) - boat) / (1.0, 1.0, self.scene.depths)
                running.append((boat, float(share * np.linalg.norm(way, axis=1).max()), share))
        return running

    def _draw_field(self, canvas: Canvas, step: int, heights: np.ndarray) -> None:
        """Contour lines on the water of the value of replies received at a place, brighter for larger values."""
        for level, lines in self._play.field.lines(step):
            ink = style.mix(style.SEA[2], style.FIELD, 0.15 + 0.6 * level)
            for line in lines:
                canvas.line(self.scene.afloat(self.scene.place(line, 0.0)[:, :2], heights), ink, self._layout.px(1.2))

    def _draw_boat(self, canvas: Canvas, t: float, boat: int, heights: np.ndarray) -> None:
        """Wake, way to the goal, goal and body."""
        layout, place, scene = self._layout, self.boats.at(t)[boat], self.scene
        wake = self.boats.until(t, self._play.track(t, 60))[:, boat, :2]
        canvas.trail(scene.afloat(wake, heights), style.BOAT, style.SEA[3], layout.px(1.3))
        goal = scene.place(self._play.goals.at(t)[boat], 0.0)
        way = place[:2] + np.linspace(0, 1, 24)[:, None] * (goal[:2] - place[:2])
        pixels = canvas.camera.pixel(scene.afloat(way, heights))
        if np.hypot(*(pixels[-1] - pixels[0])) > 20 * layout.unit:  # nearer goals are below the boat
            shapes.strokes(canvas.picture, pixels.reshape(-1, 2, 2), style.BOAT)
            shapes.cross(canvas.picture, pixels[-1], 5 * layout.unit, style.BOAT, layout.px(2))
        axes = turned(float(self._play.boat_headings.at(t)[boat]), self._slopes.at(t)[boat])
        BOAT_BODY.draw(canvas, place, axes, self._enlarged * BOAT_LENGTH * max(scene.sides))


def _backdrop(width: int, height: int, theme: Theme) -> np.ndarray:
    """A room in the theme's colour, a little lighter in the middle."""
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    glow = np.exp(-1.4 * (x * x + (y + 0.25) ** 2))[:, :, None]
    low, high = np.array(theme.background, float), np.array(theme.glow, float)
    grain = np.random.default_rng(0).uniform(-0.5, 0.5, (height, width, 1))  # against bands
    return np.clip(low + (high - low) * glow + grain, 0, 255).round().astype(np.uint8)


def _paint_surface(picture: np.ndarray, columns: Columns, sheet: Sheet, colours: np.ndarray) -> None:
    """Draw the translucent surface over the scene below."""
    small = cv2.remap(colours, sheet.texel_x, sheet.texel_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    size = 2 * small.shape[1], 2 * small.shape[0]
    region = picture[sheet.top : sheet.top + size[1], 2 * columns.first : 2 * columns.first + size[0]]
    large, shown = cv2.resize(small, size), cv2.resize(sheet.covered, size)
    cv2.threshold(shown, 127, 255, cv2.THRESH_BINARY, shown)
    cv2.copyTo(cv2.addWeighted(region, 1 - OPACITY, large, OPACITY, 0), shown, region)


COARSE = 4  # pixels of the picture to one of the water's light
LIT = np.array(style.colour("#2a86a3"), np.float32)  # water at the surface
DARK = np.array(style.colour("#07192b"), np.float32)  # water at the bed
BED = np.array(style.colour("#35596a"), np.float32)
_BLEND = np.column_stack([LIT - DARK, BED - DARK, DARK])  # of shares of light and bed
GRID = style.colour("#406a7b")
GLASS = style.colour("#6fb3c4")
HORIZON = style.colour("#4d8aa6")
SHORE = style.colour("#bfe6ee")


def _light(camera: PinholeCamera, columns: Columns, bed: float, rows: np.ndarray) -> np.ndarray:
    """Colours (R, C, 3) of the box at rows (R,) of the picture: its bed or far wall, veiled by the water before it."""
    near, far = columns.near.astype(np.float32), columns.far.astype(np.float32)
    fall = ((rows - camera.centre[1]) / camera.focal)[:, None].astype(np.float32)  # m of descent to 1 m of distance
    last = np.minimum(far, np.float32(camera.height - bed) / fall)
    entry = np.minimum(np.maximum(near, np.float32(camera.height) / fall), last)
    way = (last - entry) * (1.5 * np.hypot(*columns.ray.T) / camera.distance).astype(np.float32)
    down, middle = (np.maximum((at * fall - camera.height) / -bed, 0.0) for at in (last, 0.5 * (last + entry)))
    # The edge between bed and wall is as wide as a pixel of this coarse picture.
    on_bed = np.clip((down - 1.0) * np.float32(-bed * camera.focal / (COARSE * camera.distance)) + 1.0, 0.0, 1.0)
    clear = cv2.exp(-way)
    lit = clear * (1.0 - on_bed) * cv2.exp(-2.2 * down) + (1.0 - clear) * cv2.exp(-2.0 * middle)
    return cv2.convertScaleAbs(cv2.transform(cv2.merge([lit, clear * on_bed]), _BLEND))


def paint_water(canvas: Canvas, columns: Columns, bed: float, sheet: Sheet) -> None:
    """Fill the box from the highest line of the surface to the near edges of the bed, at height `bed`."""
    picture, camera = canvas
    foot = camera.centre[1] + camera.focal * (camera.height - bed) / columns.near
    top = max(int(sheet.horizon.min()), 0)
    rows = np.arange(top + 0.5 * COARSE - 0.5, min(float(foot.max()), picture.shape[0]) + COARSE, COARSE)
    coarse = Columns(columns.first, *(part[:: COARSE // 2] for part in columns[1:]))
    small = _light(camera, coarse, bed, rows)
    large = cv2.resize(small, None, fx=COARSE, fy=COARSE, interpolation=cv2.INTER_LINEAR)
    region = picture[top : top + large.shape[0], 2 * columns.first : 2 * columns.first + large.shape[1]]
    mask = np.zeros(region.shape[:2], np.uint8)
    above, below = (np.stack([columns.x - 2 * columns.first, line - top], 1) for line in (sheet.horizon, foot))
    cv2.fillPoly(mask, [np.rint(np.concatenate([above, below[::-1]])).astype(np.int32)], 255)
    cv2.copyTo(large[: region.shape[0], : region.shape[1]], mask, region)


def _labels_apart(places: np.ndarray, width: float, height: float) -> int:
    """Every how many of the places (N, 2) in a row can have a label of that width and height, pixels."""
    if len(places) < 2:
        return 1
    across, up = np.abs(np.diff(places, axis=0)).min(axis=0)
    return max(1, math.ceil(min(width / max(across, 1e-3), height / max(up, 1e-3))))


class GlassBox:
    """Lines and words of the box."""

    def __init__(self, scene: Scene, layout: Layout) -> None:
        self._scene, self._layout = scene, layout
        self._half = 0.5 * np.array(scene.sides)
        spacing = nice_above(max(scene.sides) / 5)
        depth = -scene.bed / scene.depths
        self._depths = np.arange(0, depth * 1.0001, nice_above(depth / 4))
        self._ticks = [np.arange(0, side * 1.0001, spacing) for side in scene.sides]

    def _near(self, camera: PinholeCamera) -> np.ndarray:
        """The area's nearest corner (2,), m."""
        return -self._half * np.sign(camera.forward)

    def draw_bed(self, canvas: Canvas, columns: Columns, sheet: Sheet) -> None:
        """The grid, and the edge behind the water."""
        bed, lines, points = self._scene.bed, [], 2 if self._scene.site.flat else FINE // 4
        for axis in (0, 1):
            for tick in self._ticks[axis]:
                line = np.full((points, 2), tick)
                line[:, 1 - axis] = np.linspace(0.0, self._scene.sides[1 - axis], points)
                lines.append(self._scene.place(line, self._scene.floor(line)))
        shapes.strokes(canvas.picture, canvas.camera.pixel(np.array(lines)), GRID)
        x, foot = canvas.camera.pixel(np.array([*-self._near(canvas.camera), bed]))
        edge = np.array([(x, sheet.horizon[columns.at(x)]), (x, foot)])
        shapes.stroke(canvas.picture, edge, GRID, self._layout.px(1))

    def draw_edges(self, canvas: Canvas, columns: Columns, sheet: Sheet) -> None:
        """The near edges of the glass, and the lines where the surface meets it."""
        near, bed, width = self._near(canvas.camera), self._scene.bed, self._layout.px(1)
        foot = np.array([(near[0], -near[1], bed), (*near, bed), (-near[0], near[1], bed)])
        canvas.line(foot, GLASS, width)
        feet = canvas.camera.pixel(foot)
        tops = [(x, sheet.shore[columns.at(x)]) for x in feet[:, 0]]
        shapes.strokes(canvas.picture, np.stack([feet, tops], 1), GLASS, width)
        for line, ink in ((sheet.horizon, HORIZON), (sheet.shore, SHORE)):
            shapes.stroke(canvas.picture, np.stack([columns.x, line], 1)[::2], ink, width)

    def write_lengths(self, canvas: Canvas) -> None:
        """Metres along the near edges of the bed, and of depth at the left."""
        picture, camera = canvas
        unit, near = self._layout.unit, self._near(camera)
        size, out = 11 * unit, 0.02 * max(self._scene.sides)
        for axis in (0, 1):
            ends = np.tile([*near, self._scene.bed], (2, len(self._ticks[axis]), 1))
            ends[:, :, axis] = self._ticks[axis] - self._half[axis]
            ends[1, :, 1 - axis] += math.copysign(out, near[1 - axis])
            ends = camera.pixel(ends).swapaxes(0, 1)
            shapes.strokes(canvas.picture, ends, self._layout.theme.muted)
            anchor, gap = ("left", 3 * unit) if ends[0, 1, 0] > ends[0, 0, 0] else ("right", -3 * unit)
            words = [f"{tick:g}" for tick in self._ticks[axis]]
            words[-1] += " m"
            every = _labels_apart(ends[:, 1], text_width(words[-1], size), size)
            for text, (_, (x, y)) in list(zip(words, ends, strict=True))[(len(words) - 1) % every :: every]:
                write(picture, text, (x + gap, y + 10 * unit), size, self._layout.theme.muted, anchor=anchor)
        corners = np.array([(near[0], -near[1]), (-near[0], near[1])])
        left = corners[np.argmin(corners @ camera.right)]
        places = camera.pixel(np.array([(*left, -depth * self._scene.depths) for depth in self._depths]))
        every = _labels_apart(places, math.inf, size)
        for depth, (x, y) in list(zip(self._depths, places, strict=True))[::every]:
            shapes.stroke(picture, np.array([(x, y), (x - 5 * unit, y)]), self._layout.theme.muted)
            words = f"−{depth:g} m" if depth else "0 m"
            write(picture, words, (x - 8 * unit, y + 4 * unit), size, self._layout.theme.muted, anchor="right")

    def draw_compass(self, canvas: Canvas) -> None:
        """An arrow to the north, lying level, at the lower left."""
        unit, (picture, camera) = self._layout.unit, canvas
        middle = np.array([34 * unit, picture.shape[0] - 34 * unit])
        level = np.array([camera.right, camera.forward * -camera.height / camera.distance]) * 20 * unit
        turns = np.linspace(0.0, 2 * np.pi, 48)
        shapes.stroke(picture, middle + np.stack([np.cos(turns), np.sin(turns)], 1) @ level.T, self._layout.theme.line)
        arrow = np.array([(0.0, 0.95), (0.26, -0.55), (0.0, -0.3), (-0.26, -0.55)]) @ level.T + middle
        shapes.fill(picture, arrow[[0, 1, 2]], self._layout.theme.muted)
        shapes.fill(picture, arrow[[0, 2, 3]], self._layout.theme.text)
        x, y = middle + level @ (0.0, 1.55)
        write(picture, "N", (x, y + 4 * unit), 11 * unit, self._layout.theme.text, bold=True, anchor="centre")


AUV_LENGTH = 0.06  # as drawn, of the area's longer side
SMALL = 300  # height up to which a view leaves words to the map beside it, pixels of the design
ZOOMS = (0.85, 1.0, 1.15)  # of nodes by their distance, of which each size has a picture of its own


class BelowSurface:
    """AUVs and nodes of world 0 of a trace, with trails, ways to the next nodes, error ellipses and numbers.

    Attributes:
        auvs: their places (K, 3) in the scene.
    """

    def __init__(self, play: Playback, scene: Scene, layout: Layout, camera: PinholeCamera, enlarged: float) -> None:
        trace, scenario, unit = play.trace, play.trace.scenario, layout.unit
        self._play, self._scene, self._layout = play, scene, layout
        places = trace.auv_position, trace.foreseen_position, trace.estimate
        auvs, foreseen, estimated = (scene.place(place[:, 0], -scene.depths * trace.depth[:, 0]) for place in places)
        self.auvs, self._foreseen, self._estimated = Series(auvs, smooth=True), Series(foreseen), Series(estimated)
        self._length = enlarged * AUV_LENGTH * max(scene.sides)
        nodes = play.node_way
        depth = play.target_depth if play.moving else scenario.auv.depth
        heights = -scene.depths * depth if play.stations or play.moving else scene.floor(nodes)
        self._nodes = play.of_nodes(scene.place(nodes, heights))
        self._floor = Series(scene.floor(trace.auv_position[:, 0]))
        spacing = math.sqrt(scene.sides[0] * scene.sides[1] / nodes.shape[1]) * camera.focal / camera.distance
        self._radii = np.clip(spacing / 8, 3.0 * unit, 9.0 * unit) * np.array(ZOOMS)
        self._gauges = [shapes.NodeGauges(float(radius)) for radius in self._radii]
        self._popups = Popups(play, unit)
        self._bodies = [auv_body(style.auv_colour(auv)) for auv in range(trace.auv_position.shape[2])]

    def draw_nodes(self, canvas: Canvas, t: float) -> None:
        """Gauges on stalks, far to near, or the stations."""
        nodes = self._nodes.at(t)
        away, feet = canvas.camera.away(nodes), canvas.camera.pixel(nodes)
        zoom = np.digitize(canvas.camera.distance / away, (0.93, 1.07))
        if self._play.moving:
            for number, (place, radius) in enumerate(zip(feet, self._radii[zoom], strict=True)):
                shapes.target(canvas.picture, place, 0.7 * radius, style.TARGET, self._layout.zoom)
                if within(canvas.picture, place):
                    label = place + np.array([14, -13]) * self._layout.unit
                    shapes.badge(canvas.picture, letter(number), label, 11 * self._layout.unit, style.TARGET)
            return
        heads = feet - self._radii[zoom][:, None] * (0.0, 1.5)
        shapes.strokes(canvas.picture, np.stack([feet, heads], 1), style.OUTLINE, self._layout.px(2))
        if self._play.stations:
            for auv, (head, radius) in enumerate(zip(heads, self._radii[zoom], strict=True)):
                shapes.station(canvas.picture, head, radius, style.auv_colour(auv), self._layout.zoom)
            return
        pulse, step = 0.5 + 0.5 * math.sin(0.35 * t / self._play.pace), step_of(t)
        for node in np.argsort(-away):
            gauges = self._gauges[zoom[node]]
            gauges.draw(canvas.picture, heads[node], self._play.fill[step, node], self._play.age[step, node], pulse)

    def draw_words(self, canvas: Canvas, t: float) -> None:
        """The AUVs' numbers beside them, and their latest data, which a small view leaves out."""
        height, unit = canvas.picture.shape[0], self._layout.unit
        auvs = canvas.camera.pixel(self.auvs.at(t))
        labels = auvs + np.array([14, -13]) * unit
        if height > SMALL * unit:
            places = canvas.camera.pixel(self.auvs.values[self._popups.begin(t)])
            self._popups.draw(canvas.picture, t, places, labels)
        for auv in np.flatnonzero(within(canvas.picture, auvs)).tolist():
            shapes.badge(canvas.picture, str(auv + 1), labels[auv], 11 * unit, style.auv_colour(auv))

    def draw_auv(self, canvas: Canvas, t: float, auv: int) -> None:
        """Trail, line down to the bed, ways to its next nodes, error ellipse, estimate, and the body."""
        colour, place, layout, size = style.auv_colour(auv), self.auvs.at(t)[auv], self._layout, max(self._scene.sides)
        dim, step = style.mix(WATER, colour, 0.6), step_of(t)
        trail = self.auvs.until(t, self._play.track(t, 60))[:, auv]
        canvas.trail(trail, colour, WATER, layout.px(2))
        foot = np.array([*place[:2], self._floor.at(t)[auv]])
        canvas.line(np.stack([place, foot]), dim)
        canvas.circle(foot, 0.012 * size, dim)
        stops = self._nodes.at(t)[self._play.stops(step, auv)]
        for number, leg in enumerate(pairwise(stops)):
            canvas.line(np.stack(leg), style.mix(WATER, colour, 0.5 - 0.12 * number), layout.px(1.3))
        node = stops[0]
        if self._play.hovering[step, auv]:
            reach = max(self._play.trace.scenario.service_radius, 0.04 * size)
            canvas.circle(node, reach, dim)
            canvas.circle(node, reach, colour, layout.px(3), self._play.service_share[step, auv])
        estimated = self._estimated.at(t)[auv]
        ends = np.stack([place, node, estimated, self._foreseen.at(t)[auv]])
        begin, end, fix, foreseen = canvas.camera.pixel(ends)
        shapes.strokes(canvas.picture, shapes.dashes(begin, end, 4 * layout.unit), dim, layout.px(1.3))
        outline = shapes.ellipse_points(estimated[:2], error_axes(self._play.covariance.at(t)[auv]), 64)
        level = np.column_stack([outline, np.full(len(outline), place[2])])
        for line in self._scene.inside(np.concatenate([level, level[:1]])):
            canvas.line(line, style.mix(colour, style.WHITE, 0.3), layout.px(1.2))
        if np.hypot(*(foreseen - fix)) > 5 * layout.unit:
            shapes.strokes(canvas.picture, shapes.dashes(foreseen, begin, 3 * layout.unit), dim)
            shapes.foreseen(canvas.picture, foreseen, 6 * layout.unit, colour, 1.6 * layout.unit, layout.zoom)
        if np.hypot(*(fix - begin)) > 5 * layout.unit:
            shapes.fix(canvas.picture, fix, 4 * layout.unit, colour, 1.5 * layout.unit, layout.zoom)
        heading, pitch, _ = self._play.attitude.at(t)[auv].tolist()
        climb = self._scene.depths * math.tan(pitch)  # as steep as its way is drawn
        axes = turned(heading, climb * np.array([math.cos(heading), math.sin(heading)]))
        self._bodies[auv].draw(canvas, place, axes, self._length)
