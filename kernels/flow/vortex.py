"""Currents of superposed Lamb–Oseen vortices (Eq. 8, with the sign of V_y that makes the printed vorticity its curl).

    V_x = −Γ (y − y0)/(2π r²) (1 − e^{−r²/δ²}),   V_y = +Γ (x − x0)/(2π r²) (1 − e^{−r²/δ²}),
    ϖ = ∂V_y/∂x − ∂V_x/∂y = Γ/(π δ²) e^{−r²/δ²},  ∇·V = 0.

A vortex is four numbers (x0, y0, Γ, δ): centre (m), circulation (m²/s, positive anticlockwise), core radius (m).
Its peak speed is 0.6382 Γ/(2πδ) at r = 1.1209 δ. Source: Lamb, "Hydrodynamics" (6th ed.), §334a.

With a viscosity ν a core spreads, dδ²/dt = 4ν, and the circulation stays: a lone vortex is then an exact solution of
the Navier–Stokes equations. Where vortices carry one another, a centre moves with the mean of the others' velocity over
the vorticity of its own core, which is the velocity of a vortex with δ² = δ_i² + δ_j² at the centre (a Gaussian folded
with a Gaussian). That is the exact motion of the centroid of a circular core (Euler's equations, first moment), and it
keeps the impulse Σ Γ_i X_i and, in ideal fluid, the energy; cores do not deform.

In a pattern that repeats with the period L in x and y (`Eddies.period`) a vortex stands for all its images, on the
uniform vorticity −Γ/L² without which a periodic field cannot be. In complex form, with z = x + iy from the vortex to
the nearest image, |x|, |y| ≤ L/2:

    u − iv = Γ/(2πi) (ζ(z) − π z̄/L²),   ζ(z) = 1/z − Σ_k c_k z^{4k−1}/L^{4k},

where ζ is Weierstrass' function of the square lattice; the pole has the factor of the core above. Of its series, with
the Eisenstein sums G_4k = Σ' (m + in)^{−4k} for c_k, four terms would be off by 4.4e-3 Γ/(2πL) in the square's corners;
fitted to ζ on the square's edge in the uniform norm, where the error of an analytic function is greatest, four are off
by 1.3e-4 at most, and by twice that the velocity jumps where the nearest image changes. Sums over the circle's other
multiples vanish by symmetry, as does the constant that a lattice without this symmetry adds to π z̄/L². The vorticity is
that of the core less Γ/L², the divergence 0, whatever the c_k. Images' cores are left out, an error
of e^{−(L/2δ)²} of the velocity. The centres then follow Hamilton's equations on a torus, so by Liouville's theorem
centres that are uniform and independent once are so for ever: the field is stationary.
Source: Weiss and McWilliams (1991), doi 10.1063/1.858014; Whittaker and Watson, "A Course of Modern Analysis", ch. XX.
"""

import math
from typing import Any, NamedTuple

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.flow.airy import LANES, lanes, total
from usvauv.kernels.functions import Launch, func, kernel
from usvauv.kernels.types import Columns, array3, array4, columns, vec2, vec4

PLACES = 8  # places side by side
ABREAST = 32  # worlds side by side: enough independent numbers that the processor need not wait for any
IMAGES = 3.15120262, 4.25286493, 3.82483015, 2.82903353  # c_k of ζ
FAR = 16.0  # r²/δ² from which on 1 − e^{−r²/δ²} counts as that at 16, within 2e-7 of 1
LEAST = 1e-18  # added to r², whose square is a number then

blocks3 = ti.types.ndarray(dtype=lanes, ndim=3)
places = ti.types.vector(PLACES, ti.f32)
abreast = ti.types.vector(ABREAST, ti.f32)
rows4 = ti.types.ndarray(dtype=vec4, ndim=2)
blocks_abreast = ti.types.ndarray(dtype=abreast, ndim=3)


