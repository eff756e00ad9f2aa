"""The task of tracking: AUVs follow moving targets by the sound these send, not knowing exactly where they are either.

**Targets** carry a transmitter. Each moves at a constant speed on a course that changes by a random walk and, at random
times, by a turn. It may drift with the water at the AUVs' cruise depth, and turn away from an AUV that comes near.

**Measurements** are those of `tracking_measurements`; AUVs send them to one another, and boats that listen to AUVs.

**Estimates.** Each AUV has a filter of each target, `usvauv.kernels.tracking`, updated by the measurements it has, each
from where the AUV that made it takes itself to be, whose error lasts from one measurement to the next
(`tracking_places`). Filters estimate the targets' depths, of which they know the limits (`depths_known`: the depth
itself). Where targets drift, the filter's velocity is that through the
water, which is taken to flow as at the AUV, with a random walk for what differs. The team's estimate of a target is
that of the AUV whose range, measured last, is the smallest; without ranges that of the AUV which heard it last and
takes it to be nearest.

**Assignment.** AUV by AUV, each follows the target with the fewest followers, and of those the nearest by its own
estimate; it changes only for one nearer by `HYSTERESIS`. With fewer AUVs than targets a metre of the deviation of its
estimate of a target outweighs `uncertainty_weight` metres of way, so that it goes from one target to another.
"""

import math
from typing import Any

import taichi as ti

from usvauv.kernels.flow import current
from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs.motion import target_of, travel
from usvauv.kernels.mission.columns import Draw
from usvauv.kernels.mission.draws import normals, uniforms
from usvauv.kernels.mission.observation import ObservationTerm, observation_terms
from usvauv.kernels.mission.tasks import rewards, tracking_places
from usvauv.kernels.mission.tasks.task import SHIPPED, RewardTerm, Task, tasks
from usvauv.kernels.mission.tasks.tracking_columns import BoatHearingColumn, TargetColumn, UncertainPairColumn
from usvauv.kernels.mission.tasks.tracking_measurements import (
    measure,
    note,
    observers,
    senders,
    take_channel,
    use_measurements,
)
from usvauv.kernels.mission.tasks.tracking_numbers import PARAMETERS, WEIGHTS
from usvauv.kernels.mission.tasks.tracking_places import believed_place
from usvauv.kernels.mission.worlds import WORLDS_PER_BLOCK, Worlds
from usvauv.kernels.tracking import range_filter
from usvauv.kernels.tracking.hypotheses import (
    ROOM,
    Filter,
    filter_of,
)
from usvauv.kernels.transcendental import TWO_PI, wrapped
from usvauv.kernels.types import Level, vec2, vec3

HYSTERESIS = 30.0  # m
COVERED = 150.0  # m, from an AUV to a target that is covered
PRECISE, USELESS = 10.0, 50.0  # m, errors between which the reward falls from 1 to 0
LOST = 3.0  # deviations over `USELESS`, above which a target is lost
NEVER = 1e8  # s
PLACINGS = 64  # attempts to place a target apart from the others
SPREAD = 100.0  # m, unit of an estimate's deviation in an observation
HALF = math.sqrt(0.5)
FOLLOWERS = 1e5  # m, that a follower of a target counts for another one


def depth_unknown(worlds: Worlds) -> bool:
    """Whether filters estimate depths; called while the kernel is compiled."""
    return worlds.program.task.pair_columns is UncertainPairColumn


@func
def depth_limits(worlds: ti.template(), w, i) -> vec2:
    """Limits between which target i is known to be, m."""
    found = vec2(worlds.task_node.depth[w, i])
    if ti.static(depth_unknown(worlds)):
        if worlds.task_parameters.depths_known == 0.0:
            found = vec2(worlds.task_parameters.depth_least, worlds.task_parameters.depth_most)
    return found


