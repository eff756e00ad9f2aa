"""Ascent of an objective of `usvauv.kernels.planning.objectives` by damped Newton steps in the region of a boat.

The region is the area, or its part inside a disc round the boat if its reach is limited. A step ends at the disc's rim;
from there the ascent follows the rim, or a border of the area at which it stops. Near a maximum the values of
neighbouring places differ by less than the resolution of single precision, so there the Newton step is accepted without
a comparison of values.
"""

from typing import NamedTuple

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.planning.information import position, squared_separation
from usvauv.kernels.planning.jet import VALUE, XX, XY, YY, X, Y
from usvauv.kernels.planning.objectives import log_objective
from usvauv.kernels.types import vec2, vec3, vec6

MAX_EVALUATIONS = 60
ROUNDING = 4e-7  # of ln of an objective, relative to 1 + its size
LEAST_DAMPING = 1e-6
UNBOUNDED = 1e9  # m, length of a step
STEP = 0.5  # of the least slant range, longest step: longer ones skip from one maximum to another


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
