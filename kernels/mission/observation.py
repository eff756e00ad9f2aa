"""Terms of an AUV's observation: functions that write one term each, from a given index on, and their registry.

The terms follow one another in the order of `observation_terms`, which has the meaning, unit and range of each number.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import taichi as ti

from usvauv.kernels.flow import airy, at_depth, current, vortex
from usvauv.kernels.flow.vortex import PLACES, places
from usvauv.kernels.functions import func
from usvauv.kernels.mission import vehicles
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BodyColumn,
    NodeColumn,
)
from usvauv.kernels.mission.motion import distance_to_target, own_position, target_of
from usvauv.kernels.mission.target_rules import knowledge
from usvauv.kernels.registry import Registry
from usvauv.kernels.types import Level, vec2

POSITION_BOUND = 2.0  # over the area's diagonal: the area itself spans 1, the rest is for fixes outside it
CURRENT = math.inf  # stands for the largest current of the scenario
# A horizontal current profiler measures on beams towards the target and BEAM_ANGLE to its right and left, at
# PROFILE_CELLS distances BEAM_CELL apart.
BEAMS, BEAM_ANGLE = 3, 1.0  # rad
PROFILE_CELLS, BEAM_CELL = 2, 25.0  # m
DEPTH_UNIT = 10.0  # m
PROFILE_POINTS = BEAMS * PROFILE_CELLS
# From an AUV, ahead and to the left, m: itself, its profiler's points, and one to spare.
AHEAD, LEFT = (
    [0.0, *(BEAM_CELL * (n // BEAMS + 1) * f(BEAM_ANGLE * (n % BEAMS - 1)) for n in range(PROFILE_POINTS)), 0.0]
    for f in (math.cos, math.sin)
)


@dataclass(frozen=True)
class ObservationTerm:
    """One term of an AUV's observation: numbers that belong together.

    Attributes:
        write: Taichi function (worlds, w, k, first) that writes the numbers of AUV k from index `first` on.
        quantities: function: number K of AUVs → meanings of the numbers, in order.
        unit: "D", the area's diagonal; "m/s"; or "1".
        low, high: bounds in the spaces, in that unit; ±inf stands for ± the largest current of the scenario.
        condition: when the term is present, in words.
        present: whether it is present; None: if `observation.extra` or the task names it.
    """

    write: Annotated[Callable[..., Any], "worlds, w, k, first"]
    quantities: Annotated[Callable[[int], Sequence[str]], "num_auvs"]
    unit: str
    low: float
    high: float
    condition: str = "named in `observation.extra` or by the task"
    present: Annotated[Callable[[Any], bool], "scenario"] | None = None


observation_terms: Registry[ObservationTerm] = Registry("observation term", form=ObservationTerm)


def quantities(name: str, num_auvs: int) -> list[str]:
    """Meanings of an observation term's numbers, in order; empty if it has no numbers for this many AUVs.

    Raises:
        UserError: a plugin's term fails to give them.
    """
    with observation_terms.calling(name):
        found = observation_terms[name].quantities(num_auvs)
        texts = list(found)
    if isinstance(found, str) or not all(isinstance(text, str) for text in texts):
        raise observation_terms.refuse(name, found, "a list of texts, what each number is")
    return texts


@func
def target_offset(worlds: ti.template(), w, k) -> vec2:
    """From AUV k's own position estimate to its target, over the area's diagonal; near it by homing."""
    target = target_of(worlds, w, k)
    here = own_position(worlds, w, k)
    if ti.static(worlds.program.reckoning):
        if distance_to_target(worlds, w, k) <= worlds.p.homing_range:
            here = vec2(worlds.auv.x[w, k], worlds.auv.y[w, k])
    there = vec2(worlds.node.x[w, target], worlds.node.y[w, target])
    return (there - here) / worlds.p.diagonal


@func
def others(worlds: ti.template(), w, k, first):
    """Estimated positions of the other AUVs relative to the own one."""
    scale = 1.0 / worlds.p.diagonal
    estimate = ti.static(worlds.estimate)
    here = own_position(worlds, w, k)
    slot = first
    for j in range(worlds.auv.shape[1]):
        if j != k:
            worlds.observation[w, k, slot] = (estimate.x[w, j] - here[0]) * scale
            worlds.observation[w, k, slot + 1] = (estimate.y[w, j] - here[1]) * scale
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
    scale = 1.0 / worlds.p.diagonal
    here = own_position(worlds, w, k)
    worlds.observation[w, k, first] = here[0] * scale
    worlds.observation[w, k, first + 1] = here[1] * scale


@func
def border(worlds: ti.template(), w, k, first):
    """Whether the last move was refused at the border."""
    worlds.observation[w, k, first] = worlds.auv.border[w, k]


@func
def overflow(worlds: ti.template(), w, k, first):
    """Share of the nodes that overflow."""
    worlds.observation[w, k, first] = worlds.tally.overflowing[w] / worlds.node.shape[1]


@func
def current_speed(worlds: ti.template(), w, k, first):
    """Speed of the current at the AUV (Eq. 4)."""
    worlds.observation[w, k, first] = vec2(worlds.auv.current_x[w, k], worlds.auv.current_y[w, k]).norm()


@func
def current_vector(worlds: ti.template(), w, k, first):
    """Components of the current at the AUV."""
    worlds.observation[w, k, first] = worlds.auv.current_x[w, k]
    worlds.observation[w, k, first + 1] = worlds.auv.current_y[w, k]


@func
def current_profile(worlds: ti.template(), w, k, first):
    """Components of the current, without waves, at the points of the profiler; `take_profile` writes them."""


@func
def profiled(worlds: ti.template(), w, k):
    """AUV k, the points of its profiler, and the boat of the same number, or the last one, side by side: x, y, m."""
    terms = ti.static(worlds.program.observation)
    towards = vec2(0.0)
    if ti.static(target in terms):  # `write_of_nodes` has written it
        slot = worlds.observation_first[ti.static(terms.index(target))]
        towards = vec2(worlds.observation[w, k, slot], worlds.observation[w, k, slot + 1])
    else:
        towards = target_offset(worlds, w, k)
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
        fade, share = at_depth.at(*vehicles.depths(worlds, w, k))
    if k < worlds.boat.shape[1]:
        boat_motion.drift_along(worlds, w, k, vec2(u[PLACES - 1], v[PLACES - 1]))
    along_x, along_y = current.at_share(worlds.water, x, y, u, v, fade, share)
    first = worlds.observation_first[ti.static(worlds.program.observation.index(current_profile))]
    for n in ti.static(range(PROFILE_POINTS)):
        worlds.observation[w, k, first + 2 * n] = along_x[1 + n]
        worlds.observation[w, k, first + 2 * n + 1] = along_y[1 + n]
    if ti.static(not worlds.program.vehicle):
        waves = current.long_wave_velocity(worlds.water, worlds.water.sea_index[w], x[0], y[0])
        carry_along(worlds, w, k, vec2(along_x[0], along_y[0]) + waves)


@func
def service(worlds: ti.template(), w, k, first):
    """Whether the AUV is taking data from its node, and those that are left, or before expected, over a buffer."""
    serving = ti.select(worlds.auv.hover[w, k] > 0.0, 1.0, 0.0)
    left = worlds.auv.cargo[w, k]
    if serving == 0.0:
        left = knowledge.backlog(worlds, w, k, target_of(worlds, w, k), 0.0)
    worlds.observation[w, k, first] = serving
    worlds.observation[w, k, first + 1] = left / worlds.p.buffer


@func
def next_node(worlds: ti.template(), w, k, first):
    """The node after the target, as far as the target rule foresees it, relative to the target; else zeros."""
    target = target_of(worlds, w, k)
    after = worlds.program.target_rule.foreseen(worlds, w, target)
    scale = 1.0 / worlds.p.diagonal
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
    read = worlds.auv.depth_error[w, k] + worlds.body.sensor_error[w, k]
    above = worlds.body.bed[w, k] - worlds.body.depth[w, k]
    worlds.observation[w, k, first] = read / DEPTH_UNIT
    worlds.observation[w, k, first + 1] = above / DEPTH_UNIT


@func
def motion(worlds: ti.template(), w, k, first):
    """Velocity of a vehicle through the water and turning rates in its own axes, rudder and stern plane."""
    for c in ti.static(range(8)):  # u … r, rudder, stern
        worlds.observation[w, k, first + c] = worlds.body[w, k, BodyColumn.u + c]


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
def add_storm_current(worlds: ti.template(), w, k):
    """Store the storm's velocity at AUV k, to which `sense_current` adds; a vehicle senses it by itself."""
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
def sense_current(worlds: ti.template(), w, k):
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
        here = vehicles.sense(worlds, w, k)
        worlds.auv.current_x[w, k] = here[0]
        worlds.auv.current_y[w, k] = here[1]
    elif ti.static(not profile):
        x, y = worlds.auv.x[w, k], worlds.auv.y[w, k]
        carry_along(worlds, w, k, current.velocity(water, Level.cruise, w, x, y))


