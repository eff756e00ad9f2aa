"""The maximum of E: cutting planes through the centre of gravity of what is left of the region.

An AUV's variance grows with its distance, so places where all variances are below the worst one at p lie in the disc
round the worst-located AUV through p, and on its side of the tangent of that disc at p. Every cut through the centre of
gravity of the polygon that is left takes away at least 4/9 of its area, whatever the variances are (Newman, Location of
the maximum on unimodal surfaces, J. ACM 12 (1965) 395–398, doi:10.1145/321281.321291). A variance is also convex, which
puts the cut beyond p where p is worse than the best place so far. Where the centre of gravity is outside the boat's
reach, the cut is the tangent of the reach.

The first place tried is the maximum for two AUVs alone, which a search along their line finds; it is often the maximum
for all, and its value is a bound that proves it.

E has its maximum in general at a kink, where two or three AUVs are located equally badly. Methods that follow slopes
get stuck there, or on plateaus, where the attitude error outweighs the noise.
"""

import taichi as ti

from usvauv.kernels.planning.newton_ascent import ROUNDING, clamp, clip
from usvauv.kernels.planning.objectives import log_variance, worst
from usvauv.kernels.planning.team import member, position, squared_separation
from usvauv.kernels.types import vec2, vec3

MOST_CUTS = 64
MOST_CORNERS = 16  # there are rarely more than seven
TOLERANCE = 1e-7  # of ln of the objective
BALANCING = 5  # Newton steps
RESOLUTION = 3e-8  # of a place in single precision, relative to the area

each_corner = ti.types.vector(MOST_CORNERS, ti.f32)


@ti.func
def centroid(x: ti.template(), y: ti.template(), count) -> vec2:
    """Centre of gravity of a polygon; a corner where it has no area."""
    first = vec2(x[0], y[0])
    area = 0.0
    moment = vec2(0.0, 0.0)
    one = vec2(x[1], y[1]) - first
    for i in range(2, count):
        other = vec2(x[i], y[i]) - first
        twice = one[0] * other[1] - one[1] * other[0]
        area += twice
        moment += twice * (one + other)
        one = other
    return first + moment / (3.0 * ti.max(area, 1e-30))


@ti.func
def cut(x: ti.template(), y: ti.template(), count, normal: vec2, level):
    """Keep the part of a polygon where normal · x ≤ level, and return its number of corners."""
    old_x = x
    old_y = y
    kept = 0
    last = count - 1
    one = vec2(old_x[last], old_y[last])
    above_one = normal.dot(one) - level
    for i in range(count):
        other = vec2(old_x[i], old_y[i])
        above = normal.dot(other) - level
        if above * above_one < 0.0 and kept < MOST_CORNERS:
            between = one + (other - one) * (above_one / (above_one - above))
            x[kept] = between[0]
            y[kept] = between[1]
            kept += 1
        if above <= 0.0 and kept < MOST_CORNERS:
            x[kept] = other[0]
            y[kept] = other[1]
            kept += 1
        one = other
        above_one = above
    return kept


