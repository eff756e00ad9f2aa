"""Tracker of each AUV: a Kalman filter on position and current, from commanded velocity and USBL fixes.

State (x, y, c_x, c_y). Over a time t in which the AUV moves with the water (a hovering one does not),

    x ← x + t (v + c),   c ← ρ c + w,   ρ = e^{−t/τ},   w ~ N(0, σ² (1 − ρ²) I),   fix = x + n,   n ~ N(0, R),

v the commanded velocity through the water, R the fix's predicted covariance. For an Ornstein–Uhlenbeck current, whose
given σ² and τ, and Gaussian fixes this is the least-squares
estimate. A fix in Cartesian coordinates and v in the world's frame make the filter linear; only R is linearised. The
covariance consists of 2 × 2 blocks A (position), B (position, current), C (current). After a fix, S = A + R, they are
R S⁻¹ A = (|A| R + |R| A)/|S|, R S⁻¹ B and C − Bᵀ S⁻¹ B: I − gain, written as R S⁻¹, does not cancel, and a sum of
positive definite blocks with positive weights stays so in single precision.

The attitude error is common to all fixes of a moment. R contains it, so every AUV's filter is consistent by itself; the
correlation between AUVs is not used. The error of a relative position is therefore smaller than the two covariances
indicate. A joint filter of two to six AUVs did not improve the positions themselves (rms 0.1 to 1 % worse, the currents
being correlated too).

A fix whose normalised innovation squared exceeds `usbl.GATE` is rejected, one in a thousand if the model holds. A
filter that has lost its AUV would reject all: if CONFIRMATIONS successive rejected fixes agree with one another, each
within the distance that the AUV can have travelled since the one before, the track begins anew at the last of them.

Sources: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), §5.2, §5.4,
§6.2; Blackman and Popoli, "Design and Analysis of Modern Tracking Systems" (1999), §6.2 (a new track from several
detections).
"""

import taichi as ti
import torch

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.positioning.usbl import GATE, Expectation, squared_innovation
from usvauv.kernels.types import array2, array3, mat2, vec2, vec3

# Columns of a track: the state, the upper triangle of its covariance, whether the AUV is adrift and its last commanded
# velocity through the water (0 where it is not); how many fixes in a row were rejected and agree with one another, the
# last of them, and the time since.
X, Y, CURRENT_X, CURRENT_Y = range(4)
XX, XY, XU, XV, YY, YU, YV, UU, UV, VV = range(4, 14)
ADRIFT, WATER_X, WATER_Y = range(14, 17)
REJECTIONS, REJECTED_X, REJECTED_Y, REJECTED_AGE = range(17, 21)
COLUMNS = 21
AGE = 14  # where an AUV has the state and its covariance from the boat, the column of the time since, s
OWN_COLUMNS = 15
CONFIRMATIONS = 3


@ti.dataclass
class TrackFix:
    """A fix for a track.

    Attributes:
        place: measured position, m.
        covariance: of that, (xx, xy, yy), m²; positive definite.
        lag: time since the fix during which the AUV was adrift, s; 0 for a fix of now.
        carried: commanded displacement through the water during that time, m.
    """

    place: vec2
    covariance: vec3
    lag: ti.f32
    carried: vec2


@func
def position_block(track: ti.template(), w, k) -> mat2:
    """Block A of the covariance, m²."""
    return mat2([[track[w, k, XX], track[w, k, XY]], [track[w, k, XY], track[w, k, YY]]])


@func
def cross_block(track: ti.template(), w, k) -> mat2:
    """Block B of the covariance, rows of the position, columns of the current, m²/s."""
    return mat2([[track[w, k, XU], track[w, k, XV]], [track[w, k, YU], track[w, k, YV]]])


@func
def current_block(track: ti.template(), w, k) -> mat2:
    """Block C of the covariance, m²/s²."""
    return mat2([[track[w, k, UU], track[w, k, UV]], [track[w, k, UV], track[w, k, VV]]])


