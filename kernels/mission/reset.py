"""The start of an episode in one world."""

from typing import Any, NamedTuple

import taichi as ti

from usvauv.kernels import random
from usvauv.kernels.flow.vortex import Vortex
from usvauv.kernels.mission import boat, channel, fixes, navigation, observation, reception, serving
from usvauv.kernels.mission.columns import AuvColumn, Draw, EstimateColumn, Parameter, Schedule, Sensor
from usvauv.kernels.mission.motion import distance_between
from usvauv.kernels.mission.worlds import address, key, uniforms
from usvauv.kernels.types import array1, array2, array3, index2

START_ATTEMPTS = 256


@ti.func
def between(low, high, u):
    """The number at share u of the way from `low` to `high`."""
    return low + u * (high - low)


class VortexDraw(NamedTuple):
    """The part of `Worlds` that `place_vortices` reads."""

    p: Any
    fixed_vortex: Any
    key: Any
    clock: Any


@ti.func
def place_vortices(worlds: ti.template(), vortex: ti.template(), w):
    """Draw the vortices of an episode, or take the fixed ones, and their signs."""
    p = ti.static(worlds.p)
    for v in range(vortex.shape[1]):
        if p[Parameter.random_vortices] > 0.5:
            u = uniforms(worlds, w, Draw.vortex, v)
            vortex[w, v, Vortex.x] = u[0] * p[Parameter.width]
            vortex[w, v, Vortex.y] = u[1] * p[Parameter.length]
            vortex[w, v, Vortex.Gamma] = between(p[Parameter.circulation_min], p[Parameter.circulation_max], u[2])
            vortex[w, v, Vortex.delta] = between(p[Parameter.core_radius_min], p[Parameter.core_radius_max], u[3])
        else:
            for c in range(4):
                vortex[w, v, c] = worlds.fixed_vortex[v, c]
        if p[Parameter.alternate] > 0.5:
            u = uniforms(worlds, w, Draw.vortex_sign, v)
            if u[0] < 0.5:
                vortex[w, v, Vortex.Gamma] = -vortex[w, v, Vortex.Gamma]


@ti.kernel
def draw_vortices(p: array1, fixed_vortex: array2, key: index2, clock: index2, vortex: array3):
    """The vortices with which the present episode of each world begins, into `vortex` (W, V, 4)."""
    for w in range(vortex.shape[0]):
        place_vortices(ti.static(VortexDraw(p, fixed_vortex, key, clock)), vortex, w)


@ti.func
def place_auv(worlds: ti.template(), w, k):
    """Deploy AUV k at a random place apart from those before it; after `START_ATTEMPTS` tries at the last one."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    for c in range(auv.shape[2]):
        auv[w, k, c] = 0.0
    auv[w, k, AuvColumn.target] = -1.0
    searching = True
    attempt = 0
    while searching:
        u = random.uniforms(address(worlds, w, attempt, Draw.auv, k), key(worlds, w))
        margin = p[Parameter.start_margin]
        x = margin + u[0] * (p[Parameter.width] - 2 * margin)
        y = margin + u[1] * (p[Parameter.length] - 2 * margin)
        auv[w, k, AuvColumn.x] = x
        auv[w, k, AuvColumn.y] = y
        searching = False
        for j in range(k):
            if distance_between(worlds, w, j, k) < p[Parameter.start_separation]:
                searching = True
        attempt += 1
        if attempt == START_ATTEMPTS:
            searching = False


@ti.func
def begin_estimate(worlds: ti.template(), w, k):
    """Estimate AUV k where it is deployed, which is known."""
    estimate = ti.static(worlds.estimate)
    for c in range(estimate.shape[2]):
        estimate[w, k, c] = 0.0
    estimate[w, k, EstimateColumn.x] = worlds.auv[w, k, AuvColumn.x]
    estimate[w, k, EstimateColumn.y] = worlds.auv[w, k, AuvColumn.y]
    estimate[w, k, EstimateColumn.separation] = worlds.p[Parameter.separation_boat]


@ti.func
def begin_episode(worlds: ti.template(), w):
    """Begin the next episode of world w: place nodes, vortices, AUVs and boats, take a first fix, give targets."""
    num_auvs = worlds.auv.shape[1]
    worlds.clock[w, 0] = worlds.clock[w, 0] + 1
    worlds.clock[w, 1] = 0
    worlds.program.task.place(worlds, w)
    place_vortices(worlds, worlds.water.vortex, w)
    for k in range(num_auvs):
        place_auv(worlds, w, k)
        begin_estimate(worlds, w, k)
    for c in range(worlds.tally.shape[1]):
        worlds.tally[w, c] = 0.0
    boat.place(worlds, w)
    if ti.static(worlds.program.schedule != Schedule.every_step):
        channel.open_channel(worlds, w)
    for b in range(worlds.boat.shape[1]):
        boat.ride(worlds, w, b)
        boat.locate(worlds, w, b)
        pose = reception.array_pose(worlds, w, b)
        for k in range(num_auvs):
            if serving.serves(worlds, w, b, k):
                fixes.begin_estimate(worlds, pose, w, k)
                if ti.static(worlds.program.tracker):
                    navigation.begin_filter(worlds, worlds.track, w, k)
                if ti.static(worlds.program.sensor != Sensor.none):
                    navigation.begin(worlds, w, k)
                if ti.static(worlds.program.schedule == Schedule.every_step):
                    fixes.take_fix(worlds, pose, w, k)
                else:
                    channel.begin(worlds, pose, w, k)
    for k in range(num_auvs):
        worlds.program.task.assign(worlds, w, k)
    for k in range(num_auvs):
        observation.write(worlds, w, k)
        if ti.static(worlds.program.tracker):
            fixes.prepare_next_step(worlds, w, k)
