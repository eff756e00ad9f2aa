"""A rule that simulates, for each promising node, the data collected if all AUVs then continue with the rule `rate`.

It chooses the node after which most data are collected, as rollout policies do (Bertsekas, Tsitsiklis and Wu, 1997,
Journal of Heuristics 3, doi 10.1023/A:1009635226865). AUVs travel straight at the reference speed. Data are discounted
by exp(−t/T), up to t = 3 T: with a sharp end the choice would depend on which services are just before it.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.choices import RULE_NUMBERS, TargetRule
from usvauv.kernels.mission.columns import Information
from usvauv.kernels.mission.target_rules import knowledge
from usvauv.kernels.mission.target_rules.rule import data_per_time, travel_time
from usvauv.kernels.types import vec2

OVERHEAD = 10.0  # s, of the base rule `rate`
TIMES = 3.0  # T that are simulated
CANDIDATES = 12  # nodes that are tried, those with the largest value by the base rule
X, Y, READY, NUMBERS = 0, 1, 2, 3  # of a simulated AUV: where and when it is free, m and s from now


@func
def memory(worlds: ti.template(), j, column):
    """Place in the workspace of a number of the simulated AUV j; the nodes are before: when each is emptied, or −1."""
    return worlds.node.shape[1] + NUMBERS * j + column


@func
def travel(worlds: ti.template(), w, j, i):
    """Time that the simulated AUV j needs to node i, s."""
    apart = vec2(
        worlds.node.x[w, i] - worlds.workspace[w, memory(worlds, j, X)],
        worlds.node.y[w, i] - worlds.workspace[w, memory(worlds, j, Y)],
    ).norm()
    return travel_time(worlds.p, apart)


@func
def packets(worlds: ti.template(), w, k, i, t):
    """Packets that AUV k expects at node i at time t of the simulation; none where an AUV is on its way there."""
    emptied = worlds.workspace[w, i]
    there = 0.0
    if emptied < 0.0:
        there = knowledge.backlog(worlds, w, k, i, t)
    elif emptied <= t:
        there = ti.min(knowledge.rate(worlds, w, k, i) * (t - emptied), worlds.p.buffer)
    return there


@func
def serve(worlds: ti.template(), w, k, j, i):
    """The simulated AUV j goes to node i and serves it; returns the packets times exp(−t/T)."""
    p = ti.static(worlds.p)
    arrival = worlds.workspace[w, memory(worlds, j, READY)] + travel(worlds, w, j, i)
    taken = packets(worlds, w, k, i, arrival)
    hover = ti.max(taken * p.payload / (p.buffer * p.reference_rate), p.step)
    worlds.workspace[w, i] = arrival
    worlds.workspace[w, memory(worlds, j, X)] = worlds.node.x[w, i]
    worlds.workspace[w, memory(worlds, j, Y)] = worlds.node.y[w, i]
    worlds.workspace[w, memory(worlds, j, READY)] = arrival + hover
    return taken * ti.exp(-(arrival + hover) / worlds.rule_numbers[0])


@func
def begin(worlds: ti.template(), w, k, end):
    """Put the simulated AUVs where they are; those on their way arrive. Without communication AUV k is alone."""
    for i in range(worlds.node.shape[1]):
        worlds.workspace[w, i] = -1.0
    total = 0.0
    for j in range(worlds.auv.shape[1]):
        worlds.workspace[w, memory(worlds, j, X)] = worlds.estimate.x[w, j]
        worlds.workspace[w, memory(worlds, j, Y)] = worlds.estimate.y[w, j]
        worlds.workspace[w, memory(worlds, j, READY)] = 0.0
        target = ti.cast(worlds.auv.target[w, j], ti.i32)
        if ti.static(worlds.program.information == Information.own_visits):
            if j != k:
                worlds.workspace[w, memory(worlds, j, READY)] = end
        elif j != k and target >= 0:
            if worlds.auv.hover[w, j] > 0.0:
                worlds.workspace[w, target] = 0.0
                worlds.workspace[w, memory(worlds, j, READY)] = worlds.auv.hover[w, j]
            else:
                total += serve(worlds, w, k, j, target)
    return total


@func
def go_on(worlds: ti.template(), w, k, end):
    """All simulated AUVs go on by `rate` until `end`, the one that is free first next; returns the packets."""
    total = 0.0
    searching = True
    while searching:
        j = 0
        for other in range(1, worlds.auv.shape[1]):
            if worlds.workspace[w, memory(worlds, other, READY)] < worlds.workspace[w, memory(worlds, j, READY)]:
                j = other
        free = worlds.workspace[w, memory(worlds, j, READY)]
        searching = free < end
        if searching:
            best = -1
            most = 0.0
            for i in range(worlds.node.shape[1]):
                time = travel(worlds, w, j, i)
                value = packets(worlds, w, k, i, free + time) / (time + OVERHEAD)
                if value > most and knowledge.in_sector(worlds, w, k, i):
                    best = i
                    most = value
            if best < 0:
                worlds.workspace[w, memory(worlds, j, READY)] = end
            else:
                total += serve(worlds, w, k, j, best)
    return total


@func
def future(worlds: ti.template(), w, k, i):
    """Packets that all AUVs collect if AUV k goes to node i next, each times exp(−t/T)."""
    end = TIMES * worlds.rule_numbers[0]
    total = begin(worlds, w, k, end)
    total += serve(worlds, w, k, k, i)
    total += go_on(worlds, w, k, end)
    return total


@func
def next_best(worlds: ti.template(), w, k, last, last_value):
    """The free node with the largest value by the base rule after node `last`, and its value; −1 where there is none.

    Equal values are in the order of their nodes.
    """
    best = -1
    best_value = -1.0
    for i in range(worlds.node.shape[1]):
        value = data_per_time(worlds, w, k, i, OVERHEAD)
        later = value < last_value or (value == last_value and i > last)
        if later and value > best_value and knowledge.is_open(worlds, w, k, i):
            best = i
            best_value = value
    return best, best_value


@func
def rollout(worlds: ti.template(), w, k):
    """The free node after which all AUVs together are expected to collect most; they are simulated for some HORIZON."""
    best = -1
    most = -1.0
    last = -1
    last_value = 1e30
    for _ in range(CANDIDATES):
        candidate, value = next_best(worlds, w, k, last, last_value)
        last = candidate
        last_value = value
        if candidate >= 0:
            total = future(worlds, w, k, candidate)
            if total > most:
                best = candidate
                most = total
    if best < 0:
        best = k % worlds.node.shape[1]
    return best


def workspace(num_nodes: int, num_auvs: int) -> int:
    """When each node is emptied, and the numbers of each AUV."""
    return num_nodes + NUMBERS * num_auvs


ROLLOUT = TargetRule(rollout, workspace=workspace, **RULE_NUMBERS["rollout"]._asdict())
