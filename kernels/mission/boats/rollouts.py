"""Rollouts of a boat's visits: how uncertain AUVs will be of their own positions if it goes to some goal first.

After the first goal the boat visits, in the rollout, the AUV that is then least certain of its position; wind and water
carry it meanwhile. One number of
each 2 × 2 block of a filter's covariance is enough, half its trace, because drift and fixes are equal for both axes:
(a, b, c) of `usvauv.kernels.positioning.tracker.Drift`, with the current's variance and memory, or those of the log's
bias reversed. In a rollout a reply is received where that is probable enough, the uncertainty of the AUV's position
included to first order.

All AUVs are side by side in vectors. Where many worlds step together, a plan computes once for all its rollouts where
the boat expects the AUVs (`foresee_ways`), except for those that get lost in a rollout.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.boats import boat_motion, foresight
from usvauv.kernels.mission.boats.foresight import PredictedAuv, drift_over, own_uncertainty
from usvauv.kernels.mission.link import replies
from usvauv.kernels.mission.link.replies import SIGNAL, Signal
from usvauv.kernels.mission.worlds import WORLDS_PER_BLOCK
from usvauv.kernels.positioning import tracker
from usvauv.kernels.random import LANES
from usvauv.kernels.taichi_internals import impl
from usvauv.kernels.types import select, vec2

INTERVAL = 5.0  # s, of a step of the rollout
STEPS = 60  # of a rollout
SURE = 0.8  # probability from which on a reply is received in a rollout
NO_AUV = -1  # the index of a goal that is no AUV
STRAYING = 0.3  # standard deviation per axis of an AUV's velocity from the predicted one, over the reference speed
WAY = 4  # numbers of a `PredictedAuv` that change: x, y, node, hovers
TEAM = 11  # numbers of an AUV at the beginning, before those of `Signal`


class Team(NamedTuple):
    """The AUVs at the beginning of a plan's rollouts, a vector of each number.

    Attributes:
        served: 1 for those that the boat serves, else 0.
        a, b, c: of an AUV's own position.
        p, q, r: the same of its estimate of its position about the predicted one.
        x, y, node, hovers: of `PredictedAuv`.
        signal: `Signal` of them.
    """

    served: Any
    a: Any
    b: Any
    c: Any
    p: Any
    q: Any
    r: Any
    x: Any
    y: Any
    node: Any
    hovers: Any
    signal: Signal

    @classmethod
    def of(cls, numbers: Sequence[Any]) -> "Team":
        """From vectors of `team_numbers`, which are computed once."""
        held = [impl.expr_init(vector) for vector in numbers]
        return cls._make([*held[:TEAM], Signal._make(held[TEAM:])])


@func
def straying_over(worlds: ti.template(), time) -> tracker.Drift:
    """How an AUV's own estimate of its position strays from the predicted one over a time, s."""
    p = ti.static(worlds.p)
    speed = STRAYING * p.reference_speed
    return tracker.drift_over(time, speed * speed, p.velocity_memory, 0.0)


@func
def numbers_of(way: PredictedAuv):
    """Numbers that change in a rollout."""
    return ti.Vector([way.place[0], way.place[1], ti.cast(way.node, ti.f32), way.hovers])


@func
def team_numbers(worlds: ti.template(), w, boat):
    """Vectors of the numbers of boat b's AUVs in `Team` and in `Signal`."""
    numbers = ti.Matrix.zero(ti.f32, TEAM + SIGNAL, worlds.program.abreast)
    for k in range(worlds.estimate.shape[1]):
        if boat_motion.serves(worlds, w, boat, k):
            s = own_uncertainty(worlds, w, k)
            strayed = straying_over(worlds, worlds.exchange.elapsed[w, k])
            way = numbers_of(foresight.remembered(worlds, w, k))
            own = [1.0, s[0], s[1], s[2], strayed.position, strayed.cross, strayed.current]
            signal = replies.signal_of(worlds, k, replies.height(worlds, w, boat, k))
            for n in ti.static(range(len(own))):
                numbers[n, k] = own[n]
            for n in ti.static(range(WAY)):
                numbers[TEAM - WAY + n, k] = way[n]
            for n in ti.static(range(SIGNAL)):
                numbers[TEAM + n, k] = signal[n]
    return [
        ti.Vector([numbers[n, k] for k in ti.static(range(worlds.program.abreast))])
        for n in ti.static(range(TEAM + SIGNAL))
    ]


