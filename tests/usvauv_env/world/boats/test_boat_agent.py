"""Boats as agents: what they observe against NumPy, where their actions lead, and what is refused."""

import math

import numpy as np
import pytest
import torch
from pettingzoo.test import parallel_api_test

from usvauv.env import Scenario, ScenarioError, World, parallel_env
from usvauv.env.world.agents import boat_observed, global_state, global_state_size, observe_boats
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    NodeColumn,
)
from usvauv.kernels.positioning import tracker

TWO = Scenario.load("wide", ["auv.count=3", "boat.count=2", "nodes.count=20", "mission.duration=40"])
DIAGONAL = math.hypot(600, 600)


@pytest.fixture(scope="module")
def world():
    return World(TWO, 4, 5, "agent")


def still(world):
    return torch.zeros(world.num_worlds, world.num_auvs, 2, device=world.device)


def test_a_boat_goes_where_its_action_leads():
    """Velocity through the water is the action times the top speed, at most that, and the current adds to it."""
    ideal = ["boat.response_time=0", "boat.windage=0", "boat.dead_band=0", "boat.top_speed=2", "boat.thrust=0"]
    world = World(Scenario.load("wide", ["auv.count=3", "boat.count=2", "nodes.count=20", *ideal]), 4, 5, "agent")
    world.reset()
    world.boat[..., : BoatColumn.y + 1] = torch.tensor([[300.0, 300.0], [250.0, 350.0]], device=world.device)
    action = torch.tensor([[0.5, -0.25], [3.0, 4.0]], device=world.device).expand(4, 2, 2)
    wanted = torch.tensor([[0.5, -0.25], [0.6, 0.8]], device=world.device)
    for _ in range(5):
        current = world.boat[..., BoatColumn.span("current_x", "current_y")].clone()
        world.step(still(world), action)
        moved = world.boat[..., BoatColumn.span("moved_x", "moved_y")]
        torch.testing.assert_close(moved, current + 2.0 * wanted.expand_as(moved), atol=2e-4, rtol=0)
        effort = world.boat[..., BoatColumn.effort]
        torch.testing.assert_close(effort, wanted.norm(dim=-1).expand_as(effort), atol=2e-4, rtol=0)


def test_the_observation_is_what_its_table_says(world):
    world.reset()
    for _ in range(30):
        world.step(still(world), torch.ones(4, 2, 2, device=world.device))
    observation = observe_boats(world).cpu().numpy()
    assert observation.shape == (4, 2, len(boat_observed(TWO))) == (4, 2, 2 + 2 + 3 * 5)
    boat, foresight, estimate = (
        array.cpu().numpy() for array in (world.boat[..., :2], world.foresight, world.estimate)
    )
    silence = world.exchange[..., ExchangeColumn.elapsed].cpu().numpy()
    track = world.track.cpu().numpy()
    for w in range(4):
        for b in range(2):
            row = [*boat[w, b] / DIAGONAL, *(boat[w, 1 - b] - boat[w, b]) / DIAGONAL]
            for k in range(3):
                row += list((foresight[w, k, : ForesightColumn.y + 1] - boat[w, b]) / DIAGONAL)
                row.append(math.sqrt(0.5 * (track[w, k, tracker.XX] + track[w, k, tracker.YY])) / DIAGONAL)
                row += [silence[w, k] / 300, estimate[w, k, EstimateColumn.served_by] == b]
            np.testing.assert_allclose(observation[w, b], row, rtol=1e-5, atol=1e-6)
    assert (observation[..., [8, 13, 18]].sum(1) == 1).all()  # each AUV is served by one boat
    assert observation[..., 7].max() > 0  # some AUV is silent


def test_actions_that_are_none_are_refused(world):
    world.reset()
    for action, message in (
        (None, "boat_action: missing, but the boat's strategy is 'agent'"),
        (torch.zeros(4, 2), "boat_action has shape"),
        (torch.full((4, 2, 2), math.nan), "boat_action: all numbers must be finite"),
    ):
        with pytest.raises(ValueError, match=message):
            world.step(still(world), action if action is None else action.to(world.device))
    with pytest.raises(ScenarioError, match=r"'agent' foresees AUVs .* needs navigation"):
        World(Scenario.load("extreme", ["navigation.sensor=none"]), 1, usv="agent")


def test_the_global_state_is_the_truth(world):
    world.reset()
    state = global_state(world).cpu().numpy()
    assert state.shape == (4, global_state_size(TWO)) == (4, 6 * 3 + 2 * 2 + 20)
    auv = world.auv.cpu().numpy()
    np.testing.assert_allclose(state[:, :6], auv[..., : AuvColumn.y + 1].reshape(4, 6) / DIAGONAL, rtol=1e-6)
    for _ in range(3):
        world.step(still(world), torch.ones(4, 2, 2, device=world.device))
    state, auv = global_state(world).cpu().numpy(), world.auv.cpu().numpy()
    error = (world.own_position.cpu().numpy() - auv[..., : AuvColumn.y + 1]).reshape(4, 6) / DIAGONAL
    np.testing.assert_allclose(state[:, 6:12], error, atol=1e-6)
    assert np.abs(error).max() > 1e-5
    current = auv[..., AuvColumn.current_x : AuvColumn.current_y + 1].reshape(4, 6)
    np.testing.assert_array_equal(state[:, 12:18], current)
    assert np.abs(current).max() > 1e-3
    backlog = world.node[..., NodeColumn.backlog].cpu().numpy()
    np.testing.assert_allclose(state[:, 22:], backlog / TWO.nodes.buffer, rtol=1e-6)
    np.testing.assert_allclose(state[:, 18:22], world.boat[..., :2].cpu().numpy().reshape(4, 4) / DIAGONAL, rtol=1e-6)


def test_boats_are_agents_of_the_parallel_environment():
    env = parallel_env(TWO, "agent")
    assert env.possible_agents == ["auv_0", "auv_1", "auv_2", "usv_0", "usv_1"]
    observation, _ = env.reset(seed=5)
    assert {agent: len(row) for agent, row in observation.items() if agent[0] == "u"} == {"usv_0": 19, "usv_1": 19}
    assert env.state().shape == env.state_space.shape == (42,)
    _, reward, *_ = env.step({agent: np.zeros(2, np.float32) for agent in env.agents})
    assert reward["usv_0"] == pytest.approx(np.mean([reward[f"auv_{k}"] for k in range(3)]))
    parallel_api_test(env, 50)


def test_boats_are_a_group_of_the_torchrl_environment():
    pytest.importorskip("torchrl")
    from torchrl.envs.utils import check_env_specs

    from usvauv.env.interfaces.torchrl_env import DataCollectionTorchRLEnv

    env = DataCollectionTorchRLEnv(TWO, 4, 5, "agent")
    check_env_specs(env)
    data = env.rollout(3)
    assert env.group_map["boats"] == ["usv_0", "usv_1"]
    rewards = data["next", "agents", "reward"].mean(-2, keepdim=True).expand(-1, -1, 2, -1)
    torch.testing.assert_close(data["next", "boats", "reward"], rewards)
