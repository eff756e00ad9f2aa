"""The boat's visits by rollouts: predicted uncertainty of the AUVs' own positions over the next minutes.

The boat compares first goals: each AUV's predicted position (`usvauv.kernels.mission.boats.foresight`), their mean, and
its present goal. The loss of a goal is the mean of a², over the horizon and all AUVs, with a the variance of an AUV's
own position (`usvauv.kernels.mission.boats.rollouts`): the square, so that one AUV alone for long counts more than
several for a short time. The boat goes to the least certain AUV unless another goal's loss is less by a margin, because
rollouts have errors. It keeps the goal until it has received a reply of the AUV that it visits, has arrived, or has
searched for too long: with a new plan in each step, a far AUV would always come second. It gives up a goal that it
cannot approach against wind and water (`boat_motion.can_approach`).

Source: a rollout of a base policy is no worse than the base policy where its model holds (Bertsekas, "Rollout, Policy
Iteration, and Distributed Reinforcement Learning" (2020), §2.3).
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.boats import boat_motion, rollouts
from usvauv.kernels.mission.boats.foresight import foreseen_place, own_uncertainty
from usvauv.kernels.mission.boats.rollouts import INTERVAL, NO_AUV
from usvauv.kernels.types import vec2

PATIENCE = 150.0  # s that the boat looks for an AUV before it plans anew
GIVE_UP = 30.0  # s, after which it gives up a goal that it cannot approach
MARGIN = 0.03  # share by which another goal's loss must be below that of going to the least certain AUV
NO_LIMIT = 3e38  # m⁴
OTHER_GOALS = 2  # of a boat besides the AUVs, see `goal_of`


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
    visited = ti.cast(worlds.boat.visits[w, b], ti.i32)
    goal = boat_motion.goal_place(worlds, w, b)
    if visited != NO_AUV:
        goal = foreseen_place(worlds, w, visited)
    return goal


@func
def just_heard(worlds: ti.template(), w, k):
    """Whether a reply of AUV k was received in the last step."""
    return worlds.exchange.elapsed[w, k] < 2.0 * worlds.p.step


@func
def is_due(worlds: ti.template(), w, b):
    """Whether a plan is due: boat b has a reply of the AUV that it visits, serves it no longer, or has arrived.

    Or it gives up. Two plans are from `INTERVAL` to `PATIENCE` apart.
    """
    visited = ti.cast(worlds.boat.visits[w, b], ti.i32)
    over = ti.cast(worlds.clock[w, 1], ti.f32) * worlds.p.step - worlds.boat.planned[w, b]
    due = over >= PATIENCE or (over >= GIVE_UP and not boat_motion.can_approach(worlds, w, b, aim(worlds, w, b)))
    if visited != NO_AUV:
        due = due or just_heard(worlds, w, visited) or not boat_motion.serves(worlds, w, b, visited)
    away = aim(worlds, w, b) - boat_motion.boat_place(worlds, w, b)
    near = worlds.p.top_speed * INTERVAL + worlds.p.dead_band
    due = due or away.norm() < near
    return worlds.clock[w, 1] == 1 or (due and over >= INTERVAL)


@func
def place_of(worlds: ti.template(), b, n):
    """Index in the workspace at which `weigh` writes, after the target rule's part."""
    return worlds.workspace.shape[1] - 1 - b * (worlds.estimate.shape[1] + OTHER_GOALS) - n


@func
def loss_of(worlds: ti.template(), w, b, n: ti.i32, team: ti.template(), limit) -> ti.f32:
    """`rollouts.expected_loss` of goal n of boat b, m⁴."""
    return rollouts.expected_loss(worlds, w, b, goal_of(worlds, w, b, n), auv_of(worlds, n), team, limit)


@func
def weigh(worlds: ti.template(), w, b, n):
    """Write the loss of goal n of boat b, if a plan is due, for `plan`."""
    if boat_motion.num_served(worlds, w, b) > 0 and is_due(worlds, w, b) and is_goal(worlds, w, b, n):
        numbers = rollouts.team_numbers(worlds, w, b)
        team = ti.static(rollouts.Team.of(numbers))
        worlds.workspace[w, place_of(worlds, b, n)] = loss_of(worlds, w, b, n, team, NO_LIMIT)


@func
def plan(worlds: ti.template(), w, b) -> vec2:
    """The goal of boat b with the least expected loss, or the least certain AUV if its loss is hardly more, m."""
    numbers = rollouts.team_numbers(worlds, w, b)
    team = ti.static(rollouts.Team.of(numbers))
    if ti.static(worlds.program.in_lanes):
        rollouts.foresee_ways(worlds, w, b)
    usual = least_certain(worlds, w, b)
    if usual == NO_AUV:
        usual = worlds.estimate.shape[1]  # their mean
    best = usual
    least = NO_LIMIT
    for turn in range(worlds.estimate.shape[1] + OTHER_GOALS + 1):
        n = usual if turn == 0 else turn - 1
        if turn == 0 or (n != usual and is_goal(worlds, w, b, n)):
            loss = 0.0
            if ti.static(worlds.program.weighs_apart):
                loss = worlds.workspace[w, place_of(worlds, b, n)]
            else:
                loss = loss_of(worlds, w, b, n, team, least)
            if turn == 0:
                loss *= 1.0 - MARGIN
            if loss < least:
                least = loss
                best = n
    worlds.boat.visits[w, b] = ti.cast(auv_of(worlds, best), ti.f32)
    worlds.boat.planned[w, b] = ti.cast(worlds.clock[w, 1], ti.f32) * worlds.p.step
    return goal_of(worlds, w, b, best)


@func
def go(worlds: ti.template(), w, b) -> vec2:
    """The goal of the last plan, until a new one is due, m. Without an AUV the boat stays where it is."""
    goal = boat_motion.boat_place(worlds, w, b)
    if boat_motion.num_served(worlds, w, b) > 0:
        goal = aim(worlds, w, b)
        if is_due(worlds, w, b):
            goal = plan(worlds, w, b)
    return goal
