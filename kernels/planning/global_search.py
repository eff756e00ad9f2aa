"""Global maximum of an objective of `kernels.planning.objectives` over the boat's place, in the area or within reach.

One or more ascents (`kernels.planning.newton_ascent`) in the area, or in a disc round the boat where its reach is
limited:

- D, SUM, PAPER can have several local maxima, above AUVs that are far apart for their depth and between them. So there
  is an ascent from a given place, from the AUVs' mean, and from each AUV that is not close to one tried before; and no
  step is longer than the least depth, which is the width of a maximum: longer ones would skip from one to another.
  `benchmarks.plan` looks for a higher place in thousands of layouts. PAPER dips straight above an AUV, where its sines
  vanish, and peaks on a ring of radius about √|z| round it, so there ascents start on the ring of every AUV. Within a
  reach the ascents start at the point of it nearest to each of these places.
- A has one maximum, and one ascent.
- E has one maximum too, in general at a kink where two or three AUVs are located equally badly. It is smoothed, more
  sharply from round to round, and in every round each AUV's bias moves by its difference from the worst. That is the
  exponential method of multipliers (Tseng and Bertsekas, Mathematical Programming 60 (1993) 1–19), which converges to
  the kink itself.

All of them suppose a level array at its present elevation.
"""

import taichi as ti
import torch

from kernels.planning import paper_objective
from kernels.planning.newton_ascent import ROUNDING, Region, ascend, clip
from kernels.planning.objectives import PAPER, A, E, Objective, auv_variance, objective_of, worst
from kernels.planning.team import Team, check_team, each_auv, mean_position, position, squared_separation
from kernels.types import array2, array3, vec2, vec3

RING_STARTS = 8
TWO_PI = 6.283185307179586
SHARPNESS = 4.0  # β of the first round of E
SHARPENING = 6.0  # factor on β from round to round
SHARPENINGS = 5  # rounds until it stays
ROUNDS = 8
FADED = 5.0  # lower bound on the log-multipliers is −FADED
ANYWHERE = 1e9  # m, unlimited reach
CLOSE_BY = 0.5  # of the least depth: AUVs so near to one another share a maximum


@ti.func
def single_ascent(team: ti.template(), code: ti.template(), start: vec2, region: ti.template()) -> vec3:
    """The maximum of A."""
    bias = each_auv(0.0)
    objective = ti.static(Objective(code, 0.0, 1.0, bias))
    return ascend(team, objective, clip(start, region), vec3(0.0, 0.0, -1e30), 0.0, ANYWHERE, region)


@ti.func
def method_of_multipliers(team: ti.template(), code: ti.template(), start: vec2, region: ti.template()) -> vec3:
    """The maximum of E."""
    sharpness = SHARPNESS
    bias = each_auv(0.0)
    objective = ti.static(Objective(code, 0.0, sharpness, bias))
    place = start
    for i in range(ROUNDS):
        best = ascend(team, objective, clip(place, region), vec3(0.0, 0.0, -1e30), 0.0, ANYWHERE, region)
        place = vec2(best[0], best[1])
        sharper = sharpness
        if i + 1 < SHARPENINGS:
            sharper *= SHARPENING
        for k in range(team.count):
            g = auv_variance(team, code, k, place)[0]
            bias[k] = ti.max((bias[k] + g + best[2]) * sharpness, -FADED) / sharper
        sharpness = sharper
    return vec3(place[0], place[1], worst(team, code, place)[0])


@ti.func
def place_on_ring(team: ti.template(), k, spoke) -> vec2:
    """One of RING_STARTS places on the ring round AUV k on which PAPER peaks."""
    angle = TWO_PI / RING_STARTS * spoke
    radius = ti.sqrt(ti.sqrt(squared_separation(team, k)))
    return position(team, k) + radius * vec2(ti.cos(angle), ti.sin(angle))


@ti.func
def is_close_by(team: ti.template(), k, tried: ti.template(), nearest) -> bool:
    """Whether AUV k shares its maximum with an earlier one marked in `tried`; `nearest` is the least squared depth."""
    close = False
    for j in range(k):
        apart = position(team, k) - position(team, j)
        if tried[j] > 0.0 and apart.norm_sqr() < CLOSE_BY * CLOSE_BY * nearest:
            close = True
    return close


