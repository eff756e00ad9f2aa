"""A learned boat: a small network says which AUV it visits next, or that it goes to the mean of them all.

The network is that of `usvauv.kernels.mission.candidate_scores`; its first feature compares the candidates by the
rollouts of `usvauv.kernels.mission.belief_planner`, so that before training the boat chooses as `belief` does. A
decision holds until the boat has heard whom it went to, has arrived, or `PATIENCE` is over. Weights come from a file
that `usvauv train-boat` writes (`policies/decisions`).

For other features the boat imagines the way to each candidate, straight and at its top speed, while AUVs go on to the
nodes that they head for, and how probably it hears each of them on the way.
"""

import taichi as ti
import torch

from usvauv.kernels.mission import belief_planner, candidate_scores, expected_reply, serving
from usvauv.kernels.mission.belief_planner import INTERVAL, NOBODY
from usvauv.kernels.mission.candidate_scores import HEAD, Decision, Network
from usvauv.kernels.mission.columns import BoatColumn, Draw, ExchangeColumn, ForesightColumn, NodeColumn, Parameter
from usvauv.kernels.types import Columns, vec2, vec3

PATIENCE = 30.0  # s, the longest time between them
SAMPLES = 8  # of an imagined way
TIME = 100.0  # s, the unit of times
FAR = 3.0  # units, beyond which all are alike
NEIGHBOURHOOD = 100.0  # m
NEXT = 0.3  # units of time that are added to every way


class Feature(Columns):
    """What the network sees of a candidate, of order one. The mean has 0 where a feature is of an AUV."""

    future: int  # share by which its loss by a rollout is above the least, negative
    own: int  # standard deviation of the AUV's own position, over how far off it still finds its node
    arrival: int  # the same when the boat hears it
    growth: int  # standard deviation of its reckoned velocity, times `TIME`, over the same
    lost: int  # probability that it misses its node
    later: int  # the same in a time `TIME`, if it is not heard
    trip: int  # time until it is heard; to the mean
    here: int  # probability that it is heard from where the boat is
    silent: int  # time since it was heard
    hovers: int  # 1: it serves a node
    kept: int  # 1: the boat is on its way there
    turn: int  # cosine between the way there and that to the last goal
    served: int  # others that are heard on the way, by `later`
    served_lost: int  # by `lost`
    pays: int  # all that are heard on the way, by `later`, for each `TIME` of the way and some for the next one
    around: int  # others around the candidate's place, by `later`
    onward: int  # from there to the others that are not heard on the way, time
    mean: int  # 1: the candidate is the mean
    all_own: int  # mean of `own`
    most_own: int  # largest
    all_lost: int  # mean of `lost`
    left: int  # of the mission, share
    end: int  # exp(−time left)


FEATURES = len(Feature.names)
NETWORK = Network(FEATURES, Feature.future, 20.0, "boat", "train-boat")
EXPLORE, WEIGHTS = 0, 1  # places in `strategy_arguments`


def read_weights(text: str) -> tuple[float, ...]:
    """`strategy_arguments` for the weights of a JSON file, or for those before training; raises ValueError."""
    return (0.0, *NETWORK.read(text))


@ti.func
def decision(worlds: ti.template(), b):
    """Place in the workspace of the decision of boat b."""
    return b * (HEAD + (worlds.estimate.shape[1] + 1) * (FEATURES + 1))


@ti.func
def place(worlds: ti.template(), b, i, feature):
    """Place in the workspace of a feature of candidate i, an AUV or after all AUVs the mean; `FEATURES`: it is one."""
    return decision(worlds, b) + HEAD + i * (FEATURES + 1) + feature


@ti.func
def is_candidate(worlds: ti.template(), w, b, i):
    """Whether boat b may go to candidate i: it serves that AUV, or it is the mean of those it serves."""
    mine = True
    if i < worlds.estimate.shape[1]:
        mine = serving.serves(worlds, w, b, i)
    return mine


