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
def worth(worlds: ti.template(), w, k, i, separation):
    """λ b/C − α d of node i for AUV k; d from its estimated position with a vertical separation (m)."""
    p = ti.static(worlds.p)
    node = ti.static(worlds.node)
    dx = node[w, i, NodeColumn.x] - worlds.estimate[w, k, EstimateColumn.x]
    dy = node[w, i, NodeColumn.y] - worlds.estimate[w, k, EstimateColumn.y]
    d = ti.sqrt(dx * dx + dy * dy + separation * separation)
    filling = node[w, i, NodeColumn.backlog] / p[Parameter.buffer]
    return node[w, i, NodeColumn.rate] * filling - p[Parameter.distance_weight] * d


@ti.func
def backlog_less_distance(worlds: ti.template(), w, k):
    """The free node with the largest λ b/C − α d, d horizontal (the paper's rule)."""
    node = ti.static(worlds.node)
    best = -1
    best_value = -1e30
    for i in range(node.shape[1]):
        if is_free(worlds, w, i):
            value = worth(worlds, w, k, i, 0.0)
            if value > best_value:
                best = i
                best_value = value
    if best < 0:  # more AUVs than nodes: share the nearest by index
        best = k % node.shape[1]
    return best


@ti.func
def demonstration(worlds: ti.template(), w, k):
    """Of the two nodes with the largest λ b/C − α d besides the old target, d the slant distance, the one of the lower
    index that is no other AUV's target; where both are, the best free node.
    """
    node = ti.static(worlds.node)
    separation = worlds.p[Parameter.separation_boat]  # the demonstration has one, to boat and nodes alike
    old = ti.cast(worlds.auv[w, k, AuvColumn.target], ti.i32)
    first = -1
    second = -1
    free = -1
    first_value = -1e30
    second_value = -1e30
    free_value = -1e30
    for i in range(node.shape[1]):
        value = worth(worlds, w, k, i, separation)
        if is_free(worlds, w, i) and value > free_value:
            free = i
            free_value = value
        if i != old and value > first_value:
            second = first
            second_value = first_value
            first = i
            first_value = value
        elif i != old and value > second_value:
            second = i
            second_value = value
    lower = ti.min(first, second)
    upper = ti.max(first, second)
    best = free
    if upper >= 0 and is_free(worlds, w, upper):
        best = upper
    if lower >= 0 and is_free(worlds, w, lower):
        best = lower
    if best < 0:  # more AUVs than nodes: share the nearest by index
        best = k % node.shape[1]
    return best


target_rules.register("demonstration", demonstration)
target_rules.register("backlog-less-distance", backlog_less_distance)
