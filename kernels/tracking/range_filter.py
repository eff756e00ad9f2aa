"""An AUV's filter of a moving target from ranges: a mixture of Gaussian hypotheses.

The target keeps its speed, within known limits, and turns at random: by an angle of either sign, after a number of
steps since the last turn, both uniform between limits. Between turns its velocity walks a little. Over a step T, the
velocity v turned by θ,

    v ← R(θ) v + w,   x ← x + T v,   w ~ N(0, q² I),   range = |x − o| + n,   n ~ N(0, σ²),

o the place of the observer, itself known with a covariance, of which the part along the line of sight adds to σ².

One mechanism does both that a range only tells of a ring and that a turn shows later: a hypothesis is a Gaussian with
a weight. The first range begins `KEPT` of them round the ring. In a step each moves on straight, and the heaviest of
those that can turn also begin hypotheses of a turn, one for each quarter of the angles (left and right, less and more);
mean and covariance of R(θ) v over a quarter are exact, by the moments of cos θ and cos 2θ. Where there is no room left,
a hypothesis moves with the moments over turning and not turning. A range updates each by an extended Kalman filter of
second order in the direction across the line of sight,

    ẑ = √(d² + P_⊥),   S = (d/ẑ)² P_∥ + R + ½ (P_⊥/ẑ)²,

d the distance of the mean, P_∥ and P_⊥ the variance along and across the line of sight. At the end of a step light
hypotheses merge into heavy ones that they resemble, by their moments, and the lightest are forgotten.

A speed less well known than by its limits is taken as measured, with the variance after which it is as well known. The
time of the last turn counts, since it says when the next one can come: each hypothesis has it.

A filter that follows a mirror image does not notice by its covariance. The logarithm of the likelihood of each range,
over that of one without error and of the same variance, is on average −½ ln(S/R) − ½; where it is below −`USUAL` for
several, and the sum of what is missing exceeds `LOST`, the filter begins anew with the next range, until which the
estimate stays.

A mission calls, for each filter and step, `predict`, `observe_range` for each range that arrives, and `finish`.

Sources: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), §10.3
(second-order filter), §11.6 (several models); Salmond, "Mixture reduction algorithms for point and extended object
tracking in clutter", IEEE Trans. AES 45 (2009), doi 10.1109/TAES.2009.5089549.
"""

import math

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.tracking import mixture
from usvauv.kernels.tracking.hypotheses import (
    CAPACITY,
    COLUMNS,
    KEPT,
    FilterColumn,
    Hypothesis,
    HypothesisColumn,
    corrected,
    count_of,
    load,
    place_of,
    seen_at,
    store,
)
from usvauv.kernels.trigonometry import circle
from usvauv.kernels.types import mat2, vec2, vec3, vec4

TURNS = 4  # hypotheses that one begins by turning
USUAL = 2.5  # of a range's logarithmic likelihood, see above
LOST = 8.0
FIRST_WEIGHT = -math.log(KEPT)
LIKELIEST_TURN = 0.5  # greatest probability of a turn in a step
LEAST_SPEED_VARIANCE = 1e-4  # m²/s²
FORGOTTEN = -8.0  # logarithm of a weight, over the heaviest


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
    """Begin a filter that knows nothing."""
    for c in range(COLUMNS):
        filters[w, k, i, c] = 0.0


@func
def arc_moments(first, last) -> vec4:
    """Means of cos θ, sin θ, cos 2θ and sin 2θ over angles from `first` to `last`, rad."""
    c0, s0 = circle(first)
    c1, s1 = circle(last)
    width = 1.0 / (last - first)
    return width * vec4(s1 - s0, c0 - c1, s1 * c1 - s0 * c0, c0 * c0 - c1 * c1)


@func
def turned(one: Hypothesis, arc: vec4, motion: Motion) -> Hypothesis:
    """A hypothesis after a step in which the velocity turns by an angle with the moments `arc`, then moves it."""
    T = motion.step
    R = mat2([[arc[0], -arc[1]], [arc[1], arc[0]]])
    velocity = R @ one.velocity
    # The mean of R S Rᵀ, S the second moment of v: its trace stays, the rest turns by 2θ.
    u, v = one.velocity[0], one.velocity[1]
    xx, xy, yy = one.C[0, 0] + u * u, one.C[0, 1] + u * v, one.C[1, 1] + v * v
    half, difference = 0.5 * (xx + yy), 0.5 * (xx - yy)
    stretch = arc[2] * difference - arc[3] * xy
    shear = arc[3] * difference + arc[2] * xy - velocity[0] * velocity[1]
    noise = motion.walk * motion.walk
    C = mat2(
        [
            [ti.max(half + stretch - velocity[0] * velocity[0], 0.0) + noise, shear],
            [shear, ti.max(half - stretch - velocity[1] * velocity[1], 0.0) + noise],
        ]
    )
    B = one.B @ R.transpose()
    return Hypothesis(
        weight=one.weight,
        age=one.age,
        position=one.position + T * velocity,
        velocity=velocity,
        A=one.A + T * (B + B.transpose()) + T * T * C,
        B=B + T * C,
        C=C,
    )


