"""Global maximum of an objective of `usvauv.kernels.planning.objectives` over the boat's place, in the area or within
reach.

One or more ascents (`usvauv.kernels.planning.ascent`) in the area, or in its part inside a disc round the boat if its
reach is limited. Starts of ascents:

- D, SUM, PAPER can have several local maxima, above AUVs that are far apart for their depth and between them. So there
  is an ascent from a given place, from the AUVs' mean, and from the STARTS AUVs above which the objective is highest,
  except those close to a better one; and no step is longer than half the slant range of the nearest AUV, the width of a
  maximum there. Where the attitude error makes an AUV's variance constant over a plateau, D can have maxima at the
  plateaus' edges: then the two best places of a lattice are starts too. The number of starts and of places is bounded,
  so that the time of a search grows little faster than the number of AUVs. By noise alone the logarithm of an AUV's
  variance is convex where it is deeper than far, so D has one maximum where all are: it needs no start close to the
  best maximum so far, unless errors that grow with distance make it peaked above an AUV. `benchmarks.plan` looks for a
  higher place in thousands of layouts. PAPER dips straight above an AUV, where its sines vanish, and peaks on a ring of
  radius about √|z| round it, so there ascents start on the ring of every AUV. Within a reach the ascents start at
  the point of it nearest to each of these places.
- A has one maximum, and one ascent.

All of them assume a level array at its present elevation.
"""

import taichi as ti
import torch

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.limits import MAX_AUVS
from usvauv.kernels.planning.ascent import ROUNDING, Region, ascend, clip
from usvauv.kernels.planning.information import (
    Team,
    check_team,
    each_auv,
    is_certain,
    log_T,
    mat2x3,
    mean_position,
    member,
    position,
    squared_separation,
)
from usvauv.kernels.planning.objectives import PAPER, A, D, log_objective, objective_of
from usvauv.kernels.positioning.acoustic_link import ALIGNMENT, ATTITUDE, HEADING, POSITION, SOUND_SPEED
from usvauv.kernels.transcendental import TWO_PI
from usvauv.kernels.types import array2, array3, vec2, vec3, vec4

SMALL_GAIN = 1e-6  # a Newton step of a smaller predicted gain is accepted without evaluation
SMALL_GAIN_BETWEEN = 1e-3  # likewise between searches everywhere; the next step makes up for it
RING_STARTS = 8
ANYWHERE = 1e9  # m, unlimited reach
STARTS = 6  # of the AUVs above which the objective is highest
TRIED = -1e30  # in place of the height above an AUV
COARSE, FINE = 5, 10  # places tried along each side of the AUVs' box, where all fixes are good and where some may fail
CLOSE_BY = 0.5  # of the least depth: AUVs so near to one another share a maximum
SAME_HILL = 0.7  # likewise: ascents from places so near to a maximum of D lead to it
PEAKED = 10.0  # variance by errors that grow with distance over that by the others, as far from an AUV as it is deep


@func
def place_above(team: ti.template(), code: ti.template(), k, spoke) -> vec2:
    """AUV k's place; for PAPER one of RING_STARTS places on the ring round it on which PAPER peaks."""
    place = position(team, k)
    if ti.static(objective_of(code) == PAPER):
        angle = TWO_PI / RING_STARTS * spoke
        place += ti.sqrt(ti.sqrt(squared_separation(team, k))) * vec2(ti.cos(angle), ti.sin(angle))
    return place


def most_auvs(code: int) -> int:
    """At how many AUVs a search starts; PAPER, whose maxima are narrow, has no limit."""
    return MAX_AUVS if objective_of(code) == PAPER else STARTS


@func
def heights_above(team: ti.template(), code: ti.template(), nearest, region: ti.template()) -> each_auv:
    """ln of the objective above each AUV, 0 where all of them are tried anyway; TRIED for one close to an earlier one.

    Args:
        nearest: least squared depth, m².
    """
    heights = each_auv(0.0)
    for k in range(team.count):
        if ti.static(objective_of(code) != PAPER):
            for j in range(k):
                if (
                    heights[j] > TRIED
                    and (position(team, k) - position(team, j)).norm_sqr() < CLOSE_BY * CLOSE_BY * nearest
                ):
                    heights[k] = TRIED
        if heights[k] > TRIED and team.count > ti.static(most_auvs(code)):
            heights[k] = log_objective(team, code, clip(position(team, k), region))[0]
    return heights


@func
def highest(heights: ti.template(), count):
    """Index of the highest of the first `count` numbers."""
    top = 0
    for k in range(1, count):
        if heights[k] > heights[top]:
            top = k
    return top


@func
def is_peaked(team: ti.template(), k) -> bool:
    """Whether D can have a narrow peak above AUV k: elsewhere errors that grow with distance are the largest."""
    link = ti.static(team.link)
    i = member(team, k)
    z2 = squared_separation(team, k)
    constant = (link[i, ATTITUDE] + link[i, ALIGNMENT]) * z2 + link[i, POSITION]
    return (link[i, HEADING] + 4.0 * link[i, SOUND_SPEED]) * z2 > PEAKED * constant


@func
def box_of(team: ti.template()) -> vec4:
    """The box of the AUVs' estimated positions: least x and y, and its sides, m."""
    box = vec4(1e9, 1e9, -1e9, -1e9)
    for k in range(team.count):
        place = position(team, k)
        box = vec4(
            ti.min(box[0], place[0]), ti.min(box[1], place[1]), ti.max(box[2], place[0]), ti.max(box[3], place[1])
        )
    return vec4(box[0], box[1], box[2] - box[0], box[3] - box[1])


