"""Fisher information of the boat's position from the fixes of its AUVs, and the planner that maximises it (Eq. 2–3).

With d_k the horizontal offset of AUV k, z_k its vertical separation, q = S_k² = |d_k|² + z_k² and n_k the vector d_k
turned by a right angle,

    J = Σ_k a_k(q) I + b_k(q) n_k n_kᵀ,   T_k(q) = K_k/S_k² = κ_k²/(σ_k² q),
    ln T = level − power ln(q/S_0²) − decay (√q − S_0),

which has no singularity beneath the boat and is positive definite as it stands (a, b ≥ 0). σ by the sonar equation
gives power = 1 + 3/4 · paths · exponent (echo 2.5, transponder 1.75; under the demonstration's noise law 4 and 2.5)
and a decay by absorption; a constant σ gives 1 and 0. These constants are in `usbl.link_table`. Three forms of J:

- PHASE, Eq. 1's two phase differences at known depth: T [s⁴ r̂r̂ᵀ + t̂t̂ᵀ] with s² = z²/q, so a = T z⁴/q² and
  b = T (1 + z²/q)/q. That is HᵀR⁻¹H with the Jacobian H exactly. What the noise's strength itself tells about the
  range, 4 (d ln σ/dρ)², is left out: 2e-4 per m² at S = 141 m, beside T = 3 per m².
- FIX, phases and slant range, depth unknown and marginalised. Three measurements of three unknowns: the inverse of the
  Schur complement is the covariance I/T + (σ_S²/S²) d dᵀ. Its second term is below 1e-6 of the first (σ_S ~ 0.1 mm) and
  dropped: a = T, b = 0.
- PRINTED, the paper's Eq. 3a (K/S0²)² [3m sin²γ0 + (sin⁴γ0 + 1)² χ], for unequal ranges taken as
  3 Σ T_k² s_k² + Σ_{i<j} T_i T_j (1 + s_i⁴)(1 + s_j⁴) sin²α_ij. It is the determinant of no information matrix. With
  a = 0 and b = T (1 + s⁴)/ρ² its second sum is a determinant of the same shape, its first one is added. sin²α jumps
  beneath the boat; ρ² + (1 m)² in place of ρ² makes it smooth.

det J of that sum is the paper's criterion. It treats the fixes as measurements of one common offset, so one very good
fix makes up for a bad one and the boat parks above one AUV. What is estimated are K positions; their information matrix
is block diagonal, and its determinant is the product of the K determinants:

- JOINT_PHASE: Σ_k ln det J_k = Σ_k 2 ln T_k + 2 ln(z_k²/q_k).
- JOINT_FIX: Σ_k 2 ln T_k.
"""

import taichi as ti
import torch

from kernels.usbl import DECAY, LEVEL, POWER, REFERENCE

PHASE = 0
FIX = 1
PRINTED = 2
JOINT_PHASE = 3
JOINT_FIX = 4

RING_STARTS = 8
MAX_EVALUATIONS = 40
TWO_PI = 6.283185307179586

vec2 = ti.types.vector(2, ti.f32)
vec3 = ti.types.vector(3, ti.f32)
vec6 = ti.types.vector(6, ti.f32)
mat3 = ti.types.matrix(3, 3, ti.f32)
array2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
array3 = ti.types.ndarray(dtype=ti.f32, ndim=3)


def form(measurement: str = "phase", objective: str = "sum") -> int:
    """The code that kernels take for a scenario's planner.measurement and planner.objective.

    Raises:
        ValueError: unknown name.
    """
    if measurement not in ("phase", "fix"):
        raise ValueError(f"measurement: {measurement!r} is not one of phase, fix")
    if objective not in ("joint", "sum", "printed"):
        raise ValueError(f"objective: {objective!r} is not one of joint, sum, printed")
    if objective == "printed":
        return PRINTED
    if objective == "joint":
        return JOINT_PHASE if measurement == "phase" else JOINT_FIX
    return PHASE if measurement == "phase" else FIX


@ti.func
def log_T(link: ti.template(), k, q):
    """ln T of AUV k at the squared slant range q (m²); T in 1/m²."""
    S0 = link[k, REFERENCE]
    return link[k, LEVEL] - link[k, POWER] * ti.log(q / (S0 * S0)) - link[k, DECAY] * (ti.sqrt(q) - S0)


@ti.func
def times_T(T, L1, L2, g, g1, g2) -> vec3:
    """T g and its first two derivatives, from T, the derivatives L1, L2 of ln T, and g, g', g''."""
    return T * vec3(g, L1 * g + g1, (L1 * L1 + L2) * g + 2.0 * L1 * g1 + g2)


