"""The motion of a boat with a lag against closed forms, and about its goal in waves."""

import math

import numpy as np
import pytest
import torch

from usvauv.env import Scenario, ScenarioError, World
from usvauv.kernels.mission.columns import BoatColumn

PLACE = BoatColumn.span("x", "y")
CURRENT = BoatColumn.span("current_x", "current_y")
SECTIONS = {
    "area": {"width": 2000, "length": 2000},
    "mission": {"duration": 3000},
    "boat": {"response_time": 3, "top_speed": 2},
    "auv": {"count": 1},
    "nodes": {"arrival_rates": [1]},
}


def world_of(goal, num_worlds=1, **sections):
    """A world whose boat holds a goal (x, y), put at (100, 100) at rest."""
    merged = {name: SECTIONS.get(name, {}) | sections.get(name, {}) for name in SECTIONS | sections}
    world = World(Scenario.from_dict({"task": "station-keeping", **merged}), num_worlds, 4, f"hold:{goal[0]},{goal[1]}")
    world.reset()
    world.boat[..., PLACE] = 100.0
    return world


def sailed(world, steps, current=None, boat_action=None):
    """Places (steps, W, 2) of the boat after each step, in a current given, m."""
    places = []
    for _ in range(steps):
        if current is not None:
            world.boat[..., CURRENT] = torch.tensor(current)
        world.step(torch.zeros(world.num_worlds, world.num_auvs, 2), boat_action)
        places.append(world.boat[:, 0, PLACE].double().clone())
    return torch.stack(places).cpu().numpy()


@pytest.mark.parametrize("step", [0.5, 7.0])
def test_its_speed_follows_with_the_response_time(step):
    """v = V (1 − e^{−t/T}) and x = V t − V T (1 − e^{−t/T}) at any step; its effort is the mean speed of a step."""
    world = world_of((1900, 100), mission={"step": step})
    x = sailed(world, 6)[:, 0, 0] - 100
    t = step * np.arange(1, 7)
    expected = 2 * t - 2 * 3 * (1 - np.exp(-t / 3))
    np.testing.assert_allclose(x, expected, atol=1e-3)
    assert world.boat[0, 0, BoatColumn.water_x].item() == pytest.approx(2 * (1 - math.exp(-t[-1] / 3)), rel=1e-5)
    effort = (expected[-1] - expected[-2]) / (2 * step)
    assert world.boat[0, 0, BoatColumn.effort].item() == pytest.approx(effort, rel=1e-3)


def test_adrift_it_has_the_current_and_the_leeway():
    """The wind blows as the storm travels, here to the north, and drives the boat at a share of its speed."""
    world = world_of(
        (100, 100),
        boat={"top_speed": 1e-4, "windage": 0.03},
        acoustics={"wind": 10},
        storm={"direction": math.pi / 2},
    )
    x, y = sailed(world, 40, (0.2, -0.1))[-1, 0]
    assert x == pytest.approx(100 + 40 * 0.2, abs=0.02)
    assert y == pytest.approx(100 + 40 * (0.3 - 0.1), abs=0.02)


@pytest.mark.parametrize(("step", "response"), [(1.0, 0.5), (1.0, 3.0), (10.0, 3.0), (1.0, 60.0), (10.0, 60.0)])
def test_it_reaches_its_goal_without_overshoot(step, response):
    world = world_of((300, 200), mission={"step": step, "duration": 100 * step}, boat={"response_time": response})
    left = (sailed(world, math.ceil(900 / step) if step > 1 else 900)[:, 0] - [300, 200]) @ [2, 1] / math.sqrt(5)
    assert left.max() < 1e-2
    assert (np.diff(left) > -1e-2).all()
    assert abs(left[-1]) < 1e-2


def test_it_holds_its_goal_in_a_steady_current():
    """The mean offset goes to nothing with its estimate of the drift, without a cycle about it."""
    offset = sailed(world_of((100, 100)), 400, (0.6, -0.9))[:, 0] - 100
    assert np.abs(offset[10]).max() > 3
    assert np.abs(offset[-50:]).max() < 1e-2


def test_within_the_dead_band_it_makes_good_the_drift_alone():
    world = world_of((110, 100), boat={"dead_band": 20})
    offset = sailed(world, 400, (0.5, 0.0))[:, 0]
    assert np.abs(np.diff(offset[-50:], axis=0)).max() < 1e-3
    assert np.linalg.norm(offset[-1] - [110, 100]) < 20.1
    still = sailed(world_of((110, 100), boat={"dead_band": 20}), 5)
    assert (still == 100).all()


def test_a_current_above_its_top_speed_carries_it_off_with_the_rest():
    x = sailed(world_of((100, 100)), 200, (2.5, 0.0))[:, 0, 0]
    np.testing.assert_allclose(np.diff(x[-60:]), 0.5, atol=1e-3)


def test_in_waves_it_moves_as_the_water_does():
    """Its excursion about the mean is that of the water's surface, √Σ ½ (a coth kh)², within a quarter.

    The sea is so low that the Stokes drift of its groups moves the boat little beside that.
    """
    world = world_of(
        (1000, 1000),
        num_worlds=16,
        area={"depth": 120},
        storm={"spectrum": "jonswap", "significant_height": 1},
        boat={"top_speed": 4, "windage": 0.02},
        sea={"realisations": 16},
    )
    world.boat[..., PLACE] = 1000.0
    places = sailed(world, 400)[100:]
    storm = world.storm
    depth = world.scenario.area.depth
    radius = storm.amplitude / np.tanh(storm.k * depth)
    expected = math.sqrt(0.5 * (radius**2).sum() / 16)
    slow = places.mean(axis=0)
    excursion = math.sqrt(((places - slow) ** 2).sum(axis=-1).mean())
    assert excursion == pytest.approx(expected, rel=0.25)
    assert np.linalg.norm(slow - 1000, axis=-1).max() < 5


def test_a_state_brought_back_has_the_same_future():
    world = world_of((300, 200), boat={"windage": 0.02, "dead_band": 2}, storm={"spectrum": "jonswap"})
    sailed(world, 20)
    state = world.state()
    first = sailed(world, 10)
    world.load_state(state)
    assert (sailed(world, 10) == first).all()
    for column in range(BoatColumn.water_x, BoatColumn.drift_y + 1):  # each decides it
        changed = {name: value.clone() for name, value in state.items()}
        changed["boat"][0, 0, column] += 0.5
        world.load_state(changed)
        assert (sailed(world, 3) != first[:3]).any()


def test_a_dead_band_without_a_lag_is_refused():
    with pytest.raises(ScenarioError, match=r"ideal: boat: dead_band = 3: must be 0 where response_time is 0"):
        Scenario.load("ideal", ["boat.response_time=0", "boat.windage=0", "boat.dead_band=3"])
