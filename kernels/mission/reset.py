"""The start of an episode, batched over worlds."""

import taichi as ti

from kernels import random
from kernels.flow import airy
from kernels.mission import boat as usv
from kernels.mission import collection, common, fixes, station_keeping
from kernels.mission.columns import AuvColumn, BoatColumn, Draw, EstimateColumn, Parameter, Task
from kernels.planning import global_search
from kernels.types import array1, array2, array3, array4, index1, index2, mask1, vec2

START_ATTEMPTS = 256


@ti.kernel
def begin_episodes(
    options: ti.template(),
    p: array1,
    kinds: array2,
    link: array2,
    layers: array2,
    fixed_vortex: array2,
    key_low: ti.u32,
    key_high: ti.u32,
    chosen: mask1,
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
    clock: index2,
    auv: array3,
    node: array3,
    vortices: array3,
    boat: array2,
    estimate: array3,
    track: array3,
    observation: array3,
):
    """Begin the next episode of each chosen world: draw its nodes, vortices and AUVs, place the boat, take a first fix.

    AUVs are deployed at known places, so the boat starts where its strategy puts it for their true positions.
    """
    ti.loop_config(serialize=options.serial)
    for w in range(clock.shape[0]):
        if chosen[w] != 0:
            episode = clock[w, 0] + 1
            clock[w, 0] = episode
            clock[w, 1] = 0
            if ti.static(options.task == Task.collection):
                collection.place_nodes(p, kinds, node, key_low, key_high, w, episode)
            else:
                station_keeping.place_stations(p, node, key_low, key_high, w, episode)
            for v in range(vortices.shape[1]):
                if p[Parameter.random_vortices] > 0.5:
                    u = random.uniforms(common.address(p, w, episode, 0, Draw.vortex, v), key_low, key_high)
                    vortices[w, v, 0] = u[0] * p[Parameter.width]
                    vortices[w, v, 1] = u[1] * p[Parameter.length]
                    vortices[w, v, 2] = p[Parameter.circulation_min] + u[2] * (
                        p[Parameter.circulation_max] - p[Parameter.circulation_min]
                    )
                    vortices[w, v, 3] = p[Parameter.core_radius_min] + u[3] * (
                        p[Parameter.core_radius_max] - p[Parameter.core_radius_min]
                    )
                else:
                    for c in range(4):
                        vortices[w, v, c] = fixed_vortex[v, c]
                if p[Parameter.alternate] > 0.5:
                    u = random.uniforms(common.address(p, w, episode, 0, Draw.vortex_sign, v), key_low, key_high)
                    if u[0] < 0.5:
                        vortices[w, v, 2] = -vortices[w, v, 2]
            for k in range(auv.shape[1]):
                for c in range(auv.shape[2]):
                    auv[w, k, c] = 0.0
                auv[w, k, AuvColumn.target] = -1.0
                searching = True
                attempt = 0
                while searching:
                    draw = common.address(p, w, episode, attempt, Draw.auv, k)
                    u = random.uniforms(draw, key_low, key_high)
                    margin = p[Parameter.start_margin]
                    x = margin + u[0] * (p[Parameter.width] - 2 * margin)
                    y = margin + u[1] * (p[Parameter.length] - 2 * margin)
                    auv[w, k, AuvColumn.x] = x
                    auv[w, k, AuvColumn.y] = y
                    searching = False
                    for j in range(k):
                        apart = vec2(x - auv[w, j, AuvColumn.x], y - auv[w, j, AuvColumn.y]).norm()
                        if apart < p[Parameter.start_separation]:
                            searching = True
                    attempt += 1
                    if attempt == START_ATTEMPTS:
                        searching = False
                for c in range(estimate.shape[2]):
                    estimate[w, k, c] = 0.0
                estimate[w, k, EstimateColumn.x] = auv[w, k, AuvColumn.x]
                estimate[w, k, EstimateColumn.y] = auv[w, k, AuvColumn.y]
                estimate[w, k, EstimateColumn.separation] = p[Parameter.separation_boat]
                if ti.static(options.tracker):
                    fixes.begin_track(p, estimate, track, w, k)
            for c in range(boat.shape[1]):
                boat[w, c] = 0.0
            usv.head_for(p, boat, usv.destination(p, link, options, boat, estimate, global_search.ANYWHERE, w), w)
            boat[w, BoatColumn.x] = boat[w, BoatColumn.goal_x]
            boat[w, BoatColumn.y] = boat[w, BoatColumn.goal_y]
            usv.ride(p, boat, eta, U, V, unit_x, unit_y, wave, stream, bed, lane, cells_x, cells_y, vortices, w)
            array = fixes.posture(p, boat, w, episode, 0, key_low, key_high)
            for k in range(auv.shape[1]):
                fixes.take(
                    p, link, layers, options, auv, boat, array, estimate, track, episode, 0, key_low, key_high, w, k
                )
            for k in range(auv.shape[1]):
                if ti.static(options.task == Task.collection):
                    collection.choose_target(p, auv, node, estimate, w, k)
                else:
                    station_keeping.take_station(auv, w, k)
            for k in range(auv.shape[1]):
                common.observe(
                    p, auv, node, boat, U, V, unit_x, unit_y, wave, stream, bed, lane, cells_x, cells_y, vortices,
                    estimate, observation, w, k,
                )  # fmt: skip
                if ti.static(options.tracker):
                    fixes.turn_to_next_step(p, auv, track, episode, 0, key_low, key_high, w, k)
