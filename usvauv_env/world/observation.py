"""Observations and actions of AUVs: a table of terms, from which offsets, spaces, names and documentation follow.

The scenario decides which terms an AUV's observation has. They follow one another in the order of
`observation_terms`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.kernels.errors import choices
from usvauv.kernels.mission import observation as kernel
from usvauv.kernels.mission.observation import BEAM_ANGLE, BEAM_CELL, BEAMS, PROFILE_POINTS
from usvauv.kernels.registry import Registry

POSITION_BOUND = 2.0  # over the area's diagonal: the area itself spans 1, the rest is for fixes outside it
CURRENT = math.inf  # stands for the largest current of the scenario


class Quantity(NamedTuple):
    """One number of a vector.

    Attributes:
        index: position in the vector.
        quantity: its meaning; x points east, y north.
        unit: the quantity that 1 stands for.
        low, high: bounds in the spaces of the Gymnasium, PettingZoo and TorchRL environments.
    """

    index: int
    quantity: str
    unit: str
    low: float
    high: float


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
    present: Annotated[Callable[[Scenario], bool], "scenario"] | None = None


observation_terms: Registry[ObservationTerm] = Registry("observation term", ScenarioError, ObservationTerm)


def quantities(name: str, num_auvs: int) -> list[str]:
    """Meanings of an observation term's numbers, in order; empty if it has no numbers for this many AUVs.

    Raises:
        ScenarioError: a plugin's term fails to give them.
    """
    with observation_terms.calling(name):
        found = observation_terms[name].quantities(num_auvs)
        texts = list(found)
    if isinstance(found, str) or not all(isinstance(text, str) for text in texts):
        raise observation_terms.refuse(name, found, "a list of texts, what each number is")
    return texts


@dataclass(frozen=True)
class ObservationLayout:
    """Indices of a scenario's terms in an AUV's observation (..., O): `observation[..., layout.slice("target")]`.

    Attributes:
        num_auvs: number K of AUVs.
        terms: names of the terms, in order.
    """

    num_auvs: int
    terms: tuple[str, ...]

    @classmethod
    def of(cls, scenario: Scenario) -> ObservationLayout:
        """The layout of a scenario.

        Raises:
            ScenarioError: an unknown term in `observation.extra` or of the task.
        """
        extra = {*scenario.observation.extra, *scenario.task_definition.observation}
        for name in extra:
            if name not in observation_terms:
                raise ScenarioError(f"observation.extra: {name!r}: {choices(name, observation_terms)}")
        present = []
        for name, term in observation_terms.items():
            with observation_terms.calling(name):
                if term.present(scenario) if term.present else name in extra:
                    present.append(name)
        return cls(scenario.auv.count, tuple(present))

    def __contains__(self, name: str) -> bool:
        return name in self.terms

    def __iter__(self) -> Iterator[tuple[str, slice]]:
        """Names and indices of the terms."""
        last = 0
        for name in self.terms:
            first, last = last, last + len(quantities(name, self.num_auvs))
            yield name, slice(first, last)

    @property
    def size(self) -> int:
        """Length O of one AUV's observation."""
        return max(place.stop for _, place in self)

    def slice(self, name: str) -> slice:
        """Indices of a term.

        Raises:
            KeyError: the term is not present.
        """
        return dict(self)[name]


def commanded(scenario: Scenario) -> list[Quantity]:
    """The action of one AUV, number by number."""
    auv = scenario.auv
    if auv.action == "fins":
        names = [(f"{name}, a share of its limit", "1") for name in ("rudder to starboard", "stern plane, diving")]
        names.append(("propeller, a share of its fastest revolutions", "1"))
    elif auv.action != "polar":
        clamped = f"the velocity's norm is clamped into {auv.speed_min:g} .. {auv.speed_max:g} m/s"
        names = [(f"velocity through the water, {axis}; {clamped}", f"{auv.speed_max:g} m/s") for axis in "xy"]
        if auv.action == "vector-depth":
            names.append((f"depth: {auv.depth_min:g} m at -1, {auv.depth_max:g} m at 1, linear between", "1"))
    else:
        span = f"{auv.speed_min:g} m/s at -1, {auv.speed_max:g} m/s at 1, linear between"
        names = [("heading, from east towards north", "pi rad"), (f"speed through the water: {span}", "1")]
    return [Quantity(index, text, unit, -1.0, 1.0) for index, (text, unit) in enumerate(names)]


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
When = tuple[str, Callable[[Scenario], bool]]
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
_ship("others", kernel.others, _others, POSITION)
_ship(
    "target", kernel.target, [f"{axis} of the target, a node or station, minus own {axis}" for axis in "xy"], POSITION
)
_ship("position", kernel.position, ["own x", "own y"], POSITION)
_ship("border", kernel.border, ["1 if the last move was refused at the border, else 0"], SHARE)
_ship("overflow", kernel.overflow, ["share of nodes that overflow"], SHARE)
_shown = _shows('not "none"', "speed", "vector", "profile")
_ship("current_speed", kernel.current_speed, ["speed of the current at the AUV"], ("m/s", 0.0, CURRENT), _shown)
_shown = _shows('"vector" or "profile"', "vector", "profile")
_ship("current", kernel.current_vector, [f"current at the AUV, {axis}" for axis in "xy"], VELOCITY, _shown)
_ship("current_profile", kernel.current_profile, PROFILE, VELOCITY, _shows('"profile"', "profile"))
_left = "data left there, or before that expected, over a buffer"
_ship("service", kernel.service, ["1 while data come in from the target, else 0", _left], SHARE, PASSING)
_next = [f"{axis} of the node after the target, where the target rule foresees it, minus that of it" for axis in "xy"]
_ship("next", kernel.next_node, _next, POSITION, PASSING)
_angles = ["cosine of the heading, from east", "its sine", "pitch, nose up", "roll, starboard down"]
_ship("attitude", kernel.attitude, _angles, ("1, rad", -4.0, 4.0), _of_vehicles("attitude"))
_depths, _unit = ["depth below the cruise depth, by the sensor", "height above the bed"], f"{kernel.DEPTH_UNIT:g} m"
_ship("depth", kernel.depth, _depths, (_unit, -1200.0, 1200.0), _of_vehicles("depth"))
_rates = [
    *(f"velocity through the water, {way}" for way in ("forward", "to starboard", "downward")),
    *(f"turning rate, {way}" for way in ("roll", "pitch", "yaw to starboard")),
    *("rudder", "stern plane"),
]
_ship("motion", kernel.motion, _rates, ("m/s, rad/s, rad", -10.0, 10.0), _of_vehicles("motion"))
