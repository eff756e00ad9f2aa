"""Objectives of the planner: optimality criteria of the information on all positions, and the paper's (Eq. 2–3).

K positions are estimated. Objectives are evaluated as logarithms, here with T_k, q, z and d as in
`usvauv.kernels.planning.information`, ρ = |d|:

- D: ln det J = Σ_k ln det J_k, the volume of the error ellipsoid.
- A: −ln tr J⁻¹, the sum of all variances.
- SUM: ln det Σ_k J_k, the paper's Eq. 2. It treats the fixes as measurements of one offset common to all, so one very
  good fix makes up for a bad one and the boat parks above one AUV. It has neither of the systematic errors below.
- In D and A an AUV whose fix is good with the probability p < 1 counts as expected: with a good fix J_k is that of the
  fix, without one it is J_0 = I/σ_0², σ_0 the deviation of its position in the area. D is Σ_k p ln det J_k + (1 − p) ln
  det J_0, A −ln Σ_k p tr J_k⁻¹ + (1 − p) tr J_0⁻¹, and a fix that says less than J_0 is worth nothing. In SUM J_k is
  p J_k. So an AUV out of range moves the boat no more, and where all fixes are good these are the determinants.
- PAPER: Eq. 3a as it is printed, (K/S0²)² [3m sin²γ0 + (sin⁴γ0 + 1)² χ], for unequal ranges taken as
  3 Σ T_k² s_k² + Σ_{i<j} T_i T_j (1 + s_i⁴)(1 + s_j⁴) sin²α_ij, without attitude error. It is the determinant of no
  information matrix. sin²α jumps beneath the boat; ρ² + (1 m)² in place of ρ² makes it smooth.

J of D and A is that of the whole error of a fix: errors of alignment ε_a, heading ε_h, speed of sound σ_c/c and the
array's position σ_p are unknowns with normal priors, and marginalised. A block's inverse has the variances

    across the line of sight   1/T + ε_a² z² + σ_p² + ε_h² ρ²,
    along it, FIX              1/T + ε_a² z² + σ_p² + 4 (σ_c/c)² ρ²,
    along it, PHASE            q²/z⁴ (1/T + ε_a² z² + (σ_c/c)² ρ²) + σ_p²,

what `tilted_covariance` of `usvauv.kernels.planning.information` has for a level array. D and A depend on the AUVs'
distances only, and every variance grows with distance, so the maximum lies in the AUVs' convex hull. Both variances of
a block are convex functions of the boat's place. So A, whose tr J⁻¹ is their sum, has no local maximum except the
global one; D can have several.

SUM of PHASE and PAPER (`log_det_of_sum`): with J_k = a_k I + b_k n_k n_kᵀ, P = J_11, Q = J_22, R = J_12,

    det J = P Q − R² + E,

E = 0 for SUM. With a = 0 and b = T (1 + s⁴)/ρ² the second sum of PAPER has the shape of P Q − R², and its first is E.
Far from shallow AUVs J is nearly singular, and P Q − R² a small difference of large numbers. So the axes are those
along and across the line of sight of the AUV m with the largest b_k ρ_k². It adds nothing to R, and by the inequality
of Cauchy and Schwarz R² ≤ (1 − 1/K) P Q: the difference is at least 1/K of P Q. Each T is divided by the largest one.
"""

import taichi as ti
import torch

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.planning import jet
from usvauv.kernels.planning.information import (
    FIX,
    MEASUREMENTS,
    PHASE,
    Team,
    check_team,
    coefficients,
    each_auv,
    is_certain,
    log_good,
    log_signal,
    log_strength,
    member,
    position,
    squared_separation,
    times_T,
)
from usvauv.kernels.positioning.acoustic_link import ALIGNMENT, ATTITUDE, HEADING, POSITION, SOUND_SPEED, UNLOCATED
from usvauv.kernels.types import array2, array3, mat3, vec2, vec3, vec6

OBJECTIVES = ("d", "a", "sum", "paper")
D, A, SUM, PAPER = range(4)
MOST_LOG = 80.0  # of a variance (m²), in magnitude: beyond, single precision has no room for its square


def objective_code(measurement: str, objective: str) -> int:
    """The constant of kernels that stands for a scenario's planner.measurement and planner.objective.

    Raises:
        ValueError: unknown name.
    """
    for name, value, allowed in (("measurement", measurement, MEASUREMENTS), ("objective", objective, OBJECTIVES)):
        if value not in allowed:
            raise ValueError(f"{name}: {value!r} is not one of {', '.join(allowed)}")
    return 2 * OBJECTIVES.index(objective) + MEASUREMENTS.index(measurement)