@func
def may_miss(team: ti.template()) -> bool:
    """Whether from above one AUV of the team the fix of another may fail."""
    box = box_of(team)
    missed = False
    for k in range(team.count):
        z2 = squared_separation(team, k)
        q = box[2] * box[2] + box[3] * box[3] + z2
        if not is_certain(team.link, member(team, k), ti.exp(log_T(team.link, member(team, k), q)), q, z2):
            missed = True
    return missed


@func
def place_on_lattice(n, size, box: vec4, region: ti.template()) -> vec2:
    """Place n of size² in the middles of the cells of a box, m."""
    return clip(vec2(box[0] + (n // size + 0.5) * box[2] / size, box[1] + (n % size + 0.5) * box[3] / size), region)


@func
def best_on_lattice(team: ti.template(), code: ti.template(), size, region: ti.template()) -> mat2x3:
    """The best of size² places over the AUVs' box and the best that is no neighbour of it: x, y, ln objective.

    Args:
        size: at most FINE.
    """
    box = box_of(team)
    heights = ti.Vector.zero(ti.f32, FINE * FINE)
    for n in range(size * size):
        heights[n] = log_objective(team, code, place_on_lattice(n, size, box, region))[0]
    best = mat2x3(0.0)
    for row in range(2):
        top = highest(heights, size * size)
        place = place_on_lattice(top, size, box, region)
        best[row, 0], best[row, 1], best[row, 2] = place[0], place[1], heights[top]
        for n in range(size * size):
            if ti.abs(n // size - top // size) <= 1 and ti.abs(n % size - top % size) <= 1:
                heights[n] = TRIED
    return best


@func
def multistart(team: ti.template(), code: ti.template(), start: vec2, everywhere, small, region: ti.template()) -> vec3:
    """The highest of the maxima of D, SUM or PAPER, or that uphill of `start`, which wins a tie."""
    starts_per_auv = ti.static(RING_STARTS if objective_of(code) == PAPER else 1)
    nearest = 1e30
    for k in range(team.count):
        nearest = ti.min(nearest, squared_separation(team, k))
    at_auvs = ti.min(team.count, ti.static(most_auvs(code))) * starts_per_auv
    heights = each_auv(TRIED)
    lattice = mat2x3(0.0)
    starts = 1
    hill = 0.0  # square of a radius, m²
    if everywhere:
        starts = 2 + at_auvs
        heights = heights_above(team, code, nearest, region)
        size = 0
        if may_miss(team):
            size = FINE
        elif ti.static(objective_of(code) == D):
            hill = SAME_HILL * SAME_HILL * nearest
            for k in range(team.count):
                if is_peaked(team, k):
                    hill = 0.0
            if team.count > 2:
                size = COARSE
        if size > 0:
            lattice = best_on_lattice(team, code, size, region)
            starts += 2
    above = 0
    near = 0.0
    best = vec3(start[0], start[1], -1e30)
    for i in range(starts):
        point = start
        new = True
        if i == 1:
            point = mean_position(team)
        elif i >= 2 + at_auvs:
            row = i - 2 - at_auvs
            point = vec2(lattice[row, 0], lattice[row, 1])
            new = lattice[row, 2] > TRIED
        elif i > 1:
            if (i - 2) % starts_per_auv == 0:
                above = highest(heights, team.count)
                new = heights[above] > TRIED
                heights[above] = TRIED
            point = place_above(team, code, above, i % RING_STARTS)
        point = clip(point, region)
        if new and (i == 0 or (point - best.xy).norm_sqr() >= hill):
            top = ascend(team, code, point, best, near, small, True, region)
            if top[2] > best[2] + ROUNDING:
                best = top
        if ti.static(objective_of(code) != PAPER):  # the dips and peaks of PAPER are narrower than the AUVs are deep
            near = 1e-3 * ti.min(nearest, region.reach * region.reach)
    return best


@func
def search(team: ti.template(), code: ti.template(), start: vec2, everywhere, region: ti.template()) -> vec3:
    """The best place of a region and ln of the objective there: (x*, y*, ln of the objective, lengths in m).

    Args:
        team: `Team`. code: of `objectives.objective_code`. region: `Region`.
        start: a place to start from, m. Its maximum wins a tie within rounding, so a goal handed back in stays.
        everywhere: whether to start from other places too, or to follow the maximum uphill of `start`.
    """
    small = SMALL_GAIN_BETWEEN
    if everywhere:
        small = SMALL_GAIN
    best = vec3(0.0, 0.0, -1e30)
    several = True
    if ti.static(objective_of(code) == A):
        several = may_miss(team)
        if not several:
            best = ascend(team, code, clip(start, region), best, 0.0, small, False, region)
    if several:
        best = multistart(team, code, start, everywhere, small, region)
    return best


@kernel
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
        best = search(team, code, start, True, ti.static(Region(size, start, reach, limited)))
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
    reach: float = ANYWHERE,
) -> torch.Tensor:
    """`search` for many layouts at once, over the area or within reach of `start`.

    Args:
        link: (K, COLUMNS) float32 of `acoustic_link.link_table`.
        points: (n, K, 3) float32, x, y and vertical separation of every AUV, m.
        code: of `objectives.objective_code`.
        width, length: the box [0, width] × [0, length] the boat may be in, m.
        start: (n, 2) float32, a further place to start from, in the box, m; default its middle.
        reach: greatest distance of the boat from `start`, m.

    Returns:
        (n, 3) float32: best x, y (m) and ln of the objective there (lengths in m).

    Raises:
        ValueError: more than MAX_AUVS AUVs, or not as many places as layouts.
    """
    if start is None:
        start = points.new_tensor([width / 2.0, length / 2.0]).expand(points.shape[0], 2).contiguous()
    check_team(points, start)
    out = points.new_empty((points.shape[0], 3))
    _batch(link, points, start, code, reach < ANYWHERE, reach, width, length, out)
    return out
