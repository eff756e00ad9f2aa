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

    u − iv = Γ/(2πi) (ζ(z) − π z̄/L²),   ζ(z) = 1/z − Σ_k G_4k z^{4k−1}/L^{4k},

where ζ is Weierstrass' function of the square lattice and G_n = Σ' (m + in)^{−n} are its Eisenstein sums; the pole has
the factor of the core above. Sums over the circle's other multiples vanish by symmetry, as does the constant that a
lattice without this symmetry adds to π z̄/L². The vorticity is that of the core less Γ/L², the divergence 0. With six
terms the velocity jumps by at most 1e-3 Γ/(2πL) where the nearest image changes. Images' cores are left out, an error
of e^{−(L/2δ)²} of the velocity. The centres then follow Hamilton's equations on a torus, so by Liouville's theorem
centres that are uniform and independent once are so for ever: the field is stationary.
Source: Weiss and McWilliams (1991), doi 10.1063/1.858014; Whittaker and Watson, "A Course of Modern Analysis", ch. XX.
"""

import math
from typing import NamedTuple

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.launch import Launch
from usvauv.kernels.types import Columns, array3, columns

LANES = 16  # vortices side by side
PLACES = 8  # places side by side
IMAGES = 6  # terms of ζ besides the pole
FAR = 16.0  # r²/δ² from which on 1 − e^{−r²/δ²} counts as that at 16, within 2e-7 of 1
LEAST = 1e-30  # of r²

lanes = ti.types.vector(LANES, ti.f32)
blocks3 = ti.types.ndarray(dtype=lanes, ndim=3)
places = ti.types.vector(PLACES, ti.f32)


class Eddies(NamedTuple):
    """How the vortices of a world fill the water; compiled into kernels. By default without end, alike at all depths.

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


ENDLESS = Eddies()


def eisenstein_sums(count: int) -> list[float]:
    """G_4, G_8, …, G_4·count of the lattice of whole complex numbers.

    G_4 = Γ(1/4)⁸/(960 π²), and c_n = (2n − 1) G_2n of the series of ℘ has c_n = 3/((2n + 1)(n − 3)) Σ c_m c_{n−m}
    over m from 2 to n − 2. Source: Abramowitz and Stegun, 18.5.3.
    """
    c = {2: 3.0 * math.gamma(0.25) ** 8 / (960.0 * math.pi**2)}
    for n in range(4, 2 * count + 1, 2):
        c[n] = 3.0 / ((2 * n + 1) * (n - 3)) * sum(c[m] * c[n - m] for m in range(2, n - 1, 2))
    return [c[2 * k] / (4 * k - 1) for k in range(1, count + 1)]


EISENSTEIN = tuple(eisenstein_sums(IMAGES))


class Vortex(Columns):
    """A vortex, (W, V, 4)."""

    x: int  # centre, m
    y: int
    Gamma: int  # circulation, m²/s
    delta: int  # core radius, m


# Rows of the workspace of a step, LANES vortices side by side: vortices with δ², what `carry` finds, where centres
# began, and the weighted mean of the stages' velocities.
Work = columns("x", "y", "Gamma", "delta2", "u", "v", "start_x", "start_y", "mean_u", "mean_v")


@func
def core(s):
    """n(s) = 1 − e^{−s} for s ≥ 0, within 4e-7 of itself: a polynomial for n(s/16), and n(2t) = n(t) (2 − n(t))."""
    t = ti.min(s, FAR) * (1.0 / 16.0)
    high = 0.0414065988 - t * (0.00782370753 - t * 0.000907157727)
    n = t * (0.999999921 - t * (0.499994584 - t * (0.166605221 - t * high)))
    for _ in ti.static(range(4)):
        n *= 2.0 - n
    return n


@func
def images(x, y, r2):
    """Real and imaginary part of Σ_k G_4k z^{4k−2} for z = x + iy, r2 = |z|², |x|, |y| ≤ ½.

    The polynomial in q = z⁴ is summed by Horner's rule for real coefficients, b_k = c_k + 2 Re(q) b_{k+1} −
    |q|² b_{k+2} (Knuth, "Seminumerical Algorithms", §4.6.4).
    """
    real, imaginary = x * x - y * y, 2.0 * x * y  # of z²
    r4 = r2 * r2
    size = r4 * r4
    q = r4 - 2.0 * imaginary * imaginary
    after = ti.static(EISENSTEIN[-2]) + 2.0 * q * ti.static(EISENSTEIN[-1])
    b = ti.static(EISENSTEIN[-3]) + 2.0 * q * after - size * ti.static(EISENSTEIN[-1])
    for k in ti.static(range(IMAGES - 4, 0, -1)):
        b, after = ti.static(EISENSTEIN[k]) + 2.0 * q * b - size * after, b
    series, turned = ti.static(EISENSTEIN[0]) + q * b - size * after, 2.0 * real * imaginary * b
    return real * series - imaginary * turned, real * turned + imaginary * series


