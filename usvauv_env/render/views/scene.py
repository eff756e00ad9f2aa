"""The scene of the perspective view: coordinates, camera, projected sea surface and lines, vehicles as solids.

The camera is a level pinhole camera, with its picture shifted down to the scene. Verticals stay vertical in such a
picture, as with the shifted lens of a view camera. Each column of the picture is then a vertical plane of the scene, so
that the sea can be drawn column by column (`look`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.layout import nice, nice_above
from usvauv.env.render.style import Colour
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.site.site import Site

ELEVATION = math.radians(25)  # of the camera above the scene's centre
DISTANCE = 2.6  # from the camera to the scene's centre, in diagonals of the area
OFF_AXIS = math.radians(28)  # from the direction in which a side of the area is seen frontally
SWING = math.radians(9)  # to both sides, by which the camera moves around the scene
SWING_FRAMES = 3600  # of one movement there and back
FOLLOWED = 3.0  # magnification of a view that goes along with a vehicle


@dataclass(frozen=True)
class PinholeCamera:
    """Scene coordinates are metres from the area's centre at mean sea level: east, north, up.

    Attributes:
        heading: in which it looks, anticlockwise from east, rad. distance, height: from the scene's centre, m.
        focal: length in pixels. centre: pixel (x, y) of what is straight ahead at infinity.
        aim: place (east, north) that it looks over from that distance, m.
    """

    heading: float
    distance: float
    height: float
    focal: float
    centre: tuple[float, float]
    aim: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def around(
        cls, sides: tuple[float, float], top: float, bottom: float, left: int, above: int, size: tuple[int, int]
    ) -> PinholeCamera:
        """The camera to which the box of an area is as large as fits in all of its movement, in the middle of that.

        Args:
            sides: of the area, in x and y, m. It is seen across the longer one, from the south or from the east.
            top, bottom: of the box, m.
            left, above, size: of the room in the picture, pixels.
        """
        frontal = math.pi / 2 if sides[0] >= sides[1] else math.pi
        distance = DISTANCE * math.hypot(*sides)
        camera = cls(frontal + OFF_AXIS, distance, distance * math.tan(ELEVATION), 1.0, (0.0, 0.0))
        half = 0.5 * np.array(sides)
        corners = np.array([(x, y, z) for x in (-half[0], half[0]) for y in (-half[1], half[1]) for z in (top, bottom)])
        turns = np.linspace(-SWING, SWING, 9)
        seen = np.concatenate([replace(camera, heading=camera.heading + turn).pixel(corners) for turn in turns])
        low, high = seen.min(axis=0), seen.max(axis=0)
        focal = float((size / (high - low)).min())
        x, y = 0.5 * np.array(size) - 0.5 * focal * (low + high)
        return replace(camera, focal=focal, centre=(float(x) + left, float(y) + above))

    def swung(self, frame: float) -> PinholeCamera:
        """The camera in a frame: it moves slowly to and fro around the scene."""
        turn = SWING * math.sin(2 * math.pi * frame / SWING_FRAMES)
        return replace(self, heading=self.heading + turn)

    def along(self, place: np.ndarray, middle: tuple[float, float]) -> PinholeCamera:
        """The camera that sees a place (3,) from nearer, at the pixel `middle`."""
        focal = FOLLOWED * self.focal
        down = focal * (self.height - float(place[2])) / self.distance
        x, y = place[:2].tolist()
        return replace(self, focal=focal, centre=(middle[0], middle[1] - down), aim=(x, y))

    @cached_property
    def eye(self) -> np.ndarray:
        """Its place (2,) seen from above, m."""
        return np.array(self.aim) - self.distance * self.forward

    @cached_property
    def forward(self) -> np.ndarray:
        """Horizontal unit vector (2,) in which it looks."""
        return np.array([math.cos(self.heading), math.sin(self.heading)])

    @cached_property
    def right(self) -> np.ndarray:
        """Horizontal unit vector (2,) to its right."""
        return np.array([math.sin(self.heading), -math.cos(self.heading)])

    @cached_property
    def _matrix(self) -> tuple[np.ndarray, np.ndarray]:
        """Linear (3, 3) and constant (3,) part of the map to homogeneous pixels, transposed."""
        lens = np.array([(self.focal, 0, self.centre[0]), (0, self.focal, self.centre[1]), (0, 0, 1)])
        axes = np.array([(*self.right, 0.0), (0.0, 0.0, -1.0), (*self.forward, 0.0)])
        return (lens @ axes).T, lens @ (-self.eye @ self.right, self.height, -self.eye @ self.forward)

    def away(self, points: np.ndarray) -> np.ndarray:
        """Distances (...) of points (..., 2 or 3) along the direction in which it looks, m."""
        return (points[..., :2] - self.eye) @ self.forward

    def pixel(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3)."""
        linear, constant = self._matrix
        seen = points @ linear + constant
        return seen[..., :2] / seen[..., 2:]


