"""The boat's visits by rollouts: predicted uncertainty of the AUVs' own positions over the next minutes.

The boat compares first goals: each AUV's predicted position (`usvauv.kernels.mission.foresight`), their mean, and its
present goal. After the first goal it visits, in the rollout, the AUV that is then least certain of its position. The
loss of a goal is the mean of a², over the horizon and all AUVs, with a the variance of an AUV's own position: the
square, so that one AUV alone for long counts more than several for a short time. The boat goes to the least certain AUV
unless another goal's loss is less by a margin, because rollouts have errors. It keeps the goal until it has received a
reply of the AUV that it visits, has arrived, or has searched for too long: with a new plan in each step, a far AUV
would always come second.

One number of each 2 × 2 block of a filter's covariance is enough, half its trace, because drift and fixes are equal for
both axes: (a, b, c) of `usvauv.kernels.positioning.tracker.Drift`, with the current's variance and memory, or those of
the log's bias reversed. In a rollout a reply is received where that is probable enough, the uncertainty of the AUV's
position included to first order.

Source: a rollout of a base policy is no worse than the base policy where its model holds (Bertsekas, "Rollout, Policy
Iteration, and Distributed Reinforcement Learning" (2020), §2.3).
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission import boat_motion, foresight, reception, replies
from usvauv.kernels.mission.columns import BoatColumn, ExchangeColumn, ForesightColumn, Parameter
from usvauv.kernels.mission.foresight import Way, drift_over, foreseen_place, own_uncertainty
from usvauv.kernels.planning.information import each_auv
from usvauv.kernels.positioning import acoustic_link, tracker
from usvauv.kernels.types import vec2, vec3

INTERVAL = 5.0  # s, of a step of the rollout, and the least between two plans
STEPS = 60  # of a rollout
PATIENCE = 150.0  # s that the boat looks for an AUV before it plans anew
SURE = 0.8  # probability from which on a reply is received in a rollout
BISECTIONS = 8  # of the acoustic range, from the area's diagonal on
MARGIN = 0.03  # share by which another goal's loss must be below that of going to the least certain AUV
NO_LIMIT = 3e38  # m⁴
OTHER_GOALS = 2  # of a boat besides the AUVs, see `goal_of`
NO_AUV = -1  # the index of a goal that is no AUV
STRAYING = 0.3  # standard deviation per axis of an AUV's velocity from the predicted one, over the reference speed


@func
def straying(worlds: ti.template(), elapsed) -> ti.f32:
    """Variance per axis (m²) of an AUV's own position estimate about the predicted position.

    Args:
        elapsed: since its last reply, s.
    """
    p = ti.static(worlds.p)
    tau = p[Parameter.velocity_memory]
    speed = STRAYING * p[Parameter.reference_speed]
    return speed * speed * tau * tau * tracker.decayed(elapsed / tau)[1]


@func
def hearing_range(worlds: ti.template(), k, z, farthest) -> ti.f32:
    """Horizontal distance, m, beyond which AUV k's replies are not received in a rollout; at most `farthest`.

    By bisection of the signal's excess for a boat at rest and a known position, which is then the largest and decreases
    with the distance. Returns the far end of the last interval.
    """
    sure = replies.excess_for(worlds, SURE)
    near = 0.0
    far = farthest
    for _ in range(BISECTIONS):
        middle = 0.5 * (near + far)
        offset = vec3(middle, 0.0, z)
        loss = acoustic_link.loss_in_bubbles(worlds.link, k, offset)
        if replies.expected_signal(worlds, k, offset, loss, 0.0)[0] >= sure:
            near = middle
        else:
            far = middle
    return far


@func
def hearing_ranges(worlds: ti.template(), w, b) -> each_auv:
    """`hearing_range` of each AUV that boat b serves, m."""
    ranges = each_auv(0.0)
    for k in range(worlds.estimate.shape[1]):
        if boat_motion.serves(worlds, w, b, k):
            ranges[k] = hearing_range(worlds, k, reception.height(worlds, w, b, k), worlds.p[Parameter.diagonal])
    return ranges


@func
def auv_of(worlds: ti.template(), n: ti.i32) -> ti.i32:
    """The AUV of goal n of `goal_of`, or NO_AUV."""
    return ti.select(n < worlds.estimate.shape[1], n, NO_AUV)


@func
def goal_of(worlds: ti.template(), w, b, n: ti.i32) -> vec2:
    """Goal n of boat b, m: AUV n's predicted position; K: the mean of all that it serves; K + 1: its present goal."""
    count = worlds.estimate.shape[1]
    goal = boat_motion.goal_place(worlds, w, b)
    if n < count:
        goal = foreseen_place(worlds, w, n)
    elif n == count:
        goal = vec2(0.0, 0.0)
        for k in range(count):
            if boat_motion.serves(worlds, w, b, k):
                goal += foreseen_place(worlds, w, k) / boat_motion.num_served(worlds, w, b)
    return goal


