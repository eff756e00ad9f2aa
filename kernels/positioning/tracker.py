"""Tracker of each AUV: a Kalman filter on position and current, from measured velocity and USBL fixes.

State (x, y, c_x, c_y), where c is what the measured velocity lacks: the current where that is through the water, or the
log's bias, an Ornstein–Uhlenbeck process dc = −c/τ dt + σ √(2/τ) dW. Position and c move together (`drift`); while the
AUV holds its place by itself only c changes (`renew`). A fix is x + n, n ~ N(0, R), R its predicted covariance. For
given σ² and τ and Gaussian fixes this is the least-squares estimate. A fix in Cartesian coordinates and a velocity in
the world's frame make the filter linear; only R is linearised. The covariance consists of 2 × 2 blocks A (position), B
(position, current), C (current). After a fix, S = A + R, they are R S⁻¹ A = (|A| R + |R| A)/|S|, R S⁻¹ B and
C − Bᵀ S⁻¹ B: I − gain, written as R S⁻¹, does not cancel, and a sum of positive definite blocks with positive weights
stays so in single precision.

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

from usvauv.kernels.functions import func
from usvauv.kernels.positioning.usbl import GATE, Expectation, squared_innovation
from usvauv.kernels.types import mat2, vec2, vec3

# Columns of a track: the state, the upper triangle of its covariance; how many fixes in a row were rejected and agree
# with one another, the last of them, and the time since.
X, Y, CURRENT_X, CURRENT_Y = range(4)
XX, XY, XU, XV, YY, YU, YV, UU, UV, VV = range(4, 14)
REJECTIONS, REJECTED_X, REJECTED_Y, REJECTED_AGE = range(14, 18)
COLUMNS = 18
AGE = 14  # where an AUV has the state and its covariance from the boat, the column of the time since, s
OWN_COLUMNS = 15
CONFIRMATIONS = 3


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
def spread(track: ti.template(), w, k, variance):
    """Add a variance per axis (m²) to the position's covariance."""
    track[w, k, XX] = track[w, k, XX] + variance
    track[w, k, YY] = track[w, k, YY] + variance


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
def reject(track: ti.template(), w, k, place: vec2, covariance: vec3, variance, speed):
    """Note a fix beyond the gate; begin the track anew where it confirms those rejected before it."""
    last = vec2(track[w, k, REJECTED_X], track[w, k, REJECTED_Y])
    near = Expectation(place=last, covariance=covariance, reach=speed * track[w, k, REJECTED_AGE])
    in_a_row = 1.0
    if track[w, k, REJECTIONS] > 0.0 and squared_innovation(near, place, covariance) <= GATE:
        in_a_row += track[w, k, REJECTIONS]
    track[w, k, REJECTIONS] = in_a_row
    track[w, k, REJECTED_X] = place[0]
    track[w, k, REJECTED_Y] = place[1]
    track[w, k, REJECTED_AGE] = 0.0
    if in_a_row >= CONFIRMATIONS:
        begin(track, w, k, place[0], place[1], covariance, variance)


@func
def update(track: ti.template(), w, k, place: vec2, covariance: vec3, variance, speed):
    """Update by a fix of now; returns its normalised innovation squared, χ² of two degrees of freedom.

    A fix beyond the gate changes nothing, except that the track counts it in REJECTIONS, or begins anew with it; after
    a fix that was used REJECTIONS is 0.

    Args:
        track: (W, K, COLUMNS) float32, moved to the time of the fix; `w` and `k` select the AUV.
        place: measured position, m.
        covariance: of that, (xx, xy, yy), m²; positive definite.
        variance: of the current, see `renew`; for a track that begins anew.
        speed: greatest of the AUV over ground, m/s; how far rejected fixes that agree can be apart.
    """
    R = mat2([[covariance[0], covariance[1]], [covariance[1], covariance[2]]])
    innovation = place - vec2(track[w, k, X], track[w, k, Y])
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
        reject(track, w, k, place, covariance, variance, speed)
    return squared


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
