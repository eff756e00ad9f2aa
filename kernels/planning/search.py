"""Global maximum of an objective of `usvauv.kernels.planning.objectives` over the boat's place, in the area or within
reach.

One or more ascents by damped Newton steps in the area, or in its part inside a disc round the boat if its reach is
limited. A step ends at the disc's rim; from there the ascent follows the rim, or a border of the area at which it
stops. Near a maximum the values of neighbouring places differ by less than the resolution of single precision, so there
the Newton step is accepted without a comparison of values. Starts of ascents:

- D, SUM, PAPER can have several local maxima, above AUVs that are far apart for their depth and between them. So there
  is an ascent from a given place, from the AUVs' mean, and from each AUV that is not close to one tried before; and no
  step is longer than half the slant range of the nearest AUV, the width of a maximum there. Where the attitude error
  makes an AUV's variance constant over a plateau, D can have maxima at the plateaus' edges: then the two best of
  several places between each two AUVs are starts too. By noise alone the logarithm of an AUV's variance is convex
  where it is deeper than far, so D has one maximum where all are: it needs no start close to the best maximum so far,
  unless errors that grow with distance make it peaked above an AUV. `benchmarks.plan` looks for a higher place in
  thousands of layouts. PAPER dips straight above an AUV, where its sines vanish, and peaks on a ring of radius about
  √|z| round it, so there ascents start on the ring of every AUV. Within a reach the ascents start at the point of it
  nearest to each of these places.
- A has one maximum, and one ascent.

All of them assume a level array at its present elevation.
"""

from typing import NamedTuple

import taichi as ti
import torch

from usvauv.kernels.functions import func, kernel
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
from usvauv.kernels.planning.jet import VALUE, XX, XY, YY, X, Y
from usvauv.kernels.planning.objectives import PAPER, A, D, log_objective, objective_of
from usvauv.kernels.positioning.acoustic_link import ALIGNMENT, ATTITUDE, HEADING, POSITION, SOUND_SPEED
from usvauv.kernels.trigonometry import TWO_PI
from usvauv.kernels.types import array2, array3, vec2, vec3, vec4, vec6

MAX_EVALUATIONS = 60
ROUNDING = 4e-7  # of ln of an objective, relative to 1 + its size
SMALL_GAIN = 1e-6  # a Newton step of a smaller predicted gain is accepted without evaluation
SMALL_GAIN_BETWEEN = 1e-3  # likewise between searches everywhere; the next step makes up for it
LEAST_DAMPING = 1e-6
UNBOUNDED = 1e9  # m, length of a step
STEP = 0.5  # of the least slant range, longest step: longer ones skip from one maximum to another
RING_STARTS = 8
ANYWHERE = 1e9  # m, unlimited reach
LATTICE = 10  # places tried along each side of the AUVs' box
BETWEEN = 5  # places tried between two AUVs
PLATEAU = 10.0  # variance by the attitude error over that by noise, straight above
CLOSE_BY = 0.5  # of the least depth: AUVs so near to one another share a maximum
SAME_HILL = 0.7  # likewise: ascents from places so near to a maximum of D lead to it
PEAKED = 10.0  # variance by errors that grow with distance over that by the others, as far from an AUV as it is deep


class Region(NamedTuple):
    """Where the boat may be: the box [0, width] × [0, length], and within `reach` of a place in it if limited.

    Attributes:
        size: vec2, width and length, m.
        centre: vec2, m.
        reach: greatest distance from the centre, m.
        limited: whether the reach counts, a constant of the kernel.
    """

    size: ti.Vector
    centre: ti.Vector
    reach: ti.f32
    limited: bool


@func
def clamp(place: vec2, region: ti.template()) -> vec2:
    """The point of the box nearest to a place."""
    return ti.min(ti.max(place, 0.0), region.size)


