"""Velocity of the water in long waves, which is the same at all depths."""

import taichi as ti

from usvauv.kernels.flow import regular_grid
from usvauv.kernels.shallow_water import packing
from usvauv.kernels.types import vec2

SHALLOWEST = 1.0  # m; over less water a transport makes no velocity that a vehicle would meet


@ti.func
def velocity(water: ti.template(), sea: ti.i32, x: ti.f32, y: ti.f32) -> vec2:
    """Velocity (m/s) at (x, y), m: the transports of a sea, bilinear between their faces, over the depth.

    The linear solver's transports are half a substep older than its elevation, and so is this. In the outer half cell
    the nearest polynomial is continued. `water` is a `usvauv.kernels.flow.current.Water` of at least 3 cells each way.
    """
    nx, ny = water.nx, water.ny
    p = ti.math.clamp(x / water.width, 0.0, 1.0) * nx
    q = ti.math.clamp(y / water.length, 0.0, 1.0) * ny
    # Western faces lie at (j, i + ½), southern ones at (j + ½, i).
    j = ti.min(ti.cast(p, ti.i32), nx - 1)
    i = ti.math.clamp(ti.cast(ti.floor(q - 0.5), ti.i32), 0, ny - 2)
    west = packing.mix_rows(water.U, sea, i, j, q - 0.5 - i, nx)
    east = packing.mix_rows(water.U, sea, i, j + 1, q - 0.5 - i, nx)
    transport_x = west + (p - j) * (east - west)
    j = ti.math.clamp(ti.cast(ti.floor(p - 0.5), ti.i32), 0, nx - 2)
    i = ti.min(ti.cast(q, ti.i32), ny - 1)
    south = packing.mix_columns(water.V, sea, i, j, p - 0.5 - j, nx)
    north = packing.mix_columns(water.V, sea, i + 1, j, p - 0.5 - j, nx)
    transport_y = south + (q - i) * (north - south)
    depth = ti.max(regular_grid.sample(water.bed, 0, 0, x, y, water.width, water.length), SHALLOWEST)
    return vec2(water.unit_x * transport_x, water.unit_y * transport_y) / depth
