"""Terms of an AUV's observation: functions that write one term each, from a given index on, and their registry.

The terms follow one another in the order of `observation_terms`, which has the meaning, unit and range of each number.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission import water
from usvauv.kernels.mission.auvs import vehicles
from usvauv.kernels.mission.auvs.motion import target_of
from usvauv.kernels.mission.auvs.reckoning import offset_to_target_from_estimate, own_position
from usvauv.kernels.mission.columns import BodyColumn, NodeColumn
from usvauv.kernels.mission.target_rules import knowledge
from usvauv.kernels.mission.water import BEAM_ANGLE, BEAM_CELL, BEAMS, PROFILE_POINTS
from usvauv.kernels.registry import Registry
from usvauv.kernels.types import vec2

POSITION_BOUND = 2.0  # over the area's diagonal: the area itself spans 1, the rest is for fixes outside it
CURRENT = math.inf  # stands for the largest current of the scenario
DEPTH_UNIT = 10.0  # m


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
        of_each_node: meanings of numbers that follow for each node, station or target.
    """

    write: Annotated[Callable[..., Any], "worlds, w, k, first"]
    quantities: Annotated[Callable[[int], Sequence[str]], "num_auvs"]
    unit: str
    low: float
    high: float
    condition: str = "named in `observation.extra` or by the task"
    present: Annotated[Callable[[Any], bool], "scenario"] | None = None
    of_each_node: Sequence[str] = ()


observation_terms: Registry[ObservationTerm] = Registry("observation term", form=ObservationTerm)


def quantities(name: str, num_auvs: int, num_nodes: int) -> list[str]:
    """Meanings of an observation term's numbers, in order; empty if it has no numbers for this many AUVs.

    Raises:
        UserError: a plugin's term fails to give them.
    """
    with observation_terms.calling(name):
        found = observation_terms[name].quantities(num_auvs)
        texts = list(found)
    if isinstance(found, str) or not all(isinstance(text, str) for text in texts):
        raise observation_terms.refuse(name, found, "a list of texts, what each number is")
    of_each = observation_terms[name].of_each_node
    return texts + [
        f"number {number}: {text}" for number in range(1, num_nodes + 1 if of_each else 1) for text in of_each
    ]


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
    offset = offset_to_target_from_estimate(worlds, w, k)
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
    numbers = vehicles.attitude(worlds.body, w, k)
    for n in ti.static(range(4)):
        worlds.observation[w, k, first + n] = numbers[n]


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
def observe_auv(worlds: ti.template(), w, k):
    """Write the observation of AUV k."""
    terms = ti.static(worlds.program.observation)
    for t in ti.static(range(len(terms))):
        terms[t](worlds, w, k, worlds.observation_first[t])


@func
def observe(worlds: ti.template(), w):
    """Observations of the AUVs of world w."""
    for k in range(worlds.auv.shape[1]):
        observe_auv(worlds, w, k)


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
_ship("current_profile", water.current_profile, PROFILE, VELOCITY, _shows('"profile"', "profile"))
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
