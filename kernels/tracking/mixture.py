"""Reduction of a mixture: light hypotheses merge into heavy ones that they resemble.

From the heaviest on, each hypothesis takes in those within a squared distance D of its mean, in units of its own
covariance: D < `ALIKE`, or D times the lighter one's share of all weights below `LIGHT`, since what a light one adds to
the mixture's error is in proportion to its weight. Both limits widen by `WIDER` with each hypothesis kept after the
first `NARROW`, and the last one takes in whatever is left: no weight is dropped, and a mixture of few hypotheses keeps
them apart. The merged Gaussian has the moments of all. Depths do not count in the distance.

Source: Salmond, "Mixture reduction algorithms for point and extended object tracking in clutter", IEEE Trans. AES 45
(2009), doi 10.1109/TAES.2009.5089549.
"""

import taichi as ti

from usvauv.kernels.functions import LANES, func
from usvauv.kernels.tracking.hypotheses import (
    CAPACITY,
    COVARIANCE,
    KEPT,
    MEAN,
    PAIRS,
    FilterColumn,
    HypothesisColumn,
    WorkColumn,
    most_of,
    wide,
)

ALIKE = 0.25
LIGHT = 0.003
NARROW = 12
WIDER = 1.15  # all by simulations: wider limits lose turns and mirror images, narrower ones leave more to the last
AGES = 0.25  # squared distance of two hypotheses whose last turns are a step apart
WHATEVER = 1e30  # instead of `WIDER`: all that is left is within limits
LEAST = 1e-9  # m²/s²
PLACE = (1 << (CAPACITY - 1).bit_length()) - 1  # last bits of a weight that have the hypothesis's place
METRIC = WorkColumn.metric_xx  # first of the columns of a metric


@func
def marked(share, place):
    """A weight with the place of its hypothesis in its last bits, by which any two differ."""
    return ti.bit_cast(ti.bit_cast(share, ti.i32) & ~PLACE | place, ti.f32)


@func
def prepare(f: ti.template(), g):
    """Write the metric of a group of hypotheses and what is left of them.

    The metric is the inverse of the covariance by blocks A, B and C: A⁻¹, A⁻¹ B and (C − Bᵀ A⁻¹ B)⁻¹, those off the
    diagonals of the first and the last twice.
    """
    work = ti.static(f.work)
    share = work[WorkColumn.share, g]
    work[WorkColumn.most, g] = ti.max(ALIKE, LIGHT / ti.max(share, 1e-30))
    if ti.static(work.width == 1):
        work[WorkColumn.left, g] = ti.select(share > 0.0, marked(share, g), 0.0)
    else:
        left = ti.Vector([marked(share[n], LANES * g + n) for n in ti.static(range(LANES))])
        work[WorkColumn.left, g] = ti.select(share > 0.0, left, 0.0)
    xx, xy, yy = work[WorkColumn.xx, g], work[WorkColumn.xy, g], work[WorkColumn.yy, g]
    xu, xv, yu, yv = [work[c, g] for c in ti.static((WorkColumn.xu, WorkColumn.xv, WorkColumn.yu, WorkColumn.yv))]
    whole = 1.0 / (xx * yy - xy * xy)
    a, b, c = yy * whole, 0.0 - xy * whole, xx * whole
    g_xu, g_xv, g_yu, g_yv = a * xu + b * yu, a * xv + b * yv, b * xu + c * yu, b * xv + c * yv
    uu, uv, vv = work[WorkColumn.uu, g], work[WorkColumn.uv, g], work[WorkColumn.vv, g]
    # In single precision what is left can be less than 0 where a velocity is known by positions alone.
    uu = ti.max(uu - (xu * g_xu + yu * g_yu), 1e-3 * uu + LEAST)
    vv = ti.max(vv - (xv * g_xv + yv * g_yv), 1e-3 * vv + LEAST)
    most = 0.99 * ti.sqrt(uu * vv)
    uv = ti.max(ti.min(uv - 0.5 * (xu * g_xv + yu * g_yv + xv * g_xu + yv * g_yu), most), 0.0 - most)
    whole = 1.0 / (uu * vv - uv * uv)
    metric = [a, 2.0 * b, c, g_xu, g_xv, g_yu, g_yv, vv * whole, -2.0 * uv * whole, uu * whole]
    for n in ti.static(range(len(metric))):
        work[METRIC + n, g] = metric[n]


