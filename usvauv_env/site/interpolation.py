"""Interpolation from the points of a file to those of an area: linear in longitude, latitude, depth and time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from usvauv.env.site.cf import Axis
from usvauv.env.site.local_frame import EQUATOR, LocalFrame

BLOCK = 2**21  # values interpolated at a time


def depth_weights(depths: np.ndarray, levels: Sequence[float]) -> np.ndarray:
    """Weight of each depth of a file in each level, (L, D): linear between depths, nearest depth beyond them."""
    return np.stack([np.interp(levels, depths, unit) for unit in np.eye(len(depths))], axis=1)


def cell_means(
    values: np.ndarray,
    axes: dict[str, Axis],
    frame: LocalFrame,
    width: float,
    length: float,
    cells: tuple[int, int],
) -> np.ndarray:
    """Means over cells, (ny, nx), of the bilinear field through `values` (latitude, longitude)."""
    nx, ny = cells
    across, along = (
        # Points unevenly spaced do not need as many everywhere as where they are closest.
        min(max(1, math.ceil(size / step)), 4 * math.ceil(len(axes[kind].values) / count))
        for size, count, step, kind in zip(
            (width / nx, length / ny), cells, spacing(axes), ("longitude", "latitude"), strict=True
        )
    )
    x = (np.arange(nx * across) + 0.5) * (width / (nx * across))
    means = np.empty((ny, nx))
    step = max(1, BLOCK // (len(x) * along))
    for first in range(0, ny, step):
        rows = np.arange(first * along, min(first + step, ny) * along)
        lon, lat = frame.to_geographic(*np.meshgrid(x, (rows + 0.5) * (length / (ny * along))))
        fine = bilinear(values, axes, lon, lat)
        means[first : first + step] = fine.reshape(-1, along, nx, across).mean(axis=(1, 3))
    return means


def spacing(axes: dict[str, Axis]) -> tuple[float, float]:
    """Smallest distance between points of a window in x and y, m."""
    degrees = {kind: np.radians(np.diff(axes[kind].values).min()) for kind in ("longitude", "latitude")}
    parallel = math.cos(math.radians(abs(axes["latitude"].values).max()))
    return EQUATOR * parallel * degrees["longitude"], EQUATOR * degrees["latitude"]


def bilinear(values: np.ndarray, axes: dict[str, Axis], lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    """A field (…, latitude, longitude) at points inside its window."""
    i, right = bracket(axes["longitude"].values, lon)
    j, up = bracket(axes["latitude"].values, lat)
    south = (1 - right) * values[..., j, i] + right * values[..., j, i + 1]
    north = (1 - right) * values[..., j + 1, i] + right * values[..., j + 1, i + 1]
    return (1 - up) * south + up * north


def at_time(times: np.ndarray, values: np.ndarray, t: float) -> np.ndarray:
    """Values (T, …) float32 at rising times (T,) s, linear between them; beyond them those of the nearest time."""
    if len(times) == 1:
        return values[0]
    index, weight = bracket(times, t)
    weight = np.float32(weight)
    return (1 - weight) * values[index] + weight * values[index + 1]


def bracket(values: np.ndarray, targets: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Index of the value at or below each target and the weight, 0 to 1, of the next."""
    index = np.clip(np.searchsorted(values, targets, "right") - 1, 0, len(values) - 2)
    return index, np.clip((targets - values[index]) / (values[index + 1] - values[index]), 0, 1)
