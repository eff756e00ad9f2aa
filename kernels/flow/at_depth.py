"""The water around a vehicle at any depth: velocity, gradient and rate of change, axes x east, y north, z up.

Vortices decay with the depth d as e^{−d/D}, D = `current.decay_depth`. Real currents are linear between the two levels
at which they are given, the surface and cruise depth, and constant below; with `current.shear` n they change in
proportion to the height over the mean bed to the power of n, down to the height `LEAST_HEIGHT`. Long waves are equal at
all depths; their vertical velocity, at most that of the surface, is neglected. For each component of the storm,

    C = (e^{−kd} + e^{−k(2h − d)})/(1 − e^{−2kh}),   D = (e^{−kd} − e^{−k(2h − d)})/(1 − e^{−2kh})

(`usvauv.kernels.flow.airy`), so it is exact at any depth, but that the shortest waves are left out below the depth to
which they move the water. Its rate is the change over a mission step Δ divided by Δ,
exact at both ends: cos(θ − ωΔ) − cos θ = (cos ωΔ − 1) cos θ + sin ωΔ sin θ. Neglected are the gradient and the rate of
long waves, which are kilometres long and constant for `sea.update_interval`, and the rate of vortices and real
currents, of order V²/δ.
"""

import numpy as np
import taichi as ti

from usvauv.kernels.flow import airy, current
from usvauv.kernels.flow.airy import lanes, total
from usvauv.kernels.functions import func
from usvauv.kernels.limits import LEAST_HEIGHT
from usvauv.kernels.transcendental import TWO_PI, decaying, half_cosine, half_sine
from usvauv.kernels.types import Level, columns, mat3, vec2, vec3

# Columns of a sea after those of its levels. `reach`: the depth (m) below which a component and those after it, as a
# rule shorter waves, move the water by less than `airy.STILL` all together.
Deep = columns("k", "speed", "lift", "bottom", "cosine", "sine", "reach")
DEEP = airy.LEVEL + 2 * len(Level.names)
DEPTHS = 16  # from the surface to the bed, at which the reach is looked for


@ti.dataclass
class Flow:
    """Water at a point: `velocity` (m/s), `gradient` with ∂(row)/∂(column) (1/s), `rate` at a fixed place (m/s²)."""

    velocity: vec3
    gradient: mat3
    rate: vec3


def deep_columns(
    amplitude: np.ndarray, k: np.ndarray, omega: np.ndarray, depth: float, step: float
) -> list[np.ndarray]:
    """The columns `Deep` of wave components, each (seas, N), float64.

    Args:
        amplitude, k, omega: a (m), k (rad/m), ω (rad/s), each (seas, N).
        depth: h, m.
        step: Δ, s.
    """
    scale = -np.expm1(-2 * k * depth)
    turn = omega * step
    reach = np.zeros_like(k)
    for d in np.linspace(0.0, depth, DEPTHS):
        speed = amplitude * omega * airy.decay(k, -d, depth)[0]
        those_after = speed[:, ::-1].cumsum(axis=1)[:, ::-1]
        reach[those_after >= airy.STILL] = d + depth / (DEPTHS - 1)
    return [
        k,
        TWO_PI * amplitude * omega / k / scale,
        amplitude * omega / scale,
        np.exp(-2 * k * depth),
        -2 * np.sin(turn / 2) ** 2 / step,
        np.sin(turn) / step,
        reach,
    ]