@func
def is_goal(worlds: ti.template(), w, b, n: ti.i32):
    """Whether goal n is a goal of boat b: AUVs that it does not serve are not."""
    return n >= worlds.estimate.shape[1] or boat_motion.serves(worlds, w, b, n)


@func
def expected_loss(worlds: ti.template(), w, boat, n: ti.i32, ranges: each_auv, limit) -> ti.f32:
    """Mean squared variance of the own positions of the AUVs that a boat serves, per axis (m⁴), over the horizon.

    Args:
        n: index of the boat's first goal, see `goal_of`.
        ranges: `hearing_range` of each AUV, m.
        limit: loss (m⁴) above which its value is irrelevant: the rollout ends once its sum, which only grows, is above.
    """
    p = ti.static(worlds.p)
    count = worlds.estimate.shape[1]
    here = vec2(worlds.boat[w, boat, BoatColumn.x], worlds.boat[w, boat, BoatColumn.y])
    z = -(p[Parameter.separation_boat] + worlds.boat[w, boat, BoatColumn.elevation])
    works = foresight.works_within(worlds)
    reach = p[Parameter.top_speed] * INTERVAL
    over_step = drift_over(worlds, INTERVAL)
    strayed = straying(worlds, INTERVAL)
    sure = replies.excess_for(worlds, SURE)
    a = each_auv(0.0)
    b = each_auv(0.0)
    c = each_auv(0.0)
    elapsed = each_auv(0.0)
    x = each_auv(0.0)
    y = each_auv(0.0)
    noise = each_auv(0.0)  # loss in the boat's own noise at full speed, dB
    heads_for = each_auv(0.0)
    hovers = each_auv(0.0)
    for k in range(count):
        if boat_motion.serves(worlds, w, boat, k):
            s = own_uncertainty(worlds, w, k)
            a[k] = s[0]
            b[k] = s[1]
            c[k] = s[2]
            noise[k] = acoustic_link.loss_in_own_noise(worlds.link, k, 1.0)
            elapsed[k] = worlds.exchange[w, k, ExchangeColumn.elapsed]
            x[k] = worlds.foresight[w, k, ForesightColumn.x]
            y[k] = worlds.foresight[w, k, ForesightColumn.y]
            heads_for[k] = worlds.foresight[w, k, ForesightColumn.heads_for]
            hovers[k] = worlds.foresight[w, k, ForesightColumn.hovers]
    goal = goal_of(worlds, w, boat, n)
    visited = auv_of(worlds, n)
    total = 0.0
    terms = STEPS * boat_motion.num_served(worlds, w, boat)
    heading = 0.0
    if ti.static(worlds.program.otter):
        heading = boat_motion.boat_heading(worlds, w, boat)
    for _ in range(STEPS):
        if total > limit * terms:
            break
        if visited != NO_AUV:
            goal = vec2(x[visited], y[visited])
        way = goal - here
        distance = way.norm()
        gone = reach
        if ti.static(worlds.program.otter):
            turn = boat_motion.turn_towards(worlds, heading, way, INTERVAL)
            heading += turn[0]
            gone -= p[Parameter.top_speed] * turn[1]
        if distance > gone:
            way *= gone / distance
        here += way
        reached = distance <= gone
        effort = ti.min(distance / reach, 1.0)
        least = 0
        for k in range(count):
            if boat_motion.serves(worlds, w, boat, k):
                lost = ti.cast(a[k] > works * works, ti.i32)
                after = Way(
                    place=vec2(x[k], y[k]),
                    node=ti.cast(heads_for[k], ti.i32),
                    hovers=hovers[k],
                    speed=worlds.foresight[w, k, ForesightColumn.speed],
                )
                after = foresight.advanced(worlds, w, after, INTERVAL, lost)
                x[k] = after.place[0]
                y[k] = after.place[1]
                heads_for[k] = ti.cast(after.node, ti.f32)
                hovers[k] = after.hovers
                s = tracker.drifted(vec3(a[k], b[k], c[k]), over_step)
                if ti.static(worlds.program.vehicle):
                    z = reception.height(worlds, w, boat, k)
                offset = vec3(after.place[0] - here[0], after.place[1] - here[1], z)
                elapsed[k] += INTERVAL
                if offset.xy.norm_sqr() <= ranges[k] * ranges[k]:
                    spread = s[0] + strayed
                    if elapsed[k] > INTERVAL:
                        spread = s[0] + straying(worlds, elapsed[k])
                    loss = noise[k]
                    if effort < 1.0:
                        loss = acoustic_link.loss_in_own_noise(worlds.link, k, effort)
                    loss += acoustic_link.loss_in_bubbles(worlds.link, k, offset)
                    found = replies.expected_signal(worlds, k, offset, loss, spread)
                    if found[0] >= sure:
                        s = tracker.fixed(s, found[1])
                        elapsed[k] = 0.0
                        if k == visited:
                            reached = True
                a[k] = s[0]
                b[k] = s[1]
                c[k] = s[2]
                total += s[0] * s[0]
                if a[k] > a[least]:
                    least = k
        if reached:
            visited = least
    return total / terms