OF_NODES = (target, service, next_node)


@func
def write_of_nodes(worlds: ti.template(), w, k):
    """Write the terms of AUV k's observation that read nodes, while these are in the processor's cache."""
    terms = ti.static(worlds.program.observation)
    for t in ti.static(range(len(terms))):
        if ti.static(terms[t] in OF_NODES):
            terms[t](worlds, w, k, worlds.observation_first[t])


@func
def write(worlds: ti.template(), w, k):
    """Write what `write_of_nodes` has left."""
    terms = ti.static(worlds.program.observation)
    for t in ti.static(range(len(terms))):
        if ti.static(terms[t] != current_profile and terms[t] not in OF_NODES):  # it is written with the AUV's own
            terms[t](worlds, w, k, worlds.observation_first[t])


def _others(num_auvs: int) -> list[str]:
    return [
        f"{axis} of another AUV, number {number} of the others in the order of their index, minus own {axis}"
        for number in range(1, num_auvs)
        for axis in "xy"
    ]


PROFILE = [
    f"current {BEAM_CELL * (point // BEAMS + 1):g} m away,"
    f" {BEAM_ANGLE * (point % BEAMS - 1):g} rad to the left of the target's bearing, {axis}"
    for point in range(PROFILE_POINTS)
    for axis in "xy"
]
# Kinds of numbers: unit and bounds. Conditions: in words, and as a function of the scenario.
POSITION, SHARE, VELOCITY = ("D", -POSITION_BOUND, POSITION_BOUND), ("1", 0.0, 1.0), ("m/s", -CURRENT, CURRENT)
When = tuple[str, Callable[[Any], bool]]
ALWAYS: When = "always", lambda scenario: True
PASSING: When = '`nodes.service` is "passing"', lambda scenario: scenario.collects_in_passing