@func
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


@func
def correct_state(track: ti.template(), w, k, position: vec2, current: vec2):
    """Add corrections of position (m) and current (m/s)."""
    track[w, k, X] = track[w, k, X] + position[0]
    track[w, k, Y] = track[w, k, Y] + position[1]
    track[w, k, CURRENT_X] = track[w, k, CURRENT_X] + current[0]
    track[w, k, CURRENT_Y] = track[w, k, CURRENT_Y] + current[1]


@func
def corrections(A: mat2, B: mat2, R: mat2, innovation: vec2):
    """Corrections of the part with block A and of the other part by an innovation, and its square over S."""
    weighted = (A + R).inverse() @ innovation
    return A @ weighted, B.transpose() @ weighted, innovation.dot(weighted)


@func
def measured(A: mat2, B: mat2, C: mat2, R: mat2):
    """Blocks A, B, C after a measurement of covariance R of the part with block A; B is the cross block."""
    S = A + R
    S_inverse = S.inverse()
    share = 1.0 / S.determinant()
    kept = ti.max(A.determinant(), 0.0) * share * R + R.determinant() * share * A
    return kept, R @ S_inverse @ B, C - B.transpose() @ S_inverse @ B


@func
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


@func
def shift(track: ti.template(), w, k, carried: vec2, time):
    """Move the position by `carried` (m) and by the current during `time` (s, of either sign)."""
    A = position_block(track, w, k)
    B = cross_block(track, w, k)
    C = current_block(track, w, k)
    track[w, k, X] = track[w, k, X] + carried[0] + time * track[w, k, CURRENT_X]
    track[w, k, Y] = track[w, k, Y] + carried[1] + time * track[w, k, CURRENT_Y]
    store_covariance(track, w, k, A + time * (B + B.transpose()) + time * time * C, B + time * C, C)


@func
def spread(track: ti.template(), w, k, variance):
    """Add a variance per axis (m²) to the position's covariance."""
    track[w, k, XX] = track[w, k, XX] + variance
    track[w, k, YY] = track[w, k, YY] + variance


@func
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
    track[w, k, REJECTED_AGE] = track[w, k, REJECTED_AGE] + time
    shift(track, w, k, adrift * time * velocity, adrift * time)


@func
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


@func
def decayed(t):
    """f = 1 − e^{−t} for t ≥ 0, and 2t − 3 + 4e^{−t} − e^{−2t} = 2 (t − f) − f², without cancellation."""
    f = t * (1.0 - t * (0.5 - t * (1.0 / 6.0 - t * (1.0 / 24.0 - t * (1.0 / 120.0)))))
    spreading = t * t * t * (2.0 / 3.0 - t * (0.5 - t * (7.0 / 30.0 - t * (1.0 / 12.0))))
    if t >= 0.1:
        f = 1.0 - ti.exp(-t)
        spreading = 2.0 * (t - f) - f * f
    return f, spreading


@func
def drift_state(track: ti.template(), w, k, carried: vec2, f, correlation_time):
    """The state's part of `drift`; f as there."""
    for axis in ti.static(range(2)):
        current = track[w, k, CURRENT_X + axis]
        track[w, k, X + axis] = track[w, k, X + axis] + carried[axis] + correlation_time * f * current
        track[w, k, CURRENT_X + axis] = (1.0 - f) * current


@func
def drift(track: ti.template(), w, k, carried: vec2, time, variance, correlation_time):
    """Propagate position and current together over a time (s) in which the current changes, to any length exactly.

    Over the time t, with f = 1 − e^{−t/τ}, the current moves the AUV by τ f c and a noise of the variance σ² τ²
    (2 (t/τ − f) − f²) that has the covariance σ² τ f² with the noise of the new current.

    Args:
        carried: commanded displacement, m. variance, correlation_time: as for `renew`.
    """
    f, spreading = decayed(time / correlation_time)
    kept, reach = 1.0 - f, correlation_time * f
    A = position_block(track, w, k)
    B = cross_block(track, w, k)
    C = current_block(track, w, k)
    A += reach * (B + B.transpose()) + reach * reach * C
    B = kept * (B + reach * C)
    C *= kept * kept
    for axis in ti.static(range(2)):
        A[axis, axis] += variance * correlation_time * correlation_time * spreading
        B[axis, axis] += variance * correlation_time * f * f
        C[axis, axis] += variance * f * (2.0 - f)
    store_covariance(track, w, k, A, B, C)
    drift_state(track, w, k, carried, f, correlation_time)


