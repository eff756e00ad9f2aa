"""Deep deterministic policy gradient.

Lillicrap et al., "Continuous control with deep reinforcement learning", ICLR 2016, arXiv:1509.02971, with n-step
returns (Barth-Maron et al., ICLR 2018, arXiv:1804.08617).
"""

from __future__ import annotations

import torch
from torch import Tensor

from usvauv.policies.algorithms.deterministic import DeterministicLearner
from usvauv.policies.algorithms.learner import Batch


class DDPG(DeterministicLearner):
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
