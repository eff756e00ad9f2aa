"""Fisher information of the boat's fixes about horizontal positions (Eq. 2), of a level and of a tilted array.

A level array: with d_k the horizontal offset of AUV k, z_k its vertical separation, q = S_k² = |d_k|² + z_k² and n_k
the vector d_k turned by a right angle,

    J = Σ_k J_k,  J_k = a_k(q) I + b_k(q) n_k n_kᵀ,  1/T_k = S_k² σ_k²/κ_k² + ε² z_k²,
    ln (κ²/(σ² q)) = level − power ln(q/S_0²) − decay (√q − S_0),

which is regular beneath the boat and positive definite (a, b ≥ 0). 1/T is the variance of a fix across its line of
sight, from phase noise and the attitude error ε in pitch and roll. σ by the sonar equation gives power =
1 + 3/4 · paths · exponent (echo 2.5, transponder 1.75; under the demonstration's noise law 4 and 2.5) and a decay by
absorption; a constant σ gives 1 and 0. These constants are in `acoustic_link.link_table`. Two measurements:

- PHASE, Eq. 1's two phase differences at known depth: T [s⁴ r̂r̂ᵀ + t̂t̂ᵀ] with s² = z²/q, so a = T z⁴/q² and
  b = T (1 + z²/q)/q. That is HᵀR⁻¹H with the exact Jacobian H. The information in the noise's strength about the
  range, 4 (d ln σ/dρ)², is neglected: 2e-4 per m² at S = 141 m, compared with T = 3 per m².
- FIX, phases and slant range, depth unknown and marginalised. Three measurements of three unknowns: the inverse of the
  Schur complement is the covariance I/T + (σ_S²/S²) d dᵀ. Its second term is below 1e-6 of the first (σ_S ~ 0.1 mm) and
  dropped: a = T, b = 0.

The attitude error is common to all fixes of one step; the resulting correlation between AUVs is neglected.

A fix can fail (`log_good`): it is good with the probability p = Φ(√(a² + 7) − √T_0) Φ((κ'² − κ² ρ²/q) a/(2 √8 κ')),
that its amplitude, √(a² + 7) with a² = 8/σ², exceeds the threshold √T_0 (`usvauv.kernels.positioning.usbl`), and that
noise does not carry its phases beyond κ' = min(κ, π), where they wrap or have no real direction. a includes the loss in
bubbles. Φ is taken as logistic, and the distance of the phases' length κ ρ/√q from κ' by its square. Objectives
(`usvauv.kernels.planning.objectives`) weigh an AUV's information by p.

A tilted array (`tilted_covariance`, `tilted_information`): pitch and roll follow from the surface's slope
(`usbl.attitude`) and are measured with the error ε; systematic errors are included. FIX is `usbl.horizontal_covariance`
plus `systematic_covariance`. For PHASE, with r the offset, q = |r|² and b = A r in the array's frame, the phases are
κ (b_x, b_y)/√q, so

    H_ij = ∂(b_i/√q)/∂d_j = (A_ij − b_i r_j/q)/√q,
    R = σ²/κ² I + (ε² + ε_a²)/q Σ (∂b/∂angle)(∂b/∂angle)ᵀ + (σ_c/c)² b bᵀ/q + H C_p Hᵀ,
    J = Hᵀ R⁻¹ H,   C = H⁻¹ R H⁻ᵀ,

with ε_a of the alignment, C_p of `usbl.placement_covariance`, and |det H| = |z b_z|/q²: the solid angle that an area
on the bed has, and that of the projected directions. The planner itself supposes a level array, since the tilt at a
place the boat is yet to reach is unknown.
"""

from typing import Any, NamedTuple

import taichi as ti
import torch

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.limits import MAX_AUVS
from usvauv.kernels.positioning import acoustic_link, usbl
from usvauv.kernels.positioning.acoustic_link import (
    ATTITUDE,
    BUBBLES,
    CERTAIN,
    CERTAINTY,
    DECAY,
    HORIZON,
    KAPPA,
    LEVEL,
    MOST_BUBBLES,
    NOISE_EXPONENT,
    PATHS,
    POWER,
    REFERENCE,
    THRESHOLD,
)
from usvauv.kernels.positioning.sonar import LN10
from usvauv.kernels.types import array2, array3, index1, mat2, vec2, vec3

