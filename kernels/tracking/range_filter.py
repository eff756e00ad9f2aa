"""An AUV's filter of a moving target: a mixture of Gaussian hypotheses.

The target keeps its speed, within known limits, and turns at random: by an angle of either sign, after a number of
steps since the last turn, both uniform between limits. Between turns its velocity walks a little. Over a step T, the
velocity v turned by θ,

    v ← R(θ) v + w,   x ← x + T v,   w ~ N(0, q² I).

Its depth is constant; where only limits of it are known, it is one more number of the state.

One mechanism does both that a range only tells of a ring and that a turn shows later: a hypothesis is a Gaussian with
a weight. The first range begins `KEPT` of them round the ring (`usvauv.kernels.tracking.ranges`). In a step each moves
on straight, and the heaviest of those that can turn also begin hypotheses of a turn, one for each quarter of the angles
(left and right, less and more); mean and covariance of R(θ) v over a quarter are exact, by the moments of cos θ and
cos 2θ. At the end of a step hypotheses of hardly any weight are forgotten, and light ones merge into heavy ones that
they resemble, by their moments (`usvauv.kernels.tracking.mixture`).

A speed less well known than by its limits is taken as measured, with the variance after which it is as well known. The
time of the last turn counts, since it says when the next one can come: each hypothesis has it.

A filter that follows a mirror image does not notice by its covariance. The logarithm of the likelihood of each range,
over that of one without error and of the same variance, is on average −½ ln(S/R) − ½; where it is below −`USUAL` for
several, and the sum of what is missing exceeds `LOST`, the filter begins anew with the next range, until which the
estimate stays.

A mission calls, for one filter after the other, `predict`, `ranges.observe_range` for each range that arrives, and
`finish`.

Sources: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), §11.6
(several models); Salmond, "Mixture reduction algorithms for point and extended object
tracking in clutter", IEEE Trans. AES 45 (2009), doi 10.1109/TAES.2009.5089549.
"""

import math

import taichi as ti

from usvauv.kernels.functions import LANES, func
from usvauv.kernels.tracking import mixture
from usvauv.kernels.tracking.hypotheses import (
    CAPACITY,
    KEPT,
    OF,
    FilterColumn,
    WorkColumn,
    adjust,
    exponential,
    most_of,
    sum_of,
    wide,
)
from usvauv.kernels.transcendental import circle
from usvauv.kernels.types import vec2, vec3, vec4

TURNS = 4  # hypotheses that one begins by turning
TOGETHER = LANES // TURNS  # that turn in a group
MOST_TURNING = (CAPACITY - KEPT) // TURNS
USUAL = 2.5  # of a range's logarithmic likelihood, see above
LOST = 8.0
LIKELIEST_TURN = 0.5  # greatest probability of a turn in a step
LEAST_SPEED_VARIANCE = 1e-4  # m²/s²
FORGOTTEN = math.exp(-8.0)  # weight, over the heaviest
PLACE = [WorkColumn.x, WorkColumn.y, WorkColumn.xx, WorkColumn.xy, WorkColumn.yy]
SLOPES = [WorkColumn.xu, WorkColumn.xv, WorkColumn.yu, WorkColumn.yv]


@ti.dataclass
class Motion:
    """What a filter assumes of a target.

    Attributes:
        step: T, s.
        slowest, fastest: limits of its speed, m/s.
        least_interval, greatest_interval: limits of the steps from one turn to the next; of one that does not turn
            both are larger than any episode.
        least_turn, greatest_turn: limits of the angle of a turn, rad, from 0 to π, the second larger.
        walk: q, standard deviation that the velocity gains in a step, m/s.
    """

    step: ti.f32
    slowest: ti.f32
    fastest: ti.f32
    least_interval: ti.f32
    greatest_interval: ti.f32
    least_turn: ti.f32
    greatest_turn: ti.f32
    walk: ti.f32


@func
def begin(filters: ti.template(), w, k, i):
    """Begin filter (w, k, i) of (W, K, M, C) float32, which knows nothing."""
    for c in range(filters.shape[3]):
        filters[w, k, i, c] = 0.0


