"""A mirrored world has a mirrored future: positions, currents, long waves and actions mirrored, nothing else changed.

Without storm, whose directions are drawn about a mean, and with sound so loud that the fixes' noise, which is not
mirrored, is far below a millimetre. The long waves are mirrored by the edge that they come in from.
"""

import re

import numpy as np
import pytest
import torch

from tests.links import EVERY_STEP
from usvauv.env import Scenario, World
from usvauv.kernels.flow.vortex import Vortex
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, NodeColumn, TallyColumn

STEPS, WORLDS = 80, 12
SIDES = {"x": 240.0, "y": 160.0}  # of the area, m: the diagonal's mirror exchanges them
LOUD = ["acoustics.source_level=240", "usbl.attitude_error=0", "storm.spectrum=none"]
COLUMNS = {
    "auv": AuvColumn.names,
    "node": NodeColumn.names,
    "vortex": Vortex.names,
    "boat": BoatColumn.names,
    "tally": TallyColumn.names,
    "estimate": EstimateColumn.names,
}
PLACES = {"x", "y", "fix_x", "fix_y", "heard_x", "heard_y", "goal_x", "goal_y"}
EDGES = {
    "x": {"east": "west", "north": "north"},
    "y": {"east": "east", "north": "south"},
    "diagonal": {"east": "north", "north": "east"},
}


def image(name: str, mirror: str) -> tuple[str, float, float]:
    """Column whose value a column takes in the mirror, with what sign, and what is added."""
    if name == "Gamma":
        return name, -1.0, 0.0
    if name == "covariance_xy":
        return name, 1.0 if mirror == "diagonal" else -1.0, 0.0
    if mirror == "diagonal":
        return (
            re.sub("(?<![a-z])(x|y|xx|yy)$", lambda axis: axis[0].translate(str.maketrans("xy", "yx")), name),
            1.0,
            0.0,
        )
    if name == mirror or name.endswith(f"_{mirror}"):
        return name, -1.0, SIDES[mirror] if name in PLACES else 0.0
    return name, 1.0, 0.0


def mirrored(name: str, table: torch.Tensor, mirror: str) -> torch.Tensor:
    """A table of the world's state in the mirror."""
    columns = COLUMNS[name]
    found = torch.empty_like(table)
    for index, column in enumerate(columns):
        other, sign, shift = image(column, mirror)
        found[..., index] = shift + sign * table[..., columns.index(other)]
    return found


def mirrored_action(action: torch.Tensor, mirror: str) -> torch.Tensor:
    if mirror == "diagonal":
        return action.flip(-1)
    return action * torch.tensor([-1.0, 1.0] if mirror == "x" else [1.0, -1.0])


@pytest.mark.parametrize(
    ("mirror", "usv", "edge", "seed"),
    [("x", "fim", "east", 1), ("diagonal", "fim", "east", 3)],
)
def test_mirrored_worlds_have_mirrored_futures(mirror, usv, edge, seed):
    def built(edge: str, width: float, length: float) -> World:
        place = [f"sea.forced_edge={edge}", "sea.radiating_edges=[]", f"area.width={width}", f"area.length={length}"]
        place += [
            "sea.irregular_rms=2",
            "sea.cell_size=4",
            "sea.forcing=elevation",
            "auv.speed_noise=0",
        ]  # whose numbers have no mirror
        world = World(Scenario.load("extreme", [*EVERY_STEP, *LOUD, *place]), WORLDS, seed, usv)
        world.reset()
        return world

    sides = list(SIDES.values())
    one = built(edge, *sides)
    other = built(EDGES[mirror][edge], *(sides[::-1] if mirror == "diagonal" else sides))
    state = other.state()
    other.load_state(state | {name: mirrored(name, getattr(one, name), mirror) for name in COLUMNS})
    generator = torch.Generator().manual_seed(seed)
    deployed = one.auv[..., AuvColumn.span("x", "y")].clone()
    services = 0
    for _ in range(STEPS):
        towards = one.node.gather(1, one.auv[..., AuvColumn.target, None].long().expand(-1, -1, len(NodeColumn.names)))
        offset = towards[..., NodeColumn.span("x", "y")] - one.auv[..., AuvColumn.span("x", "y")]
        speed = 0.5 + 0.5 * torch.rand(WORLDS, 2, 1, generator=generator).to(offset.device)
        action = offset / offset.norm(dim=-1, keepdim=True) * speed
        _, reward, ended, *_ = one.step(action)
        services += int((one.auv[..., AuvColumn.service_rate] > 0).sum())
        _, reward_there, ended_there, *_ = other.step(mirrored_action(action, mirror))
        np.testing.assert_allclose(reward_there, reward, atol=5e-2)
        assert torch.equal(ended, ended_there)
    assert services > 0
    assert (one.auv[..., AuvColumn.span("x", "y")] - deployed).norm(dim=-1).min() > 5
    assert one.boat[..., BoatColumn.elevation].abs().max() > 0.3
    for name in COLUMNS:
        expected = mirrored(name, getattr(one, name), mirror)
        for index, column in enumerate(COLUMNS[name]):
            np.testing.assert_allclose(
                getattr(other, name)[..., index],
                expected[..., index],
                atol=1e-2,
                rtol=1e-3,
                err_msg=f"{name} {column}",
            )