PHASE = 0
FIX = 1
MEASUREMENTS = ("phase", "fix")
each_auv = ti.types.vector(MAX_AUVS, ti.f32)
indices = ti.types.vector(MAX_AUVS, ti.i32)
mat2x3 = ti.types.matrix(2, 3, ti.f32)


class Team(NamedTuple):
    """The AUVs of one world, arrays and numbers inside a kernel.

    Attributes:
        estimate: (W, K, 3) estimated x, y and vertical separation of every AUV, m.
        link: (K, COLUMNS) of `acoustic_link.link_table`.
        world: the row of `estimate`.
        count: K, at most the rows of `link` and MAX_AUVS; with `members` their number.
        members: vector of the indices of the AUVs that the boat plans for; None for all of them.
    """

    estimate: ti.types.ndarray
    link: ti.types.ndarray
    world: ti.i32
    count: ti.i32
    members: Any = None

    @property
    def whole(self) -> bool:
        """Whether the boat plans for all AUVs of the world."""
        return self.members is None


@func
def member(team: ti.template(), k) -> ti.i32:
    """Index in the arrays of the team's AUV k."""
    index = k
    if ti.static(not team.whole):
        index = team.members[k]
    return index


@func
def position(team: ti.template(), k) -> vec2:
    """Estimated horizontal position of AUV k, m."""
    return vec2(team.estimate[team.world, member(team, k), 0], team.estimate[team.world, member(team, k), 1])


@func
def squared_separation(team: ti.template(), k):
    """z² of AUV k's vertical separation z (m), at least 1 m²: the laws of sound begin at 1 m."""
    z = team.estimate[team.world, member(team, k), 2]
    return ti.max(z * z, 1.0)


@func
def mean_position(team: ti.template()) -> vec2:
    """Mean of the AUVs' estimated horizontal positions, m."""
    mean = vec2(0.0, 0.0)
    for k in range(team.count):
        mean += position(team, k) / team.count
    return mean


def check_team(points: torch.Tensor, places: torch.Tensor) -> None:
    """Check the layouts (n, K, 3) of n teams, and one place (n, 2) for each.

    Raises:
        ValueError: more AUVs than kernels provide for, or not one place for each layout.
    """
    if places.shape != (points.shape[0], 2):
        raise ValueError(f"places: {tuple(places.shape)} must be ({points.shape[0]}, 2)")
    if points.shape[1] > MAX_AUVS:
        raise ValueError(f"points: {points.shape[1]} AUVs, at most {MAX_AUVS} are possible")


@func
def log_T(link: ti.template(), k, q):
    """ln κ²/(σ² q) of AUV k at the squared slant range q (m²), without attitude error; T in 1/m²."""
    S0 = link[k, REFERENCE]
    return link[k, LEVEL] - link[k, POWER] * ti.log(q / (S0 * S0)) - link[k, DECAY] * (ti.sqrt(q) - S0)


@func
def log_signal(link: ti.template(), k, q) -> vec3:
    """`log_T` and its first two derivatives by q (m²)."""
    i = 1.0 / q
    decay = 0.5 * link[k, DECAY] / ti.sqrt(q)
    return vec3(log_T(link, k, q), -link[k, POWER] * i - decay, link[k, POWER] * i * i + 0.5 * decay * i)


@func
def log_strength(link: ti.template(), k, q, z2) -> vec3:
    """ln p T of AUV k, attitude error included, and its first two derivatives by q (m²) at constant z2 = z²."""
    f = log_signal(link, k, q)
    good = vec3(0.0)
    if not is_certain(link, k, ti.exp(f[0]), q, z2):
        good = log_good(link, k, f, q, z2)
    if link[k, ATTITUDE] > 0.0:
        u = link[k, ATTITUDE] * z2 * ti.exp(f[0])
        fraction = 1.0 / (1.0 + u)
        f = vec3(f[0] - ti.log(1.0 + u), f[1] * fraction, (f[2] - u * fraction * f[1] * f[1]) * fraction)
    return f + good


