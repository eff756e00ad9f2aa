"""PettingZoo face of the world: one mission, each AUV an agent that acts at the same time as the others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv

from usvauv_env.faces.camera import FPS, MODES
from usvauv_env.faces.gymnasium_env import DataCollectionEnv
from usvauv_env.scenario import Scenario
from usvauv_env.world.spaces import auv_action_space, auv_observation_space


class DataCollectionParallelEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """One mission with the agents "auv_0", "auv_1", …, all of them until its time is over.

    observation (O,) and action (2,) of an agent are those of one AUV in `usvauv_env.world.world.World`, clamped into
    their spaces; reward is the AUV's own. `terminated` is always False and all are truncated in the same step. An
    agent's
    info: "reward_terms" (R,), "measures" (6,), and "horizon_ended", that a service ended its value horizon (only with
    reward.service_terminates; the mission goes on). `reset(seed=s)` begins the first episode of
    `World(scenario, 1, s)`, `reset()` the next one. With render_mode "rgb_array" `render()` gives the
    mission so far as a picture, (720, 1280, 3) uint8.
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
        self.possible_agents = [f"auv_{k}" for k in range(self._team.world.num_auvs)]
        self.agents: list[str] = []
        self._observation_spaces = {a: auv_observation_space(self._team.world.site) for a in self.possible_agents}
        self._action_spaces = {a: auv_action_space() for a in self.possible_agents}

    def observation_space(self, agent: str) -> Box:
        """What `agent` can observe; the same object each time."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """What `agent` can do; the same object each time."""
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
        """Advance by one mission step; `actions` holds one (2,) for every agent.

        Raises:
            ResetNeeded: no episode is under way.
            ValueError: an agent has no action, or one that is not (2,) or not finite.
        """
        if not self.agents:
            raise gymnasium.error.ResetNeeded("no episode is under way: call reset")
        if set(actions) != set(self.agents):
            raise ValueError(f"actions are for {sorted(actions)}: must be for {self.agents}")
        joint = np.stack([np.asarray(actions[agent]) for agent in self.agents])
        observation, _, terminated, truncated, info = self._team.step(joint)
        agents = self.agents
        if truncated:
            self.agents = []
        infos = {
            agent: {
                "reward_terms": info["reward_terms"][k].copy(),
                "measures": info["measures"][k].copy(),
                "horizon_ended": bool(info["horizon_ended"][k]),
            }
            for k, agent in enumerate(agents)
        }
        return (
            self._by_agent(observation),
            {agent: float(info["auv_reward"][k]) for k, agent in enumerate(agents)},
            dict.fromkeys(agents, terminated),
            dict.fromkeys(agents, truncated),
            infos,
        )

    def render(self) -> np.ndarray | None:
        """The mission as it is now, (720, 1280, 3) uint8, RGB; None without a render mode."""
        return self._team.render()

    def _by_agent(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        return {agent: observation[k].copy() for k, agent in enumerate(self.possible_agents)}


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
