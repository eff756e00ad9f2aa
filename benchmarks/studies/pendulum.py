"""SAC, TD3 and DDPG on Gymnasium's Pendulum-v1, beside the returns that others have published.

    python -m benchmarks.studies.pendulum --json

The algorithms, their networks, replay, noise and standardizer are those of `policies`; what `Trainer` adds belongs to
the ocean and is left out. Gymnasium's environment trains and evaluates. Published: RL Baselines3 Zoo (Raffin, 2020),
https://github.com/DLR-RM/rl-baselines3-zoo/blob/master/benchmark.md, one run of each algorithm, 20 000 steps,
deterministic policy over 750 episodes, mean ± standard deviation over episodes. The time is the processor's, so that
other programs hardly change it.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from torch import Tensor

from benchmarks.machine import describe
from usvauv.policies import TrainingConfig
from usvauv.policies.algorithms import Learner, Sizes, algorithms
from usvauv.policies.learned import Standardizer
from usvauv.policies.networks import stack, unstack
from usvauv.policies.training.exploration import CorrelatedNoise
from usvauv.policies.training.replay import Replay

ENVIRONMENT = "Pendulum-v1"
SIZES = Sizes(stack=1, observation=3, action=1)
STEPS = 20_000  # of all environments together, as published
SEEDS = (10, 11, 12)  # the settings were chosen on 0, 1 and 2
EPISODES, EVALUATION_SEED = 100, 10_000
PUBLISHED = {"sac": (-156.995, 88.714), "td3": (-151.855, 90.227), "ddpg": (-152.099, 94.282)}
PUBLISHED_EPISODES = 750

REWARD_SCALE = 0.1  # rewards down to −16.3 become of order one, for which the algorithms are set

# Every setting is named here, so that the defaults, which suit the ocean, may change.
SETTINGS = {
    "num_worlds": 4,
    "hidden": (64, 64),
    "gamma": 0.98,
    "n_step": 1,
    "batch": 128,
    "updates": 4,
    "learning_rate": 1e-3,
    "final_rate": 0.05,
    "tau": 0.005,
    "noise": 0.5,
    "correlation": 0.9,
    "replay": STEPS + STEPS // 100,
    "warmup": 1000,
    "layer_norm": True,
}


def make(environments: int) -> VectorEnv:
    """Pendulums that begin and end together."""
    return gymnasium.make_vec(ENVIRONMENT, environments, vector_kwargs={"autoreset_mode": AutoresetMode.DISABLED})


def torque(action: Tensor, environments: VectorEnv) -> np.ndarray:
    """The environments' action (W, 1) for a learner's in [−1, 1]."""
    return action.numpy() * environments.single_action_space.high


def features(observation: np.ndarray) -> Tensor:
    """Observations (W, 3) as those of one agent, (W, 1, 3)."""
    return torch.from_numpy(observation).unsqueeze(1)


class Pendulum:
    """A learner and its standardizer, trained on `STEPS` steps of Pendulum-v1 as `Trainer` trains in the ocean."""

    def __init__(self, config: TrainingConfig) -> None:
        self.config = config
        self.generator = torch.Generator().manual_seed(config.seed)
        self.learner: Learner = algorithms[config.algorithm](SIZES, config, self.generator)
        self.standardizer = Standardizer.identity(SIZES.observation, self.generator.device)

    def train(self) -> None:
        """Act with exploration, store, update."""
        config, worlds = self.config, self.config.num_worlds
        shape = (worlds, 1, SIZES.observation, SIZES.action)
        replay = Replay(config.replay // worlds, shape, self.generator.device, shared=False)
        noise = CorrelatedNoise((worlds, 1, SIZES.action), config.correlation, self.generator)
        environments = make(worlds)
        seen = features(environments.reset(seed=config.seed)[0])
        for step in range(STEPS // worlds):
            learning = step * worlds >= config.warmup
            if learning and self.learner.updates == 0:
                self.standardizer = Standardizer.of(replay.observation[: replay.size])
                replay.observation[: replay.size] = self.standardizer(replay.observation[: replay.size])
            standardized = self.standardizer(seen)
            action = unstack(self.learner.explore(stack(standardized, False), stack(noise.step(), False)), 1)
            after, reward, terminated, truncated, _ = environments.step(torque(action[:, 0], environments))
            scaled = torch.from_numpy(reward).float().unsqueeze(1) * REWARD_SCALE
            replay.add(standardized, action, scaled, torch.from_numpy(terminated).unsqueeze(1))
            seen = features(after)
            if truncated.all():
                replay.finish(self.standardizer(seen))
                seen = features(environments.reset()[0])
            if learning:
                self.learner.set_learning_rate(1.0 - (1.0 - config.final_rate) * step * worlds / STEPS)
                for _ in range(config.updates):
                    self.learner.update(replay.sample(config.batch, config.n_step, config.gamma, [self.generator]))
                    self.learner.average()
        environments.close()

    @torch.no_grad()
    def evaluate(self) -> list[float]:
        """Returns of `EPISODES` episodes of the averaged actor without noise, from the seed `EVALUATION_SEED` on."""
        environments = make(EPISODES)
        observation, _ = environments.reset(seed=EVALUATION_SEED)
        returns, over = np.zeros(EPISODES), False
        while not over:
            action = self.learner.averaged(stack(self.standardizer(features(observation)), False))[0]
            observation, reward, _, truncated, _ = environments.step(torque(action, environments))
            returns += reward
            over = bool(truncated.all())
        environments.close()
        return returns.tolist()


def measure(algorithm: str) -> dict[str, object]:
    """Train and evaluate an algorithm with every seed."""
    torch.set_num_threads(1)
    begun = time.process_time()
    returns = []
    for seed in SEEDS:
        pendulum = Pendulum(TrainingConfig(algorithm=algorithm, seed=seed, **SETTINGS))
        pendulum.train()
        returns.append(pendulum.evaluate())
    together = [value for run in returns for value in run]
    published = PUBLISHED[algorithm]
    return {
        "algorithm": algorithm,
        "return_mean": statistics.fmean(together),
        "return_deviation": statistics.stdev(together),
        "return_mean_by_seed": [statistics.fmean(run) for run in returns],
        "published_mean": published[0],
        "published_deviation": published[1],
        "processor_seconds": time.process_time() - begun,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    arguments = parser.parse_args()
    machine = describe()
    rows = []
    for algorithm in PUBLISHED:
        row = measure(algorithm)
        rows.append(row)
        seeds = ", ".join(f"{mean:.1f}" for mean in row["return_mean_by_seed"])
        print(
            f"{algorithm:4} {row['return_mean']:.1f} ± {row['return_deviation']:.1f} (seeds {seeds});"
            f" published {row['published_mean']:.1f} ± {row['published_deviation']:.1f};"
            f" {row['processor_seconds']:.0f} s of processor",
            file=sys.stderr if arguments.json else sys.stdout,
            flush=True,
        )
    if arguments.json:
        result = {
            "machine": machine,
            "seeds": SEEDS,
            "episodes": EPISODES,
            "steps": STEPS,
            "reward_scale": REWARD_SCALE,
        }
        print(json.dumps({**result, "settings": SETTINGS, "algorithms": rows}, indent=1))
        return
    print(machine)


if __name__ == "__main__":
    main()