def pair_filter(worlds: Worlds, w: Any, k: Any, i: Any, depths: Any) -> Filter:
    """AUV k's filter of target i of world w, between limits of its depth; called while the kernel is compiled."""
    place = w // WORLDS_PER_BLOCK if worlds.program.in_lanes else w
    in_lanes, at = not worlds.program.in_threads, (w, k, i)
    unknown = depth_unknown(worlds)
    return filter_of(worlds.task_pair, worlds.pair_rows, worlds.room, at, place, in_lanes, unknown, depths)


@func
def place_target(worlds: ti.template(), w, i):
    """Put target i at a random place apart from the AUVs and the targets before it, on a random course."""
    p, given = ti.static(worlds.p, worlds.task_parameters)
    node, target = ti.static(worlds.node, worlds.task_node)
    searching, attempt = True, 0
    while searching:
        u = uniforms(worlds, w, Draw.node, PLACINGS * i + attempt)
        node.x[w, i] = p.node_margin + u[0] * (p.width - 2 * p.node_margin)
        node.y[w, i] = p.node_margin + u[1] * (p.length - 2 * p.node_margin)
        here = vec2(node.x[w, i], node.y[w, i])
        attempt += 1
        searching = attempt < PLACINGS and nearest(worlds, w, here, i) < p.start_separation
    u = uniforms(worlds, w, Draw.target, i)
    for c in ti.static(range(len(TargetColumn.names))):
        target[w, i, c] = 0.0
    target.course[w, i] = TWO_PI * (u[0] - 0.5)
    target.speed[w, i] = given.target_speed_least + u[1] * (given.target_speed_most - given.target_speed_least)
    target.depth[w, i] = given.depth_least + u[2] * (given.depth_most - given.depth_least)
    target.turn_at[w, i] = time_of_turn(worlds, 0.0, u[3])
    target.by[w, i] = -1.0
    first = i % worlds.auv.shape[1]  # the AUV that is to follow it
    target.estimate_x[w, i] = worlds.auv.x[w, first]
    target.estimate_y[w, i] = worlds.auv.y[w, first]


@func
def nearest(worlds: ti.template(), w, here: vec2, targets):
    """Distance from a place to the nearest AUV or target before number `targets`, m."""
    least = worlds.p.diagonal
    for k in range(worlds.auv.shape[1]):
        least = ti.min(least, (vec2(worlds.auv.x[w, k], worlds.auv.y[w, k]) - here).norm())
    for i in range(targets):
        least = ti.min(least, (vec2(worlds.node.x[w, i], worlds.node.y[w, i]) - here).norm())
    return least


@func
def time_of_turn(worlds: ti.template(), now, u):
    """Time of the turn after `now`, s, by a number u in (0, 1)."""
    given = ti.static(worlds.task_parameters)
    found = NEVER
    if given.turn_after_most > 0.0:
        found = now + given.turn_after_least + u * (given.turn_after_most - given.turn_after_least)
    return found


@func
def place(worlds: ti.template(), w):
    """Nodes have no data. Targets are placed with the first AUV's assignment, apart from AUVs that are in place."""
    for i in range(worlds.node.shape[1]):
        for c in range(worlds.node.shape[2]):
            worlds.node[w, i, c] = 0.0


@func
def assign(worlds: ti.template(), w, k):
    """Place the targets with AUV 0; nothing is known of them yet. AUV k begins with the target of its number."""
    if k == 0:
        for i in range(worlds.node.shape[1]):
            place_target(worlds, w, i)
            for j in range(observers(worlds)):
                note(worlds, w, j, i, vec3(0.0))
    worlds.auv.target[w, k] = ti.cast(k % worlds.node.shape[1], ti.f32)
    for i in range(worlds.node.shape[1]):
        range_filter.begin(worlds.task_pair, w, k, i)


@func
def move(worlds: ti.template(), w, k, a0, a1):
    """One step of AUV k."""
    travel(worlds, w, k, a0, a1)
    worlds.auv.closed[w, k] = 0.0


