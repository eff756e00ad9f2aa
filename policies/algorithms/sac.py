"""Soft actor-critic with a learned temperature.

Haarnoja et al., "Soft actor-critic algorithms and applications", 2018, arXiv:1812.05905, with n-step returns (the
entropy of the steps in between is left out).
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

from usvauv.policies.algorithms.learner import Batch, Learner, Settings
from usvauv.policies.networks import Critic, GaussianActor, Sizes


class SAC(Learner[GaussianActor]):
    """Twin critics and a Gaussian actor π whose entropy is rewarded.

    With R the n-step reward, Γ the discount of the value after it, a′ ~ π(s′) and target critics Q′ (`Batch`):

        target       y = R + Γ (min_i Q′_i(s′, a′) − α ln π(a′|s′))
        critics      minimise Σ_i mean (Q_i(s, a) − y)²
        actor        minimises mean (α ln π(ã|s) − min_i Q_i(s, ã)), ã ~ π(s)
        temperature  ln α falls by the gradient of −ln α mean (ln π(ã|s) − A), A components of an action
    """

    @staticmethod
    def make_actor(sizes: Sizes, config: Settings, generator: torch.Generator) -> GaussianActor:
        return GaussianActor.near_zero(sizes, config.hidden, generator)

    def __init__(self, sizes: Sizes, config: Settings, generator: torch.Generator) -> None:
        super().__init__(sizes, config, generator)
        self.set_actor(self.make_actor(sizes, config, generator))
        self.critics = Critic(2, sizes, config.hidden, generator, config.layer_norm)
        self.target_critics = copy.deepcopy(self.critics).requires_grad_(False)
        # One temperature for each learner, small at first because rewards are of order one.
        self.log_alpha = nn.Parameter(torch.full((sizes.stack, 1), -3.0, dtype=torch.float32, device=generator.device))
        self.target_entropy = -float(sizes.action)
        self.add_optimiser("critics", self.critics.parameters())
        self.add_optimiser("temperature", [self.log_alpha])

    @torch.no_grad()
    def explore(self, observation: Tensor, noise: Tensor) -> Tensor:
        return self.actor.draw(observation, noise)

    def update(self, batch: Batch) -> dict[str, Tensor]:
        alpha = self.log_alpha.detach().exp()
        with torch.no_grad():
            noise = self.normal(batch.action.shape)
            next_action, next_log_density = self.actor.sample(batch.next_observation, noise)
            next_value = self.target_critics(batch.next_observation, next_action).amin(0) - alpha * next_log_density
            target = batch.reward + batch.discount * next_value

        value = self.critics(batch.observation, batch.action)
        critic_loss = (value - target).square().mean(-1).sum(0)
        self.gradient_step("critics", critic_loss.sum())

        action, log_density = self.actor.sample(batch.observation, self.normal(batch.action.shape))
        found = self.critics(batch.observation, action, frozen=True).amin(0)
        actor_loss = (alpha * log_density - found).mean(-1)
        surprise = (log_density.detach() + self.target_entropy).mean(-1, keepdim=True)
        self.gradient_step(("actor", "temperature"), actor_loss.sum() - (self.log_alpha * surprise).sum())

        self.soft_update(self.target_critics, self.critics)
        self.updates += 1
        return {
            "critic_loss": critic_loss.detach().mean(),
            "value": value.detach().mean(),
            "temperature": alpha.mean(),
            "entropy": -log_density.detach().mean(),
        }
