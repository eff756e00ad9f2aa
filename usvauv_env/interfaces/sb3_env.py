"""Stable-Baselines3 environment of the world: `AuvVecEnv`, with one environment for each AUV of each mission.

W worlds, K AUVs, O numbers in an AUV's observation; environment w·K + k is AUV k of world w, and all share one policy.

    observation  (W·K, O)  float32  as `usvauv.env.world.world.World` tabulates it, clamped into `observation_space`
    action       (W·K, A)  float32  in [−1, 1]; values outside are clipped
    reward       (W·K,)    float32  the AUV's own, times `reward_scale`
    done         (W·K,)    bool     the mission's time is over; the observation is then the next mission's first
    info                            "auv_reward", the AUV's reward unscaled, always; with done also
                                    "terminal_observation" (O,) and "TimeLimit.truncated", which is True

This module needs the extra `sb3`; nothing else in the package imports it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode

from usvauv.env.interfaces.gymnasium_env import DataCollectionVectorEnv
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.world.state import numbers_of

try:
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError as missing:
    if (missing.name or "").partition(".")[0] != "stable_baselines3":
        raise
    raise ModuleNotFoundError(
        'the Stable-Baselines3 face needs the extra sb3: pip install "usvauv[sb3]"', name="stable_baselines3"
    ) from None


class AuvVecEnv(VecEnv):
    """Many missions as a vectorised environment of Stable-Baselines3, one environment per AUV.

    The first `reset` begins the first episodes of `World(scenario, num_worlds, seed)`, each further one the next ones;
    after `seed(s)` it begins the first ones of seed s. With render_mode "rgb_array" `render()` shows all worlds side
    by side.

    Args:
        scenario: a `Scenario`, a shipped name or a path.
        num_worlds: number of missions W.
        seed: of the first `reset`; by default random.
        usv: the boat's strategy, see `World`.
        render_mode: None or "rgb_array".
        reward_scale: factor on rewards: a service gives some tens, and many learners expect rewards of order one.

    Raises:
        ScenarioError: the scenario, the strategy or `num_worlds` cannot be used.
        TypeError: another render mode.
    """

    def __init__(
        self,
        scenario: Scenario | str | Path = "extreme",
        num_worlds: int = 1,
        seed: int | None = None,
        usv: str | None = None,
        render_mode: str | None = None,
        reward_scale: float = 1.0,
    ) -> None:
        self.worlds = DataCollectionVectorEnv(num_worlds, scenario, usv, AutoresetMode.DISABLED, render_mode)
        self.num_auvs, self.reward_scale, self.render_mode = self.worlds.world.num_auvs, reward_scale, render_mode
        team, moves = self.worlds.single_observation_space, self.worlds.single_action_space
        assert isinstance(team, Box)
        assert isinstance(moves, Box)
        observation = Box(team.low[0], team.high[0], dtype=np.float32)
        super().__init__(num_worlds * self.num_auvs, observation, Box(moves.low[0], moves.high[0], dtype=np.float32))
        if seed is not None:
            self.seed(seed)

    def reset(self) -> np.ndarray:
        """Begin an episode in all worlds: the first of a newly set seed, else the next."""
        observation, _ = self.worlds.reset(seed=self._seeds[0])
        self._reset_seeds()
        self._reset_options()
        return observation.reshape(self.num_envs, -1)

    def step_async(self, actions: np.ndarray) -> None:
        """Set the actions (W·K, A) for the next step; a ScenarioError if they are none."""
        given = numbers_of("actions", actions, (self.num_envs, self.worlds.world.action_size))
        self._actions = given.unflatten(0, (-1, self.num_auvs)).numpy(force=True)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance by one mission step: observations, rewards, dones and infos."""
        observation, _, _, over, details = self.worlds.step(self._actions)
        reward, done = details["auv_reward"].reshape(self.num_envs), np.repeat(over, self.num_auvs)
        infos: list[dict[str, Any]] = [{"auv_reward": float(own)} for own in reward]
        if over.any():
            last = observation.reshape(self.num_envs, -1)
            for auv in np.flatnonzero(done):
                infos[auv] |= {"terminal_observation": last[auv], "TimeLimit.truncated": True}
            observation, _ = self.worlds.reset(options={"reset_mask": over})
        return observation.reshape(self.num_envs, -1), self.reward_scale * reward, done, infos

    def get_images(self) -> Sequence[np.ndarray | None]:
        """A picture (720, 1280, 3) uint8 of each world."""
        return self.worlds.render() or ()

    def close(self) -> None:
        """There is nothing to release."""
        self.worlds.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of this object, once for each requested environment."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: environments are rows of one world's arrays."""
        raise NotImplementedError(f"{attr_name}: the environments have no attributes of their own")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Refuse: environments are rows of one world's arrays."""
        raise NotImplementedError(f"{method_name}: the environments have no methods of their own")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """False: single environments are never wrapped."""
        return [False for _ in self._get_indices(indices)]
