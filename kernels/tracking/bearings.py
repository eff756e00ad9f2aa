"""Bearings in an AUV's filter of a target.

A bearing is the angle of the line of sight, anticlockwise from east, with a normal error of deviation σ. It updates
each hypothesis by an extended Kalman filter of second order. With d the distance of the mean, and P_∥, P_⊥ and P_× the
variances along and across the line of sight and the covariance of both,

    β̂ = β(mean) − P_×/d²,   S = (P_⊥ + O_⊥)/d² + σ² + (P_∥ P_⊥ + P_×²)/d⁴,

where O_⊥ is the variance of the observer's place across the line. The last term makes a bearing worth little near a
target whose place is not known, where the direction of the line of sight is not either.

The first measurement of a filter may be a bearing: then the hypotheses lie along the ray, each with an interval of the
distance, `RATIO` times the one before, and a weight in proportion to it.

Sources: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), §10.3; Peach,
"Bearings-only tracking using a set of range-parameterised extended Kalman filters", IEE Proc. Control Theory Appl. 142
(1995), doi 10.1049/ip-cta:19951614.
"""

import taichi as ti

from usvauv.kernels.functions import LANES, func
from usvauv.kernels.tracking.hypotheses import KEPT, OF, FilterColumn, WorkColumn, correct, see
from usvauv.kernels.tracking.range_filter import begin_hypotheses, update_hypotheses
from usvauv.kernels.transcendental import circle, wrapped
from usvauv.kernels.types import vec2, vec3, vec4

SPAN = 40.0  # farthest distance over the nearest at which a first bearing begins hypotheses
RATIO = SPAN ** (1.0 / KEPT)


@func
def begin_ray(f: ti.template(), place: vec3, covariance: vec3, bearing, variance, farthest):
    """Begin hypotheses along the ray of the first bearing."""
    begin_hypotheses(f)
    c, s = circle(bearing)
    span = f.depths[1] - f.depths[0]
    depth = vec3(0.5 * (f.depths[0] + f.depths[1]), span * span / 12.0, 0.0)
    last = farthest
    for h in range(KEPT):
        first = last / RATIO
        distance, width = 0.5 * (first + last), last - first
        along, across = width * width / 12.0, distance * distance * variance
        see(f, h, width / farthest, place, covariance, vec2(c, s), vec3(distance, along, across), depth)
        last = first


@func
def update(f: ti.template(), g, place: vec3, covariance: vec3, bearing, variance):
    """Update a group of hypotheses by a bearing."""
    work = ti.static(f.work)
    dx, dy = work[WorkColumn.x, g] - place[0], work[WorkColumn.y, g] - place[1]
    away = ti.sqrt(dx * dx + dy * dy) + 1e-6
    c, s = dx / away, dy / away
    xx, xy, yy = work[WorkColumn.xx, g], work[WorkColumn.xy, g], work[WorkColumn.yy, g]
    sideways_x, sideways_y = c * xy - s * xx, c * yy - s * xy
    across, both = c * sideways_y - s * sideways_x, c * sideways_x + s * sideways_y
    along = ti.max(xx + yy - across, 0.0)
    g1 = 1.0 / away
    g2 = g1 * g1
    own = s * s * covariance[0] - 2.0 * c * s * covariance[1] + c * c * covariance[2]
    S = g2 * (across + own + g2 * (along * across + both * both)) + variance
    of = [g1 * (c * work[OF[a][1], g] - s * work[OF[a][0], g]) for a in ti.static(range(f.axes))]
    correct(f, g, of, wrapped(bearing - angle(dx, dy, work.width) + both * g2), S, variance)
    weight = g1 * work[WorkColumn.share, g] / S
    x, y = weight * of[0], weight * of[1]
    return 0.0 - x * s, x * c, 0.0 - y * s, y * c


@func
def angle(x, y, width: ti.template()):
    """Angles of a group of vectors, rad."""
    if ti.static(width == 1):
        return ti.atan2(y, x)
    else:  # noqa: RET505 - Taichi reads one of both
        return ti.Vector([ti.atan2(y[n], x[n]) for n in ti.static(range(LANES))])


@func
def observe_bearing(f: ti.template(), place: vec3, covariance: vec3, bearing, variance, farthest):
    """Update a filter by a bearing.

    Args:
        f: a `Filter`, after `usvauv.kernels.tracking.range_filter.predict`.
        place: of the observer, x, y and depth, m.
        covariance: of that, (xx, xy, yy), m²; 0 where it is exact.
        bearing: measured, anticlockwise from east, rad.
        variance: of its error, rad², above 0.
        farthest: largest distance at which the target can be, m; used with the first bearing.

    Returns:
        as `usvauv.kernels.tracking.ranges.observe_range`.
    """
    moved = vec4(1.0, 0.0, 0.0, 1.0)
    if f.head[FilterColumn.count] == 0.0:
        begin_ray(f, place, covariance, bearing, variance, farthest)
    else:
        moved = update_hypotheses(f, update, place, covariance, bearing, variance)
    return moved
