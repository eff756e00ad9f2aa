"""What the planner maximises: optimality criteria of the information on all positions, and the paper's (Eq. 2–3).

What is estimated are K positions. Their information matrix J is block diagonal with the blocks J_k of
`kernels.planning.fisher`.
Every objective is taken as its logarithm, here with v_k = 1/T_k, and q and z as there:

- D: ln det J = Σ_k ln det J_k, the volume of the error ellipsoid. A block gives −2 ln v (FIX), −2 ln (v q/z²) (PHASE).
- A: −ln tr J⁻¹, the sum of all variances. A block has the trace 2v (FIX), v (1 + q²/z⁴) (PHASE).
- E: ln of the least eigenvalue of J, the worst axis of the worst-located AUV. A block has −ln v, −ln (v q²/z⁴).
- SUM and PAPER: the paper's Eq. 2 and Eq. 3, see `kernels.planning.paper_objective`.

In D, A and E a block counts by its distance alone, and every variance grows with it, so the maximum lies in the AUVs'
convex hull. Both variances of a block are convex functions of the boat's place. So A, whose tr J⁻¹ is their sum, and E,
whose 1/λ is their maximum, have no local maximum but the global one; D can have several.

A and E are one function, −1/β ln Σ_k exp(β (g_k + bias_k)): with the logarithm g of a block's trace, β = 1 and no bias
it is A; with that of its larger variance, and large β, E smoothed.
"""

import taichi as ti
import torch

from kernels.planning import paper_objective
from kernels.planning.fisher import FIX, MEASUREMENTS, PHASE, log_strength, squared_separation

OBJECTIVES = ("d", "a", "e", "sum", "paper")
D, A, E, SUM, PAPER = range(5)
MAX_AUVS = 16

vec3 = ti.types.vector(3, ti.f32)
vec6 = ti.types.vector(6, ti.f32)
each_auv = ti.types.vector(MAX_AUVS, ti.f32)
array2 = ti.types.ndarray(dtype=ti.f32, ndim=2)
array3 = ti.types.ndarray(dtype=ti.f32, ndim=3)


def form(measurement: str, objective: str) -> int:
    """The code that kernels take for a scenario's planner.measurement and planner.objective.

    Raises:
        ValueError: unknown name.
    """
    for name, value, allowed in (("measurement", measurement, MEASUREMENTS), ("objective", objective, OBJECTIVES)):
        if value not in allowed:
            raise ValueError(f"{name}: {value!r} is not one of {', '.join(allowed)}")
    return 2 * OBJECTIVES.index(objective) + MEASUREMENTS.index(measurement)


def objective_of(form: int) -> int:
    """One of D, A, E, SUM, PAPER. Forms are constants of a kernel, so that only one objective is compiled into it."""
    return form // 2


def measurement_of(form: int) -> int:
    """PHASE or FIX."""
    return form % 2


@ti.func
def log_variance(link: ti.template(), k, form: ti.template(), q, z2) -> vec3:
    """ln det, ln tr or ln of the larger eigenvalue of J_k⁻¹ for D, A, E, and its first two derivatives by q (m²)."""
    objective = ti.static(objective_of(form))
    g = -log_strength(link, k, q, z2)
    if ti.static(objective == D):
        g *= 2.0
    elif ti.static(objective == A and measurement_of(form) == FIX):
        g[0] += 0.6931471805599453
    if ti.static(measurement_of(form) == PHASE):
        i = 1.0 / q
        if ti.static(objective == A):
            y = (q / z2) ** 2
            slope = 2.0 * y * i / (1.0 + y)
            g += vec3(ti.log(1.0 + y), slope, slope * i - slope * slope)
        else:
            g += vec3(2.0 * ti.log(q / z2), 2.0 * i, -2.0 * i * i)
    return g


@ti.func
def by_place(g: vec3, dx, dy) -> vec6:
    """A function of q as one of the boat's place: value, gradient (x, y) and Hessian (xx, xy, yy)."""
    # The derivatives of q by x and y are 2 dx, 2 dy and 2.
    g1 = 2.0 * g[1]
    g2 = 4.0 * g[2]
    return vec6(g[0], g1 * dx, g1 * dy, g1 + g2 * dx * dx, g2 * dx * dy, g1 + g2 * dy * dy)


@ti.func
def log_det(estimate: ti.template(), w, num_auvs, link: ti.template(), form: ti.template(), x, y) -> vec6:
    """Objective D."""
    f = vec6(0.0)
    for k in range(num_auvs):
        dx = x - estimate[w, k, 0]
        dy = y - estimate[w, k, 1]
        z2 = squared_separation(estimate[w, k, 2])
        f -= by_place(log_variance(link, k, form, dx * dx + dy * dy + z2, z2), dx, dy)
    return f