@ti.func
def coefficients(link: ti.template(), k, form, log_scale, rho2, z2) -> mat3:
    """Rows a, b and e, what PRINTED adds to the determinant; columns the value, d/dq, d²/dq² at q = rho2 + z2 (m²).

    T is divided by exp(log_scale).
    """
    q = rho2 + z2
    i = 1.0 / q
    S = ti.sqrt(q)
    T = ti.exp(log_T(link, k, q) - log_scale)
    L1 = -link[k, POWER] * i - 0.5 * link[k, DECAY] / S
    L2 = link[k, POWER] * i * i + 0.25 * link[k, DECAY] * i / S
    s2 = z2 * i
    s4 = s2 * s2
    a = vec3(0.0, 0.0, 0.0)
    b = vec3(0.0, 0.0, 0.0)
    e = vec3(0.0, 0.0, 0.0)
    if form == PHASE:
        a = times_T(T, L1, L2, s4, -2.0 * s4 * i, 6.0 * s4 * i * i)
        b = times_T(T, L1, L2, (1.0 + s2) * i, -(1.0 + 2.0 * s2) * i * i, (2.0 + 6.0 * s2) * i * i * i)
    elif form == FIX:
        a = times_T(T, L1, L2, 1.0, 0.0, 0.0)
    else:
        u = 1.0 + s4
        u1 = -2.0 * s4 * i
        u2 = 6.0 * s4 * i * i
        v = 1.0 / (rho2 + 1.0)
        b = times_T(T, L1, L2, u * v, (u1 - u * v) * v, (u2 - 2.0 * u1 * v + 2.0 * u * v * v) * v)
        e = times_T(3.0 * T * T, 2.0 * L1, 2.0 * L2, s2, -s2 * i, 2.0 * s2 * i * i)
    return mat3([[a[0], a[1], a[2]], [b[0], b[1], b[2]], [e[0], e[1], e[2]]])


@ti.func
def squared_separation(z):
    """z² of a vertical separation z (m), at least 1 m²: the laws of sound begin at 1 m."""
    return ti.max(z * z, 1.0)


@ti.func
def reference_log_T(estimate: ti.template(), w, num_auvs, link: ti.template()):
    """The largest ln T straight above an AUV: the scale that keeps the planner's numbers of order one."""
    largest = -1e30
    for k in range(num_auvs):
        largest = ti.max(largest, log_T(link, k, squared_separation(estimate[w, k, 2])))
    return largest


@ti.func
def information(estimate: ti.template(), w, num_auvs, link: ti.template(), form, x, y) -> vec3:
    """J = (J11, J12, J22) in 1/m² of a boat at (x, y), for PHASE or FIX; arguments as `plan`."""
    J = vec3(0.0, 0.0, 0.0)
    for k in range(num_auvs):
        dx = x - estimate[w, k, 0]
        dy = y - estimate[w, k, 1]
        c = coefficients(link, k, form, 0.0, dx * dx + dy * dy, squared_separation(estimate[w, k, 2]))
        J += vec3(c[0, 0] + c[1, 0] * dy * dy, -c[1, 0] * dx * dy, c[0, 0] + c[1, 0] * dx * dx)
    return J


@ti.func
def scale_of(form, num_auvs, log_scale):
    """What ln of the objective loses when every T is divided by exp(log_scale): det J has T², the joint forms T²ᴷ."""
    scale = 2.0 * log_scale
    if form == JOINT_PHASE or form == JOINT_FIX:
        scale *= num_auvs
    return scale


@ti.func
def joint_log_det(estimate: ti.template(), w, num_auvs, link: ti.template(), form, x, y) -> vec6:
    """Σ_k ln det J_k, with its gradient (x, y) and Hessian (xx, xy, yy); arguments as `plan`."""
    f = vec6(0.0)
    for k in range(num_auvs):
        dx = x - estimate[w, k, 0]
        dy = y - estimate[w, k, 1]
        z2 = squared_separation(estimate[w, k, 2])
        q = dx * dx + dy * dy + z2
        i = 1.0 / q
        power = link[k, POWER]
        value = 2.0 * log_T(link, k, q)
        if form == JOINT_PHASE:
            power += 1.0
            value += 2.0 * ti.log(z2 * i)
        # First and second derivative by q; q's own by x and y are 2 dx, 2 dy and 2.
        decay = link[k, DECAY] / ti.sqrt(q)
        f1 = -2.0 * power * i - decay
        f2 = 2.0 * power * i * i + 0.5 * decay * i
        f += vec6(
            value,
            2.0 * dx * f1,
            2.0 * dy * f1,
            2.0 * f1 + 4.0 * dx * dx * f2,
            4.0 * dx * dy * f2,
            2.0 * f1 + 4.0 * dy * dy * f2,
        )
    return f


