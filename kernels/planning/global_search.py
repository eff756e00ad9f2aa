"""Where the boat should be: the global maximum of an objective of `kernels.planning.objectives`, or the best place
within reach.

One or more climbs (`kernels.planning.newton_ascent`) in the area, cut by a disc round the boat where its reach is
limited:

- D, SUM, PAPER can have several local maxima, above AUVs that are far apart for their depth and between them. So there
  is a climb from a further place, from the AUVs' mean, and from each AUV that is not close by one climbed from before;
  and no step is longer than the least depth, which is the width of a hill: longer ones would skip from hill to hill.
  `benchmarks.plan` looks for a higher place in thousands of layouts. PAPER dips straight above an AUV, where its sines
  vanish, and peaks on a ring of radius about √|z| round it, so there climbs start on the ring of every AUV. Within a
  reach the climbs start at the point of it nearest to each of these places.
- A has one maximum, and one climb.
- E has one maximum too, in general at a kink where two or three AUVs are located equally badly. It is smoothed, more
  sharply from round to round, and in every round each AUV's bias moves by how far it is from the worst. That is the
  exponential method of multipliers (Tseng and Bertsekas, Mathematical Programming 60 (1993) 1–19), which converges to
  the kink itself.

All of them take the array to be level and at the elevation it has now.
"""

import taichi as ti
import torch

from kernels.planning import paper_objective
from kernels.planning.fisher import array2, array3, squared_separation
from kernels.planning.newton_ascent import ROUNDING, Region, climb, clip
from kernels.planning.objectives import PAPER, A, E, check_team, each_auv, log_variance, objective_of, worst

RING_STARTS = 8
TWO_PI = 6.283185307179586
SHARPNESS = 4.0  # β of the first round of E
SHARPENING = 6.0  # what it is multiplied with from round to round
SHARPENINGS = 5  # rounds until it stays
ROUNDS = 8
FADED = 5.0  # an AUV's ln of a multiplier falls no lower, so that it can come back
ANYWHERE = 1e9  # m, a reach that is none
CLOSE_BY = 0.5  # of the least depth: two AUVs so near to one another are on one hill

vec2 = ti.types.vector(2, ti.f32)
vec3 = ti.types.vector(3, ti.f32)


@ti.func
def summit(
    estimate: ti.template(),
    w,
    num_auvs,
    link: ti.template(),
    form: ti.template(),
    start: vec2,
    region: Region,
    limited: ti.template(),
) -> vec3:
    """The best place of the region and ln of the objective there; the maximum uphill of `start` wins a tie."""
    log_scale = paper_objective.log_scale(estimate, w, num_auvs, link)
    objective = ti.static(objective_of(form))
    spokes = 1
    climbs = 2 + num_auvs
    if ti.static(objective == PAPER):
        spokes = RING_STARTS
        climbs = 2 + num_auvs * spokes
    elif ti.static(objective == A):
        climbs = 1
    elif ti.static(objective == E):
        climbs = ROUNDS
    nearest = 1e30
    middle = vec2(0.0, 0.0)
    for k in range(num_auvs):
        nearest = ti.min(nearest, squared_separation(estimate[w, k, 2]))
        middle += vec2(estimate[w, k, 0], estimate[w, k, 1]) / num_auvs
    longest = ti.sqrt(nearest)
    if ti.static(objective in (A, E)):
        longest = ANYWHERE
    climbed_from = each_auv(0.0)
    bias = each_auv(0.0)
    sharpness = 1.0
    if ti.static(objective == E):
        sharpness = SHARPNESS
    near = 0.0
    best = vec3(start[0], start[1], -1e30)
    for i in range(climbs):
        point = start
        new = True
        if ti.static(objective == E):
            point = vec2(best[0], best[1])
        elif i == 1:
            point = middle
        elif i > 1:
            k = (i - 2) // spokes
            point = vec2(estimate[w, k, 0], estimate[w, k, 1])
            if ti.static(objective == PAPER):
                angle = TWO_PI / RING_STARTS * (i % RING_STARTS)
                radius = ti.sqrt(ti.sqrt(squared_separation(estimate[w, k, 2])))
                point += radius * vec2(ti.cos(angle), ti.sin(angle))
            else:
                for j in range(k):
                    apart = point - vec2(estimate[w, j, 0], estimate[w, j, 1])
                    if climbed_from[j] > 0.0 and apart.norm_sqr() < CLOSE_BY * CLOSE_BY * nearest:
                        new = False
                climbed_from[k] = ti.cast(new, ti.f32)
        point = clip(point[0], point[1], region)
        top = best
        if new:
            top = climb(
                estimate,
                w,
                num_auvs,
                link,
                form,
                log_scale,
                sharpness,
                bias,
                point,
                best,
                near,
                longest,
                region,
                limited,
            )
        if ti.static(objective == E):
            best = top
            sharper = sharpness
            if i + 1 < SHARPENINGS:
                sharper *= SHARPENING
            for k in range(num_auvs):
                dx = top[0] - estimate[w, k, 0]
                dy = top[1] - estimate[w, k, 1]
                z2 = squared_separation(estimate[w, k, 2])
                g = log_variance(link, k, form, dx * dx + dy * dy + z2, z2)[0]
                bias[k] = ti.max((bias[k] + g + top[2]) * sharpness, -FADED) / sharper
            sharpness = sharper
        else:
            if top[2] > best[2] + ROUNDING:
                best = top
            if ti.static(objective != PAPER):  # whose dips and peaks are narrower than the AUVs are deep
                near = 1e-3 * ti.min(nearest, region.reach * region.reach)
    if ti.static(objective == E):
        best[2] = worst(estimate, w, num_auvs, link, form, best[0], best[1])[0]
    return best


