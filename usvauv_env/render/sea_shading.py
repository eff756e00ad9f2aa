"""Light on the sea: its colour by elevation and slope, reflected sky, glint of the sun, foam on steep crests."""

from __future__ import annotations

import cv2
import numpy as np

from usvauv.env.render import style
from usvauv.env.render.camera import Camera
from usvauv.env.render.sea_layers import COLOURS

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
    """The sea of a trace as heights and colours on one grid, row 0 in the south."""

    def __init__(
        self, surface: np.ndarray, limit: float, sides: tuple[float, float], camera: Camera, scale: float
    ) -> None:
        """
        Args:
            surface: (T, Y, X) m, row 0 in the south; empty for a flat sea.
            limit: elevation (m) of the colour scale's ends, ±; 0 for a flat sea.
            sides: of the area in x and y, m.
            camera: from which it is seen; that it moves a little is neglected.
            scale: by which heights are drawn exaggerated.
        """
        self._surface, self._limit, self._sides, self._scale = surface, limit, sides, scale
        fit = TEXELS / max(sides)
        self._shape = max(8, round(sides[0] * fit)), max(8, round(sides[1] * fit))
        self._per_metre = self._shape[0] / sides[0]
        x = (np.arange(self._shape[0], dtype=np.float32) + 0.5) / self._shape[0] - 0.5
        y = (np.arange(self._shape[1], dtype=np.float32) + 0.5) / self._shape[1] - 0.5
        place = np.stack(np.broadcast_arrays(x * sides[0], (y * sides[1])[:, None]), -1)
        eye = np.array([*(-camera.distance * camera.forward), camera.height])
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
        small = ((size[0] // n + 1, size[1] // n + 1) for n in (7, 3, 1))
        grains = [
            cv2.resize(random.standard_normal(part), self._shape, interpolation=cv2.INTER_CUBIC) for part in small
        ]
        self._noise = np.exp(0.35 * sum(grains)).astype(np.float32)  # patches of foam
        self._still = None if self._limit else self._shade(*np.zeros((2, *size), np.float32))

    def at(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """Heights (Y, X) m as drawn, float32, and colours (Y, X, 3) of step t."""
        if self._still is not None:
            return np.zeros(self._shape[::-1], np.float32), self._still
        coarse = self._surface[t].astype(np.float32, copy=False)
        field = cv2.resize(coarse, self._shape, interpolation=cv2.INTER_CUBIC)
        return field * np.float32(self._scale), self._shade(field, cv2.resize(self._crests(coarse), self._shape))

    def _crests(self, field: np.ndarray) -> np.ndarray:
        """(a k)² of the waves at their crests, a the amplitude and k the wavenumber: −η ∇²η; 0 in troughs."""
        bent = cv2.Laplacian(field, cv2.CV_32F, scale=(field.shape[1] / self._sides[0]) ** 2)
        return np.maximum(-bent, 0.0) * np.maximum(field, 0.0)

    def _shade(self, field: np.ndarray, crests: np.ndarray) -> np.ndarray:
        per_metre = 0.125 * self._per_metre * self._scale * STEEPER
        east = cv2.Sobel(field, cv2.CV_32F, 1, 0, scale=per_metre, borderType=cv2.BORDER_REPLICATE)
        north = cv2.Sobel(field, cv2.CV_32F, 0, 1, scale=per_metre, borderType=cv2.BORDER_REPLICATE)
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
