"""Motion of the water without the storm: vortices, real currents on a regular grid, and long waves.

A field on a regular grid is (levels, rows, columns, components), at least 2 rows and columns, row 0 in the south,
column 0 in the west, its corners the area's corners; between nodes it is bilinear, outside the area it is that of the
nearest edge. Long waves are the packed fields of `usvauv.kernels.shallow_water.discretisation`, with at least 3 cells
each way.
"""

from typing import Any, NamedTuple

import taichi as ti
import torch

from usvauv.kernels.flow import vortex
from usvauv.kernels.flow.vortex import ENDLESS, PLACES, Eddies, Pattern, places
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.shallow_water.discretisation import LANES
from usvauv.kernels.types import Level, array1, array3, array4, index1, vec2, vec3

LANE = [float(n) for n in range(PLACES)]
SHALLOWEST = 1.0  # m; over less water a transport makes no velocity that a vehicle would meet


class Profile(NamedTuple):
    """How currents change with depth.

    Attributes:
        cruise: depth of `Level.cruise`, m.
        decay: in which vortices fade, m; 0: they do not.
        shear: exponent of the height over the bed in real currents; 0: they are linear between the two levels.
        bed: mean depth of the bed, m.
    """

    cruise: Any
    decay: Any = 0.0
    shear: Any = 0.0
    bed: Any = 1.0


