"""The state of worlds: shapes and memory of its arrays, possible states, and fields that may change meanwhile."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple, NoReturn, TypeGuard

import numpy as np
import torch

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels.functions import LANES, Limits
from usvauv.kernels.mission.worlds import REWARDS, state_arrays

Numbers = torch.Tensor | np.ndarray | Sequence[Any]  # arguments of `World.step`
ALIGNMENT = LANES  # numbers
ANYTHING = 1e20  # bound of a number without a range: of an observation, a reward
LATEST = 1_000_000_000  # largest episode or step of a clock
# Fields on which only numbers in the kernels' tables, the storm and the forcing of the sea depend.
ADJUSTABLE = (
    "current.circulation_min",
    "current.circulation_max",
    "storm.significant_height",
    "sea.irregular_rms",
    "acoustics.source_level",
    "channel.interval",
)
DECISIONS = ("boat.strategy", "nodes.target_rule")


def array_shapes(scenario: Scenario, num_worlds: int, foresees: bool) -> dict[str, tuple[int, ...]]:
    """Shape of each array of `STATE` and of the rewards; one that the scenario does not use has one row for all worlds.

    Args:
        foresees: the boat's strategy predicts the AUVs' positions.
    """
    reckons = scenario.navigation.sensor != "none"
    in_use = {
        "track": reckons,
        "own": reckons,
        "exchange": scenario.channel.schedule != "every-step",
        "foresight": foresees,
        "body": scenario.auv.dynamic,
        "hull": scenario.boat.model == "otter",
        "task_auv": scenario.task_definition.auv_columns is not None,
        "task_node": scenario.task_definition.node_columns is not None,
        "task_pair": scenario.task_definition.pair_columns is not None,
        "task_boat": scenario.task_definition.boat_columns is not None,
    }
    lengths = {
        "W": num_worlds,
        "K": scenario.auv.count,
        "B": scenario.boat.count,
        "M": scenario.targets,
        "V": max(scenario.current.vortices, 1),
        "I": scenario.auv.count if scenario.nodes.information == "own-visits" else 1,
        "O": ObservationLayout.of(scenario).size,
        "R": len(scenario.task_definition.reward_names),
    }
    arrays = {**state_arrays(scenario.task_definition), **REWARDS}
    return {
        name: (
            *(lengths[axis] if in_use.get(name, True) else 1 for axis in array.axes),
            *([len(array.names)] if array.names else []),
        )
        for name, array in arrays.items()
    }


def padded_length(shape: Sequence[int]) -> int:
    """Length of an array with the padding that aligns the next one."""
    return -(-math.prod(shape) // ALIGNMENT) * ALIGNMENT


class StateBuffer(NamedTuple):
    """The arrays of `STATE` and `REWARDS` of worlds, one after the other, so that one check finds any fault.

    Attributes:
        numbers: all of them, (N,) float32.
        arrays: views of these by name.
        spans: of each array that every world has the first row of `ALIGNMENT` numbers, and the numbers of a world,
            (…, 2) int32.
        limits: of all numbers.
    """

    numbers: torch.Tensor
    arrays: dict[str, torch.Tensor]
    spans: torch.Tensor
    limits: Limits


def allocate(
    shapes: Mapping[str, Sequence[int]], scenario: Scenario, num_worlds: int, device: torch.device
) -> StateBuffer:
    """A buffer of zeros for arrays of these shapes, in worlds of this scenario."""
    lengths = [padded_length(shape) for shape in shapes.values()]
    numbers = torch.zeros(sum(lengths), dtype=torch.float32, device=device)
    named = zip(numbers.split(lengths), shapes.items(), strict=True)
    arrays = {name: part[: math.prod(shape)].view(*shape) for part, (name, shape) in named}
    rows = np.cumsum([0, *lengths]) // ALIGNMENT
    each = [
        (row, math.prod(shape[1:])) for row, shape in zip(rows, shapes.values(), strict=False) if shape[0] == num_worlds
    ]
    spans = torch.tensor(np.array(each, np.int32), device=device)
    return StateBuffer(numbers, arrays, spans, limits_of(shapes, scenario, device))


def limits_of(shapes: Mapping[str, Sequence[int]], scenario: Scenario, device: torch.device) -> Limits:
    """Limits of the numbers of arrays of these shapes that lie one after the other, each in rows of its own."""
    bounds, which, bits = bounds_of(scenario), [], []
    for name, shape in shapes.items():
        columns = bounds.get(name, ANYTHING * np.array([[-1], [1]], np.float32))
        period = columns.shape[1] // math.gcd(columns.shape[1], ALIGNMENT)  # rows after which the columns are the same
        low, high = np.tile(columns, ALIGNMENT * period // columns.shape[1])
        which.append(len(bits) + np.arange(padded_length(shape) // ALIGNMENT) % period)
        least, greatest = (side.view(np.int32).reshape(period, ALIGNMENT) for side in (abs(low), high))
        bits += [*np.stack((greatest, greatest ^ least), 1)]
    tables = np.concatenate(which).astype(np.int32), np.array(bits, np.int32)
    return Limits(*(torch.tensor(table, device=device) for table in tables))


def bounds_of(scenario: Scenario) -> dict[str, np.ndarray]:
    """Bounds of each column of the arrays of `STATE` that has ranges, (2, columns) float32: low, high."""
    numbers: dict[Any, float] = {
        "width": scenario.area.width,
        "length": scenario.area.length,
        "targets": scenario.targets,
        "last_target": scenario.targets - 1,
        "last_auv": scenario.auv.count - 1,
        "last_boat": scenario.boat.count - 1,
        "last_kind": len(scenario.nodes.arrival_rates) - 1,
    }
    arrays = state_arrays(scenario.task_definition)
    sides = {name: ([r.low for r in array.ranges], [r.high for r in array.ranges]) for name, array in arrays.items()}
    return {
        name: np.array([[numbers.get(b, b) for b in side] for side in both], np.float32)
        for name, both in sides.items()
        if both[0]
    }


def first_outside(
    name: str, values: torch.Tensor, scenario: Scenario, columns: Sequence[str] = ()
) -> tuple[int, str] | None:
    """World and description of an array's first number (W, ..., columns) outside its column's bounds; None without one.

    Args:
        name: of the array.
        columns: names of the numbers in an array whose columns have no ranges.
    """
    values = values.detach().double().cpu()
    bounds = bounds_of(scenario)
    array = state_arrays(scenario.task_definition).get(name)
    ranges = array.ranges if array else ()
    if not ranges:
        wrong = ~(values.abs() <= ANYTHING)
    else:
        low, high = torch.from_numpy(bounds[name]).double()
        whole = torch.tensor([allowed.whole for allowed in ranges], device="cpu")
        wrong = ~((values >= low) & (values <= high)) | (whole & (values != values.round()))
    places = wrong.nonzero()
    if not len(places):
        return None
    place = places[0].tolist()
    value = float(values[tuple(place)])
    if array is None or not ranges:
        column = f" {columns[place[2]]!r}" if columns else ""
        return place[0], f"{name}{column} of AUV {place[1]} is {value:g}"
    column = place[-1]
    whose = f"{array.whose} {place[1]}" if array.whose else f"the {name}"
    rule = "a whole number from" if ranges[column].whole else "from"
    low, high = bounds[name][:, column]
    return place[0], f"{array.names[column]} of {whose} is {value:g}: must be {rule} {low:g} to {high:g}"


def first_fault(
    arrays: Mapping[str, torch.Tensor], scenario: Scenario, columns: Mapping[str, Sequence[str]]
) -> tuple[int, str]:
    """World and description of the first impossible number in arrays; `columns` as in `first_outside`, by array."""
    for name, values in arrays.items():
        if (problem := first_outside(name, values, scenario, columns.get(name, ()))) is not None:
            return problem
    return 0, "its state was not finite"


def checked_state(given: object, own: Mapping[str, torch.Tensor], scenario: Scenario) -> dict[str, torch.Tensor]:
    """A state, without gradients; one that a world of this scenario cannot have is refused.

    Args:
        given: the state to load. own: the world's present state, for names, shapes and types.

    Raises:
        ScenarioError: it is another world's state, or a number is out of range.
    """

    def refuse(problem: str) -> NoReturn:
        raise ScenarioError(f"state of the world: {problem}")

    if not isinstance(given, Mapping):
        refuse(f"is a {type(given).__name__}: must be what World.state returned")
    if given.keys() != own.keys():
        missing, unknown = sorted(own.keys() - given.keys()), sorted(given.keys() - own.keys(), key=str)
        refuse(f"{missing[0]} is missing" if missing else f"{unknown[0]} is unknown")
    for name, mine in own.items():
        value = given[name]
        if not _has_numbers(value):
            kind = f"{value.device} tensor" if isinstance(value, torch.Tensor) else type(value).__name__
            refuse(f"{name} is a {kind}: must be a dense tensor with numbers")
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
        elif (problem := first_outside(name, value, scenario)) is not None:
            refuse(f"world {problem[0]}: {problem[1]}")
    return {name: given[name].detach() for name in own}


def _has_numbers(value: object) -> TypeGuard[torch.Tensor]:
    """Whether it is a tensor in memory, number by number."""
    return isinstance(value, torch.Tensor) and value.layout is torch.strided and not value.is_meta


def check_same(before: Scenario, after: Scenario, but_for: Collection[str], problem: str) -> None:
    """Refuse a scenario that differs from another in a field outside `but_for`; `problem` is part of the message.

    Raises:
        ScenarioError: it differs.
    """
    for name, value, _ in after.differences(before):
        if name not in but_for:
            raise ScenarioError(f"{name} = {value!r}: {problem}; what may differ is {', '.join(but_for)}")


def numbers_of(name: str, given: object, shape: Sequence[int]) -> torch.Tensor:
    """An argument of `World.step` as a tensor of that shape.

    Raises:
        ScenarioError: it does not hold real numbers, or has another shape.
    """
    given = _tensor(given)
    if not _has_numbers(given) or given.is_complex():
        raise ScenarioError(f"{name} = {_shown(given)}: must be real numbers of shape {tuple(shape)}")
    if given.shape != shape:
        raise ScenarioError(f"{name} has shape {tuple(given.shape)}: must be {tuple(shape)}")
    return given.detach() if given.requires_grad else given


def _tensor(given: object) -> object:
    """Real numbers in single precision, or bools, as a tensor; a tensor and anything else unchanged.

    Dates, text, objects and values that a masked array hides are no numbers, although NumPy converts them.
    """
    if isinstance(given, torch.Tensor) or _hides(given):
        return given
    try:
        array = np.asarray(given)
        if array.dtype.kind not in "biuf":
            return given
        with np.errstate(over="ignore"):  # infinite ones are refused
            return torch.from_numpy(np.array(array, bool if array.dtype.kind == "b" else np.float32))
    except (TypeError, ValueError):
        return given


def _hides(given: object) -> bool:
    """Whether a masked array in it hides a value."""
    return any(map(_hides, given)) if isinstance(given, list | tuple) else np.ma.is_masked(given)


def _shown(given: object) -> str:
    """What was given, on one short line."""
    return f"{' '.join(repr(given).split()):.80}"


def mask_of(given: object, num_worlds: int, begun: bool) -> torch.Tensor:
    """The mask given to `World.reset`; `begun` if all worlds have an episode.

    Raises:
        ScenarioError: it is not one bool per world, or leaves out a world that has not begun.
    """
    mask = _tensor(given)
    if not _has_numbers(mask):
        raise ScenarioError(f"mask = {_shown(given)}: must be a bool for each of {num_worlds} worlds")
    if mask.dtype != torch.bool or mask.shape != (num_worlds,):
        raise ScenarioError(f"mask is {mask.dtype} of shape {tuple(mask.shape)}: must be bool of ({num_worlds},)")
    if not begun and not mask.all():
        raise ScenarioError("mask: leaves out worlds that have not begun: call reset of all worlds first")
    return mask