LOGISTIC = 1.702  # 1/(1 + e^{−1.702 x}) is the normal distribution function within 0.01
ROOT_8 = 2.8284271247461903


@func
def is_certain(link: ti.template(), k, T, q, z2) -> bool:
    """Whether AUV k's fix is good but for one in a billion, at the squared slant range q and height z2 (m²).

    Args:
        T: exp of `log_T`.
    """
    kappa, horizon = link[k, KAPPA], link[k, HORIZON]
    b = (horizon * horizon - kappa * kappa * (1.0 - z2 / q)) / (2.0 * horizon)
    aligned = b > 0.0 and b * b * T * q >= CERTAINTY * CERTAINTY * kappa * kappa
    return (T * q >= link[k, CERTAIN] and aligned) or link[k, CERTAIN] == 0.0


@func
def log_logistic(u: vec3) -> vec3:
    """ln 1/(1 + e^{−1.702 u}) with its first two derivatives, from u and its own."""
    m = LOGISTIC * u
    off = 1.0 / (1.0 + ti.exp(ti.math.clamp(m[0], -80.0, 80.0)))
    value = ti.min(m[0], 0.0) - ti.log(1.0 + ti.exp(-ti.abs(m[0])))
    return vec3(value, off * m[1], off * (m[2] - (1.0 - off) * m[1] * m[1]))


@func
def log_good(link: ti.template(), k, f: vec3, q, z2) -> vec3:
    """ln p, that a fix of AUV k is good, and its first two derivatives by q (m²) at constant z2 = z².

    Args:
        f: of `log_signal`.
    """
    i = 1.0 / q
    kappa, horizon = link[k, KAPPA], link[k, HORIZON]
    each_db = 0.1 * LN10 * link[k, NOISE_EXPONENT] * link[k, PATHS]
    bubbles = each_db * link[k, BUBBLES] * ti.sqrt(q / z2)
    E = vec3(f[0] - ti.log(0.125 * kappa * kappa * i), f[1] + i, f[2] - i * i)  # ln a²
    if bubbles < each_db * MOST_BUBBLES:
        E = E - bubbles * vec3(1.0, 0.5 * i, -0.25 * i * i)
    else:
        E[0] -= each_db * MOST_BUBBLES
    A = ti.exp(ti.math.clamp(E[0], -80.0, 80.0)) * vec3(1.0, E[1], E[2] + E[1] * E[1])
    root = 1.0 / ti.sqrt(A[0] + 7.0)
    half = 0.5 * A[1] * root
    above = vec3((A[0] + 7.0) * root - ti.sqrt(link[k, THRESHOLD]), half, 0.5 * A[2] * root - half * half * root)
    a = ti.sqrt(A[0]) * vec3(1.0, 0.5 * E[1], 0.5 * E[2] + 0.25 * E[1] * E[1])
    c = kappa * kappa * z2 * i
    b = vec3(horizon * horizon - kappa * kappa + c, -c * i, 2.0 * c * i * i) / (2.0 * ROOT_8 * horizon)
    within = vec3(b[0] * a[0], b[1] * a[0] + b[0] * a[1], b[2] * a[0] + 2.0 * b[1] * a[1] + b[0] * a[2])
    return log_logistic(above) + log_logistic(within)


@func
def times_T(T, L1, L2, g, g1, g2) -> vec3:
    """T g and its first two derivatives, from T, the derivatives L1, L2 of ln T, and g, g', g''."""
    return T * vec3(g, L1 * g + g1, (L1 * L1 + L2) * g + 2.0 * L1 * g1 + g2)


