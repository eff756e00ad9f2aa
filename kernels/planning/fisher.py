"""Fisher information of the boat's fixes about horizontal positions (Eq. 2), and its derivatives by distance.

With d_k the horizontal offset of AUV k, z_k its vertical separation, q = S_k² = |d_k|² + z_k² and n_k the vector d_k
turned by a right angle,

    J = Σ_k J_k,  J_k = a_k(q) I + b_k(q) n_k n_kᵀ,  1/T_k = S_k² σ_k²/κ_k² + ε² z_k²,
    ln (κ²/(σ² q)) = level − power ln(q/S_0²) − decay (√q − S_0),

which is regular beneath the boat and positive definite (a, b ≥ 0). 1/T is the variance of a level array's fix across
its line of sight, from phase noise and the attitude error ε in pitch and roll. σ by the sonar equation gives power =
1 + 3/4 · paths · exponent (echo 2.5, transponder 1.75; under the demonstration's noise law 4 and 2.5) and a decay by
absorption; a constant σ gives 1 and 0. These constants are in `acoustic_link.link_table`. Two measurements:

- PHASE, Eq. 1's two phase differences at known depth: T [s⁴ r̂r̂ᵀ + t̂t̂ᵀ] with s² = z²/q, so a = T z⁴/q² and
  b = T (1 + z²/q)/q. That is HᵀR⁻¹H with the exact Jacobian H. The information in the noise's strength about the
  range, 4 (d ln σ/dρ)², is neglected: 2e-4 per m² at S = 141 m, compared with T = 3 per m².
- FIX, phases and slant range, depth unknown and marginalised. Three measurements of three unknowns: the inverse of the
  Schur complement is the covariance I/T + (σ_S²/S²) d dᵀ. Its second term is below 1e-6 of the first (σ_S ~ 0.1 mm) and
  dropped: a = T, b = 0.

The attitude error is common to all fixes of one step; the resulting correlation between AUVs is neglected.
`usvauv.kernels.planning.tilted_array` has J for an array that does not lie level.
"""

import taichi as ti
import torch

from usvauv.kernels.planning.team import Team, member, position, squared_separation
from usvauv.kernels.positioning.acoustic_link import ATTITUDE, DECAY, LEVEL, POWER, REFERENCE
from usvauv.kernels.types import array2, array3, vec2, vec3

PHASE = 0
FIX = 1
MEASUREMENTS = ("phase", "fix")

mat2x3 = ti.types.matrix(2, 3, ti.f32)


@ti.func
def log_T(link: ti.template(), k, q):
    """ln κ²/(σ² q) of AUV k at the squared slant range q (m²), without attitude error; T in 1/m²."""
    S0 = link[k, REFERENCE]
    return link[k, LEVEL] - link[k, POWER] * ti.log(q / (S0 * S0)) - link[k, DECAY] * (ti.sqrt(q) - S0)


@ti.func
def log_signal(link: ti.template(), k, q) -> vec3:
    """`log_T` and its first two derivatives by q (m²)."""
    i = 1.0 / q
    decay = 0.5 * link[k, DECAY] / ti.sqrt(q)
    return vec3(log_T(link, k, q), -link[k, POWER] * i - decay, link[k, POWER] * i * i + 0.5 * decay * i)


@ti.func
def log_strength(link: ti.template(), k, q, z2) -> vec3:
    """ln T of AUV k, attitude error included, and its first two derivatives by q (m²) at constant z2 = z²."""
    f = log_signal(link, k, q)
    if link[k, ATTITUDE] > 0.0:
        u = link[k, ATTITUDE] * z2 * ti.exp(f[0])
        fraction = 1.0 / (1.0 + u)
        f = vec3(f[0] - ti.log(1.0 + u), f[1] * fraction, (f[2] - u * fraction * f[1] * f[1]) * fraction)
    return f


@ti.func
def times_T(T, L1, L2, g, g1, g2) -> vec3:
    """T g and its first two derivatives, from T, the derivatives L1, L2 of ln T, and g, g', g''."""
    return T * vec3(g, L1 * g + g1, (L1 * L1 + L2) * g + 2.0 * L1 * g1 + g2)


@ti.func
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


@ti.func
def information(team: ti.template(), measurement: ti.template(), place: vec2) -> vec3:
    """J = (J11, J12, J22) in 1/m², summed over the AUVs of a `Team`, for a boat at `place` (m); PHASE or FIX."""
    J = vec3(0.0, 0.0, 0.0)
    for k in range(team.count):
        d = place - position(team, k)
        z2 = squared_separation(team, k)
        f = log_strength(team.link, member(team, k), d.norm_sqr() + z2, z2)
        c = coefficients(measurement, vec3(ti.exp(f[0]), f[1], f[2]), d.norm_sqr(), z2)
        J += vec3(c[0, 0] + c[1, 0] * d[1] * d[1], -c[1, 0] * d[0] * d[1], c[0, 0] + c[1, 0] * d[0] * d[0])
    return J


@ti.kernel
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