@func
def limited(one: Hypothesis, motion: Motion) -> Hypothesis:
    """A hypothesis whose speed is at least as well known as by its limits."""
    result = one
    squared = one.velocity.dot(one.velocity)
    trace = one.C[0, 0] + one.C[1, 1]
    if squared > trace:
        speed = ti.sqrt(squared)
        u = one.velocity / speed
        cross = one.B @ u
        own = one.C @ u
        along = u.dot(own)
        width = motion.fastest - motion.slowest
        least = ti.max(width * width / 12.0, LEAST_SPEED_VARIANCE)
        if along > least:
            # A reading of the variance r = least·along/(along − least): gain 1/(along + r) is this.
            gain = (along - least) / (along * along)
            innovation = 0.5 * (motion.slowest + motion.fastest) - speed - 0.5 * (trace - along) / speed
            result.position = one.position + gain * innovation * cross
            result.velocity = one.velocity + gain * innovation * own
            result.A = one.A - gain * cross.outer_product(cross)
            result.B = one.B - gain * cross.outer_product(own)
            result.C = one.C - gain * own.outer_product(own)
    return result


@func
def turn_probability(age, motion: Motion):
    """Probability of a turn in a step that ends `age` steps after the last turn."""
    probability = 0.0
    if age > motion.least_interval - 0.5:
        probability = ti.min(LIKELIEST_TURN, 1.0 / ti.max(motion.greatest_interval + 1.0 - age, 1.0))
    return probability


@func
def predict(filters: ti.template(), w, k, i, motion: Motion):
    """Propagate a filter by a step."""
    filters[w, k, i, FilterColumn.elapsed] = filters[w, k, i, FilterColumn.elapsed] + 1.0
    if filters[w, k, i, FilterColumn.fresh] > 0.0:
        filters[w, k, i, FilterColumn.fresh] = 0.0
        slowest, fastest = motion.slowest, motion.fastest
        variance = (slowest * slowest + slowest * fastest + fastest * fastest) / 6.0
        age = ti.min(filters[w, k, i, FilterColumn.elapsed] - 1.0, motion.least_interval)
        for h in range(KEPT):
            filters[w, k, i, place_of(h, HypothesisColumn.age)] = age
            filters[w, k, i, place_of(h, HypothesisColumn.uu)] = variance
            filters[w, k, i, place_of(h, HypothesisColumn.vv)] = variance
    middle = 0.5 * (motion.least_turn + motion.greatest_turn)
    less = arc_moments(motion.least_turn, middle)
    more = arc_moments(middle, motion.greatest_turn)
    both = 0.5 * (less + more)
    count = count_of(filters, w, k, i)
    used = count
    for h in range(count):
        one = limited(load(filters, w, k, i, h), motion)
        probability = turn_probability(one.age + 1.0, motion)
        stay = vec4(1.0, 0.0, 1.0, 0.0)
        weight, age = one.weight, one.age + 1.0
        if probability > 0.0:
            if used + TURNS <= CAPACITY:
                one.age = 0.0
                one.weight = weight + ti.log(probability / TURNS)
                for side in ti.static((1.0, -1.0)):
                    sides = vec4(1.0, side, 1.0, side)
                    store(filters, w, k, i, used, turned(one, sides * less, motion))
                    store(filters, w, k, i, used + 1, turned(one, sides * more, motion))
                    used += 2
                weight += ti.log(1.0 - probability)
            else:
                stay = (1.0 - probability) * stay + probability * vec4(both[0], 0.0, both[2], 0.0)
                age *= 1.0 - probability
        one.weight = weight
        one.age = age
        store(filters, w, k, i, h, turned(one, stay, motion))
    filters[w, k, i, FilterColumn.count] = used


@func
def carry(filters: ti.template(), w, k, i, way: vec2):
    """Move a filter's hypotheses by what the water carries the target, m."""
    for h in range(count_of(filters, w, k, i)):
        for axis in ti.static(range(2)):
            n = place_of(h, ti.static(HypothesisColumn.x + axis))
            filters[w, k, i, n] = filters[w, k, i, n] + way[axis]


@func
def begin_ring(filters: ti.template(), w, k, i, place: vec2, covariance: vec3, distance, variance):
    """Begin hypotheses round the ring of the first range; their velocities follow in the next prediction."""
    filters[w, k, i, FilterColumn.known] = 1.0
    filters[w, k, i, FilterColumn.fresh] = 1.0
    filters[w, k, i, FilterColumn.count] = KEPT
    radius = ti.max(distance, 0.0)
    half = math.pi / KEPT * radius
    across = ti.max(half * half, variance)
    for h in range(KEPT):
        c, s = circle(2.0 * math.pi / KEPT * ti.cast(h, ti.f32))
        one = seen_at(FIRST_WEIGHT, place, covariance, vec2(c, s), radius, variance, across)
        store(filters, w, k, i, h, one)


