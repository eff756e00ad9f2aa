"""A mission step does not wait for a GPU: found without one, by refusing every operation that would."""

import math

import pytest
import torch

from tests.kernels.nothing_waits import NothingWaits
from usvauv.env import Scenario, World
from usvauv.kernels import runtime
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.mission.columns import AuvColumn

WORLDS = 4


@pytest.fixture
def elsewhere(monkeypatch, device):
    """A host in whose memory torch's tensors do not lie."""
    monkeypatch.setattr(runtime.Runtime, "torch_on_host", False)
    monkeypatch.setattr(runtime, "upload", lambda numbers, tensor: None)  # does not wait


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("extreme", []),
        pytest.param("paper-extreme", [], marks=pytest.mark.slow),
        pytest.param("station-keeping", [], marks=pytest.mark.slow),
    ],
)
def test_a_step_waits_for_nothing(elsewhere, name, settings):
    if not runtime.start().shares_memory_with_torch:
        pytest.skip("arrays are copied at each launch, which waits")
    world = World(Scenario.load(name, settings), WORLDS)
    world.reset()
    action = torch.full((WORLDS, world.num_auvs, 2), 0.3, device=world.device)
    world.step(action)  # compiles
    with NothingWaits():
        for _ in range(3):
            world.step(action)


def test_a_fault_is_found_one_step_later(elsewhere):
    world = World(Scenario.load("extreme"), WORLDS)
    world.reset()
    action = torch.zeros(WORLDS, world.num_auvs, 2, device=world.device)
    world.step(action)
    world.auv[2, 0, AuvColumn.x] = math.nan
    world.step(action)
    with pytest.raises(DivergenceError, match=r"^world 2 at 3 s: "):
        world.step(action)
