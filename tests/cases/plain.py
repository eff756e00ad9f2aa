"""Grids, waves and beds that several cases share."""

import numpy as np

GRAVITY = 9.81
ROUNDING = 2.0**-24  # half a unit in the last place of an f32 number near one
SIDES = ("west", "east", "south", "north")


def centres(cells: int, length: float) -> np.ndarray:
    return (np.arange(cells) + 0.5) * (length / cells)


def faces(cells: int, length: float) -> np.ndarray:
    return np.arange(cells + 1) * (length / cells)


def many(field: np.ndarray, num_seas: int) -> np.ndarray:
    """The same field for each sea, times 1, 2, 3, … so that seas cannot be confused."""
    return field * np.arange(1, num_seas + 1)[:, None, None]


def from_wall(coordinate: np.ndarray, side: str, length: float) -> np.ndarray:
    """Distance from the wall opposite an open boundary."""
    return length - coordinate if side in ("west", "south") else coordinate


def waves(amplitude: float, period: float, phase: float = 0.0, num_seas: int = 1) -> tuple[np.ndarray, ...]:
    """Arguments of `set_forcing` for one component, its amplitude times 1, 2, 3, … in each sea."""
    each = np.arange(1.0, num_seas + 1)[:, None]
    return amplitude * each, np.full_like(each, period), np.full_like(each, phase)


def rough_bed(nx: int, ny: int) -> np.ndarray:
    """Depths from 20 to 120 m with an island and a dry corner."""
    depth = np.random.default_rng(5).uniform(20, 120, (ny, nx))
    depth[ny // 3 : ny // 2, nx // 4 : nx // 3] = 0
    depth[-3:, -2:] = 0
    return depth