def objective_of(code: int) -> int:
    """D, A, SUM or PAPER. Codes are constants of a kernel, so that only one objective is compiled into it."""
    return code // 2


def measurement_of(code: int) -> int:
    """PHASE or FIX."""
    return code % 2


@func
def log_sum_of_variances(f: vec3, own, other: vec3) -> vec3:
    """ln(e^−f + other) with its first two derivatives, from those of f and of `other`, which is not negative.

    Args:
        own: e^−f.
    """
    precision = 1.0 / (own + other[0])
    share = own * precision
    slope = other[1] * precision - f[1] * share
    return vec3(-ti.log(precision), slope, other[2] * precision + (f[1] * f[1] - f[2]) * share - slope * slope)


@func
def log_variances(link: ti.template(), k, code: ti.template(), f: vec3, own, rho2, z2):
    """ln of the variances (m²) of AUV k's fixes across and along the line of sight, for D and A.

    Each with its first two derivatives by q = rho2 + z2 (m²) at constant z2 = z².

    Args:
        f: of `log_signal`. own: e^−f.
    """
    q = rho2 + z2
    turning = (link[k, ATTITUDE] + link[k, ALIGNMENT]) * z2
    place, heading, speed = link[k, POSITION], link[k, HEADING], link[k, SOUND_SPEED]
    across = log_sum_of_variances(f, own, vec3(turning + place + heading * rho2, heading, 0.0))
    along = vec3(0.0)
    if ti.static(measurement_of(code) == FIX):
        along = log_sum_of_variances(f, own, vec3(turning + place + 4.0 * speed * rho2, 4.0 * speed, 0.0))
    else:
        i = 1.0 / q
        s2 = z2 * i
        shrunk = place * s2 * s2
        slope = speed - 2.0 * shrunk * i
        along = log_sum_of_variances(f, own, vec3(turning + speed * rho2 + shrunk, slope, 6.0 * shrunk * i * i))
        along += vec3(-2.0 * ti.log(s2), 2.0 * i, -2.0 * i * i)
    return across, along


@func
def expected(code: ti.template(), g: vec3, good: vec3, unlocated) -> vec3:
    """`log_variance` of a fix that may fail, from that of a good one and ln p, each with its first two derivatives.

    Args:
        unlocated: −ln det J_0.
    """
    p = ti.exp(good[0]) * vec3(1.0, good[1], good[2] + good[1] * good[1])
    found = vec3(unlocated, 0.0, 0.0)
    if ti.static(objective_of(code) == D):
        gain = g[0] - unlocated
        if gain < 0.0:
            found = vec3(
                unlocated + p[0] * gain, p[1] * gain + p[0] * g[1], p[2] * gain + 2.0 * p[1] * g[1] + p[0] * g[2]
            )
    else:
        found[0] = 0.5 * unlocated + 0.6931471805599453  # ln tr J_0⁻¹
        if g[0] < found[0]:
            v = ti.exp(g[0] - found[0]) * vec3(1.0, g[1], g[2] + g[1] * g[1])
            v[0] -= 1.0
            t = vec3(1.0 + p[0] * v[0], p[1] * v[0] + p[0] * v[1], p[2] * v[0] + 2.0 * p[1] * v[1] + p[0] * v[2])
            slope = t[1] / t[0]
            found = vec3(found[0] + ti.log(t[0]), slope, t[2] / t[0] - slope * slope)
    return found


@func
def log_variance(link: ti.template(), k, code: ti.template(), rho2, z2) -> vec3:
    """Expected ln det, or ln of the expected tr, of J_k⁻¹ for D, A, and −ln p T_k for SUM of FIX.

    The value and its first two derivatives by q = rho2 + z2 (m²).
    """
    objective = ti.static(objective_of(code))
    g = vec3(0.0)
    if ti.static(objective == SUM):
        g = -1.0 * log_strength(link, k, rho2 + z2, z2)
    else:
        q = rho2 + z2
        f = log_signal(link, k, q)
        own = ti.exp(ti.math.clamp(-f[0], -MOST_LOG, MOST_LOG))
        across, along = log_variances(link, k, code, f, own, rho2, z2)
        if ti.static(objective == D):
            g = across + along
        else:
            larger = ti.max(across[0], along[0])
            a = ti.exp(across[0] - larger)
            total = a + ti.exp(along[0] - larger)
            a /= total
            slope = a * across[1] + (1.0 - a) * along[1]
            bend = a * (across[2] + across[1] * across[1]) + (1.0 - a) * (along[2] + along[1] * along[1])
            g = vec3(larger + ti.log(total), slope, bend - slope * slope)
        if not is_certain(link, k, 1.0 / own, q, z2):
            g = expected(code, g, log_good(link, k, f, q, z2), -1.0 * link[k, UNLOCATED])
    return g