@ti.func
def log_det(estimate: ti.template(), w, num_auvs, link: ti.template(), form, log_scale, x, y) -> vec6:
    """ln of the objective less `scale_of`, with its gradient (x, y) and Hessian (xx, xy, yy); arguments as `plan`."""
    f = vec6(0.0)
    if form == JOINT_PHASE or form == JOINT_FIX:
        f = joint_log_det(estimate, w, num_auvs, link, form, x, y)
        f[0] -= scale_of(form, num_auvs, log_scale)
    else:
        f = summed_log_det(estimate, w, num_auvs, link, form, log_scale, x, y)
    return f


@ti.func
def summed_log_det(estimate: ti.template(), w, num_auvs, link: ti.template(), form, log_scale, x, y) -> vec6:
    """`log_det` of PHASE, FIX and PRINTED: ln det of the sum over AUVs."""
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
        c = coefficients(link, k, form, log_scale, xx + yy, squared_separation(estimate[w, k, 2]))
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
    return vec6(ti.log(D), g_x, g_y, D_xx / D - g_x * g_x, D_xy / D - g_x * g_y, D_yy / D - g_y * g_y)


@ti.func
def ascent_step(f: vec6, x, y, width, length) -> vec2:
    """A Newton step uphill inside the box, the Hessian shifted where it is not negative definite."""
    g_x = f[1]
    g_y = f[2]
    h_xx = f[3]
    h_xy = f[4]
    h_yy = f[5]
    # A coordinate held by the border takes no part in the step.
    if (x <= 0.0 and g_x < 0.0) or (x >= width and g_x > 0.0):
        g_x = 0.0
        h_xy = 0.0
        h_xx = h_yy
    if (y <= 0.0 and g_y < 0.0) or (y >= length and g_y > 0.0):
        g_y = 0.0
        h_xy = 0.0
        h_yy = h_xx
    mean = 0.5 * (h_xx + h_yy)
    spread = ti.sqrt(0.25 * (h_xx - h_yy) * (h_xx - h_yy) + h_xy * h_xy)
    curvature = ti.abs(mean) + spread
    shift = ti.max(mean + spread + 0.1 * curvature, 0.0) + 1e-12
    h_xx -= shift
    h_yy -= shift
    return vec2(h_xy * g_y - h_yy * g_x, h_xy * g_x - h_xx * g_y) / (h_xx * h_yy - h_xy * h_xy)


@ti.func
def climb(
    estimate: ti.template(), w, num_auvs, link: ti.template(), form, log_scale, x_start, y_start, width, length
) -> vec3:
    """The local maximum uphill of a start, (x, y, log_det), by damped Newton steps projected onto the box."""
    x_new = ti.min(ti.max(x_start, 0.0), width)
    y_new = ti.min(ti.max(y_start, 0.0), length)
    x = x_new
    y = y_new
    f = vec6(-1e30, 0.0, 0.0, 0.0, 0.0, 0.0)
    damping = 0.5
    evaluations = 0
    climbing = True
    while climbing:
        f_new = log_det(estimate, w, num_auvs, link, form, log_scale, x_new, y_new)
        evaluations += 1
        if f_new[0] > f[0]:
            x = x_new
            y = y_new
            f = f_new
            damping = ti.min(2.0 * damping, 1.0)
        else:
            damping *= 0.3
        step = damping * ascent_step(f, x, y, width, length)
        x_new = ti.min(ti.max(x + step[0], 0.0), width)
        y_new = ti.min(ti.max(y + step[1], 0.0), length)
        gain = f[1] * (x_new - x) + f[2] * (y_new - y)
        # A gain below 2e-7 is lost in the rounding of single precision.
        climbing = gain > 2e-7 and damping > 1e-3 and evaluations < MAX_EVALUATIONS
    return vec3(x, y, f[0])


