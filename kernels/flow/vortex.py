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
"""

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.launch import Launch
from usvauv.kernels.types import Columns, array3, vec2

TWO_PI = 6.283185307179586
FAR = 17.4  # r²/δ² from which on 1 − e^{−r²/δ²} is 1 in single precision


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
def current(vortex: ti.template(), w: ti.i32, x: ti.f32, y: ti.f32) -> vec2:
    """Velocity (m/s) at (x, y) in world w; `vortex` has shape (W, V, 4)."""
    V = vec2(0.0, 0.0)
    for v in range(vortex.shape[1]):
        dx = x - vortex[w, v, Vortex.x]
        dy = y - vortex[w, v, Vortex.y]
        Gamma = vortex[w, v, Vortex.Gamma]
        delta2 = core_squared(vortex, w, v)
        rotation = Gamma / (TWO_PI * delta2) * core_factor((dx * dx + dy * dy) / delta2)
        V += vec2(-rotation * dy, rotation * dx)
    return V


@func
def mutual_velocities(vortex: ti.template(), work: ti.template(), w: ti.i32):
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
            dx = x - vortex[w, other, Vortex.x]
            dy = y - vortex[w, other, Vortex.y]
            delta2 = own + core_squared(vortex, w, other)
            turn = core_factor((dx * dx + dy * dy) / delta2) / (TWO_PI * delta2)
            V += vortex[w, other, Vortex.Gamma] * turn * vec2(-dy, dx)
            work[w, other, Work.u] = work[w, other, Work.u] + Gamma * turn * dy
            work[w, other, Work.v] = work[w, other, Work.v] - Gamma * turn * dx
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
                mutual_velocities(vortex, work, w)
                weight = ti.static((1 / 6, 1 / 3, 1 / 3, 1 / 6)[stage])
                time = ti.static((0.5, 0.5, 1.0, 0.0)[stage]) * dt
                for v in range(vortex.shape[1]):
                    for axis in ti.static(range(2)):
                        work[w, v, Work.mean_u + axis] = (
                            work[w, v, Work.mean_u + axis] + weight * work[w, v, Work.u + axis]
                        )
                        vortex[w, v, axis] = work[w, v, axis] + time * work[w, v, Work.u + axis]
                    vortex[w, v, Vortex.delta] = ti.sqrt(work[w, v, Work.delta2] + 4.0 * viscosity * time)
        for v in range(vortex.shape[1]):
            for axis in ti.static(range(2)):
                vortex[w, v, axis] = work[w, v, axis] + dt * work[w, v, Work.mean_u + axis]
            vortex[w, v, Vortex.delta] = ti.sqrt(work[w, v, Work.delta2] + 4.0 * viscosity * dt)


@kernel
def _sample_current(
    vortex: array3,
    points: array3,
    out: array3,
):
    for w, p in ti.ndrange(points.shape[0], points.shape[1]):
        V = current(vortex, w, points[w, p, 0], points[w, p, 1])
        out[w, p, 0] = V[0]
        out[w, p, 1] = V[1]


def evolution(vortex: torch.Tensor, work: torch.Tensor, dt: float, viscosity: float, mutual: bool) -> Launch:
    """A launch that lets vortices spread and move one another for a time, in place: classical Runge–Kutta method.

    Args:
        vortex: (W, V, 4) float32.
        work: (W, V, 7) float32, workspace.
        dt: s; a vortex should not move further than a fraction of a core radius in it.
        viscosity: ν ≥ 0, m²/s.
        mutual: whether the centres move.
    """
    serial = runtime.better_alone(vortex.shape[0] * vortex.shape[1])
    return Launch(_evolve, serial, vortex, work, dt, viscosity, int(mutual))


def sample_current(vortex: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    """Velocity at many points.

    Args:
        vortex: (W, V, 4) float32, rows (x0, y0, Γ, δ) in m, m, m²/s, m; V may be 0.
        points: (W, P, 2) float32, positions in m.

    Returns:
        (W, P, 2) float32, (V_x, V_y) in m/s.
    """
    out = torch.zeros_like(points)
    if vortex.shape[1]:
        _sample_current(vortex.contiguous(), points.contiguous(), out)
    return out