@func
def updated(one: Hypothesis, place: vec2, covariance: vec3, distance, variance) -> Hypothesis:
    """A hypothesis after a range."""
    line = one.position - place
    squared = line.dot(line)
    away = ti.sqrt(squared) + 1e-6
    u = line / away
    toward = one.A @ u
    along = u.dot(toward)
    across = ti.max(one.A[0, 0] + one.A[1, 1] - along, 0.0)
    expected = ti.sqrt(squared + across)
    share = away / expected
    bend = across / expected
    own = u[0] * u[0] * covariance[0] + 2.0 * u[0] * u[1] * covariance[1] + u[1] * u[1] * covariance[2]
    S = share * share * along + variance + own + 0.5 * bend * bend
    cross = share * toward
    turning = share * (one.B.transpose() @ u)
    return corrected(one, cross, turning, distance - expected, S, variance)


@func
def observe_range(filters: ti.template(), w, k, i, place: vec2, covariance: vec3, distance, variance):
    """Update a filter by a range.

    Args:
        filters: (W, K, M, COLUMNS) float32; `w`, `k` and `i` select the filter.
        place: of the observer, m.
        covariance: of that, (xx, xy, yy), m²; 0 where it is exact.
        distance: measured, horizontally, m.
        variance: of its error, m², above 0.
    """
    if filters[w, k, i, FilterColumn.count] == 0.0:
        begin_ring(filters, w, k, i, place, covariance, distance, variance)
    else:
        filters[w, k, i, FilterColumn.surprise] = filters[w, k, i, FilterColumn.surprise] - USUAL
        for h in range(count_of(filters, w, k, i)):
            one = load(filters, w, k, i, h)
            store(filters, w, k, i, h, updated(one, place, covariance, distance, variance))


@func
def estimate(filters: ti.template(), w, k, i):
    """Normalise the weights, forget the lightest hypotheses, and write the moments of all."""
    count = count_of(filters, w, k, i)
    heaviest = -1e30
    for h in range(count):
        heaviest = ti.max(heaviest, filters[w, k, i, place_of(h, HypothesisColumn.weight)])
    total = 0.0
    mean = vec4(0.0)
    second = vec3(0.0)
    x0 = filters[w, k, i, place_of(0, HypothesisColumn.x)]
    y0 = filters[w, k, i, place_of(0, HypothesisColumn.y)]
    left = 0
    for h in range(count):
        weight = filters[w, k, i, place_of(h, HypothesisColumn.weight)] - heaviest
        if weight > FORGOTTEN:
            one = load(filters, w, k, i, h)
            one.weight = ti.exp(weight)
            dx, dy = one.position[0] - x0, one.position[1] - y0
            total += one.weight
            mean += one.weight * vec4(dx, dy, one.velocity[0], one.velocity[1])
            second += one.weight * vec3(one.A[0, 0] + dx * dx, one.A[0, 1] + dx * dy, one.A[1, 1] + dy * dy)
            store(filters, w, k, i, left, one)
            left += 1
    surprise = filters[w, k, i, FilterColumn.surprise] - heaviest - ti.log(total)
    filters[w, k, i, FilterColumn.surprise] = ti.max(surprise, 0.0)
    mean /= total
    second /= total
    filters[w, k, i, FilterColumn.x] = x0 + mean[0]
    filters[w, k, i, FilterColumn.y] = y0 + mean[1]
    filters[w, k, i, FilterColumn.vx] = mean[2]
    filters[w, k, i, FilterColumn.vy] = mean[3]
    filters[w, k, i, FilterColumn.xx] = second[0] - mean[0] * mean[0]
    filters[w, k, i, FilterColumn.xy] = second[1] - mean[0] * mean[1]
    filters[w, k, i, FilterColumn.yy] = second[2] - mean[1] * mean[1]
    for h in range(left):
        n = place_of(h, HypothesisColumn.weight)
        filters[w, k, i, n] = filters[w, k, i, n] / total
    filters[w, k, i, FilterColumn.count] = left


@func
def finish(filters: ti.template(), w, k, i):
    """End a step: write the estimate and reduce the hypotheses."""
    if filters[w, k, i, FilterColumn.count] > 0.0:
        estimate(filters, w, k, i)
        if filters[w, k, i, FilterColumn.surprise] > LOST:
            filters[w, k, i, FilterColumn.count] = 0.0
            filters[w, k, i, FilterColumn.surprise] = 0.0
        else:
            mixture.reduce(filters, w, k, i)
