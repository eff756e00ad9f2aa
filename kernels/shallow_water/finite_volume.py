"""Time step of the nonlinear solver: second-order finite volumes and Heun's method.

The equations are in `kernels.shallow_water.nonlinear`, the faces in `kernels.shallow_water.riemann`, layout and edges
in `kernels.shallow_water.ghost_cells`.

Instead of the depth h the state is D = h − max(−b, 0), the water over that of the still sea: the elevation at sea, the
depth on land. Rounding is then that of the wave, not that of the depth, and the still sea is exactly 0.
"""

import taichi as ti

from kernels.shallow_water.ghost_cells import fill_ghosts, place
from kernels.shallow_water.packing import LANES
from kernels.shallow_water.riemann import flux, half_slopes

vector = ti.types.vector(LANES, ti.f32)
vectors = ti.types.ndarray(dtype=vector, ndim=1)
scalars = ti.types.ndarray(dtype=ti.f32, ndim=1)
doubles1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
doubles2 = ti.types.ndarray(dtype=ti.f64, ndim=2)
integers1 = ti.types.ndarray(dtype=ti.i32, ndim=1)
integers2 = ti.types.ndarray(dtype=ti.i32, ndim=2)

# Entries of the clock: time of the interval that is done, the step on its way, steps done, time that friction acts,
# elevation of forced edges at the beginning and at the end of the step.
DONE, STEP, STEPS, FRICTION, EDGE_NOW, EDGE_NEXT = range(6)
CLOCK = 6
KEPT = 7  # vectors that a band keeps for each column: four slopes and three fluxes

ENDLESS = 1e30
INFINITY = float("inf")
COURANT = 0.45  # depth stays positive below 1/2


