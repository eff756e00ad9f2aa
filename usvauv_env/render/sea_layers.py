"""Bottom layers of the map: the sea surface as coloured, shaded relief, and the current as drifting streaks."""

from __future__ import annotations

import math

import cv2
import numpy as np
import torch

from usvauv.env.render import style
from usvauv.env.render.frame_layout import MapView, nice_above
from usvauv.env.render.shapes import Overlay
from usvauv.env.storage.memory import extremes
from usvauv.kernels import runtime
from usvauv.kernels.flow.current import particle_paths

RELIEF_PIXELS = 160  # largest side of the relief as it is shaded, before it is enlarged
LIGHT = np.array([-0.55, 0.55, 0.63], np.float32)  # unit vector to the light: east, north, up


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

    Attributes:
        limit: elevation (m) of the colour scale's ends, ±, about the 99th percentile; 0 for a flat sea.
    """

    def __init__(self, surface: np.ndarray, view: MapView, pixels: int = RELIEF_PIXELS) -> None:
        """
        Args:
            surface: elevation that the scales are fitted to, (T, Y, X) m, row 0 in the south; empty for a flat sea.
            view: the map.
            pixels: largest side of the relief as it is shaded, before it is enlarged.
        """
        self._surface = surface
        self._view = view
        self._pixels = pixels
        self.limit = elevation_limit(surface)
        if self.limit == 0.0:
            return
        # Slopes are exaggerated until steep ones, the 98th percentile, are drawn at about 30°.
        some = surface[:: max(1, len(surface) // 20)].astype(np.float32)
        slopes = [np.hypot(*self._slopes(self._small(field))) for field in some]
        # The lower bound keeps rounding errors of an almost level surface from being exaggerated.
        self._steepen = 0.55 / max(float(np.quantile(slopes, 0.98)), 1e-3 * self.limit)

    def _small(self, field: np.ndarray) -> np.ndarray:
        """A field with the north on top, reduced to the resolution of shading."""
        area = self._view.rectangle
        shrink = min(1.0, self._pixels / max(area.width, area.height))
        shape = max(2, round(area.width * shrink)), max(2, round(area.height * shrink))
        field = np.flipud(field).astype(np.float32)
        if shape[0] >= field.shape[1] or shape[1] >= field.shape[0]:
            return field  # shading an enlarged field would show its grid
        return cv2.resize(field, shape, interpolation=cv2.INTER_AREA)

    @staticmethod
    def _slopes(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slope towards the east and the north, m per pixel."""
        east = cv2.Sobel(field, cv2.CV_32F, 1, 0, scale=0.125, borderType=cv2.BORDER_REPLICATE)
        south = cv2.Sobel(field, cv2.CV_32F, 0, 1, scale=0.125, borderType=cv2.BORDER_REPLICATE)
        return east, -south

    def paint(self, picture: np.ndarray, t: int) -> None:
        """Draw the surface of step t over the map."""
        region = self._view.rectangle.of(picture)
        if self.limit == 0.0:
            region[:] = style.SEA[2]
            return
        small = self.relief(self._surface[t])
        region[:] = cv2.resize(small, (region.shape[1], region.shape[0]), interpolation=cv2.INTER_CUBIC)

    def relief(self, field: np.ndarray) -> np.ndarray:
        """A surface (Y, X) m, row 0 in the south, as a picture with the north on top, at the resolution of shading."""
        field = self._small(field)
        if self.limit == 0.0:
            return np.full((*field.shape, 3), style.SEA[2], np.uint8)
        east, north = self._slopes(field)
        east, north = east * self._steepen, north * self._steepen
        normal_light = LIGHT[2] - LIGHT[0] * east - LIGHT[1] * north
        shade = normal_light / np.sqrt(1.0 + east * east + north * north) / LIGHT[2]
        index = np.clip((field / self.limit + 1.0) * 127.5, 0, 255).astype(np.uint8)
        colours = COLOURS[index] * np.clip(0.3 + 0.7 * shade, 0.4, 1.4)[:, :, None]
        return np.clip(colours, 0, 255).astype(np.uint8)


def colour_scale(width: int, height: int) -> np.ndarray:
    """Picture of the colour scale, lowest elevation at the left, (height, width, 3)."""
    return np.repeat(COLOURS[np.linspace(0, 255, width).astype(int)][None], height, axis=0).astype(np.uint8)


def _colour_table() -> np.ndarray:
    stops = np.linspace(0, 255, len(style.SEA))
    channels = np.array(style.SEA, float).T
    return np.stack([np.interp(np.arange(256), stops, channel) for channel in channels], axis=1).astype(np.float32)


COLOURS = _colour_table()


class CurrentStreaks:
    """Particles that drift with the current, with tails as long as the way they drift in the time `tail`.

    A particle starts at its seed point, at a time of its own, and lives for `LIVES` tail times. Its path is that in the
    present field, so where the field changes the picture changes with it, without jumps.

    Attributes:
        fastest: highest speed in the area at the start, m/s. tail: s, infinite without current.
    """

    TAIL_POINTS = 8
    LIVES = 5

    def __init__(
        self, vortex: np.ndarray, stream: np.ndarray, width: float, length: float, view: MapView, unit: float
    ) -> None:
        """Vortices (V, 4) at the start, and the real current (rows, columns, 2) m/s, empty for none."""
        rectangle = view.rectangle
        across = max(2, round(rectangle.width / (27 * unit)))
        up = max(2, round(rectangle.height / (27 * unit)))
        jitter = np.random.default_rng(1).uniform(-0.5, 0.5, (up, across, 2))
        grid = np.stack(np.meshgrid(np.arange(across), np.arange(up)), axis=-1)
        self._seeds = ((grid + 0.5 + 0.9 * jitter) / (across, up) * (width, length)).reshape(-1, 2)
        self._stream = stream
        self._size, self._view = (width, length), view
        self._vortex = vortex
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
            for array in (self._vortex[None], stream[None], self._seeds)
        )
        return particle_paths(vortex, stream, seeds, level=0, size=self._size, step=step, count=count).cpu().numpy()

    def _paths(self) -> np.ndarray:
        """Pixels (P, points, 2) of the paths over a whole life."""
        return self._view.pixel(self._follow(self._step, self.LIVES * self.TAIL_POINTS).astype(float))

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
        overlay.white_lines(tails, 0.22, width)
        overlay.white_lines(tails[:, : self.TAIL_POINTS // 2 + 1], 0.5, width)