@ti.func
def goal_of(worlds: ti.template(), w, b, i) -> vec2:
    """Where candidate i is foreseen at present, m."""
    count = worlds.estimate.shape[1]
    goal = vec2(0.0, 0.0)
    if i < count:
        goal = belief_planner.foreseen_place(worlds, w, i)
    else:
        for k in range(count):
            if serving.serves(worlds, w, b, k):
                goal += belief_planner.foreseen_place(worlds, w, k) / serving.num_served(worlds, w, b)
    return goal


@ti.func
def soon(worlds: ti.template(), w, k, time) -> vec2:
    """Where AUV k is foreseen after a short time (s): on its way to the node that it heads for, m."""
    node = ti.cast(worlds.foresight[w, k, ForesightColumn.heads_for], ti.i32)
    there = vec2(worlds.node[w, node, NodeColumn.x], worlds.node[w, node, NodeColumn.y])
    now = belief_planner.foreseen_place(worlds, w, k)
    travelled = worlds.foresight[w, k, ForesightColumn.speed] * ti.max(
        time - worlds.foresight[w, k, ForesightColumn.hovers], 0.0
    )
    return now + ti.min(travelled / ti.max((there - now).norm(), 1e-3), 1.0) * (there - now)


@ti.func
def own_after(worlds: ti.template(), w, k, time) -> ti.f32:
    """What AUV k's variance of its own position per axis will be if it is not heard for some time (s), m²."""
    s = belief_planner.own_uncertainty(worlds, w, k)
    return belief_planner.drifted(s, belief_planner.drift_over(worlds, time))[0]


@ti.func
def misses(worlds: ti.template(), a) -> ti.f32:
    """Probability that an AUV with this variance of its position (m²) is farther off than it finds its node."""
    works = belief_planner.works_within(worlds)
    return ti.exp(-0.5 * works * works / ti.max(a, 1e-6))


@ti.func
def heard(worlds: ti.template(), w, b, k, at: vec2, effort, time) -> ti.f32:
    """Probability that AUV k is heard from a place (m) in some time (s)."""
    z = -(worlds.p[Parameter.separation_boat] + worlds.boat[w, b, BoatColumn.elevation])
    away = soon(worlds, w, k, time) - at
    strays = belief_planner.straying(worlds, worlds.exchange[w, k, ExchangeColumn.elapsed] + time)
    return expected_reply.reply(worlds, k, vec3(away[0], away[1], z), effort, own_after(worlds, w, k, time) + strays)[0]


@ti.func
def see(worlds: ti.template(), w, b, i):
    """Write what the boat sees of candidate i for itself."""
    p = ti.static(worlds.p)
    boat = ti.static(worlds.boat)
    seen = ti.static(worlds.boat_workspace)
    here = vec2(boat[w, b, BoatColumn.x], boat[w, b, BoatColumn.y])
    way = goal_of(worlds, w, b, i) - here
    last = vec2(boat[w, b, BoatColumn.goal_x], boat[w, b, BoatColumn.goal_y]) - here
    if way.norm() > 1.0 and last.norm() > 1.0:
        seen[w, place(worlds, b, i, Feature.turn)] = way.dot(last) / (way.norm() * last.norm())
    left = p[Parameter.duration] - ti.cast(worlds.clock[w, 1], ti.f32) * p[Parameter.step]
    seen[w, place(worlds, b, i, Feature.left)] = left / p[Parameter.duration]
    seen[w, place(worlds, b, i, Feature.end)] = ti.exp(-left / TIME)
    seen[w, place(worlds, b, i, FEATURES)] = 1.0
    if i < worlds.estimate.shape[1]:
        s = belief_planner.own_uncertainty(worlds, w, i)
        elapsed = worlds.exchange[w, i, ExchangeColumn.elapsed]
        works = belief_planner.works_within(worlds)
        on_its_way = ti.cast(boat[w, b, BoatColumn.visits], ti.i32) == i and worlds.clock[w, 1] > 1
        seen[w, place(worlds, b, i, Feature.own)] = ti.sqrt(s[0]) / works
        seen[w, place(worlds, b, i, Feature.growth)] = ti.sqrt(ti.max(s[2], 0.0)) * TIME / works
        seen[w, place(worlds, b, i, Feature.lost)] = misses(worlds, s[0])
        seen[w, place(worlds, b, i, Feature.later)] = misses(worlds, own_after(worlds, w, i, TIME))
        seen[w, place(worlds, b, i, Feature.here)] = heard(worlds, w, b, i, here, boat[w, b, BoatColumn.effort], 0.0)
        seen[w, place(worlds, b, i, Feature.silent)] = ti.min(elapsed / TIME, FAR) / FAR
        hovers = worlds.foresight[w, i, ForesightColumn.hovers] > 0.0
        seen[w, place(worlds, b, i, Feature.hovers)] = ti.cast(hovers, ti.f32)
        kept = on_its_way and not belief_planner.just_heard(worlds, w, i)
        seen[w, place(worlds, b, i, Feature.kept)] = ti.cast(kept, ti.f32)
    else:
        seen[w, place(worlds, b, i, Feature.mean)] = 1.0


