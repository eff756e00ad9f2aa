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
from usvauv.kernels.types import Columns, array3, vec2

TWO_PI = 6.283185307179586
IMAGES = 6  # terms of ζ besides the pole
FAR = 17.4  # r²/δ² from which on 1 − e^{−r²/δ²} is 1 in single precision


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


class Work(Columns):
    """Workspace of a step of a vortex, (W, V, 7)."""

    x: int  # centre at the beginning, m
    y: int
    delta2: int  # δ² at the beginning, m²
    u: int  # velocity of the centre in a stage, m/s
    v: int
    mean_u: int  # weighted mean of the stages' velocities, m/s
    mean_v: int


@func
def core_factor(s: ti.f32) -> ti.f32:
    """(1 − e^{−s})/s for s ≥ 0, which is 1 at s = 0: a series where the difference would cancel in single precision."""
    value = 0.0
    if s > FAR:
        value = 1.0 / s
    elif s > 0.25:
        value = (1.0 - ti.exp(-s)) / s
    else:
        value = 1.0 - s / 2.0 * (1.0 - s / 3.0 * (1.0 - s / 4.0 * (1.0 - s / 5.0 * (1.0 - s / 6.0))))
    return value


@func
def core_squared(vortex: ti.template(), w: ti.i32, v: ti.i32) -> ti.f32:
    """δ² of vortex v, m²."""
    return vortex[w, v, Vortex.delta] * vortex[w, v, Vortex.delta]


@func
def nearest(d: ti.f32, period: ti.template()) -> ti.f32:
    """A component of the way from the nearest image of a vortex, from that of the way from any."""
    way = d
    if ti.static(period > 0):
        turns = d * ti.static(1.0 / period if period > 0 else 0.0)
        way -= period * ti.cast(turns + ti.select(turns < 0.0, -0.5, 0.5), ti.i32)  # ti.round is a call
    return way


@func
def images(dx: ti.f32, dy: ti.f32, period: ti.template()) -> vec2:
    """What the images of a vortex of circulation 1 m²/s and the background add to its velocity (m/s) at (dx, dy).

    The polynomial in q = (z/L)⁴ is summed by Horner's rule for real coefficients, b_k = c_k + 2 Re(q) b_{k+1} − |q|²
    b_{k+2} (Knuth, "Seminumerical Algorithms", §4.6.4).
    """
    x, y = dx * ti.static(1.0 / period), dy * ti.static(1.0 / period)
    square = vec2(x * x - y * y, 2.0 * x * y)  # z²
    q = vec2(square[0] * square[0] - square[1] * square[1], 2.0 * square[0] * square[1])
    size = q[0] * q[0] + q[1] * q[1]
    b = vec2(ti.static(EISENSTEIN[-1]), 0.0)  # of k and k + 1
    for k in ti.static(range(IMAGES - 2, 0, -1)):
        b = vec2(ti.static(EISENSTEIN[k]) + 2.0 * q[0] * b[0] - size * b[1], b[0])
    series = vec2(ti.static(EISENSTEIN[0]) - size * b[1] + q[0] * b[0], q[1] * b[0])
    cube = vec2(x * square[0] - y * square[1], x * square[1] + y * square[0])
    # W of u − iv = W/(2πiL), so u = Im W/(2πL) and v = Re W/(2πL).
    W = vec2(
        -math.pi * x - cube[0] * series[0] + cube[1] * series[1],
        math.pi * y - cube[0] * series[1] - cube[1] * series[0],
    )
    return vec2(W[1], W[0]) * ti.static(1.0 / (TWO_PI * period))


@func
def current(vortex: ti.template(), w: ti.i32, x: ti.f32, y: ti.f32, period: ti.template()) -> vec2:
    """Velocity (m/s) at the surface at (x, y) in world w; `vortex` has shape (W, V, 4), `period` is of `Eddies`."""
    V = vec2(0.0, 0.0)
    for v in range(vortex.shape[1]):
        dx = nearest(x - vortex[w, v, Vortex.x], period)
        dy = nearest(y - vortex[w, v, Vortex.y], period)
        Gamma = vortex[w, v, Vortex.Gamma]
        delta2 = core_squared(vortex, w, v)
        rotation = Gamma / (TWO_PI * delta2) * core_factor((dx * dx + dy * dy) / delta2)
        V += vec2(-rotation * dy, rotation * dx)
        if ti.static(period > 0):
            V += Gamma * images(dx, dy, period)
    return V