@func
def move_target(worlds: ti.template(), w, i):
    """One step of target i; at the border it turns back inside."""
    p, given = ti.static(worlds.p, worlds.task_parameters)
    node, target = ti.static(worlds.node, worlds.task_node)
    here = vec2(node.x[w, i], node.y[w, i])
    now = p.step * worlds.clock[w, 1]
    noise, u = normals(worlds, w, Draw.target, i), uniforms(worlds, w, Draw.turn, i)
    course = target.course[w, i] + given.course_walk * ti.sqrt(p.step) * noise[0]
    if now >= target.turn_at[w, i]:
        turn = given.turn_least + u[0] * (given.turn_most - given.turn_least)
        course += ti.select(u[1] < 0.5, turn, -turn)
        target.turn_at[w, i] = time_of_turn(worlds, now, u[2])
    for k in range(worlds.auv.shape[1]):
        away = here - vec2(worlds.auv.x[w, k], worlds.auv.y[w, k])
        if away.norm() < given.evade_range and away.norm() > 0.0:
            course = ti.atan2(away[1], away[0])
    velocity = target.speed[w, i] * vec2(ti.cos(course), ti.sin(course))
    if given.drifts > 0.0:
        velocity += current.velocity(worlds.water, Level.cruise, w, here[0], here[1])
    there = here + p.step * velocity
    inside = vec2(ti.min(ti.max(there[0], 0.0), p.width), ti.min(ti.max(there[1], 0.0), p.length))
    if inside[0] != there[0] or inside[1] != there[1]:
        course = ti.atan2(0.5 * p.length - here[1], 0.5 * p.width - here[0])
    node.x[w, i] = inside[0]
    node.y[w, i] = inside[1]
    target.course[w, i] = wrapped(course)


@func
def share_estimate(worlds: ti.template(), w, i):
    """The team's estimate of target i: of the AUV nearest to it of those that heard it, else of the last one."""
    target, pair = ti.static(worlds.task_node, worlds.task_pair)
    least = 1e9
    for k in range(worlds.auv.shape[1]):
        if pair.heard[w, k, i] > 0.0:
            distance = pair.measured[w, k, i]
            if worlds.task_parameters.ranges == 0.0:
                distance = (vec2(pair.x[w, k, i], pair.y[w, k, i]) - believed_place(worlds, w, k)).norm()
            if distance < least:
                least = distance
                target.by[w, i] = ti.cast(k, ti.f32)
                target.known[w, i] = 1.0
    k = ti.max(ti.cast(target.by[w, i], ti.i32), 0)
    x, y = pair.x[w, k, i], pair.y[w, k, i]
    if target.known[w, i] == 0.0:
        here = believed_place(worlds, w, k)
        x, y = here[0], here[1]
    target.estimate_x[w, i] = x
    target.estimate_y[w, i] = y
    target.covariance_xx[w, i] = pair.xx[w, k, i]
    target.covariance_xy[w, i] = pair.xy[w, k, i]
    target.covariance_yy[w, i] = pair.yy[w, k, i]
    here = vec2(worlds.node.x[w, i], worlds.node.y[w, i])
    target.error[w, i] = (vec2(x, y) - here).norm()
    target.distance[w, i] = nearest(worlds, w, here, 0)


@func
def assumed(worlds: ti.template()):
    """What filters assume of a target: what is true, but for evasion."""
    p, given = ti.static(worlds.p, worlds.task_parameters)
    least, greatest = NEVER, NEVER
    if given.turn_after_most > 0.0:
        least = ti.floor(given.turn_after_least / p.step) + 1.0
        greatest = ti.ceil(given.turn_after_most / p.step)
    # A course that walks moves the velocity across the way only, as much as half of the variance in both axes does.
    walk = vec2(HALF * given.target_speed_most * given.course_walk, given.drifts * given.drift_walk)
    return range_filter.Motion(
        step=p.step,
        slowest=given.target_speed_least,
        fastest=given.target_speed_most,
        least_interval=least,
        greatest_interval=greatest,
        least_turn=given.turn_least,
        greatest_turn=ti.max(given.turn_most, given.turn_least + 1e-3),
        walk=walk.norm() * ti.sqrt(p.step),
    )