@func
def clip(place: vec2, region: ti.template()) -> vec2:
    """A point of the region near a place."""
    point = clamp(place, region)
    if ti.static(region.limited):
        way = point - region.centre
        if way.norm_sqr() > region.reach * region.reach:
            point = region.centre + way * (region.reach / way.norm())
    return point


@func
def newton_step(f: vec6, place: vec2, region: ti.template()) -> vec2:
    """A Newton step uphill, the Hessian shifted where it is not negative definite; it may leave the box."""
    g_x = f[X]
    g_y = f[Y]
    h_xx = f[XX]
    h_xy = f[XY]
    h_yy = f[YY]
    # A coordinate held by the border takes no part in the step.
    if (place[0] <= 0.0 and g_x < 0.0) or (place[0] >= region.size[0] and g_x > 0.0):
        g_x = 0.0
        h_xy = 0.0
        h_xx = h_yy
    if (place[1] <= 0.0 and g_y < 0.0) or (place[1] >= region.size[1] and g_y > 0.0):
        g_y = 0.0
        h_xy = 0.0
        h_yy = h_xx
    mean = 0.5 * (h_xx + h_yy)
    spread = ti.sqrt(0.25 * (h_xx - h_yy) * (h_xx - h_yy) + h_xy * h_xy)
    curvature = ti.abs(mean) + spread
    largest = mean + spread
    shift = 1e-12
    if largest > -1e-4 * curvature:
        shift += largest + ti.max(ti.abs(largest), 1e-4 * curvature)
    h_xx -= shift
    h_yy -= shift
    return vec2(h_xy * g_y - h_yy * g_x, h_xy * g_x - h_xx * g_y) / (h_xx * h_yy - h_xy * h_xy)


@func
def step_along_circle(f: vec6, place: vec2, outward: vec2, region: ti.template()) -> vec2:
    """A Newton step uphill along the circle that bounds the reach; none where it would leave the box."""
    slope = f[Y] * outward[0] - f[X] * outward[1]
    tangent = vec2(-outward[1], outward[0])
    if slope < 0.0:
        slope = -slope
        tangent = -1.0 * tangent
    step = vec2(0.0, 0.0)
    to_side = (place[0] <= 0.0 and tangent[0] < 0.0) or (place[0] >= region.size[0] and tangent[0] > 0.0)
    to_end = (place[1] <= 0.0 and tangent[1] < 0.0) or (place[1] >= region.size[1] and tangent[1] > 0.0)
    if not (to_side or to_end):
        bend = (
            f[XX] * tangent[0] * tangent[0]
            + 2.0 * f[XY] * tangent[0] * tangent[1]
            + f[YY] * tangent[1] * tangent[1]
            - (f[X] * outward[0] + f[Y] * outward[1]) / region.reach
        )
        step = tangent * ti.min(slope / ti.max(ti.abs(bend), 1e-12), region.reach)
    return step


@func
def next_place(f: vec6, place: vec2, damping, longest, region: ti.template()) -> vec3:
    """Where a damped step of at most `longest` (m) from a place ends inside the region, and the gain by the slope."""
    step = damping * newton_step(f, place, region)
    length = step.norm()
    if length > longest:
        step *= longest / length
    target = place + step
    along = False
    if ti.static(region.limited):
        radius = place - region.centre
        distance = radius.norm()
        if (target - region.centre).norm_sqr() > region.reach * region.reach:
            outward = radius / ti.max(distance, 1e-20)
            along = distance > 0.9999 * region.reach and step.dot(outward) >= 0.0
            if along:
                step = damping * step_along_circle(f, place, outward, region)
                radius += step
                target = region.centre + radius * (region.reach / ti.max(radius.norm(), 1e-20))
            else:  # as far as the circle
                a = step.norm_sqr()
                b = radius.dot(step)
                c = ti.min(distance * distance - region.reach * region.reach, 0.0)
                target = place + step * ((ti.sqrt(b * b - a * c) - b) / a)
    target = clamp(target, region)
    if not along:
        step = target - place
    # Along the circle the slope is that of the arc; `step_along_circle` has accounted for its bend.
    return vec3(target[0], target[1], f[X] * step[0] + f[Y] * step[1])