@func
def nearest(d: ti.f32, period: ti.template()) -> ti.f32:
    """A component of the way from the nearest image of a vortex, from that of the way from any."""
    return d - ti.static(period) * ti.floor(d * ti.static(1.0 / period) + 0.5)


@func
def induced(dx, dy, delta2, period: ti.template()):
    """2πL times the velocity (m/s) at (dx, dy), m, from a vortex of circulation 1 m²/s; L is 1 m without a period.

    Numbers or vectors of numbers, without branches. A vortex adds exactly 0 at its centre.
    """
    per_length = ti.static(1.0 / (period or 1.0))
    x, y = dx * per_length, dy * per_length
    background = ti.static(math.pi if period > 0 else 0.0)
    if ti.static(period > 0):
        x, y = x - ti.floor(x + 0.5), y - ti.floor(y + 0.5)
    r2 = ti.max(x * x + y * y, LEAST)
    turn = core(r2 / (delta2 * ti.static(per_length * per_length))) / r2
    u, v = (background - turn) * y, (turn - background) * x
    if ti.static(period > 0):
        real, imaginary = images(x, y, r2)
        u, v = u - (y * real + x * imaginary), v + (y * imaginary - x * real)
    return u, v


@func
def current(vortex: ti.template(), w: ti.i32, x, y, period: ti.template()):
    """Velocity (u, v) in m/s at the surface at (x, y) in world w: numbers, or vectors of numbers.

    Args:
        vortex: of shape (W, V, 4).
        x, y: m. period: of `Eddies`.
    """
    u, v = 0.0 * x, 0.0 * y
    for n in range(vortex.shape[1]):
        delta2 = vortex[w, n, Vortex.delta] * vortex[w, n, Vortex.delta]
        along_x, along_y = induced(x - vortex[w, n, Vortex.x], y - vortex[w, n, Vortex.y], delta2, period)
        u += vortex[w, n, Vortex.Gamma] * along_x
        v += vortex[w, n, Vortex.Gamma] * along_y
    share = ti.static(0.5 / math.pi / (period or 1.0))
    return share * u, share * v


@func
def load(vortex: ti.template(), work: ti.template(), w: ti.i32):
    """Put the vortices of a world into the workspace, which is filled up with vortices of no circulation."""
    count = vortex.shape[1]
    for g in range(work.shape[2]):
        for c in ti.static(range(4)):
            row = lanes(0.0)
            for n in ti.static(range(LANES)):
                if g * LANES + n < count:
                    row[n] = vortex[w, g * LANES + n, c]
            if ti.static(c == Vortex.delta):
                row *= row
            work[w, c, g] = row
        work[w, Work.start_x, g] = work[w, Work.x, g]
        work[w, Work.start_y, g] = work[w, Work.y, g]
        work[w, Work.mean_u, g] = lanes(0.0)
        work[w, Work.mean_v, g] = lanes(0.0)


@func
def carry(work: ti.template(), w: ti.i32, count: ti.i32, period: ti.template()):
    """2πL times the velocities (m/s) of all centres of a world from the other vortices, into the workspace.

    Each vortex carries those of its own group and of the groups before, and these of groups before carry it.
    Sums are written out: `+=` on an array would be an atomic.
    """
    lane = ti.Vector(ti.static(list(range(LANES))), ti.i32)
    for g in range(work.shape[2]):
        work[w, Work.u, g] = lanes(0.0)
        work[w, Work.v, g] = lanes(0.0)
    for i in range(count):
        own, n = i // LANES, i % LANES
        x, y = work[w, Work.x, own][n], work[w, Work.y, own][n]
        Gamma, delta2 = work[w, Work.Gamma, own][n], work[w, Work.delta2, own][n]
        back_u, back_v = lanes(0.0), lanes(0.0)
        for g in range(own + 1):
            u, v = induced(work[w, Work.x, g] - x, work[w, Work.y, g] - y, work[w, Work.delta2, g] + delta2, period)
            work[w, Work.u, g] = work[w, Work.u, g] + Gamma * u
            work[w, Work.v, g] = work[w, Work.v, g] + Gamma * v
            if g < own:
                back_u += work[w, Work.Gamma, g] * u
                back_v += work[w, Work.Gamma, g] * v
        if own > 0:
            here = ti.select(lane == n, lanes(1.0), lanes(0.0))
            work[w, Work.u, own] = work[w, Work.u, own] - here * back_u.sum()
            work[w, Work.v, own] = work[w, Work.v, own] - here * back_v.sum()