class Pattern(NamedTuple):
    """What a function needs of `Eddies` to compute a velocity.

    Attributes:
        repeats: whether there is a period; compiled into kernels.
        scale: by which `induced` measures lengths: 1/L, 1/m; 1 without a period.
        share: velocity over what `induced` gives: 1/(2πL), 1/m; 1/(2π) without a period.
        cruise: as of `Eddies`.
    """

    repeats: bool
    scale: Any
    share: Any
    cruise: Any = 1.0


class Eddies(NamedTuple):
    """How the vortices of a world fill the water. By default without end, alike at all depths.

    Attributes:
        period: L of the pattern in x and y, m; 0: the vortices have no images.
        centre: of the square of side L that holds the vortices, m.
        cruise: velocity at cruise depth over that at the surface, 1.
        column: velocity with which the vortices carry one another over that at the surface, 1.
    """

    period: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)
    cruise: float = 1.0
    column: float = 1.0

    @property
    def pattern(self) -> Pattern:
        """For kernels."""
        length = self.period or 1.0
        return Pattern(self.period > 0, 1.0 / length, 0.5 / math.pi / length, self.cruise)


ENDLESS = Eddies()


class Vortex(Columns):
    """A vortex, (W, V, 4)."""

    x: int  # centre, m
    y: int
    Gamma: int  # circulation, m²/s
    delta: int  # core radius, m


# Rows of the workspace of a step: vortices with δ², what `carry` finds, where centres began, the weighted mean of the
# stages' velocities, and a part of what `carry_abreast` finds.
Work = columns("x", "y", "Gamma", "width2", "u", "v", "start_x", "start_y", "mean_u", "mean_v", "back_u", "back_v")


@func
def core(t):
    """n = 1 − e^{−16t} for t ≥ 0, within 4e-7 of itself: a polynomial for 1 − e^{−t}, and n(2t) = n(t) (2 − n(t))."""
    t = ti.min(t, 1.0)
    high = 0.0414065988 - t * (0.00782370753 - t * 0.000907157727)
    n = t * (0.999999921 - t * (0.499994584 - t * (0.166605221 - t * high)))
    for _ in ti.static(range(4)):
        n *= 2.0 - n
    return n


@func
def images(x, y, real, r4):
    """Real and imaginary part of Σ_k c_k z^{4k−2} for z = x + iy, with x² − y² and |z|⁴, |x|, |y| ≤ ½.

    The polynomial in q = z⁴ is summed by Horner's rule for real coefficients, b_k = c_k + 2 Re(q) b_{k+1} −
    |q|² b_{k+2} (Knuth, "Seminumerical Algorithms", §4.6.4).
    """
    imaginary = (x + x) * y  # of z², as `real`
    size = r4 * r4
    half = imaginary * imaginary
    q = r4 - (half + half)
    q2 = q + q
    b3 = ti.static(IMAGES[2]) + q2 * ti.static(IMAGES[3])
    b2 = ti.static(IMAGES[1]) + q2 * b3 - size * ti.static(IMAGES[3])
    series, turned = ti.static(IMAGES[0]) + q * b2 - size * b3, (real + real) * imaginary * b2
    return real * series - imaginary * turned, real * turned + imaginary * series


@func
def induced(x, y, width2, repeats: ti.template()):
    """2πL times the velocity (m/s) at (x, y) from a vortex of circulation 1 m²/s.

    Numbers or vectors of numbers, without branches. A vortex adds exactly 0 at its centre.

    Args:
        x, y: over L. width2: `FAR` δ²/L². repeats: of `Pattern`.
    """
    if ti.static(repeats):
        x, y = x - ti.floor(x + 0.5), y - ti.floor(y + 0.5)
    x2, y2 = x * x, y * y
    r2 = x2 + y2 + LEAST
    u, v = x, y
    if ti.static(repeats):
        r4 = r2 * r2
        share = 1.0 / (r2 * width2)  # one division in place of two
        turn = math.pi - core(r4 * share) * (width2 * share)
        real, imaginary = images(x, y, x2 - y2, r4)
        u, v = (turn - real) * y - x * imaginary, y * imaginary - (turn + real) * x
    else:
        turn = core(r2 / width2) / r2
        u, v = (0.0 - turn) * y, turn * x
    return u, v


