"""One step of the data-collection mission, batched over worlds: one kernel, one loop iteration a world.

Everything in a world happens in program order inside its iteration and every random number is addressed by
(world, episode, step, draw), so a world's history does not depend on how many others run beside it or on threads.
"""

import taichi as ti

from kernels import acoustics, airy, fixes, random, regular_grid, task, vehicle
from kernels import boat as usv
from kernels.layout import (
    AuvColumn,
    BoatColumn,
    Draw,
    EstimateColumn,
    NodeColumn,
    Parameter,
    RewardTerm,
    array1,
    array2,
    array3,
    array4,
    index1,
    index2,
    vec2,
    vec3,
)


@ti.func
def distance_to_target(auv: ti.template(), node: ti.template(), w, k):
    """True horizontal distance from AUV k to its target node, m."""
    target = ti.cast(auv[w, k, AuvColumn.target], ti.i32)
    dx = node[w, target, NodeColumn.x] - auv[w, k, AuvColumn.x]
    dy = node[w, target, NodeColumn.y] - auv[w, k, AuvColumn.y]
    return ti.sqrt(dx * dx + dy * dy)


@ti.func
def begin_service(p: ti.template(), bed: ti.template(), auv: ti.template(), node: ti.template(), w, k, distance):
    """Fix the data to carry, the link's rate at this distance, and how long the AUV will hover for it."""
    target = ti.cast(auv[w, k, AuvColumn.target], ti.i32)
    x = node[w, target, NodeColumn.x]
    y = node[w, target, NodeColumn.y]
    depth = regular_grid.sample(bed, 0, 0, x, y, p[Parameter.width], p[Parameter.length])
    separation = depth - p[Parameter.cruise]
    slant = ti.sqrt(distance * distance + separation * separation)
    snr = p[Parameter.data_level] - acoustics.transmission_loss(slant, p[Parameter.data_frequency])
    law = ti.cast(p[Parameter.data_demonstration], ti.i32)
    rate = 1e-6 * acoustics.shannon_rate(p[Parameter.data_bandwidth], snr, law)
    cargo = p[Parameter.payload] * node[w, target, NodeColumn.backlog] / p[Parameter.buffer]
    auv[w, k, AuvColumn.rate] = rate
    auv[w, k, AuvColumn.cargo] = cargo
    auv[w, k, AuvColumn.hover] = ti.max(cargo / rate, 1e-3 * p[Parameter.step])


