"""The linear scheme written plainly in NumPy and f64, and grids and beds that several cases share."""

import numpy as np

from usvauv.kernels.shallow_water.linear import ShallowWater

GRAVITY = 9.81
ROUNDING = 2.0**-24  # half a unit in the last place of an f32 number near one
SIDES = ("west", "east", "south", "north")
ELEVATION_FACTOR = {"forced": 1, "incident": 2, "radiating": 0}  # elevation outside over the prescribed one


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


class PlainScheme:
    """The scheme of a solver for one sea, from rest."""

    def __init__(self, solver: ShallowWater, eta: np.ndarray, prescribed=lambda t: 0.0) -> None:
        self.s, self.prescribed, self.steps = solver, prescribed, 0
        self.dt = dt = solver.time_step
        h = np.asarray(solver.depth, np.float64)
        wet = np.pad(h, 1)
        self.hx = np.where((wet[1:-1, 1:] > 0) & (wet[1:-1, :-1] > 0), (wet[1:-1, 1:] + wet[1:-1, :-1]) / 2, 0)
        self.hy = np.where((wet[1:, 1:-1] > 0) & (wet[:-1, 1:-1] > 0), (wet[1:, 1:-1] + wet[:-1, 1:-1]) / 2, 0)
        at = {"west": np.s_[:, 0], "east": np.s_[:, -1], "south": np.s_[0], "north": np.s_[-1]}
        self.open = [
            (kind, at[side], side in ("west", "east"), -1 if side in ("west", "south") else 1)
            for side, kind in solver.boundaries.kind.items()
            if kind != "wall"
        ]
        for _, at_side, across_x, _ in self.open:
            (self.hx if across_x else self.hy)[at_side] = h[at_side]
        self.h = h
        self.eta = np.where(h > 0, eta, 0.0)
        gx, gy = self.gradient(self.eta)
        self.U, self.V = dt / 2 * GRAVITY * self.hx * gx, dt / 2 * GRAVITY * self.hy * gy
        self.factor = (1 - solver.drag * dt / 2) / (1 + solver.drag * dt / 2)

    def gradient(self, field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Differences on the faces; at an open boundary to the elevation outside, over half a cell."""
        gx, gy = np.zeros_like(self.hx), np.zeros_like(self.hy)
        gx[:, 1:-1], gy[1:-1] = np.diff(field, axis=1) / self.s.dx, np.diff(field, axis=0) / self.s.dy
        for kind, at_side, across_x, outward in self.open:
            outside = ELEVATION_FACTOR[kind] * self.prescribed(self.steps * self.dt)
            across, size = (gx, self.s.dx) if across_x else (gy, self.s.dy)
            across[at_side] = outward * (outside - field[at_side]) / (size / 2)
        return gx, gy

    def advance(self, substeps: int) -> np.ndarray:
        dt = self.dt
        for _ in range(substeps):
            gx, gy = self.gradient(self.eta)
            old = self.U, self.V
            self.U = self.factor * self.U - (1 + self.factor) / 2 * dt * GRAVITY * self.hx * gx
            self.V = self.factor * self.V - (1 + self.factor) / 2 * dt * GRAVITY * self.hy * gy
            for kind, at_side, across_x, _ in self.open:
                if kind != "forced":  # U/c at the face, mean of the old and the new transport
                    W, before, size = (self.U, old[0], self.s.dx) if across_x else (self.V, old[1], self.s.dy)
                    passing = (1 + self.factor) / 2 * dt / size * np.sqrt(GRAVITY * self.h[at_side])
                    W[at_side] = (W[at_side] - passing * before[at_side]) / (1 + passing)
            self.eta = self.eta - dt * (np.diff(self.U, axis=1) / self.s.dx + np.diff(self.V, axis=0) / self.s.dy)
            self.steps += 1
        return self.eta