@func
def current(vortex: ti.template(), w: ti.i32, x, y, pattern: ti.template()):
    """Velocity (u, v) in m/s at the surface at (x, y) in world w: numbers, or vectors of numbers.

    Args:
        vortex: of shape (W, V, 4).
        x, y: m. pattern: of the vortices.
    """
    scale, share = pattern.scale, pattern.share
    x, y = x * scale, y * scale
    u, v = 0.0 * x, 0.0 * y
    for n in range(vortex.shape[1]):
        delta = vortex[w, n, Vortex.delta] * scale
        x_n, y_n = vortex[w, n, Vortex.x] * scale, vortex[w, n, Vortex.y] * scale
        along_x, along_y = induced(x - x_n, y - y_n, FAR * delta * delta, pattern.repeats)
        u += vortex[w, n, Vortex.Gamma] * along_x
        v += vortex[w, n, Vortex.Gamma] * along_y
    return share * u, share * v


@func
def load(vortex: ti.template(), work: ti.template(), w: ti.i32, scale: ti.f32):
    """Put the vortices of a world into the workspace; lanes without a vortex have no circulation."""
    for v in range(vortex.shape[1]):
        g, n = v // LANES, v % LANES
        delta = vortex[w, v, Vortex.delta] * scale
        work[w, Work.start_x, g][n] = vortex[w, v, Vortex.x] * scale
        work[w, Work.start_y, g][n] = vortex[w, v, Vortex.y] * scale
        work[w, Work.Gamma, g][n] = vortex[w, v, Vortex.Gamma]
        work[w, Work.width2, g][n] = FAR * delta * delta


@func
def gathered(vortex: ti.template(), first: ti.i32, v: ti.i32):
    """x, y, Γ and δ of vortex v of worlds from the first on; those after the last world repeat it."""
    last = vortex.shape[0] - 1
    rows = abreast(0.0), abreast(0.0), abreast(0.0), abreast(0.0)
    for n in ti.static(range(ABREAST)):
        one = vortex[ti.min(first + n, last), v]
        for column in ti.static(range(4)):
            rows[column][n] = one[column]
    return rows


@func
def scatter(vortex: ti.template(), first: ti.i32, v: ti.i32, x, y, Gamma, delta):
    """Write what `gathered` reads."""
    last = vortex.shape[0] - 1
    for n in ti.static(range(ABREAST)):
        vortex[ti.min(first + n, last), v] = vec4(x[n], y[n], Gamma[n], delta[n])


@func
def within(place, middle: ti.f32, period: ti.f32, scale: ti.f32, repeats: ti.template()):
    """A coordinate of a centre, m; of a periodic pattern, that of the image in the square around its `middle`."""
    if ti.static(repeats):
        away = place - middle
        place = middle + (away - period * ti.floor(away * scale + 0.5))
    return place


@func
def passed_on(row: lanes, size: ti.i32) -> lanes:
    """The first lanes of a row as a ring of some size, each with what the next one had."""
    lane = ti.Vector(ti.static(list(range(LANES))), ti.i32)
    moved = ti.Vector([row[(n + 1) % LANES] for n in ti.static(range(LANES))])
    return ti.select(lane == size - 1, lanes(row[0]), moved)