@ti.func
def move_auv(
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
    """One step of AUV k: hover and send, or travel with the current; its distance and power terms are raw here."""
    dt = p[Parameter.step]
    x = auv[w, k, AuvColumn.x]
    y = auv[w, k, AuvColumn.y]
    current = vec2(auv[w, k, AuvColumn.current_x], auv[w, k, AuvColumn.current_y])
    before = distance_to_target(auv, node, w, k)
    closed = 0.0
    auv[w, k, AuvColumn.moved_x] = 0.0
    auv[w, k, AuvColumn.moved_y] = 0.0
    auv[w, k, AuvColumn.border] = 0.0
    auv[w, k, AuvColumn.service_rate] = 0.0
    auv[w, k, AuvColumn.delivered] = 0.0
    auv[w, k, AuvColumn.hovering] = 0.0
    if auv[w, k, AuvColumn.hover] > 0.0:
        auv[w, k, AuvColumn.hovering] = 1.0
        auv[w, k, AuvColumn.water_x] = 0.0
        auv[w, k, AuvColumn.water_y] = 0.0
        auv[w, k, AuvColumn.power] = vehicle.hovering_power(current.norm())
        auv[w, k, AuvColumn.hover] = auv[w, k, AuvColumn.hover] - dt
        if auv[w, k, AuvColumn.hover] <= 0.0:
            auv[w, k, AuvColumn.hover] = 0.0
            auv[w, k, AuvColumn.service_rate] = auv[w, k, AuvColumn.rate]
            auv[w, k, AuvColumn.delivered] = auv[w, k, AuvColumn.cargo]
    else:
        velocity = vehicle.water_velocity(p, a0, a1)
        auv[w, k, AuvColumn.water_x] = velocity[0]
        auv[w, k, AuvColumn.water_y] = velocity[1]
        auv[w, k, AuvColumn.power] = vehicle.travelling_power(velocity.norm())
        moved = vec2(x, y) + dt * (velocity + current)
        inside = moved[0] >= 0.0 and moved[0] <= p[Parameter.width]
        inside = inside and moved[1] >= 0.0 and moved[1] <= p[Parameter.length]
        if inside:
            auv[w, k, AuvColumn.x] = moved[0]
            auv[w, k, AuvColumn.y] = moved[1]
            auv[w, k, AuvColumn.moved_x] = moved[0] - x
            auv[w, k, AuvColumn.moved_y] = moved[1] - y
        else:
            auv[w, k, AuvColumn.border] = 1.0
        after = distance_to_target(auv, node, w, k)
        closed = before - after
        if after <= p[Parameter.hover_radius]:
            begin_service(p, bed, auv, node, w, k, after)
    if p[Parameter.progress] > 0.5:
        reward_terms[w, k, RewardTerm.distance] = closed
    else:
        reward_terms[w, k, RewardTerm.distance] = -distance_to_target(auv, node, w, k)


@ti.func
def fill_nodes(p: ti.template(), node: ti.template(), boat: ti.template(), key_low, key_high, w, episode, now):
    """Poisson arrivals at every node; count those whose full buffer lost packets."""
    overflowing = 0.0
    words = random.float4(0.0, 0.0, 0.0, 0.0)
    for i in range(node.shape[1]):
        part = i % 4
        if part == 0:
            words = random.uniforms(task.address(p, w, episode, now, Draw.arrival, i // 4), key_low, key_high)
        u = words[0]
        if part == 1:
            u = words[1]
        elif part == 2:
            u = words[2]
        elif part == 3:
            u = words[3]
        mean = node[w, i, NodeColumn.rate] * p[Parameter.step]
        backlog = node[w, i, NodeColumn.backlog] + random.poisson(mean, u)
        if backlog > p[Parameter.buffer]:
            backlog = p[Parameter.buffer]
            overflowing += 1.0
        node[w, i, NodeColumn.backlog] = backlog
    boat[w, BoatColumn.overflowing] = overflowing


@ti.func
def reward(
    p: ti.template(),
    auv: ti.template(),
    boat: ti.template(),
    estimate: ti.template(),
    reward_terms: ti.template(),
    total: ti.template(),
    w,
    k,
):
    """Weighted reward terms of AUV k, and their sum."""
    too_near = 0.0
    x = auv[w, k, AuvColumn.x]
    y = auv[w, k, AuvColumn.y]
    for j in range(auv.shape[1]):
        if j != k:
            apart = vec2(auv[w, j, AuvColumn.x] - x, auv[w, j, AuvColumn.y] - y).norm()
            too_near += ti.max(0.0, p[Parameter.safe_distance] - apart)
            if apart < p[Parameter.collision_distance] and j < k:
                boat[w, BoatColumn.collisions] = boat[w, BoatColumn.collisions] + 1.0
    dx = x - boat[w, BoatColumn.x]
    dy = y - boat[w, BoatColumn.y]
    slant = vec3(dx, dy, estimate[w, k, EstimateColumn.separation]).norm()
    served = 0.0
    if auv[w, k, AuvColumn.service_rate] > 0.0:
        served = 1.0
    distance = reward_terms[w, k, RewardTerm.distance]
    reward_terms[w, k, RewardTerm.distance] = p[Parameter.weight_distance] * distance
    reward_terms[w, k, RewardTerm.border] = p[Parameter.weight_border] * auv[w, k, AuvColumn.border]
    reward_terms[w, k, RewardTerm.overflow] = p[Parameter.weight_overflow] * boat[w, BoatColumn.overflowing]
    reward_terms[w, k, RewardTerm.proximity] = p[Parameter.weight_proximity] * too_near
    reward_terms[w, k, RewardTerm.service] = p[Parameter.weight_service] * served
    reward_terms[w, k, RewardTerm.power] = p[Parameter.weight_power] * auv[w, k, AuvColumn.power]
    reward_terms[w, k, RewardTerm.collaboration] = p[Parameter.weight_collaboration] * p[Parameter.farthest] / slant
    sum_of_terms = 0.0
    for r in range(reward_terms.shape[2]):
        sum_of_terms += reward_terms[w, k, r]
    total[w, k] = sum_of_terms


@ti.kernel
def step(
    options: ti.template(),
    p: array1,
    link: array2,
    layers: array2,
    key_low: ti.u32,
    key_high: ti.u32,
    eta: array4,
    U: array4,
    V: array4,
    unit_x: ti.f32,
    unit_y: ti.f32,
    wave: airy.waves,
    stream: array4,
    bed: array4,
    lane: index1,
    cells_x: ti.i32,
    cells_y: ti.i32,
    action: array3,
    clock: index2,
    auv: array3,
    node: array3,
    vortices: array3,
    boat: array2,
    estimate: array3,
    track: array3,
    observation: array3,
    reward_terms: array3,
    total: array2,
):
    """Advance every world by one mission step; `total` (W, K) is the reward, `reward_terms` (W, K, R) its parts."""
    for w in range(clock.shape[0]):
        episode = clock[w, 0]
        now = clock[w, 1] + 1
        clock[w, 1] = now
        num_auvs = auv.shape[1]
        for k in range(num_auvs):
            move_auv(p, bed, auv, node, reward_terms, w, k, action[w, k, 0], action[w, k, 1])
            if ti.static(options.tracker):
                fixes.predict(p, auv, estimate, track, w, k)
        usv.plan(p, link, options, boat, estimate, track, w)
        usv.move(p, boat, w)
        usv.ride(p, boat, eta, U, V, unit_x, unit_y, wave, stream, bed, lane, cells_x, cells_y, vortices, w)
        for k in range(num_auvs):
            fixes.take(p, link, layers, options, auv, boat, estimate, track, episode, now, key_low, key_high, w, k)
        fill_nodes(p, node, boat, key_low, key_high, w, episode, now)
        boat[w, BoatColumn.collisions] = 0.0
        for k in range(num_auvs):
            reward(p, auv, boat, estimate, reward_terms, total, w, k)
        for k in range(num_auvs):
            if auv[w, k, AuvColumn.service_rate] > 0.0:
                node[w, ti.cast(auv[w, k, AuvColumn.target], ti.i32), NodeColumn.backlog] = 0.0
                task.choose_target(p, auv, node, estimate, w, k)
        for k in range(num_auvs):
            task.observe(
                p, auv, node, boat, U, V, unit_x, unit_y, wave, stream, bed, lane, cells_x, cells_y, vortices,
                estimate, observation, w, k,
            )  # fmt: skip
            if ti.static(options.tracker):
                fixes.turn_to_next_step(p, auv, track, episode, now, key_low, key_high, w, k)
