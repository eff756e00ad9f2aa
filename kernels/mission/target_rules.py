"""Target rules: which node an AUV heads for next. A rule is a function (worlds, w, k) → index of a node."""

from collections.abc import Callable
from typing import Any

import taichi as ti

from kernels.mission.columns import AuvColumn, EstimateColumn, NodeColumn, Parameter
from kernels.registry import Registry

target_rules: Registry[Callable[..., Any]] = Registry("target rule")


@ti.func
def is_free(worlds: ti.template(), w, i):
    """Whether node i is no AUV's target, not even the one that it has just emptied.

    That one lies at no distance, so most rules would choose it again at once and empty services would count.
    """
    free = True
    for j in range(worlds.auv.shape[1]):
        if ti.cast(worlds.auv[w, j, AuvColumn.target], ti.i32) == i:
            free = False
    return free


@ti.func
def backlog_less_distance(worlds: ti.template(), w, k):
    """The free node with the largest λ b/C − α d, d from the AUV's estimated position (the paper's rule)."""
    p = ti.static(worlds.p)
    node = ti.static(worlds.node)
    best = -1
    best_value = -1e30
    for i in range(node.shape[1]):
        if is_free(worlds, w, i):
            dx = node[w, i, NodeColumn.x] - worlds.estimate[w, k, EstimateColumn.x]
            dy = node[w, i, NodeColumn.y] - worlds.estimate[w, k, EstimateColumn.y]
            value = node[w, i, NodeColumn.rate] * node[w, i, NodeColumn.backlog] / p[Parameter.buffer] - p[
                Parameter.distance_weight
            ] * ti.sqrt(dx * dx + dy * dy)
            if value > best_value:
                best = i
                best_value = value
    if best < 0:  # more AUVs than nodes: share the nearest by index
        best = k % node.shape[1]
    return best


target_rules.register("backlog-less-distance", backlog_less_distance)
