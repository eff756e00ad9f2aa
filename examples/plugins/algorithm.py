"""An algorithm: DDPG whose targets are the mean of four critics.

usvauv train --plugin examples/plugins/algorithm.py --algorithm ensemble
"""

import torch
from torch import Tensor

from usvauv.extend.policy import Batch, DeterministicLearner, algorithms


class EnsembleDDPG(DeterministicLearner):
    """The mean of independent critics has a smaller variance than one of them (Anschel et al., arXiv:1611.01929)."""

    members = 4

    def update(self, batch: Batch) -> dict[str, Tensor]:
        with torch.no_grad():
            next_action = self.target_actor(batch.next_observation)
            next_value = self.target_critics(batch.next_observation, next_action).mean(0)
            target = batch.reward + batch.discount * next_value

        value = self.critics(batch.observation, batch.action)
        critic_loss = (value - target).square().mean(-1).sum(0)
        self.gradient_step("critics", critic_loss.sum())

        self.update_actor_and_targets(batch.observation)
        self.updates += 1
        return {"critic_loss": critic_loss.detach().mean(), "value": value.detach().mean()}


algorithms.register("ensemble", EnsembleDDPG)
