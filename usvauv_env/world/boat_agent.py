"""Boats as agents, with the strategy `agent`: what a boat observes.

Observation of boat b, float32, with D the area's diagonal, K AUVs and B boats: `boat_observed` tabulates it. What a
boat's action is says `World.step`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from usvauv.env.scenario import Scenario
from usvauv.env.world.observation import POSITION_BOUND, Quantity
from usvauv.kernels.mission.columns import BoatColumn, EstimateColumn, ExchangeColumn
from usvauv.kernels.positioning import tracker

if TYPE_CHECKING:
    from usvauv.env.world.world import World

SILENCE = 300.0  # s, the unit of times
LONGEST = 10.0  # of these units, beyond which all are alike


def boat_observed(scenario: Scenario) -> list[Quantity]:
    """The observation of one boat, number by number, with the bounds of the space."""
    diagonal = f"area's diagonal, {scenario.area.diagonal:.6g} m"
    rows = [(f"own {axis}", diagonal, 0.0, 1.0) for axis in "xy"]
    for other in range(1, scenario.boat.count):
        rows += [(f"{axis} of other boat {other} minus own {axis}", diagonal, -1.0, 1.0) for axis in "xy"]
    for k in range(scenario.auv.count):
        rows += [
            (f"{axis} where AUV {k} is foreseen, minus own {axis}", diagonal, -POSITION_BOUND, POSITION_BOUND)
            for axis in "xy"
        ]
        rows += [
            (f"standard deviation of where AUV {k} took itself to be when it was last heard", diagonal, 0.0, 1.0),
            (f"time since AUV {k} was heard", f"{SILENCE:g} s", 0.0, LONGEST),
            (f"1 if it serves AUV {k}, else 0", "1", 0.0, 1.0),
        ]
    return [Quantity(index, *row) for index, row in enumerate(rows)]


def observe_boats(world: World) -> torch.Tensor:
    """What all boats observe, (W, B, number of `boat_observed`)."""
    scale = 1.0 / world.scenario.area.diagonal
    own = world.boat[..., BoatColumn.span("x", "y")]
    boats = own.shape[1]
    away = (world.foreseen_position[:, None] - own[:, :, None]) * scale
    variance = 0.5 * (world.track[..., tracker.XX] + world.track[..., tracker.YY])
    deviation = (variance.clamp(min=0.0).sqrt() * scale).clamp(max=1.0)
    silence = (world.exchange[..., ExchangeColumn.elapsed] / SILENCE).clamp(max=LONGEST)
    served_by = world.estimate[:, None, :, EstimateColumn.served_by].round()
    serves = (served_by == torch.arange(boats, device=own.device)[:, None]).float()
    known = torch.stack([deviation, silence], -1)[:, None].expand(-1, boats, -1, -1)
    each = torch.cat([away, known, serves[..., None]], -1).flatten(2)
    others = (own[:, None] - own[:, :, None]) * scale
    rest = ~torch.eye(boats, dtype=torch.bool, device=own.device)
    return torch.cat([own * scale, others[:, rest].reshape(len(own), boats, -1), each], -1)
