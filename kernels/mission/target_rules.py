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
def worth(worlds: ti.template(), w, k, i, alpha, separation):
    """λ b/C − α d of node i for AUV k; d from its estimated position with a vertical separation (m)."""
    node = ti.static(worlds.node)
    dx = node[w, i, NodeColumn.x] - worlds.estimate[w, k, EstimateColumn.x]
    dy = node[w, i, NodeColumn.y] - worlds.estimate[w, k, EstimateColumn.y]
    d = ti.sqrt(dx * dx + dy * dy + separation * separation)
    filling = node[w, i, NodeColumn.backlog] / worlds.p[Parameter.buffer]
    return node[w, i, NodeColumn.rate] * filling - alpha * d


@ti.func
def backlog_less_distance(worlds: ti.template(), w, k):
    """The free node with the largest λ b/C − α d, d horizontal (the paper's rule)."""
    node = ti.static(worlds.node)
    best = -1
    best_value = -1e30
    for i in range(node.shape[1]):
        if is_free(worlds, w, i):
            value = worth(worlds, w, k, i, worlds.p[Parameter.distance_weight], 0.0)
            if value > best_value:
                best = i
                best_value = value
    if best < 0:  # more AUVs than nodes: share the nearest by index
        best = k % node.shape[1]
    return best


@ti.func
def demonstration(worlds: ti.template(), w, k):
    """Of the K nodes with the largest λ b/C − α d, K the number of AUVs and d the slant distance, the free one of the
    lowest index; where none of them is free, the free one with the largest value. At first the K nodes with the largest
    λ b/C, the best to the last AUV.

    The targets of all AUVs are among the nodes compared: one that has just been emptied takes the place of another.
    """
    node = ti.static(worlds.node)
    count = worlds.auv.shape[1]
    separation = worlds.p[Parameter.separation_boat]  # the demonstration has one, to boat and nodes alike
    alpha = worlds.p[Parameter.distance_weight]
    first = worlds.auv[w, k, AuvColumn.target] < 0
    if first:
        alpha = 0.0
    chosen = -1
    best = -1
    best_value = -1e30
    for i in range(node.shape[1]):
        if chosen < 0 and is_free(worlds, w, i):
            value = worth(worlds, w, k, i, alpha, separation)
            if value > best_value:
                best = i
                best_value = value
            better = 0
            for j in range(node.shape[1]):
                other = worth(worlds, w, k, j, alpha, separation)
                if j != i and (other > value or (other == value and j > i)):
                    better += 1
            if better == count - 1 - k or (not first and better < count):
                chosen = i
    if chosen < 0:
        chosen = best
    if chosen < 0:  # more AUVs than nodes: share the nearest by index
        chosen = k % node.shape[1]
    return chosen


target_rules.register("demonstration", demonstration)
target_rules.register("backlog-less-distance", backlog_less_distance)
