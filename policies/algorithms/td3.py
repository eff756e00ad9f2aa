"""Twin delayed deep deterministic policy gradient.

Fujimoto, van Hoof, Meger, "Addressing function approximation error in actor-critic methods", ICML 2018,
arXiv:1802.09477, with n-step returns.
"""

from __future__ import annotations

import torch
from torch import Tensor

from usvauv.policies.algorithms.ddpg import DeterministicLearner
from usvauv.policies.algorithms.learner import Batch

SMOOTHING, SMOOTHING_LIMIT = 0.2, 0.5  # standard deviation of the target policy's noise, and its bound
DELAY = 2  # updates of the critics for each of the actor


class TD3(DeterministicLearner):
    """Twin critics, target policy smoothing and a delayed actor μ.

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
