"""Diffusion of vortices, and their advection of one another.

With a viscosity ν a core spreads, dδ²/dt = 4ν, at constant circulation: a single vortex is then an exact solution of
the Navier–Stokes equations. With mutual advection a centre moves with the others' velocity averaged over the vorticity
of its own core, which is the velocity of a vortex with δ² = δ_i² + δ_j² at the centre (a Gaussian convolved with a
Gaussian). This is the exact motion of the centroid of a circular core (Euler's equations, first moment), and it
conserves the impulse Σ Γ_i X_i and, in ideal fluid, the energy; cores do not deform.
A uniform current carries all centres alike, which changes nothing in what they do to one another.
In a periodic pattern centres follow Hamilton's equations on a torus, so by Liouville's theorem centres that are once
uniform and independent remain so: the field is stationary.
"""

from collections import namedtuple
from collections.abc import Callable
from typing import Any

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.flow.airy import LANES, lanes
from usvauv.kernels.flow.vortex import ENDLESS, FAR, Eddies, Vortex, induced
from usvauv.kernels.functions import Launch, func, kernel
from usvauv.kernels.types import Columns, array3, array4, columns, index1, index2, select, vec2, vec4

ABREAST = 32  # worlds side by side: enough independent numbers that the processor need not wait for any
RENEWAL = 4.0  # s, at most, for which a centre keeps its acceleration
STAGES = 4  # of the Runge–Kutta method
PAIRS_A_MICROSECOND = 64  # of vortices abreast, whose motion one thread renews

blocks3 = ti.types.ndarray(dtype=lanes, ndim=3)
abreast = ti.types.vector(ABREAST, ti.f32)
rows4 = ti.types.ndarray(dtype=vec4, ndim=2)
blocks_abreast = ti.types.ndarray(dtype=abreast, ndim=3)


class VortexDrift(Columns):
    """Motion of a vortex's centre, (W, V, 4)."""

    u: int  # velocity, m/s
    v: int
    u_rate: int  # acceleration, m/s²
    v_rate: int


# A step: its time, s; ν, m²/s; numbers of `Pattern`, with the speed of columns; L and centre of `Eddies`, m; the number
# of steps from one renewal of a world's `VortexDrift` to the next; and the uniform current of `Eddies`, m/s.
Step = ti.types.struct(
    dt=ti.f32, viscosity=ti.f32, scale=ti.f32, share=ti.f32, period=ti.f32, middle=vec2, renewal=ti.i32, carried=vec2
)
Moving = namedtuple("Moving", "dt viscosity scale period middle")  # the part of it that `move` reads
# Rows of the workspace: vortices with δ², what `carry` finds, where centres are, and their `VortexDrift`.
Work = columns(
    *("x", "y", "Gamma", "width2", "u", "v"),
    *("start_x", "start_y", "drift_u", "drift_v", "u_rate", "v_rate"),
)


@func
def load(vortex: ti.template(), work: ti.template(), w: ti.i32, scale: ti.f32):
    """Put the vortices of a world into the workspace; lanes without a vortex have no circulation."""
    for v in range(vortex.shape[1]):
        g, n = v // LANES, v % LANES
        delta = vortex[w, v][Vortex.delta] * scale
        for axis in ti.static(range(2)):
            work[w, Work.start_x + axis, g][n] = vortex[w, v][axis] * scale
            work[w, Work.x + axis, g][n] = vortex[w, v][axis] * scale
        work[w, Work.Gamma, g][n] = vortex[w, v][Vortex.Gamma]
        work[w, Work.width2, g][n] = FAR * delta * delta


@func
def gathered(vortex: ti.template(), due: ti.template(), first: ti.i32, v: ti.i32):
    """x, y, Γ and δ of vortex v of worlds in `due`, from the first on; the last one stands for those after it."""
    rows = abreast(0.0), abreast(0.0), abreast(0.0), abreast(0.0)
    for n in ti.static(range(ABREAST)):
        one = vortex[due[ti.min(first + n, due[0])], v]
        for column in ti.static(range(4)):
            rows[column][n] = one[column]
    return rows


