"""Proximal policy optimisation on what the worlds did in their last steps.

Schulman et al., "Proximal policy optimization algorithms", 2017, arXiv:1707.06347, with an average of the policy as the
one near which it stays (Hilton, Cobbe and Schulman, "Batch size-invariance for policy optimization", NeurIPS 2022,
arXiv:2110.00641).
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor

from usvauv.policies.algorithms.learner import Batch, Learner, Settings
from usvauv.policies.algorithms.sac import SAC
from usvauv.policies.networks import GaussianActor, Sizes, StackedMLP

CLIP = 0.2  # largest change of a probability's ratio that is learned from
FARTHEST = 3.0  # of a logarithm of such a ratio; beyond it nothing is learned
DEVIATION = 0.25  # of actions before the tanh, at first
LEAST_DEVIATION = 1e-6  # of advantages


class PPO(Learner[GaussianActor]):
    """A value V of states and a Gaussian actor π, which stays near its running average π̄ over 1/τ updates.

    With R the n-step reward and Γ the discount of the value after it (`Batch`):

        value        minimises mean (V(s) − y)², y = R + Γ V(s′)
        actor        maximises mean min(r A, clip(r, 1 ± `CLIP`) A), r = π(a|s)/π̄(a|s), A = y − V(s) scaled to mean 0
                     and deviation 1

    The actions are those of policies of some updates ago and are taken as those of π̄. So the replay has to be short: a
    few times n steps of all worlds, with 1/τ about as many updates.
    """

    def __init__(self, sizes: Sizes, config: Settings, generator: torch.Generator) -> None:
        super().__init__(sizes, config, generator)
        self.set_actor(self.make_actor(sizes, config, generator))
        self.near = copy.deepcopy(self.actor).requires_grad_(False)
        self.value = StackedMLP(sizes.stack, (sizes.observation, *config.hidden, 1), generator, config.layer_norm)
        self.add_optimiser("value", self.value.parameters())

    @staticmethod
    def make_actor(sizes: Sizes, config: Settings, generator: torch.Generator) -> GaussianActor:
        actor = SAC.make_actor(sizes, config, generator)
        actor.set_deviation(DEVIATION)
        return actor

    @torch.no_grad()
    def explore(self, observation: Tensor, noise: Tensor) -> Tensor:
        return self.actor.sample(observation, noise)[0]

    def update(self, batch: Batch) -> dict[str, Tensor]:
        value = self.value(batch.observation).squeeze(-1)
        with torch.no_grad():
            target = batch.reward + batch.discount * self.value(batch.next_observation).squeeze(-1)
            advantage = target - value
            advantage -= advantage.mean(-1, keepdim=True)
            advantage /= advantage.std(-1, correction=0, keepdim=True) + LEAST_DEVIATION
            before = self.near.log_density(batch.observation, batch.action)
        value_loss = (value - target).square().mean(-1)
        self.gradient_step("value", value_loss.sum())

        log_ratio = (self.actor.log_density(batch.observation, batch.action) - before).clamp(-FARTHEST, FARTHEST)
        ratio = log_ratio.exp()
        gain = torch.minimum(ratio * advantage, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * advantage)
        self.gradient_step("actor", -gain.mean(-1).sum())
        self.soft_update(self.near, self.actor)
        self.updates += 1
        return {
            "value_loss": value_loss.detach().mean(),
            "value": value.detach().mean(),
            "divergence": (ratio - 1.0 - log_ratio).detach().mean(),
        }
