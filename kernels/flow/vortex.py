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

from kernels import runtime
from kernels.launch import Launch

TWO_PI = 6.283185307179586
vec2 = ti.types.vector(2, ti.f32)


@ti.func
def core_factor(s: ti.f32) -> ti.f32:
    """(1 − e^{−s})/s for s ≥ 0, which is 1 at s = 0: a series where the difference would cancel in single precision."""
    value = 1.0 - s / 2.0 * (1.0 - s / 3.0 * (1.0 - s / 4.0 * (1.0 - s / 5.0 * (1.0 - s / 6.0))))
    if s > 0.25:
        value = (1.0 - ti.exp(-s)) / s
    return value


@ti.func
def current(vortex: ti.template(), w: ti.i32, x: ti.f32, y: ti.f32) -> vec2:
    """Velocity (m/s) at (x, y) in world w; `vortex` has shape (W, V, 4)."""
    V = vec2(0.0, 0.0)
    for v in range(vortex.shape[1]):
        dx = x - vortex[w, v, 0]
        dy = y - vortex[w, v, 1]
        Gamma = vortex[w, v, 2]
        delta2 = vortex[w, v, 3] * vortex[w, v, 3]
        rotation = Gamma / (TWO_PI * delta2) * core_factor((dx * dx + dy * dy) / delta2)
        V += vec2(-rotation * dy, rotation * dx)
    return V


@ti.func
def carry(vortex: ti.template(), kept: ti.template(), w: ti.i32):
    """Velocities (m/s) of all centres of a world by the other vortices, into columns 3 and 4 of `kept`.

    Sums are written out: `+=` on an array would be an atomic.
    """
    for v in range(vortex.shape[1]):
        kept[w, v, 3] = 0.0
        kept[w, v, 4] = 0.0
        for other in range(v):
            dx = vortex[w, v, 0] - vortex[w, other, 0]
            dy = vortex[w, v, 1] - vortex[w, other, 1]
            delta2 = vortex[w, v, 3] * vortex[w, v, 3] + vortex[w, other, 3] * vortex[w, other, 3]
            turn = core_factor((dx * dx + dy * dy) / delta2) / (TWO_PI * delta2)
            kept[w, v, 3] = kept[w, v, 3] - vortex[w, other, 2] * turn * dy
            kept[w, v, 4] = kept[w, v, 4] + vortex[w, other, 2] * turn * dx
            kept[w, other, 3] = kept[w, other, 3] + vortex[w, v, 2] * turn * dy
            kept[w, other, 4] = kept[w, other, 4] - vortex[w, v, 2] * turn * dx


@ti.func
def vorticity(vortex: ti.template(), w: ti.i32, x: ti.f32, y: ti.f32) -> ti.f32:
    """Vorticity ϖ (1/s) at (x, y) in world w; `vortex` has shape (W, V, 4)."""
    total = 0.0
    for v in range(vortex.shape[1]):
        dx = x - vortex[w, v, 0]
        dy = y - vortex[w, v, 1]
        delta2 = vortex[w, v, 3] * vortex[w, v, 3]
        total += 2.0 * vortex[w, v, 2] / (TWO_PI * delta2) * ti.exp(-(dx * dx + dy * dy) / delta2)
    return total


@ti.kernel
def _evolve(
    serial: ti.template(),
    vortex: ti.types.ndarray(dtype=ti.f32, ndim=3),
    kept: ti.types.ndarray(dtype=ti.f32, ndim=3),
    dt: ti.f32,
    viscosity: ti.f32,
    mutual: ti.i32,
):
    """`kept` (W, V, 7): centre and δ² at the beginning, velocity, and the weighted sum of velocities."""
    ti.loop_config(serialize=serial)
    for w in range(vortex.shape[0]):
        for v in range(vortex.shape[1]):
            kept[w, v, 0] = vortex[w, v, 0]
            kept[w, v, 1] = vortex[w, v, 1]
            kept[w, v, 2] = vortex[w, v, 3] * vortex[w, v, 3]
            kept[w, v, 5] = 0.0
            kept[w, v, 6] = 0.0
        if mutual != 0:
            for stage in ti.static(range(4)):
                carry(vortex, kept, w)
                share = ti.static((1 / 6, 1 / 3, 1 / 3, 1 / 6)[stage])
                reach = ti.static((0.5, 0.5, 1.0, 0.0)[stage]) * dt
                for v in range(vortex.shape[1]):
                    for axis in ti.static(range(2)):
                        kept[w, v, 5 + axis] = kept[w, v, 5 + axis] + share * kept[w, v, 3 + axis]
                        vortex[w, v, axis] = kept[w, v, axis] + reach * kept[w, v, 3 + axis]
                    vortex[w, v, 3] = ti.sqrt(kept[w, v, 2] + 4.0 * viscosity * reach)
        for v in range(vortex.shape[1]):
            for axis in ti.static(range(2)):
                vortex[w, v, axis] = kept[w, v, axis] + dt * kept[w, v, 5 + axis]
            vortex[w, v, 3] = ti.sqrt(kept[w, v, 2] + 4.0 * viscosity * dt)


@ti.kernel
def _sample_current(
    vortex: ti.types.ndarray(dtype=ti.f32, ndim=3),
    points: ti.types.ndarray(dtype=ti.f32, ndim=3),
    out: ti.types.ndarray(dtype=ti.f32, ndim=3),
):
    for w, p in ti.ndrange(points.shape[0], points.shape[1]):
        V = current(vortex, w, points[w, p, 0], points[w, p, 1])
        out[w, p, 0] = V[0]
        out[w, p, 1] = V[1]


@ti.kernel
def _sample_vorticity(
    vortex: ti.types.ndarray(dtype=ti.f32, ndim=3),
    points: ti.types.ndarray(dtype=ti.f32, ndim=3),
    out: ti.types.ndarray(dtype=ti.f32, ndim=2),
):
    for w, p in ti.ndrange(points.shape[0], points.shape[1]):
        out[w, p] = vorticity(vortex, w, points[w, p, 0], points[w, p, 1])


def evolution(vortex: torch.Tensor, kept: torch.Tensor, dt: float, viscosity: float, mutual: bool) -> Launch:
    """What lets vortices spread and carry one another for a time, in place, by the classical Runge–Kutta method.

    Args:
        vortex: (W, V, 4) float32.
        kept: (W, V, 7) float32, room to work in.
        dt: s; a vortex should not move further than a fraction of a core radius in it.
        viscosity: ν ≥ 0, m²/s.
        mutual: whether the centres move.
    """
    return Launch(
        _evolve, runtime.better_alone(vortex.shape[0] * vortex.shape[1]), vortex, kept, dt, viscosity, int(mutual)
    )


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


def sample_vorticity(vortex: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    """Vorticity (1/s) at many points: shapes as `sample_current`, result (W, P)."""
    out = points.new_zeros(points.shape[:2])
    if vortex.shape[1]:
        _sample_vorticity(vortex.contiguous(), points.contiguous(), out)
    return out
