"""Whether a world's state can be: while it runs, and when it is loaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch

from usvauv.env.scenario import Scenario, ScenarioError
from usvauv.kernels.mission.state_ranges import ANYTHING, STATE, resolve

LATEST = 1_000_000_000  # episode or step that a clock can show
PER = {
    "auv": "AUV",
    "estimate": "the estimate of AUV",
    "node": "node",
    "belief": "the belief, of all or of AUV",
    "vortex": "vortex",
    "track": "the track of AUV",
    "own": "the own track of AUV",
    "exchange": "the exchange with AUV",
    "boat": "boat",
}


def bounds_of(scenario: Scenario) -> dict[str, np.ndarray]:
    """`usvauv.kernels.mission.state_ranges.resolve` for a scenario."""
    return resolve(
        {
            "width": float(np.float32(scenario.area.width)),
            "length": float(np.float32(scenario.area.length)),
            "targets": scenario.targets,
            "last_target": scenario.targets - 1,
            "last_auv": scenario.auv.count - 1,
            "last_boat": scenario.boat.count - 1,
            "last_kind": len(scenario.nodes.arrival_rates) - 1,
        }
    )


def first_outside(
    name: str, values: torch.Tensor, bounds: Mapping[str, np.ndarray], columns: Sequence[str] = ()
) -> tuple[int, str] | None:
    """World and words for the first number of an array (W, ..., columns) that its column may not hold; None if all may.

    Args:
        name: of the array, as in `usvauv.kernels.mission.state_ranges.STATE`; one that is not there may hold any
        number. bounds: of `bounds_of`.
        columns: what the numbers are in an array that is not there.
    """
    values = values.detach().double().cpu()
    table = STATE.get(name)
    if table is None:
        wrong = ~(values.abs() <= ANYTHING)
    else:
        low, high = torch.from_numpy(bounds[name])
        whole = torch.tensor([allowed.whole for _, allowed in table])
        wrong = ~((values >= low) & (values <= high)) | (whole & (values != values.round()))
    places = wrong.nonzero()
    if not len(places):
        return None
    place = places[0].tolist()
    value = float(values[tuple(place)])
    if table is None:
        column = f" {columns[place[2]]!r}" if columns else ""
        return place[0], f"{name}{column} of AUV {place[1]} is {value:g}"
    column, allowed = table[place[-1]]
    whose = f"{column} of {PER[name]} {place[1]}" if name in PER else f"{column} of the {name}"
    rule = "a whole number from" if allowed.whole else "from"
    return place[
        0
    ], f"{whose} is {value:g}: must be {rule} {bounds[name][0, place[-1]]:g} to {bounds[name][1, place[-1]]:g}"


def check_state(given: Mapping[str, torch.Tensor], own: Mapping[str, torch.Tensor], scenario: Scenario) -> None:
    """Refuse a state that a world of this scenario cannot have.

    Args:
        given: to be loaded. own: of the world as it is, for names, shapes and types.

    Raises:
        ScenarioError: it is another world's, or a number is not one that it can hold.
    """

    def refuse(problem: str) -> None:
        raise ScenarioError(f"state of the world: {problem}")

    if given.keys() != own.keys():
        missing, unknown = sorted(own.keys() - given.keys()), sorted(given.keys() - own.keys())
        refuse(f"{missing[0]} is missing" if missing else f"{unknown[0]} is unknown")
    bounds = bounds_of(scenario)
    for name, mine in own.items():
        value = given[name]
        if tuple(value.shape) != tuple(mine.shape):
            refuse(f"{name} has shape {tuple(value.shape)}: must be {tuple(mine.shape)}")
        if value.dtype != mine.dtype:
            refuse(f"{name} is {value.dtype}: must be {mine.dtype}")
        if name in ("clock", "sea_clock", "sea_episode"):
            least = -1 if name == "clock" else 0
            wrong = ~((value >= least) & (value <= LATEST))
            if name != "sea_clock":  # a nonlinear sea's has a rate, too
                wrong |= value != value.double().round()
            if wrong.any():
                kind = "" if name == "sea_clock" else "a whole number "
                refuse(f"{name} has {float(value[wrong][0]):g}: must be {kind}from {least} to {LATEST}")
        elif (problem := first_outside(name, value, bounds)) is not None:
            refuse(f"world {problem[0]}: {problem[1]}")