@kernel
def _evolve(
    serial: ti.template(),
    vortex: array3,
    work: blocks3,
    dt: ti.f32,
    viscosity: ti.f32,
    mutual: ti.i32,
    eddies: ti.template(),
):
    ti.loop_config(serialize=serial)
    for w in range(vortex.shape[0]):
        count = vortex.shape[1]
        if mutual != 0:
            load(vortex, work, w)
            for stage in range(4):
                carry(work, w, count, eddies.period)
                weight = ti.select(stage == 1 or stage == 2, 1.0 / 3.0, 1.0 / 6.0)
                time = ti.select(stage == 2, dt, 0.5 * dt)
                grown = 4.0 * viscosity * (time - ti.select(stage == 0, 0.0, 0.5 * dt))
                share = ti.static(0.5 / math.pi / (eddies.period or 1.0) * eddies.column)
                for g in range(work.shape[2]):
                    for axis in ti.static(range(2)):
                        velocity = share * work[w, Work.u + axis, g]
                        work[w, Work.mean_u + axis, g] = work[w, Work.mean_u + axis, g] + weight * velocity
                        work[w, Work.x + axis, g] = work[w, Work.start_x + axis, g] + time * velocity
                    work[w, Work.delta2, g] = work[w, Work.delta2, g] + grown
            for v in range(count):
                for axis in ti.static(range(2)):
                    place = vortex[w, v, axis] + dt * work[w, Work.mean_u + axis, v // LANES][v % LANES]
                    if ti.static(eddies.period > 0):
                        middle = ti.static(eddies.centre[axis])
                        place = middle + nearest(place - middle, eddies.period)
                    vortex[w, v, axis] = place
        for v in range(count):
            delta = vortex[w, v, Vortex.delta]
            vortex[w, v, Vortex.delta] = ti.sqrt(delta * delta + 4.0 * viscosity * dt)


@kernel
def _sample_current(
    vortex: array3,
    points: array3,
    out: array3,
    period: ti.template(),
):
    for w, g in ti.ndrange(points.shape[0], (points.shape[1] + PLACES - 1) // PLACES):
        x, y = places(0.0), places(0.0)
        for n in ti.static(range(PLACES)):
            point = ti.min(g * PLACES + n, points.shape[1] - 1)
            x[n], y[n] = points[w, point, 0], points[w, point, 1]
        u, v = current(vortex, w, x, y, period)
        for n in ti.static(range(PLACES)):
            point = ti.min(g * PLACES + n, points.shape[1] - 1)
            out[w, point, 0], out[w, point, 1] = u[n], v[n]


def evolution(vortex: torch.Tensor, dt: float, viscosity: float, mutual: bool, eddies: Eddies = ENDLESS) -> Launch:
    """A launch that lets vortices spread and move one another for a time, in place: classical Runge–Kutta method.

    Centres of a periodic pattern that leave its square come in at the opposite side.

    Args:
        vortex: (W, V, 4) float32.
        dt: s; a vortex should not move further than a fraction of a core radius in it.
        viscosity: ν ≥ 0, m²/s.
        mutual: whether the centres move.
        eddies: their period and the speed of their columns.
    """
    worlds, count = vortex.shape[:2]
    work = vortex.new_zeros((worlds, len(Work.names), -(-count // LANES), LANES))
    serial = runtime.better_alone(worlds * count)
    settings = runtime.vectors_in_registers()
    return Launch(_evolve, serial, vortex, work, dt, viscosity, int(mutual), eddies, settings=settings)


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
        _sample_current(vortex.contiguous(), points.contiguous(), out, period)
    return out
