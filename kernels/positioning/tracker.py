"""Tracker of each AUV: a Kalman filter on position and current, from commanded velocity and USBL fixes.

State (x, y, c_x, c_y). Over a time t in which the AUV is carried by the water (a hovering one is not),

    x ← x + t (v + c),   c ← ρ c + w,   ρ = e^{−t/τ},   w ~ N(0, σ² (1 − ρ²) I),   fix = x + n,   n ~ N(0, R),

v the commanded velocity through the water, R the fix's predicted covariance. For an Ornstein–Uhlenbeck current and
Gaussian fixes this is the least-squares estimate. A fix in Cartesian coordinates and v in the world's frame make the
filter linear; only R is linearised. The covariance consists of 2 × 2 blocks A (position), B (position, current),
C (current) and is updated in Joseph's form, a sum of squares, with I − gain written as R S⁻¹, which does not cancel: it
stays positive definite in single precision.

The current of a moving AUV is not an Ornstein–Uhlenbeck process but a sum of eddies it passes through, orbital motion
and long waves, each smooth. For a filter with the memory m only its mean square increment D(m) matters. So the model is
the random walk with that increment, q = D(m)/m, at the filter's own memory m = (R t_fix/q)^¼: that of the stationary
filter, whose characteristic polynomial is s⁴ + q/(R t_fix). σ² is the variance of all parts and τ = 2σ²/q; σ² bounds
the variance of the current while fixes are lost. See `ornstein_uhlenbeck`.

The attitude error is common to all fixes of a moment. R contains it, so every AUV's filter is consistent by itself; the
correlation between AUVs is not used. The error of a relative position is therefore smaller than the two covariances
say. A joint filter of two to six AUVs did not improve the positions themselves (rms 0.1 to 1 % worse, the currents
being correlated too). No gate rejects outliers: the tail of the normalised innovations of a mission is that of χ².

Sources: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), §5.2, §5.4,
§6.2; Uhlenbeck and Ornstein (1930), doi 10.1103/PhysRev.36.823.
"""

import math
from collections.abc import Sequence

import numpy as np
import taichi as ti
import torch

from kernels import runtime
from kernels.flow import airy
from kernels.types import array2, array3, mat2, vec2, vec3

# Columns of a track: the state, the upper triangle of its covariance, whether the AUV is adrift and its last commanded
# velocity through the water (0 where it is not).
X, Y, CURRENT_X, CURRENT_Y = range(4)
XX, XY, XU, XV, YY, YU, YV, UU, UV, VV = range(4, 14)
ADRIFT, WATER_X, WATER_Y = range(14, 17)
COLUMNS = 17
FOREVER = 1e9  # s, correlation time of a current that does not change


@ti.func
def position_block(track: ti.template(), w, k) -> mat2:
    """Block A of the covariance, m²."""
    return mat2([[track[w, k, XX], track[w, k, XY]], [track[w, k, XY], track[w, k, YY]]])


@ti.func
def cross_block(track: ti.template(), w, k) -> mat2:
    """Block B of the covariance, rows of the position, columns of the current, m²/s."""
    return mat2([[track[w, k, XU], track[w, k, XV]], [track[w, k, YU], track[w, k, YV]]])


@ti.func
def current_block(track: ti.template(), w, k) -> mat2:
    """Block C of the covariance, m²/s²."""
    return mat2([[track[w, k, UU], track[w, k, UV]], [track[w, k, UV], track[w, k, VV]]])


@ti.func
def store_covariance(track: ti.template(), w, k, A: mat2, B: mat2, C: mat2):
    """Write the blocks of the covariance, A and C made symmetric."""
    track[w, k, XX] = A[0, 0]
    track[w, k, XY] = 0.5 * (A[0, 1] + A[1, 0])
    track[w, k, YY] = A[1, 1]
    track[w, k, XU] = B[0, 0]
    track[w, k, XV] = B[0, 1]
    track[w, k, YU] = B[1, 0]
    track[w, k, YV] = B[1, 1]
    track[w, k, UU] = C[0, 0]
    track[w, k, UV] = 0.5 * (C[0, 1] + C[1, 0])
    track[w, k, VV] = C[1, 1]


@ti.func
def correct_state(track: ti.template(), w, k, position: vec2, current: vec2):
    """Add corrections of position (m) and current (m/s)."""
    track[w, k, X] = track[w, k, X] + position[0]
    track[w, k, Y] = track[w, k, Y] + position[1]
    track[w, k, CURRENT_X] = track[w, k, CURRENT_X] + current[0]
    track[w, k, CURRENT_Y] = track[w, k, CURRENT_Y] + current[1]


