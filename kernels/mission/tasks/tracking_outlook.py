"""What the rudders that an AUV of `tracking-plain` may take next are worth for each target: an observation term.

With its last rudder, or the neighbour to either side, kept for some intervals, an AUV comes to places from which ranges
are measured. Those of all AUVs, the others taken to keep their rudders, leave of each target the covariance P,

    P ← P + q² I,   P⁻¹ ← P⁻¹ + Σ p uu′/σ²,

as in the heuristic `tree` (`usvauv.policies.heuristics.tracking`). Vectors are along the AUV's course and to the left
of it. The numbers of a target are the same whatever its place among the others, and do not depend on how many there are
of targets and AUVs.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs.motion import target_of
from usvauv.kernels.mission.observation import ObservationTerm, observation_terms
from usvauv.kernels.mission.tasks.tracking_places import believed_place
from usvauv.kernels.types import vec2, vec3

MOST = 2  # rudders to either side
TURN = -6.052 * 0.12  # rad in an interval by a rudder
INTERVALS = 3  # that rudders are kept
UNFORESEEN = 0.3  # share of its speed by which a target's velocity is uncertain
EDGE = 25.0  # m, over which a range becomes unlikely at the largest one
NEAR, FAR, OTHERS = 60.0, 100.0, 30.0  # m, scales of distances to targets, and to the nearest other AUV
DEVIATION = 10.0  # m, unit of deviations
WORTH = 5.0  # m, most that a rudder is counted for one target
BOUND = 6.0  # of each number
STEPS = 0, -1, 1  # from the last rudder, by `SIDES`; to the left rudders are negative
SIDES = "last rudder", "next to the left", "next to the right"
OWN = (
    *(f"1 if the last rudder is number {number} from the left" for number in range(-MOST, MOST + 1)),
    *(f"direction of the nearest other AUV, {way}, less the farther" for way in ("ahead", "left")),
    *(
        f"what the {side} lowers deviations {when}, m, sum over targets"
        for when in ("after an interval", f"in the mean of {INTERVALS}")
        for side in SIDES[1:]
    ),
)
EACH = (
    *("direction, ahead", "left", f"distance d/(d + {NEAR:g} m)", f"place, ahead, {FAR:g} m", "left"),
    *("velocity, ahead, over the AUVs' speed", "left"),
    f"logarithm of the deviation, {DEVIATION:g} m",
    *("difference of variances ahead and to the left, over their sum", "twice the covariance over it"),
    *(
        f"{number} of the information by the others' ranges {when}"
        for when in ("of the next interval", f"of {INTERVALS}")
        for number in ("logarithm of 1 and half the trace", "difference over the trace", "twice that off the diagonal")
    ),
    *("1 if the AUV follows it", "1 if it is known"),
    *(f"logarithm of the deviation {when} by the last rudder" for when in ("after an interval", f"of {INTERVALS}")),
    *(
        f"how much less it is {when} by the {side}, m"
        for when in ("after an interval", f"in the mean of {INTERVALS}")
        for side in SIDES[1:]
    ),
)


@func
def information(worlds: ti.template(), away: vec2, height) -> vec3:
    """Expected information xx, xy, yy of a range along `away`, 1/m²."""
    given = ti.static(worlds.task_parameters)
    square = ti.max(away.norm_sqr(), 1.0)
    slant_square = square + height * height
    measured = (1.0 - given.range_loss) / (1.0 + ti.exp((ti.sqrt(slant_square) - given.range_most) / EDGE))
    share = measured / (given.range_noise * given.range_noise * slant_square)
    return share * vec3(away[0] * away[0], away[0] * away[1], away[1] * away[1])


@func
def unit_vector(angle) -> vec2:
    """Unit vector at an angle from the first axis."""
    return vec2(ti.cos(angle), ti.sin(angle))


@func
def turned(vector: vec2, by: vec2) -> vec2:
    """A vector turned to the left by the angle of a unit vector."""
    return vec2(vector[0] * by[0] - vector[1] * by[1], vector[1] * by[0] + vector[0] * by[1])


@func
def along(vector: vec2, course: vec2) -> vec2:
    """A vector's components along a course and to the left of it."""
    return turned(vector, vec2(course[0], 0.0 - course[1]))