@func
def update(worlds: ti.template(), w):
    """Move the targets; every `interval` seconds measure them and update the filters."""
    p, given = ti.static(worlds.p, worlds.task_parameters)
    now, num_targets = p.step * worlds.clock[w, 1], worlds.node.shape[1]
    due = ti.floor(now / given.interval + 1e-4) > ti.floor((now - p.step) / given.interval + 1e-4)
    for i in range(num_targets):
        move_target(worlds, w, i)
    for j in range(observers(worlds)):
        for i in range(num_targets):
            signal = vec3(0.0)
            if due:
                signal = measure(worlds, w, j, i)
            note(worlds, w, j, i, signal)
    if due:
        take_channel(worlds, w)
    motion = assumed(worlds)
    for k in range(worlds.auv.shape[1]):
        water = p.step * vec2(worlds.auv.current_x[w, k], worlds.auv.current_y[w, k])
        received = ti.cast(0, ti.i64)
        if due:
            received = senders(worlds, w, k)
        for i in range(num_targets):
            depths = depth_limits(worlds, w, i)
            f = ti.static(pair_filter(worlds, w, k, i, depths))
            range_filter.predict(f, motion)
            if given.drifts > 0.0:
                range_filter.carry(f, water)
            use_measurements(worlds, w, k, i, received, f)
            range_filter.finish(f, tracking_places.common_error(worlds, w, k, i))
    for i in range(num_targets):
        share_estimate(worlds, w, i)


@func
def finish(worlds: ti.template(), w):
    """Assign targets to the AUVs anew."""
    pair = ti.static(worlds.task_pair)
    for k in range(worlds.auv.shape[1]):
        here, best, least = believed_place(worlds, w, k), target_of(worlds, w, k), 1e9
        for i in range(worlds.node.shape[1]):
            cost = 0.0
            if pair.known[w, k, i] > 0.0:
                cost = (vec2(pair.x[w, k, i], pair.y[w, k, i]) - here).norm()
                if worlds.node.shape[1] > worlds.auv.shape[1]:
                    deviation = ti.sqrt(pair.xx[w, k, i] + pair.yy[w, k, i])
                    cost -= worlds.task_parameters.uncertainty_weight * deviation
            if i != target_of(worlds, w, k):
                cost += HYSTERESIS
            for j in range(k):
                if target_of(worlds, w, j) == i:
                    cost += FOLLOWERS
            if cost < least:
                least = cost
                best = i
        worlds.auv.target[w, k] = ti.cast(best, ti.f32)


@func
def way(worlds: ti.template(), w, k) -> vec2:
    """What AUV k takes the way to its target to be, m; none while it knows nothing of it."""
    pair = ti.static(worlds.task_pair)
    i = target_of(worlds, w, k)
    found = vec2(0.0)
    if pair.known[w, k, i] > 0.0:
        found = vec2(pair.x[w, k, i], pair.y[w, k, i]) - believed_place(worlds, w, k)
    return found


@func
def known_place(worlds: ti.template(), w, i) -> vec2:
    """Where the team takes target i to be, m."""
    return vec2(worlds.task_node.estimate_x[w, i], worlds.task_node.estimate_y[w, i])