@ti.func
def corrections(A: mat2, B: mat2, R: mat2, innovation: vec2):
    """Corrections of the part with block A and of the other part by an innovation, and its square over S."""
    weighted = (A + R).inverse() @ innovation
    return A @ weighted, B.transpose() @ weighted, innovation.dot(weighted)


@ti.func
def joseph(A: mat2, B: mat2, C: mat2, R: mat2):
    """Blocks A, B, C after a measurement of covariance R of the part with block A; B is the cross block."""
    S = A + R
    S_inverse = S.inverse()
    rest = R @ S_inverse  # I − gain, without cancellation
    G = A @ S_inverse
    L = B.transpose() @ S_inverse
    LB = L @ B
    return (
        rest @ A @ rest.transpose() + G @ R @ G.transpose(),
        rest @ (B - A @ L.transpose()) + G @ R @ L.transpose(),
        C - LB - LB.transpose() + L @ S @ L.transpose(),
    )


@ti.func
def begin(track: ti.template(), w, k, x, y, covariance: vec3, variance):
    """Begin a track at (x, y) with covariance (xx, xy, yy), m², in a current of zero mean and `variance`, m²/s²."""
    for c in ti.static(range(COLUMNS)):
        track[w, k, c] = 0.0
    track[w, k, X] = x
    track[w, k, Y] = y
    track[w, k, XX] = covariance[0]
    track[w, k, XY] = covariance[1]
    track[w, k, YY] = covariance[2]
    track[w, k, UU] = variance
    track[w, k, VV] = variance


@ti.func
def shift(track: ti.template(), w, k, carried: vec2, time):
    """Move the position by `carried` (m) and by the current during `time` (s, of either sign)."""
    A = position_block(track, w, k)
    B = cross_block(track, w, k)
    C = current_block(track, w, k)
    track[w, k, X] = track[w, k, X] + carried[0] + time * track[w, k, CURRENT_X]
    track[w, k, Y] = track[w, k, Y] + carried[1] + time * track[w, k, CURRENT_Y]
    store_covariance(track, w, k, A + time * (B + B.transpose()) + time * time * C, B + time * C, C)


@ti.func
def carry(track: ti.template(), w, k, velocity: vec2, time, adrift):
    """Propagate the track by the AUV's motion, before the fix taken at its end or on the way.

    Args:
        track: (W, K, COLUMNS) float32; `w` and `k` select the AUV.
        velocity: commanded velocity through the water, m/s.
        time: s.
        adrift: 1 where the AUV moved with the water; 0 where it held its position, its velocity over ground being zero.
    """
    track[w, k, ADRIFT] = adrift
    track[w, k, WATER_X] = adrift * velocity[0]
    track[w, k, WATER_Y] = adrift * velocity[1]
    shift(track, w, k, adrift * time * velocity, adrift * time)


@ti.func
def renew(track: ti.template(), w, k, time, variance, correlation_time):
    """Propagate the current by `time` (s) to the next motion; σ² = `variance` (m²/s²), τ = `correlation_time` (s)."""
    rho = ti.exp(-time / correlation_time)
    C = rho * rho * current_block(track, w, k)
    noise = variance * (1.0 - rho * rho)
    C[0, 0] += noise
    C[1, 1] += noise
    store_covariance(track, w, k, position_block(track, w, k), rho * cross_block(track, w, k), C)
    track[w, k, CURRENT_X] = rho * track[w, k, CURRENT_X]
    track[w, k, CURRENT_Y] = rho * track[w, k, CURRENT_Y]


@ti.func
def update(track: ti.template(), w, k, fix: vec2, covariance: vec3, lag, carried: vec2):
    """Update by a fix; returns its normalised innovation squared, χ² of two degrees of freedom.

    A late fix is compared with the position at its own time, and the result is propagated to the present. That is exact
    as long as `renew` has not been called since; treat a fix that is older than a step as lost.

    Args:
        track: after `carry`.
        fix: measured position, m.
        covariance: of the fix, (xx, xy, yy), m²; positive definite.
        lag: time since the fix during which the AUV was adrift, s; 0 for a fix of now.
        carried: commanded displacement through the water during that time, m.
    """
    shift(track, w, k, -carried, -lag)
    R = mat2([[covariance[0], covariance[1]], [covariance[1], covariance[2]]])
    innovation = fix - vec2(track[w, k, X], track[w, k, Y])
    A = position_block(track, w, k)
    B = cross_block(track, w, k)
    C = current_block(track, w, k)
    position, current, squared = corrections(A, B, R, innovation)
    A, B, C = joseph(A, B, C, R)
    store_covariance(track, w, k, A, B, C)
    correct_state(track, w, k, position, current)
    shift(track, w, k, carried, lag)
    return squared


