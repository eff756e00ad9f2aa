"""Arakawa C grid of linear shallow water: its boundaries, layout of its fields in memory, depths,
slopes, coefficients of a time step.

A packed field has the shape (blocks, rows, W, LANES): vectors of LANES numbers that one machine instruction processes
together. The lanes are filled in one of two ways, by the same source.

- *pool*, several seas: lane l of block b is sea 16 b + l, and W = nx + o.
- *strips*, one sea: lane l holds columns l W to l W + W − 1, so W = ⌈(nx + o)/16⌉; W ≤ nx holds for strips alone.

Rows 0 to ny − 1 and columns 0 to nx − 1 are water. U[j] and V[i] are the faces west of column j and south of row i, so
column nx and row ny hold the eastern and northern boundary, and columns are cyclic, so that the last one (of the last
lane, in strips) lies west of column 0. These outer cells hold the elevation outside an open boundary; all their other
faces are closed. There are o = 2 outer columns where west and east are both open, else one. Rows above ny belong to the
time loop: the row south of row 0, and copies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import taichi as ti
import torch

from usvauv.kernels.functions import LANES
from usvauv.kernels.limits import Side

vector = ti.types.vector(LANES, ti.f32)
vectors = ti.types.ndarray(dtype=vector, ndim=1)
CHUNK = 1 << 15  # cells that the host works on at a time: its f64 copies stay small against the fields

Boundary = Literal["wall", "forced", "incident", "radiating"]

SIDES: tuple[Side, ...] = ("west", "east", "south", "north")
WEST, EAST, SOUTH, NORTH = range(4)

# Elevation outside each kind of boundary as a multiple of the prescribed one. A wave that enters past the resistance
# U/c halves: the elevation at the face is E − U/c, and of a wave that runs inwards η = U/c.
ELEVATION_FACTOR = {"wall": 0.0, "forced": 1.0, "incident": 2.0, "radiating": 0.0}
RADIATING = ("incident", "radiating")  # kinds that let waves out


class SideGeometry(NamedTuple):
    """Where a side lies."""

    axis: int  # 0 if it cuts the axis of U, 1 for V
    outward: int  # sign of the transport that leaves
    faces: tuple  # its faces in an array (…, rows, nx + 1)
    cells: tuple  # the cells along it in an array (…, rows + 1, nx) that begins one row further south


GEOMETRY: dict[Side, SideGeometry] = {
    "west": SideGeometry(0, -1, np.s_[..., :, 0], np.s_[..., 1:, 0]),
    "east": SideGeometry(0, 1, np.s_[..., :, -1], np.s_[..., 1:, -1]),
    "south": SideGeometry(1, -1, np.s_[..., 0, :-1], np.s_[..., 1, :]),
    "north": SideGeometry(1, 1, np.s_[..., -1, :-1], np.s_[..., -2, :]),
}


def complete_kinds(kinds: Mapping[Side, str] | None, known: tuple[str, ...]) -> dict[Side, str]:
    """Kind of each of the four sides; those that `kinds` leaves out are walls.

    Raises:
        ValueError: unknown side, or a kind that is not in `known`.
    """
    kinds = dict(kinds or {})
    for side, kind in kinds.items():
        if side not in SIDES or kind not in known:
            raise ValueError(f"boundaries: {side!r}: {kind!r} is not one of {SIDES} with one of {known}")
    return {side: kinds.get(side, "wall") for side in SIDES}


class BasinBoundaries:
    """Kinds of the four boundaries of a basin.

    Args:
        kinds: kind by side; sides that are missing are walls.

    Attributes:
        kind: of each side.
        forced: whether an elevation is prescribed somewhere.
        radiating: whether waves leave somewhere.

    Raises:
        ValueError: unknown side or kind.
    """

    def __init__(self, kinds: Mapping[Side, Boundary] | None) -> None:
        self.kind = complete_kinds(kinds, tuple(ELEVATION_FACTOR))
        self.forced = any(ELEVATION_FACTOR[kind] > 0 for kind in self.kind.values())
        self.radiating = any(kind in RADIATING for kind in self.kind.values())

    def open(self, side: Side) -> bool:
        """Whether water passes this side."""
        return self.kind[side] != "wall"

    @property
    def outer_columns(self) -> int:
        """Columns of outer cells that a packed field needs: the western and the eastern boundary can share one."""
        return 1 + (self.open("west") and self.open("east"))

    def elevation_factors(self) -> list[float]:
        """Factor on the prescribed elevation for each side; −1 for a wall."""
        return [ELEVATION_FACTOR[self.kind[side]] if self.open(side) else -1.0 for side in SIDES]


@dataclass(frozen=True)
class Packing:
    """Packing of the fields (num_seas, ny + 1, nx + 1) of a number of seas; `outer` is the number o above."""

    num_seas: int
    nx: int
    ny: int
    outer: int = 1

    @property
    def strips(self) -> bool:
        """Whether lanes are strips of one sea, and not seas of a pool."""
        return self.num_seas == 1 and self.nx >= LANES

    @property
    def blocks(self) -> int:
        """Groups of LANES seas."""
        return math.ceil(self.num_seas / LANES)

    @property
    def columns(self) -> int:
        """Number W of vectors in a row."""
        columns = self.nx + self.outer
        return math.ceil(columns / LANES) if self.strips else columns

    def pack(self, field: np.ndarray, packed: torch.Tensor, first: int) -> None:
        """Write rows of a field (num_seas, rows, nx + 1) to the rows from `first` on."""
        rows, columns = field.shape[1:]
        values = torch.as_tensor(field, dtype=torch.float32, device="cpu")
        if self.strips:
            values = torch.nn.functional.pad(values, (0, self.columns * LANES - columns))
            packed[0, first : first + rows] = values.view(rows, LANES, self.columns).transpose(1, 2)
        else:
            values = torch.nn.functional.pad(values, (0, 0, 0, 0, 0, self.blocks * LANES - self.num_seas))
            lanes = values.view(self.blocks, LANES, rows, columns).permute(0, 2, 3, 1)
            packed[:, first : first + rows, :columns] = lanes

    def unpack(self, packed: torch.Tensor, first: int, last: int) -> np.ndarray:
        """Rows `first` to `last` − 1 of the field as (num_seas, rows, nx + 1)."""
        packed = packed[:, first:last].cpu()
        if self.strips:
            return packed.transpose(2, 3).reshape(1, last - first, -1)[:, :, : self.nx + 1].numpy()
        return packed[:, :, : self.nx + 1].permute(0, 3, 1, 2).flatten(0, 1)[: self.num_seas].numpy()

    def spread(self, field: np.ndarray) -> np.ndarray:
        """A field (rows, up to nx + 1) that all seas have in common as (rows, W, LANES), f32."""
        rows, columns = field.shape
        wide = np.zeros((rows, self.columns * (LANES if self.strips else 1)), np.float32)
        wide[:, :columns] = field
        if self.strips:
            return wide.reshape(rows, LANES, self.columns).swapaxes(1, 2)
        return np.repeat(wide[:, :, None], LANES, axis=2)


class Discretisation:
    """The scheme of `usvauv.kernels.shallow_water.linear.ShallowWater` over one bed, in NumPy and f64 by chunks of
    rows.

    Args:
        packing: of the fields.
        depth: still-water depth h at cell centres, (ny, nx), m; not copied.
        spacing: (Δx, Δy), m.
        gravity: g, m/s².
        drag: rate r, 1/s.
        time_step: Δt, s.
        boundaries: of the basin.

    Attributes:
        drag_factor: a = (1 − r Δt/2)/(1 + r Δt/2), what drag leaves of a transport in a substep.
    """

    def __init__(
        self,
        packing: Packing,
        depth: np.ndarray,
        spacing: tuple[float, float],
        gravity: float,
        drag: float,
        time_step: float,
        boundaries: BasinBoundaries,
    ) -> None:
        self.packing, self.depth, self.spacing, self.gravity = packing, depth, spacing, gravity
        self.time_step, self.boundaries = time_step, boundaries
        self.drag_factor = (1 - drag * time_step / 2) / (1 + drag * time_step / 2)

    def chunks(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """Ranges of rows of about `CHUNK` cells of all seas."""
        step = max(1, CHUNK // (self.packing.num_seas * (self.packing.nx + 1)))
        return ((row, min(row + step, last)) for row in range(first, last, step))

    def cell_rows(self, first: int, last: int, read: Callable[[int, int], np.ndarray]) -> np.ndarray:
        """Rows `first` − 1 to `last` − 1 of a field of cells that `read` gives, f64; zero beyond the basin."""
        low, high = max(first - 1, 0), min(last, self.packing.ny)
        rows = np.asarray(read(low, high), np.float64)
        return np.pad(rows, ((0, 0), (low - first + 1, last - high), (0, 0)))

    def open_sides(self, axis: int, first: int, last: int) -> list[Side]:
        """Sides across an axis that are open and have faces in rows `first` to `last` − 1 of 0 to ny."""
        present = {"west": True, "east": True, "south": first == 0, "north": last == self.packing.ny + 1}
        return [
            side for side in GEOMETRY if GEOMETRY[side].axis == axis and present[side] and self.boundaries.open(side)
        ]

    def faces(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Depth h, m, and damping s of western and southern faces of rows `first` to `last` − 1, (2, rows, nx + 1).

        h = 0 is a wall. s is half the rate of damping times Δt: (1 + s) U⁺ = (1 − s) U⁻ − g h Δt η_x.
        """
        cells = self.cell_rows(first, last, lambda low, high: self.depth[None, low:high])[0]
        h = np.zeros((2, last - first, self.packing.nx + 1))
        h[0, :, 1:-1] = _mean_if_wet(cells[1:, :-1], cells[1:, 1:])
        h[1, :, :-1] = _mean_if_wet(cells[:-1], cells[1:])
        damping = np.full_like(h, (1 - self.drag_factor) / (1 + self.drag_factor))
        for axis, size in enumerate(self.spacing):
            for side in self.open_sides(axis, first, last):
                along = cells[GEOMETRY[side].cells]
                h[axis][GEOMETRY[side].faces] = along
                if self.boundaries.kind[side] in RADIATING:
                    damping[axis][GEOMETRY[side].faces] += np.sqrt(self.gravity * along) * self.time_step / size
        return h, damping

    def slopes(self, eta: np.ndarray, first: int, last: int, prescribed: np.ndarray) -> np.ndarray:
        """η_x and η_y on the faces of rows `first` to `last` − 1, (2, num_seas, rows, nx + 1), of an elevation with the
        row south of them; at an open boundary over the half cell to the prescribed elevation (num_seas, 1).
        """
        slopes = np.zeros((2, self.packing.num_seas, last - first, self.packing.nx + 1))
        slopes[0, :, :, 1:-1] = np.diff(eta[:, 1:], axis=2) / self.spacing[0]
        slopes[1, :, :, :-1] = np.diff(eta, axis=1) / self.spacing[1]
        for axis, size in enumerate(self.spacing):
            for side in self.open_sides(axis, first, last):
                _, outward, faces, cells = GEOMETRY[side]
                outside = ELEVATION_FACTOR[self.boundaries.kind[side]] * prescribed
                slopes[axis][faces] = outward * (outside - eta[cells]) / (size / 2)
        return slopes

    def coefficients(self, device: torch.device) -> tuple[torch.Tensor, np.ndarray]:
        """C of `wavefront.march` with equal neighbouring rows once, and which of its rows each row 0 to ny takes."""
        depth, ny = self.depth, self.packing.ny
        changes = [] if depth.strides[0] == 0 else [i for i in range(1, ny) if (depth[i] != depth[i - 1]).any()]
        rows = np.unique(np.array([0, 1, *changes, *(i + 1 for i in changes), ny], int))
        C = torch.empty((2, len(rows), self.packing.columns, LANES), dtype=torch.float32, device=device)
        done = 0
        for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            for first, last in self.chunks(run[0], run[-1] + 1):
                h, damping = self.faces(first, last)
                for axis, size in enumerate(self.spacing):
                    for side in self.open_sides(axis, first, last):  # the difference is over half a cell
                        h[axis][GEOMETRY[side].faces] *= 2
                    part = self.gravity * (self.time_step / size) ** 2 * h[axis] / (1 + damping[axis])
                    C[axis, done : done + last - first] = torch.from_numpy(self.packing.spread(part))
                done += last - first
        return C, (np.searchsorted(rows, np.arange(ny + 1), side="right") - 1).astype(np.int32)

    def resistances(self) -> torch.Tensor:
        """R of `wavefront.march` along south, north, west and east; one vector if nothing radiates.

        With λ = c Δt/Δx and s of the face without its radiation, (1 + s + λ) U⁺ = (1 − s − λ) U⁻ − 2 λ² (η − E) is
        U⁺ = a U⁻ − C (η − (E − R U⁻)), a = (1 − s)/(1 + s), C = 2 λ²/(1 + s + λ), R = 1/(λ (1 + s)).
        """
        if not self.boundaries.radiating:
            return torch.zeros((1, LANES), dtype=torch.float32, device="cpu")
        resistances = []
        cells: dict[Side, Any] = {"south": np.s_[0], "north": np.s_[-1], "west": np.s_[:, 0], "east": np.s_[:, -1]}
        for side, along in cells.items():
            depth = self.depth[along].astype(np.float64)
            wave = np.sqrt(self.gravity * depth) * self.time_step / self.spacing[GEOMETRY[side].axis]
            passes = (depth > 0) & (self.boundaries.kind[side] in RADIATING)
            resistances.append(np.where(passes, (1 + self.drag_factor) / 2 / np.where(passes, wave, 1.0), 0.0))
        south, north, *ends = resistances
        height = self.packing.ny + 1
        columns = [np.repeat(np.pad(R, (0, height - len(R)))[:, None], LANES, axis=1) for R in ends]
        vectors = np.concatenate([*(self.packing.spread(R[None])[0] for R in (south, north)), *columns])
        return torch.tensor(vectors, dtype=torch.float32, device="cpu")  # a copy, which is aligned to vectors


def _mean_if_wet(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.where((a > 0) & (b > 0), (a + b) / 2, 0.0)