@func
def scatter(drift: ti.template(), due: ti.template(), first: ti.i32, v: ti.i32, work: ti.template(), b: ti.i32):
    """Write the `VortexDrift` that is found for what `gathered` reads."""
    rows = [work[b, Work.drift_u + column, v] for column in ti.static(range(4))]
    for n in ti.static(range(ABREAST)):
        drift[due[ti.min(first + n, due[0])], v] = vec4([rows[column][n] for column in ti.static(range(4))])


@func
def within(place, middle, period: ti.f32, scale: ti.f32, repeats: ti.template()):
    """A coordinate of a centre, m; of a periodic pattern, that of the image in the square around its `middle`."""
    if ti.static(repeats):
        away = place - middle
        place = middle + (away - period * ti.floor(away * scale + 0.5))
    return place


@func
def carry(work: ti.template(), w: ti.i32, count: ti.i32, repeats: ti.template()):
    """2πL times the velocities (m/s) of all centres of a world from the vortices, into the workspace.

    Sums are in the order of the vortices. Of a pair, what the second meets is that of the first, turned round.
    """
    lane = ti.Vector(ti.static(list(range(LANES))), ti.i32)
    for g in range(work.shape[2]):
        x, y, width2 = work[w, Work.x, g], work[w, Work.y, g], work[w, Work.width2, g]
        u, v = lanes(0.0), lanes(0.0)
        for n in range(count):
            x_n, y_n = work[w, Work.x, n // LANES][n % LANES], work[w, Work.y, n // LANES][n % LANES]
            Gamma_n, width2_n = work[w, Work.Gamma, n // LANES][n % LANES], work[w, Work.width2, n // LANES][n % LANES]
            sign = ti.select(lane < n - g * LANES, lanes(1.0), lanes(-1.0))
            along_u, along_v = induced(sign * (x - x_n), sign * (y - y_n), width2 + width2_n, repeats)
            u += sign * (Gamma_n * along_u)
            v += sign * (Gamma_n * along_v)
        work[w, Work.u, g] = u
        work[w, Work.v, g] = v


@func
def carry_abreast(work: ti.template(), b: ti.i32, repeats: ti.template()):
    """`carry` where worlds lie side by side, each pair once: the same sums in the same order, so the same bits.

    Sums are written out: `+=` on an array would be an atomic.
    """
    for i in range(work.shape[2]):
        work[b, Work.u, i] = abreast(0.0)
        work[b, Work.v, i] = abreast(0.0)
    for i in range(work.shape[2]):
        x_i, y_i, Gamma_i, width2_i = [work[b, row, i] for row in ti.static((Work.x, Work.y, Work.Gamma, Work.width2))]
        u, v = work[b, Work.u, i], work[b, Work.v, i]
        for j in range(i + 1, work.shape[2]):
            along_u, along_v = induced(
                x_i - work[b, Work.x, j], y_i - work[b, Work.y, j], width2_i + work[b, Work.width2, j], repeats
            )
            u += work[b, Work.Gamma, j] * along_u
            v += work[b, Work.Gamma, j] * along_v
            work[b, Work.u, j] = work[b, Work.u, j] - Gamma_i * along_u
            work[b, Work.v, j] = work[b, Work.v, j] - Gamma_i * along_v
        work[b, Work.u, i] = u
        work[b, Work.v, i] = v


@func
def advance(work: ti.template(), b: ti.i32, stage: ti.i32, step: ti.template()):
    """Bring the centres and widths of a block to where the next stage evaluates velocities."""
    interval = step.dt * step.renewal
    time = ti.select(stage < 2, 0.5, 1.0) * interval  # of the next stage
    weight = ti.select(stage == 0, -5.0, ti.select(stage == 3, 1.0, 2.0)) / (3.0 * interval)
    grown = ti.select(stage == 1, 0.0, 2.0) * step.viscosity * interval * FAR * step.scale * step.scale
    for g in range(work.shape[2]):
        for axis in ti.static(range(2)):
            velocity = step.share * work[b, Work.u + axis, g]
            rate = weight * velocity
            if stage == 0:
                work[b, Work.drift_u + axis, g] = velocity + step.carried[axis]
            else:
                rate += work[b, Work.u_rate + axis, g]
            work[b, Work.u_rate + axis, g] = rate
            work[b, Work.x + axis, g] = work[b, Work.start_x + axis, g] + (time * step.scale) * velocity
        work[b, Work.width2, g] = work[b, Work.width2, g] + grown


@func
def grown(delta, step: ti.template()):
    """Core radius after a step."""
    return ti.sqrt(delta**2 + 4.0 * step.viscosity * step.dt)


@func
def move(vortex: ti.template(), drift: ti.template(), w, v, step: ti.template(), repeats: ti.template()):
    """Vortex v of world w after a step (`Step` or `Moving`), in which its centre moves and its core spreads."""
    for axis in ti.static(range(2)):
        gained = step.dt * drift[w, v, VortexDrift.u_rate + axis]
        place = vortex[w, v, axis] + step.dt * (drift[w, v, axis] + 0.5 * gained)
        vortex[w, v, axis] = within(place, step.middle[axis], step.period, step.scale, repeats)
        drift[w, v, axis] = drift[w, v, axis] + gained
    vortex[w, v, Vortex.delta] = grown(vortex[w, v, Vortex.delta], step)


@func
def move_side_by_side(vortex: ti.template(), drift: ti.template(), row, step: ti.template(), repeats: ti.template()):
    """`move` of LANES // 4 vortices in a row of (…, LANES) arrays, of `Vortex` and `VortexDrift`, bit for bit."""
    quarters = ti.static(LANES // 4)
    along = lanes(ti.static([1.0, 1.0, 0.0, 0.0] * quarters))
    middle = lanes([step.middle[n % 2] for n in ti.static(range(LANES))])
    before, motion = vortex[row], drift[row]
    rate = lanes([motion[n - n % 4 + VortexDrift.u_rate + n % 2] for n in ti.static(range(LANES))])
    gained = step.dt * (along * rate)
    after = before + along * (step.dt * (motion + 0.5 * gained))
    if ti.static(repeats):
        after = select(along > 0.5, within(after, middle, step.period, step.scale, repeats), after)
    if step.viscosity > 0.0:
        for q in ti.static(range(quarters)):
            delta = ti.static(4 * q + Vortex.delta)
            after[delta] = grown(before[delta], step)
    vortex[row] = after
    drift[row] = motion + gained


@kernel
def _renew(
    serial: ti.template(),
    vortex: rows4,
    drift: rows4,
    clock: index2,
    work: blocks3,
    step: Step,
    repeats: ti.template(),
):
    ti.loop_config(serialize=serial)
    for w in range(work.shape[0]):
        if clock[w, 1] % step.renewal == 0:
            load(vortex, work, w, step.scale)
            for stage in range(STAGES):
                carry(work, w, vortex.shape[1], repeats)
                advance(work, w, stage, step)
            for v in range(vortex.shape[1]):
                for column in ti.static(range(4)):
                    drift[w, v][column] = work[w, Work.drift_u + column, v // LANES][v % LANES]


@kernel
def _renew_abreast(
    serial: ti.template(),
    vortex: rows4,
    drift: rows4,
    clock: index2,
    due: index1,
    work: blocks_abreast,
    step: Step,
    repeats: ti.template(),
):
    """`_renew` of ABREAST worlds side by side, bit for bit.

    Args:
        due: (W + 1,) number and indices of the worlds whose `VortexDrift` is renewed; workspace.
    """
    due[0] = 0
    ti.loop_config(serialize=True)
    for w in range(clock.shape[0]):
        if clock[w, 1] % step.renewal == 0:
            count = due[0] + 1
            due[count] = w
            due[0] = count
    ti.loop_config(serialize=serial)
    for b in range((due[0] + ABREAST - 1) // ABREAST):
        first = 1 + b * ABREAST
        for v in range(vortex.shape[1]):
            x, y, Gamma, delta = gathered(vortex, due, first, v)
            place = step.scale * x, step.scale * y
            for axis in ti.static(range(2)):
                work[b, Work.start_x + axis, v] = place[axis]
                work[b, Work.x + axis, v] = place[axis]
            work[b, Work.Gamma, v] = Gamma
            delta = step.scale * delta
            work[b, Work.width2, v] = FAR * delta * delta
        for stage in range(STAGES):
            carry_abreast(work, b, repeats)
            advance(work, b, stage, step)
        for v in range(vortex.shape[1]):
            scatter(drift, due, first, v, work, b)


@kernel
def _renew_each(
    vortex: array3,
    drift: array3,
    clock: index2,
    velocity: array4,
    step: Step,
    repeats: ti.template(),
):
    """`_renew` with a thread for each vortex, and without lanes.

    Args:
        velocity: (STAGES, W, V, 2), of each stage, m/s; workspace.
    """
    for stage in ti.static(range(STAGES)):
        for w, i in ti.ndrange(vortex.shape[0], vortex.shape[1]):
            if clock[w, 1] % step.renewal == 0:
                time = step.dt * step.renewal * ti.static((0.0, 0.5, 0.5, 1.0)[stage])
                x, y = vortex[w, i, Vortex.x], vortex[w, i, Vortex.y]
                if ti.static(stage > 0):
                    x += time * velocity[stage - 1, w, i, 0]
                    y += time * velocity[stage - 1, w, i, 1]
                delta2 = vortex[w, i, Vortex.delta] ** 2 + 8.0 * step.viscosity * time  # with the growth of both cores
                u, v = 0.0, 0.0
                for j in range(vortex.shape[1]):
                    other_x, other_y = vortex[w, j, Vortex.x], vortex[w, j, Vortex.y]
                    if ti.static(stage > 0):
                        other_x += time * velocity[stage - 1, w, j, 0]
                        other_y += time * velocity[stage - 1, w, j, 1]
                    width2 = FAR * step.scale * step.scale * (delta2 + vortex[w, j, Vortex.delta] ** 2)
                    along = step.scale * (x - other_x), step.scale * (y - other_y)
                    along_x, along_y = induced(along[0], along[1], width2, repeats)
                    u += vortex[w, j, Vortex.Gamma] * along_x
                    v += vortex[w, j, Vortex.Gamma] * along_y
                velocity[stage, w, i, 0] = step.share * u
                velocity[stage, w, i, 1] = step.share * v
    for w, i in ti.ndrange(vortex.shape[0], vortex.shape[1]):
        due = clock[w, 1] % step.renewal == 0
        for axis in ti.static(range(2)):
            slopes = ti.Vector([velocity[stage, w, i, axis] for stage in ti.static(range(STAGES))])
            rate = slopes.dot(ti.Vector([-5.0, 2.0, 2.0, 1.0])) / (3.0 * step.dt * step.renewal)
            # What stays is read, because Vulkan takes the whole array back, and sends it only where it is read.
            drift[w, i, axis] = ti.select(due, slopes[0] + step.carried[axis], drift[w, i, axis])
            drift[w, i, VortexDrift.u_rate + axis] = ti.select(due, rate, drift[w, i, VortexDrift.u_rate + axis])


@kernel
def _move(serial: ti.template(), vortex: array3, drift: array3, step: Step, repeats: ti.template()):
    ti.loop_config(serialize=serial)
    for w, v in ti.ndrange(vortex.shape[0], vortex.shape[1]):
        move(vortex, drift, w, v, step, repeats)


def evolution(
    vortex: torch.Tensor,
    dt: float,
    viscosity: float,
    mutual: bool,
    eddies: Eddies = ENDLESS,
    drift: torch.Tensor | None = None,
    clock: torch.Tensor | None = None,
) -> Callable[[], None]:
    """A function that lets vortices spread and move one another for a time, in place.

    A centre moves with uniform acceleration for a time T, the largest multiple of `dt` up to `RENEWAL`, or `dt` itself
    where that is longer. It starts with its velocity at the beginning of T, and ends where the classical Runge–Kutta
    method of fourth order has it after a step of T. The motion is chaotic: errors grow exponentially, those of rounding
    too. In the pattern of `extreme` they are below 2 mm after 100 s (`tests/kernels/flow/test_eddies.py`).
    Source: Hairer, Nørsett and Wanner, "Solving Ordinary Differential Equations I" (1993), §II.1.

    Centres of a periodic pattern that leave its square come in at the opposite side.

    Args:
        vortex: (W, V, 4) float32.
        dt: s; a vortex should not move further than a fraction of a core radius in it.
        viscosity: ν ≥ 0, m²/s.
        mutual: whether the centres move.
        eddies: their period and the speed of their columns.
        drift: (W, V, 4) float32, columns `VortexDrift`; with the vortices it decides their future. Default: kept here.
        clock: (W, 2) int32, in column 1 the steps that each world's vortices have made; default: counted here.
    """
    if drift is None:
        drift = torch.zeros_like(vortex)
    own = clock is None
    if clock is None:
        clock = torch.zeros((len(vortex), 2), dtype=torch.int32, device=vortex.device)
    step = _step(dt, viscosity, eddies)
    renew = renewal(vortex, drift, clock, dt, viscosity, eddies) if mutual else None
    serial = runtime.too_few_for_threads(vortex.shape[0] * vortex.shape[1])
    move_all = Launch(_move, serial, vortex, drift, step, eddies.pattern.repeats)

    def evolve() -> None:
        if renew:
            renew()
        move_all()
        if own:
            clock[:, 1] += 1

    return evolve


def steps_of_renewal(dt: float) -> int:
    """Steps from one renewal of a world's `VortexDrift` to the next."""
    return max(1, int(RENEWAL / dt + 1e-6))


def _step(dt: float, viscosity: float, eddies: Eddies) -> tuple[Any, ...]:
    """Numbers of `Step`."""
    _, scale, share, _ = eddies.pattern
    renewal = steps_of_renewal(dt)
    return dt, viscosity, scale, share * eddies.column, eddies.period, eddies.centre, renewal, eddies.carried


def renewal(
    vortex: torch.Tensor, drift: torch.Tensor, clock: torch.Tensor, dt: float, viscosity: float, eddies: Eddies
) -> Launch:
    """The kernel that renews the motion of vortices where it is due; arguments as of `evolution`."""
    worlds, count = vortex.shape[:2]
    arrays, step, repeats = (vortex, drift, clock), _step(dt, viscosity, eddies), eddies.pattern.repeats
    if not runtime.start().on_cpu:
        velocity = vortex.new_zeros((STAGES, worlds, count, 2))
        return Launch(_renew_each, *arrays, velocity, step, repeats)
    if worlds >= ABREAST * runtime.start().threads:
        work = vortex.new_zeros((-(-worlds // ABREAST), len(Work.names), count, ABREAST))
        due = torch.zeros(worlds + 1, dtype=torch.int32, device=vortex.device)
        settings = {**runtime.vectors_in_registers(), **runtime.fast_compilation()}
        serial = runtime.too_few_for_threads(worlds * count * count // PAIRS_A_MICROSECOND)
        return Launch(_renew_abreast, serial, *arrays, due, work, step, repeats, settings=settings)
    work = vortex.new_zeros((worlds, len(Work.names), -(-count // LANES), LANES))
    work[:, Work.width2] = 1.0  # of lanes without a vortex: `induced` divides by it
    serial = runtime.too_few_for_threads(worlds * count)
    settings = runtime.vectors_in_registers()
    return Launch(_renew, serial, *arrays, work, step, repeats, settings=settings)
