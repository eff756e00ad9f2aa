"""PettingZoo environment of the world: one mission in which AUVs, and boats if wanted, are agents acting together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv

from usvauv.env.interfaces.gymnasium_env import FPS, MODES, DataCollectionEnv
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.world.agents import (
    action_space,
    auv_observation_space,
    boat_observation_space,
    global_state,
    global_state_size,
    observe_boats,
)
from usvauv.env.world.state import numbers_of
from usvauv.env.world.world import NOT_BEGUN
from usvauv.kernels.mission.boats.boat_strategies import AGENT


class DataCollectionParallelEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """One mission with the agents "auv_0", "auv_1", …, all of them active until its time is over.

    An agent's observation (O,) and action (A,) are those of one AUV in `usvauv.env.world.world.World`, clamped into
    their spaces; its reward is the AUV's own. `terminated` is always False and all are truncated in the same step. Its
    info is "reward_terms" (R,), "measures" (6,), and "horizon_ended": a service ended its value horizon (only with
    reward.service_terminates; the mission continues). `reset(seed=s)` begins the first episode of
    `World(scenario, 1, s)`, `reset()` the next one. With render_mode "rgb_array" `render()` returns a picture of the
    mission so far, (720, 1280, 3) uint8.

    With usv = "agent" the boats are agents too, "usv_0", …: their observations and actions are those of
    `usvauv.env.world.agents`, their reward is the mean of the AUVs', their info is empty. `state()` is
    `usvauv.env.world.agents.global_state`, for centralised critics.
    """

    metadata = {  # noqa: RUF012 - PettingZoo defines it as a class attribute
        "name": "usvauv_data_collection_v0",
        "render_modes": list(MODES),
        "render_fps": FPS,
        "is_parallelizable": True,
    }

    def __init__(self, scenario: Scenario | str | Path, usv: str | None, render_mode: str | None) -> None:
        self.render_mode = render_mode
        self._team = DataCollectionEnv(scenario, usv, render_mode)
        world = self._team.world
        boats = world.scenario.boat.count if world.strategy.name == AGENT else 0
        self._auvs, self._boats = [f"auv_{k}" for k in range(world.num_auvs)], [f"usv_{b}" for b in range(boats)]
        self.possible_agents = self._auvs + self._boats
        self.agents: list[str] = []
        self._observation_spaces = {a: auv_observation_space(world.site) for a in self._auvs}
        self._observation_spaces |= {a: boat_observation_space(world.site) for a in self._boats}
        self._action_spaces = {a: action_space(world.action_size) for a in self._auvs}
        self._action_spaces |= {a: action_space() for a in self._boats}
        self.state_space = Box(-np.inf, np.inf, (global_state_size(world.scenario),), np.float32)

    def observation_space(self, agent: str) -> Box:
        """Space of observations of `agent`; the same object in each call."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """Space of actions of `agent`; the same object in each call."""
        return self._action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Begin the next episode, or with `seed` the first of that seed; no `options` are known."""
        observation, _ = self._team.reset(seed=seed)
        self.agents = self.possible_agents[:]
        return self._by_agent(observation), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, np.ndarray]
    ) -> tuple[dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Advance by one mission step; `actions` holds one for every agent.

        Raises:
            ResetNeeded: no episode is under way.
            ValueError: an agent's action is missing, has another shape or is not finite.
        """
        if not self.agents:
            raise gymnasium.error.ResetNeeded("no episode is under way: call reset first")
        if set(actions) != set(self.agents):
            raise ValueError(f"actions are for {sorted(actions)}: must be for {self.agents}")
        given = {a: numbers_of(f"action of {a}", actions[a], self._action_spaces[a].shape) for a in self.agents}
        joint = torch.stack([given[agent] for agent in self._auvs])
        boats = torch.stack([given[agent] for agent in self._boats]) if self._boats else None
        observation, reward, terminated, truncated, info = self._team.step_with_boats(joint, boats)
        agents = self.agents
        if truncated:
            self.agents = []
        infos = {
            agent: {
                "reward_terms": info["reward_terms"][k].copy(),
                "measures": info["measures"][k].copy(),
                "horizon_ended": bool(info["horizon_ended"][k]),
            }
            for k, agent in enumerate(self._auvs)
        } | {agent: {} for agent in self._boats}
        rewards = {agent: float(info["auv_reward"][k]) for k, agent in enumerate(self._auvs)}
        return (
            self._by_agent(observation),
            rewards | dict.fromkeys(self._boats, reward / len(self._auvs)),
            dict.fromkeys(agents, terminated),
            dict.fromkeys(agents, truncated),
            infos,
        )

    def render(self) -> np.ndarray | None:
        """The mission as it is now, (720, 1280, 3) uint8, RGB; None without a render mode."""
        return self._team.render()

    def state(self) -> np.ndarray:
        """The global state, (S,) float32.

        Raises:
            ResetNeeded: before the first reset.
        """
        if not self._team.world.begun:
            raise gymnasium.error.ResetNeeded(NOT_BEGUN)
        return global_state(self._team.world)[0].numpy(force=True)

    def _by_agent(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        found = {agent: observation[k].copy() for k, agent in enumerate(self._auvs)}
        if self._boats:
            known = observe_boats(self._team.world)[0].numpy(force=True)
            for row, agent in zip(known, self._boats, strict=True):
                space = self._observation_spaces[agent]
                found[agent] = np.clip(row, space.low, space.high)
        return found


def parallel_env(
    scenario: Scenario | str | Path = "extreme", usv: str | None = None, render_mode: str | None = None
) -> DataCollectionParallelEnv:
    """A PettingZoo parallel environment of one mission.

    Args:
        scenario: a `Scenario`, a shipped name or a path.
        usv: the boat's strategy, see `World`.
        render_mode: None or "rgb_array".

    Raises:
        ScenarioError: the scenario or the strategy cannot be used.
        TypeError: another render mode.
    """
    return DataCollectionParallelEnv(scenario, usv, render_mode)