@ti.func
def see_way(worlds: ti.template(), w, b, i):
    """Write what the boat meets on its way to candidate i, and what lies around it and beyond."""
    p = ti.static(worlds.p)
    seen = ti.static(worlds.boat_workspace)
    count = worlds.estimate.shape[1]
    here = vec2(worlds.boat[w, b, BoatColumn.x], worlds.boat[w, b, BoatColumn.y])
    goal = goal_of(worlds, w, b, i)
    if i < count:
        goal = soon(worlds, w, i, (goal - here).norm() / p[Parameter.top_speed])
    lasts = ti.max((goal - here).norm() / p[Parameter.top_speed], INTERVAL)
    trip = lasts
    own = 0.0
    served = 0.0
    served_lost = 0.0
    around = 0.0
    onward = 0.0
    weight = 0.0
    for k in range(count):
        found = seen[w, place(worlds, b, k, Feature.here)]  # of an AUV that the boat does not serve all are 0
        until = 0.0
        for sample in range(SAMPLES):
            share = (ti.cast(sample, ti.f32) + 1.0) / SAMPLES
            until += (1.0 - found) * lasts / SAMPLES
            found = ti.max(found, heard(worlds, w, b, k, here + share * (goal - here), 1.0, share * lasts))
        if k == i:
            trip = until
            own = found * seen[w, place(worlds, b, k, Feature.later)]
        else:
            worth = seen[w, place(worlds, b, k, Feature.later)]
            apart = (belief_planner.foreseen_place(worlds, w, k) - goal).norm()
            served += found * worth
            served_lost += found * seen[w, place(worlds, b, k, Feature.lost)]
            around += worth / (1.0 + (apart / NEIGHBOURHOOD) ** 2)
            onward += (1.0 - found) * worth * apart
            weight += (1.0 - found) * worth
    seen[w, place(worlds, b, i, Feature.trip)] = ti.min(trip / TIME, FAR)
    seen[w, place(worlds, b, i, Feature.served)] = served
    seen[w, place(worlds, b, i, Feature.served_lost)] = served_lost
    seen[w, place(worlds, b, i, Feature.pays)] = (own + served) / (lasts / TIME + NEXT)
    seen[w, place(worlds, b, i, Feature.around)] = around
    time = onward / ti.max(weight, 1e-6) / p[Parameter.top_speed]
    seen[w, place(worlds, b, i, Feature.onward)] = ti.min(time / TIME, FAR)
    if i < count:
        works = belief_planner.works_within(worlds)
        seen[w, place(worlds, b, i, Feature.arrival)] = ti.sqrt(own_after(worlds, w, i, trip)) / works


@ti.func
def see_future(worlds: ti.template(), w, b):
    """Write what rollouts expect of all candidates; the AUV least certain of itself has the margin of `belief`."""
    seen = ti.static(worlds.boat_workspace)
    count = worlds.estimate.shape[1]
    usual = belief_planner.least_certain(worlds, w, b)
    least = 1e30
    for i in range(count + 1):
        if is_candidate(worlds, w, b, i):
            first = ti.select(i < count, i, NOBODY)
            loss = belief_planner.expected_loss(worlds, w, b, first, goal_of(worlds, w, b, i))
            if i == usual:
                loss *= 1.0 - belief_planner.MARGIN
            seen[w, place(worlds, b, i, Feature.future)] = loss
            least = ti.min(least, loss)
    for i in range(count + 1):
        if is_candidate(worlds, w, b, i):
            loss = seen[w, place(worlds, b, i, Feature.future)]
            seen[w, place(worlds, b, i, Feature.future)] = ti.max(1.0 - loss / ti.max(least, 1e-6), -FAR)