@func
def count_of(f: ti.template()):
    """Number of hypotheses."""
    return ti.cast(f.head[FilterColumn.count], ti.i32)


@func
def groups_of(f: ti.template()):
    """Number of groups of hypotheses."""
    return (count_of(f) + f.work.width - 1) // f.work.width


@func
def update_hypotheses(
    f: ti.template(), update: ti.template(), place: vec3, covariance: vec3, measured, variance
) -> vec4:
    """Update all hypotheses by a measurement, group by group.

    Args:
        update: a Taichi function (f, g, place, covariance, measured, variance) that does so with group g, and gives
            that group's part of what is returned.

    Returns:
        as `usvauv.kernels.tracking.ranges.observe_range`.
    """
    f.head[FilterColumn.surprise] = f.head[FilterColumn.surprise] - USUAL
    sums = [wide(0.0, f.work.width) for _ in ti.static(range(4))]
    for g in range(groups_of(f)):
        xx, xy, yx, yy = update(f, g, place, covariance, measured, variance)
        sums[0] += xx
        sums[1] += xy
        sums[2] += yx
        sums[3] += yy
    return vec4([sum_of(sums[n], f.work.width) for n in ti.static(range(4))])


@func
def arc_moments(first, last) -> vec4:
    """Means of cos θ, sin θ, cos 2θ and sin 2θ over angles from `first` to `last`, rad."""
    c0, s0 = circle(first)
    c1, s1 = circle(last)
    width = 1.0 / (last - first)
    return width * vec4(s1 - s0, c0 - c1, s1 * c1 - s0 * c0, c0 * c0 - c1 * c1)


@func
def limit(f: ti.template(), g, motion: Motion):
    """Let the speeds of a group of hypotheses be at least as well known as by their limits."""
    work = ti.static(f.work)
    u, v = work[WorkColumn.vx, g], work[WorkColumn.vy, g]
    squared, trace = u * u + v * v, work[WorkColumn.uu, g] + work[WorkColumn.vv, g]
    speed = ti.sqrt(squared) + 1e-12
    c, s = u / speed, v / speed
    of = [c * work[OF[a][2], g] + s * work[OF[a][3], g] for a in ti.static(range(f.axes))]
    along = c * of[2] + s * of[3]
    width = motion.fastest - motion.slowest
    least = ti.max(width * width / 12.0, LEAST_SPEED_VARIANCE)
    # A reading of the variance r = least·along/(along − least): gain 1/(along + r) is this.
    gain = ti.select(along > least, (along - least) / (along * along), 0.0)
    gain = ti.select(squared > trace, gain, 0.0)
    adjust(f, g, of, gain, 0.5 * (motion.slowest + motion.fastest) - speed - 0.5 * (trace - along) / speed)


@func
def turn_probability(age, motion: Motion):
    """Probability of a turn in a step that ends `age` steps after the last turn."""
    probability = ti.min(LIKELIEST_TURN, 1.0 / ti.max(motion.greatest_interval + 1.0 - age, 1.0))
    return ti.select(age > motion.least_interval - 0.5, probability, 0.0)


@func
def go(f: ti.template(), place: ti.template(), velocity: ti.template(), B: ti.template(), C: ti.template(), to, T):
    """Write a group of hypotheses that go on with new velocities for a time T.

    Args:
        place: columns x, y, xx, xy and yy before. velocity: u and v.
        B: columns xu, xv, yu and yv, of the velocity that is new. C: uu, uv and vv.
    """
    xu, xv, yu, yv = B[0] + T * C[0], B[1] + T * C[1], B[2] + T * C[1], B[3] + T * C[2]
    f.work[WorkColumn.x, to] = place[0] + T * velocity[0]
    f.work[WorkColumn.y, to] = place[1] + T * velocity[1]
    f.work[WorkColumn.vx, to] = velocity[0]
    f.work[WorkColumn.vy, to] = velocity[1]
    f.work[WorkColumn.xx, to] = place[2] + T * (B[0] + xu)
    f.work[WorkColumn.xy, to] = place[3] + T * (B[2] + xv)
    f.work[WorkColumn.yy, to] = place[4] + T * (B[3] + yv)
    f.work[WorkColumn.xu, to] = xu
    f.work[WorkColumn.xv, to] = xv
    f.work[WorkColumn.yu, to] = yu
    f.work[WorkColumn.yv, to] = yv
    f.work[WorkColumn.uu, to] = C[0]
    f.work[WorkColumn.uv, to] = C[1]
    f.work[WorkColumn.vv, to] = C[2]
    f.work[WorkColumn.square, to] = wide(0.0, f.work.width)
    f.work[WorkColumn.volume, to] = wide(1.0, f.work.width)


