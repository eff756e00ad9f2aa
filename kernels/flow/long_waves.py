"""Velocity of the water in long waves, which is the same at all depths."""

import taichi as ti

from kernels.flow import regular_grid
from kernels.shallow_water import packing
from kernels.types import vec2

SHALLOWEST = 1.0  # m; over less water a transport makes no velocity that a vehicle would meet


@ti.func
def velocity(
    U: ti.template(),
    V: ti.template(),
    unit_x: ti.f32,
    unit_y: ti.f32,
    bed: ti.template(),
    sea: ti.i32,
    x: ti.f32,
    y: ti.f32,
    width: ti.f32,
    length: ti.f32,
    nx: ti.i32,
    ny: ti.i32,
) -> vec2:
    """Velocity (m/s) at a point: the transports, bilinear between their faces, over the depth.

    The linear solver's transports are half a substep older than its elevation, and so is this.

    Half a cell inside a wall or an edge the nearest polynomial is continued.

    Args:
        U, V: packed transports (blocks, rows, W, LANES) at western and southern faces, see
        `kernels.shallow_water.packing`.
        unit_x, unit_y: what makes m²/s of them.
        bed: depth h, m, a field of `kernels.flow.regular_grid`.
        sea: index of the sea.
        x, y: position, m, inside the area.
        width, length: of the area, m.
        nx, ny: number of cells, at least 3 each way.
    """
    p = ti.math.clamp(x / width, 0.0, 1.0) * nx
    q = ti.math.clamp(y / length, 0.0, 1.0) * ny
    # Western faces lie at (j, i + ½), southern ones at (j + ½, i).
    j = ti.min(ti.cast(p, ti.i32), nx - 1)
    i = ti.math.clamp(ti.cast(ti.floor(q - 0.5), ti.i32), 0, ny - 2)
    west = packing.mix_rows(U, sea, i, j, q - 0.5 - i, nx)
    east = packing.mix_rows(U, sea, i, j + 1, q - 0.5 - i, nx)
    transport_x = west + (p - j) * (east - west)
    j = ti.math.clamp(ti.cast(ti.floor(p - 0.5), ti.i32), 0, nx - 2)
    i = ti.min(ti.cast(q, ti.i32), ny - 1)
    south = packing.mix_columns(V, sea, i, j, p - 0.5 - j, nx)
    north = packing.mix_columns(V, sea, i + 1, j, p - 0.5 - j, nx)
    transport_y = south + (q - i) * (north - south)
    depth = ti.max(regular_grid.sample(bed, 0, 0, x, y, width, length), SHALLOWEST)
    return vec2(unit_x * transport_x, unit_y * transport_y) / depth
