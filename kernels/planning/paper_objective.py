"""The paper's objective: ln det of the information summed over the AUVs (Eq. 2), and Eq. 3a as it is printed.

The sum treats the fixes as measurements of one offset common to all, so one very good fix makes up for a bad one and
the boat parks above one AUV. With J_k = a_k I + b_k n_k n_kᵀ of `kernels.planning.fisher`, P = J_11, Q = J_22, R =
J_12,

    det J = P Q − R² + E,

E = 0. Eq. 3a is printed as (K/S0²)² [3m sin²γ0 + (sin⁴γ0 + 1)² χ], for unequal ranges taken as
3 Σ T_k² s_k² + Σ_{i<j} T_i T_j (1 + s_i⁴)(1 + s_j⁴) sin²α_ij, without attitude error. It is the determinant of no
information matrix, but with a = 0 and b = T (1 + s⁴)/ρ² its second sum has the shape of one, and its first is E.
sin²α jumps beneath the boat; ρ² + (1 m)² in place of ρ² makes it smooth.
"""

import taichi as ti

from kernels.planning.fisher import coefficients, log_signal, log_strength, squared_separation, times_T

vec3 = ti.types.vector(3, ti.f32)
vec6 = ti.types.vector(6, ti.f32)
mat3 = ti.types.matrix(3, 3, ti.f32)


@ti.func
def log_scale(estimate: ti.template(), w, num_auvs, link: ti.template()):
    """The largest ln T straight above an AUV: the scale that keeps the sums of order one."""
    largest = -1e30
    for k in range(num_auvs):
        z2 = squared_separation(estimate[w, k, 2])
        largest = ti.max(largest, log_strength(link, k, z2, z2)[0])
    return largest


@ti.func
def terms(link: ti.template(), k, measurement: ti.template(), printed: ti.template(), scale, rho2, z2) -> mat3:
    """Rows a, b and e, whose sum is E; columns the value, d/dq, d²/dq² at q = rho2 + z2 (m²), T over exp(scale)."""
    a = vec3(0.0, 0.0, 0.0)
    b = vec3(0.0, 0.0, 0.0)
    e = vec3(0.0, 0.0, 0.0)
    if ti.static(printed):
        i = 1.0 / (rho2 + z2)
        L = log_signal(link, k, rho2 + z2)
        T = ti.exp(L[0] - scale)
        s2 = z2 * i
        s4 = s2 * s2
        u = 1.0 + s4
        u1 = -2.0 * s4 * i
        u2 = 6.0 * s4 * i * i
        v = 1.0 / (rho2 + 1.0)
        b = times_T(T, L[1], L[2], u * v, (u1 - u * v) * v, (u2 - 2.0 * u1 * v + 2.0 * u * v * v) * v)
        e = times_T(3.0 * T * T, 2.0 * L[1], 2.0 * L[2], s2, -s2 * i, 2.0 * s2 * i * i)
    else:
        c = coefficients(link, k, measurement, scale, rho2, z2)
        a = vec3(c[0, 0], c[0, 1], c[0, 2])
        b = vec3(c[1, 0], c[1, 1], c[1, 2])
    return mat3([[a[0], a[1], a[2]], [b[0], b[1], b[2]], [e[0], e[1], e[2]]])


@ti.func
def log_det(
    estimate: ti.template(),
    w,
    num_auvs,
    link: ti.template(),
    measurement: ti.template(),
    printed: ti.template(),
    scale,
    x,
    y,
) -> vec6:
    """ln det J with its gradient (x, y) and Hessian (xx, xy, yy); arguments as `optimality.log_objective`."""
    P = vec6(0.0)  # J11, J22, J12 and E, each with its gradient and Hessian
    Q = vec6(0.0)
    R = vec6(0.0)
    E = vec6(0.0)
    for k in range(num_auvs):
        dx = x - estimate[w, k, 0]
        dy = y - estimate[w, k, 1]
        xx = dx * dx
        yy = dy * dy
        xy = dx * dy
        c = terms(link, k, measurement, printed, scale, xx + yy, squared_separation(estimate[w, k, 2]))
        b = c[1, 0]
        b1 = c[1, 1]
        b2 = c[1, 2]
        p1 = c[0, 1] + b1 * yy
        p2 = 4.0 * (c[0, 2] + b2 * yy)
        q1 = c[0, 1] + b1 * xx
        q2 = 4.0 * (c[0, 2] + b2 * xx)
        P += vec6(
            c[0, 0] + b * yy,
            2.0 * dx * p1,
            2.0 * dy * (p1 + b),
            2.0 * p1 + xx * p2,
            xy * (p2 + 4.0 * b1),
            2.0 * (p1 + b) + yy * (p2 + 8.0 * b1),
        )
        Q += vec6(
            c[0, 0] + b * xx,
            2.0 * dx * (q1 + b),
            2.0 * dy * q1,
            2.0 * (q1 + b) + xx * (q2 + 8.0 * b1),
            xy * (q2 + 4.0 * b1),
            2.0 * q1 + yy * q2,
        )
        R -= vec6(
            b * xy,
            dy * (b + 2.0 * b1 * xx),
            dx * (b + 2.0 * b1 * yy),
            xy * (6.0 * b1 + 4.0 * b2 * xx),
            b + 2.0 * b1 * (xx + yy) + 4.0 * b2 * xx * yy,
            xy * (6.0 * b1 + 4.0 * b2 * yy),
        )
        E += vec6(
            c[2, 0],
            2.0 * dx * c[2, 1],
            2.0 * dy * c[2, 1],
            2.0 * c[2, 1] + 4.0 * xx * c[2, 2],
            4.0 * xy * c[2, 2],
            2.0 * c[2, 1] + 4.0 * yy * c[2, 2],
        )
    D = ti.max(P[0] * Q[0] - R[0] * R[0] + E[0], 1e-37)
    D_x = P[1] * Q[0] + P[0] * Q[1] - 2.0 * R[0] * R[1] + E[1]
    D_y = P[2] * Q[0] + P[0] * Q[2] - 2.0 * R[0] * R[2] + E[2]
    D_xx = P[3] * Q[0] + 2.0 * P[1] * Q[1] + P[0] * Q[3] - 2.0 * (R[1] * R[1] + R[0] * R[3]) + E[3]
    D_xy = P[4] * Q[0] + P[1] * Q[2] + P[2] * Q[1] + P[0] * Q[4] - 2.0 * (R[1] * R[2] + R[0] * R[4]) + E[4]
    D_yy = P[5] * Q[0] + 2.0 * P[2] * Q[2] + P[0] * Q[5] - 2.0 * (R[2] * R[2] + R[0] * R[5]) + E[5]
    g_x = D_x / D
    g_y = D_y / D
    return vec6(ti.log(D) + 2.0 * scale, g_x, g_y, D_xx / D - g_x * g_x, D_xy / D - g_x * g_y, D_yy / D - g_y * g_y)
