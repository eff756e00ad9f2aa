"""Beginning of an episode: vortices and AUVs in their places, and the errors that last."""

from typing import Any, NamedTuple

import taichi as ti

from usvauv.kernels import random
from usvauv.kernels.flow.vortex import Vortex
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.mission.auvs import motion, vehicles
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.columns import Draw, Flag, KeyColumn, Parameter, Schedule
from usvauv.kernels.mission.draws import address, key
from usvauv.kernels.mission.link import channel, fixes
from usvauv.kernels.mission.worlds import Numbers, Rows
from usvauv.kernels.types import array1, array2, array3, index1, index2

START_ATTEMPTS = 256


@func
def between(low, high, u):
    """The number at share u of the way from `low` to `high`."""
    return low + u * (high - low)


class VortexDraw(NamedTuple):
    """The part of `Worlds` that `place_vortices` reads."""

    p: Any
    flag: Any
    fixed_vortex: Any
    key: Any
    clock: Any


@func
def place_vortices(worlds: ti.template(), vortex: ti.template(), w):
    """Draw the vortices of an episode, or take the fixed ones, and their signs.

    Centres are uniform over the area, or over the square of a periodic pattern round its middle.
    """
    p = ti.static(worlds.p)
    width, length = p.width, p.length
    if p.period > 0.0:
        width = p.period
        length = width
    west, south = 0.5 * (p.width - width), 0.5 * (p.length - length)
    for v in range(vortex.shape[1]):
        if worlds.flag.random_vortices != 0:
            u = random.uniforms(address(worlds, w, worlds.clock[w, 1], Draw.vortex, v), key(worlds, w))
            vortex[w, v, Vortex.x] = west + u[0] * width
            vortex[w, v, Vortex.y] = south + u[1] * length
            vortex[w, v, Vortex.Gamma] = between(p.circulation_min, p.circulation_max, u[2])
            vortex[w, v, Vortex.delta] = between(p.core_radius_min, p.core_radius_max, u[3])
        else:
            for c in range(4):
                vortex[w, v, c] = worlds.fixed_vortex[v, c]
        if worlds.flag.alternate != 0:
            u = random.uniforms(address(worlds, w, worlds.clock[w, 1], Draw.vortex_sign, v), key(worlds, w))
            if u[0] < 0.5:
                vortex[w, v, Vortex.Gamma] = -vortex[w, v, Vortex.Gamma]


@kernel
def draw_vortices(p: array1, flag: index1, fixed_vortex: array2, key: index2, clock: index2, vortex: array3):
    """The vortices with which the present episode of each world begins, into `vortex` (W, V, 4)."""
    for w in range(vortex.shape[0]):
        draw = ti.static(
            VortexDraw(Numbers.of(p, Parameter), Numbers.of(flag, Flag), fixed_vortex, Rows.of(key, KeyColumn), clock)
        )
        place_vortices(draw, vortex, w)


@func
def place_auv(worlds: ti.template(), w, k):
    """Deploy AUV k at a random place apart from those before it; after `START_ATTEMPTS` tries at the last one."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    for c in range(auv.shape[2]):
        auv[w, k, c] = 0.0
    auv.target[w, k] = -1.0
    if ti.static(worlds.program.battery):
        auv.charge[w, k] = p.battery
    searching = True
    attempt = 0
    while searching:
        u = random.uniforms(address(worlds, w, attempt, Draw.auv, k), key(worlds, w))
        margin = p.start_margin
        x = margin + u[0] * (p.width - 2 * margin)
        y = margin + u[1] * (p.length - 2 * margin)
        auv.x[w, k] = x
        auv.y[w, k] = y
        searching = False
        for j in range(k):
            if motion.distance_between(worlds, w, j, k) < p.start_separation:
                searching = True
        attempt += 1
        if attempt == START_ATTEMPTS:
            searching = False


@func
def place_estimate(worlds: ti.template(), w, k):
    """Estimate AUV k where it is deployed, which is known."""
    estimate = ti.static(worlds.estimate)
    for c in range(estimate.shape[2]):
        estimate[w, k, c] = 0.0
    estimate.x[w, k] = worlds.auv.x[w, k]
    estimate.y[w, k] = worlds.auv.y[w, k]
    estimate.separation[w, k] = worlds.p.separation_boat


@func
def begin_episode(worlds: ti.template(), w):
    """Begin the next episode of world w: nodes, vortices and AUVs in their places, boats without one yet."""
    worlds.clock[w, 0] = worlds.clock[w, 0] + 1
    worlds.clock[w, 1] = 0
    worlds.program.task.place(worlds, w)
    place_vortices(worlds, worlds.water.vortex, w)
    for v in range(worlds.drift.shape[1]):
        for c in range(worlds.drift.shape[2]):
            worlds.drift[w, v, c] = 0.0
    for k in range(worlds.auv.shape[1]):
        place_auv(worlds, w, k)
        if ti.static(worlds.program.vehicle):
            vehicles.place(worlds, w, k)
        place_estimate(worlds, w, k)
    for c in range(worlds.tally.shape[1]):
        worlds.tally[w, c] = 0.0
    boat_motion.clear_boats(worlds, w)
    if ti.static(worlds.program.schedule != Schedule.every_step):
        channel.open_channel(worlds, w)
    for b in range(worlds.boat.shape[1]):
        fixes.draw_lasting_errors(worlds, w, b)
