"""A learned rule: a small network corrects the data that `rollout` predicts for each of its candidates.

    score_i = g f_i0 + w₂ · max(0, W₁ f_i + b₁)

f_i are the features of candidate i. The first, f_i0, is the data collected by `rollout` if the AUV goes to node i next,
minus those of the best candidate, in buffers: without training, the rule chooses by it alone. Features of the other
nodes are sums, so that the network works for any number of them. In training, a candidate is drawn by exp(score).

`rule_numbers` are T of the rollouts, `EXPLORE`, whether candidates are drawn, and the weights g, W₁, b₁ and w₂, from a
file that `usvauv train-targets` writes (`policies/decisions.py`). Each AUV's last decision stays in the workspace:
`Decision`, and for each node its features and whether it was a candidate.
"""

import json
from pathlib import Path

import taichi as ti
import torch

from usvauv.kernels.functions import func
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
from usvauv.kernels.mission.target_rules.rule import TargetRule, distance, travel_time
from usvauv.kernels.mission.worlds import uniforms
from usvauv.kernels.types import Columns, vec2

HORIZON = 40.0  # T of the rollouts, s
NEIGHBOURHOOD = 50.0  # m
TIME = 100.0  # s, the unit of times
FAR = 3.0  # times, beyond which all are alike
UNTRAINED = "untrained"  # in place of a file
GAIN = 60.0  # g before training; with less, what is drawn while it learns is far worse than the best
HIDDEN = 32
LARGEST_WEIGHT = 1e3
LARGEST_FILE = 1_000_000  # bytes


class Feature(Columns):
    """Features of a node for the network, of order one."""

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


class Decision(Columns):
    """The head of a decision; the features of each node, and whether it was a candidate, follow."""

    made: int  # 1; whoever reads it makes it 0
    chosen: int


FEATURES = len(Feature.names)
HEAD = len(Decision.names)
NUM_WEIGHTS = 1 + HIDDEN * (FEATURES + 2)
EXPLORE, WEIGHTS = 1, 2  # places in `rule_numbers` after T


def read_weights(text: str) -> tuple[float, ...]:
    """`rule_numbers` for the weights of a JSON file, or for those before training.

    Raises:
        ValueError: there is no such file, or it does not hold the numbers of this network.
    """
    weights: list[float] = []
    if text == UNTRAINED:
        weights = [GAIN, *(NUM_WEIGHTS - 1) * [0.0]]
    else:
        path = Path(text)
        try:
            if path.is_file() and path.stat().st_size <= LARGEST_FILE:  # a device may never end
                weights = [float(weight) for weight in json.loads(path.read_bytes())["weights"]]
        except (OSError, ValueError, TypeError, KeyError, ArithmeticError, RecursionError):
            weights = []
    if len(weights) != NUM_WEIGHTS or not all(abs(weight) <= LARGEST_WEIGHT for weight in weights):
        raise ValueError(f"learned:{text}: no weights of a learned rule; expected a file of `usvauv train-targets`")
    return (HORIZON, 0.0, *weights)


@func
def score(worlds: ti.template(), w, place):
    """The network's score of the candidate whose features begin at `place` in the workspace."""
    numbers = ti.static(worlds.rule_numbers)
    seen = ti.static(worlds.workspace)
    total = numbers[WEIGHTS] * seen[w, place + Feature.future]
    for h in range(HIDDEN):
        row = WEIGHTS + 1 + h * (FEATURES + 2)
        hidden = numbers[row + FEATURES]
        for f in ti.static(range(FEATURES)):
            hidden += numbers[row + f] * seen[w, place + f]
        total += numbers[row + FEATURES + 1] * ti.max(hidden, 0.0)
    return total


@func
def decision(worlds: ti.template(), k):
    """Place in the workspace of the decision of AUV k, after the numbers of the rollouts."""
    return rollout.expected(worlds, worlds.node.shape[1]) + k * (HEAD + worlds.node.shape[1] * (FEATURES + 1))


@func
def place(worlds: ti.template(), k, i, feature):
    """Place in the workspace of a feature of node i as AUV k saw it; `FEATURES`: whether node i was a candidate."""
    return decision(worlds, k) + HEAD + i * (FEATURES + 1) + feature


@func
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


@func
def uncertainty(worlds: ti.template(), w, k, i):
    """Standard deviation of the rate of node i over its mean, as a share of that at the start; 0 where it is known."""
    share = 0.0
    if ti.static(worlds.program.information > Information.rates):
        p = ti.static(worlds.p)
        b = knowledge.holder(worlds, k)
        exposure = knowledge.start_exposure(p)
        share = ti.sqrt(exposure / ti.max(worlds.belief[w, b, i, BeliefColumn.exposure], exposure))
    return share


@func
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


@func
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


@func
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


@func
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
            value = score(worlds, w, place(worlds, k, i, 0))
            if worlds.rule_numbers[EXPLORE] > 0.0:
                u = uniforms(worlds, w, Draw.decision, k * node.shape[1] + i)
                value -= ti.log(-ti.log(u[0]))
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
    return rollout.workspace(num_nodes, num_auvs) + num_auvs * (HEAD + num_nodes * (FEATURES + 1))


LEARNED = TargetRule(
    learned,
    workspace=workspace,
    read=read_weights,
    about="The node preferred by a network from `usvauv train-targets`",
)
