"""Deep deterministic policy gradient.

Lillicrap et al., "Continuous control with deep reinforcement learning", ICLR 2016, arXiv:1509.02971, with n-step
returns (Barth-Maron et al., ICLR 2018, arXiv:1804.08617).
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor

from policies.algorithms.learner import Learner, Sizes
from policies.config import TrainingConfig
from policies.networks import Critic, DeterministicActor
from policies.replay import Batch


class DDPG(Learner):
    @staticmethod
    def make_actor(sizes: Sizes, config: TrainingConfig, generator: torch.Generator) -> DeterministicActor:
        layers = (sizes.observation, *config.hidden, sizes.action)
        return DeterministicActor(sizes.stack, layers, generator, output_gain=0.01)

    def __init__(self, sizes: Sizes, config: TrainingConfig, generator: torch.Generator):
        super().__init__(config, generator)
        self.act_with(self.make_actor(sizes, config, generator))
        self.critic = Critic(
            1, sizes.stack, sizes.observation, sizes.action, config.hidden, generator, config.layer_norm
        )
        self.target_actor = copy.deepcopy(self.actor).requires_grad_(False)
        self.target_critic = copy.deepcopy(self.critic).requires_grad_(False)
        self.optimise("critic", self.critic.parameters())

    @torch.no_grad()
    def explore(self, observation: Tensor, noise: Tensor) -> Tensor:
        return (self.actor(observation) + self.config.noise * noise).clamp(-1.0, 1.0)

    def update(self, batch: Batch) -> dict[str, Tensor]:
        with torch.no_grad():
            next_action = self.target_actor(batch.next_observation)
            next_value = self.target_critic(batch.next_observation, next_action)[0]
            target = batch.reward + batch.discount * next_value

        value = self.critic(batch.observation, batch.action)[0]
        critic_loss = (value - target).square().mean(-1)
        self.descend("critic", critic_loss.sum())

        actor_loss = -self.critic(batch.observation, self.actor(batch.observation))[0].mean(-1)
        self.descend("actor", actor_loss.sum())

        self.follow(self.target_critic, self.critic)
        self.follow(self.target_actor, self.actor)
        self.updates += 1
        return {"critic_loss": critic_loss.detach().mean(), "value": value.detach().mean()}
