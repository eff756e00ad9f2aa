"""A learned rule: a small network corrects what `rollout` expects of each of its candidates.

The network is that of `usvauv.kernels.mission.candidate_scores`; its first feature is what comes in by `rollout` if the
AUV goes to the node next, less the same of the best candidate, in buffers. Weights come from a file that
`usvauv train-targets` writes (`policies/decisions`).
"""

import taichi as ti
import torch

from usvauv.kernels.mission import candidate_scores
from usvauv.kernels.mission.candidate_scores import HEAD, Decision, Network
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BeliefColumn,
    Draw,
    EstimateColumn,
    Information,
    NodeColumn,
    Parameter,
)
from usvauv.kernels.mission.target_rules import knowledge, rollout
from usvauv.kernels.mission.target_rules.rule import TargetRule
from usvauv.kernels.mission.target_rules.value import distance, travel_time
from usvauv.kernels.types import Columns, vec2

HORIZON = 40.0  # T of the rollouts, s
NEIGHBOURHOOD = 50.0  # m
TIME = 100.0  # s, the unit of times
FAR = 3.0  # times, beyond which all are alike


class Feature(Columns):
    """What the network sees of a node, of order one."""

    future: int  # F, −1 of other nodes than candidates
    travel: int  # time to it
    backlog: int  # expected at arrival, buffers
    rate: int  # expected, over the mean of all
    uncertainty: int  # of the rate: standard deviation over that at the start, 0 where rates are known
    waited: int  # time since it was last visited
    other: int  # time at which another AUV could be there; `FAR` without communication
    lead: int  # by which this AUV would be there before
    near_backlog: int  # of free nodes around it, buffers
    near_uncertainty: int
    all_backlog: int  # of all free nodes, mean
    all_uncertainty: int
    left: int  # of the mission, share
    end: int  # exp(−time left)


FEATURES = len(Feature.names)
NETWORK = Network(FEATURES, Feature.future, 60.0, "rule", "train-targets")
EXPLORE, WEIGHTS = 1, 2  # places in `rule_numbers` after T


def read_weights(text: str) -> tuple[float, ...]:
    """`rule_numbers` for the weights of a JSON file, or for those before training; raises ValueError."""
    return (HORIZON, 0.0, *NETWORK.read(text))


@ti.func
def decision(worlds: ti.template(), k):
    """Place in the workspace of the decision of AUV k, after the numbers of the rollouts."""
    return rollout.expected(worlds, worlds.node.shape[1]) + k * (HEAD + worlds.node.shape[1] * (FEATURES + 1))


@ti.func
def place(worlds: ti.template(), k, i, feature):
    """Place in the workspace of a feature of node i as AUV k saw it; `FEATURES`: whether node i was a candidate."""
    return decision(worlds, k) + HEAD + i * (FEATURES + 1) + feature


@ti.func
def other_arrival(worlds: ti.template(), w, k, i):
    """When the first of the other AUVs could be at node i after its service, s; far away without communication."""
    first = FAR * TIME
    if ti.static(worlds.program.information != Information.own_visits):
        for j in range(worlds.auv.shape[1]):
            if j != k:
                x = worlds.estimate[w, j, EstimateColumn.x]
                y = worlds.estimate[w, j, EstimateColumn.y]
                ready = worlds.auv[w, j, AuvColumn.hover]
                target = ti.cast(worlds.auv[w, j, AuvColumn.target], ti.i32)
                if target >= 0 and ready == 0.0:
                    ready = travel_time(worlds.p, distance(worlds, w, j, target))
                    x = worlds.node[w, target, NodeColumn.x]
                    y = worlds.node[w, target, NodeColumn.y]
                apart = vec2(worlds.node[w, i, NodeColumn.x] - x, worlds.node[w, i, NodeColumn.y] - y).norm()
                first = ti.min(first, ready + travel_time(worlds.p, apart))
    return first


@ti.func
def uncertainty(worlds: ti.template(), w, k, i):
    """Standard deviation of the rate of node i over its mean, as a share of that at the start; 0 where it is known."""
    share = 0.0
    if ti.static(worlds.program.information > Information.rates):
        p = ti.static(worlds.p)
        b = knowledge.holder(worlds, k)
        exposure = knowledge.start_exposure(p)
        share = ti.sqrt(exposure / ti.max(worlds.belief[w, b, i, BeliefColumn.exposure], exposure))
    return share