SAMPLES = 128  # of the surface along the plane of a column


class Columns(NamedTuple):
    """Columns of the half-size picture that see the area, C of them.

    Attributes:
        first: index of the first. x: (C,) their centres, pixels of the picture.
        ray: (C, 2) horizontal way along the column's plane that is 1 m long in the camera's direction.
        near, far: (C,) distance of the area's borders along the camera's direction, m.
    """

    first: int
    x: np.ndarray
    ray: np.ndarray
    near: np.ndarray
    far: np.ndarray

    @classmethod
    def of(cls, camera: PinholeCamera, sides: tuple[float, float], width: int) -> Columns:
        """Columns of a picture `width` pixels wide that see an area with `sides` in x and y, m."""
        x = 2.0 * np.arange(width // 2) + 0.5
        ray = camera.forward + ((x - camera.centre[0]) / camera.focal)[:, None] * camera.right
        half = 0.5 * np.array(sides)
        ray = np.where(np.abs(ray) < 1e-9, 1e-9, ray)
        crossings = np.sort(np.stack([(-half - camera.eye) / ray, (half - camera.eye) / ray]), axis=0)
        near, far = crossings[0].max(axis=1), crossings[1].min(axis=1)
        seen = np.flatnonzero(far > near)
        part = slice(seen[0], seen[-1] + 1)
        return cls(int(seen[0]), x[part], ray[part], near[part], far[part])

    def at(self, x: float) -> int:
        """Index of the column at x, or of the nearest, pixels of the picture."""
        return int(np.clip(round(0.5 * (x - self.x[0])), 0, len(self.x) - 1))


class Sheet(NamedTuple):
    """Surface points in the pixels of a half-size picture: R rows from `top`, columns as `Columns`.

    Attributes:
        top: row of the picture at which it begins, pixels.
        texel_x, texel_y: (R, C) column and row of the field that a pixel shows.
        covered: (R, C) 255 where it shows the surface, else 0.
        horizon, shore: (C,) highest row and row of the near border in the picture, pixels.
    """

    top: int
    texel_x: np.ndarray
    texel_y: np.ndarray
    covered: np.ndarray
    horizon: np.ndarray
    shore: np.ndarray


def look(camera: PinholeCamera, columns: Columns, sides: tuple[float, float], field: np.ndarray, height: int) -> Sheet:
    """Where the sight lines of the pixels of a picture meet a field (Y, X) of heights over an area.

    A column of the picture is a vertical plane of the scene. The surface is sampled along each such plane from the near
    border of the area to the far one. A pixel shows the first sample that is not below it: the samples are entered at
    their rows, the nearest of those at one row remaining, and a running minimum from the top row down finds the nearest
    of all that are as high. All columns are treated at once, at half the picture's resolution. One polygon a cell takes
    OpenCV many times as long; a fixed-point search along the sight lines takes half as long, but does not find what is
    hidden.

    Args:
        sides: of the area in x and y, m.
        field: heights as drawn, m, float32, row 0 in the south.
        height: of the picture, pixels. What is above its first row or below its last is cut off.
    """
    cells = np.array(field.shape[::-1])
    scale = cells / sides
    # Columns and rows of the field at distance D are ray·D + start.
    ray = (columns.ray * scale).astype(np.float32)
    start = (camera.eye * scale + 0.5 * cells - 0.5).astype(np.float32)
    near = (1.0 / columns.near).astype(np.float32)
    change = ((1.0 / columns.far - 1.0 / columns.near) / (SAMPLES - 1)).astype(np.float32)
    inverse = near + np.arange(SAMPLES, dtype=np.float32)[:, None] * change
    distance = 1.0 / inverse
    x, y = distance * ray[:, 0] + start[0], distance * ray[:, 1] + start[1]
    heights = cv2.remap(field, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    rows = (camera.height - heights) * (inverse * np.float32(camera.focal)) + np.float32(camera.centre[1])
    horizon = rows.min(axis=0)
    top, bottom = max(int(horizon.min()) - 2, 0), min(int(rows[0].max()) + 3, height - 2)
    count = max((bottom - top) // 2 + 1, 1)
    sample, covered = nearest(rows, top, count)
    distance = 1.0 / (near + sample * change)
    texel_x, texel_y = distance * ray[:, 0] + start[0], distance * ray[:, 1] + start[1]
    return Sheet(top, texel_x, texel_y, covered, horizon, rows[0])


def nearest(rows: np.ndarray, top: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (count, C) of the samples that pixels of a half-size picture see, with fractions, and 255 where any.

    Args:
        rows: of the picture at which S samples of C columns lie, the nearest first, (S, C) float32.
        top: row of the picture at which the pixels begin.
    """
    samples, across = rows.shape
    # Written far to near, so that the nearest remains.
    place = np.clip(np.ceil((rows - (top + 0.5)) * 0.5), 0, count - 1).astype(np.intp)
    place = place * across + np.arange(across)
    first = np.full((count, across), samples, np.int16)
    numbers = np.arange(samples - 1, -1, -1, dtype=np.int16)[:, None]
    first.reshape(-1)[place[::-1]] = np.broadcast_to(numbers, place.shape)
    first = np.minimum.accumulate(first, axis=0)
    covered = cv2.inRange(first, 1, samples - 1)

    # Between it and the one before, by the row of the pixel.
    before = np.clip(first - 1, 0, samples - 2).astype(np.intp) * across + np.arange(across)
    below, above = rows.take(before), rows.reshape(-1)[across:].take(before)
    middle = (top + 0.5 + 2.0 * np.arange(count, dtype=np.float32))[:, None]
    share = np.clip((below - middle) / np.maximum(below - above, np.float32(1e-6)), 0.0, 1.0)
    return np.clip(first - 1, 0, samples - 2) + share, covered


LEAST_HEIGHT = 0.012  # of the waves' scale over the area's longer side, below which heights are exaggerated
DEPTHS = (0.3, 0.7)  # of the bed's depth over the longer side, beyond which depths are scaled
MOST = 100.0  # exaggeration of heights
WATER = style.colour("#123b56")  # to which lines in the water fade


class Scene(NamedTuple):
    """Scene coordinates are metres from the area's centre at mean sea level: east, north, up.

    Attributes:
        sides: of the area, m. heights, depths: factors by which they are drawn.
        bed: height at which its deepest place is drawn, m, below 0. site: with the bed.
    """

    sides: tuple[float, float]
    heights: float
    depths: float
    bed: float
    site: Site

    @classmethod
    def of(cls, scenario: Scenario, limit: float) -> Scene:
        """The scene of a scenario whose waves have a colour scale that ends at `limit` m; 0 for none."""
        area, longer = scenario.area, max(scenario.area.width, scenario.area.length)
        wanted = LEAST_HEIGHT * longer / limit if limit else 1.0
        heights = min(nice_above(wanted, (1, 2, 5, 10)), MOST) if wanted > 1 else 1.0
        site = Site.recorded(scenario)
        deep = max(float(site.bed.max()), scenario.auv.depth)
        least, most = DEPTHS[0] * longer / deep, DEPTHS[1] * longer / deep
        depths = nice_above(least, (1, 2, 5, 10)) if least > 1 else nice(most) if most < 1 else 1.0
        return cls((area.width, area.length), heights, depths, -depths * deep, site)

    def place(self, position: np.ndarray, up: float | np.ndarray) -> np.ndarray:
        """Scene coordinates (..., 3) of positions (..., 2) in m, at heights as drawn."""
        flat = np.asarray(position, float) - 0.5 * np.array(self.sides)
        return np.concatenate([flat, np.broadcast_to(np.asarray(up, float)[..., None], (*flat.shape[:-1], 1))], -1)

    def floor(self, position: np.ndarray) -> np.ndarray:
        """Heights (...) as drawn of the bed at positions (..., 2) in m."""
        return self.bed + self.depths * (self.site.bed.max() - self.site.depth_at(position))

    def inside(self, line: np.ndarray) -> list[np.ndarray]:
        """The pieces of a line (N, 3) of at least two points that lie within the area and not below the bed."""
        beyond = np.maximum(np.abs(line[:, :2]) - 0.5 * np.array(self.sides), self.bed - line[:, 2:])
        within = np.all(beyond < 1e-6, axis=1)
        breaks = np.flatnonzero(np.diff(within)) + 1
        return [piece for piece in np.split(line, breaks)[0 if within[0] else 1 :: 2] if len(piece) > 1]

    def afloat(self, flat: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """Places (N, 3) on the surface, of heights (Y, X) as drawn, above or below places (N, 2)."""
        x, y = ((flat / self.sides + 0.5) * heights.shape[::-1] - 0.5).astype(np.float32).T
        up = cv2.remap(heights, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.column_stack([flat, up.ravel()])

    @property
    def note(self) -> str:
        """Exaggerated parts, in words."""
        parts = [("heights", self.heights), ("depths", self.depths)]
        told = [f"{name} × {factor:g}" for name, factor in parts if factor != 1]
        return ", ".join(told) if told else "true to scale"


TRAIL_PIECES = 5  # of one colour each


class Canvas(NamedTuple):
    """A BGR picture and the camera whose pixels are its own."""

    picture: np.ndarray
    camera: PinholeCamera

    def line(self, points: np.ndarray, ink: Colour, width: int = 1) -> None:
        """A line through points (N, 3) of the scene."""
        shapes.stroke(self.picture, self.camera.pixel(points), ink, width)

    def circle(self, centre: np.ndarray, radius: float, ink: Colour, width: int = 1, share: float = 1.0) -> None:
        """The part `share` of a level circle of a radius in m, clockwise from the north."""
        turn = np.linspace(0, 2 * np.pi * share, max(3, round(40 * share)))
        self.line(centre + radius * np.stack([np.sin(turn), np.cos(turn), 0 * turn], 1), ink, width)

    def trail(self, points: np.ndarray, ink: Colour, faded: Colour, width: int) -> None:
        """A line through points (N, 3), oldest first, that fades towards the oldest."""
        pixels = self.camera.pixel(points)
        length = max(2, len(pixels) // TRAIL_PIECES + 1)
        begins = range(0, len(pixels) - 1, length)
        for place, begin in enumerate(begins):
            shade = style.mix(faded, ink, (place + 1) / len(begins))
            shapes.stroke(self.picture, pixels[begin : begin + length + 1], shade, width)


LIGHT = np.array([-0.42, -0.25, 0.87])  # unit vector to the light: east, north, up
FACTOR = 3  # by which bodies are drawn magnified before they are averaged


class Body(NamedTuple):
    """A solid of F flat faces, which is as long as 1.

    Attributes:
        corners: (F, 4, 3) of the faces, anticlockwise seen from outside; x forward, y to port, z up.
        normals: (F, 3) unit vectors. colours: (F, 3).
    """

    corners: np.ndarray
    normals: np.ndarray
    colours: np.ndarray

    @classmethod
    def of(cls, faces: list[np.ndarray], colours: list[Colour]) -> Body:
        corners = np.array(faces)
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        return cls(corners, normals / np.linalg.norm(normals, axis=1, keepdims=True), np.array(colours, float))

    def draw(self, canvas: Canvas, place: np.ndarray, axes: np.ndarray, length: float) -> None:
        """Draw it around a place (3,) of the scene, `length` m long, with the axes of `turned`."""
        corners = self.corners * length @ axes + place
        pixels, centre = canvas.camera.pixel(corners), canvas.camera.pixel(place)
        (ax, ay), (bx, by) = (pixels[:, 2] - pixels[:, 0]).T, (pixels[:, 3] - pixels[:, 1]).T
        seen = np.flatnonzero(ax * by - ay * bx < 0)  # rows run down
        seen = seen[np.argsort(-canvas.camera.away(corners[seen].mean(axis=1)))]
        lit = 0.7 + 0.3 * self.normals[seen] @ (axes @ LIGHT)
        colours = (self.colours[seen] * lit[:, None]).tolist()
        reach = float(np.abs(pixels - centre).max()) + 3
        with shapes.smooth(canvas.picture, centre, reach, FACTOR) as (fine, middle):
            outlines = shapes.fixed((pixels[seen] - centre) * FACTOR + middle)
            cv2.polylines(fine, list(outlines), True, style.OUTLINE, 2 * FACTOR, cv2.LINE_8, shapes.SHIFT)
            for outline, colour in zip(outlines, colours, strict=True):
                cv2.fillConvexPoly(fine, outline, colour, cv2.LINE_8, shapes.SHIFT)


def turned(heading: float, slope: np.ndarray) -> np.ndarray:
    """Axes (3, 3) of a body, one a row: forward, to port, up; it stands on a slope (2,) to the east and north, m/m."""
    # The horizontal part of its forward axis is its heading.
    ahead = np.array([math.cos(heading), math.sin(heading)])
    rise = float(slope @ ahead)
    forward = np.array([*ahead, rise]) / math.hypot(1.0, rise)
    up = np.array([-slope[0], -slope[1], 1.0]) / math.sqrt(1.0 + float(slope @ slope))
    (a, b, c), (x, y, z) = up, forward
    return np.array([forward, (b * z - c * y, c * x - a * z, a * y - b * x), up])


def tube(rings: list[np.ndarray], colours: list[Colour]) -> tuple[list[np.ndarray], list[Colour]]:
    """Faces between rings (N, 3) of corners, each ring with a colour for the faces up to the next."""
    faces, inks = [], []
    for low, high, ink in zip(rings[:-1], rings[1:], colours, strict=True):
        faces += list(np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1))
        inks += [ink] * len(low)
    return faces, inks


def _deck(half: tuple[tuple[float, float], ...], up: float) -> np.ndarray:
    """A ring (2 N, 3) at a height, anticlockwise from above, of its starboard half (N, 2) from stern to bow."""
    starboard = np.array(half)
    whole = np.concatenate([starboard, starboard[::-1] * (1, -1)])
    return np.column_stack([whole, np.full(len(whole), up)])


def _lid(ring: np.ndarray) -> list[np.ndarray]:
    """Faces of a flat ring (2 N, 3): strips from side to side."""
    last = len(ring) - 1
    return [ring[[i, i + 1, last - i - 1, last - i]] for i in range(len(ring) // 2 - 1)]


def _boat(waterline: bool = False) -> Body:
    """A boat; with `waterline` what of it is above the water, with a mast, to be seen from beside it."""
    keel = _deck(((-0.46, -0.12), (0.02, -0.14), (0.24, -0.08), (0.38, -0.005)), -0.08)
    line = _deck(((-0.48, -0.16), (0.03, -0.185), (0.29, -0.1), (0.46, -0.005)), 0.02)
    rail = _deck(((-0.5, -0.19), (0.04, -0.21), (0.32, -0.13), (0.56, -0.005)), 0.12)
    red = style.colour("#c8402f")
    below = [line + np.array([0.0, 0.0, up]) for up in (-0.02, 0.015)] if waterline else [keel, line]
    faces, inks = tube([*below, rail], [red, style.BOAT])
    faces += _lid(rail)
    inks += [style.colour("#b9c4ce")] * 3
    room = [_deck(((-0.3, -0.13), (0.14, -0.13)), 0.12), _deck(((-0.29, -0.12), (0.09, -0.12)), 0.22)]
    room += [_deck(((-0.28, -0.115), (0.03, -0.115)), 0.34)]
    walls, shades = tube(room, [style.BOAT, style.BOAT_DECK])
    faces += [*walls, *_lid(room[-1])]
    inks += [*shades, style.BOAT]
    if waterline:
        mast = [_deck(((-0.17, -r), (-0.17 + 2 * r, -r)), up) for r, up in ((0.01, 0.34), (0.004, 0.6))]
        poles, paints = tube(mast, [style.OUTLINE])
        faces, inks = [*faces, *poles], [*inks, *paints]
    return Body.of(faces, inks)


def auv_body(colour: Colour) -> Body:
    """A torpedo with four fins."""
    turns = np.linspace(0.0, 2 * np.pi, 6, endpoint=False)
    profile = ((-0.5, 0.02), (-0.24, 0.1), (0.34, 0.1), (0.5, 0.02))  # along the axis, radius
    rings = [np.stack([np.full(6, x), r * np.cos(turns), r * np.sin(turns)], 1) for x, r in profile]
    band = style.mix(colour, style.WHITE, 0.55)
    faces, inks = tube(rings, [colour, colour, band])
    fin = np.array([(-0.46, 0.03), (-0.28, 0.07), (-0.36, 0.25), (-0.48, 0.25)])
    for y, z in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        blade = np.stack([fin[:, 0], fin[:, 1] * y, fin[:, 1] * z], 1)
        faces += [blade, blade[::-1]]
        inks += [style.mix(colour, style.OUTLINE, 0.3)] * 2
    return Body.of(faces, inks)


BOAT_BODY, BOAT_AFLOAT = _boat(), _boat(waterline=True)