@func
def place_of(worlds: ti.template(), n, c):
    """First index in `worlds.ways` of number c of the AUVs' ways after step n of a rollout."""
    return (WAY * n + c) * ti.static(worlds.program.abreast // LANES)


@func
def foresee_ways(worlds: ti.template(), w, boat):
    """Predict where each AUV of a boat is after each step of a rollout unless it gets lost."""
    for k in range(worlds.estimate.shape[1]):
        if boat_motion.serves(worlds, w, boat, k):
            way = foresight.remembered(worlds, w, k)
            for n in range(STEPS):
                way = foresight.advanced(worlds, w, way, INTERVAL, 0)
                numbers = numbers_of(way)
                for c in ti.static(range(WAY)):
                    worlds.ways[w // WORLDS_PER_BLOCK, place_of(worlds, n, c) + k // LANES][k % LANES] = numbers[c]


@func
def foreseen(worlds: ti.template(), w, n, c):
    """Number c of the AUVs' ways after step n of a rollout, from `foresee_ways`."""
    rows = [
        worlds.ways[w // WORLDS_PER_BLOCK, place_of(worlds, n, c) + row]
        for row in ti.static(range(worlds.program.abreast // LANES))
    ]
    return ti.Vector([rows[row][lane] for row in ti.static(range(len(rows))) for lane in ti.static(range(LANES))])


@func
def expected_loss(worlds: ti.template(), w, boat, goal: vec2, first: ti.i32, team: ti.template(), limit) -> ti.f32:
    """Mean squared variance of the own positions of the AUVs that a boat serves, per axis (m⁴), over the horizon.

    Args:
        goal: the boat's first, m. first: the AUV whose predicted position this is, or NO_AUV.
        team: `Team`.
        limit: loss (m⁴) above which its value is irrelevant: the rollout ends once its sum, which only grows, is above.
    """
    shared = ti.static(worlds.program.in_lanes)
    count = worlds.estimate.shape[1]
    here = boat_motion.boat_place(worlds, w, boat)
    speed = worlds.p.top_speed
    reach = speed * INTERVAL
    drift = drift_over(worlds, INTERVAL)
    straying = straying_over(worlds, INTERVAL)
    sure = replies.excess_for(worlds, SURE)
    works = foresight.works_within(worlds)
    lost_from = works * works
    a = team.a
    b = team.b
    c = team.c
    p = team.p
    q = team.q
    r = team.r
    x = team.x
    y = team.y
    node = team.node
    hovers = team.hovers
    astray = ti.static(0.0 if shared else 1.0) * team.served
    full = replies.left_by_noise(team.signal, 1.0)
    heading = 0.0
    if ti.static(worlds.program.otter):
        heading = boat_motion.boat_heading(worlds, w, boat)
    visited = first
    apart = False  # one has been lost
    squares = (team.served * a * a).sum()
    total = 0.0
    terms = STEPS * boat_motion.num_served(worlds, w, boat)
    for n in range(STEPS):
        if total > limit * terms:
            break
        if visited != NO_AUV:
            goal = vec2(x[visited], y[visited])
        here += INTERVAL * boat_motion.expected_drift(worlds, w, boat, (n + 0.5) * INTERVAL)
        way = goal - here
        distance = way.norm()
        gone = reach
        if ti.static(worlds.program.otter):
            turn = boat_motion.turn_towards(worlds, heading, way, INTERVAL)
            heading += turn[0]
            gone -= speed * turn[1]
        if distance > gone:
            way *= gone / distance
        here += way
        reached = distance <= gone
        left = full
        if distance < reach:
            left = replies.left_by_noise(team.signal, distance / reach)
        if ti.static(not shared) or apart or squares > lost_from * lost_from:  # or none is lost
            uncertain = a
            for k in range(count):
                lost = uncertain[k] > lost_from
                if boat_motion.serves(worlds, w, boat, k) and (lost or astray[k] > 0.5):
                    apart = True
                    astray[k] = 1.0
                    after = PredictedAuv(
                        place=vec2(x[k], y[k]),
                        node=ti.cast(node[k], ti.i32),
                        hovers=hovers[k],
                        speed=worlds.foresight.speed[w, k],
                    )
                    after = foresight.advanced(worlds, w, after, INTERVAL, ti.cast(lost, ti.i32))
                    x[k] = after.place[0]
                    y[k] = after.place[1]
                    node[k] = ti.cast(after.node, ti.f32)
                    hovers[k] = after.hovers
        if ti.static(shared):
            x = select(astray > 0.5, x, foreseen(worlds, w, n, 0))
            y = select(astray > 0.5, y, foreseen(worlds, w, n, 1))
            node = select(astray > 0.5, node, foreseen(worlds, w, n, 2))
            hovers = select(astray > 0.5, hovers, foreseen(worlds, w, n, 3))
        a, b, c = tracker.drifted(a, b, c, drift)
        p, q, r = tracker.drifted(p, q, r, straying)
        across, along = x - here[0], y - here[1]
        above, slope, variance, in_the_sea = replies.expected_signal(team.signal, across * across + along * along, left)
        if ti.static(worlds.program.messages):
            above = replies.heard_both_ways(worlds, above, in_the_sea)
        above = select(above > 0.0, above, 0.0)
        heard = select(above * above >= sure * sure * (1.0 + slope * (a + p)), 1.0, 0.0)
        fixed_a, fixed_b, fixed_c = tracker.fixed(a, b, c, variance)
        a = select(heard > 0.5, fixed_a, a)
        b = select(heard > 0.5, fixed_b, b)
        c = select(heard > 0.5, fixed_c, c)
        p = select(heard > 0.5, 0.0, p)
        q = select(heard > 0.5, 0.0, q)
        r = select(heard > 0.5, 0.0, r)
        squares = select(team.served > 0.5, a * a, 0.0).sum()
        total += squares
        if visited != NO_AUV:
            reached = reached or heard[visited] > 0.5
        if reached:
            uncertain = select(team.served > 0.5, a, -1.0)
            visited = 0
            for k in range(count):
                if uncertain[k] > uncertain[visited]:
                    visited = k
    return total / terms
