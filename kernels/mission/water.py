"""The water in a mission: vortices that move, and what the AUVs and boats feel of it where they are.

The velocity of the water at AUVs and boats, by vortices or files, by long waves and by the storm, carries them during
the coming step.
"""

import math

import taichi as ti

from usvauv.kernels.flow import airy, at_depth, current, vortex, vortex_motion
from usvauv.kernels.flow.vortex import PLACES, places
from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs import vehicles
from usvauv.kernels.mission.auvs.reckoning import offset_to_target_from_estimate
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.mission.worlds import worlds_per_block
from usvauv.kernels.types import Level, vec2, vec3

# A horizontal current profiler measures on beams towards the target and BEAM_ANGLE to its right and left, at
# PROFILE_CELLS distances BEAM_CELL apart.
BEAMS, BEAM_ANGLE = 3, 1.0  # rad
PROFILE_CELLS, BEAM_CELL = 2, 25.0  # m
PROFILE_POINTS = BEAMS * PROFILE_CELLS
# From an AUV, ahead and to the left, m: itself, its profiler's points, and one to spare.
AHEAD, LEFT = (
    [0.0, *(BEAM_CELL * (n // BEAMS + 1) * f(BEAM_ANGLE * (n % BEAMS - 1)) for n in range(PROFILE_POINTS)), 0.0]
    for f in (math.cos, math.sin)
)


@func
def move_vortices(worlds: ti.template(), n):
    """The vortices of the worlds of iteration n move and spread; find out where their motion is then to be renewed."""
    if ti.static(worlds.program.vortices_move):
        p = ti.static(worlds.p)
        middle = vec2(0.5 * p.width, 0.5 * p.length)
        scale, period = p.eddy_scale, p.period
        step = ti.static(vortex_motion.Moving(p.step, p.viscosity, scale, period, middle))
        repeats = ti.static(worlds.program.repeats)
        count = ti.static(worlds_per_block(worlds.program))
        first, last = count * n, ti.min(count * (n + 1), worlds.clock.shape[0])
        if ti.static(worlds.program.in_lanes):
            each = 4 * worlds.vortex.shape[1]
            lanes = ti.static(airy.LANES)
            for row in range(first * each // lanes, (last * each + lanes - 1) // lanes):
                vortex_motion.move_side_by_side(worlds.vortex_rows, worlds.drift_rows, row, step, repeats)
        else:
            for v in range(worlds.vortex.shape[1]):
                vortex_motion.move(worlds.vortex, worlds.drift, first, v, step, repeats)
        renewal = ti.cast(p.renewal, ti.i32)
        for w in range(first, last):
            if worlds.due[0] == 0 and (worlds.clock[w, 1] + 1) % renewal == 0:
                worlds.due[0] = 1


@func
def add_storm_current(worlds: ti.template(), w, k):
    """Store the storm's velocity at AUV k, to which `add_current` adds; a vehicle senses it by itself."""
    water = ti.static(worlds.water)
    if ti.static(not worlds.program.vehicle):
        x, y = worlds.auv.x[w, k], worlds.auv.y[w, k]
        sea = water.sea_index[w]
        storm = airy.motion(water.wave, water.since, sea, water.felt[sea], Level.cruise, x, y)
        worlds.auv.current_x[w, k] = storm[3]
        worlds.auv.current_y[w, k] = storm[4]


@func
def carry_along(worlds: ti.template(), w, k, velocity: vec2):
    """Add what carries AUV k besides the storm, m/s."""
    for axis in ti.static(range(2)):
        column = ti.static(AuvColumn.current_x + axis)
        worlds.auv[w, k, column] = worlds.auv[w, k, column] + velocity[axis]


@func
def current_profile(worlds: ti.template(), w, k, first):
    """Components of the current, without waves, at the points of the profiler: a term of an observation."""
    for n in ti.static(range(2 * PROFILE_POINTS)):
        worlds.observation[w, k, first + n] = worlds.profile[w, k, n]


@func
def profiled(worlds: ti.template(), w, k):
    """AUV k, the points of its profiler, and the boat of the same number, or the last one, side by side: x, y, m."""
    towards = offset_to_target_from_estimate(worlds, w, k)
    bearing = vec2(1.0, 0.0)
    if towards.norm() > 1e-9:
        bearing = towards.normalized()
    ahead, left = ti.Vector(ti.static(AHEAD)), ti.Vector(ti.static(LEFT))
    x = worlds.auv.x[w, k] + ahead * bearing[0] - left * bearing[1]
    y = worlds.auv.y[w, k] + left * bearing[0] + ahead * bearing[1]
    boat = boat_motion.boat_place(worlds, w, ti.min(k, worlds.boat.shape[1] - 1))
    x[PLACES - 1], y[PLACES - 1] = boat[0], boat[1]
    return x, y


@func
def take_profile(worlds: ti.template(), w, k, x: places, y: places, u: places, v: places):
    """Make a profile of AUV k, its own current and that of the boat of the same number of the vortices' velocity.

    Args:
        x, y: of `profiled`. u, v: of vortices at the surface, m/s.
    """
    fade, share = current.at_level(worlds.water, Level.cruise)
    if ti.static(worlds.program.vehicle):
        depth = worlds.body.depth[w, k]
        fade = at_depth.fade(worlds.water.profile, depth)
        share, _ = at_depth.share(worlds.water.profile, depth)
    if k < worlds.boat.shape[1]:
        boat_motion.drift_along(worlds, w, k, vec2(u[PLACES - 1], v[PLACES - 1]))
    along_x, along_y = current.at_share(worlds.water, x, y, u, v, fade, share)
    for n in ti.static(range(PROFILE_POINTS)):
        worlds.profile[w, k, 2 * n] = along_x[1 + n]
        worlds.profile[w, k, 2 * n + 1] = along_y[1 + n]
    if ti.static(not worlds.program.vehicle):
        waves = current.long_wave_velocity(worlds.water, worlds.water.sea_index[w], x[0], y[0])
        carry_along(worlds, w, k, vec2(along_x[0], along_y[0]) + waves)


@func
def both(a: places, b: places):
    """Places of two AUVs side by side."""
    return ti.Vector([a[n] for n in ti.static(range(PLACES))] + [b[n] for n in ti.static(range(PLACES))])


@func
def half(v, first: ti.template()) -> places:
    """One of the two, from its first lane on."""
    return ti.Vector([v[first + n] for n in ti.static(range(PLACES))])


@func
def take_profiles(worlds: ti.template(), w):
    """`take_profile` of all AUVs of world w, two side by side, for where vectors stay in registers."""
    num_auvs = worlds.auv.shape[1]
    for pair in range((num_auvs + 1) // 2):
        j, k = 2 * pair, ti.min(2 * pair + 1, num_auvs - 1)
        x_j, y_j = profiled(worlds, w, j)
        x_k, y_k = profiled(worlds, w, k)
        u, v = vortex.current(worlds.water.vortex, w, both(x_j, x_k), both(y_j, y_k), worlds.water.pattern)
        take_profile(worlds, w, j, x_j, y_j, half(u, 0), half(v, 0))
        if k > j:
            take_profile(worlds, w, k, x_k, y_k, half(u, PLACES), half(v, PLACES))


@func
def sense_side_by_side(worlds: ti.template(), w):
    """`vehicles.sense` of all AUVs of world w, with the vortices at PLACES of them side by side."""
    num_auvs = worlds.auv.shape[1]
    for part in range((num_auvs + PLACES - 1) // PLACES):
        auvs = [ti.min(part * PLACES + n, num_auvs - 1) for n in ti.static(range(PLACES))]
        x = places([worlds.auv.x[w, auvs[n]] for n in ti.static(range(PLACES))])
        y = places([worlds.auv.y[w, auvs[n]] for n in ti.static(range(PLACES))])
        u, v, u_x, u_y, v_x = vortex.current_and_gradient(worlds.water.vortex, w, x, y, worlds.water.pattern)
        for n in range(ti.min(PLACES, num_auvs - part * PLACES)):
            vehicles.sense(worlds, w, part * PLACES + n, vec2(u[n], v[n]), vec3(u_x[n], u_y[n], v_x[n]))


@func
def add_current(worlds: ti.template(), w, k):
    """Complete the velocity of the water at AUV k of world w and at each boat of its number, modulo the number of AUVs.

    It carries them during the coming step. `add_storm_current` has come before. A profile of the current, if there is
    one, has been taken with others' by `take_profiles`, or is taken here, and with it the current at the AUV.
    """
    water = ti.static(worlds.water)
    pattern = ti.static(water.pattern)
    profile = ti.static(current_profile in worlds.program.observation)
    num_auvs = worlds.auv.shape[1]
    if ti.static(profile and not worlds.program.in_lanes):
        x, y = profiled(worlds, w, k)
        u, v = vortex.current(water.vortex, w, x, y, pattern)
        take_profile(worlds, w, k, x, y, u, v)
    for turn in range(ti.static(1 if profile else 0), (worlds.boat.shape[1] - k + num_auvs - 1) // num_auvs):
        b = k + turn * num_auvs
        place = boat_motion.boat_place(worlds, w, b)
        u, v = vortex.current(water.vortex, w, place[0], place[1], pattern)
        boat_motion.drift_along(worlds, w, b, vec2(u, v))
    if ti.static(worlds.program.vehicle):
        if ti.static(not worlds.program.in_lanes):
            x, y = worlds.auv.x[w, k], worlds.auv.y[w, k]
            u, v, u_x, u_y, v_x = vortex.current_and_gradient(water.vortex, w, x, y, pattern)
            vehicles.sense(worlds, w, k, vec2(u, v), vec3(u_x, u_y, v_x))
    elif ti.static(not profile):
        x, y = worlds.auv.x[w, k], worlds.auv.y[w, k]
        carry_along(worlds, w, k, current.velocity(water, Level.cruise, w, x, y))


@func
def add_storm_currents(worlds: ti.template(), w):
    """The storm at the AUVs of world w."""
    for k in range(worlds.auv.shape[1]):
        add_storm_current(worlds, w, k)


@func
def add_currents(worlds: ti.template(), w):
    """The currents at the AUVs and boats of world w, added to the storm."""
    if ti.static(worlds.program.in_lanes and current_profile in worlds.program.observation):
        take_profiles(worlds, w)
    if ti.static(worlds.program.in_lanes and worlds.program.vehicle):
        sense_side_by_side(worlds, w)
    for k in range(worlds.auv.shape[1]):
        add_current(worlds, w, k)


@func
def sense_auv(worlds: ti.template(), w, k):
    """The velocity of the water at AUV k, and at the boats of its number."""
    add_storm_current(worlds, w, k)
    add_current(worlds, w, k)
