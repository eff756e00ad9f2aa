"""How an AUV moves in a step."""

import taichi as ti

from usvauv.kernels.mission import vehicle
from usvauv.kernels.mission.columns import AuvColumn, NodeColumn, Parameter
from usvauv.kernels.types import vec2


@ti.func
def target_of(worlds: ti.template(), w, k):
    """Index of the node that AUV k heads for; one that a plugin has set wrong counts as the nearest index."""
    target = ti.cast(worlds.auv[w, k, AuvColumn.target], ti.i32)
    return ti.min(ti.max(target, 0), worlds.node.shape[1] - 1)


@ti.func
def distance_to_target(worlds: ti.template(), w, k):
    """True horizontal distance from AUV k to its target, m."""
    target = target_of(worlds, w, k)
    return vec2(
        worlds.node[w, target, NodeColumn.x] - worlds.auv[w, k, AuvColumn.x],
        worlds.node[w, target, NodeColumn.y] - worlds.auv[w, k, AuvColumn.y],
    ).norm()


@ti.func
def distance_between(worlds: ti.template(), w, j, k):
    """True horizontal distance between AUVs j and k, m."""
    return vec2(
        worlds.auv[w, j, AuvColumn.x] - worlds.auv[w, k, AuvColumn.x],
        worlds.auv[w, j, AuvColumn.y] - worlds.auv[w, k, AuvColumn.y],
    ).norm()


@ti.func
def travel(worlds: ti.template(), w, k, a0, a1):
    """Move AUV k for one step as its action commands and with the water; a move across the border is refused."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    velocity = vehicle.water_velocity(p, a0, a1)
    auv[w, k, AuvColumn.water_x] = velocity[0]
    auv[w, k, AuvColumn.water_y] = velocity[1]
    auv[w, k, AuvColumn.power] = vehicle.travelling_power(velocity.norm())
    x = auv[w, k, AuvColumn.x]
    y = auv[w, k, AuvColumn.y]
    current = vec2(auv[w, k, AuvColumn.current_x], auv[w, k, AuvColumn.current_y])
    moved = vec2(x, y) + p[Parameter.step] * (velocity + current)
    inside = moved[0] >= 0.0 and moved[0] <= p[Parameter.width]
    inside = inside and moved[1] >= 0.0 and moved[1] <= p[Parameter.length]
    if inside:
        auv[w, k, AuvColumn.x] = moved[0]
        auv[w, k, AuvColumn.y] = moved[1]
        auv[w, k, AuvColumn.moved_x] = moved[0] - x
        auv[w, k, AuvColumn.moved_y] = moved[1] - y
    else:
        auv[w, k, AuvColumn.border] = 1.0
        if p[Parameter.refused_hovers] > 0.5:
            auv[w, k, AuvColumn.power] = vehicle.hovering_power(current.norm())


@ti.func
def clear_last_step(worlds: ti.template(), w, k):
    """Clear what AUV k did in the step before."""
    auv = ti.static(worlds.auv)
    auv[w, k, AuvColumn.moved_x] = 0.0
    auv[w, k, AuvColumn.moved_y] = 0.0
    auv[w, k, AuvColumn.border] = 0.0
    auv[w, k, AuvColumn.service_rate] = 0.0
    auv[w, k, AuvColumn.delivered] = 0.0
    auv[w, k, AuvColumn.packets_delivered] = 0.0
    auv[w, k, AuvColumn.hovering] = 0.0
