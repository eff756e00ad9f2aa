"""What the planner maximises: optimality criteria of the information on all positions, and the paper's (Eq. 2–3).

K positions are estimated. Their information matrix J is block diagonal with the blocks J_k of
`usvauv.kernels.planning.fisher`. Objectives are evaluated as logarithms, here with v_k = 1/T_k, and q and z as there:

- D: ln det J = Σ_k ln det J_k, the volume of the error ellipsoid. A block gives −2 ln v (FIX), −2 ln (v q/z²) (PHASE).
- A: −ln tr J⁻¹, the sum of all variances. A block has the trace 2v (FIX), v (1 + q²/z⁴) (PHASE).
- SUM and PAPER: the paper's Eq. 2 and Eq. 3, see `usvauv.kernels.planning.paper_objective`.

D and A depend on the AUVs' distances only, and every variance grows with distance, so the maximum lies in the AUVs'
convex hull. Both variances of a block are convex functions of the boat's place. So A, whose tr J⁻¹ is their sum, has no
local maximum except the global one; D can have several.
"""

import taichi as ti
import torch

from usvauv.kernels.planning import jet, paper_objective
from usvauv.kernels.planning.fisher import FIX, MEASUREMENTS, PHASE, log_strength
from usvauv.kernels.planning.team import Team, check_team, member, position, squared_separation
from usvauv.kernels.types import array2, array3, vec2, vec3, vec6

OBJECTIVES = ("d", "a", "sum", "paper")
D, A, SUM, PAPER = range(4)


def objective_code(measurement: str, objective: str) -> int:
    """The code by which kernels know a scenario's planner.measurement and planner.objective.

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


@ti.func
def log_variance(link: ti.template(), k, code: ti.template(), q, z2) -> vec3:
    """ln det or ln tr of J_k⁻¹ for D, A, and −ln T_k for SUM of FIX.

    The value and its first two derivatives by q (m²).
    """
    objective = ti.static(objective_of(code))
    g = -log_strength(link, k, q, z2)
    if ti.static(objective == D):
        g *= 2.0
    elif ti.static(objective == A and measurement_of(code) == FIX):
        g[0] += 0.6931471805599453
    if ti.static(measurement_of(code) == PHASE):
        i = 1.0 / q
        if ti.static(objective == A):
            y = (q / z2) ** 2
            slope = 2.0 * y * i / (1.0 + y)
            g += vec3(ti.log(1.0 + y), slope, slope * i - slope * slope)
        else:
            g += vec3(2.0 * ti.log(q / z2), 2.0 * i, -2.0 * i * i)
    return g


@ti.func
def auv_variance(team: ti.template(), code: ti.template(), k, place: vec2) -> vec6:
    """`log_variance` of AUV k as a jet of the boat's place."""
    d = place - position(team, k)
    z2 = squared_separation(team, k)
    return jet.of_squared_distance(log_variance(team.link, member(team, k), code, d.norm_sqr() + z2, z2), d[0], d[1])


@ti.func
def log_det(team: ti.template(), code: ti.template(), place: vec2) -> vec6:
    """Objective D."""
    f = vec6(0.0)
    for k in range(team.count):
        f -= auv_variance(team, code, k, place)
    return f


@ti.func
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


@ti.func
def log_objective(team: ti.template(), code: ti.template(), place: vec2) -> vec6:
    """Jet of ln of the objective for a boat at `place` (m)."""
    objective = ti.static(objective_of(code))
    f = vec6(0.0)
    if ti.static(objective == D):
        f = log_det(team, code, place)
    elif ti.static(objective == A):
        f = -log_sum(team, code, 1.0, place)
    elif ti.static(objective == SUM and measurement_of(code) == FIX):
        f = 2.0 * log_sum(team, code, -1.0, place)
    else:
        f = paper_objective.log_det(team, ti.static(objective == PAPER), place)
    return f


@ti.kernel
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