@func
def coefficients(measurement: ti.template(), T: vec3, rho2, z2) -> mat2x3:
    """Rows a and b; columns the value, d/dq, d²/dq² at q = rho2 + z2 (m²), from T and two derivatives of ln T."""
    i = 1.0 / (rho2 + z2)
    s2 = z2 * i
    s4 = s2 * s2
    a = vec3(0.0, 0.0, 0.0)
    b = vec3(0.0, 0.0, 0.0)
    if ti.static(measurement == PHASE):
        a = times_T(T[0], T[1], T[2], s4, -2.0 * s4 * i, 6.0 * s4 * i * i)
        b = times_T(T[0], T[1], T[2], (1.0 + s2) * i, -(1.0 + 2.0 * s2) * i * i, (2.0 + 6.0 * s2) * i * i * i)
    else:
        a = times_T(T[0], T[1], T[2], 1.0, 0.0, 0.0)
    return mat2x3([[a[0], a[1], a[2]], [b[0], b[1], b[2]]])


@func
def information(team: ti.template(), measurement: ti.template(), place: vec2) -> vec3:
    """J = (J11, J12, J22) in 1/m² expected of a fix, summed over a `Team`, for a boat at `place` (m); PHASE or FIX."""
    J = vec3(0.0, 0.0, 0.0)
    for k in range(team.count):
        d = place - position(team, k)
        z2 = squared_separation(team, k)
        f = log_strength(team.link, member(team, k), d.norm_sqr() + z2, z2)
        c = coefficients(measurement, vec3(ti.exp(f[0]), f[1], f[2]), d.norm_sqr(), z2)
        J += vec3(c[0, 0] + c[1, 0] * d[1] * d[1], -c[1, 0] * d[0] * d[1], c[0, 0] + c[1, 0] * d[0] * d[0])
    return J


@kernel
def _information_batch(link: array2, points: array3, boat: array2, measurement: ti.template(), out: array2):
    for i in range(points.shape[0]):
        team = ti.static(Team(points, link, i, points.shape[1]))
        J = information(team, measurement, vec2(boat[i, 0], boat[i, 1]))
        for j in ti.static(range(3)):
            out[i, j] = J[j]


def information_batch(
    link: torch.Tensor, points: torch.Tensor, boat: torch.Tensor, *, measurement: int = PHASE
) -> torch.Tensor:
    """`information` for boats (n, 2) and layouts (n, K, 3): J = (J11, J12, J22) in 1/m², (n, 3)."""
    out = points.new_empty((points.shape[0], 3))
    _information_batch(link, points, boat, measurement, out)
    return out


@func
def packed(M: mat2) -> vec3:
    """(xx, xy, yy) of a symmetric matrix."""
    return vec3(M[0, 0], M[0, 1], M[1, 1])


@func
def phase_jacobian(offset: vec3, slope: vec2) -> mat2:
    """H: derivatives of the two direction cosines in the array's frame by the AUV's x and y, 1/m."""
    axes = usbl.array_axes(usbl.attitude(slope))
    body = axes @ offset
    q = offset.norm_sqr()
    bx = body[0] / q
    by = body[1] / q
    rows = mat2(
        [
            [axes[0, 0] - bx * offset[0], axes[0, 1] - bx * offset[1]],
            [axes[1, 0] - by * offset[0], axes[1, 1] - by * offset[1]],
        ]
    )
    return rows / ti.sqrt(q)


@func
def phase_noise(link: ti.template(), k, offset: vec3, slope: vec2) -> mat2:
    """R: covariance of the two direction cosines by phase noise, attitude error and systematic errors."""
    axes = usbl.array_axes(usbl.attitude(slope))
    body = axes @ offset
    q = offset.norm_sqr()
    deviation = acoustic_link.phase_deviation(link, k, ti.sqrt(q), offset[2], 1.0) / link[k, acoustic_link.KAPPA]
    by_pitch = vec2(axes[0, 0] * offset[2] - axes[0, 2] * offset[0], axes[2, 1] * body[0])
    by_roll = vec2(0.0, body[2])
    cosines = vec2(body[0], body[1]) / ti.sqrt(q)
    H = phase_jacobian(offset, slope)
    common = usbl.placement_covariance(link, k, offset)
    turning = link[k, acoustic_link.ATTITUDE] + link[k, acoustic_link.ALIGNMENT]
    noise = deviation * deviation * mat2([[1.0, 0.0], [0.0, 1.0]])
    noise += turning / q * (by_pitch.outer_product(by_pitch) + by_roll.outer_product(by_roll))
    noise += link[k, acoustic_link.SOUND_SPEED] * cosines.outer_product(cosines)
    return noise + H @ mat2([[common[0], common[1]], [common[1], common[2]]]) @ H.transpose()


