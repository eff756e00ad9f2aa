"""Time step of the nonlinear solver: second-order finite volumes and Heun's method.

The equations are in `kernels.shallow_water.nonlinear`, the fluxes in `kernels.shallow_water.riemann`, layout and
boundaries in `kernels.shallow_water.ghost_cells`.

Instead of the depth h the state is D = h − max(−b, 0), the water over that of the still sea: the elevation at sea, the
depth on land. Rounding is then that of the wave, not that of the depth, and the still sea is exactly 0.
"""
# pyright: reportAttributeAccessIssue=false, reportIndexIssue=false
# (the members of Taichi's structs and the elements of its vectors exist only while a kernel is compiled)

from collections import namedtuple

import taichi as ti

from kernels import runtime
from kernels.shallow_water.ghost_cells import fill_ghosts, vector_index
from kernels.shallow_water.packing import LANES, vector, vectors
from kernels.shallow_water.riemann import flux, half_slopes, lower_face, turned, upper_face
from kernels.types import array1, columns, index1, index2

doubles1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
doubles2 = ti.types.ndarray(dtype=ti.f64, ndim=2)

# Time of the interval that is done, the step under way, steps done, time that friction acts, and the elevation at
# forced boundaries at the beginning and at the end of the step.
Clock = columns("done", "step", "steps", "friction", "level", "next_level")
Tide = columns("amplitude", "omega", "phase")  # m, rad/s, rad
# What a band stores for the next row: half slopes across y (with the velocity along y first), and the flux through the
# northern face.
Workspace = columns("eta", "h", "v", "u", "mass", "momentum", "transverse")

# Arguments of `step` that its functions share.
Basin = namedtuple(
    "Basin",
    "state cells bed bed_cells workspace speeds clock tide halo boundaries ny W bands dx dy g dry drag manning start "
    "interval friction",
)
Fluxes = namedtuple("Fluxes", "west east south north")  # through the faces of a cell

ENDLESS = 1e30
INFINITY = float("inf")
COURANT = 0.45  # depth stays positive below 1/2