@ti.func
def see_all(worlds: ti.template(), w, b):
    """Write what the boat sees of all candidates."""
    seen = ti.static(worlds.boat_workspace)
    count = worlds.estimate.shape[1]
    own = 0.0
    most = 0.0
    lost = 0.0
    for i in range(count + 1):
        for f in range(FEATURES + 1):
            seen[w, place(worlds, b, i, f)] = 0.0
        if is_candidate(worlds, w, b, i):
            see(worlds, w, b, i)
        own += seen[w, place(worlds, b, i, Feature.own)] / serving.num_served(worlds, w, b)
        most = ti.max(most, seen[w, place(worlds, b, i, Feature.own)])
        lost += seen[w, place(worlds, b, i, Feature.lost)] / serving.num_served(worlds, w, b)
    for i in range(count + 1):
        if is_candidate(worlds, w, b, i):
            see_way(worlds, w, b, i)
            seen[w, place(worlds, b, i, Feature.all_own)] = own
            seen[w, place(worlds, b, i, Feature.most_own)] = most
            seen[w, place(worlds, b, i, Feature.all_lost)] = lost
    see_future(worlds, w, b)


@ti.func
def decide(worlds: ti.template(), w, b):
    """Choose the candidate with the largest score; while the boat learns, one drawn by exp(score)."""
    boat = ti.static(worlds.boat)
    see_all(worlds, w, b)
    count = worlds.estimate.shape[1]
    best = count
    most = -1e30
    for i in range(count + 1):
        if is_candidate(worlds, w, b, i):
            value = candidate_scores.score(
                NETWORK, worlds.strategy_arguments, WEIGHTS, worlds.boat_workspace, w, place(worlds, b, i, 0)
            )
            if worlds.strategy_arguments[EXPLORE] > 0.0:
                value += candidate_scores.gumbel(worlds, w, Draw.visit, b * (count + 1) + i)
            if value > most:
                best = i
                most = value
    worlds.boat_workspace[w, decision(worlds, b) + Decision.made] = 1.0
    worlds.boat_workspace[w, decision(worlds, b) + Decision.chosen] = ti.cast(best, ti.f32)
    goal = goal_of(worlds, w, b, best)
    boat[w, b, BoatColumn.goal_x] = goal[0]
    boat[w, b, BoatColumn.goal_y] = goal[1]
    boat[w, b, BoatColumn.visits] = ti.cast(ti.select(best < count, best, NOBODY), ti.f32)
    boat[w, b, BoatColumn.planned] = ti.cast(worlds.clock[w, 1], ti.f32) * worlds.p[Parameter.step]


@ti.func
def learned(worlds: ti.template(), w, b) -> vec2:
    """Where the AUV is foreseen that the last decision chose; the mean stays where it was then.

    Without an AUV the boat stays where it is.
    """
    goal = serving.place_of(worlds, w, b)
    for k in range(worlds.estimate.shape[1]):
        if serving.serves(worlds, w, b, k):
            belief_planner.foresee(worlds, w, k)
    if serving.num_served(worlds, w, b) > 0:
        if belief_planner.is_due(worlds, w, b, PATIENCE):
            decide(worlds, w, b)
        goal = belief_planner.aim(worlds, w, b)
    return goal


def decisions(workspace: torch.Tensor, num_auvs: int) -> torch.Tensor:
    """View (W, B, ·) of the latest decisions of all boats in `worlds.boat_workspace` (W, ·)."""
    return workspace.view(len(workspace), -1, NETWORK.decision(num_auvs + 1))


def workspace(num_auvs: int, num_boats: int) -> int:
    """The last decisions of all boats."""
    return num_boats * NETWORK.decision(num_auvs + 1)