@func
def least_certain(worlds: ti.template(), w, b) -> ti.i32:
    """The AUV of boat b that is least certain of its own position, or NO_AUV."""
    least = NO_AUV
    largest = -1.0
    for k in range(worlds.estimate.shape[1]):
        a = own_uncertainty(worlds, w, k)[0]
        if a > largest and boat_motion.serves(worlds, w, b, k):
            least = k
            largest = a
    return least


@func
def aim(worlds: ti.template(), w, b) -> vec2:
    """Goal of boat b from its last plan, m: the predicted position of the AUV that it visits, or the planned place."""
    visited = ti.cast(worlds.boat[w, b, BoatColumn.visits], ti.i32)
    goal = boat_motion.goal_place(worlds, w, b)
    if visited != NO_AUV:
        goal = foreseen_place(worlds, w, visited)
    return goal


@func
def just_heard(worlds: ti.template(), w, k):
    """Whether a reply of AUV k was received in the last step."""
    return worlds.exchange[w, k, ExchangeColumn.elapsed] < 2.0 * worlds.p[Parameter.step]


@func
def is_due(worlds: ti.template(), w, b):
    """Whether a plan is due: boat b has a reply of the AUV that it visits, serves it no longer, or has arrived.

    Two plans are from `INTERVAL` to `PATIENCE` apart.
    """
    visited = ti.cast(worlds.boat[w, b, BoatColumn.visits], ti.i32)
    over = ti.cast(worlds.clock[w, 1], ti.f32) * worlds.p[Parameter.step] - worlds.boat[w, b, BoatColumn.planned]
    due = over >= PATIENCE
    if visited != NO_AUV:
        due = due or just_heard(worlds, w, visited) or not boat_motion.serves(worlds, w, b, visited)
    away = aim(worlds, w, b) - boat_motion.boat_place(worlds, w, b)
    near = worlds.p[Parameter.top_speed] * INTERVAL + worlds.p[Parameter.dead_band]
    due = due or away.norm() < near
    return worlds.clock[w, 1] == 1 or (due and over >= INTERVAL)


@func
def place_of(worlds: ti.template(), b, n):
    """Index in the workspace at which `weigh` writes, after the target rule's part."""
    return worlds.workspace.shape[1] - 1 - b * (worlds.estimate.shape[1] + OTHER_GOALS) - n


@func
def weigh(worlds: ti.template(), w, b, n):
    """Write the loss of goal n of boat b, if a plan is due, for `plan`."""
    if boat_motion.num_served(worlds, w, b) > 0 and is_due(worlds, w, b) and is_goal(worlds, w, b, n):
        loss = expected_loss(worlds, w, b, n, hearing_ranges(worlds, w, b), NO_LIMIT)
        worlds.workspace[w, place_of(worlds, b, n)] = loss


@func
def loss_of(worlds: ti.template(), w, b, n: ti.i32, ranges: each_auv, limit) -> ti.f32:
    """`expected_loss`, or the value that `weigh` has written."""
    loss = 0.0
    if ti.static(worlds.program.weighs_apart):
        loss = worlds.workspace[w, place_of(worlds, b, n)]
    else:
        loss = expected_loss(worlds, w, b, n, ranges, limit)
    return loss


@func
def plan(worlds: ti.template(), w, b) -> vec2:
    """The goal of boat b with the least expected loss, or the least certain AUV if its loss is hardly more, m."""
    ranges = each_auv(0.0)
    if ti.static(not worlds.program.weighs_apart):
        ranges = hearing_ranges(worlds, w, b)
    usual = least_certain(worlds, w, b)
    best = usual
    least = (1.0 - MARGIN) * loss_of(worlds, w, b, usual, ranges, NO_LIMIT)
    for n in range(worlds.estimate.shape[1] + OTHER_GOALS):
        if n != usual and is_goal(worlds, w, b, n):
            loss = loss_of(worlds, w, b, n, ranges, least)
            if loss < least:
                least = loss
                best = n
    worlds.boat[w, b, BoatColumn.visits] = ti.cast(auv_of(worlds, best), ti.f32)
    worlds.boat[w, b, BoatColumn.planned] = ti.cast(worlds.clock[w, 1], ti.f32) * worlds.p[Parameter.step]
    return goal_of(worlds, w, b, best)


@func
def go(worlds: ti.template(), w, b) -> vec2:
    """Plans visits to its AUVs that keep them certain of their own positions, by rollouts of five minutes.

    The goal, m, is that of the last plan, until a new one is due. Without an AUV the boat stays where it is.
    """
    goal = boat_motion.boat_place(worlds, w, b)
    if boat_motion.num_served(worlds, w, b) > 0:
        goal = aim(worlds, w, b)
        if is_due(worlds, w, b):
            goal = plan(worlds, w, b)
    return goal