@ti.func
def plan(estimate: ti.template(), w, num_auvs, link: ti.template(), form, x_start, y_start, width, length) -> vec3:
    """The boat's best place in [0, width] × [0, length]: (x*, y*, ln det J there), det J in 1/m⁴.

    In dense searches over thousands of layouts the global maximum lay uphill of an AUV each time, so there is a climb
    from every AUV and one from a further place. The printed form dips straight above an AUV, where its sines vanish,
    and peaks on a ring of radius about √|z| round it, so there the climbs start on that ring.

    Args:
        estimate: (W, K, 3) estimated x, y and vertical separation of every AUV, m; `w` selects the world.
        num_auvs: K, at most the rows of `link`.
        link: (K, COLUMNS) of `usbl.link_table`.
        form: one of the five codes above.
        x_start, y_start: the further place, m. Its maximum wins a tie within rounding, so a goal handed back in stays.
        width, length: m.
    """
    log_scale = reference_log_T(estimate, w, num_auvs, link)
    best = vec3(x_start, y_start, -1e30)
    spokes = 1
    if form == PRINTED:
        spokes = RING_STARTS
    for start in range(1 + num_auvs * spokes):
        x = x_start
        y = y_start
        if start > 0:
            k = (start - 1) // spokes
            x = estimate[w, k, 0]
            y = estimate[w, k, 1]
            if form == PRINTED:
                angle = TWO_PI / RING_STARTS * (start % RING_STARTS)
                radius = ti.sqrt(ti.sqrt(squared_separation(estimate[w, k, 2])))
                x += radius * ti.cos(angle)
                y += radius * ti.sin(angle)
        top = climb(estimate, w, num_auvs, link, form, log_scale, x, y, width, length)
        if top[2] > best[2] + 5e-7:
            best = top
    best[2] += scale_of(form, num_auvs, log_scale)
    return best


@ti.kernel
def _plan_batch(link: array2, points: array3, start: array2, form: ti.i32, width: ti.f32, length: ti.f32, out: array2):
    for i in range(points.shape[0]):
        best = plan(points, i, points.shape[1], link, form, start[i, 0], start[i, 1], width, length)
        for j in ti.static(range(3)):
            out[i, j] = best[j]


@ti.kernel
def _log_det_batch(link: array2, points: array3, boat: array2, form: ti.i32, out: array2):
    for i in range(points.shape[0]):
        log_scale = reference_log_T(points, i, points.shape[1], link)
        f = log_det(points, i, points.shape[1], link, form, log_scale, boat[i, 0], boat[i, 1])
        f[0] += scale_of(form, points.shape[1], log_scale)
        for j in ti.static(range(6)):
            out[i, j] = f[j]


@ti.kernel
def _information_batch(link: array2, points: array3, boat: array2, form: ti.i32, out: array2):
    for i in range(points.shape[0]):
        J = information(points, i, points.shape[1], link, form, boat[i, 0], boat[i, 1])
        for j in ti.static(range(3)):
            out[i, j] = J[j]


def plan_batch(
    link: torch.Tensor,
    points: torch.Tensor,
    *,
    form: int = PHASE,
    width: float = 200.0,
    length: float = 200.0,
    start: torch.Tensor | None = None,
) -> torch.Tensor:
    """Plan for many layouts at once.

    Args:
        link: (K, COLUMNS) float32 of `usbl.link_table`.
        points: (n, K, 3) float32, x, y and vertical separation of every AUV, m.
        form: one of the five codes above.
        width, length: the box [0, width] × [0, length] the boat may be in, m.
        start: (n, 2) float32, a further place to start from, m; default the middle of the box.

    Returns:
        (n, 3) float32: best x, y (m) and ln det J there (det in 1/m⁴).
    """
    if start is None:
        start = points.new_tensor([width / 2.0, length / 2.0]).expand(points.shape[0], 2).contiguous()
    out = points.new_empty((points.shape[0], 3))
    _plan_batch(link, points, start, form, width, length, out)
    return out


def log_det_batch(link: torch.Tensor, points: torch.Tensor, boat: torch.Tensor, *, form: int = PHASE) -> torch.Tensor:
    """ln det J with gradient and Hessian for boats (n, 2) and layouts (n, K, 3): (n, 6), order f, x, y, xx, xy, yy."""
    out = points.new_empty((points.shape[0], 6))
    _log_det_batch(link, points, boat, form, out)
    return out


def information_batch(
    link: torch.Tensor, points: torch.Tensor, boat: torch.Tensor, *, form: int = PHASE
) -> torch.Tensor:
    """J = (J11, J12, J22) in 1/m², PHASE or FIX, for boats (n, 2) and layouts (n, K, 3): (n, 3)."""
    out = points.new_empty((points.shape[0], 3))
    _information_batch(link, points, boat, form, out)
    return out