@func
def carry(work: ti.template(), w: ti.i32, count: ti.i32, repeats: ti.template()):
    """2πL times the velocities (m/s) of all centres of a world from the other vortices, into the workspace.

    Each pair is met once. In a group of lanes the vortices stand in a ring: its copy is passed on by one lane a time,
    half way round, and collects what its own vortices owe to those that they meet. Each vortex also carries the groups
    before its own, and these carry it. Sums are written out: `+=` on an array would be an atomic.
    """
    lane = ti.Vector(ti.static(list(range(LANES))), ti.i32)
    for g in range(work.shape[2]):
        size = ti.min(count - g * LANES, LANES)
        x, y = work[w, Work.x, g], work[w, Work.y, g]
        Gamma, width2 = work[w, Work.Gamma, g], work[w, Work.width2, g]
        met_x, met_y, met_Gamma, met_width2 = x, y, Gamma, width2
        u, v, back_u, back_v = lanes(0.0), lanes(0.0), lanes(0.0), lanes(0.0)
        for turn in range(1, size + 1):  # the last one brings the copy home
            met_x, met_y = passed_on(met_x, size), passed_on(met_y, size)
            met_Gamma, met_width2 = passed_on(met_Gamma, size), passed_on(met_width2, size)
            back_u, back_v = passed_on(back_u, size), passed_on(back_v, size)
            if 2 * turn <= size:
                along_u, along_v = induced(x - met_x, y - met_y, width2 + met_width2, repeats)
                u += met_Gamma * along_u
                v += met_Gamma * along_v
                if 2 * turn < size:  # else both of a pair meet the other
                    back_u = back_u - Gamma * along_u
                    back_v = back_v - Gamma * along_v
        u += back_u
        v += back_v
        if g > 0:
            for n in range(size):
                x_n, y_n = work[w, Work.x, g][n], work[w, Work.y, g][n]
                Gamma_n, width2_n = work[w, Work.Gamma, g][n], work[w, Work.width2, g][n]
                back_u, back_v = lanes(0.0), lanes(0.0)
                for h in range(g):
                    x_h, y_h, width2_h = work[w, Work.x, h], work[w, Work.y, h], work[w, Work.width2, h]
                    Gamma_h, u_h, v_h = work[w, Work.Gamma, h], work[w, Work.u, h], work[w, Work.v, h]
                    along_u, along_v = induced(x_h - x_n, y_h - y_n, width2_h + width2_n, repeats)
                    back_u += Gamma_h * along_u
                    back_v += Gamma_h * along_v
                    work[w, Work.u, h] = u_h + Gamma_n * along_u
                    work[w, Work.v, h] = v_h + Gamma_n * along_v
                here = ti.select(lane == n, lanes(1.0), lanes(0.0))
                u = u - here * total(back_u)
                v = v - here * total(back_v)
        work[w, Work.u, g] = u
        work[w, Work.v, g] = v


@func
def add(work: ti.template(), b: ti.i32, column: ti.template(), i: ti.i32, more):
    """Add to both components of a velocity in the workspace; `+=` on an array would be an atomic."""
    for axis in ti.static(range(2)):
        work[b, column + axis, i] = work[b, column + axis, i] + more[axis]


