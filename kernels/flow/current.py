"""Velocity of the water without the storm: vortices, the stream of real currents on a regular grid, and long waves.

The stream is (levels, rows, columns, 2), m/s, see `kernels.flow.regular_grid`; its levels are
`kernels.mission.columns.Level`. Of a single row there is none.
"""

import taichi as ti
import torch

from kernels.flow import long_waves, regular_grid, vortex
from kernels.mission.columns import Parameter
from kernels.types import Level, array1, array3, array4, index1, mask1, vec2


@ti.func
def steady(
    vortices: ti.template(),
    stream: ti.template(),
    level: ti.i32,
    w: ti.i32,
    x: ti.f32,
    y: ti.f32,
    width: ti.f32,
    length: ti.f32,
) -> vec2:
    """Velocity (m/s) at (x, y) in world w of an area of the given size, without long waves."""
    V = vortex.current(vortices, w, x, y)
    if stream.shape[1] > 1:
        for axis in ti.static(range(2)):
            V[axis] += regular_grid.sample(stream, level, axis, x, y, width, length)
    return V


@ti.func
def velocity(
    p: ti.template(),
    vortices: ti.template(),
    stream: ti.template(),
    level: ti.i32,
    U: ti.template(),
    V: ti.template(),
    unit_x: ti.f32,
    unit_y: ti.f32,
    bed: ti.template(),
    sea: ti.i32,
    nx: ti.i32,
    ny: ti.i32,
    w: ti.i32,
    x: ti.f32,
    y: ti.f32,
) -> vec2:
    """Velocity (m/s) at (x, y) in world w."""
    width = p[Parameter.width]
    length = p[Parameter.length]
    waves = long_waves.velocity(U, V, unit_x, unit_y, bed, sea, x, y, width, length, nx, ny)
    return steady(vortices, stream, level, w, x, y, width, length) + waves


@ti.kernel
def on_grid(
    p: array1,
    vortices: array3,
    stream: array4,
    U: array4,
    V: array4,
    unit_x: ti.f32,
    unit_y: ti.f32,
    bed: array4,
    lane: index1,
    nx: ti.i32,
    ny: ti.i32,
    mask: mask1,
    margin: ti.f32,
    flow: array4,
):
    """Velocity (m/s) at cruise level on a grid over the area without a margin (m), in worlds where `mask` is not 0.

    `flow` is (W, rows, columns, 2), row 0 in the south.
    """
    for w, i in ti.ndrange(flow.shape[0], flow.shape[1]):
        if mask[w] != 0:
            y = margin + (p[Parameter.length] - 2.0 * margin) * i / (flow.shape[1] - 1)
            for j in range(flow.shape[2]):
                x = margin + (p[Parameter.width] - 2.0 * margin) * j / (flow.shape[2] - 1)
                here = velocity(p, vortices, stream, Level.cruise, U, V, unit_x, unit_y, bed, lane[w], nx, ny, w, x, y)
                flow[w, i, j, 0] = here[0]
                flow[w, i, j, 1] = here[1]


@ti.kernel
def _follow(vortices: array3, stream: array4, level: ti.i32, width: ti.f32, length: ti.f32, step: ti.f32, path: array3):
    for n in range(path.shape[0]):
        for t in range(1, path.shape[1]):
            at = vec2(path[n, t - 1, 0], path[n, t - 1, 1])
            V = steady(vortices, stream, level, 0, at[0], at[1], width, length)
            middle = at + 0.5 * step * V
            V = steady(vortices, stream, level, 0, middle[0], middle[1], width, length)
            path[n, t, 0] = at[0] + step * V[0]
            path[n, t, 1] = at[1] + step * V[1]


def follow(
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
        level: of `kernels.mission.columns.Level`.
        size: (width, length) of the area, m.
        step: s. count: steps.

    Returns:
        (N, count + 1, 2) float32, m.
    """
    path = points[:, None].repeat(1, count + 1, 1).contiguous()
    _follow(vortices.contiguous(), stream.contiguous(), level, *size, step, path)
    return path