@func
def turned_matrix(J: vec3, course: vec2) -> vec3:
    """A symmetric matrix xx, xy, yy along a course and to the left of it."""
    c, s = course[0], course[1]
    xx = c * c * J[0] + 2.0 * c * s * J[1] + s * s * J[2]
    return vec3(xx, c * s * (J[2] - J[0]) + (c * c - s * s) * J[1], J[0] + J[2] - xx)


@func
def left_by(P: vec3, walk, J: vec3) -> vec3:
    """Covariance xx, xy, yy after an interval with information J, m²."""
    xx, yy = P[0] + walk, P[2] + walk
    whole = ti.max(xx * yy - P[1] * P[1], 1e-6)
    a, b, c = yy / whole + J[0], J[1] - P[1] / whole, xx / whole + J[2]
    whole = ti.max(a * c - b * b, 1e-12)
    return vec3(c, 0.0 - b, a) / whole


@func
def write(worlds: ti.template(), w, k, at, number):
    """Write a number of the observation, within bounds."""
    worlds.observation[w, k, at] = ti.min(ti.max(number, 0.0 - BOUND), BOUND)


@func
def deviation(P: vec3):
    """√(P_xx + P_yy), m."""
    return ti.sqrt(ti.max(P[0] + P[2], 1e-3))


@func
def shape_of(J: vec3, spread, course: vec2) -> vec3:
    """Amount of information J beside a covariance of the trace `spread`, and its shape along a course."""
    own, trace = turned_matrix(J, course), J[0] + J[2]
    share = 1.0 / (trace + 1e-9)
    return vec3(ti.log(1.0 + 0.5 * trace * spread), (own[0] - own[2]) * share, 2.0 * own[1] * share)


