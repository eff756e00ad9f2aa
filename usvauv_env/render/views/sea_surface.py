"""The sea in pictures: from above as coloured relief with the current as streaks, in perspective as a lit surface.

From above (`SeaSurface`, `CurrentStreaks`) and in perspective (`SeaShading`) it has the same colour scale. `MapView`
is the scale of lengths from above.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import torch

from usvauv.env.render import style
from usvauv.env.render.layout import Rectangle, nice_above
from usvauv.env.render.shapes import Overlay
from usvauv.env.render.views.scene import PinholeCamera
from usvauv.env.scenario.environment import Area
from usvauv.env.storage.memory import extremes
from usvauv.kernels import runtime
from usvauv.kernels.flow.current import particle_paths
from usvauv.kernels.flow.vortex import ENDLESS, Eddies
from usvauv.kernels.types import Level

RELIEF_PIXELS = 160  # largest side of the relief as it is shaded, before it is enlarged
LIGHT = np.array([-0.55, 0.55, 0.63], np.float32)  # unit vector to the light: east, north, up


class MapView:
    """Metres of the area (x east, y north) to pixels of the frame.

    Args:
        area: the whole area. rectangle: that shows it. zoom: ≥ 1, shows a part of it that is so many times smaller.

    Attributes:
        bounds: south-western and north-eastern corner of what is shown, (2, 2) m.
    """

    def __init__(self, area: Area, rectangle: Rectangle, zoom: float = 1.0) -> None:
        self.rectangle, self.zoom = rectangle, zoom
        self.per_metre = zoom * rectangle.width / area.width
        self._sides = np.array([area.width, area.length])
        self._scale = zoom * np.array([rectangle.width, -rectangle.height]) / self._sides
        self.look(0.5 * self._sides)

    def look(self, place: np.ndarray) -> None:
        """Show the surroundings of a place (2,), m, as far as they are within the area."""
        shown = self._sides / self.zoom
        corner = np.clip(place - 0.5 * shown, 0.0, self._sides - shown)
        self.bounds = np.stack([corner, corner + shown])
        # Pixel centres are whole numbers, so the left edge of the first pixel is at −½.
        self._origin = np.array([self.rectangle.left - 0.5, self.rectangle.bottom - 0.5]) - corner * self._scale

    def grid(self, pixels: int = 160) -> tuple[np.ndarray, np.ndarray]:
        """Centres x (X,) and y (Y,) of cells that cover the view, at most `pixels` per side, m."""
        low, high = self.bounds
        counts = np.maximum(np.round((high - low) / (high - low).max() * pixels).astype(int), 2)
        x, y = (a + (np.arange(n) + 0.5) * (b - a) / n for a, b, n in zip(low, high, counts, strict=True))
        return x, y

    def pixel(self, position: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of positions (..., 2) in metres."""
        return self._origin + np.asarray(position, float) * self._scale

    def vector(self, metres: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of displacements (..., 2) in metres."""
        return np.asarray(metres, float) * self._scale


def _slopes(field: np.ndarray, scale: float = 0.125) -> tuple[np.ndarray, np.ndarray]:
    """Slopes along the rows and along the columns of a field, with the scale of 1/8 a pixel."""
    along = {"scale": scale, "borderType": cv2.BORDER_REPLICATE}
    return cv2.Sobel(field, cv2.CV_32F, 1, 0, **along), cv2.Sobel(field, cv2.CV_32F, 0, 1, **along)


def smoothed(field: np.ndarray) -> np.ndarray:
    """A surface without waves that are short beside it, which would be a pattern under what is drawn."""
    return cv2.GaussianBlur(field, (0, 0), 0.015 * max(field.shape))


def elevation_limit(surface: np.ndarray) -> float:
    """End of the colour scale (m) for a surface (T, Y, X), about its 99th percentile; 0 for a flat sea."""
    lowest, highest = extremes(surface)
    highest = max(highest, -lowest)
    if highest < 1e-3:
        return 0.0
    usual = float(np.quantile(np.abs(surface[:: max(1, len(surface) // 50)]), 0.99))
    return nice_above(max(usual, 0.1 * highest), (1, 1.5, 2, 3, 4, 5, 7, 10))


class SeaSurface:
    """Elevation as colour, slope as shade.

    Args:
        surface: elevation that the scales are fitted to, (T, Y, X) m, row 0 in the south; empty for a flat sea.
        view: the map. pixels: largest side of the relief as it is shaded, before it is enlarged.
        limit: of the colour scale; None for one that fits.

    Attributes:
        limit: elevation (m) of the colour scale's ends, ±, about the 99th percentile; 0 for a flat sea.
    """

    def __init__(
        self, surface: np.ndarray, view: MapView, pixels: int = RELIEF_PIXELS, limit: float | None = None
    ) -> None:
        self._view, self._pixels, own = view, pixels, elevation_limit(surface)
        self.limit = own if limit is None else limit
        self._flat = own == 0.0
        if self._flat:
            return
        # Slopes are exaggerated until steep ones, the 98th percentile, are drawn at about 30°.
        some = surface[:: max(1, len(surface) // 20)].astype(np.float32)
        slopes = [np.hypot(*_slopes(self._small(field))) for field in some]
        # The lower bound keeps rounding errors of an almost level surface from being exaggerated.
        self._steepen = 0.55 / max(float(np.quantile(slopes, 0.98)), 1e-3 * self.limit)
        self._columns = slopes[0].shape[1]

    def _small(self, field: np.ndarray) -> np.ndarray:
        """A field with the north on top, reduced to the resolution of shading."""
        area = self._view.rectangle
        shrink = min(1.0, self._pixels / max(area.width, area.height))
        shape = max(2, round(area.width * shrink)), max(2, round(area.height * shrink))
        field = np.flipud(field).astype(np.float32)
        if shape[0] >= field.shape[1] or shape[1] >= field.shape[0]:
            return field  # shading an enlarged field would show its grid
        return cv2.resize(field, shape, interpolation=cv2.INTER_AREA)

    def paint(self, picture: np.ndarray, field: np.ndarray) -> None:
        """Draw a surface (Y, X) m of what the map shows, row 0 in the south, over it, `smoothed`."""
        region = self._view.rectangle.of(picture)
        if self._flat:
            region[:] = style.SEA[2]
            return
        small = self.relief(smoothed(field))
        region[:] = cv2.resize(small, (region.shape[1], region.shape[0]), interpolation=cv2.INTER_CUBIC)

    def relief(self, field: np.ndarray) -> np.ndarray:
        """A surface (Y, X) m, row 0 in the south, as a picture with the north on top, at the resolution of shading."""
        field = self._small(field)
        if self._flat:
            return np.full((*field.shape, 3), style.SEA[2], np.uint8)
        steepen = self._steepen * (field.shape[1] * self._view.zoom / self._columns)
        east, south = (slope * steepen for slope in _slopes(field))
        shade = (LIGHT[2] - LIGHT[0] * east + LIGHT[1] * south) / np.sqrt(1.0 + east * east + south * south) / LIGHT[2]
        index = np.clip((field / self.limit + 1.0) * 127.5, 0, 255).astype(np.uint8)
        colours = COLOURS[index] * np.clip(0.3 + 0.7 * shade, 0.4, 1.4)[:, :, None]
        return np.clip(colours, 0, 255).astype(np.uint8)


def colour_scale(width: int, height: int) -> np.ndarray:
    """Picture of the colour scale, lowest elevation at the left, (height, width, 3)."""
    return np.repeat(COLOURS[np.linspace(0, 255, width).astype(int)][None], height, axis=0).astype(np.uint8)


_STOPS = np.linspace(0, 255, len(style.SEA))
_CHANNELS = [np.interp(np.arange(256), _STOPS, channel) for channel in np.array(style.SEA, float).T]
COLOURS = np.stack(_CHANNELS, axis=1).astype(np.float32)


class CurrentStreaks:
    """Particles that drift with the current, with tails as long as the way they drift in the time `tail`.

    A particle passes its seed point, at a time of its own, in the middle of a life of `LIVES` tail times. Its path is
    that in the present field, so where the field changes the picture changes with it: little, since the path is short.

    Attributes:
        fastest: highest speed in the area at the start, m/s. tail: s, infinite without current.
    """

    TAIL_POINTS = 8
    LIVES = 2

    def __init__(
        self,
        vortex: np.ndarray,
        stream: np.ndarray,
        width: float,
        length: float,
        view: MapView,
        unit: float,
        eddies: Eddies = ENDLESS,
        level: int = Level.surface,
    ) -> None:
        """Vortices (V, 4) at the start and how they fill the water, and the real current (rows, columns, 2) m/s at the
        level that is drawn, empty for none.
        """
        across, up = (max(2, round(side / (27 * unit))) for side in view.rectangle[2:])
        jitter = np.random.default_rng(1).uniform(-0.5, 0.5, (up, across, 2))
        grid = np.stack(np.meshgrid(np.arange(across), np.arange(up)), axis=-1)
        self._seeds = ((grid + 0.5 + 0.9 * jitter) / (across, up) * (width, length)).reshape(-1, 2)
        self._view, self._vortex, self._stream = view, vortex, stream
        self._drawn = {"level": level, "size": (width, length), "eddies": eddies}
        moved = self._follow(1.0, 1)
        self.fastest = float(np.hypot(*(moved[:, 1] - moved[:, 0]).T).max())
        self.tail = math.inf
        if self.fastest < 1e-3:
            self.fastest = 0.0
            return
        # The fastest tail is 30 px of the design, in a current below 0.1 m/s proportionally shorter.
        self.tail = 30 * unit / (max(self.fastest, 0.1) * view.per_metre)
        self._step = self.tail / self.TAIL_POINTS
        self._life = (self.LIVES + 1) * self.TAIL_POINTS
        self._start = np.random.default_rng(2).uniform(0, self._life, len(self._seeds))
        self._path = self._paths()

    def _follow(self, step: float, count: int) -> np.ndarray:
        """Paths (P, count + 1, 2) from the seeds, m."""
        device = runtime.start().device
        stream = self._stream if self._stream.size else np.zeros((1, 1, 2))
        vortex, stream, seeds = (
            torch.from_numpy(np.array(array, np.float32)).to(device)
            for array in (self._vortex[None], np.stack([stream] * len(Level.names)), self._seeds)
        )
        return particle_paths(vortex, stream, seeds, step=step, count=count, **self._drawn).cpu().numpy()

    def _paths(self) -> np.ndarray:
        """Paths (P, points, 2) over a whole life, m."""
        half = self.LIVES * self.TAIL_POINTS // 2
        before, after = (self._follow(step, half) for step in (-self._step, self._step))
        return np.concatenate([before[:, :0:-1], after], axis=1).astype(float)

    def update(self, vortex: np.ndarray, stream: np.ndarray) -> None:
        """Set the vortices (V, 4) and the real current (rows, columns, 2)."""
        same = np.array_equal(vortex, self._vortex) and np.array_equal(stream, self._stream)
        if self.fastest > 0 and not same:
            self._vortex, self._stream = vortex, stream
            self._path = self._paths()

    def draw(self, overlay: Overlay, time: float, width: int) -> None:
        """Draw the tails at a time in s."""
        if self.fastest == 0.0:
            return
        age = (self._start + time / self._step) % self._life
        ages = np.clip(age[:, None] - np.arange(self.TAIL_POINTS + 1), 0, self._path.shape[1] - 1.001)
        whole = ages.astype(int)
        part = (ages - whole)[:, :, None]
        each = np.arange(len(age))[:, None]
        tails = self._path[each, whole] * (1 - part) + self._path[each, whole + 1] * part
        tails = self._view.pixel(tails)
        overlay.white_lines(tails, 0.22, width)
        overlay.white_lines(tails[:, : self.TAIL_POINTS // 2 + 1], 0.5, width)


TEXELS = 160  # of the longer side of the area
STEEPER = 1.5  # factor by which slopes are shaded
SUN_AHEAD, SUN_LEFT, SUN_UP = 0.80, 0.36, 0.48  # direction to the sun as the camera looks
SKY = np.array(style.colour("#a9cfe6"), np.float32)
SUN = np.array(style.colour("#fff1d6"), np.float32)
FOAM = np.array(style.colour("#f2fafc"), np.float32)
DEEP = np.array(style.SEA[1], np.float32)
_LIGHTS = np.column_stack([SKY, SUN, FOAM, DEEP])
FOAM_FROM = 0.1  # square of a crest's steepness a k from which there is foam; waves break at a k = 0.44
FAINT = 0.24  # of the light that haze takes at the far border


class SeaShading:
    """A sea as heights and colours on one grid, row 0 in the south.

    Args:
        limit: elevation (m) of the colour scale's ends, ±; 0 for a flat sea.
        sides: of the area in x and y, m. texels: of the longer side.
        camera: from which it is seen; that it moves a little is neglected.
        scale: by which heights are drawn exaggerated.
    """

    def __init__(
        self, limit: float, sides: tuple[float, float], camera: PinholeCamera, scale: float, texels: int
    ) -> None:
        self._limit, self._sides, self._scale = limit, sides, scale
        fit = texels / max(sides)
        self._shape = max(8, round(sides[0] * fit)), max(8, round(sides[1] * fit))
        self._per_metre = self._shape[0] / sides[0]
        x, y = ((np.arange(count, dtype=np.float32) + 0.5) / count - 0.5 for count in self._shape)
        place = np.stack(np.broadcast_arrays(x * sides[0], (y * sides[1])[:, None]), -1)
        eye = np.array([*camera.eye, camera.height])
        view = np.concatenate([eye[:2] - place, np.full((*place.shape[:2], 1), eye[2])], -1)
        self._view = _planes(view)
        sun = SUN_AHEAD * camera.forward - SUN_LEFT * camera.right
        self._sun = np.array([*sun, SUN_UP]) / np.linalg.norm([*sun, SUN_UP])
        self._between = _planes(view / np.linalg.norm(view, axis=-1, keepdims=True) + self._sun)
        away = camera.away(place)
        haze = FAINT * (away - away.min()) / max(float(np.ptp(away)), 1e-9)
        self._clear = (1.0 - haze).astype(np.float32)
        random = np.random.default_rng(3)
        size = self._shape[::-1]
        coarse = (random.standard_normal((size[0] // n + 1, size[1] // n + 1)) for n in (7, 3, 1))
        grains = [cv2.resize(part, self._shape, interpolation=cv2.INTER_CUBIC) for part in coarse]
        self._noise = np.exp(0.35 * sum(grains)).astype(np.float32)  # patches of foam
        self._still = None if self._limit else self._shade(*np.zeros((2, *size), np.float32))

    def of(self, coarse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Heights (Y, X) m as drawn, float32, and colours (Y, X, 3) of a surface, m, row 0 in the south."""
        if self._still is not None:
            return np.zeros(self._shape[::-1], np.float32), self._still
        coarse = coarse.astype(np.float32, copy=False)
        field = cv2.resize(coarse, self._shape, interpolation=cv2.INTER_CUBIC)
        colours = self._shade(smoothed(field), cv2.resize(self._crests(coarse), self._shape))
        return field * np.float32(self._scale), colours

    def _crests(self, field: np.ndarray) -> np.ndarray:
        """(a k)² of the waves at their crests, a the amplitude and k the wavenumber: −η ∇²η; 0 in troughs."""
        bent = cv2.Laplacian(field, cv2.CV_32F, scale=(field.shape[1] / self._sides[0]) ** 2)
        return np.maximum(-bent, 0.0) * np.maximum(field, 0.0)

    def _shade(self, field: np.ndarray, crests: np.ndarray) -> np.ndarray:
        east, north = _slopes(field, 0.125 * self._per_metre * self._scale * STEEPER)
        upright = 1.0 / cv2.sqrt(1.0 + east * east + north * north)
        sun = self._sun.astype(np.float32)
        diffuse = (sun[2] - sun[0] * east - sun[1] * north) * upright
        facing = np.clip(_along(self._view, east, north) * upright, 0.0, 1.0)
        glint = np.clip(_along(self._between, east, north) * upright, 0.0, 1.0)
        mirrored = (1.0 - facing) ** 2
        mirrored = 0.02 + 0.55 * mirrored * mirrored
        for _ in range(6):
            glint = glint * glint
        level = field * np.float32(127.5 / self._limit) + 127.5 if self._limit else field + 127.5
        index = np.clip(level, 0, 255).astype(np.uint8)
        body = (0.34 + 1.05 * np.maximum(diffuse, 0.0)) * (1.0 - mirrored)
        foam = (crests * self._noise - np.float32(FOAM_FROM)) * np.float32(8.0)
        foam = np.float32(0.85) * np.clip(foam, 0.0, 1.0)
        shown = (1.0 - foam) * self._clear
        lights = cv2.merge([mirrored * shown, glint * shown, foam * self._clear, 1.0 - self._clear])
        colour = COLOURS[index] * (body * shown)[:, :, None] + cv2.transform(lights, _LIGHTS)
        return np.clip(colour, 0, 255).astype(np.uint8)


def _planes(vectors: np.ndarray) -> np.ndarray:
    """Components (3, Y, X) of vectors (Y, X, 3) made one long."""
    vectors = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.ascontiguousarray(vectors.transpose(2, 0, 1), np.float32)


def _along(vectors: np.ndarray, east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """Product of vectors with the upward normals (−east, −north, 1) of slopes."""
    return vectors[2] - vectors[0] * east - vectors[1] * north