@ti.func
def multistart(team: ti.template(), code: ti.template(), start: vec2, region: ti.template()) -> vec3:
    """The highest of the maxima of D, SUM or PAPER; that uphill of `start` wins a tie."""
    starts_per_auv = ti.static(RING_STARTS if objective_of(code) == PAPER else 1)
    log_scale = paper_objective.log_scale(team)
    bias = each_auv(0.0)
    objective = ti.static(Objective(code, log_scale, 1.0, bias))
    nearest = 1e30
    for k in range(team.count):
        nearest = ti.min(nearest, squared_separation(team, k))
    middle = mean_position(team)
    tried = each_auv(0.0)
    near = 0.0
    best = vec3(start[0], start[1], -1e30)
    for i in range(2 + team.count * starts_per_auv):
        point = start
        new = True
        if i == 1:
            point = middle
        elif i > 1:
            k = (i - 2) // starts_per_auv
            if ti.static(objective_of(code) == PAPER):
                point = place_on_ring(team, k, i % RING_STARTS)
            else:
                point = position(team, k)
                new = not is_close_by(team, k, tried, nearest)
                tried[k] = ti.cast(new, ti.f32)
        if new:
            top = ascend(team, objective, clip(point, region), best, near, ti.sqrt(nearest), region)
            if top[2] > best[2] + ROUNDING:
                best = top
        if ti.static(objective_of(code) != PAPER):  # the dips and peaks of PAPER are narrower than the AUVs are deep
            near = 1e-3 * ti.min(nearest, region.reach * region.reach)
    return best


@ti.func
def search(team: ti.template(), code: ti.template(), start: vec2, region: ti.template()) -> vec3:
    """The best place of a region and ln of the objective there: (x*, y*, ln of the objective, lengths in m).

    Args:
        team: `Team`. code: of `objectives.objective_code`. region: `Region`.
        start: a place to start from, m. Its maximum wins a tie within rounding, so a goal handed back in stays.
    """
    best = vec3(0.0, 0.0, 0.0)
    if ti.static(objective_of(code) == A):
        best = single_ascent(team, code, start, region)
    elif ti.static(objective_of(code) == E):
        best = method_of_multipliers(team, code, start, region)
    else:
        best = multistart(team, code, start, region)
    return best


@ti.func
def plan(team: ti.template(), code: ti.template(), start: vec2, size: vec2) -> vec3:
    """`search` over the area of the given width and length, m."""
    return search(team, code, start, ti.static(Region(size, start, ANYWHERE, False)))


@ti.func
def greedy(team: ti.template(), code: ti.template(), boat: vec2, reach, size: vec2) -> vec3:
    """`search` within `reach` (m) of the boat's place in the area of the given width and length, m."""
    return search(team, code, boat, ti.static(Region(size, boat, reach, True)))


@ti.kernel
def _batch(
    link: array2,
    points: array3,
    place: array2,
    code: ti.template(),
    limited: ti.template(),
    reach: ti.f32,
    width: ti.f32,
    length: ti.f32,
    out: array2,
):
    for i in range(points.shape[0]):
        team = ti.static(Team(points, link, i, points.shape[1]))
        start = vec2(place[i, 0], place[i, 1])
        size = vec2(width, length)
        best = search(team, code, start, ti.static(Region(size, start, reach, limited)))
        for j in ti.static(range(3)):
            out[i, j] = best[j]


def plan_batch(
    link: torch.Tensor,
    points: torch.Tensor,
    *,
    code: int,
    width: float = 200.0,
    length: float = 200.0,
    start: torch.Tensor | None = None,
) -> torch.Tensor:
    """`plan` for many layouts at once.

    Args:
        link: (K, COLUMNS) float32 of `usbl.link_table`.
        points: (n, K, 3) float32, x, y and vertical separation of every AUV, m.
        code: of `objectives.objective_code`.
        width, length: the box [0, width] × [0, length] the boat may be in, m.
        start: (n, 2) float32, a further place to start from, in the box, m; default its middle.

    Returns:
        (n, 3) float32: best x, y (m) and ln of the objective there (lengths in m).

    Raises:
        ValueError: more than MAX_AUVS AUVs, or not as many places as layouts.
    """
    if start is None:
        start = points.new_tensor([width / 2.0, length / 2.0]).expand(points.shape[0], 2).contiguous()
    return greedy_batch(link, points, start, code=code, reach=ANYWHERE, width=width, length=length)


def greedy_batch(
    link: torch.Tensor,
    points: torch.Tensor,
    boat: torch.Tensor,
    *,
    code: int,
    reach: float,
    width: float = 200.0,
    length: float = 200.0,
) -> torch.Tensor:
    """`greedy` for many layouts and boats (n, 2) in the box at once; otherwise as `plan_batch`."""
    check_team(points, boat)
    out = points.new_empty((points.shape[0], 3))
    _batch(link, points, boat, code, reach < ANYWHERE, reach, width, length, out)
    return out