def _shows(words: str, *choices: str) -> When:
    return f"`observation.current` is {words}", lambda scenario: scenario.observation.current in choices


def _of_vehicles(name: str) -> When:
    """Terms of vehicles with dynamics: all are present where fins are commanded, else those that are named."""
    return (
        'named in `observation.extra`, or `auv.action` is "fins"',
        lambda scenario: name in scenario.observation.extra or scenario.auv.action == "fins",
    )


def _ship(
    name: str,
    write: Callable[..., Any],
    texts: list[str] | Callable[[int], list[str]],
    kind: tuple[str, float, float],
    when: When = ALWAYS,
) -> None:
    quantities = texts if callable(texts) else lambda num_auvs: texts
    observation_terms.register(name, ObservationTerm(write, quantities, *kind, *when))


# In the order of an observation.
_ship("others", others, _others, POSITION)
_ship("target", target, [f"{axis} of the target, a node or station, minus own {axis}" for axis in "xy"], POSITION)
_ship("position", position, ["own x", "own y"], POSITION)
_ship("border", border, ["1 if the last move was refused at the border, else 0"], SHARE)
_ship("overflow", overflow, ["share of nodes that overflow"], SHARE)
_shown = _shows('not "none"', "speed", "vector", "profile")
_ship("current_speed", current_speed, ["speed of the current at the AUV"], ("m/s", 0.0, CURRENT), _shown)
_shown = _shows('"vector" or "profile"', "vector", "profile")
_ship("current", current_vector, [f"current at the AUV, {axis}" for axis in "xy"], VELOCITY, _shown)
_ship("current_profile", current_profile, PROFILE, VELOCITY, _shows('"profile"', "profile"))
_left = "data left there, or before that expected, over a buffer"
_ship("service", service, ["1 while data come in from the target, else 0", _left], SHARE, PASSING)
_next = [f"{axis} of the node after the target, where the target rule foresees it, minus that of it" for axis in "xy"]
_ship("next", next_node, _next, POSITION, PASSING)
_angles = ["cosine of the heading, from east", "its sine", "pitch, nose up", "roll, starboard down"]
_ship("attitude", attitude, _angles, ("1, rad", -4.0, 4.0), _of_vehicles("attitude"))
_depths, _unit = ["depth below the cruise depth, by the sensor", "height above the bed"], f"{DEPTH_UNIT:g} m"
_ship("depth", depth, _depths, (_unit, -1200.0, 1200.0), _of_vehicles("depth"))
_rates = [
    *(f"velocity through the water, {way}" for way in ("forward", "to starboard", "downward")),
    *(f"turning rate, {way}" for way in ("roll", "pitch", "yaw to starboard")),
    *("rudder", "stern plane"),
]
_ship("motion", motion, _rates, ("m/s, rad/s, rad", -10.0, 10.0), _of_vehicles("motion"))
