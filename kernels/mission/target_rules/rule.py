"""The rules that choose the node of the largest value, and a rule from its name."""

from dataclasses import replace

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.choices import RULE_NUMBERS, TargetRule, rule_and_numbers, target_rules
from usvauv.kernels.mission.columns import Parameter
from usvauv.kernels.mission.target_rules import knowledge
from usvauv.kernels.types import vec2, vec3


@func
def nothing(worlds: ti.template(), w):
    """No preparation."""


@func
def unknown(worlds: ti.template(), w, i):
    """The node itself: the next one is not known in advance."""
    return i


def parse(text: str) -> tuple[TargetRule, tuple[float, ...]]:
    """A rule with all its functions, and its numbers, from "name", "name:number" or "name:number,number".

    Raises:
        ValueError: as `rule_and_numbers`.
    """
    name, numbers = rule_and_numbers(text)
    rule = target_rules[name]
    return replace(rule, prepare=rule.prepare or nothing, foreseen=rule.foreseen or unknown), numbers


BEYOND = 1e5  # above every distance in an area, m


@func
def offset(worlds: ti.template(), w, k, i):
    """From the estimated position of AUV k to node i, m."""
    return vec2(
        worlds.node.x[w, i] - worlds.estimate.x[w, k],
        worlds.node.y[w, i] - worlds.estimate.y[w, k],
    )


@func
def distance(worlds: ti.template(), w, k, i):
    """Horizontal distance from the estimated position of AUV k to node i, m."""
    return offset(worlds, w, k, i).norm()


@func
def travel_time(p: ti.template(), metres):
    """Time to come within the hover radius of a node at some distance, at the reference speed, s."""
    return ti.max(metres - p[Parameter.hover_radius], 0.0) / p[Parameter.reference_speed]


@func
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


@func
def urgency(worlds: ti.template(), w, k, i):
    """λ b/C, packets/s."""
    filling = knowledge.backlog(worlds, w, k, i, 0.0) / worlds.p.buffer
    return knowledge.rate(worlds, w, k, i) * filling


@func
def worth(worlds: ti.template(), w, k, i):
    """λ b/C − α d."""
    return urgency(worlds, w, k, i) - worlds.rule_numbers[0] * distance(worlds, w, k, i)


@func
def nearness(worlds: ti.template(), w, k, i):
    """Minus the distance, m; nodes with too few packets come after all others, the one that lacks least first."""
    packets = knowledge.backlog(worlds, w, k, i, 0.0)
    near = -distance(worlds, w, k, i)
    if packets < worlds.rule_numbers[0]:
        near = packets - worlds.rule_numbers[0] - BEYOND
    return near


@func
def data_per_time(worlds: ti.template(), w, k, i, overhead):
    """Packets expected at arrival over the time to get there and an overhead (s), packets/s."""
    travel = travel_time(worlds.p, distance(worlds, w, k, i))
    packets = knowledge.backlog(worlds, w, k, i, travel)
    return packets / (travel + overhead)


@func
def pace_of_data(worlds: ti.template(), w, k, i):
    """`data_per_time` with the rule's own overhead."""
    return data_per_time(worlds, w, k, i, worlds.rule_numbers[0])


@func
def greedy(worlds: ti.template(), w, k):
    """The node with the largest rate times filling, minus ALPHA times its distance, as in the paper.

    λ b/C − α d with the horizontal distance d.
    """
    return best_free(worlds, worth, w, k)


@func
def nearest(worlds: ti.template(), w, k):
    """The nearest node that has at least PACKETS."""
    return best_free(worlds, nearness, w, k)


@func
def rate(worlds: ti.template(), w, k):
    """The node with the most data per time to get there, with SECONDS added."""
    return best_free(worlds, pace_of_data, w, k)


GREEDY = TargetRule(greedy, **RULE_NUMBERS["greedy"]._asdict())
NEAREST = TargetRule(nearest, **RULE_NUMBERS["nearest"]._asdict())
RATE = TargetRule(rate, **RULE_NUMBERS["rate"]._asdict())


@func
def slant_worth(worlds: ti.template(), w, k, i, alpha):
    """λ b/C − α d of node i for AUV k, d from its estimated position with the vertical separation of the boat."""
    across = offset(worlds, w, k, i)
    slant = vec3(across[0], across[1], worlds.p.separation_boat).norm()
    return urgency(worlds, w, k, i) - alpha * slant


@func
def demonstration(worlds: ti.template(), w, k):
    """The rule of the paper's demonstration, with the slant distance.

    The free node of the lowest index among the K with the largest λ b/C − α d, K the number of AUVs and d the slant
    distance; where none of them is free, the free one with the largest value. At first the K nodes with the largest
    λ b/C, the best to the last AUV.

    The targets of all AUVs are among the nodes compared: one that has just been emptied takes the place of another.
    """
    node = ti.static(worlds.node)
    count = worlds.auv.shape[1]
    alpha = worlds.rule_numbers[0]
    first = worlds.auv.target[w, k] < 0
    if first:
        alpha = 0.0
    chosen = -1
    best = -1
    best_value = -1e30
    for i in range(node.shape[1]):
        if chosen < 0 and knowledge.is_free(worlds, w, k, i):
            value = slant_worth(worlds, w, k, i, alpha)
            if value > best_value:
                best = i
                best_value = value
            better = 0
            for j in range(node.shape[1]):
                other = slant_worth(worlds, w, k, j, alpha)
                if j != i and (other > value or (other == value and j > i)):
                    better += 1
            if better == count - 1 - k or (not first and better < count):
                chosen = i
    if chosen < 0:
        chosen = best
    if chosen < 0:  # more AUVs than nodes: share the nearest by index
        chosen = k % node.shape[1]
    return chosen


DEMONSTRATION = TargetRule(demonstration, **RULE_NUMBERS["demonstration"]._asdict())
