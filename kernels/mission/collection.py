"""The task of collecting data: nodes fill, AUVs go to them, hover and take what they hold."""

import taichi as ti

from kernels import random
from kernels.flow import regular_grid
from kernels.mission import common, poisson_table, vehicle
from kernels.mission.columns import AuvColumn, BoatColumn, Draw, EstimateColumn, NodeColumn, Parameter, RewardTerm
from kernels.positioning import sonar_equation
from kernels.types import vec2


@ti.func
def place_nodes(p: ti.template(), kinds: ti.template(), node: ti.template(), key_low, key_high, w, episode):
    """Scatter the nodes of a new episode over the bed, with what has piled up in them."""
    num_kinds = kinds.shape[0]
    for i in range(node.shape[1]):
        u = random.uniforms(common.address(p, w, episode, 0, Draw.node, i), key_low, key_high)
        margin = p[Parameter.node_margin]
        node[w, i, NodeColumn.x] = margin + u[0] * (p[Parameter.width] - 2 * margin)
        node[w, i, NodeColumn.y] = margin + u[1] * (p[Parameter.length] - 2 * margin)
        kind = ti.min(ti.cast(u[2] * num_kinds, ti.i32), num_kinds - 1)
        node[w, i, NodeColumn.kind] = ti.cast(kind, ti.f32)
        node[w, i, NodeColumn.rate] = kinds[kind, poisson_table.RATE]
        node[w, i, NodeColumn.backlog] = ti.floor(u[3] * (p[Parameter.start_backlog] + 1.0))


@ti.func
def choose_target(p: ti.template(), auv: ti.template(), node: ti.template(), estimate: ti.template(), w, k):
    """Give AUV k the free node with the largest λ b/C − α d, d from its measured position.

    Its present target, the node it has just emptied, is not free: lying at no distance it would win again at once, and
    empty services would be counted without end.
    """
    best = -1
    best_value = -1e30
    for i in range(node.shape[1]):
        free = True
        for j in range(auv.shape[1]):
            if ti.cast(auv[w, j, AuvColumn.target], ti.i32) == i:
                free = False
        if free:
            dx = node[w, i, NodeColumn.x] - estimate[w, k, EstimateColumn.x]
            dy = node[w, i, NodeColumn.y] - estimate[w, k, EstimateColumn.y]
            value = node[w, i, NodeColumn.rate] * node[w, i, NodeColumn.backlog] / p[Parameter.buffer] - p[
                Parameter.distance_weight
            ] * ti.sqrt(dx * dx + dy * dy)
            if value > best_value:
                best = i
                best_value = value
    if best < 0:  # more AUVs than nodes: share the nearest by index
        best = k % node.shape[1]
    auv[w, k, AuvColumn.target] = ti.cast(best, ti.f32)


@ti.func
def begin_service(p: ti.template(), bed: ti.template(), auv: ti.template(), node: ti.template(), w, k, distance):
    """Fix the data to carry, the link's rate at this distance, and how long the AUV will hover for it."""
    target = ti.cast(auv[w, k, AuvColumn.target], ti.i32)
    x = node[w, target, NodeColumn.x]
    y = node[w, target, NodeColumn.y]
    depth = regular_grid.sample(bed, 0, 0, x, y, p[Parameter.width], p[Parameter.length])
    separation = depth - p[Parameter.cruise]
    slant = ti.sqrt(distance * distance + separation * separation)
    snr = p[Parameter.data_level] - sonar_equation.transmission_loss(slant, p[Parameter.data_frequency])
    law = ti.cast(p[Parameter.data_demonstration], ti.i32)
    rate = 1e-6 * sonar_equation.shannon_rate(p[Parameter.data_bandwidth], snr, law)
    cargo = p[Parameter.payload] * node[w, target, NodeColumn.backlog] / p[Parameter.buffer]
    auv[w, k, AuvColumn.rate] = rate
    auv[w, k, AuvColumn.cargo] = cargo
    auv[w, k, AuvColumn.hover] = ti.max(cargo / rate, 1e-3 * p[Parameter.step])


@ti.func
def move(
    p: ti.template(),
    bed: ti.template(),
    auv: ti.template(),
    node: ti.template(),
    reward_terms: ti.template(),
    w,
    k,
    a0,
    a1,
):
    """One step of AUV k: hover and send, or travel with the current; its distance term is raw here."""
    before = common.distance_to_target(auv, node, w, k)
    after = before
    common.forget_last_step(auv, w, k)
    if auv[w, k, AuvColumn.hover] > 0.0:
        current = vec2(auv[w, k, AuvColumn.current_x], auv[w, k, AuvColumn.current_y])
        auv[w, k, AuvColumn.hovering] = 1.0
        auv[w, k, AuvColumn.water_x] = 0.0
        auv[w, k, AuvColumn.water_y] = 0.0
        auv[w, k, AuvColumn.power] = vehicle.hovering_power(current.norm())
        auv[w, k, AuvColumn.hover] = auv[w, k, AuvColumn.hover] - p[Parameter.step]
        if auv[w, k, AuvColumn.hover] <= 0.0:
            auv[w, k, AuvColumn.hover] = 0.0
            auv[w, k, AuvColumn.service_rate] = auv[w, k, AuvColumn.rate]
            auv[w, k, AuvColumn.delivered] = auv[w, k, AuvColumn.cargo]
    else:
        common.travel(p, auv, w, k, a0, a1)
        after = common.distance_to_target(auv, node, w, k)
        if after <= p[Parameter.hover_radius]:
            begin_service(p, bed, auv, node, w, k, after)
    if p[Parameter.progress] > 0.5:
        reward_terms[w, k, RewardTerm.distance] = before - after
    else:
        reward_terms[w, k, RewardTerm.distance] = -after


@ti.func
def fill_nodes(
    p: ti.template(), kinds: ti.template(), node: ti.template(), boat: ti.template(), key_low, key_high, w, episode, now
):
    """Poisson arrivals at every node; count those whose full buffer lost packets."""
    overflowing = 0.0
    for group in range((node.shape[1] + 3) // 4):
        u = random.uniforms(common.address(p, w, episode, now, Draw.arrival, group), key_low, key_high)
        for part in ti.static(range(4)):
            i = 4 * group + part
            if i < node.shape[1]:
                kind = ti.cast(node[w, i, NodeColumn.kind], ti.i32)
                backlog = node[w, i, NodeColumn.backlog] + poisson_table.draw(kinds, kind, u[part])
                if backlog > p[Parameter.buffer]:
                    backlog = p[Parameter.buffer]
                    overflowing += 1.0
                node[w, i, NodeColumn.backlog] = backlog
    boat[w, BoatColumn.overflowing] = overflowing


@ti.func
def empty_served(p: ti.template(), auv: ti.template(), node: ti.template(), estimate: ti.template(), w):
    """Empty the nodes whose service was completed in this step, and send their AUVs on."""
    for k in range(auv.shape[1]):
        if auv[w, k, AuvColumn.service_rate] > 0.0:
            node[w, ti.cast(auv[w, k, AuvColumn.target], ti.i32), NodeColumn.backlog] = 0.0
            choose_target(p, auv, node, estimate, w, k)
