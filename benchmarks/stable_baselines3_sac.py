"""Stable-Baselines3's SAC on our environment, for `benchmarks.train`, which describes the variants."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from examples.stable_baselines3_sac import REWARD_SCALE
from usvauv import policies
from usvauv.env import Scenario
from usvauv.env.interfaces.sb3_env import AuvVecEnv
from usvauv.policies.frames import Frame, frames

DEFAULT_WORLDS = 4


def learner(variant: str, scenario: str, seed: int) -> tuple[SAC, Callable[[torch.Tensor], torch.Tensor], int]:
    """An untrained model, its action in our worlds without exploration, and the number of AUVs."""
    ours = policies.TrainingConfig()
    worlds = DEFAULT_WORLDS if variant == "sb3_defaults" else ours.num_worlds
    env = AuvVecEnv(scenario, worlds, seed, reward_scale=REWARD_SCALE)
    num_auvs, space = env.num_auvs, env.observation_space
    frame = frames[ours.frame if variant == "sb3_tuned_our_frame" else "world"](Scenario.load(scenario))
    settings: dict[str, Any] = {}
    if variant != "sb3_defaults":
        settings = {
            "learning_rate": ours.learning_rate,
            "batch_size": ours.batch,
            "gamma": ours.gamma,
            "n_steps": ours.n_step,
            "tau": ours.tau,
            "buffer_size": ours.replay * num_auvs,
            "gradient_steps": ours.updates,
            "learning_starts": ours.warmup * num_auvs,
            "ent_coef": "auto_0.05",  # about our initial temperature
            "policy_kwargs": {"net_arch": list(ours.hidden)},
        }
    model = SAC("MlpPolicy", Framed(env, frame), seed=seed, device="cpu", **settings)

    @torch.no_grad()
    def act(observation: torch.Tensor) -> torch.Tensor:
        seen = torch.from_numpy(np.clip(observation.numpy(force=True), space.low, space.high))
        action = model.actor(frame.encode(seen).flatten(0, 1), deterministic=True)
        return frame.decode(seen, action.unflatten(0, seen.shape[:2])).to(observation)

    return model, act, num_auvs


class Framed(VecEnvWrapper):
    """AUVs as environments, observed and commanded through one of our frames."""

    def __init__(self, env: VecEnv, frame: Frame) -> None:
        self.frame = frame
        super().__init__(env, gymnasium.spaces.Box(-np.inf, np.inf, (frame.features,), np.float32))

    def _encode(self, observation: np.ndarray) -> np.ndarray:
        return self.frame.encode(torch.from_numpy(observation)).numpy()

    def reset(self) -> np.ndarray:
        self._seen = self.venv.reset()
        return self._encode(self._seen)

    def step_async(self, actions: np.ndarray) -> None:
        self.venv.step_async(self.frame.decode(torch.from_numpy(self._seen), torch.from_numpy(actions)).numpy())

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        self._seen, reward, done, infos = self.venv.step_wait()
        for row in np.flatnonzero(done):
            infos[row]["terminal_observation"] = self._encode(infos[row]["terminal_observation"])
        return self._encode(self._seen), reward, done, infos
