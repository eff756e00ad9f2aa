"""Soft actor-critic of Stable-Baselines3, one policy for all AUVs, in many missions at once.

Install and run:

    pip install -c constraints.txt -e ".[sb3]"
    cd examples && python stable_baselines3_sac.py --steps 6000

and compare what was learned, in the same folder:

    usvauv eval --policy stable_baselines3_sac:Learned --policy straight
"""

import argparse
from collections.abc import Sequence

import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback

from usvauv import World
from usvauv.env.interfaces.sb3_env import AuvVecEnv

SAVED = "stable_baselines3_sac.zip"
REWARD_SCALE = 0.1  # a service brings 30, and Adam's defaults suit numbers of order one


class Learned:
    """The policy that was saved last, without exploration."""

    def __init__(self, world: World) -> None:
        self.model = SAC.load(SAVED, device="cpu")

    def act(self, observation: torch.Tensor) -> np.ndarray:
        """Actions (W, K, A) for observations (W, K, O)."""
        actions, _ = self.model.predict(observation.flatten(0, 1).numpy(), deterministic=True)
        return actions.reshape(*observation.shape[:2], -1)


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

    env = AuvVecEnv(asked.scenario, asked.worlds, asked.seed, reward_scale=REWARD_SCALE)
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
    model.save(SAVED)
    return report.means


if __name__ == "__main__":
    main()
