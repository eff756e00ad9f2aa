"""A target rule: the nearest free node. `usvauv eval --plugin target_rule.py --set nodes.target_rule=nearest`"""

import taichi as ti

from kernels.mission.columns import EstimateColumn, NodeColumn
from kernels.mission.target_rules import is_free, target_rules
from kernels.types import vec2


@ti.func
def nearest(worlds: ti.template(), w, k):
    best = k % worlds.node.shape[1]  # where no node is free
    least = 1e30
    for i in range(worlds.node.shape[1]):
        dx = worlds.node[w, i, NodeColumn.x] - worlds.estimate[w, k, EstimateColumn.x]
        dy = worlds.node[w, i, NodeColumn.y] - worlds.estimate[w, k, EstimateColumn.y]
        distance = vec2(dx, dy).norm()
        if is_free(worlds, w, i) and distance < least:
            best = i
            least = distance
    return best


target_rules.register("nearest", nearest)
