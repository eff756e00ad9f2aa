"""Twin delayed deep deterministic policy gradient.

Fujimoto, van Hoof, Meger, "Addressing function approximation error in actor-critic methods", ICML 2018,
arXiv:1802.09477, with n-step returns.
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor

from policies.algorithms.learner import Learner, Sizes
from policies.config import TrainingConfig
from policies.networks import Critic, DeterministicActor
from policies.replay import Batch

SMOOTHING, SMOOTHING_LIMIT = 0.2, 0.5
DELAY = 2


class TD3(Learner):
    @staticmethod
    def make_actor(sizes: Sizes, config: TrainingConfig, generator: torch.Generator) -> DeterministicActor:
        layers = (sizes.observation, *config.hidden, sizes.action)
        return DeterministicActor(sizes.stack, layers, generator, output_gain=0.01)

    def __init__(self, sizes: Sizes, config: TrainingConfig, generator: torch.Generator):
        super().__init__(config, generator)
        self.act_with(self.make_actor(sizes, config, generator))
        self.critics = Critic(
            2, sizes.stack, sizes.observation, sizes.action, config.hidden, generator, config.layer_norm
        )
        self.target_actor = copy.deepcopy(self.actor).requires_grad_(False)
        self.target_critics = copy.deepcopy(self.critics).requires_grad_(False)
        self.optimise("critics", self.critics.parameters())

    @torch.no_grad()
    def explore(self, observation: Tensor, noise: Tensor) -> Tensor:
        return (self.actor(observation) + self.config.noise * noise).clamp(-1.0, 1.0)

    def update(self, batch: Batch) -> dict[str, Tensor]:
        with torch.no_grad():
            # Target policy smoothing, then the smaller of the twin targets.
            next_action = self.target_actor(batch.next_observation)
            noise = SMOOTHING * self.normal(next_action.shape)
            next_action = (next_action + noise.clamp(-SMOOTHING_LIMIT, SMOOTHING_LIMIT)).clamp(-1.0, 1.0)
            next_value = self.target_critics(batch.next_observation, next_action).amin(0)
            target = batch.reward + batch.discount * next_value

        value = self.critics(batch.observation, batch.action)
        critic_loss = (value - target).square().mean(-1).sum(0)
        self.descend("critics", critic_loss.sum())

        self.updates += 1
        if self.updates % DELAY == 0:
            actor_loss = -self.critics(batch.observation, self.actor(batch.observation))[0].mean(-1)
            self.descend("actor", actor_loss.sum())
            self.follow(self.target_critics, self.critics)
            self.follow(self.target_actor, self.actor)
        return {"critic_loss": critic_loss.detach().mean(), "value": value.detach().mean()}
