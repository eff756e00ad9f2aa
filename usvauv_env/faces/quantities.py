"""What the numbers of an observation and of an action are, as data: for files that leave this program."""

from __future__ import annotations

from typing import NamedTuple

from kernels.mission.columns import BEAM_ANGLE, BEAM_CELL, BEAMS, PROFILE_POINTS
from usvauv_env.scenario import Scenario
from usvauv_env.world.spaces import auv_action_space, auv_observation_space
from usvauv_env.world.tables import CURRENT_COMPONENTS


class Quantity(NamedTuple):
    """One number of a vector.

    Attributes:
        index: place in the vector.
        quantity: what it is; x points east, y north.
        unit: what 1 stands for.
        low: lower bound in the faces' spaces.
        high: upper bound there.
    """

    index: int
    quantity: str
    unit: str
    low: float
    high: float


def observed(scenario: Scenario) -> list[Quantity]:
    """The observation of AUV k of a team of K, number by number, as `usvauv_env.world.world.World` tabulates it."""
    diagonal = f"area's diagonal, {scenario.area.diagonal:.6g} m"
    place = "node" if scenario.task == "data-collection" else "station"
    others = [
        f"{axis} of another AUV, number {number} of the others in the order of their index, minus own {axis}"
        for number in range(1, scenario.auv.count)
        for axis in "xy"
    ]
    target = [f"{axis} of the target {place} minus own {axis}" for axis in "xy"]
    names = [(name, diagonal) for name in (*others, *target, "own x", "own y")]
    names += [("1 if the last move was refused at the border, else 0", "1"), ("share of nodes that overflow", "1")]
    current = ["speed of the current at the AUV", "current at the AUV, x", "current at the AUV, y"]
    for point in range(PROFILE_POINTS):
        reach, beam = BEAM_CELL * (point // BEAMS + 1), BEAM_ANGLE * (point % BEAMS - 1)
        place = f"{reach:g} m away, {beam:g} rad to the left of the target's bearing"
        current += [f"current {place}, {axis}" for axis in "xy"]
    names += [(name, "m/s") for name in current[: CURRENT_COMPONENTS[scenario.observation.current]]]
    space = auv_observation_space(scenario)
    return _table(names, space.low.tolist(), space.high.tolist())


def commanded(scenario: Scenario) -> list[Quantity]:
    """The action of one AUV, number by number."""
    auv = scenario.auv
    if auv.action == "vector":
        clamped = f"the velocity's norm is clamped into {auv.speed_min:g} .. {auv.speed_max:g} m/s"
        names = [(f"velocity through the water, {axis}; {clamped}", f"{auv.speed_max:g} m/s") for axis in "xy"]
    else:
        span = f"{auv.speed_min:g} m/s at -1, {auv.speed_max:g} m/s at 1, linear between"
        names = [("heading, from east towards north", "pi rad"), (f"speed through the water: {span}", "1")]
    space = auv_action_space()
    return _table(names, space.low.tolist(), space.high.tolist())


def _table(names: list[tuple[str, str]], low: list[float], high: list[float]) -> list[Quantity]:
    """Names with units, and bounds."""
    rows = zip(names, low, high, strict=True)
    return [Quantity(index, *name, *bounds) for index, (name, *bounds) in enumerate(rows)]