@ti.func
def see(worlds: ti.template(), w, k, i):
    """Write what AUV k sees of node i for itself."""
    p = ti.static(worlds.p)
    work = ti.static(worlds.workspace)
    travel = travel_time(p, distance(worlds, w, k, i))
    packets = knowledge.backlog(worlds, w, k, i, travel)
    other = other_arrival(worlds, w, k, i)
    b = knowledge.holder(worlds, k)
    waited = knowledge.time(worlds, w) - worlds.belief[w, b, i, BeliefColumn.since]
    left = p[Parameter.duration] - knowledge.time(worlds, w)
    work[w, place(worlds, k, i, Feature.travel)] = ti.min(travel / TIME, FAR)
    work[w, place(worlds, k, i, Feature.backlog)] = packets / p[Parameter.buffer]
    work[w, place(worlds, k, i, Feature.rate)] = ti.min(
        knowledge.rate(worlds, w, k, i) / ti.max(p[Parameter.rate_mean], 1e-6), FAR
    )
    work[w, place(worlds, k, i, Feature.uncertainty)] = uncertainty(worlds, w, k, i)
    work[w, place(worlds, k, i, Feature.waited)] = ti.min(waited / TIME, FAR) / FAR
    work[w, place(worlds, k, i, Feature.other)] = ti.min(other / TIME, FAR)
    work[w, place(worlds, k, i, Feature.lead)] = ti.math.clamp((other - travel) / TIME, -FAR, FAR)
    work[w, place(worlds, k, i, Feature.left)] = left / p[Parameter.duration]
    work[w, place(worlds, k, i, Feature.end)] = ti.exp(-left / TIME)
    work[w, place(worlds, k, i, FEATURES)] = ti.cast(knowledge.is_open(worlds, w, k, i), ti.f32)


@ti.func
def see_around(worlds: ti.template(), w, k):
    """Write what AUV k sees around each node and of all nodes; a node counts by 1/(1 + (d/50 m)²)."""
    node = ti.static(worlds.node)
    work = ti.static(worlds.workspace)
    count = node.shape[1]
    all_backlog = 0.0
    all_uncertainty = 0.0
    for j in range(count):
        all_backlog += work[w, place(worlds, k, j, Feature.backlog)] * work[w, place(worlds, k, j, FEATURES)]
        all_uncertainty += work[w, place(worlds, k, j, Feature.uncertainty)]
    for i in range(count):
        near_backlog = 0.0
        near_uncertainty = 0.0
        for j in range(count):
            if j != i and work[w, place(worlds, k, j, FEATURES)] > 0.0:
                dx = node[w, j, NodeColumn.x] - node[w, i, NodeColumn.x]
                dy = node[w, j, NodeColumn.y] - node[w, i, NodeColumn.y]
                weight = 1.0 / (1.0 + (dx * dx + dy * dy) / (NEIGHBOURHOOD * NEIGHBOURHOOD))
                near_backlog += weight * work[w, place(worlds, k, j, Feature.backlog)]
                near_uncertainty += weight * work[w, place(worlds, k, j, Feature.uncertainty)]
        work[w, place(worlds, k, i, Feature.near_backlog)] = 0.5 * near_backlog
        work[w, place(worlds, k, i, Feature.near_uncertainty)] = 0.25 * near_uncertainty
        work[w, place(worlds, k, i, Feature.all_backlog)] = 3.0 * all_backlog / count
        work[w, place(worlds, k, i, Feature.all_uncertainty)] = all_uncertainty / count


@ti.func
def see_future(worlds: ti.template(), w, k):
    """Write what `rollout` expects of its candidates; only these are free from now on."""
    work = ti.static(worlds.workspace)
    best = rollout.try_candidates(worlds, w, k)
    for i in range(worlds.node.shape[1]):
        total = work[w, rollout.expected(worlds, i)]
        tried = total >= 0.0
        work[w, place(worlds, k, i, Feature.future)] = -1.0
        if tried:
            most = work[w, rollout.expected(worlds, best)]
            work[w, place(worlds, k, i, Feature.future)] = (total - most) / worlds.p[Parameter.buffer]
        work[w, place(worlds, k, i, FEATURES)] = ti.cast(tried, ti.f32)


@ti.func
def learned(worlds: ti.template(), w, k):
    """The candidate with the largest score; while it learns, one drawn by exp(score) (Gumbel's trick)."""
    node = ti.static(worlds.node)
    for i in range(node.shape[1]):
        see(worlds, w, k, i)
    see_around(worlds, w, k)
    see_future(worlds, w, k)
    best = -1
    most = -1e30
    for i in range(node.shape[1]):
        if worlds.workspace[w, place(worlds, k, i, FEATURES)] > 0.0:
            value = candidate_scores.score(
                NETWORK, worlds.rule_numbers, WEIGHTS, worlds.workspace, w, place(worlds, k, i, 0)
            )
            if worlds.rule_numbers[EXPLORE] > 0.0:
                value += candidate_scores.gumbel(worlds, w, Draw.decision, k * node.shape[1] + i)
            if value > most:
                best = i
                most = value
    free = best >= 0
    if not free:
        best = k % node.shape[1]
    worlds.workspace[w, decision(worlds, k) + Decision.made] = ti.cast(free, ti.f32)
    worlds.workspace[w, decision(worlds, k) + Decision.chosen] = ti.cast(best, ti.f32)
    return best


def decisions(workspace: torch.Tensor, num_nodes: int, num_auvs: int) -> torch.Tensor:
    """View (W, K, ·) of the latest decisions of all AUVs in `worlds.workspace` (W, ·)."""
    return workspace[:, rollout.workspace(num_nodes, num_auvs) :].view(len(workspace), num_auvs, -1)


def workspace(num_nodes: int, num_auvs: int) -> int:
    """The numbers of the rollouts, and the decisions of all AUVs."""
    return rollout.workspace(num_nodes, num_auvs) + num_auvs * NETWORK.decision(num_nodes)


LEARNED = TargetRule(learned, workspace=workspace, read=read_weights)
