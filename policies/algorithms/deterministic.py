"""Algorithms with a deterministic policy, and their common base: DDPG and TD3, both with n-step returns.

Lillicrap et al., "Continuous control with deep reinforcement learning", ICLR 2016, arXiv:1509.02971; Barth-Maron et
al., ICLR 2018, arXiv:1804.08617; Fujimoto, van Hoof, Meger, "Addressing function approximation error in actor-critic
methods", ICML 2018, arXiv:1802.09477.
"""

from __future__ import annotations

import copy
from typing import ClassVar

import torch
from torch import Tensor

from usvauv.policies.algorithms.learner import Batch, Learner, Settings
from usvauv.policies.networks import Critic, DeterministicActor, Sizes

SMOOTHING, SMOOTHING_LIMIT = 0.2, 0.5  # standard deviation of the target policy's noise, and its bound
DELAY = 2  # updates of the critics for each of the actor


class DeterministicLearner(Learner[DeterministicActor]):
    """A deterministic actor, one or more critics, a target network of each, and additive noise for exploration.

    Attributes:
        members: number of critics for each learner.
    """

    members: ClassVar[int]

    @staticmethod
    def make_actor(sizes: Sizes, config: Settings, generator: torch.Generator) -> DeterministicActor:
        return DeterministicActor.near_zero(sizes, config.hidden, generator)

    def __init__(self, sizes: Sizes, config: Settings, generator: torch.Generator) -> None:
        super().__init__(sizes, config, generator)
        self.set_actor(self.make_actor(sizes, config, generator))
        self.critics = Critic(self.members, sizes, config.hidden, generator, config.layer_norm)
        self.target_actor = copy.deepcopy(self.actor).requires_grad_(False)
        self.target_critics = copy.deepcopy(self.critics).requires_grad_(False)
        self.add_optimiser("critics", self.critics.parameters())

    @torch.no_grad()
    def explore(self, observation: Tensor, noise: Tensor) -> Tensor:
        return (self.actor(observation) + self.config.noise * noise).clamp(-1.0, 1.0)

    def update_actor_and_targets(self, observation: Tensor) -> None:
        """One gradient step of the actor up the first critic's value, and a soft update of every target network."""
        loss = -self.critics(observation, self.actor(observation), frozen=True)[0].mean(-1)
        self.gradient_step("actor", loss.sum())
        self.soft_update(self.target_critics, self.critics)
        self.soft_update(self.target_actor, self.actor)


class DDPG(DeterministicLearner):
    """Deep deterministic policy gradient: one critic Q and a deterministic actor μ, with target networks Q′ and μ′.

    With R, Γ as in `Batch`, the critic minimises mean (Q(s, a) − y)² with y = R + Γ Q′(s′, μ′(s′)), and the actor
    maximises mean Q(s, μ(s)).
    """

    members = 1

    def update(self, batch: Batch) -> dict[str, Tensor]:
        with torch.no_grad():
            next_action = self.target_actor(batch.next_observation)
            next_value = self.target_critics(batch.next_observation, next_action)[0]
            target = batch.reward + batch.discount * next_value

        value = self.critics(batch.observation, batch.action)[0]
        critic_loss = (value - target).square().mean(-1)
        self.gradient_step("critics", critic_loss.sum())

        self.update_actor_and_targets(batch.observation)
        self.updates += 1
        return {"critic_loss": critic_loss.detach().mean(), "value": value.detach().mean()}


class TD3(DeterministicLearner):
    """Twin delayed deep deterministic policy gradient: twin critics, target policy smoothing and a delayed actor μ.

    With R, Γ as in `Batch` and target networks Q′, μ′:

        target       y = R + Γ min_i Q′_i(s′, a′), a′ = clip(μ′(s′) + clip(ε, ±0.5), ±1), ε ~ N(0, 0.2²)
        critics      minimise Σ_i mean (Q_i(s, a) − y)²
        actor        every `DELAY` updates maximises mean Q_1(s, μ(s)); then target networks move by τ
    """

    members = 2
    period = DELAY

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
        self.gradient_step("critics", critic_loss.sum())

        self.updates += 1
        if self.updates % DELAY == 0:
            self.update_actor_and_targets(batch.observation)
        return {"critic_loss": critic_loss.detach().mean(), "value": value.detach().mean()}
