"""The arrays of a batch of worlds: their shapes, and how they lie in memory. W worlds, K AUVs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch

from usvauv.env.scenario import Scenario
from usvauv.env.world.observation import ObservationLayout
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BeliefColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    NodeColumn,
    TallyColumn,
)
from usvauv.kernels.positioning import tracker

ALIGNMENT = 16  # numbers
STATE = (
    *("auv", "node", "vortex", "boat", "tally", "estimate", "track", "own", "exchange", "foresight", "belief"),
    "observation",
)


def unused(scenario: Scenario, foresees: bool) -> tuple[str, ...]:
    """Names of the arrays that a scenario does without.

    Args:
        foresees: the boat's strategy foresees the AUVs.
    """
    reckons = scenario.navigation.sensor != "none"
    in_use = {
        "track": scenario.tracker.enabled or reckons,
        "own": reckons,
        "exchange": scenario.channel.schedule != "every-step",
        "foresight": foresees,
    }
    return tuple(name for name, used in in_use.items() if not used)


def shapes(scenario: Scenario, num_worlds: int, foresees: bool) -> dict[str, tuple[int, ...]]:
    """Shape of each array of `STATE` and of the rewards; a row for all worlds where it is unused."""
    team = (num_worlds, scenario.auv.count)
    knowing = scenario.auv.count if scenario.nodes.information == "own-visits" else 1
    used = {
        "auv": (*team, len(AuvColumn.names)),
        "node": (num_worlds, scenario.targets, len(NodeColumn.names)),
        "vortex": (num_worlds, max(scenario.current.vortices, 1), 4),
        "boat": (num_worlds, scenario.boat.count, len(BoatColumn.names)),
        "tally": (num_worlds, len(TallyColumn.names)),
        "estimate": (*team, len(EstimateColumn.names)),
        "track": (*team, tracker.COLUMNS),
        "own": (*team, tracker.COLUMNS),
        "exchange": (*team, len(ExchangeColumn.names)),
        "foresight": (*team, len(ForesightColumn.names)),
        "belief": (num_worlds, knowing, scenario.targets, len(BeliefColumn.names)),
        "observation": (*team, ObservationLayout.of(scenario).size),
        "reward": team,
        "reward_terms": (*team, len(scenario.task_definition.reward_names)),
    }
    return used | {name: (1, 1, used[name][-1]) for name in unused(scenario, foresees)}


def room(shape: Sequence[int]) -> int:
    """Numbers that an array takes beside others, each aligned."""
    return -(-math.prod(shape) // ALIGNMENT) * ALIGNMENT


def side_by_side(shapes: Mapping[str, Sequence[int]], device: torch.device) -> tuple[torch.Tensor, list[torch.Tensor]]:
    """All arrays as parts of one, float32 zeros, so that one look finds any fault: that one, (N,), and the parts."""
    numbers = torch.zeros(sum(map(room, shapes.values())), dtype=torch.float32, device=device)
    parts = numbers.split([room(shape) for shape in shapes.values()])
    return numbers, [part[: math.prod(shape)].view(*shape) for part, shape in zip(parts, shapes.values(), strict=True)]