@ti.func
def sense(track: ti.template(), w, k, reading: vec2, variance):
    """Update by a reading of the current at the AUV (m/s) with `variance` per axis, m²/s²; after `renew`."""
    R = mat2([[variance, 0.0], [0.0, variance]])
    innovation = reading - vec2(track[w, k, CURRENT_X], track[w, k, CURRENT_Y])
    A = position_block(track, w, k)
    B = cross_block(track, w, k).transpose()
    C = current_block(track, w, k)
    current, position, _ = corrections(C, B, R, innovation)
    C, B, A = joseph(C, B, A, R)
    store_covariance(track, w, k, A, B.transpose(), C)
    correct_state(track, w, k, position, current)


@ti.kernel
def _follow(
    velocity: array3,
    adrift: array2,
    fix: array3,
    covariance: array3,
    age: array2,
    reading: array3,
    reading_variance: ti.f32,
    variance: ti.f32,
    correlation_time: ti.f32,
    step: ti.f32,
    track: array3,
    squared_innovation: array2,
):
    for n in range(track.shape[1]):
        for t in range(velocity.shape[0]):
            for c in range(track.shape[2]):
                track[t + 1, n, c] = track[t, n, c]
            v = vec2(velocity[t, n, 0], velocity[t, n, 1])
            carry(track, t + 1, n, v, step, adrift[t, n])
            squared_innovation[t, n] = -1.0
            if age[t, n] >= 0.0:
                lag = adrift[t, n] * age[t, n]
                z = vec2(fix[t, n, 0], fix[t, n, 1])
                R = vec3(covariance[t, n, 0], covariance[t, n, 1], covariance[t, n, 2])
                squared_innovation[t, n] = update(track, t + 1, n, z, R, lag, lag * v)
            renew(track, t + 1, n, step, variance, correlation_time)
            if reading_variance > 0.0:
                sense(track, t + 1, n, vec2(reading[t, n, 0], reading[t, n, 1]), reading_variance)


