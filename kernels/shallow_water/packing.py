"""Packed Arakawa C grids: layout of fields in memory, conversion from and to plain arrays, and sampling between cells.

A packed field has the shape (blocks, rows, W, LANES): vectors of LANES numbers that one machine instruction processes
together. The lanes are filled in one of two ways, by the same source.

- *pool*, several seas: lane l of block b is sea 16 b + l, and W = nx + o.
- *strips*, one sea: lane l holds columns l W to l W + W − 1, so W = ⌈(nx + o)/16⌉; W ≤ nx tells strips from pool.

Rows 0 to ny − 1 and columns 0 to nx − 1 are water. U[j] and V[i] are the faces west of column j and south of row i, so
column nx and row ny hold the eastern and northern boundary, and columns are cyclic, so that the last one (of the last
lane, in strips) lies west of column 0. These outer cells hold the elevation outside an open boundary; all their other
faces are closed. There are o = 2 outer columns where west and east are both open, else one. Rows above ny belong to the
time loop: the row south of row 0, and copies.
"""

import math
from dataclasses import dataclass

import numpy as np
import taichi as ti
import torch

from usvauv.kernels.types import vec3

LANES = 16
vector = ti.types.vector(LANES, ti.f32)
vectors = ti.types.ndarray(dtype=vector, ndim=1)


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
        values = torch.as_tensor(field, dtype=torch.float32)
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


@ti.func
def sample(
    eta: ti.template(), sea: ti.i32, x: ti.f32, y: ti.f32, dx: ti.f32, dy: ti.f32, nx: ti.i32, ny: ti.i32
) -> vec3:
    """Elevation and its slopes (η, η_x, η_y) of a sea at a point, m and 1.

    η is bilinear between the four cell centres around the point. η_x is the difference over each western face,
    bilinear between those faces, likewise η_y: continuous everywhere and second order, as is η. In the outer half
    cell (for a slope: the outer cell) the nearest polynomial is continued, so a plane is exact up to the boundary.

    Args:
        eta: packed elevation (blocks, rows, W, LANES) as an ndarray argument of f32 with ndim=4.
        sea: index of the sea.
        x, y: position, m; clamped into the area.
        dx, dy: cell size, m.
        nx, ny: number of cells, at least 3 each way.
    """
    p = ti.math.clamp(x / dx, 0.0, ti.cast(nx, ti.f32))
    q = ti.math.clamp(y / dy, 0.0, ti.cast(ny, ti.f32))
    # Cell centres lie at j + ½, western faces at j; the stencil starts at the centre or the face below the point.
    j = ti.math.clamp(ti.cast(ti.floor(p - 0.5), ti.i32), 0, nx - 2)
    i = ti.math.clamp(ti.cast(ti.floor(q - 0.5), ti.i32), 0, ny - 2)
    jf = ti.math.clamp(ti.cast(ti.floor(p), ti.i32), 1, nx - 2)
    i_f = ti.math.clamp(ti.cast(ti.floor(q), ti.i32), 1, ny - 2)
    wx = p - 0.5 - ti.cast(j, ti.f32)
    wy = q - 0.5 - ti.cast(i, ti.f32)
    vx = p - ti.cast(jf, ti.f32)
    vy = q - ti.cast(i_f, ti.f32)
    west = mix_rows(eta, sea, i, j, wy, nx)
    east = mix_rows(eta, sea, i, j + 1, wy, nx)
    face_west = mix_rows(eta, sea, i, jf, wy, nx) - mix_rows(eta, sea, i, jf - 1, wy, nx)
    face_east = mix_rows(eta, sea, i, jf + 1, wy, nx) - mix_rows(eta, sea, i, jf, wy, nx)
    face_south = mix_columns(eta, sea, i_f, j, wx, nx) - mix_columns(eta, sea, i_f - 1, j, wx, nx)
    face_north = mix_columns(eta, sea, i_f + 1, j, wx, nx) - mix_columns(eta, sea, i_f, j, wx, nx)
    return vec3(
        west + wx * (east - west),
        (face_west + vx * (face_east - face_west)) / dx,
        (face_south + vy * (face_north - face_south)) / dy,
    )


@ti.func
def cell(eta: ti.template(), sea: ti.i32, i: ti.i32, j: ti.i32, nx: ti.i32) -> ti.f32:
    """Elevation of the cell in row i and column j."""
    W = eta.shape[2]
    block = sea // LANES
    lane = sea % LANES
    column = j
    if W <= nx:
        block = 0
        lane = j // W
        column = j % W
    return eta[block, i, column, lane]


@ti.func
def mix_rows(eta: ti.template(), sea: ti.i32, i: ti.i32, j: ti.i32, w: ti.f32, nx: ti.i32) -> ti.f32:
    """Between rows i and i + 1 of column j."""
    south = cell(eta, sea, i, j, nx)
    return south + w * (cell(eta, sea, i + 1, j, nx) - south)


@ti.func
def mix_columns(eta: ti.template(), sea: ti.i32, i: ti.i32, j: ti.i32, w: ti.f32, nx: ti.i32) -> ti.f32:
    """Between columns j and j + 1 of row i."""
    west = cell(eta, sea, i, j, nx)
    return west + w * (cell(eta, sea, i, j + 1, nx) - west)