@func
def mutual_velocities(vortex: ti.template(), work: ti.template(), w: ti.i32, period: ti.template()):
    """Velocities (m/s) of all centres of a world by the other vortices, into `work`.

    Sums are written out: `+=` on an array would be an atomic.
    """
    for v in range(vortex.shape[1]):
        x = vortex[w, v, Vortex.x]
        y = vortex[w, v, Vortex.y]
        Gamma = vortex[w, v, Vortex.Gamma]
        own = core_squared(vortex, w, v)
        V = vec2(0.0, 0.0)
        for other in range(v):
            dx = nearest(x - vortex[w, other, Vortex.x], period)
            dy = nearest(y - vortex[w, other, Vortex.y], period)
            delta2 = own + core_squared(vortex, w, other)
            turn = core_factor((dx * dx + dy * dy) / delta2) / (TWO_PI * delta2)
            V += vortex[w, other, Vortex.Gamma] * turn * vec2(-dy, dx)
            work[w, other, Work.u] = work[w, other, Work.u] + Gamma * turn * dy
            work[w, other, Work.v] = work[w, other, Work.v] - Gamma * turn * dx
            if ti.static(period > 0):
                more = images(dx, dy, period)
                V += vortex[w, other, Vortex.Gamma] * more
                work[w, other, Work.u] = work[w, other, Work.u] - Gamma * more[0]
                work[w, other, Work.v] = work[w, other, Work.v] - Gamma * more[1]
        work[w, v, Work.u] = V[0]
        work[w, v, Work.v] = V[1]


@kernel
def _evolve(
    serial: ti.template(),
    vortex: array3,
    work: array3,
    dt: ti.f32,
    viscosity: ti.f32,
    mutual: ti.i32,
    eddies: ti.template(),
):
    ti.loop_config(serialize=serial)
    for w in range(vortex.shape[0]):
        for v in range(vortex.shape[1]):
            work[w, v, Work.x] = vortex[w, v, Vortex.x]
            work[w, v, Work.y] = vortex[w, v, Vortex.y]
            work[w, v, Work.delta2] = core_squared(vortex, w, v)
            work[w, v, Work.mean_u] = 0.0
            work[w, v, Work.mean_v] = 0.0
        if mutual != 0:
            for stage in ti.static(range(4)):
                mutual_velocities(vortex, work, w, eddies.period)
                weight = ti.static((1 / 6, 1 / 3, 1 / 3, 1 / 6)[stage])
                time = ti.static((0.5, 0.5, 1.0, 0.0)[stage]) * dt
                for v in range(vortex.shape[1]):
                    for axis in ti.static(range(2)):
                        if ti.static(eddies.column != 1.0):
                            work[w, v, Work.u + axis] = eddies.column * work[w, v, Work.u + axis]
                        work[w, v, Work.mean_u + axis] = (
                            work[w, v, Work.mean_u + axis] + weight * work[w, v, Work.u + axis]
                        )
                        vortex[w, v, axis] = work[w, v, axis] + time * work[w, v, Work.u + axis]
                    vortex[w, v, Vortex.delta] = ti.sqrt(work[w, v, Work.delta2] + 4.0 * viscosity * time)
        for v in range(vortex.shape[1]):
            for axis in ti.static(range(2)):
                vortex[w, v, axis] = work[w, v, axis] + dt * work[w, v, Work.mean_u + axis]
                if ti.static(eddies.period > 0):
                    middle = ti.static(eddies.centre[axis])
                    vortex[w, v, axis] = middle + nearest(vortex[w, v, axis] - middle, eddies.period)
            vortex[w, v, Vortex.delta] = ti.sqrt(work[w, v, Work.delta2] + 4.0 * viscosity * dt)


@kernel
def _sample_current(
    vortex: array3,
    points: array3,
    out: array3,
    period: ti.template(),
):
    for w, p in ti.ndrange(points.shape[0], points.shape[1]):
        V = current(vortex, w, points[w, p, 0], points[w, p, 1], period)
        out[w, p, 0] = V[0]
        out[w, p, 1] = V[1]


def evolution(
    vortex: torch.Tensor, work: torch.Tensor, dt: float, viscosity: float, mutual: bool, eddies: Eddies = ENDLESS
) -> Launch:
    """A launch that lets vortices spread and move one another for a time, in place: classical Runge–Kutta method.

    Centres of a periodic pattern that leave its square come in at the opposite side.

    Args:
        vortex: (W, V, 4) float32.
        work: (W, V, 7) float32, workspace.
        dt: s; a vortex should not move further than a fraction of a core radius in it.
        viscosity: ν ≥ 0, m²/s.
        mutual: whether the centres move.
        eddies: their period and the speed of their columns.
    """
    serial = runtime.better_alone(vortex.shape[0] * vortex.shape[1])
    return Launch(_evolve, serial, vortex, work, dt, viscosity, int(mutual), eddies)


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
