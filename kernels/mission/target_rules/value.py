"""Rules that give each free node a value, and choose the largest: greedy, nearest, rate."""

import taichi as ti

from usvauv.kernels.mission.columns import EstimateColumn, NodeColumn, Parameter
from usvauv.kernels.mission.target_rules import knowledge
from usvauv.kernels.mission.target_rules.rule import TargetRule
from usvauv.kernels.types import vec2

FAR = 1e5  # above every distance in an area, m


@ti.func
def offset(worlds: ti.template(), w, k, i):
    """From the estimated position of AUV k to node i, m."""
    return vec2(
        worlds.node[w, i, NodeColumn.x] - worlds.estimate[w, k, EstimateColumn.x],
        worlds.node[w, i, NodeColumn.y] - worlds.estimate[w, k, EstimateColumn.y],
    )


@ti.func
def distance(worlds: ti.template(), w, k, i):
    """Horizontal distance from the estimated position of AUV k to node i, m."""
    return offset(worlds, w, k, i).norm()


@ti.func
def travel_time(p: ti.template(), metres):
    """Time to come within the hover radius of a node at some distance, at the reference speed, s."""
    return ti.max(metres - p[Parameter.hover_radius], 0.0) / p[Parameter.reference_speed]


@ti.func
def best_free(worlds: ti.template(), value: ti.template(), w, k):
    """The free node with the largest value(worlds, w, k, i); where none is free, AUVs share nodes by index."""
    best = -1
    best_value = -1e30
    for i in range(worlds.node.shape[1]):
        if knowledge.is_open(worlds, w, k, i):
            this = value(worlds, w, k, i)
            if this > best_value:
                best = i
                best_value = this
    if best < 0:
        best = k % worlds.node.shape[1]
    return best


@ti.func
def urgency(worlds: ti.template(), w, k, i):
    """λ b/C, packets/s."""
    filling = knowledge.backlog(worlds, w, k, i, 0.0) / worlds.p[Parameter.buffer]
    return knowledge.rate(worlds, w, k, i) * filling


@ti.func
def worth(worlds: ti.template(), w, k, i):
    """λ b/C − α d."""
    return urgency(worlds, w, k, i) - worlds.rule_numbers[0] * distance(worlds, w, k, i)


@ti.func
def nearness(worlds: ti.template(), w, k, i):
    """Minus the distance, m; nodes with too few packets come after all others, the one that lacks least first."""
    packets = knowledge.backlog(worlds, w, k, i, 0.0)
    near = -distance(worlds, w, k, i)
    if packets < worlds.rule_numbers[0]:
        near = packets - worlds.rule_numbers[0] - FAR
    return near


@ti.func
def data_per_time(worlds: ti.template(), w, k, i, overhead):
    """Packets expected at arrival over the time to get there and an overhead (s), packets/s."""
    travel = travel_time(worlds.p, distance(worlds, w, k, i))
    packets = knowledge.backlog(worlds, w, k, i, travel)
    return packets / (travel + overhead)


@ti.func
def pace_of_data(worlds: ti.template(), w, k, i):
    """`data_per_time` with the rule's own overhead."""
    return data_per_time(worlds, w, k, i, worlds.rule_numbers[0])


@ti.func
def greedy(worlds: ti.template(), w, k):
    """The paper's rule with the horizontal distance."""
    return best_free(worlds, worth, w, k)


@ti.func
def nearest(worlds: ti.template(), w, k):
    """The nearest node that has some packets."""
    return best_free(worlds, nearness, w, k)


@ti.func
def rate(worlds: ti.template(), w, k):
    """The node with the most data per time."""
    return best_free(worlds, pace_of_data, w, k)


GREEDY = TargetRule(greedy, arguments=(("ALPHA", 0.015),))  # 1/(m s)
NEAREST = TargetRule(nearest, arguments=(("PACKETS", 1000.0),))
RATE = TargetRule(rate, arguments=(("SECONDS", 10.0),))
