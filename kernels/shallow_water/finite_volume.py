"""Time step of the nonlinear solver: second-order finite volumes, along x and along y in turn.

The equations are in `usvauv.kernels.shallow_water.nonlinear`, the fluxes and the states beyond boundaries in
`usvauv.kernels.shallow_water.riemann`.

Instead of the depth h the state is D = h − max(−b, 0), the water over that of the still sea: the elevation at sea, the
depth on land. Rounding is then that of the wave, not that of the depth, and the still sea is exactly 0.

Fields D, u and v lie one after the other, twice (the state, and what a sweep along x makes of it), each of ny + 4 rows
of W + 4 vectors, with two ghosts all round. A lane holds W neighbouring columns of the basin, and those beyond as
ghosts. The first lane begins at the western boundary and the last one ends at the eastern one, so that lanes overlap
where W does not divide the columns: all lanes hold water, and columns held twice are equal to the last bit. The bed,
one field, lies likewise, mirrored beyond the boundaries.
"""
# pyright: reportAttributeAccessIssue=false, reportIndexIssue=false
# (the members of Taichi's structs and the elements of its vectors exist only while a kernel is compiled)

from collections import namedtuple

import taichi as ti

from usvauv.kernels import runtime
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.shallow_water.discretisation import LANES, SOUTH, vector, vectors
from usvauv.kernels.shallow_water.riemann import (
    WALL,
    Ghost,
    fill_open,
    fill_wall,
    flux,
    half_slopes,
    half_step,
    lower_face,
    upper_face,
)
from usvauv.kernels.types import array1, columns, index1, index2, vec2

doubles1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
doubles2 = ti.types.ndarray(dtype=ti.f64, ndim=2)

# Time at which the interval begins, how much of it is done, the step under way, that of its sweep along x, steps done,
# and the prescribed elevation at the beginning and at the end of the sweeps along x and along y.
Clock = columns("start", "done", "step", "step_x", "steps", "level_x", "next_x", "level_y", "next_y")
Tide = columns("amplitude", "omega", "phase")  # m, rad/s, rad

# Entries of the table `halo` for a ghost, the same in each row: its column and lane; the boundary beyond which it lies
# (−1 if it is a cell of another lane) and how many cells beyond; column and lane of the cell nearest to that boundary
# (or of the cell itself), and of the next nearest.
Halo = columns("column", "lane", "boundary", "layer", "first_column", "first_lane", "second_column", "second_lane")

# Arguments of `step` that its functions share.
NonlinearBasin = namedtuple(
    "NonlinearBasin",
    "state cells bed bed_cells fastest clock tide halo boundaries ny W parts pieces dx dy g dry drag manning interval "
    "friction",
)
# A row or (a piece of) a column of vectors that a sweep goes along: axis (0 for x, 1 for y), index of the first vector,
# from one to the next, their number, and from a vector that is read to where it is written.
Line = namedtuple("Line", "axis first stride length offset")

ENDLESS = 1e30
INFINITY = float("inf")
COURANT = 0.95
# How many times shorter steps are beside dry land, where puddles would gain energy otherwise; and where the bed jumps,
# 1 + ROUGH · jump/(jump + depth) times: waves over jumps of most of the depth would still gain energy in longer steps.
SHORE, ROUGH = 2.0, 20.0
MOST_STEPS = 1e9  # of an interval; with more the flow counts as infinitely fast


@kernel
def step(
    state: vectors,
    cells: array1,
    bed: vectors,
    bed_cells: array1,
    fastest: array1,
    clock: doubles1,
    tide: doubles2,
    halo: index2,
    boundaries: index1,
    ny: ti.i32,
    W: ti.i32,
    parts: ti.i32,
    pieces: ti.i32,
    dx: ti.f32,
    dy: ti.f32,
    g: ti.f32,
    dry: ti.f32,
    drag: ti.f64,
    manning: ti.f32,
    interval: ti.f64,
    friction: ti.template(),
    alone: ti.template(),
):
    """The next step of an interval, or only the last half step along x if the interval is over.

    Args:
        state, cells: D (m), u and v (m/s), as vectors and as numbers.
        bed, bed_cells: bed b, m, (ny + 4, W + 4), likewise.
        fastest: (1), greatest speed of a wave over the size of a cell since the last step began, 1/s.
        clock: `Clock`, s and m.
        tide: (components, `Tide`) of the prescribed elevation.
        halo: (ghosts of a row, `Halo`).
        boundaries: (4), kind of each boundary.
        parts, pieces: parts of all rows, and of each column, one for a thread. No value depends on them.
        dry: depth below which water does not move, m.
        drag, manning: 1/s, s/m^(1/3); read only with `friction`.
        interval: its length, s.
        friction: whether there is any.
        alone: take all steps of the interval in one launch, on one thread.
    """
    basin = ti.static(
        NonlinearBasin(
            *(state, cells, bed, bed_cells, fastest, clock, tide, halo, boundaries),
            *(ny, W, parts, pieces, dx, dy, g, dry, drag, manning, interval, friction),
        )
    )
    if ti.static(alone):
        for _ in range(1):
            going = True
            while going:
                take_step(basin)
                going = clock[Clock.step] > 0.0
    else:
        take_step(basin)