@func
def keep_depth(f: ti.template(), one: ti.template(), uz, vz, to, T):
    """Write the depth of a group of hypotheses of the columns `one` before and new covariances uz and vz."""
    f.work[WorkColumn.z, to] = one[WorkColumn.z]
    f.work[WorkColumn.zz, to] = one[WorkColumn.zz]
    f.work[WorkColumn.uz, to] = uz
    f.work[WorkColumn.vz, to] = vz
    f.work[WorkColumn.xz, to] = one[WorkColumn.xz] + T * uz
    f.work[WorkColumn.yz, to] = one[WorkColumn.yz] + T * vz


@func
def turn(f: ti.template(), one: ti.template(), arc: ti.template(), to, motion: Motion):
    """Write a group of hypotheses whose velocities turn by angles with the moments `arc`; `one`: columns before."""
    c, s, c2, s2 = arc[0], arc[1], arc[2], arc[3]
    u, v = one[WorkColumn.vx], one[WorkColumn.vy]
    velocity = [c * u - s * v, s * u + c * v]
    # The mean of R S Rᵀ, S the second moment of v: its trace stays, the rest turns by 2θ.
    xx, xy, yy = one[WorkColumn.uu] + u * u, one[WorkColumn.uv] + u * v, one[WorkColumn.vv] + v * v
    half, difference = 0.5 * (xx + yy), 0.5 * (xx - yy)
    stretch, noise = c2 * difference - s2 * xy, motion.walk * motion.walk
    C = [
        ti.max(half + stretch - velocity[0] * velocity[0], 0.0) + noise,
        s2 * difference + c2 * xy - velocity[0] * velocity[1],
        ti.max(half - stretch - velocity[1] * velocity[1], 0.0) + noise,
    ]
    xu, xv, yu, yv = one[WorkColumn.xu], one[WorkColumn.xv], one[WorkColumn.yu], one[WorkColumn.yv]
    B = [c * xu - s * xv, s * xu + c * xv, c * yu - s * yv, s * yu + c * yv]
    place = [one[n] for n in ti.static(PLACE)]
    f.work[WorkColumn.age, to] = wide(0.0, f.work.width)
    go(f, place, velocity, B, C, to, motion.step)
    if ti.static(f.depth_unknown):
        uz, vz = one[WorkColumn.uz], one[WorkColumn.vz]
        keep_depth(f, one, c * uz - s * vz, s * uz + c * vz, to, motion.step)