@ti.kernel
def step(
    state: vectors,
    cells: array1,
    bed: vectors,
    bed_cells: array1,
    workspace: vectors,
    speeds: array1,
    clock: doubles1,
    tide: doubles2,
    halo: index2,
    boundaries: index1,
    ny: ti.i32,
    W: ti.i32,
    bands: ti.i32,
    dx: ti.f32,
    dy: ti.f32,
    g: ti.f32,
    dry: ti.f32,
    drag: ti.f64,
    manning: ti.f32,
    start: ti.f64,
    interval: ti.f64,
    friction: ti.template(),
    alone: ti.template(),
):
    """The next step of an interval, or only the last half step of friction if the interval is over.

    Args:
        state, cells: D (m), u and v (m/s), as vectors and as numbers.
        bed, bed_cells: bed b, m, (ny + 4, W + 4), likewise.
        workspace: (bands, W, `Workspace`), scratch.
        speeds: (ny), scratch.
        clock: `Clock`, s and m.
        tide: (components, `Tide`) of the prescribed elevation.
        halo: (ghosts of a row, `Halo`).
        boundaries: (4), kind of each boundary.
        bands: parts of the basin, one for a thread. No value depends on them.
        dry: depth below which water does not move, m.
        drag, manning: 1/s, s/m^(1/3); read only with `friction`.
        start, interval: time at which the interval begins, and its length, s.
        friction: whether there is any.
        alone: take all steps of the interval in one launch, on one thread.
    """
    basin = ti.static(
        Basin(
            *(state, cells, bed, bed_cells, workspace, speeds, clock, tide, halo, boundaries),
            *(ny, W, bands, dx, dy, g, dry, drag, manning, start, interval, friction),
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


@ti.func
def take_step(basin: ti.template()):
    """Heun's method, the second-order strong-stability-preserving one: two Euler steps, and the mean with the start.

    Friction acts half before and half after it (Strang); the halves of two steps are taken together.
    """
    for i in range(basin.ny):
        basin.speeds[i] = greatest_rate(basin, i)
    for _ in range(1):
        next_time_step(basin)
    if ti.static(basin.friction):
        for i in range(basin.ny):
            apply_friction(basin, i, basin.clock[Clock.friction])
    for stage in ti.static(range(2)):
        for i in range(basin.ny + 4):
            if basin.clock[Clock.step] > 0.0:
                level = ti.cast(basin.clock[Clock.level + stage], ti.f32)
                fill_ghosts(basin, stage, i, level)
        ti.loop_config(block_dim=ti.static(runtime.one_task_a_thread()))
        for band in range(basin.bands):
            if basin.clock[Clock.step] > 0.0:
                march(basin, stage, band, ti.cast(basin.clock[Clock.step], ti.f32))


@ti.func
def read_cell(basin: ti.template(), stage: ti.template(), p: ti.i32):
    """The cells at vector p of the state or the first stage, as a struct of `kernels.shallow_water.riemann`."""
    size = (basin.ny + 4) * (basin.W + 4)
    zero = vector(0.0)
    D = basin.state[p]
    b = basin.bed[p - 3 * stage * size]
    h = D + ti.max(zero - b, zero)
    return ti.Struct(D=D, b=b, eta=D + ti.max(b, zero), h=h, u=basin.state[p + size], v=basin.state[p + 2 * size])


@ti.func
def greatest_rate(basin: ti.template(), i: ti.i32) -> ti.f32:
    """Greatest (|u| + c)/Δx + (|v| + c)/Δy of a row, 1/s; infinite where the flow is no longer finite."""
    zero = vector(0.0)
    most = zero
    total = zero
    for j in range(basin.W):
        cell = read_cell(basin, 0, vector_index(0, i, j, basin.ny, basin.W))
        c = ti.sqrt(basin.g * cell.h)
        rate = (ti.max(cell.u, zero - cell.u) + c) / basin.dx + (ti.max(cell.v, zero - cell.v) + c) / basin.dy
        most = ti.max(most, rate)
        total = total + rate
    result = 0.0
    for lane in ti.static(range(LANES)):
        result = ti.max(result, most[lane])
        if not total[lane] < ENDLESS:  # also true of a NaN, which a maximum passes over
            result = INFINITY
    return result


@ti.func
def next_time_step(basin: ti.template()):
    """Close the step before, and choose the next: if speeds stay as they are, equal ones up to the interval's end."""
    clock, tide = ti.static((basin.clock, basin.tide))
    rate = 0.0
    for i in range(basin.ny):
        rate = ti.max(rate, basin.speeds[i])
    before = clock[Clock.step]
    done = clock[Clock.done] + before
    left = basin.interval - done
    dt = left / ti.max(ti.ceil(left * ti.cast(rate, ti.f64) / COURANT), 1.0)
    if left < 1e-9 * basin.interval:
        done = basin.interval
        dt = 0.0 * left
    clock[Clock.done] = done
    clock[Clock.step] = dt
    clock[Clock.friction] = 0.5 * (before + dt)
    if dt > 0.0:
        clock[Clock.steps] = clock[Clock.steps] + 1.0
    level = 0.0 * basin.start
    next_level = 0.0 * basin.start
    for n in range(tide.shape[0]):
        angle = tide[n, Tide.omega] * (basin.start + done) + tide[n, Tide.phase]
        level = level + tide[n, Tide.amplitude] * ti.cos(angle)
        next_level = next_level + tide[n, Tide.amplitude] * ti.cos(angle + tide[n, Tide.omega] * dt)
    clock[Clock.level] = level
    clock[Clock.next_level] = next_level


@ti.func
def apply_friction(basin: ti.template(), i: ti.i32, t: ti.f64):
    """The exact solution of u_t = −r u − g n² |u| u/h^(4/3) at constant depth for a time t, in a row."""
    cells, drag = ti.static((basin.cells, basin.drag))
    drag_factor = ti.cast(ti.exp(-drag * t), ti.f32)
    damped_time = ti.cast(t, ti.f32)  # ∫ e^{−rt} dt
    if drag * t > 1e-6:
        damped_time = ti.cast((1.0 - ti.exp(-drag * t)) / drag, ti.f32)
    size = (basin.ny + 4) * (basin.W + 4) * LANES
    first = vector_index(0, i, 0, basin.ny, basin.W) * LANES
    for n in range(first, first + basin.W * LANES):
        h = ti.max(cells[n] + ti.max(-basin.bed_cells[n], 0.0), basin.dry)
        u = cells[n + size]
        v = cells[n + 2 * size]
        K = basin.g * basin.manning * basin.manning / ti.pow(h, 4.0 / 3.0)
        factor = drag_factor / (1.0 + K * damped_time * ti.sqrt(u * u + v * v))
        cells[n + size] = u * factor
        cells[n + 2 * size] = v * factor


@ti.func
def march(basin: ti.template(), stage: ti.template(), band: ti.i32, dt: ti.f32):
    """One stage in a band of rows: from the state to the first stage, or on from there and to the mean with the state.

    Every face is worked out once: slopes and flux of the western face stay in registers and those of the southern one
    in the workspace. To begin with, two rows south of the band are passed.
    """
    W, ny, dry, g, workspace = ti.static((basin.W, basin.ny, basin.dry, basin.g, basin.workspace))
    north_row = W + 4
    zero = vector(0.0)
    rx = dt / basin.dx
    ry = dt / basin.dy
    first = ny * band // basin.bands
    for i in range(first - 2, ny * (band + 1) // basin.bands):
        p = vector_index(3 * stage, i, -1, ny, W)
        x = half_slopes(read_cell(basin, stage, p - 1), read_cell(basin, stage, p), read_cell(basin, stage, p + 1), dry)
        west = ti.Struct(mass=zero, left=zero, right=zero, transverse=zero)
        for j in range(-1, W):
            p = vector_index(3 * stage, i, j, ny, W)
            here = read_cell(basin, stage, p)
            east = ti.Struct(mass=zero, left=zero, right=zero, transverse=zero)
            next_x = ti.Struct(eta=zero, h=zero, u=zero, v=zero)
            if i >= first:
                cell = read_cell(basin, stage, p + 1)
                next_x = half_slopes(here, cell, read_cell(basin, stage, p + 2), dry)
                east = flux(upper_face(here, x), lower_face(cell, next_x), g)
            if j >= 0:
                k = (band * W + j) * ti.static(len(Workspace.names))
                here_y = turned(here)
                cell = turned(read_cell(basin, stage, p + north_row))
                next_y = half_slopes(here_y, cell, turned(read_cell(basin, stage, p + 2 * north_row)), dry)
                if i >= first - 1:
                    y = read_slopes(workspace, k)
                    north = flux(upper_face(here_y, y), lower_face(cell, next_y), g)
                    if i >= first:
                        south = read_flux(workspace, k)
                        fluxes = ti.static(Fluxes(west, east, south, north))
                        stepped = euler_step(here, x.eta, y.eta, fluxes, rx, ry, g)
                        store(basin, stage, vector_index(3 * (1 - stage), i, j, ny, W), here, stepped)
                    workspace[k + Workspace.mass] = north.mass
                    workspace[k + Workspace.momentum] = north.right
                    workspace[k + Workspace.transverse] = north.transverse
                workspace[k + Workspace.eta] = next_y.eta
                workspace[k + Workspace.h] = next_y.h
                workspace[k + Workspace.v] = next_y.u
                workspace[k + Workspace.u] = next_y.v
            west = east
            x = next_x


@ti.func
def read_slopes(workspace: ti.template(), k: ti.i32):
    """Half slopes across y that the row to the south has stored, as faces across y see them."""
    return ti.Struct(
        eta=workspace[k + Workspace.eta],
        h=workspace[k + Workspace.h],
        u=workspace[k + Workspace.v],
        v=workspace[k + Workspace.u],
    )


@ti.func
def read_flux(workspace: ti.template(), k: ti.i32):
    """Flux through the southern face of a cell, as the cell north of it feels it."""
    return ti.Struct(
        mass=workspace[k + Workspace.mass],
        right=workspace[k + Workspace.momentum],
        transverse=workspace[k + Workspace.transverse],
    )


@ti.func
def euler_step(here, x_eta, y_eta, fluxes: ti.template(), rx: ti.f32, ry: ti.f32, g: ti.f32):
    """D and the discharges h u, h v of a cell after an Euler step; x_eta, y_eta are the half slopes of its surface."""
    west, east, south, north = ti.static(fluxes)
    pull = 2.0 * g * here.h
    q_x = (here.h * here.u - rx * ((east.left - west.right) + pull * x_eta)) - ry * (
        north.transverse - south.transverse
    )
    q_y = (here.h * here.v - ry * ((north.left - south.right) + pull * y_eta)) - rx * (
        east.transverse - west.transverse
    )
    D = here.D - (rx * (east.mass - west.mass) + ry * (north.mass - south.mass))
    return ti.Struct(D=D, q_x=q_x, q_y=q_y)


@ti.func
def store(basin: ti.template(), stage: ti.template(), n: ti.i32, here, stepped):
    """Write the result of a stage to vector n: after the second stage the mean with the state."""
    size = (basin.ny + 4) * (basin.W + 4)
    zero = vector(0.0)
    h0 = ti.max(zero - here.b, zero)
    D, q_x, q_y = stepped.D, stepped.q_x, stepped.q_y
    if ti.static(stage == 1):
        D_0 = basin.state[n]
        D = 0.5 * (D_0 + D)
        q_x = 0.5 * ((D_0 + h0) * basin.state[n + size] + q_x)
        q_y = 0.5 * ((D_0 + h0) * basin.state[n + 2 * size] + q_y)
    D = ti.max(D, zero - h0)  # against rounding
    h = D + h0
    # q/h, fading to zero in water thinner than `dry` (Kurganov and Petrova 2007).
    per_depth = 2.0 * h / (h * h + ti.max(h * h, basin.dry * basin.dry + zero))
    basin.state[n] = D
    basin.state[n + size] = q_x * per_depth
    basin.state[n + 2 * size] = q_y * per_depth
