"""What errors of the AUVs' own places, which last from one measurement to the next, do to an AUV's filter of a target.

Measurements by AUV j are made from where it takes itself to be, in error by e_j of the covariance B_j. To first order
the error of the estimate is

    ξ = ϱ + Σ_l W_l e_l,

ϱ independent of all e_l and of the covariance of the filter's hypotheses, the W_l the same for all of them. A range by
AUV j in the direction u then differs from what is expected by uᵀ(ϱ + Σ_l (W_l − δ_lj) e_l) and its noise. The filter
takes the second part as noise too, as if AUV j's place had the covariance

    D_j = Σ_l (W_l − δ_lj) B_l (W_l − δ_lj)ᵀ,   and with its gain K   W_l ← W_l − K uᵀ (W_l − δ_lj).

A lone AUV has W = 1 and D = 0: it tracks the target from itself, and the estimate is as far off as it is. When B_j
becomes B′, larger by dead reckoning or smaller by a fix, the share 1 − r, r the ratio of their traces below 1, of
W_j B_j W_jᵀ is no longer due to e_j: it is added to the covariance of ϱ, and where B_j has grown W_j ← r W_j. The
covariance of the estimate is that of ϱ and Σ_l W_l B_l W_lᵀ. A boat that listens has no e: its D is that too.

As in Schmidt's filter the errors e_l are considered, not estimated; unlike there the gain is not the best one.

Source: Schmidt, "Application of state-space methods to navigation problems", Advances in Control Systems 3 (1966),
293.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs.reckoning import own_covariance, own_position
from usvauv.kernels.tracking import range_filter
from usvauv.kernels.tracking.hypotheses import columns_of
from usvauv.kernels.types import mat2, vec2, vec3, vec4

OBSERVERS = 16  # AUVs of which a filter has W and B; errors of others count as noise
NAMES = "weight_xx", "weight_xy", "weight_yx", "weight_yy", "place_xx", "place_xy", "place_yy"
START = columns_of(True)  # first of these columns
EACH = len(NAMES)
COLUMNS = tuple(f"{name}_{j}" for j in range(OBSERVERS) for name in NAMES)


@func
def believed_place(worlds: ti.template(), w, k) -> vec2:
    """Where AUV k takes itself to be, m."""
    here = own_position(worlds, w, k)
    if worlds.task_parameters.places_known > 0.0:
        here = vec2(worlds.auv.x[w, k], worlds.auv.y[w, k])
    return here


@func
def place_covariance(worlds: ti.template(), w, j) -> vec3:
    """Covariance (xx, xy, yy) of where observer j takes itself to be, m²; 0 of a boat."""
    found = vec3(0.0)
    if j < worlds.auv.shape[1] and worlds.task_parameters.places_known == 0.0:
        found = own_covariance(worlds, w, j)
    return found


@func
def considered(worlds: ti.template()):
    """Number of AUVs whose errors a filter considers."""
    return ti.min(worlds.auv.shape[1], OBSERVERS)


@func
def number(worlds: ti.template(), w, k, i, j, n):
    """Number n of `NAMES` of AUV j in AUV k's filter of target i."""
    return worlds.task_pair[w, k, i, START + EACH * j + n]


@func
def weight_of(worlds: ti.template(), w, k, i, j) -> mat2:
    """W of AUV j in AUV k's filter of target i."""
    xx, xy = number(worlds, w, k, i, j, 0), number(worlds, w, k, i, j, 1)
    yx, yy = number(worlds, w, k, i, j, 2), number(worlds, w, k, i, j, 3)
    return mat2([[xx, xy], [yx, yy]])


@func
def set_weight(worlds: ti.template(), w, k, i, j, W: mat2):
    """Write it."""
    for a, b in ti.static(ti.ndrange(2, 2)):
        worlds.task_pair[w, k, i, START + EACH * j + 2 * a + b] = W[a, b]


@func
def covariance_of(worlds: ti.template(), w, k, i, j) -> mat2:
    """B of AUV j, as it was in the last message, m²."""
    xx, xy, yy = [number(worlds, w, k, i, j, 4 + n) for n in ti.static(range(3))]
    return mat2([[xx, xy], [xy, yy]])


@func
def upper(M: mat2) -> vec3:
    """xx, xy and yy of a symmetric matrix."""
    return vec3(M[0, 0], M[0, 1], M[1, 1])


@func
def common(worlds: ti.template(), w, k, i, j) -> vec3:
    """Σ (W_l − δ_lj) B_l (W_l − δ_lj)ᵀ, m²; that of the estimate's own error with j = −1."""
    found = mat2(0.0)
    for n in range(considered(worlds)):
        W = weight_of(worlds, w, k, i, n)
        if n == j:
            W -= mat2([[1.0, 0.0], [0.0, 1.0]])
        found += W @ covariance_of(worlds, w, k, i, n) @ W.transpose()
    return upper(found)


@func
def renew(worlds: ti.template(), w, k, i, j, f: ti.template()):
    """Note the covariance of AUV j's place that it has now."""
    place = place_covariance(worlds, w, j)
    B, W = covariance_of(worlds, w, k, i, j), weight_of(worlds, w, k, i, j)
    before, now = B[0, 0] + B[1, 1], place[0] + place[2]
    ratio = ti.min(now, before) / ti.max(ti.max(now, before), 1e-12)
    range_filter.loosen(f, (1.0 - ratio) * upper(W @ B @ W.transpose()))
    if now > before:
        set_weight(worlds, w, k, i, j, ratio * W)
    for n in ti.static(range(3)):
        worlds.task_pair[w, k, i, START + EACH * j + 4 + n] = place[n]


@func
def assumed(worlds: ti.template(), w, k, i, j, f: ti.template()) -> vec3:
    """Covariance of observer j's place that AUV k's filter of target i takes with a measurement, D, m²."""
    found = place_covariance(worlds, w, j)
    if ti.static(worlds.task_pair.shape[3] > START):
        if j < considered(worlds):
            renew(worlds, w, k, i, j, f)
            found = common(worlds, w, k, i, j)
        else:
            found += common(worlds, w, k, i, -1)
    return found


@func
def move(worlds: ti.template(), w, k, i, j, moved: vec4):
    """Change the weights after a measurement by observer j, with whose place the estimate moves by `moved`."""
    if ti.static(worlds.task_pair.shape[3] > START):
        M = mat2([[moved[0], moved[1]], [moved[2], moved[3]]])
        for n in range(considered(worlds)):
            W = weight_of(worlds, w, k, i, n)
            if n == j:
                W -= mat2([[1.0, 0.0], [0.0, 1.0]])
            set_weight(worlds, w, k, i, n, weight_of(worlds, w, k, i, n) - M @ W)


@func
def common_error(worlds: ti.template(), w, k, i) -> vec3:
    """Covariance of the error that all hypotheses of AUV k's filter of target i have in common, m²."""
    found = vec3(0.0)
    if ti.static(worlds.task_pair.shape[3] > START):
        found = common(worlds, w, k, i, -1)
    return found