@func
def reject(track: ti.template(), w, k, fix: TrackFix, variance, speed):
    """Note a fix beyond the gate; begin the track anew where it confirms those rejected before it."""
    last = vec2(track[w, k, REJECTED_X], track[w, k, REJECTED_Y])
    near = Expectation(place=last, covariance=fix.covariance, reach=speed * track[w, k, REJECTED_AGE])
    in_a_row = 1.0
    if track[w, k, REJECTIONS] > 0.0 and squared_innovation(near, fix.place, fix.covariance) <= GATE:
        in_a_row += track[w, k, REJECTIONS]
    track[w, k, REJECTIONS] = in_a_row
    track[w, k, REJECTED_X] = fix.place[0]
    track[w, k, REJECTED_Y] = fix.place[1]
    track[w, k, REJECTED_AGE] = 0.0
    if in_a_row >= CONFIRMATIONS:
        adrift = vec3(track[w, k, ADRIFT], track[w, k, WATER_X], track[w, k, WATER_Y])
        begin(track, w, k, fix.place[0], fix.place[1], fix.covariance, variance)
        track[w, k, ADRIFT] = adrift[0]
        track[w, k, WATER_X] = adrift[1]
        track[w, k, WATER_Y] = adrift[2]


@func
def update(track: ti.template(), w, k, fix: TrackFix, variance, speed):
    """Update by a fix; returns its normalised innovation squared, χ² of two degrees of freedom.

    A fix beyond the gate changes nothing, except that the track counts it in REJECTIONS, or begins anew with it; after
    a fix that was used REJECTIONS is 0.

    A late fix is compared with the position at its own time, and the result is propagated to the present. That is exact
    as long as `renew` has not been called since; treat a fix that is older than a step as lost.

    Args:
        track: after `carry`.
        fix: what was measured.
        variance: of the current, see `renew`; for a track that begins anew.
        speed: greatest of the AUV over ground, m/s; how far rejected fixes that agree can be apart.
    """
    if fix.lag > 0.0:
        shift(track, w, k, -1.0 * fix.carried, -fix.lag)
    R = mat2([[fix.covariance[0], fix.covariance[1]], [fix.covariance[1], fix.covariance[2]]])
    innovation = fix.place - vec2(track[w, k, X], track[w, k, Y])
    A = position_block(track, w, k)
    B = cross_block(track, w, k)
    C = current_block(track, w, k)
    position, current, squared = corrections(A, B, R, innovation)
    if squared <= GATE:
        A, B, C = measured(A, B, C, R)
        store_covariance(track, w, k, A, B, C)
        correct_state(track, w, k, position, current)
        track[w, k, REJECTIONS] = 0.0
    else:
        reject(track, w, k, fix, variance, speed)
    if fix.lag > 0.0:
        shift(track, w, k, fix.carried, fix.lag)
    return squared


@func
def sense(track: ti.template(), w, k, reading: vec2, variance):
    """Update by a reading of the current at the AUV (m/s) with `variance` per axis, m²/s²; after `renew`."""
    R = mat2([[variance, 0.0], [0.0, variance]])
    innovation = reading - vec2(track[w, k, CURRENT_X], track[w, k, CURRENT_Y])
    A = position_block(track, w, k)
    B = cross_block(track, w, k).transpose()
    C = current_block(track, w, k)
    current, position, _ = corrections(C, B, R, innovation)
    C, B, A = measured(C, B, A, R)
    store_covariance(track, w, k, A, B.transpose(), C)
    correct_state(track, w, k, position, current)