@func
def describe(worlds: ti.template(), w, k, i, first):
    """Write the numbers of target i for AUV k, `EACH`; returns what its rudders are worth, as in `OWN`, m."""
    p, given = ti.static(worlds.p, worlds.task_parameters)
    helm, pair = ti.static(worlds.task_auv, worlds.task_pair)
    reach, height = p.speed_max * given.interval, 0.5 * (given.depth_least + given.depth_most) - p.cruise
    walk = (UNFORESEEN * given.target_speed_most * given.interval) ** 2
    course, here = unit_vector(helm.course[w, k]), believed_place(worlds, w, k)
    place, drift = vec2(pair.x[w, k, i], pair.y[w, k, i]), vec2(pair.vx[w, k, i], pair.vy[w, k, i])
    P = vec3(pair.xx[w, k, i], pair.xy[w, k, i], pair.yy[w, k, i])
    soon, all_of = vec3(0.0), vec3(0.0)  # information of the others' ranges in the next interval, and in all
    known = ti.Matrix([[0.0] * 3 for _ in range(INTERVALS)])
    for j in range(worlds.auv.shape[1]):
        if j != k:
            heading, by = unit_vector(helm.course[w, j]), unit_vector(TURN * helm.rudder[w, j])
            away = place - believed_place(worlds, w, j)
            for n in ti.static(range(INTERVALS)):
                heading = turned(heading, by)
                away += given.interval * drift - reach * heading
                J = information(worlds, away, height)
                for c in ti.static(range(3)):
                    known[n, c] += J[c]
    for n in ti.static(range(INTERVALS)):
        J = vec3(known[n, 0], known[n, 1], known[n, 2])
        if ti.static(n == 0):
            soon = J
        all_of += J
    after, mean = vec3(0.0), vec3(0.0)  # deviation after an interval and in the mean of all, by `SIDES`
    for side in ti.static(range(3)):
        rudder = helm.rudder[w, k] + ti.static(STEPS[side])
        by = unit_vector(TURN * ti.min(ti.max(rudder, -MOST), MOST))
        heading, away, Q = course, place - here, P
        for n in ti.static(range(INTERVALS)):
            heading = turned(heading, by)
            away += given.interval * drift - reach * heading
            J = information(worlds, away, height) + vec3(known[n, 0], known[n, 1], known[n, 2])
            Q = left_by(Q, walk, J)
            if ti.static(n == 0):
                after[side] = deviation(Q)
            mean[side] += deviation(Q) / INTERVALS
    worth = ti.Vector([after[0] - after[1], after[0] - after[2], mean[0] - mean[1], mean[0] - mean[2]])
    way, velocity = along(place - here, course), along(drift, course) / p.speed_max
    distance, spread = way.norm(), ti.max(P[0] + P[2], 1e-3)
    own, next_one, three = turned_matrix(P, course), shape_of(soon, spread, course), shape_of(all_of, spread, course)
    for n in ti.static(range(4)):
        worth[n] = ti.min(ti.max(worth[n], -WORTH), WORTH)
    follows = ti.select(target_of(worlds, w, k) == i, 1.0, 0.0)
    ahead, left = ti.max(ti.min(way[0] / FAR, 3.0), -3.0), ti.max(ti.min(way[1] / FAR, 3.0), -3.0)
    logarithms = [ti.log(each / DEVIATION) for each in ti.static((ti.sqrt(0.5 * spread), after[0], mean[0]))]
    # fmt: off
    numbers = [
        way[0] / (distance + 1.0), way[1] / (distance + 1.0), distance / (distance + NEAR), ahead, left,
        velocity[0], velocity[1], logarithms[0], (own[0] - own[2]) / spread, 2.0 * own[1] / spread,
        next_one[0], next_one[1], next_one[2], three[0], three[1], three[2],
        follows, pair.known[w, k, i], logarithms[1], logarithms[2], worth[0], worth[1], worth[2], worth[3],
    ]
    # fmt: on
    for n in ti.static(range(len(numbers))):
        write(worlds, w, k, first + n, numbers[n])
    return worth


@func
def observe(worlds: ti.template(), w, k, first):
    """What AUV k sees of all targets: `OWN`, `EACH` of its own target, and `EACH` of every one."""
    helm = ti.static(worlds.task_auv)
    rudder = ti.cast(helm.rudder[w, k], ti.i32)
    for n in ti.static(range(2 * MOST + 1)):
        write(worlds, w, k, first + n, ti.select(rudder == n - MOST, 1.0, 0.0))
    here, nearest = believed_place(worlds, w, k), vec2(1e6, 0.0)
    for j in range(worlds.auv.shape[1]):
        way = believed_place(worlds, w, j) - here
        if j != k and way.norm() < nearest.norm():
            nearest = way
    nearest = along(nearest, unit_vector(helm.course[w, k]))
    nearest *= ti.exp(0.0 - nearest.norm() / OTHERS) / (nearest.norm() + 1.0)
    for axis in ti.static(range(2)):
        write(worlds, w, k, first + 2 * MOST + 1 + axis, nearest[axis])
    start, size = first + ti.static(len(OWN)), ti.static(len(EACH))
    worth = ti.Vector([0.0, 0.0, 0.0, 0.0])
    for i in range(worlds.node.shape[1]):
        worth += describe(worlds, w, k, i, start + size * (1 + i))
    for n in ti.static(range(4)):
        write(worlds, w, k, start - 4 + n, worth[n])
    for n in range(size):
        own = worlds.observation[w, k, start + size * (1 + target_of(worlds, w, k)) + n]
        worlds.observation[w, k, start + n] = own


observation_terms.register(
    "outlook",
    ObservationTerm(
        observe,
        lambda num_auvs: [*OWN, *(f"of its own target: {text}" for text in EACH)],
        "1",
        -BOUND,
        BOUND,
        of_each_node=EACH,
    ),
)
