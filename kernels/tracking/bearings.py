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

from usvauv.kernels.functions import func
from usvauv.kernels.tracking.hypotheses import KEPT, FilterColumn, Hypothesis, corrected, count_of, load, seen_at, store
from usvauv.kernels.tracking.range_filter import USUAL
from usvauv.kernels.trigonometry import circle, wrapped
from usvauv.kernels.types import vec2, vec3

SPAN = 40.0  # farthest distance over the nearest at which a first bearing begins hypotheses
RATIO = SPAN ** (1.0 / KEPT)


@func
def begin_ray(filters: ti.template(), w, k, i, place: vec2, covariance: vec3, bearing, variance, farthest):
    """Begin hypotheses along the ray of the first bearing; their velocities follow in the next prediction."""
    filters[w, k, i, FilterColumn.known] = 1.0
    filters[w, k, i, FilterColumn.fresh] = 1.0
    filters[w, k, i, FilterColumn.count] = KEPT
    c, s = circle(bearing)
    last = farthest
    for h in range(KEPT):
        first = last / RATIO
        distance, width = 0.5 * (first + last), last - first
        along, across = width * width / 12.0, distance * distance * variance
        weight = ti.log(width / farthest)
        one = seen_at(weight, place, covariance, vec2(c, s), distance, along, across)
        store(filters, w, k, i, h, one)
        last = first


@func
def updated(one: Hypothesis, place: vec2, covariance: vec3, bearing, variance) -> Hypothesis:
    """A hypothesis after a bearing."""
    line = one.position - place
    squared = line.dot(line)
    away = ti.sqrt(squared) + 1e-6
    u = line / away
    e = vec2(0.0 - u[1], u[0])
    sideways = one.A @ e
    across, both = e.dot(sideways), u.dot(sideways)
    along = ti.max(one.A[0, 0] + one.A[1, 1] - across, 0.0)
    g = 1.0 / away
    own = e[0] * e[0] * covariance[0] + 2.0 * e[0] * e[1] * covariance[1] + e[1] * e[1] * covariance[2]
    S = g * g * (across + own + g * g * (along * across + both * both)) + variance
    innovation = wrapped(bearing - ti.atan2(line[1], line[0]) + both * g * g)
    return corrected(one, g * sideways, g * (one.B.transpose() @ e), innovation, S, variance)


@func
def observe_bearing(filters: ti.template(), w, k, i, place: vec2, covariance: vec3, bearing, variance, farthest):
    """Update a filter by a bearing.

    Args:
        filters: (W, K, M, COLUMNS) float32; `w`, `k` and `i` select the filter.
        place: of the observer, m.
        covariance: of that, (xx, xy, yy), m²; 0 where it is exact.
        bearing: measured, anticlockwise from east, rad.
        variance: of its error, rad², above 0.
        farthest: largest distance at which the target can be, m; used with the first bearing.
    """
    if filters[w, k, i, FilterColumn.count] == 0.0:
        begin_ray(filters, w, k, i, place, covariance, bearing, variance, farthest)
    else:
        filters[w, k, i, FilterColumn.surprise] = filters[w, k, i, FilterColumn.surprise] - USUAL
        for h in range(count_of(filters, w, k, i)):
            one = load(filters, w, k, i, h)
            store(filters, w, k, i, h, updated(one, place, covariance, bearing, variance))