@func
def auv_variance(team: ti.template(), code: ti.template(), k, place: vec2) -> vec6:
    """`log_variance` of AUV k as a jet of the boat's place."""
    d = place - position(team, k)
    z2 = squared_separation(team, k)
    return jet.of_squared_distance(log_variance(team.link, member(team, k), code, d.norm_sqr(), z2), d[0], d[1])


@func
def log_det(team: ti.template(), code: ti.template(), place: vec2) -> vec6:
    """Objective D."""
    f = vec6(0.0)
    for k in range(team.count):
        f = f - auv_variance(team, code, k, place)
    return f


@func
def log_sum(team: ti.template(), code: ti.template(), sign: ti.template(), place: vec2) -> vec6:
    """ln Σ_k exp(`sign` · `auv_variance`)."""
    largest = -1e30
    total = vec6(0.0)  # Σ of w, w ∇g, w (∇²g + ∇g ∇gᵀ) with w = exp(g − largest)
    for k in range(team.count):
        g = sign * auv_variance(team, code, k, place)
        height = g[jet.VALUE]
        if height > largest:
            total *= ti.exp(largest - height)
            largest = height
        term = jet.add_gradient_product(g, 1.0)
        term[jet.VALUE] = 1.0
        total += ti.exp(height - largest) * term
    f = jet.logarithm(total)
    f[jet.VALUE] += largest
    return f


@func
def terms(strength: vec3, printed: ti.template(), rho2, z2) -> mat3:
    """Rows a, b and e, whose sum is E; columns the value, d/dq, d²/dq² at q = rho2 + z2 (m²).

    Args:
        strength: T and the first two derivatives of ln T by q.
    """
    a = vec3(0.0, 0.0, 0.0)
    b = vec3(0.0, 0.0, 0.0)
    e = vec3(0.0, 0.0, 0.0)
    if ti.static(printed):
        T = strength[0]
        L1 = strength[1]
        L2 = strength[2]
        i = 1.0 / (rho2 + z2)
        s2 = z2 * i
        s4 = s2 * s2
        u = 1.0 + s4
        u1 = -2.0 * s4 * i
        u2 = 6.0 * s4 * i * i
        v = 1.0 / (rho2 + 1.0)
        b = times_T(T, L1, L2, u * v, (u1 - u * v) * v, (u2 - 2.0 * u1 * v + 2.0 * u * v * v) * v)
        e = times_T(3.0 * T * T, 2.0 * L1, 2.0 * L2, s2, -s2 * i, 2.0 * s2 * i * i)
    else:
        c = coefficients(PHASE, strength, rho2, z2)
        a = vec3(c[0, 0], c[0, 1], c[0, 2])
        b = vec3(c[1, 0], c[1, 1], c[1, 2])
    return mat3([[a[0], a[1], a[2]], [b[0], b[1], b[2]], [e[0], e[1], e[2]]])


@func
def diagonal_entry(a: vec3, b: vec3, dx, dy) -> vec6:
    """Jet of a(q) + b(q) dy² at q = dx² + dy² + z², from the values and two derivatives by q of a and b."""
    xx = dx * dx
    yy = dy * dy
    f1 = a[1] + b[1] * yy
    f2 = 4.0 * (a[2] + b[2] * yy)
    return vec6(
        a[0] + b[0] * yy,
        2.0 * dx * f1,
        2.0 * dy * (f1 + b[0]),
        2.0 * f1 + xx * f2,
        dx * dy * (f2 + 4.0 * b[1]),
        2.0 * (f1 + b[0]) + yy * (f2 + 8.0 * b[1]),
    )


@func
def off_diagonal_entry(b: vec3, dx, dy) -> vec6:
    """Jet of b(q) dx dy."""
    xx = dx * dx
    yy = dy * dy
    xy = dx * dy
    return vec6(
        b[0] * xy,
        dy * (b[0] + 2.0 * b[1] * xx),
        dx * (b[0] + 2.0 * b[1] * yy),
        xy * (6.0 * b[1] + 4.0 * b[2] * xx),
        b[0] + 2.0 * b[1] * (xx + yy) + 4.0 * b[2] * xx * yy,
        xy * (6.0 * b[1] + 4.0 * b[2] * yy),
    )


