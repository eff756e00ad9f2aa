"""One step of a mission, batched over worlds: one kernel, one loop iteration a world.

Everything in a world happens in program order inside its iteration and every random number is addressed by
(world, episode, step, draw), so a world's history does not depend on how many others run beside it or on threads.
"""

import taichi as ti

from kernels.flow import airy
from kernels.mission import boat as usv
from kernels.mission import collection, common, fixes, station_keeping
from kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, Parameter, RewardTerm, Task
from kernels.types import array1, array2, array3, array4, index1, index2, vec2, vec3


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
    kinds: array2,
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
    ti.loop_config(serialize=options.serial)
    for w in range(clock.shape[0]):
        episode = clock[w, 0]
        now = clock[w, 1] + 1
        clock[w, 1] = now
        num_auvs = auv.shape[1]
        for k in range(num_auvs):
            if ti.static(options.task == Task.collection):
                collection.move(p, bed, auv, node, reward_terms, w, k, action[w, k, 0], action[w, k, 1])
            else:
                station_keeping.move(p, auv, node, reward_terms, w, k, action[w, k, 0], action[w, k, 1])
            if ti.static(options.tracker):
                fixes.predict(p, auv, estimate, track, w, k)
        usv.plan(p, link, options, boat, estimate, track, w)
        usv.move(p, boat, w)
        usv.ride(p, boat, eta, U, V, unit_x, unit_y, wave, stream, bed, lane, cells_x, cells_y, vortices, w)
        array = fixes.posture(p, boat, w, episode, now, key_low, key_high)
        for k in range(num_auvs):
            fixes.take(
                p, link, layers, options, auv, boat, array, estimate, track, episode, now, key_low, key_high, w, k
            )
        if ti.static(options.task == Task.collection):
            collection.fill_nodes(p, kinds, node, boat, key_low, key_high, w, episode, now)
        boat[w, BoatColumn.collisions] = 0.0
        for k in range(num_auvs):
            reward(p, auv, boat, estimate, reward_terms, total, w, k)
        if ti.static(options.task == Task.collection):
            collection.empty_served(p, auv, node, estimate, w)
        for k in range(num_auvs):
            common.observe(
                p, auv, node, boat, U, V, unit_x, unit_y, wave, stream, bed, lane, cells_x, cells_y, vortices,
                estimate, observation, w, k,
            )  # fmt: skip
            if ti.static(options.tracker):
                fixes.turn_to_next_step(p, auv, track, episode, now, key_low, key_high, w, k)