@func
def take_away(f: ti.template(), groups, h, to, wider):
    """Take hypothesis h and those near it away, by limits times `wider`, to be merged into place `to`.

    Returns:
        greatest weight of what is left.
    """
    work, width = ti.static(f.work, f.work.width)
    own = [work.one[HypothesisColumn.age + n, h] for n in ti.static(range(5))]
    m = [work.one[METRIC + n, h] for n in ti.static(range(10))]
    most = wide(0.0, width)
    for g in range(groups):
        older, dx, dy, u, v = [work[HypothesisColumn.age + n, g] - own[n] for n in ti.static(range(5))]
        du, dv = u - m[3] * dx - m[5] * dy, v - m[4] * dx - m[6] * dy
        distance = dx * (m[0] * dx + m[1] * dy) + m[2] * dy * dy
        distance = distance + (du * (m[7] * du + m[8] * dv) + m[9] * dv * dv) + AGES * older * older
        left = work[WorkColumn.left, g]
        # Of h itself it is 0, or not a number where the metric is infinite.
        rest = ti.select(distance >= wider * work[WorkColumn.most, g], left, 0.0)
        work[WorkColumn.to, g] = ti.select(rest < left, to, work[WorkColumn.to, g])
        work[WorkColumn.left, g] = rest
        most = ti.select(most < rest, rest, most)
    return most_of(most, width)


@func
def merge(f: ti.template(), groups, count):
    """Write the hypotheses, merged into `count`, by the sums of their moments about the estimate.

    About it, since in single precision moments about a far point lose the covariance.
    """
    work, kept, width = ti.static(f.work, f.kept, f.kept.width)
    origin = [f.head[n] for n in ti.static(range(4))] + [f.depths[0]]
    for g in range(groups):
        share, age = work[WorkColumn.share, g], work[WorkColumn.age, g]
        d = [work[MEAN[a], g] - origin[a] for a in ti.static(range(f.axes))]
        second = [work[COVARIANCE[n], g] + d[PAIRS[n][0]] * d[PAIRS[n][1]] for n in ti.static(range(f.pairs))]
        work[WorkColumn.age, g] = share * age
        for a in ti.static(range(f.axes)):
            work[MEAN[a], g] = share * d[a]
        for n in ti.static(range(f.pairs)):
            work[COVARIANCE[n], g] = share * second[n]
    kept_groups = (count + width - 1) // width
    for g in range(kept_groups):
        for c in ti.static(range(f.columns)):
            kept[c, g] = wide(0.0, width)
    for h in range(groups * width):
        if work.one[WorkColumn.share, h] > 0.0:
            to = ti.cast(work.one[WorkColumn.to, h], ti.i32)
            # Read all before the first is written: after each write Taichi reads addresses again.
            sums = [kept.one[c, to] + work.one[c, h] for c in ti.static(range(f.columns))]
            for c in ti.static(range(f.columns)):
                kept.one[c, to] = sums[c]
    for g in range(kept_groups):
        whole = 1.0 / ti.max(kept[HypothesisColumn.share, g], 1e-30)
        mean = [whole * kept[MEAN[a], g] for a in ti.static(range(f.axes))]
        kept[HypothesisColumn.age, g] = whole * kept[HypothesisColumn.age, g]
        for a in ti.static(range(f.axes)):
            kept[MEAN[a], g] = origin[a] + mean[a]
        for n in ti.static(range(f.pairs)):
            kept[COVARIANCE[n], g] = whole * kept[COVARIANCE[n], g] - mean[PAIRS[n][0]] * mean[PAIRS[n][1]]


@func
def reduce(f: ti.template(), groups):
    """Reduce the hypotheses of the workspace to `KEPT`, after their estimate."""
    width = ti.static(f.work.width)
    most = wide(0.0, width)
    for g in range(groups):
        prepare(f, g)
        left = f.work[WorkColumn.left, g]
        most = ti.select(most < left, left, most)
    kept, best, wider = 0, most_of(most, width), 1.0
    while kept < KEPT and best > 0.0:
        wider = ti.select(kept < NARROW, 1.0, WIDER * wider)
        if kept == KEPT - 1:
            wider = WHATEVER
        best = take_away(f, groups, ti.bit_cast(best, ti.i32) & PLACE, ti.cast(kept, ti.f32), wider)
        kept += 1
    f.head[FilterColumn.count] = ti.cast(kept, ti.f32)
    merge(f, groups, kept)