@ti.dataclass
class Drift:
    """Effect of a time t adrift on half the traces of a covariance's blocks: a of A, b of B, c of C.

    They are enough where drift and fixes treat both axes alike. With f = 1 − e^{−t/τ}, σ² and τ variance and memory of
    the current, and w the variance that a white error of velocity adds a second (m²/s),

        a ← a + 2τf b + τ²f² c + σ²τ² (2t/τ − 2f − f²) + w t,
        b ← (1 − f)(b + τf c) + σ²τf²,
        c ← (1 − f)² c + σ² f(2 − f).
    """

    way: ti.f32  # τ f, s
    kept: ti.f32  # 1 − f
    position: ti.f32  # added to a, m²
    cross: ti.f32  # added to b, m²/s
    current: ti.f32  # added to c, m²/s²


@func
def drift_over(time, variance, correlation_time, walk) -> Drift:
    """The drift over a time (s) with σ² (m²/s²), τ (s) and w (m²/s)."""
    tau = correlation_time
    f, spreading = decayed(time / tau)
    spread = variance * tau * tau * spreading + walk * time
    return Drift(
        way=tau * f, kept=1.0 - f, position=spread, cross=variance * tau * f * f, current=variance * f * (2.0 - f)
    )


@func
def drifted(a, b, c, d: Drift):
    """(a, b, c), or vectors of them, after a drift."""
    moved = b + d.way * c
    return a + d.way * (b + moved) + d.position, d.kept * moved + d.cross, d.kept * d.kept * c + d.current


@func
def fixed(a, b, c, r):
    """(a, b, c), or vectors of them, after a fix of the variance r, m²: a r/(a + r), b r/(a + r), c − b²/(a + r)."""
    gain = 1.0 / (a + r)
    left = r * gain
    return a * left, b * left, c - gain * b * b


@kernel
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
    speed: ti.f32,
    step: ti.f32,
    track: array3,
    squared: array2,
):
    for n in range(track.shape[1]):
        for t in range(velocity.shape[0]):
            for c in range(track.shape[2]):
                track[t + 1, n, c] = track[t, n, c]
            v = vec2(velocity[t, n, 0], velocity[t, n, 1])
            carry(track, t + 1, n, v, step, adrift[t, n])
            squared[t, n] = -1.0
            if age[t, n] >= 0.0:
                lag = adrift[t, n] * age[t, n]
                R = vec3(covariance[t, n, 0], covariance[t, n, 1], covariance[t, n, 2])
                z = TrackFix(place=vec2(fix[t, n, 0], fix[t, n, 1]), covariance=R, lag=lag, carried=lag * v)
                squared[t, n] = update(track, t + 1, n, z, variance, speed)
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
    speed: float,
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
        variance, correlation_time: of the current, see `renew`. speed: see `update`, m/s. step: s.
        reading: (T, N, 2) float32, current that the AUV measures at the end of each step, m/s; optional.
        reading_deviation: its standard deviation per axis, m/s, above 0 if there are readings.

    Returns:
        (T + 1, N, COLUMNS) tracks at the start and after each step; (T, N) normalised innovation squared, −1 where
        there was no fix; a fix was rejected where the track's REJECTIONS are not 0.
    """
    steps, count = adrift.shape
    track = start.new_empty((steps + 1, count, COLUMNS))
    track[0] = start
    squared = start.new_empty((steps, count))
    reading = start.new_zeros((1, 1, 2)) if reading is None else reading
    velocity, adrift, fix, covariance, age, reading = (
        array.contiguous() for array in (velocity, adrift, fix, covariance, age, reading)
    )
    model = (reading_deviation**2, variance, correlation_time, speed, step)
    _follow(velocity, adrift, fix, covariance, age, reading, *model, track, squared)
    return track, squared