@func
def tilted_covariance(link: ti.template(), k, measurement, offset: vec3, slope: vec2) -> vec3:
    """Covariance (xx, xy, yy) of the position of AUV k, m².

    Args:
        link: (K, COLUMNS) of `acoustic_link.link_table`; the attitude error is that of the planner.
        measurement: PHASE or FIX.
        offset: AUV minus boat, m; below the boat z is negative.
        slope: surface slopes (∂η/∂x, ∂η/∂y) under the boat. The AUV must not lie in the array's plane, and for PHASE
            not at its height either.
    """
    C = vec3(0.0, 0.0, 0.0)
    if measurement == PHASE:
        H = phase_jacobian(offset, slope)
        adjugate = mat2([[H[1, 1], -H[0, 1]], [-H[1, 0], H[0, 0]]])
        q = offset.norm_sqr()
        # From the geometry: the determinant of H cancels far from the nadir.
        determinant = offset[2] * (usbl.array_axes(usbl.attitude(slope)) @ offset)[2] / (q * q)
        root = adjugate / determinant
        C = packed(root @ phase_noise(link, k, offset, slope) @ root.transpose())
    else:
        sigma = acoustic_link.phase_deviation(link, k, offset.norm(), offset[2], 1.0)
        axes = usbl.array_axes(usbl.attitude(slope))
        C = usbl.horizontal_covariance(link, k, offset, axes, sigma)
        C += usbl.systematic_covariance(link, k, offset, axes)
    return C


@func
def tilted_information(link: ti.template(), k, measurement, offset: vec3, slope: vec2) -> vec3:
    """J = (J11, J12, J22) of AUV k, 1/m²; arguments as `tilted_covariance`."""
    J = vec3(0.0, 0.0, 0.0)
    if measurement == PHASE:
        H = phase_jacobian(offset, slope)
        J = packed(H.transpose() @ phase_noise(link, k, offset, slope).inverse() @ H)
    else:
        C = tilted_covariance(link, k, measurement, offset, slope)
        J = vec3(C[2], -C[1], C[0]) / (C[0] * C[2] - C[1] * C[1])
    return J


@kernel
def _tilted_batch(
    link: array2,
    auv: index1,
    measurement: ti.i32,
    offset: array2,
    slope: array2,
    variance: array2,
    J: array2,
    cosines: array2,
):
    for i in range(offset.shape[0]):
        r = vec3(offset[i, 0], offset[i, 1], offset[i, 2])
        s = vec2(slope[i, 0], slope[i, 1])
        C = tilted_covariance(link, auv[i], measurement, r, s)
        j = tilted_information(link, auv[i], measurement, r, s)
        for m in ti.static(range(3)):
            variance[i, m] = C[m]
            J[i, m] = j[m]
        body = usbl.array_axes(usbl.attitude(s)) @ r / r.norm()
        for m in ti.static(range(2)):
            cosines[i, m] = body[m]


def tilted_batch(
    link: torch.Tensor, auv: torch.Tensor, offset: torch.Tensor, slope: torch.Tensor, *, measurement: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """`tilted_covariance` and `tilted_information` for many positions, and their directions from the array.

    Args:
        link: (K, COLUMNS) float32.
        auv: (n,) int32, row of the table for each.
        offset, slope: (n, 3) m and (n, 2), float32.
        measurement: PHASE or FIX.

    Returns:
        (n, 3) covariance, m², (n, 3) information, 1/m², and (n, 2) direction cosines in the array's frame. Covariance
        and information are each accurate in their larger eigenvalue; where these are far apart, as for PHASE far from
        the nadir, take the smaller one from the other matrix.
    """
    variance, J, cosines = (offset.new_empty((offset.shape[0], columns)) for columns in (3, 3, 2))
    _tilted_batch(link, auv, measurement, offset, slope, variance, J, cosines)
    return variance, J, cosines