@func
def observe_track(worlds: ti.template(), w, k, first):
    """What AUV k's filter says of its target, and how AUV k moves: see `_said`."""
    pair = ti.static(worlds.task_pair)
    i = target_of(worlds, w, k)
    sight, seen = vec2(1.0, 0.0), way(worlds, w, k)
    if seen.norm() > 1e-3:
        sight = seen.normalized()
    xx, xy, yy = pair.xx[w, k, i], pair.xy[w, k, i], pair.yy[w, k, i]
    along = xx * sight[0] * sight[0] + 2.0 * xy * sight[0] * sight[1] + yy * sight[1] * sight[1]
    across = xx * sight[1] * sight[1] - 2.0 * xy * sight[0] * sight[1] + yy * sight[0] * sight[0]
    both = (yy - xx) * sight[0] * sight[1] + xy * (sight[0] * sight[0] - sight[1] * sight[1])
    along, across = ti.max(along, 1e-6), ti.max(across, 1e-6)
    worlds.observation[w, k, first] = pair.vx[w, k, i]
    worlds.observation[w, k, first + 1] = pair.vy[w, k, i]
    worlds.observation[w, k, first + 2] = worlds.auv.velocity_x[w, k]
    worlds.observation[w, k, first + 3] = worlds.auv.velocity_y[w, k]
    worlds.observation[w, k, first + 4] = ti.sqrt(along) / SPREAD
    worlds.observation[w, k, first + 5] = ti.sqrt(across) / SPREAD
    worlds.observation[w, k, first + 6] = both / ti.sqrt(along * across)


@func
def tracked(worlds: ti.template(), w, k, weight):
    """Mean over targets of e^{−2t/(1−t)}, t the share of the way of the team's error from `PRECISE` to `USELESS`."""
    total, count = 0.0, worlds.node.shape[1]
    for i in range(count):
        t = ti.max((worlds.task_node.error[w, i] - PRECISE) / (USELESS - PRECISE), 0.0)
        if t < 1.0:
            total += ti.exp(-2.0 * t / (1.0 - t))
    return weight * total / count


@func
def covered(worlds: ti.template(), w, k, weight):
    """Share of the targets within `COVERED` of an AUV."""
    total, count = 0.0, worlds.node.shape[1]
    for i in range(count):
        if worlds.task_node.distance[w, i] <= COVERED:
            total += 1.0
    return weight * total / count


@func
def collision(worlds: ti.template(), w, k, weight):
    """1 where two AUVs are closer than the collision distance."""
    return weight * ti.min(worlds.tally.collisions[w], 1.0)


@func
def deviation(worlds: ti.template(), w, k, weight):
    """Mean over targets of the deviation √(P_xx + P_yy) of the team's estimate over `USELESS`, at most `LOST`."""
    total, count = 0.0, worlds.node.shape[1]
    for i in range(count):
        variance = worlds.task_node.covariance_xx[w, i] + worlds.task_node.covariance_yy[w, i]
        total += ti.min(ti.sqrt(ti.max(variance, 0.0)) / USELESS, LOST)
    return weight * total / count


TERMS = (tracked, covered, collision, deviation)
REWARD_TERMS = (
    *(RewardTerm(term.__name__, term, WEIGHTS[term.__name__]) for term in TERMS),
    RewardTerm("border", rewards.border, None),
    RewardTerm("proximity", rewards.proximity, None),
    RewardTerm("power", rewards.power, None),
)
TRACKING = Task(
    place=place,
    assign=assign,
    move=move,
    update=update,
    finish=finish,
    reward_terms=REWARD_TERMS,
    targets=SHIPPED["tracking"].targets,
    parameters=PARAMETERS,
    observation=("track",),
    heuristic=SHIPPED["tracking"].heuristic,
    node_columns=TargetColumn,
    pair_columns=UncertainPairColumn,
    boat_columns=BoatHearingColumn,
    room=ROOM,
    way=way,
    known_place=known_place,
)
tasks.register("tracking", TRACKING)
_said = [
    *(f"velocity of the target by the AUV's filter, {axis}, m/s" for axis in "xy"),
    *(f"velocity of the AUV through the water, {axis}, m/s" for axis in "xy"),
    f"standard deviation of the target's place along the line of sight, over {SPREAD:g} m",
    "the same across it, to the left",
    "correlation of both",
]
observation_terms.register("track", ObservationTerm(observe_track, lambda num_auvs: _said, "m/s, 1", -1e4, 1e4))