@func
def least_slant_range(team: ti.template(), place: vec2):
    """Slant range of the AUV nearest to a place, m: the length over which an objective's derivatives change."""
    least = 1e30
    for k in range(team.count):
        least = ti.min(least, (place - position(team, k)).norm_sqr() + squared_separation(team, k))
    return ti.sqrt(least)


@func
def ascend(
    team: ti.template(),
    code: ti.template(),
    start: vec2,
    best: vec3,
    near,
    small,
    bounded: ti.template(),
    region: ti.template(),
) -> vec3:
    """The local maximum uphill of a start in the region, (x, y, `log_objective`).

    Args:
        team, code: `Team`, and of `objectives.objective_code`.
        best: a maximum found earlier. An ascent whose next step leads to a place less than √near (m) away from it, and
            not above it, ends there as that maximum.
        small: predicted gain up to which a step is accepted without evaluation.
        bounded: whether no step is longer than STEP of the least slant range, a constant of the kernel.
        region: `Region`.
    """
    place = start
    candidate = start
    f = vec6(-1e30, 0.0, 0.0, 0.0, 0.0, 0.0)
    damping = 1.0
    evaluations = 0
    ascending = True
    while ascending:
        f_new = log_objective(team, code, candidate)
        evaluations += 1
        if f_new[VALUE] > f[VALUE] - ROUNDING * (1.0 + ti.abs(f[VALUE])):
            place = candidate
            f = f_new
            damping = ti.min(2.0 * damping, 1.0)
        else:
            damping *= 0.3
        longest = UNBOUNDED
        if ti.static(bounded):
            longest = STEP * least_slant_range(team, place)
        there = next_place(f, place, damping, longest, region)
        candidate = vec2(there[0], there[1])
        gain = there[2]
        ascending = damping > LEAST_DAMPING and evaluations < MAX_EVALUATIONS
        if gain <= small * damping:
            ascending = False
            if gain > 0.0:
                place = candidate
                f[VALUE] += 0.5 * gain
        elif f[VALUE] <= best[2] and (candidate - vec2(best[0], best[1])).norm_sqr() < near:
            ascending = False
            place = vec2(best[0], best[1])
            f[VALUE] = best[2]
    return vec3(place[0], place[1], f[VALUE])


@func
def place_on_ring(team: ti.template(), k, spoke) -> vec2:
    """One of RING_STARTS places on the ring round AUV k on which PAPER peaks."""
    angle = TWO_PI / RING_STARTS * spoke
    radius = ti.sqrt(ti.sqrt(squared_separation(team, k)))
    return position(team, k) + radius * vec2(ti.cos(angle), ti.sin(angle))


@func
def is_close_by(team: ti.template(), k, tried: ti.template(), nearest) -> bool:
    """Whether AUV k shares its maximum with an earlier one marked in `tried`; `nearest` is the least squared depth."""
    close = False
    for j in range(k):
        apart = position(team, k) - position(team, j)
        if tried[j] > 0.0 and apart.norm_sqr() < CLOSE_BY * CLOSE_BY * nearest:
            close = True
    return close