@ti.kernel
def step(
    state: vectors,
    cells: scalars,
    bed: vectors,
    bed_cells: scalars,
    kept: vectors,
    speeds: scalars,
    clock: doubles1,
    tide: doubles2,
    halo: integers2,
    edges: integers1,
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
    """The next step of an interval, or nothing but the last half of friction if the interval is over.

    Args:
        state, cells: D (m), u and v (m/s), as vectors and as numbers.
        bed, bed_cells: bed b, m, (ny + 4, W + 4), likewise.
        kept: (bands, W, KEPT), of no meaning between steps.
        speeds: (ny), of no meaning between steps.
        clock: (CLOCK).
        tide: (components, 3), amplitude (m), angular frequency (rad/s) and phase of the prescribed elevation.
        halo: (ghosts of a row, 8): column and lane of a ghost; the edge beyond which it lies (or −1 if it is a cell of
            another lane) and how many cells beyond; column and lane of the cell nearest to that edge (or of the cell
            itself); column and lane of the next nearest.
        edges: (4), kind of each edge.
        bands: parts of the basin, one for a thread. No value depends on them.
        dry: depth below which water does not move, m.
        drag, manning: 1/s, s/m^(1/3); looked at only with `friction`.
        start, interval: time at which the interval begins, and its length, s.
        friction: whether there is any.
        alone: take all steps of the interval, on one thread, without a launch for each.
    """
    if ti.static(alone):
        for _ in range(1):
            going = True
            while going:
                take_step(
                    state, cells, bed, bed_cells, kept, speeds, clock, tide, halo, edges, ny, W, bands,
                    dx, dy, g, dry, drag, manning, start, interval, friction,
                )  # fmt: skip
                going = clock[STEP] > 0.0
    else:
        take_step(
            state, cells, bed, bed_cells, kept, speeds, clock, tide, halo, edges, ny, W, bands,
            dx, dy, g, dry, drag, manning, start, interval, friction,
        )  # fmt: skip


@ti.func
def take_step(
    state: ti.template(),
    cells: ti.template(),
    bed: ti.template(),
    bed_cells: ti.template(),
    kept: ti.template(),
    speeds: ti.template(),
    clock: ti.template(),
    tide: ti.template(),
    halo: ti.template(),
    edges: ti.template(),
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
):
    """Heun's method, the second-order strong-stability-preserving one: two Euler steps, and the mean with the start.

    Friction acts half before and half after it (Strang); the halves of two steps are taken together.
    """
    for i in range(ny):
        speeds[i] = fastest(state, bed, i, ny, W, dx, dy, g)
    for _ in range(1):
        schedule(clock, speeds, tide, ny, start, interval)
    if ti.static(friction):
        for i in range(ny):
            rub(cells, bed_cells, i, ny, W, g, dry, drag, manning, clock[FRICTION])
    for stage in ti.static(range(2)):
        for i in range(ny + 4):
            if clock[STEP] > 0.0:
                level = ti.cast(clock[EDGE_NOW + stage], ti.f32)
                fill_ghosts(cells, bed_cells, halo, edges, stage, i, ny, W, g, dry, level)
        ti.loop_config(block_dim=1)
        for band in range(bands):
            if clock[STEP] > 0.0:
                dt = ti.cast(clock[STEP], ti.f32)
                march(state, bed, kept, stage, band, bands, ny, W, dt / dx, dt / dy, g, dry)


@ti.func
def begin(rows: ti.i32, band: ti.i32, bands: ti.i32) -> ti.i32:
    """First of the rows of a band."""
    return rows * band // bands


@ti.func
def fastest(
    state: ti.template(), bed: ti.template(), i: ti.i32, ny: ti.i32, W: ti.i32, dx: ti.f32, dy: ti.f32, g: ti.f32
) -> ti.f32:
    """Greatest (|u| + c)/Δx + (|v| + c)/Δy of a row, 1/s; infinite where the flow is no longer finite."""
    zero = vector(0.0)
    most = zero
    total = zero
    for j in range(W):
        b = place(0, i, j, ny, W)
        u = state[place(1, i, j, ny, W)]
        v = state[place(2, i, j, ny, W)]
        c = ti.sqrt(g * (state[b] + ti.max(zero - bed[b], zero)))
        rate = (ti.max(u, zero - u) + c) / dx + (ti.max(v, zero - v) + c) / dy
        most = ti.max(most, rate)
        total = total + rate
    result = 0.0
    for lane in ti.static(range(LANES)):
        result = ti.max(result, most[lane])
        if not total[lane] < ENDLESS:  # also true of a NaN, which a maximum passes over
            result = INFINITY
    return result


@ti.func
def schedule(
    clock: ti.template(), speeds: ti.template(), tide: ti.template(), ny: ti.i32, start: ti.f64, interval: ti.f64
):
    """Close the step before, and choose the next: if speeds stay as they are, equal ones up to the interval's end."""
    rate = 0.0
    for i in range(ny):
        rate = ti.max(rate, speeds[i])
    before = clock[STEP]
    done = clock[DONE] + before
    left = interval - done
    dt = left / ti.max(ti.ceil(left * ti.cast(rate, ti.f64) / COURANT), 1.0)
    if left < 1e-9 * interval:
        done = interval
        dt = 0.0 * left
    clock[DONE] = done
    clock[STEP] = dt
    clock[FRICTION] = 0.5 * (before + dt)
    if dt > 0.0:
        clock[STEPS] = clock[STEPS] + 1.0
    now = 0.0 * start
    next = 0.0 * start
    for n in range(tide.shape[0]):
        angle = tide[n, 1] * (start + done) + tide[n, 2]
        now = now + tide[n, 0] * ti.cos(angle)
        next = next + tide[n, 0] * ti.cos(angle + tide[n, 1] * dt)
    clock[EDGE_NOW] = now
    clock[EDGE_NEXT] = next


@ti.func
def rub(
    cells: ti.template(),
    bed_cells: ti.template(),
    i: ti.i32,
    ny: ti.i32,
    W: ti.i32,
    g: ti.f32,
    dry: ti.f32,
    drag: ti.f64,
    manning: ti.f32,
    t: ti.f64,
):
    """The exact solution of u_t = −r u − g n² |u| u/h^(4/3) at constant depth for a time t, in a row."""
    keep = ti.cast(ti.exp(-drag * t), ti.f32)
    reach = ti.cast(t, ti.f32)
    if drag * t > 1e-6:
        reach = ti.cast((1.0 - ti.exp(-drag * t)) / drag, ti.f32)
    size = (ny + 4) * (W + 4) * LANES
    first = place(0, i, 0, ny, W) * LANES
    for at in range(first, first + W * LANES):
        h = ti.max(cells[at] + ti.max(-bed_cells[at], 0.0), dry)
        u = cells[at + size]
        v = cells[at + 2 * size]
        K = g * manning * manning / ti.pow(h, 4.0 / 3.0)
        factor = keep / (1.0 + K * reach * ti.sqrt(u * u + v * v))
        cells[at + size] = u * factor
        cells[at + 2 * size] = v * factor


@ti.func
def march(
    state: ti.template(),
    bed: ti.template(),
    kept: ti.template(),
    stage: ti.template(),
    band: ti.i32,
    bands: ti.i32,
    ny: ti.i32,
    W: ti.i32,
    rx: ti.f32,
    ry: ti.f32,
    g: ti.f32,
    dry: ti.f32,
):
    """One stage in a band of rows: from the state to the first stage, or on from there and to the mean with the state.

    Every face is worked out once: the flux through the western face stays in registers and that through the southern
    one in `kept`, and so do the slopes. To begin with, two rows south of the band are passed.

    Args:
        rx, ry: Δt/Δx and Δt/Δy, s/m.
    """
    u_field = (ny + 4) * (W + 4)
    v_field = 2 * u_field
    north = W + 4
    zero = vector(0.0)
    first = begin(ny, band, bands)
    for i in range(first - 2, begin(ny, band + 1, bands)):
        inside = i >= first
        p = place(3 * stage, i, -1, ny, W)
        b = place(0, i, -1, ny, W)
        x_eta, x_h, x_u, x_v = half_slopes(
            state[p - 1], state[p], state[p + 1],
            bed[b - 1], bed[b], bed[b + 1],
            state[p - 1 + u_field], state[p + u_field], state[p + 1 + u_field],
            state[p - 1 + v_field], state[p + v_field], state[p + 1 + v_field],
            dry,
        )  # fmt: skip
        F_mass, F_u, F_v = zero, zero, zero
        for j in range(-1, W):
            p = place(3 * stage, i, j, ny, W)
            b = place(0, i, j, ny, W)
            D, u, v = state[p], state[p + u_field], state[p + v_field]
            h0 = ti.max(zero - bed[b], zero)
            h = D + h0
            eta = D + ti.max(bed[b], zero)
            E_mass, E_here, E_there, E_v = zero, zero, zero, zero
            e_eta, e_h, e_u, e_v = zero, zero, zero, zero
            if inside:
                D_e, u_e, v_e = state[p + 1], state[p + 1 + u_field], state[p + 1 + v_field]
                e_eta, e_h, e_u, e_v = half_slopes(
                    D, D_e, state[p + 2],
                    bed[b], bed[b + 1], bed[b + 2],
                    u, u_e, state[p + 2 + u_field],
                    v, v_e, state[p + 2 + v_field],
                    dry,
                )  # fmt: skip
                eta_e = D_e + ti.max(bed[b + 1], zero)
                h_e = D_e + ti.max(zero - bed[b + 1], zero)
                E_mass, E_here, E_there, E_v = flux(
                    eta + x_eta, h + x_h, u + x_u, v + x_v, eta_e - e_eta, h_e - e_h, u_e - e_u, v_e - e_v, g
                )
            if j >= 0:
                k = (band * W + j) * KEPT
                n = p + north
                D_n, u_n, v_n, b_n = state[n], state[n + u_field], state[n + v_field], bed[b + north]
                n_eta, n_h, n_v, n_u = half_slopes(
                    D, D_n, state[n + north],
                    bed[b], b_n, bed[b + 2 * north],
                    v, v_n, state[n + north + v_field],
                    u, u_n, state[n + north + u_field],
                    dry,
                )  # fmt: skip
                if i >= first - 1:
                    y_eta, y_h, y_v, y_u = kept[k], kept[k + 1], kept[k + 2], kept[k + 3]
                    eta_n = D_n + ti.max(b_n, zero)
                    h_n = D_n + ti.max(zero - b_n, zero)
                    N_mass, N_here, N_there, N_u = flux(
                        eta + y_eta, h + y_h, v + y_v, u + y_u, eta_n - n_eta, h_n - n_h, v_n - n_v, u_n - n_u, g
                    )
                    if inside:
                        S_mass, S_v, S_u = kept[k + 4], kept[k + 5], kept[k + 6]
                        D = D - (rx * (E_mass - F_mass) + ry * (N_mass - S_mass))
                        pull = 2.0 * g * h
                        q_x = (h * u - rx * ((E_here - F_u) + pull * x_eta)) - ry * (N_u - S_u)
                        q_y = (h * v - ry * ((N_here - S_v) + pull * y_eta)) - rx * (E_v - F_v)
                        at = place(3 * (1 - stage), i, j, ny, W)
                        if ti.static(stage == 1):
                            D_0 = state[at]
                            D = 0.5 * (D_0 + D)
                            q_x = 0.5 * ((D_0 + h0) * state[at + u_field] + q_x)
                            q_y = 0.5 * ((D_0 + h0) * state[at + v_field] + q_y)
                        D = ti.max(D, zero - h0)  # against rounding
                        h = D + h0
                        # q/h, fading to nothing in water thinner than `dry` (Kurganov and Petrova 2007).
                        per_depth = 2.0 * h / (h * h + ti.max(h * h, dry * dry + zero))
                        state[at] = D
                        state[at + u_field] = q_x * per_depth
                        state[at + v_field] = q_y * per_depth
                    kept[k + 4], kept[k + 5], kept[k + 6] = N_mass, N_there, N_u
                kept[k], kept[k + 1], kept[k + 2], kept[k + 3] = n_eta, n_h, n_v, n_u
            F_mass, F_u, F_v = E_mass, E_there, E_v
            x_eta, x_h, x_u, x_v = e_eta, e_h, e_u, e_v