@func
def carry_abreast(work: ti.template(), b: ti.i32, repeats: ti.template()):
    """`carry` where worlds lie side by side: the same sums in the same order, so the same bits."""
    count = work.shape[2]
    for g in range((count + LANES - 1) // LANES):
        first, end = g * LANES, ti.min((g + 1) * LANES, count)
        for i in range(first, end):
            for axis in ti.static(range(2)):
                work[b, Work.u + axis, i] = abreast(0.0)
                work[b, Work.back_u + axis, i] = abreast(0.0)
        for turn in range(1, (end - first) // 2 + 1):
            for i in range(first, end):
                j = i + turn
                if j >= end:
                    j -= end - first
                x, y = work[b, Work.x, i] - work[b, Work.x, j], work[b, Work.y, i] - work[b, Work.y, j]
                u, v = induced(x, y, work[b, Work.width2, i] + work[b, Work.width2, j], repeats)
                Gamma_i, Gamma_j = work[b, Work.Gamma, i], work[b, Work.Gamma, j]
                add(work, b, Work.u, i, (Gamma_j * u, Gamma_j * v))
                if 2 * turn < end - first:  # else both of a pair meet the other
                    add(work, b, Work.back_u, j, (0.0 - Gamma_i * u, 0.0 - Gamma_i * v))
        for i in range(first, end):
            add(work, b, Work.u, i, (work[b, Work.back_u, i], work[b, Work.back_v, i]))
        for i in range(first, ti.select(g > 0, end, first)):
            # The rows `back` of the first group collect what the lanes of `carry` do.
            for lane in range(LANES):
                for axis in ti.static(range(2)):
                    work[b, Work.back_u + axis, lane] = abreast(0.0)
            x_i, y_i = work[b, Work.x, i], work[b, Work.y, i]
            Gamma_i, width2_i = work[b, Work.Gamma, i], work[b, Work.width2, i]
            for j in range(first):
                x, y = work[b, Work.x, j] - x_i, work[b, Work.y, j] - y_i
                u, v = induced(x, y, work[b, Work.width2, j] + width2_i, repeats)
                Gamma_j = work[b, Work.Gamma, j]
                add(work, b, Work.back_u, j % LANES, (Gamma_j * u, Gamma_j * v))
                add(work, b, Work.u, j, (Gamma_i * u, Gamma_i * v))
            for half in ti.static((8, 4, 2, 1)):  # as `total`
                for lane in range(half):
                    back = work[b, Work.back_u, lane + half], work[b, Work.back_v, lane + half]
                    add(work, b, Work.back_u, lane, back)
            add(work, b, Work.u, i, (0.0 - work[b, Work.back_u, 0], 0.0 - work[b, Work.back_v, 0]))


@func
def advance(work: ti.template(), b: ti.i32, stage: ti.i32, dt: ti.f32, viscosity: ti.f32, scale: ti.f32, share: ti.f32):
    """Bring the centres and widths of a block to where the next stage evaluates velocities."""
    weight = (stage + 2.0) / 9.0
    time = dt * (stage + 2.0) / 4.0  # of the next stage
    grown = ti.select(stage == 0, 2.0, 1.0) * viscosity * dt * FAR * scale * scale
    for g in range(work.shape[2]):
        for axis in ti.static(range(2)):
            velocity = share * work[b, Work.u + axis, g]
            work[b, Work.mean_u + axis, g] = work[b, Work.mean_u + axis, g] + weight * velocity
            work[b, Work.x + axis, g] = work[b, Work.start_x + axis, g] + (time * scale) * velocity
        work[b, Work.width2, g] = work[b, Work.width2, g] + grown


@kernel
def _evolve(
    serial: ti.template(),
    vortex: array3,
    work: blocks3,
    dt: ti.f32,
    viscosity: ti.f32,
    mutual: ti.i32,
    scale: ti.f32,
    share: ti.f32,
    period: ti.f32,
    middle: vec2,
    repeats: ti.template(),
):
    ti.loop_config(serialize=serial)
    for w in range(work.shape[0]):
        if mutual != 0:
            load(vortex, work, w, scale)
            for g in range(work.shape[2]):
                for axis in ti.static(range(2)):
                    work[w, Work.x + axis, g] = work[w, Work.start_x + axis, g]
                    work[w, Work.mean_u + axis, g] = lanes(0.0)
            for stage in range(3):
                carry(work, w, vortex.shape[1], repeats)
                advance(work, w, stage, dt, viscosity, scale, share)
        for v in range(vortex.shape[1]):
            if mutual != 0:
                for axis in ti.static(range(2)):
                    place = vortex[w, v, axis] + dt * work[w, Work.mean_u + axis, v // LANES][v % LANES]
                    vortex[w, v, axis] = within(place, middle[axis], period, scale, repeats)
            delta = vortex[w, v, Vortex.delta]
            vortex[w, v, Vortex.delta] = ti.sqrt(delta * delta + 4.0 * viscosity * dt)


@kernel
def _evolve_abreast(
    vortex: rows4,
    work: blocks_abreast,
    dt: ti.f32,
    viscosity: ti.f32,
    scale: ti.f32,
    share: ti.f32,
    period: ti.f32,
    middle: vec2,
    repeats: ti.template(),
):
    """`_evolve` of centres that move, ABREAST worlds side by side, bit for bit."""
    for b in range(work.shape[0]):
        first = b * ABREAST
        for v in range(vortex.shape[1]):
            x, y, Gamma, delta = gathered(vortex, first, v)
            start = scale * x, scale * y
            for axis in ti.static(range(2)):
                work[b, Work.start_x + axis, v] = start[axis]
                work[b, Work.x + axis, v] = start[axis]
                work[b, Work.mean_u + axis, v] = abreast(0.0)
            work[b, Work.Gamma, v] = Gamma
            delta = scale * delta
            work[b, Work.width2, v] = FAR * delta * delta
        for stage in range(3):
            carry_abreast(work, b, repeats)
            advance(work, b, stage, dt, viscosity, scale, share)
        for v in range(vortex.shape[1]):
            x, y, Gamma, delta = gathered(vortex, first, v)
            x = within(x + dt * work[b, Work.mean_u, v], middle[0], period, scale, repeats)
            y = within(y + dt * work[b, Work.mean_v, v], middle[1], period, scale, repeats)
            scatter(vortex, first, v, x, y, Gamma, ti.sqrt(delta * delta + 4.0 * viscosity * dt))


@kernel
def _evolve_each(
    vortex: array3,
    velocity: array4,
    dt: ti.f32,
    viscosity: ti.f32,
    mutual: ti.template(),
    scale: ti.f32,
    share: ti.f32,
    period: ti.f32,
    middle: vec2,
    repeats: ti.template(),
):
    """`_evolve` with a thread for each vortex, and without lanes.

    Args:
        velocity: (3, W, V, 2), of each stage, m/s; workspace.
    """
    for stage in ti.static(range(3 if mutual else 0)):
        for w, i in ti.ndrange(vortex.shape[0], vortex.shape[1]):
            time = dt * ti.static((0.0, 0.5, 0.75)[stage])
            x, y = vortex[w, i, Vortex.x], vortex[w, i, Vortex.y]
            if ti.static(stage > 0):
                x += time * velocity[stage - 1, w, i, 0]
                y += time * velocity[stage - 1, w, i, 1]
            delta2 = vortex[w, i, Vortex.delta] ** 2 + 8.0 * viscosity * time  # with the growth of both cores
            u, v = 0.0, 0.0
            for j in range(vortex.shape[1]):
                other_x, other_y = vortex[w, j, Vortex.x], vortex[w, j, Vortex.y]
                if ti.static(stage > 0):
                    other_x += time * velocity[stage - 1, w, j, 0]
                    other_y += time * velocity[stage - 1, w, j, 1]
                width2 = FAR * scale * scale * (delta2 + vortex[w, j, Vortex.delta] ** 2)
                along_x, along_y = induced(scale * (x - other_x), scale * (y - other_y), width2, repeats)
                u += vortex[w, j, Vortex.Gamma] * along_x
                v += vortex[w, j, Vortex.Gamma] * along_y
            velocity[stage, w, i, 0] = share * u
            velocity[stage, w, i, 1] = share * v
    for w, i in ti.ndrange(vortex.shape[0], vortex.shape[1]):
        if ti.static(mutual):
            for axis in ti.static(range(2)):
                slopes = ti.Vector([velocity[stage, w, i, axis] for stage in ti.static(range(3))])
                place = vortex[w, i, axis] + dt / 9.0 * slopes.dot(ti.Vector([2.0, 3.0, 4.0]))
                vortex[w, i, axis] = within(place, middle[axis], period, scale, repeats)
        vortex[w, i, Vortex.delta] = ti.sqrt(vortex[w, i, Vortex.delta] ** 2 + 4.0 * viscosity * dt)


@kernel
def _sample_current(
    vortex: array3,
    points: array3,
    out: array3,
    repeats: ti.template(),
    scale: ti.f32,
    share: ti.f32,
):
    for w, g in ti.ndrange(points.shape[0], (points.shape[1] + PLACES - 1) // PLACES):
        x, y = places(0.0), places(0.0)
        for n in ti.static(range(PLACES)):
            point = ti.min(g * PLACES + n, points.shape[1] - 1)
            x[n], y[n] = points[w, point, 0], points[w, point, 1]
        u, v = current(vortex, w, x, y, ti.static(Pattern(repeats, scale, share)))
        for n in ti.static(range(PLACES)):
            point = ti.min(g * PLACES + n, points.shape[1] - 1)
            out[w, point, 0], out[w, point, 1] = u[n], v[n]


def evolution(vortex: torch.Tensor, dt: float, viscosity: float, mutual: bool, eddies: Eddies = ENDLESS) -> Launch:
    """A launch that lets vortices spread and move one another for a time, in place.

    By Ralston's method of third order: k₁ at the start, k₂ where ½ Δt k₁ leads, k₃ where ¾ Δt k₂ does, and then
    Δt (2 k₁ + 3 k₂ + 4 k₃)/9. The motion is chaotic: errors grow exponentially, those of rounding to single precision
    too. In steps of 1 s of `extreme` the method's own are of the size of those of rounding.
    Source: Ralston (1962), doi 10.1090/S0025-5718-1962-0150954-0.

    Centres of a periodic pattern that leave its square come in at the opposite side.

    Args:
        vortex: (W, V, 4) float32.
        dt: s; a vortex should not move further than a fraction of a core radius in it.
        viscosity: ν ≥ 0, m²/s.
        mutual: whether the centres move.
        eddies: their period and the speed of their columns.
    """
    worlds, count = vortex.shape[:2]
    repeats, scale, share, _ = eddies.pattern
    numbers = scale, share * eddies.column, eddies.period, eddies.centre, repeats
    if not runtime.start().on_cpu:
        velocity = vortex.new_zeros((3, worlds, count, 2))
        return Launch(_evolve_each, vortex, velocity, dt, viscosity, bool(mutual), *numbers)
    if mutual and worlds >= ABREAST * runtime.start().threads:
        work = vortex.new_zeros((-(-worlds // ABREAST), len(Work.names), count, ABREAST))
        settings = {**runtime.vectors_in_registers(), **runtime.quickly()}
        return Launch(_evolve_abreast, vortex, work, dt, viscosity, *numbers, settings=settings)
    work = vortex.new_zeros((worlds, len(Work.names), -(-count // LANES), LANES))
    work[:, Work.width2] = 1.0  # of lanes without a vortex: `induced` divides by it
    serial = runtime.better_alone(worlds * count)
    settings = runtime.vectors_in_registers()
    return Launch(_evolve, serial, vortex, work, dt, viscosity, int(mutual), *numbers, settings=settings)


def sample_current(vortex: torch.Tensor, points: torch.Tensor, period: float = 0.0) -> torch.Tensor:
    """Velocity at many points at the surface.

    Args:
        vortex: (W, V, 4) float32, rows (x0, y0, Γ, δ) in m, m, m²/s, m; V may be 0.
        points: (W, P, 2) float32, positions in m.
        period: of `Eddies`, m.

    Returns:
        (W, P, 2) float32, (V_x, V_y) in m/s.
    """
    out = torch.zeros_like(points)
    if vortex.shape[1]:
        _sample_current(vortex.contiguous(), points.contiguous(), out, *Eddies(period).pattern[:3])
    return out