@func
def storm(wave: ti.template(), since: ti.template(), sea: ti.i32, x: ti.f32, y: ti.f32, depth: ti.f32) -> Flow:
    """Orbital motion of a sea whose components have the columns `Deep`, at (x, y) and a depth, m."""
    u, v, w = lanes(0.0), lanes(0.0), lanes(0.0)
    u_x, u_y, u_z = lanes(0.0), lanes(0.0), lanes(0.0)
    v_y, v_z = lanes(0.0), lanes(0.0)
    u_t, v_t, w_t = lanes(0.0), lanes(0.0), lanes(0.0)
    for n in range(wave.shape[1]):
        if depth > wave[sea, n, DEEP + Deep.reach][0]:
            break
        kx = wave[sea, n, airy.TURNS_X]
        ky = wave[sea, n, airy.TURNS_Y]
        t = airy.angle(wave, since, sea, n, x, y)
        half = half_sine(t)
        cosine = 1.0 - 2.0 * half * half
        sine = 2.0 * half * half_cosine(t)
        down = decaying(wave[sea, n, DEEP + Deep.k] * depth)
        up = wave[sea, n, DEEP + Deep.bottom] / down
        along = wave[sea, n, DEEP + Deep.speed] * (down + up)
        rising = wave[sea, n, DEEP + Deep.lift] * (down - up)
        c, s = wave[sea, n, DEEP + Deep.cosine], wave[sea, n, DEEP + Deep.sine]
        later_cosine = c * cosine + s * sine
        u += along * kx * cosine
        v += along * ky * cosine
        w += rising * sine
        u_x = u_x - along * kx * kx * sine
        u_y = u_y - along * kx * ky * sine
        v_y = v_y - along * ky * ky * sine
        u_z += rising * kx * cosine
        v_z += rising * ky * cosine
        u_t += along * kx * later_cosine
        v_t += along * ky * later_cosine
        w_t += rising * (c * sine - s * cosine)
    xx, xy, xz = TWO_PI * total(u_x), TWO_PI * total(u_y), TWO_PI * total(u_z)
    yy, yz = TWO_PI * total(v_y), TWO_PI * total(v_z)
    return Flow(
        velocity=vec3(total(u), total(v), total(w)),
        gradient=mat3([[xx, xy, xz], [xy, yy, yz], [xz, yz, -xx - yy]]),
        rate=vec3(total(u_t), total(v_t), total(w_t)),
    )


@func
def fade(profile: ti.template(), depth: ti.f32) -> ti.f32:
    """Speed of vortices at a depth (m) over that at the surface."""
    fade = 1.0
    if profile.decay > 0.0:
        fade = ti.exp(-depth / profile.decay)
    return fade


@func
def share(profile: ti.template(), depth: ti.f32):
    """Share of `current.real_current` at a depth (m), and its change with depth, 1/m."""
    share = ti.math.clamp(depth / profile.cruise, 0.0, 1.0)
    growth = ti.select(depth < profile.cruise, 1.0 / profile.cruise, 0.0)
    if profile.shear > 0.0:
        height = ti.math.clamp(profile.bed - depth, LEAST_HEIGHT, profile.bed)
        at_cruise = ti.max(profile.bed - profile.cruise, LEAST_HEIGHT)
        slower = (height / profile.bed) ** profile.shear
        span = 1.0 - (at_cruise / profile.bed) ** profile.shear
        share = (1.0 - slower) / span
        growth = ti.select(height > LEAST_HEIGHT, profile.shear * slower / (height * span), 0.0)
    return share, growth


@func
def around(
    water: ti.template(), w: ti.i32, x: ti.f32, y: ti.f32, depth: ti.f32, at_surface: vec2, slopes: vec3
) -> Flow:
    """All of the water of world w at (x, y) and a depth, m.

    Args:
        water: `usvauv.kernels.flow.current.Water` whose waves have the columns `Deep`, with a profile.
        at_surface: velocity (u, v) of the vortices at the surface there, m/s, and `slopes` (u_x, u_y, v_x) there,
            1/s, by `usvauv.kernels.flow.vortex.current_and_gradient`.
    """
    found = storm(water.wave, water.since, water.sea_index[w], x, y, depth)
    faded = fade(water.profile, depth)
    fading = ti.select(water.profile.decay > 0.0, faded / water.profile.decay, 0.0)
    waves = current.long_wave_velocity(water, water.sea_index[w], x, y)
    for axis in ti.static(range(2)):
        found.velocity[axis] += faded * at_surface[axis] + waves[axis]
        found.gradient[axis, 2] += fading * at_surface[axis]
    found.gradient[0, 0] += faded * slopes[0]
    found.gradient[0, 1] += faded * slopes[1]
    found.gradient[1, 0] += faded * slopes[2]
    found.gradient[1, 1] -= faded * slopes[0]
    if water.stream.shape[1] > 1:
        deep, growth = share(water.profile, depth)
        for level in range(2):
            weight = ti.select(level == Level.cruise, deep, 1.0 - deep)
            upwards = ti.select(level == Level.cruise, -growth, growth)
            for axis in ti.static(range(2)):
                V = current.grid_slopes(water.stream, level, axis, x, y, water.width, water.length)
                found.velocity[axis] += weight * V[0]
                found.gradient[axis, 0] += weight * V[1]
                found.gradient[axis, 1] += weight * V[2]
                found.gradient[axis, 2] += upwards * V[0]
    return found