@ti.func
def balanced(team: ti.template(), code: ti.template(), place: vec2) -> vec3:
    """The maximum for the two worst-located AUVs at a place alone, (x, y, lower bound on ln of the worst variance).

    It is on their line, where they are located equally badly, or straight above one that is located worse even there.
    No place anywhere locates them better, so the bound holds for all AUVs.
    """
    highest = vec2(-1e30, -1e30)
    i = 0
    j = 0
    for k in range(team.count):
        z2 = squared_separation(team, k)
        g = log_variance(team.link, member(team, k), code, (place - position(team, k)).norm_sqr() + z2, z2)[0]
        if g > highest[0]:
            highest = vec2(g, highest[0])
            j = i
            i = k
        elif g > highest[1]:
            highest[1] = g
            j = k
    way = position(team, j) - position(team, i)
    apart = way.norm_sqr()
    share = (place - position(team, i)).dot(way) / ti.max(apart, 1e-30)
    share = ti.min(ti.max(share, 0.0), 1.0)
    z2_i = squared_separation(team, i)
    z2_j = squared_separation(team, j)
    bound = ti.max(
        log_variance(team.link, member(team, i), code, z2_i, z2_i)[0],
        log_variance(team.link, member(team, j), code, z2_j, z2_j)[0],
    )
    for _ in range(BALANCING):
        rest = 1.0 - share
        g_i = log_variance(team.link, member(team, i), code, share * share * apart + z2_i, z2_i)
        g_j = log_variance(team.link, member(team, j), code, rest * rest * apart + z2_j, z2_j)
        bound = ti.max(bound, ti.min(g_i[0], g_j[0]))
        share -= (g_i[0] - g_j[0]) / ti.max(2.0 * apart * (share * g_i[1] + rest * g_j[1]), 1e-30)
        share = ti.min(ti.max(share, 0.0), 1.0)
    point = position(team, i) + share * way
    return vec3(point[0], point[1], bound)


@ti.func
def centre_of_gravity(team: ti.template(), code: ti.template(), start: vec2, region: ti.template()) -> vec3:
    """The maximum of E in a `Region`, (x, y, ln of the objective)."""
    pair = balanced(team, code, start)
    place = clip(vec2(pair[0], pair[1]), region)
    low = clamp(region.centre - region.reach, region) - place
    high = clamp(region.centre + region.reach, region) - place
    # Corners are relative to the place, so that they are not rounded to the resolution of its coordinates.
    x = each_corner(0.0)
    y = each_corner(0.0)
    corners = 4
    for i in ti.static(range(4)):
        x[i] = high[0] if ti.static(i in (1, 2)) else low[0]
        y[i] = high[1] if ti.static(i >= 2) else low[1]
    outward = vec2(0.0, 0.0)
    least = 1e30  # ln of the worst variance, at the best place
    best = place
    cuts = 0
    while cuts < MOST_CUTS:
        cuts += 1
        g = vec3(-1e30, 0.0, 0.0)
        away = vec2(0.0, 0.0)  # from the worst-located AUV
        for k in range(team.count):
            d = place - position(team, k)
            z2 = squared_separation(team, k)
            g_k = log_variance(team.link, member(team, k), code, d.norm_sqr() + z2, z2)
            if g_k[0] > g[0]:
                g = g_k
                away = d
        if g[0] < least:
            least = g[0]
            best = place
        slope = 2.0 * g[1] * away.norm()
        depth = 0.0
        normal = outward
        if outward.norm_sqr() == 0.0:
            normal = away
            depth = (1.0 - ti.exp(least - g[0])) / ti.max(slope, 1e-30)
        normal /= ti.max(normal.norm(), 1e-30)
        left = 0.0  # how far the polygon reaches beyond the place
        for i in range(corners):
            left = ti.max(left, -normal.dot(vec2(x[i], y[i])))
        proven = g[0] <= pair[2] + ROUNDING * (1.0 + ti.abs(pair[2]))
        if proven or slope * left < TOLERANCE or left - depth < RESOLUTION * region.size.max():
            cuts = MOST_CUTS
        else:
            corners = cut(x, y, corners, normal, -depth)
            target = place + centroid(x, y, corners)
            there = clip(target, region)
            outward = vec2(0.0, 0.0)
            if ti.static(region.limited):
                radius = target - region.centre
                if radius.norm_sqr() > region.reach * region.reach:
                    outward = radius
            moved = there - place
            for i in range(corners):
                x[i] -= moved[0]
                y[i] -= moved[1]
            place = there
            if corners < 3:
                cuts = MOST_CUTS
    # Along a kink the values of places near the maximum differ by less than the resolution of single precision.
    pair = balanced(team, code, best)
    there = clip(vec2(pair[0], pair[1]), region)
    value = worst(team, code, there)[0]
    if value >= -least - ROUNDING * (1.0 + ti.abs(least)):
        best = there
        least = -value
    return vec3(best[0], best[1], -least)