@func
def turns(f: ti.template(), turning, first, motion: Motion):
    """Begin `TURNS` hypotheses of each of those that turn, from group `first` on, so many of them in a group as fit."""
    middle = 0.5 * (motion.least_turn + motion.greatest_turn)
    less, more = arc_moments(motion.least_turn, middle), arc_moments(middle, motion.greatest_turn)
    left = vec4(1.0, -1.0, 1.0, -1.0)
    each = [less, more, left * less, left * more]
    one = ti.static(f.work.one)
    if ti.static(f.work.width == 1):
        for n in range(turning):
            h = ti.cast(one[WorkColumn.turning, n], ti.i32)
            columns = [one[c, h] for c in ti.static(range(f.columns))]
            for t in ti.static(range(TURNS)):
                turn(f, columns, each[t], first + TURNS * n + t, motion)
                one[WorkColumn.share, first + TURNS * n + t] = one[WorkColumn.turn, h] * columns[0] / TURNS
    else:
        arc = [ti.Vector([each[n % TURNS][m] for n in ti.static(range(LANES))]) for m in ti.static(range(4))]
        for g in range((turning + TOGETHER - 1) // TOGETHER):
            places = [ti.min(TOGETHER * g + n, turning - 1) for n in ti.static(range(TOGETHER))]
            h = [ti.cast(one[WorkColumn.turning, places[n]], ti.i32) for n in ti.static(range(TOGETHER))]
            share = [
                ti.select(TOGETHER * g + n < turning, one[WorkColumn.turn, h[n]] * one[0, h[n]] / TURNS, 0.0)
                for n in ti.static(range(TOGETHER))
            ]
            columns = [
                ti.Vector([one[c, h[n // TURNS]] for n in ti.static(range(LANES))]) for c in ti.static(range(f.columns))
            ]
            turn(f, columns, arc, first + g, motion)
            f.work[WorkColumn.share, first + g] = ti.Vector([share[n // TURNS] for n in ti.static(range(LANES))])


@func
def begin_velocities(f: ti.template(), motion: Motion):
    """Give the hypotheses of the first measurement their velocities."""
    f.head[FilterColumn.fresh] = 0.0
    slowest, fastest = motion.slowest, motion.fastest
    variance = (slowest * slowest + slowest * fastest + fastest * fastest) / 6.0
    age = ti.min(f.head[FilterColumn.elapsed] - 1.0, motion.least_interval)
    for g in range(groups_of(f)):
        f.kept[WorkColumn.age, g] = wide(age, f.kept.width)
        f.kept[WorkColumn.uu, g] = wide(variance, f.kept.width)
        f.kept[WorkColumn.vv, g] = wide(variance, f.kept.width)


@func
def predict(f: ti.template(), motion: Motion):
    """Propagate a filter by a step."""
    head, work = ti.static(f.head, f.work)
    head[FilterColumn.elapsed] = head[FilterColumn.elapsed] + 1.0
    if head[FilterColumn.fresh] > 0.0:
        begin_velocities(f, motion)
    groups = groups_of(f)
    for g in range(groups):
        for c in ti.static(range(f.columns)):
            work[c, g] = f.kept[c, g]
        limit(f, g, motion)
        age = work[WorkColumn.age, g] + 1.0
        work[WorkColumn.age, g] = age
        work[WorkColumn.turn, g] = ti.select(work[WorkColumn.share, g] > 0.0, turn_probability(age, motion), 0.0)
    turning = 0
    for h in range(count_of(f)):
        work.one[WorkColumn.turning, turning] = ti.cast(h, ti.f32)
        turning += ti.cast(work.one[WorkColumn.turn, h] > 0.0, ti.i32)
    for n in range(MOST_TURNING, turning):  # the lightest, for which there is no room
        work.one[WorkColumn.turn, ti.cast(work.one[WorkColumn.turning, n], ti.i32)] = 0.0
    turning = ti.min(turning, MOST_TURNING)
    turns(f, turning, groups, motion)
    noise = motion.walk * motion.walk
    for g in range(groups):
        one = [work[c, g] for c in ti.static(range(f.columns))]
        place, B = [one[n] for n in ti.static(PLACE)], [one[n] for n in ti.static(SLOPES)]
        C = [one[WorkColumn.uu] + noise, one[WorkColumn.uv], one[WorkColumn.vv] + noise]
        work[WorkColumn.share, g] = one[0] * (1.0 - work[WorkColumn.turn, g])
        go(f, place, [one[WorkColumn.vx], one[WorkColumn.vy]], B, C, g, motion.step)
        if ti.static(f.depth_unknown):
            keep_depth(f, one, one[WorkColumn.uz], one[WorkColumn.vz], g, motion.step)
    groups += (turning * TURNS + work.width - 1) // work.width
    head[FilterColumn.count] = ti.cast(groups * work.width, ti.f32)


@func
def carry(f: ti.template(), way: vec2):
    """Move a filter's hypotheses by what the water carries the target, m."""
    for g in range(groups_of(f)):
        for axis in ti.static(range(2)):
            f.work[WorkColumn.x + axis, g] = f.work[WorkColumn.x + axis, g] + way[axis]


@func
def loosen(f: ti.template(), covariance: vec3):
    """Add a covariance (xx, xy, yy), m², to the place of all hypotheses."""
    for g in range(groups_of(f)):
        f.work[WorkColumn.xx, g] = f.work[WorkColumn.xx, g] + covariance[0]
        f.work[WorkColumn.xy, g] = f.work[WorkColumn.xy, g] + covariance[1]
        f.work[WorkColumn.yy, g] = f.work[WorkColumn.yy, g] + covariance[2]


@func
def begin_hypotheses(f: ti.template()):
    """Count the hypotheses of a first measurement, which are `KEPT`; their velocities follow in the next prediction."""
    f.head[FilterColumn.known] = 1.0
    f.head[FilterColumn.fresh] = 1.0
    f.head[FilterColumn.count] = KEPT


@func
def weigh(f: ti.template()):
    """Make shares of all weights of the hypotheses, after what was measured, and forget the lightest.

    Returns:
        logarithm of the likelihood of the measurements over that of ones without error and of the same variances.
    """
    width, work = ti.static(f.work.width, f.work)
    groups = groups_of(f)
    least = wide(1e30, width)
    for g in range(groups):
        least = ti.min(least, ti.select(work[WorkColumn.share, g] > 0.0, work[WorkColumn.square, g], 1e30))
    best = 0.0 - most_of(0.0 - least, width)
    heaviest = wide(0.0, width)
    for g in range(groups):
        weight = exponential(0.5 * (best - work[WorkColumn.square, g]), width) / ti.sqrt(work[WorkColumn.volume, g])
        weight = work[WorkColumn.share, g] * weight
        work[WorkColumn.share, g] = weight
        heaviest = ti.max(heaviest, weight)
    forgotten = FORGOTTEN * most_of(heaviest, width)
    whole = wide(0.0, width)
    for g in range(groups):
        weight = work[WorkColumn.share, g]
        weight = ti.select(weight > forgotten, weight, 0.0)
        work[WorkColumn.share, g] = weight
        whole += weight
    weights = sum_of(whole, width)
    for g in range(groups):
        work[WorkColumn.share, g] = work[WorkColumn.share, g] / weights
    return ti.log(weights) - 0.5 * best


@func
def estimate(f: ti.template(), common: vec3):
    """Write the moments of all hypotheses, with an error that is common to them."""
    width, work, head = ti.static(f.work.width, f.work, f.head)
    x0, y0 = work.one[WorkColumn.x, 0], work.one[WorkColumn.y, 0]
    sums = [wide(0.0, width) for _ in ti.static(range(7))]
    for g in range(groups_of(f)):
        share = work[WorkColumn.share, g]
        dx, dy = work[WorkColumn.x, g] - x0, work[WorkColumn.y, g] - y0
        sums[0] += share * dx
        sums[1] += share * dy
        sums[2] += share * work[WorkColumn.vx, g]
        sums[3] += share * work[WorkColumn.vy, g]
        sums[4] += share * (work[WorkColumn.xx, g] + dx * dx)
        sums[5] += share * (work[WorkColumn.xy, g] + dx * dy)
        sums[6] += share * (work[WorkColumn.yy, g] + dy * dy)
    mean = [sum_of(sums[n], width) for n in ti.static(range(7))]
    head[FilterColumn.x] = x0 + mean[0]
    head[FilterColumn.y] = y0 + mean[1]
    head[FilterColumn.vx] = mean[2]
    head[FilterColumn.vy] = mean[3]
    head[FilterColumn.xx] = mean[4] - mean[0] * mean[0] + common[0]
    head[FilterColumn.xy] = mean[5] - mean[0] * mean[1] + common[1]
    head[FilterColumn.yy] = mean[6] - mean[1] * mean[1] + common[2]


@func
def finish(f: ti.template(), common: vec3):
    """End a step: write the estimate and reduce the hypotheses.

    Args:
        common: covariance (xx, xy, yy) of an error of all hypotheses' places that is not in theirs, m².
    """
    head = ti.static(f.head)
    if head[FilterColumn.count] > 0.0:
        surprise = ti.max(head[FilterColumn.surprise] - weigh(f), 0.0)
        estimate(f, common)
        if surprise > LOST:
            surprise = 0.0
            head[FilterColumn.count] = 0.0
        else:
            mixture.reduce(f, groups_of(f))
        head[FilterColumn.surprise] = surprise