@ti.func
def plan(
    estimate: ti.template(), w, num_auvs, link: ti.template(), form: ti.template(), x_start, y_start, width, length
) -> vec3:
    """The boat's best place in [0, width] × [0, length]: (x*, y*, ln of the objective there, lengths in m).

    Args:
        estimate: (W, K, 3) estimated x, y and vertical separation of every AUV, m; `w` selects the world.
        num_auvs: K, at most the rows of `link`; for A and E at most MAX_AUVS.
        link: (K, COLUMNS) of `usbl.link_table`.
        form: of `optimality.form`.
        x_start, y_start: the further place, m. Its maximum wins a tie within rounding, so a goal handed back in stays.
        width, length: m.
    """
    region = Region(width, length, 0.0, 0.0, ANYWHERE)
    return summit(estimate, w, num_auvs, link, form, vec2(x_start, y_start), region, False)


@ti.func
def greedy(
    estimate: ti.template(), w, num_auvs, link: ti.template(), form: ti.template(), x, y, reach, width, length
) -> vec3:
    """The best place within `reach` (m) of the boat at (x, y) in [0, width] × [0, length], m; else as `plan`."""
    region = Region(width, length, x, y, reach)
    return summit(estimate, w, num_auvs, link, form, vec2(x, y), region, True)


@ti.kernel
def _batch(
    link: array2,
    points: array3,
    place: array2,
    form: ti.template(),
    limited: ti.template(),
    reach: ti.f32,
    width: ti.f32,
    length: ti.f32,
    out: array2,
):
    for i in range(points.shape[0]):
        region = Region(width, length, place[i, 0], place[i, 1], reach)
        start = vec2(place[i, 0], place[i, 1])
        best = summit(points, i, points.shape[1], link, form, start, region, limited)
        for j in ti.static(range(3)):
            out[i, j] = best[j]


def plan_batch(
    link: torch.Tensor,
    points: torch.Tensor,
    *,
    form: int,
    width: float = 200.0,
    length: float = 200.0,
    start: torch.Tensor | None = None,
) -> torch.Tensor:
    """`plan` for many layouts at once.

    Args:
        link: (K, COLUMNS) float32 of `usbl.link_table`.
        points: (n, K, 3) float32, x, y and vertical separation of every AUV, m.
        form: of `optimality.form`.
        width, length: the box [0, width] × [0, length] the boat may be in, m.
        start: (n, 2) float32, a further place to start from, in the box, m; default its middle.

    Returns:
        (n, 3) float32: best x, y (m) and ln of the objective there (lengths in m).

    Raises:
        ValueError: more than MAX_AUVS AUVs, or not as many places as layouts.
    """
    if start is None:
        start = points.new_tensor([width / 2.0, length / 2.0]).expand(points.shape[0], 2).contiguous()
    return greedy_batch(link, points, start, form=form, reach=ANYWHERE, width=width, length=length)


def greedy_batch(
    link: torch.Tensor,
    points: torch.Tensor,
    boat: torch.Tensor,
    *,
    form: int,
    reach: float,
    width: float = 200.0,
    length: float = 200.0,
) -> torch.Tensor:
    """`greedy` for many layouts and boats (n, 2) in the box at once; otherwise as `plan_batch`."""
    check_team(points, boat)
    out = points.new_empty((points.shape[0], 3))
    _batch(link, points, boat, form, reach < ANYWHERE, reach, width, length, out)
    return out