@func
def log_det_of_sum(team: ti.template(), printed: ti.template(), place: vec2) -> vec6:
    """Jet of ln det J of PHASE for a boat at `place` (m); `printed` selects Eq. 3a."""
    T = each_auv(0.0)
    L1 = each_auv(0.0)
    L2 = each_auv(0.0)
    scale = -1e30
    for k in range(team.count):
        z2 = squared_separation(team, k)
        q = (place - position(team, k)).norm_sqr() + z2
        f = vec3(0.0, 0.0, 0.0)
        if ti.static(printed):
            f = log_signal(team.link, member(team, k), q)
        else:
            f = log_strength(team.link, member(team, k), q, z2)
        T[k] = f[0]
        L1[k] = f[1]
        L2[k] = f[2]
        scale = ti.max(scale, f[0])
    largest = 0.0
    origin = place  # of the line of sight, and its direction
    along = vec2(1.0, 0.0)
    for k in range(team.count):
        T[k] = ti.exp(T[k] - scale)
        d = place - position(team, k)
        rho2 = d.norm_sqr()
        weight = rho2 * terms(vec3(T[k], L1[k], L2[k]), printed, rho2, squared_separation(team, k))[1, 0]
        if weight > largest:
            largest = weight
            origin = position(team, k)
            along = d / ti.sqrt(rho2)
    P = vec6(0.0)  # jets of J11, J22 (the axes exchanged), J12 and E
    Q = vec6(0.0)
    R = vec6(0.0)
    E = vec6(0.0)
    for k in range(team.count):
        d = place - position(team, k)
        rho2 = d.norm_sqr()
        c = terms(vec3(T[k], L1[k], L2[k]), printed, rho2, squared_separation(team, k))
        a = vec3(c[0, 0], c[0, 1], c[0, 2])
        b = vec3(c[1, 0], c[1, 1], c[1, 2])
        apart = origin - position(team, k)  # across the line of sight as d, with a smaller rounding error
        dx = along.dot(d)
        dy = along[0] * apart[1] - along[1] * apart[0]
        P += diagonal_entry(a, b, dx, dy)
        Q += diagonal_entry(a, b, dy, dx)
        R = R - off_diagonal_entry(b, dx, dy)
        E += diagonal_entry(vec3(c[2, 0], c[2, 1], c[2, 2]), vec3(0.0), dx, dy)
    Q = vec6(Q[jet.VALUE], Q[jet.Y], Q[jet.X], Q[jet.YY], Q[jet.XY], Q[jet.XX])
    f = jet.turned(jet.logarithm(jet.product(P, Q) - jet.square(R) + E), along)
    f[jet.VALUE] += 2.0 * scale
    return f


@func
def log_objective(team: ti.template(), code: ti.template(), place: vec2) -> vec6:
    """Jet of ln of the objective for a boat at `place` (m)."""
    objective = ti.static(objective_of(code))
    f = vec6(0.0)
    if ti.static(objective == D):
        f = log_det(team, code, place)
    elif ti.static(objective == A):
        f = -1.0 * log_sum(team, code, 1.0, place)
    elif ti.static(objective == SUM and measurement_of(code) == FIX):
        f = 2.0 * log_sum(team, code, -1.0, place)
    else:
        f = log_det_of_sum(team, ti.static(objective == PAPER), place)
    return f


@kernel
def _batch(link: array2, points: array3, boat: array2, code: ti.template(), out: array2):
    for i in range(points.shape[0]):
        team = ti.static(Team(points, link, i, points.shape[1]))
        place = vec2(boat[i, 0], boat[i, 1])
        f = log_objective(team, code, place)
        for j in ti.static(range(6)):
            out[i, j] = f[j]


def log_objective_batch(link: torch.Tensor, points: torch.Tensor, boat: torch.Tensor, *, code: int) -> torch.Tensor:
    """ln of the objective (lengths in m) with gradient and Hessian, for many boats and layouts.

    Args:
        link: (K, COLUMNS) float32 of `acoustic_link.link_table`.
        points: (n, K, 3) float32, x, y and vertical separation of every AUV, m.
        boat: (n, 2) float32, m.
        code: of `objective_code`.

    Returns:
        (n, 6) float32: f, x, y, xx, xy, yy.

    Raises:
        ValueError: more than MAX_AUVS AUVs, or not as many boats as layouts.
    """
    check_team(points, boat)
    out = points.new_empty((points.shape[0], 6))
    _batch(link, points, boat, code, out)
    return out