@ti.func
def power_mean(
    estimate: ti.template(),
    w,
    num_auvs,
    link: ti.template(),
    form: ti.template(),
    sharpness,
    bias: ti.template(),
    x,
    y,
) -> vec6:
    """−1/β ln Σ_k exp(β (g_k + bias_k)) with β = `sharpness`: objective A, and E smoothed."""
    largest = -1e30
    total = vec6(0.0)  # Σ of w, w ∇g, w (∇²g + β ∇g ∇gᵀ) with w = exp(β (g + bias − largest))
    for k in range(num_auvs):
        dx = x - estimate[w, k, 0]
        dy = y - estimate[w, k, 1]
        z2 = squared_separation(estimate[w, k, 2])
        g = by_place(log_variance(link, k, form, dx * dx + dy * dy + z2, z2), dx, dy)
        height = g[0] + bias[k]
        if height > largest:
            total *= ti.exp(sharpness * (largest - height))
            largest = height
        weight = ti.exp(sharpness * (height - largest))
        total += weight * vec6(
            1.0,
            g[1],
            g[2],
            g[3] + sharpness * g[1] * g[1],
            g[4] + sharpness * g[1] * g[2],
            g[5] + sharpness * g[2] * g[2],
        )
    mean = total / total[0]
    return -vec6(
        largest + ti.log(total[0]) / sharpness,
        mean[1],
        mean[2],
        mean[3] - sharpness * mean[1] * mean[1],
        mean[4] - sharpness * mean[1] * mean[2],
        mean[5] - sharpness * mean[2] * mean[2],
    )


@ti.func
def worst(estimate: ti.template(), w, num_auvs, link: ti.template(), form: ti.template(), x, y) -> vec6:
    """Objective E with the derivatives of the worst-located AUV's term."""
    f = vec6(0.0)
    for k in range(num_auvs):
        dx = x - estimate[w, k, 0]
        dy = y - estimate[w, k, 1]
        z2 = squared_separation(estimate[w, k, 2])
        g = by_place(log_variance(link, k, form, dx * dx + dy * dy + z2, z2), dx, dy)
        if k == 0 or -g[0] < f[0]:
            f = -g
    return f


@ti.func
def log_objective(
    estimate: ti.template(),
    w,
    num_auvs,
    link: ti.template(),
    form: ti.template(),
    log_scale,
    sharpness,
    bias: ti.template(),
    x,
    y,
) -> vec6:
    """ln of the objective, but E smoothed, with its gradient (x, y) and Hessian (xx, xy, yy) for a boat at (x, y).

    Args:
        estimate: (W, K, 3) estimated x, y and vertical separation of every AUV, m; `w` selects the world.
        num_auvs: K, at most the rows of `link`; for A and E at most MAX_AUVS.
        link: (K, COLUMNS) of `usbl.link_table`.
        form: of `form`.
        log_scale: of `summed.log_scale`, for SUM and PAPER.
        sharpness, bias: β and bias (K used of MAX_AUVS) of A and E; for A 1 and 0.
        x, y: m.
    """
    objective = ti.static(objective_of(form))
    f = vec6(0.0)
    if ti.static(objective == D):
        f = log_det(estimate, w, num_auvs, link, form, x, y)
    elif ti.static(objective in (A, E)):
        f = power_mean(estimate, w, num_auvs, link, form, sharpness, bias, x, y)
    else:
        measurement, printed = ti.static(measurement_of(form), objective == PAPER)
        f = paper_objective.log_det(estimate, w, num_auvs, link, measurement, printed, log_scale, x, y)
    return f


@ti.kernel
def _batch(link: array2, points: array3, boat: array2, form: ti.template(), out: array2):
    for i in range(points.shape[0]):
        f = vec6(0.0)
        if ti.static(objective_of(form) == E):
            f = worst(points, i, points.shape[1], link, form, boat[i, 0], boat[i, 1])
        else:
            scale = paper_objective.log_scale(points, i, points.shape[1], link)
            f = log_objective(points, i, points.shape[1], link, form, scale, 1.0, each_auv(0.0), boat[i, 0], boat[i, 1])
        for j in ti.static(range(6)):
            out[i, j] = f[j]


def check_team(points: torch.Tensor, places: torch.Tensor) -> None:
    """
    Raises:
        ValueError: more AUVs in the layouts (n, K, 3) than kernels provide for, or not one place (n, 2) for each.
    """
    if places.shape != (points.shape[0], 2):
        raise ValueError(f"places: {tuple(places.shape)} must be ({points.shape[0]}, 2)")
    if points.shape[1] > MAX_AUVS:
        raise ValueError(f"points: {points.shape[1]} AUVs, at most {MAX_AUVS} are possible")


def log_objective_batch(link: torch.Tensor, points: torch.Tensor, boat: torch.Tensor, *, form: int) -> torch.Tensor:
    """ln of the objective (lengths in m) with gradient and Hessian, for many boats and layouts.

    Args:
        link: (K, COLUMNS) float32 of `usbl.link_table`.
        points: (n, K, 3) float32, x, y and vertical separation of every AUV, m.
        boat: (n, 2) float32, m.
        form: of `form`. E is exact; its derivatives are those of the worst-located AUV's term.

    Returns:
        (n, 6) float32: f, x, y, xx, xy, yy.

    Raises:
        ValueError: more than MAX_AUVS AUVs, or not as many boats as layouts.
    """
    check_team(points, boat)
    out = points.new_empty((points.shape[0], 6))
    _batch(link, points, boat, form, out)
    return out