def follow(
    start: torch.Tensor,
    velocity: torch.Tensor,
    adrift: torch.Tensor,
    fix: torch.Tensor,
    covariance: torch.Tensor,
    age: torch.Tensor,
    *,
    variance: float,
    correlation_time: float,
    step: float,
    reading: torch.Tensor | None = None,
    reading_deviation: float = 0.0,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Track N AUVs over T steps: motion, fix if there is one, then the current at the step's end and its reading.

    Args:
        start: (N, COLUMNS) float32, tracks at the beginning.
        velocity: (T, N, 2) float32, commanded through the water during each step, m/s.
        adrift: (T, N) float32, 1 or 0, see `carry`.
        fix: (T, N, 2) float32, m.
        covariance: (T, N, 3) float32, (xx, xy, yy), m².
        age: (T, N) float32, age of the fix at the end of the step, from 0 to `step`, s; negative where it is lost.
        variance, correlation_time: of the current, see `renew`. step: s.
        reading: (T, N, 2) float32, current that the AUV measures at the end of each step, m/s; optional.
        reading_deviation: its standard deviation per axis, m/s, above 0 if there are readings.

    Returns:
        (T + 1, N, COLUMNS) tracks at the start and after each step; (T, N) normalised innovation squared, −1 where
        there was no fix.

    Raises:
        Unsupported: so many steps that a Vulkan device may leave the loop before its end.
    """
    steps, count = adrift.shape
    runtime.check_loops(steps * (1 + COLUMNS), f"a track of {steps} steps")
    track = start.new_empty((steps + 1, count, COLUMNS))
    track[0] = start
    squared_innovation = start.new_empty((steps, count))
    reading = start.new_zeros((1, 1, 2)) if reading is None else reading
    velocity, adrift, fix, covariance, age, reading = (
        array.contiguous() for array in (velocity, adrift, fix, covariance, age, reading)
    )
    model = (reading_deviation**2, variance, correlation_time, step)
    _follow(velocity, adrift, fix, covariance, age, reading, *model, track, squared_innovation)
    return track, squared_innovation


def eddies(
    count: int, circulation: tuple[float, float], core_radius: tuple[float, float], area: float, speed: float
) -> tuple[float, float]:
    """Variance per axis (m²/s²) and frequency (rad/s) of the current along a path through random Lamb–Oseen vortices.

    Of N vortices with |Γ| and δ uniform between limits and centres spread over an area a, the vorticity has the mean
    square N E[Γ²] E[1/δ²]/(2π a), and a quarter of that is the mean square per axis of the change of velocity a metre.
    The variance is that within a disc of the same area round each, N E[Γ²] (ln(a/(πδ²)) + 0.5772 − ln 2)/(8π a).

    Args:
        count: N. circulation, core_radius: limits of |Γ| (m²/s) and δ (m). area: m².
        speed: of the AUV over ground, m/s.
    """
    low, high = circulation
    strength = count * (low * low + low * high + high * high) / 3.0 / area
    delta2 = core_radius[0] * core_radius[1]  # 1/E[1/δ²]
    variance = strength * max(math.log(area / (math.pi * delta2)) + 0.5772 - math.log(2.0), 0.1) / (8.0 * math.pi)
    change = speed * speed * strength / (8.0 * math.pi * delta2)
    return variance, math.sqrt(change / variance) if variance > 0.0 else 0.0


def orbital_motion(
    omega: np.ndarray, S: np.ndarray, significant_height: float, z: float, depth: float, gravity: float
) -> tuple[float, float]:
    """Variance per axis (m²/s²) and mean square frequency's root (rad/s) of the orbital velocity of short waves at z.

    Args:
        omega, S: frequencies (rad/s), evenly spaced, and spectral density up to a factor, (n,).
        significant_height: Hs = 4 √m0, m. z: level, −h ≤ z ≤ 0, m. depth: h, m. gravity: g, m/s².
    """
    orbital = (omega * airy.decay(airy.wavenumber(omega, depth, gravity), z, depth)[0]) ** 2 * S
    variance = 0.5 * (significant_height / 4.0) ** 2 * orbital.sum() / S.sum()
    return float(variance), float(math.sqrt((omega**2 * orbital).sum() / orbital.sum()))


def standing_waves(
    rms: float, modes: int, length: float, depth: float, gravity: float, drag: float, duration: float
) -> tuple[float, float]:
    """Variance per axis (m²/s²) and frequency (rad/s) of the current in shallow standing waves, a mission's mean.

    Mean kinetic energy equals mean potential energy, half of that at the crests: g rms²/(4h) per axis. All numbers of
    half waves from 0 to `modes` are equally likely in both axes, so (π/L)² modes (2 modes + 1)/3 is the mean of k².
    Under linear drag r energy decays as e^{−rt}.

    Args:
        rms: elevation at the crests, m. length: L of the area, m. depth: h, m. gravity: g, m/s².
        drag: r, 1/s. duration: of the mission, s.
    """
    left = -math.expm1(-drag * duration) / (drag * duration) if drag > 0.0 else 1.0
    k = math.pi / length * math.sqrt(modes * (2.0 * modes + 1.0) / 3.0)
    return 0.25 * gravity / depth * rms * rms * left, k * math.sqrt(gravity * depth)


def ornstein_uhlenbeck(
    parts: Sequence[tuple[float, float]], fix_variance: float, interval: float
) -> tuple[float, float]:
    """The current's variance σ² (m²/s²) and correlation time τ (s) for the tracker.

    D(m) = Σ 2 s² (1 − e^{−(ωm)²/2}) over the parts; q = D(m)/m with the memory m = (R t_fix/q)^¼, by bisection.

    Args:
        parts: variance s² per axis (m²/s²) and root mean square frequency ω (rad/s) of each part of the current.
        fix_variance: R per axis, m². interval: t_fix, s, between fixes.
    """
    variance = float(sum(s2 for s2, _ in parts))

    def walk(m: float) -> float:
        return sum(-2.0 * s2 * math.expm1(-0.5 * (omega * m) ** 2) for s2, omega in parts) / m

    low, high = 1e-3, 1e6
    for _ in range(80):
        m = math.sqrt(low * high)
        # m⁴ q(m) = m³ D(m) grows with m.
        low, high = (m, high) if m**4 * walk(m) < fix_variance * interval else (low, m)
    q = walk(low)
    return variance, 2.0 * variance / q if q > 0.0 else FOREVER
