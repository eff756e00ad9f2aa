"""Soft actor-critic of Stable-Baselines3, one policy for all AUVs, in many missions at once.

Install and run:

    pip install -c constraints.txt -e . "stable-baselines3>=2.9"
    python examples/stable_baselines3_sac.py --steps 6000
"""

import argparse
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

import usvauv_env  # noqa: F401 - registers the environment

REWARD_SCALE = 0.1  # a service brings 30, and Adam's defaults suit numbers of order one


class AuvVecEnv(VecEnv):
    """W missions of K AUVs as W·K environments of one AUV, each with its own reward.

    Stable-Baselines3 expects the first observation of the next episode in the step that ends one, and the last
    observation in that step's info.
    """

    def __init__(self, num_worlds: int, seed: int, **options: Any) -> None:
        mode = gymnasium.vector.AutoresetMode.DISABLED
        self.worlds = gymnasium.make_vec(
            "usvauv/DataCollection-v0", num_envs=num_worlds, autoreset_mode=mode, **options
        )
        team, moves = self.worlds.single_observation_space, self.worlds.single_action_space
        self.num_auvs, self._first_seed = len(team.low), seed
        self.render_mode = None
        space = gymnasium.spaces.Box(team.low[0], team.high[0], dtype=np.float32)
        action = gymnasium.spaces.Box(moves.low[0], moves.high[0], dtype=np.float32)
        super().__init__(num_worlds * self.num_auvs, space, action)

    def reset(self) -> np.ndarray:
        observation, _ = self.worlds.reset(seed=self._first_seed)
        return observation.reshape(self.num_envs, -1)

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions.reshape(-1, self.num_auvs, 2)

    def step_wait(self) -> VecEnvStepReturn:
        observation, _, _, over, details = self.worlds.step(self._actions)
        reward = details["auv_reward"].reshape(self.num_envs)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if over.any():
            last = observation.reshape(self.num_envs, -1)
            for auv in np.flatnonzero(np.repeat(over, self.num_auvs)):
                infos[auv] = {"terminal_observation": last[auv], "TimeLimit.truncated": True}
            observation, _ = self.worlds.reset(options={"reset_mask": over})
        done = np.repeat(over, self.num_auvs)
        return observation.reshape(self.num_envs, -1), REWARD_SCALE * reward, done, infos

    def close(self) -> None:
        self.worlds.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError("the worlds have no attributes of their own")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **options: Any) -> list[Any]:
        raise NotImplementedError("the worlds have no methods of their own")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]


class Report(BaseCallback):
    """Mean reward of a team per step, each `every` steps."""

    def __init__(self, num_auvs: int, every: int) -> None:
        super().__init__()
        self.num_auvs, self.every = num_auvs, every
        self.window: list[float] = []
        self.means: list[float] = []

    def _on_step(self) -> bool:
        self.window.append(self.num_auvs * float(self.locals["rewards"].mean()) / REWARD_SCALE)
        if len(self.window) == self.every:
            self.means.append(float(np.mean(self.window)))
            print(f"step {self.n_calls}: mean team reward {self.means[-1]:.2f} per step")
            self.window.clear()
        return True


def main(arguments: Sequence[str] | None = None) -> list[float]:
    """Learn for `--steps` mission steps; prints and returns the mean team reward per step of each tenth of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--worlds", type=int, default=32)
    parser.add_argument("--scenario", default="extreme")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args(arguments)

    env = AuvVecEnv(asked.worlds, asked.seed, scenario=asked.scenario)
    report = Report(env.num_auvs, max(1, asked.steps // 10))
    model = SAC(
        "MlpPolicy",
        env,
        learning_rate=1e-3,
        batch_size=512,
        gamma=0.95,
        tau=0.01,
        ent_coef="auto_0.05",
        gradient_steps=2,
        learning_starts=min(10_000, asked.steps * env.num_envs // 4),
        policy_kwargs={"net_arch": [64, 64]},
        seed=asked.seed,
        device="cpu",
    )
    model.learn(asked.steps * env.num_envs, callback=report)
    env.close()
    return report.means


if __name__ == "__main__":
    main()
