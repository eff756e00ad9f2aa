"""The global state of a mission, for critics that see everything while agents see their own: truth, without noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from usvauv.env.scenario import Scenario
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, NodeColumn

if TYPE_CHECKING:
    from usvauv.env.world.world import World


def size(scenario: Scenario) -> int:
    """Numbers of the state."""
    return 6 * scenario.auv.count + 2 * scenario.boat.count + scenario.targets


def global_state(world: World) -> torch.Tensor:
    """The state (W, `size`): true x and y of each AUV over the area's diagonal D; where it takes itself to be, less
    that, over D; the current there, m/s; x and y of each boat over D; the filled share of each node's buffer.
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
