"""A policy for data in passing, learned by proximal policy optimisation (PPO) from the heuristic `pass` on.

    python -m benchmarks.studies.passing --out policies/trained/ppo-wide-torpedo.safetensors

Schulman et al., 2017, arXiv:1707.06347, with generalised advantages (Schulman et al., 2016, arXiv:1506.02438). In each
iteration all worlds go on for `ROLLOUT` decisions, each held for `HOLD` steps, because what a single step changes is
lost in the noise of the reward. Groups of worlds are at different times of their episodes. Terms of the reward that an
AUV cannot change by its steering are left out while it learns: data that other nodes lose, nearness to the boat.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import torch
from torch import Tensor, nn

from usvauv.env import Scenario, World
from usvauv.policies import TrainingConfig, checkpoint
from usvauv.policies.frames import FRAMES
from usvauv.policies.learned import LearnedPolicy, Standardizer
from usvauv.policies.networks import GaussianActor, StackedMLP
from usvauv.policies.training.figures import EVALUATION_SEED_OFFSET, evaluated

GROUPS, WORLDS = 4, 32
ROLLOUT, HOLD = 25, 4
GAMMA, TRACE = 0.98, 0.9  # of a step; of a decision
EPOCHS, BATCH, CLIP, LARGEST_GRADIENT = 3, 4096, 0.2, 1.0
LEARNING_RATE, VALUE_RATE, FINAL_RATE = 1e-3, 2e-3, 0.05
LOG_DEVIATION = -1.6  # of an action before the tanh, at first
VALUE_ALONE = 2  # iterations in which only the value is learned
EVALUATE_EVERY, EPISODES = 20, 32
UNCHANGED = ("reward.lost=0", "reward.collaboration=0")


class Worlds:
    """Groups of worlds, evenly spread over the time of an episode; what is stepped are decisions of all of them."""

    def __init__(self, scenario: Scenario, frame_name: str, seed: int) -> None:
        self.frame = FRAMES[frame_name](scenario)
        self.groups = [World(scenario, WORLDS, 1000 * seed + group) for group in range(GROUPS)]
        self.done = [group * world.steps // GROUPS for group, world in enumerate(self.groups)]
        self.observations = []
        for world, steps in zip(self.groups, self.done, strict=True):
            observation, nothing = world.reset(), torch.zeros(WORLDS, world.num_auvs, self.frame.actions)
            for _ in range(steps):
                observation = world.step(self.frame.decode(observation, nothing))[0]
            self.observations.append(observation.clone())

    def features(self) -> Tensor:
        """(W, K, F) of now."""
        return torch.cat([self.frame.encode(observation) for observation in self.observations])

    def decide(self, action: Tensor) -> tuple[Tensor, Tensor]:
        """Hold actions (W, K, A): the discounted reward (W, K), and whether an episode ended (W, K), 0 or 1."""
        rewards, ends = torch.zeros(action.shape[:2]), torch.zeros(action.shape[:2])
        for group, world in enumerate(self.groups):
            own, observation = slice(group * WORLDS, (group + 1) * WORLDS), self.observations[group]
            for step in range(HOLD):
                observation, reward, *_ = world.step(self.frame.decode(observation, action[own]))
                rewards[own] += GAMMA**step * reward
                self.done[group] += 1
                if self.done[group] % world.steps == 0:
                    observation = world.reset()
                    ends[own] = 1.0
            self.observations[group] = observation.clone()
        return rewards, ends


def advantages(reward: Tensor, end: Tensor, value: Tensor, last: Tensor) -> Tensor:
    """(T, ...) from rewards, ends of episodes and values (T, ...), and the value (...) of what follows.

    At an episode's end, which the AUVs do not observe, the value is taken to stay.
    """
    result, following, sums = torch.zeros_like(reward), last, torch.zeros_like(last)
    for t in range(len(reward) - 1, -1, -1):
        following = torch.where(end[t] > 0, value[t], following)
        error = reward[t] + GAMMA**HOLD * following - value[t]
        result[t] = sums = error + GAMMA**HOLD * TRACE * (1.0 - end[t]) * sums
        following = value[t]
    return result


def main() -> None:
    """Train, evaluate beside `pass` every `EVALUATE_EVERY` iterations, keep the best."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="wide-torpedo")
    parser.add_argument("--iterations", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(asked.seed)
    generator = torch.Generator().manual_seed(asked.seed)
    scenario = Scenario.load(asked.scenario)
    config = TrainingConfig(
        "ppo", GROUPS * WORLDS, asked.seed, True, "passing", renewal=False, gamma=GAMMA, learning_rate=LEARNING_RATE
    )
    worlds = Worlds(Scenario.load(asked.scenario, UNCHANGED), config.frame, asked.seed)
    frame = worlds.frame
    layers = (frame.features, *config.hidden)
    actor = GaussianActor(1, (*layers, 2 * frame.actions), generator, output_gain=0.01)
    critic = StackedMLP(1, (*layers, 1), generator, layer_norm=True)
    log_deviation = nn.Parameter(torch.full((frame.actions,), LOG_DEVIATION))
    acting = [*actor.parameters(), log_deviation]
    optimisers = torch.optim.Adam(acting, LEARNING_RATE), torch.optim.Adam(critic.parameters(), VALUE_RATE)
    standardizer: Standardizer | None = None
    evaluation = World(scenario, EPISODES, asked.seed + EVALUATION_SEED_OFFSET)
    baseline = [row.arps for row in evaluated(evaluation, "pass")]
    level = spread = None
    best, begun = -math.inf, time.process_time()

    def mean(features: Tensor) -> Tensor:
        """Mean action before the tanh, (..., A), for standardised features (..., F)."""
        return StackedMLP.forward(actor, features.flatten(0, -2)[None])[0].unflatten(0, features.shape[:-1])[
            ..., : frame.actions
        ]

    def value(features: Tensor) -> Tensor:
        return critic(features.flatten(0, -2)[None])[0, :, 0].unflatten(0, features.shape[:-1])

    def log_density(raw: Tensor, middle: Tensor) -> Tensor:
        return (-0.5 * ((raw - middle) / log_deviation.exp()).square() - log_deviation).sum(-1)

    for iteration in range(asked.iterations):
        rows = []
        with torch.no_grad():
            for _ in range(ROLLOUT):
                features = worlds.features()
                if standardizer is None:
                    middle = torch.zeros(*features.shape[:2], frame.actions)
                else:
                    features = standardizer(features)
                    middle = mean(features)
                raw = middle + log_deviation.exp() * torch.randn(middle.shape)
                rows.append((features, raw, *worlds.decide(raw.tanh())))
            features, raw, reward, end = (torch.stack(part) for part in zip(*rows, strict=True))
            if standardizer is None:
                standardizer = Standardizer.of(features)
                features = standardizer(features)
            level = reward.mean() if level is None else level + 0.1 * (reward.mean() - level)
            spread = reward.std() if spread is None else spread
            before_value = value(features)
            advantage = advantages((reward - level) / spread, end, before_value, value(standardizer(worlds.features())))
            returns = (advantage + before_value).flatten()
            advantage = ((advantage - advantage.mean()) / advantage.std()).flatten()
            features, raw = features.flatten(0, 2), raw.flatten(0, 2)
            before = log_density(raw, mean(features))
        share = max(1.0 - iteration / asked.iterations, FINAL_RATE)
        for optimiser, rate in zip(optimisers, (LEARNING_RATE, VALUE_RATE), strict=True):
            optimiser.param_groups[0]["lr"] = share * rate
        only_value = iteration < VALUE_ALONE
        for _ in range(2 * EPOCHS if only_value else EPOCHS):
            for part in torch.randperm(len(features)).split(BATCH):
                optimisers[1].zero_grad()
                (value(features[part]) - returns[part]).square().mean().backward()
                optimisers[1].step()
                if not only_value:
                    ratio = (log_density(raw[part], mean(features[part])) - before[part]).exp()
                    gain = torch.minimum(ratio * advantage[part], ratio.clamp(1 - CLIP, 1 + CLIP) * advantage[part])
                    optimisers[0].zero_grad()
                    (-gain.mean()).backward()
                    nn.utils.clip_grad_norm_(acting, LARGEST_GRADIENT)
                    optimisers[0].step()
        if (iteration + 1) % EVALUATE_EVERY == 0:
            policy = LearnedPolicy("learned", scenario, config.frame, standardizer, actor, config.shared)
            scores = [row.arps for row in evaluated(evaluation, policy)]
            score = sum(scores) / EPISODES
            print(f"{iteration + 1}: ARPS {score:.2f}, pass {sum(baseline) / EPISODES:.2f}", flush=True)
            if score > best:
                best = score
                about = checkpoint.provenance({}, ("python", "-m", "benchmarks.studies.passing")) | {
                    "steps": (iteration + 1) * ROLLOUT * HOLD * config.num_worlds,
                    "seconds": time.process_time() - begun,
                    "score": score,
                    "usv": evaluation.strategy.name,
                }
                checkpoint.write(asked.out, {checkpoint.POLICY: checkpoint.describe(policy, config, about)})


if __name__ == "__main__":
    main()