@func
def take_step(basin: ti.template()):
    """Strang's splitting: half a step along x, one along y, half a step along x, the latter together with the next one.

    Friction acts half before and half after the sweep along y. The sweep along x leads from the state to a copy of it
    and the one along y back; the last one of an interval stays in the state.
    """
    clock, ny, W, pieces, friction = ti.static((basin.clock, basin.ny, basin.W, basin.pieces, basin.friction))
    size = (ny + 4) * (W + 4)
    for _ in range(1):
        next_time_step(basin)
    ti.loop_config(block_dim=ti.static(runtime.one_task_a_thread()))
    for part in range(basin.parts):
        if clock[Clock.step_x] > 0.0:
            dt = ti.cast(clock[Clock.step_x], ti.f32)
            tide = vec2(ti.cast(clock[Clock.level_x], ti.f32), ti.cast(clock[Clock.next_x], ti.f32))
            offset = 3 * size
            if clock[Clock.step] == 0.0:
                offset = 0
            for i in range(ny * part // basin.parts, ny * (part + 1) // basin.parts):
                fill_row_ghosts(basin, i, dt / basin.dx, tide)
                first = vector_index(0, i, 0, ny, W)
                line = ti.static(Line(0, first, 1, W, offset))
                sweep(basin, line, dt)
                if ti.static(friction):
                    if clock[Clock.step] > 0.0:
                        apply_friction(basin, line, 0.5 * clock[Clock.step])
    ti.loop_config(block_dim=ti.static(runtime.one_task_a_thread()))
    for task in range(pieces * W):
        if clock[Clock.step] > 0.0:
            j = task % W
            piece = task // W
            dt = ti.cast(clock[Clock.step], ti.f32)
            tide = vec2(ti.cast(clock[Clock.level_y], ti.f32), ti.cast(clock[Clock.next_y], ti.f32))
            for north in ti.static(range(2)):
                if piece == north * (pieces - 1):
                    fill_column_ghosts(basin, j, north, dt / basin.dy, tide)
            row = ny * piece // pieces
            first = vector_index(3, row, j, ny, W)
            stride = W + 4
            length = ny * (piece + 1) // pieces - row
            offset = -3 * size
            line = ti.static(Line(1, first, stride, length, offset))
            sweep(basin, line, dt)
            if ti.static(friction):
                apply_friction(basin, line, 0.5 * clock[Clock.step])


@func
def vector_index(field: ti.i32, i: ti.i32, j: ti.i32, ny: ti.i32, W: ti.i32) -> ti.i32:
    """Index of row i and column j of a field: 0, 1, 2 for D, u, v, and 3, 4, 5 for those after a sweep along x."""
    return (field * (ny + 4) + i + 2) * (W + 4) + j + 2


@func
def fill_row_ghosts(basin: ti.template(), i: ti.i32, r: ti.f32, tide: vec2):
    """The ghosts of row i of the state.

    Args:
        basin: see `NonlinearBasin`.
        i: the row.
        r: length of the sweep over the size of a cell, s/m.
        tide: prescribed elevation at the beginning of the sweep and at its end, m.
    """
    ny, W, cells, halo = ti.static((basin.ny, basin.W, basin.cells, basin.halo))
    size = (ny + 4) * (W + 4) * LANES
    row = vector_index(0, i, 0, ny, W)
    for n in range(halo.shape[0]):
        at = (row + halo[n, Halo.column]) * LANES + halo[n, Halo.lane]
        first = (row + halo[n, Halo.first_column]) * LANES + halo[n, Halo.first_lane]
        boundary = halo[n, Halo.boundary]
        if boundary < 0:
            for field in ti.static(range(3)):
                cells[at + field * size] = cells[first + field * size]
        else:
            second = (row + halo[n, Halo.second_column]) * LANES + halo[n, Halo.second_lane]
            layer = halo[n, Halo.layer]
            outward = 2.0 * ti.cast(boundary, ti.f32) - 1.0
            across = size
            along = 2 * size
            bed_offset = 0
            ghost = ti.static(Ghost(at, first, second, across, along, bed_offset, layer, outward, r))
            fill_ghost(basin, ghost, basin.boundaries[boundary], tide)


@func
def fill_column_ghosts(basin: ti.template(), j: ti.i32, north: ti.i32, r: ti.f32, tide: vec2):
    """The southern (`north` 0) or northern (1) ghosts of column j after a sweep along x; others as above."""
    ny, W = ti.static((basin.ny, basin.W))
    size = (ny + 4) * (W + 4) * LANES
    edge = vector_index(3, north * (ny - 1), j, ny, W)
    inwards = (1 - 2 * north) * (W + 4)
    outward = 2.0 * ti.cast(north, ti.f32) - 1.0
    across = 2 * size
    along = size
    bed_offset = 3 * size
    for n in range(2 * LANES):
        layer = n // LANES + 1
        at = (edge - layer * inwards) * LANES + n % LANES
        first = edge * LANES + n % LANES
        second = (edge + inwards) * LANES + n % LANES
        ghost = ti.static(Ghost(at, first, second, across, along, bed_offset, layer, outward, r))
        fill_ghost(basin, ghost, basin.boundaries[SOUTH + north], tide)


@func
def fill_ghost(basin: ti.template(), ghost: ti.template(), kind: ti.i32, tide: vec2):
    """A ghost beyond a boundary of a kind, from the first and the second cell inside."""
    if kind == WALL:
        fill_wall(basin, ghost)
    else:
        fill_open(basin, ghost, kind, tide)


@func
def read_cell(basin: ti.template(), axis: ti.template(), p: ti.i32):
    """The cells at vector p, as a struct of `usvauv.kernels.shallow_water.riemann` with u along the axis.

    Args:
        basin: see `NonlinearBasin`.
        axis: 0 for x, of the state; 1 for y, of its copy.
        p: index of the vector.
    """
    size = (basin.ny + 4) * (basin.W + 4)
    zero = vector(0.0)
    D = basin.state[p]
    b = basin.bed[p - 3 * axis * size]
    h = D + ti.max(zero - b, zero)
    u = basin.state[p + (1 + axis) * size]
    v = basin.state[p + (2 - axis) * size]
    return ti.Struct(D=D, b=b, eta=D + ti.max(b, zero), h=h, u=u, v=v)


@func
def next_time_step(basin: ti.template()):
    """Close the step before, and choose the next: if speeds stay as they are, equal ones up to the interval's end."""
    clock = ti.static(basin.clock)
    before = clock[Clock.step]
    done = clock[Clock.done] + before
    left = basin.interval - done
    steps = ti.max(ti.ceil(left * ti.cast(basin.fastest[0], ti.f64) / COURANT), 1.0)
    dt = left / steps
    if left < 1e-9 * basin.interval:
        done = basin.interval
        dt = 0.0 * left
    elif steps > MOST_STEPS:
        dt = 0.0 * left
    clock[Clock.done] = done
    clock[Clock.step] = dt
    clock[Clock.step_x] = 0.5 * (before + dt)
    if dt > 0.0:
        clock[Clock.steps] = clock[Clock.steps] + 1.0
        basin.fastest[0] = 0.0
    clock[Clock.level_x] = prescribed(basin, done - 0.5 * before)
    clock[Clock.next_x] = prescribed(basin, done + 0.5 * dt)
    clock[Clock.level_y] = prescribed(basin, done)
    clock[Clock.next_y] = prescribed(basin, done + dt)


@func
def prescribed(basin: ti.template(), t: ti.f64) -> ti.f64:
    """Prescribed elevation at a time of the interval, m."""
    tide = ti.static(basin.tide)
    level = 0.0 * t
    for n in range(tide.shape[0]):
        angle = tide[n, Tide.omega] * (basin.clock[Clock.start] + t) + tide[n, Tide.phase]
        level = level + tide[n, Tide.amplitude] * ti.cos(angle)
    return level


@func
def apply_friction(basin: ti.template(), line: ti.template(), t: ti.f64):
    """The exact solution of u_t = −r u − g n² |u| u/h^(4/3) at constant depth for a time t, on a line as swept."""
    cells, drag = ti.static((basin.cells, basin.drag))
    drag_factor = ti.cast(ti.exp(-drag * t), ti.f32)
    damped_time = ti.cast(t, ti.f32)  # ∫ e^{−rt} dt
    if drag * t > 1e-6:
        damped_time = ti.cast((1.0 - ti.exp(-drag * t)) / drag, ti.f32)
    size = (basin.ny + 4) * (basin.W + 4) * LANES
    for k in range(line.length * LANES):
        bed = (line.first + k // LANES * line.stride) * LANES + k % LANES - 3 * line.axis * size
        n = bed + 3 * (1 - line.axis) * size
        h = ti.max(cells[n] + ti.max(-basin.bed_cells[bed], 0.0), basin.dry)
        u = cells[n + size]
        v = cells[n + 2 * size]
        K = basin.g * basin.manning * basin.manning / ti.pow(h, 4.0 / 3.0)
        factor = drag_factor / (1.0 + K * damped_time * ti.sqrt(u * u + v * v))
        cells[n + size] = u * factor
        cells[n + 2 * size] = v * factor


@func
def sweep(basin: ti.template(), line: ti.template(), dt: ti.f32):
    """A step along one axis, and the greatest rate of the waves at its faces. See `Line`."""
    axis, g, dry, stride = ti.static((line.axis, basin.g, basin.dry, line.stride))
    zero = vector(0.0)
    spacing = basin.dx
    if ti.static(axis == 1):
        spacing = basin.dy
    r = dt / spacing
    p = line.first - stride
    here = read_cell(basin, axis, p)
    after = read_cell(basin, axis, p + stride)
    half = half_slopes(read_cell(basin, axis, p - stride), here, after, dry, r, g)
    change = half_step(here, half, r, g)
    west = ti.Struct(mass=zero, left=zero, right=zero, transverse=zero, speed=zero, step=zero)
    most = zero
    total = zero
    for n in range(line.length + 1):
        beyond = read_cell(basin, axis, p + 2 * stride)
        next_half = half_slopes(here, after, beyond, dry, r, g)
        next_change = half_step(after, next_half, r, g)
        east = flux(upper_face(here, half, change, r, g), lower_face(after, next_half, next_change, r, g), g)
        flooded = ti.min(half.flooded, next_half.flooded)
        most = ti.max(most, east.speed * (SHORE + flooded * (1.0 + ROUGH * east.step - SHORE)))
        total = total + east.speed
        if n > 0:
            pull = 2.0 * g * (half.passage + change.h) * half.eta
            q_u = here.h * here.u - r * ((east.left - west.right) + pull)
            q_v = here.h * here.v - r * (east.transverse - west.transverse)
            h0 = ti.max(zero - here.b, zero)
            D = ti.max(here.D - r * (east.mass - west.mass), zero - h0)  # against rounding
            h = D + h0
            # q/h, fading to zero in water thinner than `dry` (Kurganov and Petrova 2007).
            per_depth = 2.0 * h / (h * h + ti.max(h * h, dry * dry + zero))
            store(basin, axis, p + line.offset, D, q_u * per_depth, q_v * per_depth)
        west = east
        here = after
        after = beyond
        half = next_half
        change = next_change
        p = p + stride
    result = 0.0
    for lane in ti.static(range(LANES)):
        result = ti.max(result, most[lane])
        if not total[lane] < ENDLESS:  # also true of a NaN, which a maximum passes over
            result = INFINITY
    ti.atomic_max(basin.fastest[0], result / spacing)


@func
def store(basin: ti.template(), axis: ti.template(), p: ti.i32, D, u, v):
    """Write D and the velocities along and across the axis to vector p."""
    size = (basin.ny + 4) * (basin.W + 4)
    basin.state[p] = D
    basin.state[p + (1 + axis) * size] = u
    basin.state[p + (2 - axis) * size] = v
