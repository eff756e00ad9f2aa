"""Terms of an AUV's observation: each function writes one term, from a given index on.

What a term's numbers mean, their units and ranges stand in `usvauv.env.world.observation`.
"""

import math

import taichi as ti

from usvauv.kernels.flow import airy, at_depth, current
from usvauv.kernels.functions import func
from usvauv.kernels.mission import navigation, vehicles
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BodyColumn,
    EstimateColumn,
    NodeColumn,
    Parameter,
    Sensor,
    TallyColumn,
)
from usvauv.kernels.mission.motion import distance_to_target, target_of
from usvauv.kernels.mission.target_rules import knowledge
from usvauv.kernels.types import Level, vec2

# A horizontal current profiler measures on beams towards the target and BEAM_ANGLE to its right and left, at
# PROFILE_CELLS distances BEAM_CELL apart.
BEAMS, BEAM_ANGLE = 3, 1.0  # rad
PROFILE_CELLS, BEAM_CELL = 2, 25.0  # m
DEPTH_UNIT = 10.0  # m
PROFILE_POINTS = BEAMS * PROFILE_CELLS
# From an AUV, ahead and to the left, m: itself, and its profiler's points.
AHEAD, LEFT = (
    [0.0, *(BEAM_CELL * (n // BEAMS + 1) * f(BEAM_ANGLE * (n % BEAMS - 1)) for n in range(PROFILE_POINTS)), 0.0]
    for f in (math.cos, math.sin)
)


@func
def target_offset(worlds: ti.template(), w, k) -> vec2:
    """From where AUV k takes itself to be to its target, over the area's diagonal; near it by homing."""
    target = target_of(worlds, w, k)
    here = navigation.own_position(worlds, w, k)
    if ti.static(worlds.program.sensor != Sensor.none):
        if distance_to_target(worlds, w, k) <= worlds.p[Parameter.homing_range]:
            here = vec2(worlds.auv[w, k, AuvColumn.x], worlds.auv[w, k, AuvColumn.y])
    there = vec2(worlds.node[w, target, NodeColumn.x], worlds.node[w, target, NodeColumn.y])
    return (there - here) / worlds.p[Parameter.diagonal]


@func
def others(worlds: ti.template(), w, k, first):
    """Estimated positions of the other AUVs relative to the own one."""
    scale = 1.0 / worlds.p[Parameter.diagonal]
    estimate = ti.static(worlds.estimate)
    here = navigation.own_position(worlds, w, k)
    slot = first
    for j in range(worlds.auv.shape[1]):
        if j != k:
            worlds.observation[w, k, slot] = (estimate[w, j, EstimateColumn.x] - here[0]) * scale
            worlds.observation[w, k, slot + 1] = (estimate[w, j, EstimateColumn.y] - here[1]) * scale
            slot += 2


@func
def target(worlds: ti.template(), w, k, first):
    """The target relative to the own estimated position."""
    offset = target_offset(worlds, w, k)
    worlds.observation[w, k, first] = offset[0]
    worlds.observation[w, k, first + 1] = offset[1]


@func
def position(worlds: ti.template(), w, k, first):
    """The own estimated position."""
    scale = 1.0 / worlds.p[Parameter.diagonal]
    here = navigation.own_position(worlds, w, k)
    worlds.observation[w, k, first] = here[0] * scale
    worlds.observation[w, k, first + 1] = here[1] * scale


@func
def border(worlds: ti.template(), w, k, first):
    """Whether the last move was refused at the border."""
    worlds.observation[w, k, first] = worlds.auv[w, k, AuvColumn.border]


@func
def overflow(worlds: ti.template(), w, k, first):
    """Share of the nodes that overflow."""
    worlds.observation[w, k, first] = worlds.tally[w, TallyColumn.overflowing] / worlds.node.shape[1]


@func
def current_speed(worlds: ti.template(), w, k, first):
    """Speed of the current at the AUV (Eq. 4)."""
    worlds.observation[w, k, first] = vec2(
        worlds.auv[w, k, AuvColumn.current_x], worlds.auv[w, k, AuvColumn.current_y]
    ).norm()


@func
def current_vector(worlds: ti.template(), w, k, first):
    """Components of the current at the AUV."""
    worlds.observation[w, k, first] = worlds.auv[w, k, AuvColumn.current_x]
    worlds.observation[w, k, first + 1] = worlds.auv[w, k, AuvColumn.current_y]


@func
def current_profile(worlds: ti.template(), w, k, first) -> vec2:
    """Components of the current, without waves, at the points of the profiler; returns that at the AUV."""
    towards = target_offset(worlds, w, k)
    bearing = vec2(1.0, 0.0)
    if towards.norm() > 1e-9:
        bearing = towards.normalized()
    ahead, left = ti.Vector(ti.static(AHEAD)), ti.Vector(ti.static(LEFT))
    x = worlds.auv[w, k, AuvColumn.x] + ahead * bearing[0] - left * bearing[1]
    y = worlds.auv[w, k, AuvColumn.y] + left * bearing[0] + ahead * bearing[1]
    fade, share = current.at_level(worlds.water, Level.cruise)
    if ti.static(worlds.program.vehicle):
        fade, share = at_depth.at(*vehicles.depths(worlds, w, k))
    u, v = current.without_waves(worlds.water, w, x, y, fade, share)
    for n in ti.static(range(PROFILE_POINTS)):
        worlds.observation[w, k, first + 2 * n] = u[1 + n]
        worlds.observation[w, k, first + 2 * n + 1] = v[1 + n]
    return vec2(u[0], v[0])


@func
def service(worlds: ti.template(), w, k, first):
    """Whether the AUV is taking data from its node, and those that are left, or before expected, over a buffer."""
    serving = ti.select(worlds.auv[w, k, AuvColumn.hover] > 0.0, 1.0, 0.0)
    left = worlds.auv[w, k, AuvColumn.cargo]
    if serving == 0.0:
        left = knowledge.backlog(worlds, w, k, target_of(worlds, w, k), 0.0)
    worlds.observation[w, k, first] = serving
    worlds.observation[w, k, first + 1] = left / worlds.p[Parameter.buffer]


@func
def next_node(worlds: ti.template(), w, k, first):
    """The node after the target, as far as the target rule foresees it, relative to the target; else zeros."""
    target = target_of(worlds, w, k)
    after = worlds.program.target_rule.foreseen(worlds, w, target)
    scale = 1.0 / worlds.p[Parameter.diagonal]
    for axis in ti.static(range(2)):
        column = ti.static(NodeColumn.x + axis)
        ahead = worlds.node[w, after, column] - worlds.node[w, target, column]
        worlds.observation[w, k, first + axis] = ahead * scale


@func
def attitude(worlds: ti.template(), w, k, first):
    """Heading of a vehicle as (cos, sin) from east towards north, its pitch and its roll."""
    angles = vehicles.attitude(worlds.body, w, k)
    worlds.observation[w, k, first] = ti.cos(angles[0])
    worlds.observation[w, k, first + 1] = ti.sin(angles[0])
    worlds.observation[w, k, first + 2] = angles[1]
    worlds.observation[w, k, first + 3] = angles[2]


@func
def depth(worlds: ti.template(), w, k, first):
    """Depth of a vehicle by its sensor, below its cruise depth, and its height above the bed, over `DEPTH_UNIT`."""
    read = worlds.auv[w, k, AuvColumn.depth_error] + worlds.body[w, k, BodyColumn.sensor_error]
    above = worlds.body[w, k, BodyColumn.bed] - worlds.body[w, k, BodyColumn.depth]
    worlds.observation[w, k, first] = read / DEPTH_UNIT
    worlds.observation[w, k, first + 1] = above / DEPTH_UNIT


@func
def motion(worlds: ti.template(), w, k, first):
    """Velocity of a vehicle through the water and turning rates in its own axes, rudder and stern plane."""
    for c in ti.static(range(8)):  # u … r, rudder, stern
        worlds.observation[w, k, first + c] = worlds.body[w, k, BodyColumn.u + c]


@func
def sense_current(worlds: ti.template(), w, k):
    """Store the velocity of the water at AUV k, which also carries it during the coming step, and its profile."""
    terms = ti.static(worlds.program.observation)
    here = vec2(0.0)
    if ti.static(current_profile in terms):
        here = current_profile(worlds, w, k, worlds.observation_first[ti.static(terms.index(current_profile))])
    if ti.static(worlds.program.vehicle):
        here = vehicles.sense(worlds, w, k)
    else:
        x = worlds.auv[w, k, AuvColumn.x]
        y = worlds.auv[w, k, AuvColumn.y]
        sea = worlds.water.sea_index[w]
        if ti.static(current_profile in terms):
            here += current.long_wave_velocity(worlds.water, sea, x, y)
        else:
            here = current.velocity(worlds.water, Level.cruise, w, x, y)
        storm = airy.motion(worlds.water.wave, sea, Level.cruise, x, y)
        here += vec2(storm[3], storm[4])
    worlds.auv[w, k, AuvColumn.current_x] = here[0]
    worlds.auv[w, k, AuvColumn.current_y] = here[1]


@func
def write(worlds: ti.template(), w, k):
    """Write the observation of AUV k, term by term; NaN, which ends the run, where its target is no node's index."""
    sense_current(worlds, w, k)
    terms = ti.static(worlds.program.observation)
    for t in ti.static(range(len(terms))):
        if ti.static(terms[t] != current_profile):  # which was written together with the AUV's own
            terms[t](worlds, w, k, worlds.observation_first[t])
    if ti.cast(target_of(worlds, w, k), ti.f32) != worlds.auv[w, k, AuvColumn.target]:
        worlds.observation[w, k, 0] = ti.math.nan
