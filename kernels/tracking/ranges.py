"""Ranges in an AUV's filter of a target.

A range √(|x − o|² + h²) + n has a normal error n of the variance R: o is the place of the observer, itself known with a
covariance, of which the part along the line of sight adds to R and that across it to P_⊥ below, and h the target's
depth below it. Each hypothesis is updated by an extended Kalman filter of second order in the directions across the
line of sight,

    ẑ = √(d² + P_⊥),   S = (d/ẑ)² P_∥ + R + ½ (P_⊥/ẑ)²,

d the distance of the mean, P_∥ and P_⊥ the variances along and across the line of sight.

The first range r begins hypotheses round a ring. Where the depth is not known, each has the mean, the variance and the
covariance with the horizontal distance √(r² − h²) of a depth uniform between its limits.

Source: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), §10.3.
"""

import math

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.tracking.hypotheses import KEPT, OF, FilterColumn, WorkColumn, correct, see
from usvauv.kernels.tracking.range_filter import begin_hypotheses, update_hypotheses
from usvauv.kernels.transcendental import circle
from usvauv.kernels.types import vec2, vec3, vec4


@func
def begin_ring(f: ti.template(), place: vec3, covariance: vec3, distance, variance):
    """Begin hypotheses round the ring of the first range."""
    begin_hypotheses(f)
    r, sigma = ti.max(distance, 0.0), ti.sqrt(variance)
    farthest = r + 2.0 * sigma  # of a target straight above or below
    least = ti.max(ti.min(f.depths[0] - place[2], farthest), -farthest)
    most = ti.max(ti.min(f.depths[1] - place[2], farthest), -farthest)
    h, unknown = 0.5 * (least + most), (most - least) * (most - least) / 12.0
    square = ti.max(r * r - h * h - unknown, 0.0)
    radius, floored = ti.sqrt(square), ti.max(square, r * sigma)
    # The third term is a quarter of the variance of the squared difference of a uniform depth from its mean.
    along = (r * r * variance + h * h * unknown + 0.2 * unknown * unknown) / ti.max(floored, 1e-6)
    half = math.pi / KEPT * radius
    across = ti.max(half * half, variance)
    depth = vec3(place[2] + h, unknown, -h * unknown / ti.sqrt(ti.max(floored, 1e-6)))
    for n in range(KEPT):
        c, s = circle(2.0 * math.pi / KEPT * ti.cast(n, ti.f32))
        see(f, n, 1.0 / KEPT, place, covariance, vec2(c, s), vec3(radius, along, across), depth)


@func
def height(f: ti.template(), g, place: vec3):
    """Depths of a group of hypotheses below the observer, m."""
    if ti.static(f.depth_unknown):
        return f.work[WorkColumn.z, g] - place[2]
    else:  # noqa: RET505 - Taichi reads one of both
        return f.depths[0] - place[2]


@func
def toward(f: ti.template(), g, a: ti.template(), c, s, e):
    """Covariances of number `a` of the mean of a group of hypotheses with the distance in a direction."""
    found = c * f.work[OF[a][0], g] + s * f.work[OF[a][1], g]
    if ti.static(f.depth_unknown):
        found += e * f.work[OF[a][4], g]
    return found


@func
def update(f: ti.template(), g, place: vec3, covariance: vec3, distance, variance):
    """Update a group of hypotheses by a range."""
    work = ti.static(f.work)
    dx, dy, h = work[WorkColumn.x, g] - place[0], work[WorkColumn.y, g] - place[1], height(f, g, place)
    away = ti.sqrt(dx * dx + dy * dy + h * h) + 1e-6
    c, s, e = dx / away, dy / away, h / away
    seen = [toward(f, g, a, c, s, e) for a in ti.static(range(f.axes))]
    along, spread = c * seen[0] + s * seen[1], work[WorkColumn.xx, g] + work[WorkColumn.yy, g]
    if ti.static(f.depth_unknown):
        along += e * seen[4]
        spread += work[WorkColumn.zz, g]
    own = c * c * covariance[0] + 2.0 * c * s * covariance[1] + s * s * covariance[2]
    across = ti.max(spread - along, 0.0) + (covariance[0] + covariance[2] - own)
    expected = ti.sqrt(away * away + across)
    share, bend = away / expected, across / expected
    S = share * share * along + variance + own + 0.5 * bend * bend
    of = [share * seen[a] for a in ti.static(range(f.axes))]
    correct(f, g, of, distance - expected, S, variance)
    weight = share * work[WorkColumn.share, g] / S
    x, y = weight * of[0], weight * of[1]
    return x * c, x * s, y * c, y * s


@func
def observe_range(f: ti.template(), place: vec3, covariance: vec3, distance, variance):
    """Update a filter by a range.

    Args:
        f: a `Filter`, after `usvauv.kernels.tracking.range_filter.predict`.
        place: of the observer, x, y and depth, m.
        covariance: of x and y, (xx, xy, yy), m²; 0 where they are exact.
        distance: measured, slant, m.
        variance: of its error, m², above 0.

    Returns:
        how much the estimate moves with the observer's place: ∂(x, y) over ∂(x, y) of that, row by row.
    """
    moved = vec4(1.0, 0.0, 0.0, 1.0)
    if f.head[FilterColumn.count] == 0.0:
        begin_ring(f, place, covariance, distance, variance)
    else:
        moved = update_hypotheses(f, update, place, covariance, distance, variance)
    return moved
