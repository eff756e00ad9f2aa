"""Spaces of the agents, observations of boats as agents (strategy "agent"), and the global state of a mission.

`boat_observed` tabulates the observation of boat b, float32, with D the area's diagonal, K AUVs and B boats.
`World.step` describes a boat's action. The global state has true values, without noise, for centralised critics, which
receive everything while each agent receives its own observation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from gymnasium.spaces import Box

from usvauv.env.scenario.scenario import Scenario
from usvauv.env.sea.water import current_bound
from usvauv.env.site.site import Site
from usvauv.env.world.observation_layout import ObservationLayout, Quantity
from usvauv.env.world.world import World
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, ExchangeColumn, NodeColumn
from usvauv.kernels.mission.observation import POSITION_BOUND, observation_terms, quantities
from usvauv.kernels.positioning import tracker

SILENCE = 300.0  # s, the unit of times
LONGEST = 10.0  # of these units; longer times are clamped to it


def observed(site: Site) -> list[Quantity]:
    """The observation of one AUV, number by number, with the bounds of the space."""
    scenario, largest = site.scenario, current_bound(site)
    layout = ObservationLayout.of(scenario)
    rows: list[Quantity] = []
    for name in layout.terms:
        term = observation_terms[name]
        unit = f"area's diagonal, {scenario.area.diagonal:.6g} m" if term.unit == "D" else term.unit
        low, high = (math.copysign(largest, x) if math.isinf(x) else x for x in (term.low, term.high))
        for text in quantities(name, layout.num_auvs, layout.num_nodes):
            rows.append(Quantity(len(rows), text, unit, low, high))
    return rows


def auv_observation_space(site: Site) -> Box:
    """Space of one AUV's observations, (O,), as `observed` tabulates them.

    Fixes and storm waves have no hard bounds: the rare observation beyond (fixes at a low signal-to-noise ratio in very
    large areas, freak waves) is clamped into the space.
    """
    return _box(observed(site))


def boat_observation_space(site: Site) -> Box:
    """Space of one boat's observations with the strategy "agent", as `boat_observed` tabulates them."""
    return _box(boat_observed(site.scenario))


def _box(rows: Sequence[Quantity]) -> Box:
    low, high = (np.array([row[column] for row in rows], np.float32) for column in (3, 4))
    return Box(low, high, dtype=np.float32)


def action_space(size: int = 2) -> Box:
    """Space of one boat's actions, (2,), or of an AUV's, (`World.action_size`,)."""
    return Box(-1.0, 1.0, (size,), np.float32)


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
    """Observations of all boats, (W, B, length of `boat_observed`)."""
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


def global_state_size(scenario: Scenario) -> int:
    """Length of the global state."""
    return 6 * scenario.auv.count + 2 * scenario.boat.count + scenario.targets


def global_state(world: World) -> torch.Tensor:
    """The state (W, `global_state_size`): true x and y of each AUV over the area's diagonal D; its own position
    estimate minus these, over D; the current there, m/s; x and y of each boat over D; each buffer's filled share.
    """
    scale = 1.0 / world.scenario.area.diagonal
    place = world.auv[..., AuvColumn.span("x", "y")]
    return torch.cat(
        [
            (place * scale).flatten(1),
            ((world.own_position - place) * scale).flatten(1),
            world.auv[..., AuvColumn.span("current_x", "current_y")].flatten(1),
            (world.boat[..., BoatColumn.span("x", "y")] * scale).flatten(1),
            world.node[..., NodeColumn.backlog] / world.scenario.nodes.buffer,
        ],
        1,
    )