class Water(NamedTuple):
    """The water of all worlds; a function reads only the part it needs.

    Attributes:
        vortex: (W, V, 4) vortices: x0, y0, Γ, δ.
        stream: (levels, rows, columns, 2) real current at each `Level`, m/s; one row means no current.
        width, length: of the area, m.
        bed: (1, rows, columns, 1) depth h, m.
        eta: packed elevation of the long waves, m, (blocks, rows, W, LANES).
        U, V: packed transports of the long waves.
        unit_x, unit_y: what makes m²/s of `U` and `V`.
        nx, ny: number of cells.
        sea_index: (W,) int32, which sea of the pool a world sails on.
        wave: (seas, groups, columns, LANES) the storm's components, `airy`; velocities at each `Level`.
        since: (1,) time since that of the components' phases, s.
        felt: (seas,) int32, groups of the components that are felt at cruise level, `airy.felt`.
        pattern: of the vortices.
        profile: of the current at depths between and below the levels.
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
    since: Any = None
    felt: Any = None
    pattern: Pattern = ENDLESS.pattern
    profile: Profile | None = None


@func
def grid_cell(
    field: ti.template(),
    level: ti.i32,
    component: ti.template(),
    x: ti.f32,
    y: ti.f32,
    width: ti.f32,
    length: ti.f32,
):
    """The cell of a regular grid that holds (x, y), in an area of the given size, m.

    Returns:
        (south-west, south-east, north-west, north-east), values of the field there; the way eastwards and northwards
        through the cell, from 0 to 1.
    """
    column = ti.math.clamp(x / width, 0.0, 1.0) * (field.shape[2] - 1)
    row = ti.math.clamp(y / length, 0.0, 1.0) * (field.shape[1] - 1)
    i = ti.math.clamp(ti.cast(row, ti.i32), 0, field.shape[1] - 2)
    j = ti.math.clamp(ti.cast(column, ti.i32), 0, field.shape[2] - 2)
    corners = [field[level, i + n // 2, j + n % 2, component] for n in ti.static(range(4))]
    return corners, column - j, row - i


@func
def grid_sample(
    field: ti.template(),
    level: ti.i32,
    component: ti.template(),
    x: ti.f32,
    y: ti.f32,
    width: ti.f32,
    length: ti.f32,
) -> ti.f32:
    """Value of a field on a regular grid at (x, y) in an area of the given size, m."""
    corners, east, north = grid_cell(field, level, component, x, y, width, length)
    south_side = corners[0] + east * (corners[1] - corners[0])
    north_side = corners[2] + east * (corners[3] - corners[2])
    return south_side + north * (north_side - south_side)


@func
def grid_slopes(
    field: ti.template(),
    level: ti.i32,
    component: ti.template(),
    x: ti.f32,
    y: ti.f32,
    width: ti.f32,
    length: ti.f32,
) -> vec3:
    """`grid_sample` and its derivatives in x and y, 1/m, those of the cell where (x, y) is between two."""
    corners, east, north = grid_cell(field, level, component, x, y, width, length)
    south_side, north_side = corners[1] - corners[0], corners[3] - corners[2]
    along = south_side + north * (north_side - south_side)
    across = corners[2] - corners[0] + east * (north_side - south_side)
    value = corners[0] + east * south_side + north * across
    return vec3(value, along * (field.shape[2] - 1) / width, across * (field.shape[1] - 1) / length)


@func
def long_wave_surface(
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
    here, eastward = column(eta, sea, j, nx), column(eta, sea, j + 1, nx)
    last, face, after = column(eta, sea, jf - 1, nx), column(eta, sea, jf, nx), column(eta, sea, jf + 1, nx)
    west, east = mix_rows(eta, here, i, wy), mix_rows(eta, eastward, i, wy)
    at_face = mix_rows(eta, face, i, wy)
    face_west, face_east = at_face - mix_rows(eta, last, i, wy), mix_rows(eta, after, i, wy) - at_face
    at_face = mix_columns(eta, here, eastward, i_f, wx)
    face_south = at_face - mix_columns(eta, here, eastward, i_f - 1, wx)
    face_north = mix_columns(eta, here, eastward, i_f + 1, wx) - at_face
    return vec3(
        west + wx * (east - west),
        (face_west + vx * (face_east - face_west)) / dx,
        (face_south + vy * (face_north - face_south)) / dy,
    )


@func
def column(field: ti.template(), sea: ti.i32, j: ti.i32, nx: ti.i32):
    """Where column j of a sea is in a packed field: block, place in a row, and lane."""
    W = field.shape[2]
    block, place, lane = sea // LANES, j, sea % LANES
    if W <= nx:
        block, place, lane = 0, j % W, j // W
    return ti.Vector([block, place, lane])


@func
def mix_rows(field: ti.template(), j, i: ti.i32, w: ti.f32) -> ti.f32:
    """Between rows i and i + 1 of a `column` j."""
    south = field[j[0], i, j[1], j[2]]
    return south + w * (field[j[0], i + 1, j[1], j[2]] - south)


@func
def mix_columns(field: ti.template(), j, east, i: ti.i32, w: ti.f32) -> ti.f32:
    """Between a `column` j and the next one to the `east`, in row i."""
    west = field[j[0], i, j[1], j[2]]
    return west + w * (field[east[0], i, east[1], east[2]] - west)


@func
def long_wave_velocity(water: ti.template(), sea: ti.i32, x: ti.f32, y: ti.f32) -> vec2:
    """Velocity (m/s) at (x, y), m: the transports of a sea, bilinear between their faces, over the depth.

    The linear solver's transports are half a substep older than its elevation, and so is this. In the outer half cell
    the nearest polynomial is continued. `water` is a `Water`.
    """
    nx, ny = water.nx, water.ny
    p = ti.math.clamp(x / water.width, 0.0, 1.0) * nx
    q = ti.math.clamp(y / water.length, 0.0, 1.0) * ny
    # Western faces lie at (j, i + ½), southern ones at (j + ½, i).
    j = ti.min(ti.cast(p, ti.i32), nx - 1)
    i = ti.math.clamp(ti.cast(ti.floor(q - 0.5), ti.i32), 0, ny - 2)
    west = mix_rows(water.U, column(water.U, sea, j, nx), i, q - 0.5 - i)
    east = mix_rows(water.U, column(water.U, sea, j + 1, nx), i, q - 0.5 - i)
    transport_x = west + (p - j) * (east - west)
    j = ti.math.clamp(ti.cast(ti.floor(p - 0.5), ti.i32), 0, nx - 2)
    i = ti.min(ti.cast(q, ti.i32), ny - 1)
    here, eastward = column(water.V, sea, j, nx), column(water.V, sea, j + 1, nx)
    south = mix_columns(water.V, here, eastward, i, p - 0.5 - j)
    north = mix_columns(water.V, here, eastward, i + 1, p - 0.5 - j)
    transport_y = south + (q - i) * (north - south)
    depth = ti.max(grid_sample(water.bed, 0, 0, x, y, water.width, water.length), SHALLOWEST)
    return vec2(water.unit_x * transport_x, water.unit_y * transport_y) / depth


@func
def at_level(water: ti.template(), level: ti.i32):
    """`fade` and `share` at a level, as of `without_waves`."""
    deep = level == Level.cruise
    return ti.select(deep, ti.cast(water.pattern.cruise, ti.f32), 1.0), ti.cast(deep, ti.f32)


@func
def real_current(water: ti.template(), x: ti.f32, y: ti.f32, share: ti.f32) -> vec2:
    """Velocity (m/s) of real currents at a share of the way from the surface to cruise depth."""
    V = vec2(0.0, 0.0)
    if water.stream.shape[1] > 1:
        for level in range(2):
            weight = ti.select(level == Level.cruise, share, 1.0 - share)
            for axis in ti.static(range(2)):
                V[axis] += weight * grid_sample(water.stream, level, axis, x, y, water.width, water.length)
    return V


@func
def without_waves(water: ti.template(), w: ti.i32, x: places, y: places, fade: ti.f32, share: ti.f32):
    """Velocity (u, v) in m/s of vortices and real currents at PLACES places side by side in world w.

    Args:
        fade: speed of vortices over that at the surface. share: of the way from the surface to cruise depth.
    """
    u, v = vortex.current(water.vortex, w, x, y, water.pattern)
    return at_share(water, x, y, u, v, fade, share)


@func
def at_share(water: ti.template(), x: places, y: places, u: places, v: places, fade: ti.f32, share: ti.f32):
    """`without_waves` from the velocity (u, v) of vortices at the surface."""
    u, v = fade * u, fade * v
    if water.stream.shape[1] > 1:
        for n in range(PLACES):
            V = real_current(water, x[n], y[n], share)
            u[n] += V[0]
            v[n] += V[1]
    return u, v


@func
def velocity(water: ti.template(), level: ti.i32, w: ti.i32, x: ti.f32, y: ti.f32) -> vec2:
    """Velocity (m/s) at (x, y) in world w."""
    fade, share = at_level(water, level)
    u, v = vortex.current(water.vortex, w, x, y, water.pattern)
    waves = long_wave_velocity(water, water.sea_index[w], x, y)
    return fade * vec2(u, v) + real_current(water, x, y, share) + waves


@kernel
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
    margin: ti.f32,
    flow: array4,
    repeats: ti.template(),
    eddy_scale: ti.f32,
    eddy_share: ti.f32,
    cruise: ti.f32,
):
    """Velocity (m/s) at cruise level on a grid over the area without a margin (m).

    `size` is the area's width and length, m. `flow` is (W, rows, columns, 2), row 0 in the south.
    """
    for w, i in ti.ndrange(flow.shape[0], flow.shape[1]):
        pattern = ti.static(Pattern(repeats, eddy_scale, eddy_share, cruise))
        water = ti.static(
            Water(
                vortices, stream, size[0], size[1], bed, None, U, V, unit_x, unit_y, nx, ny, sea_index, pattern=pattern
            )
        )
        fade, share = at_level(water, Level.cruise)
        y = margin + (size[1] - 2.0 * margin) * i / (flow.shape[1] - 1)
        for g in range((flow.shape[2] + PLACES - 1) // PLACES):
            first = g * PLACES
            x = margin + (first + ti.Vector(ti.static(LANE))) * ((size[0] - 2.0 * margin) / (flow.shape[2] - 1))
            u, v = without_waves(water, w, x, places(y), fade, share)
            for n in range(ti.min(PLACES, flow.shape[2] - first)):
                here = vec2(u[n], v[n]) + long_wave_velocity(water, sea_index[w], x[n], y)
                flow[w, i, first + n, 0] = here[0]
                flow[w, i, first + n, 1] = here[1]


@kernel
def _trace_paths(
    vortices: array3,
    stream: array4,
    level: ti.i32,
    width: ti.f32,
    length: ti.f32,
    step: ti.f32,
    path: array3,
    repeats: ti.template(),
    eddy_scale: ti.f32,
    eddy_share: ti.f32,
    cruise: ti.f32,
):
    for g in range((path.shape[0] + PLACES - 1) // PLACES):
        pattern = ti.static(Pattern(repeats, eddy_scale, eddy_share, cruise))
        water = ti.static(Water(vortices, stream, width, length, pattern=pattern))
        fade, share = at_level(water, level)
        x, y = places(0.0), places(0.0)
        for n in ti.static(range(PLACES)):  # those beyond the last follow its path
            particle = ti.min(g * PLACES + n, path.shape[0] - 1)
            x[n], y[n] = path[particle, 0, 0], path[particle, 0, 1]
        for t in range(1, path.shape[1]):
            u, v = without_waves(water, 0, x, y, fade, share)
            u, v = without_waves(water, 0, x + 0.5 * step * u, y + 0.5 * step * v, fade, share)
            x += step * u
            y += step * v
            for n in ti.static(range(PLACES)):
                particle = ti.min(g * PLACES + n, path.shape[0] - 1)
                path[particle, t, 0], path[particle, t, 1] = x[n], y[n]


def particle_paths(
    vortices: torch.Tensor,
    stream: torch.Tensor,
    points: torch.Tensor,
    *,
    level: int,
    size: tuple[float, float],
    step: float,
    count: int,
    eddies: Eddies = ENDLESS,
) -> torch.Tensor:
    """Paths of particles in the field of world 0 as it stands, by the midpoint rule.

    Args:
        vortices: (1, V, 4) float32.
        stream: (levels, rows, columns, 2) float32, m/s.
        points: (N, 2) float32, where they start, m.
        level: of `Level`.
        size: (width, length) of the area, m.
        step: s. count: steps.
        eddies: how the vortices fill the water.

    Returns:
        (N, count + 1, 2) float32, m.
    """
    path = points[:, None].repeat(1, count + 1, 1).contiguous()
    _trace_paths(vortices.contiguous(), stream.contiguous(), level, *size, step, path, *eddies.pattern)
    return path
