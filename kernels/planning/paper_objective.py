"""The paper's objective: ln det of the information summed over the AUVs (Eq. 2), and Eq. 3a as it is printed.

The sum treats the fixes as measurements of one offset common to all, so one very good fix makes up for a bad one and
the boat parks above one AUV. With J_k = a_k I + b_k n_k n_kᵀ of `usvauv.kernels.planning.fisher`, P = J_11, Q = J_22, R
= J_12,

    det J = P Q − R² + E,

E = 0. Eq. 3a is printed as (K/S0²)² [3m sin²γ0 + (sin⁴γ0 + 1)² χ], for unequal ranges taken as
3 Σ T_k² s_k² + Σ_{i<j} T_i T_j (1 + s_i⁴)(1 + s_j⁴) sin²α_ij, without attitude error. It is the determinant of no
information matrix, but with a = 0 and b = T (1 + s⁴)/ρ² its second sum has the shape of one, and its first is E.
sin²α jumps beneath the boat; ρ² + (1 m)² in place of ρ² makes it smooth.

Far from shallow AUVs J is nearly singular, and P Q − R² a small difference of large numbers. So the axes are those
along and across the line of sight of the AUV m with the largest b_k ρ_k². It adds nothing to R, and by the inequality
of Cauchy and Schwarz R² ≤ (1 − 1/K) P Q: the difference is at least 1/K of P Q. Each T is divided by the largest one.
"""

import taichi as ti

from usvauv.kernels.planning import jet
from usvauv.kernels.planning.fisher import PHASE, coefficients, log_signal, log_strength, times_T
from usvauv.kernels.planning.team import each_auv, member, position, squared_separation
from usvauv.kernels.types import mat3, vec2, vec3, vec6


@ti.func
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


@ti.func
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


@ti.func
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


@ti.func
def log_det(team: ti.template(), printed: ti.template(), place: vec2) -> vec6:
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
        R -= off_diagonal_entry(b, dx, dy)
        E += diagonal_entry(vec3(c[2, 0], c[2, 1], c[2, 2]), vec3(0.0), dx, dy)
    Q = vec6(Q[jet.VALUE], Q[jet.Y], Q[jet.X], Q[jet.YY], Q[jet.XY], Q[jet.XX])
    f = jet.turned(jet.logarithm(jet.product(P, Q) - jet.square(R) + E), along)
    f[jet.VALUE] += 2.0 * scale
    return f
