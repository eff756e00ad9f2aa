"""The sea surface at any moment, on a grid of points: long waves between two steps, and the storm upon them."""

from __future__ import annotations

import numpy as np
import torch

from usvauv.env.sea.storm import AirySea
from usvauv.env.world.world import World

POINTS = 104  # at most, on the longer side


class SurfaceGrid:
    """Points at which the surface of world 0 is drawn; the outermost lie on the border of the area.

    Attributes:
        x, y: (X,) and (Y,), m.
    """

    def __init__(self, world: World) -> None:
        self._inner = world.long_waves(POINTS)[1:]
        area = world.scenario.area
        self.x, self.y = (
            np.concatenate([[0.0], inner[1:-1], [size]])
            for inner, size in zip(self._inner, (area.width, area.length), strict=True)
        )
        self._storm: AirySea | None = None

    def long_waves(self, world: World) -> np.ndarray:
        """Elevation of the long waves as they are now, (Y, X), m."""
        return world.long_waves(POINTS)[0]

    def storm(self, storm: AirySea, time: float) -> np.ndarray:
        """Elevation of the storm of world 0 at a time (s), (Y, X) float32, m.

        As `AirySea.elevation`, in real numbers and by torch: libraries for matrices that wait for a second core would
        take longer than a picture lasts.
        """
        if storm is not self._storm:
            k, direction = storm.k[0], storm.direction[0]
            east, self._north = np.outer(k * np.cos(direction), self.x), np.outer(self.y, k * np.sin(direction))
            self._east = _tensor(np.concatenate([np.cos(east), -np.sin(east)]))
            self._storm = storm
        angle = self._north + (storm.phase[0] - storm.omega[0] * time)
        a = storm.amplitude[0]
        return (_tensor(np.concatenate([a * np.cos(angle), a * np.sin(angle)], axis=1)) @ self._east).numpy()

    def height(self, surface: np.ndarray, place: np.ndarray) -> tuple[float, np.ndarray]:
        """Elevation (m) and slope (2,) of a surface (Y, X) at a place (2,), m, linear between the points."""
        (i, s), (j, t) = (_cell(axis, at) for axis, at in zip((self.x, self.y), place, strict=True))
        corners = surface[j : j + 2, i : i + 2]
        dx, dy = self.x[i + 1] - self.x[i], self.y[j + 1] - self.y[j]
        along_x, along_y = np.array([1 - t, t]) @ corners, corners @ np.array([1 - s, s])
        slope = np.array([(along_x[1] - along_x[0]) / dx, (along_y[1] - along_y[0]) / dy])
        return float(along_x @ np.array([1 - s, s])), slope


def _tensor(numbers: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(numbers.astype(np.float32))


def _cell(axis: np.ndarray, at: float) -> tuple[int, float]:
    """Index of the interval of an axis that holds a number, and the share of the way through it."""
    index = int(np.clip(np.searchsorted(axis, at) - 1, 0, len(axis) - 2))
    return index, float(np.clip((at - axis[index]) / (axis[index + 1] - axis[index]), 0.0, 1.0))
