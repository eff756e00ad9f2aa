"""The demonstration's target rule."""

import taichi as ti

from usvauv.kernels.mission.columns import AuvColumn, Parameter
from usvauv.kernels.mission.target_rules.knowledge import is_free
from usvauv.kernels.mission.target_rules.rule import TargetRule
from usvauv.kernels.mission.target_rules.value import offset, urgency
from usvauv.kernels.types import vec3


@ti.func
def worth(worlds: ti.template(), w, k, i, alpha):
    """λ b/C − α d of node i for AUV k, d from its estimated position with the vertical separation of the boat."""
    across = offset(worlds, w, k, i)
    slant = vec3(across[0], across[1], worlds.p[Parameter.separation_boat]).norm()
    return urgency(worlds, w, k, i) - alpha * slant


@ti.func
def demonstration(worlds: ti.template(), w, k):
    """Of the K nodes with the largest λ b/C − α d, K the number of AUVs and d the slant distance, the free one of the
    lowest index; where none of them is free, the free one with the largest value. At first the K nodes with the largest
    λ b/C, the best to the last AUV.

    The targets of all AUVs are among the nodes compared: one that has just been emptied takes the place of another.
    """
    node = ti.static(worlds.node)
    count = worlds.auv.shape[1]
    alpha = worlds.rule_numbers[0]
    first = worlds.auv[w, k, AuvColumn.target] < 0
    if first:
        alpha = 0.0
    chosen = -1
    best = -1
    best_value = -1e30
    for i in range(node.shape[1]):
        if chosen < 0 and is_free(worlds, w, k, i):
            value = worth(worlds, w, k, i, alpha)
            if value > best_value:
                best = i
                best_value = value
            better = 0
            for j in range(node.shape[1]):
                other = worth(worlds, w, k, j, alpha)
                if j != i and (other > value or (other == value and j > i)):
                    better += 1
            if better == count - 1 - k or (not first and better < count):
                chosen = i
    if chosen < 0:
        chosen = best
    if chosen < 0:  # more AUVs than nodes: share the nearest by index
        chosen = k % node.shape[1]
    return chosen


DEMONSTRATION = TargetRule(demonstration, arguments=(("ALPHA", 0.05),))  # 1/(m s)