@func
def has_plateau(team: ti.template(), k) -> bool:
    """Whether the attitude error outweighs the noise far round AUV k, where its variance is therefore constant."""
    z2 = squared_separation(team, k)
    return team.link[member(team, k), ATTITUDE] * z2 * ti.exp(log_T(team.link, member(team, k), z2)) > PLATEAU


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
def best_on_lattice(team: ti.template(), code: ti.template(), region: ti.template()) -> mat2x3:
    """The best of LATTICE² places over the AUVs' box and the best one away from that, as of `best_between_auvs`."""
    box = box_of(team)
    best = mat2x3([[0.0, 0.0, -1e30], [0.0, 0.0, -1e30]])
    for turn in ti.static(range(2)):
        for n in range(LATTICE * LATTICE):
            cell = vec2(box[2], box[3]) / LATTICE
            point = clip(vec2(box[0] + (n // LATTICE + 0.5) * cell[0], box[1] + (n % LATTICE + 0.5) * cell[1]), region)
            away = point - vec2(best[0, 0], best[0, 1])
            if turn == 0 or ti.abs(away[0]) > 1.5 * cell[0] or ti.abs(away[1]) > 1.5 * cell[1]:
                value = log_objective(team, code, point)[0]
                if value > best[turn, 2]:
                    best[turn, 0], best[turn, 1], best[turn, 2] = point[0], point[1], value
    return best


@func
def best_between_auvs(team: ti.template(), code: ti.template(), region: ti.template()) -> mat2x3:
    """The two best of five places between each two AUVs, as rows (x, y, ln of the objective); −1e30 for none.

    Only between AUVs of which at least one has a plateau: where plateaus end D can have maxima above no AUV.
    """
    first = vec3(0.0, 0.0, -1e30)
    second = first
    for j in range(team.count):
        limited = has_plateau(team, j)
        for k in range(team.count):
            if k != j and limited and (k > j or not has_plateau(team, k)):
                for i in range(BETWEEN):
                    share = (i + 0.5) / BETWEEN
                    point = clip(position(team, j) + share * (position(team, k) - position(team, j)), region)
                    value = log_objective(team, code, point)[0]
                    if value > first[2]:
                        second = first
                        first = vec3(point[0], point[1], value)
                    elif value > second[2]:
                        second = vec3(point[0], point[1], value)
    return mat2x3([[first[0], first[1], first[2]], [second[0], second[1], second[2]]])


@func
def multistart(team: ti.template(), code: ti.template(), start: vec2, everywhere, small, region: ti.template()) -> vec3:
    """The highest of the maxima of D, SUM or PAPER, or that uphill of `start`, which wins a tie."""
    starts_per_auv = ti.static(RING_STARTS if objective_of(code) == PAPER else 1)
    nearest = 1e30
    for k in range(team.count):
        nearest = ti.min(nearest, squared_separation(team, k))
    at_auvs = team.count * starts_per_auv
    between = mat2x3(0.0)
    starts = 1
    if everywhere:
        starts = 2 + at_auvs
    hill = 0.0  # square of a radius, m²
    if everywhere and may_miss(team):
        between = best_on_lattice(team, code, region)
        starts += 2
    elif ti.static(objective_of(code) == D):
        if everywhere:
            hill = SAME_HILL * SAME_HILL * nearest
            for k in range(team.count):
                if is_peaked(team, k):
                    hill = 0.0
        if everywhere and team.count > 2:
            between = best_between_auvs(team, code, region)
            starts += 2
    tried = each_auv(0.0)
    near = 0.0
    best = vec3(start[0], start[1], -1e30)
    for i in range(starts):
        point = start
        new = True
        if i == 1:
            point = mean_position(team)
        elif i >= 2 + at_auvs:
            row = i - 2 - at_auvs
            point = vec2(between[row, 0], between[row, 1])
            new = between[row, 2] > -1e30
        elif i > 1:
            k = (i - 2) // starts_per_auv
            if ti.static(objective_of(code) == PAPER):
                point = place_on_ring(team, k, i % RING_STARTS)
            else:
                point = position(team, k)
                new = not is_close_by(team, k, tried, nearest)
                tried[k] = ti.cast(new, ti.f32)
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
    best = vec3(0.0, 0.0, 0.0)
    single = False
    if ti.static(objective_of(code) == A):
        single = not may_miss(team)
    if single:
        best = ascend(team, code, clip(start, region), vec3(0.0, 0.0, -1e30), 0.0, small, False, region)
    else:
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
