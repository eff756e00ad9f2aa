"""Velocity of the water without the storm: vortices, real currents on a regular grid, and long waves."""

from typing import Any, NamedTuple

import taichi as ti
import torch

from usvauv.kernels.flow import long_waves, regular_grid, vortex
from usvauv.kernels.types import Level, array1, array3, array4, index1, mask1, vec2


class Water(NamedTuple):
    """The water of all worlds; a function reads only the part it needs.

    Attributes:
        vortex: (W, V, 4) vortices: x0, y0, Γ, δ.
        stream: (levels, rows, columns, 2) real current at each `Level`, m/s, `regular_grid`; of one row there is none.
        width, length: of the area, m.
        bed: (1, rows, columns, 1) depth h, m, `regular_grid`.
        eta: packed elevation of the long waves, m, `usvauv.kernels.shallow_water.packing`.
        U, V: packed transports of the long waves.
        unit_x, unit_y: what makes m²/s of `U` and `V`.
        nx, ny: number of cells.
        sea_index: (W,) int32, which sea of the pool a world sails on.
        wave: (seas, groups, columns, LANES) the storm's components, `airy`; velocities at each `Level`.
    """

    vortex: Any
    stream: Any
    width: Any
    length: Any
    bed: Any = None
    eta: Any = None
    U: Any = None
    V: Any = None
    unit_x: Any = None
    unit_y: Any = None
    nx: Any = None
    ny: Any = None
    sea_index: Any = None
    wave: Any = None


@ti.func
def without_waves(water: ti.template(), level: ti.i32, w: ti.i32, x: ti.f32, y: ti.f32) -> vec2:
    """Velocity (m/s) of vortices and real currents at (x, y) in world w."""
    V = vortex.current(water.vortex, w, x, y)
    if water.stream.shape[1] > 1:
        for axis in ti.static(range(2)):
            V[axis] += regular_grid.sample(water.stream, level, axis, x, y, water.width, water.length)
    return V


@ti.func
def velocity(water: ti.template(), level: ti.i32, w: ti.i32, x: ti.f32, y: ti.f32) -> vec2:
    """Velocity (m/s) at (x, y) in world w."""
    waves = long_waves.velocity(water, water.sea_index[w], x, y)
    return without_waves(water, level, w, x, y) + waves


@ti.kernel
def on_grid(
    size: array1,
    vortices: array3,
    stream: array4,
    bed: array4,
    U: array4,
    V: array4,
    unit_x: ti.f32,
    unit_y: ti.f32,
    nx: ti.i32,
    ny: ti.i32,
    sea_index: index1,
    mask: mask1,
    margin: ti.f32,
    flow: array4,
):
    """Velocity (m/s) at cruise level on a grid over the area without a margin (m), in worlds where `mask` is not 0.

    `size` is the area's width and length, m. `flow` is (W, rows, columns, 2), row 0 in the south.
    """
    for w, i in ti.ndrange(flow.shape[0], flow.shape[1]):
        water = ti.static(Water(vortices, stream, size[0], size[1], bed, None, U, V, unit_x, unit_y, nx, ny, sea_index))
        y = margin + (size[1] - 2.0 * margin) * i / (flow.shape[1] - 1)
        for j in range(flow.shape[2]):
            here = vec2(flow[w, i, j, 0], flow[w, i, j, 1])
            if mask[w] != 0:
                x = margin + (size[0] - 2.0 * margin) * j / (flow.shape[2] - 1)
                here = velocity(water, Level.cruise, w, x, y)
            flow[w, i, j, 0] = here[0]
            flow[w, i, j, 1] = here[1]


@ti.kernel
def _trace_paths(
    vortices: array3, stream: array4, level: ti.i32, width: ti.f32, length: ti.f32, step: ti.f32, path: array3
):
    for n in range(path.shape[0]):
        water = ti.static(Water(vortices, stream, width, length))
        for t in range(1, path.shape[1]):
            at = vec2(path[n, t - 1, 0], path[n, t - 1, 1])
            middle = at + 0.5 * step * without_waves(water, level, 0, at[0], at[1])
            V = without_waves(water, level, 0, middle[0], middle[1])
            path[n, t, 0] = at[0] + step * V[0]
            path[n, t, 1] = at[1] + step * V[1]


def particle_paths(
    vortices: torch.Tensor,
    stream: torch.Tensor,
    points: torch.Tensor,
    *,
    level: int,
    size: tuple[float, float],
    step: float,
    count: int,
) -> torch.Tensor:
    """Paths of particles in the field of world 0 as it stands, by the midpoint rule.

    Args:
        vortices: (1, V, 4) float32.
        stream: (levels, rows, columns, 2) float32, m/s.
        points: (N, 2) float32, where they start, m.
        level: of `Level`.
        size: (width, length) of the area, m.
        step: s. count: steps.

    Returns:
        (N, count + 1, 2) float32, m.
    """
    path = points[:, None].repeat(1, count + 1, 1).contiguous()
    _trace_paths(vortices.contiguous(), stream.contiguous(), level, *size, step, path)
    return path
