"""What the algorithms with a deterministic policy have in common."""

from __future__ import annotations

import copy

import torch
from torch import Tensor

from policies.algorithms.learner import Learner, Sizes
from policies.config import TrainingConfig
from policies.networks import Critic, DeterministicActor


class DeterministicLearner(Learner):
    """A deterministic actor, one or more critics, a target network of each, and noise added to explore.

    Attributes:
        members: number of critics for each learner.
    """

    members: int

    @staticmethod
    def make_actor(sizes: Sizes, config: TrainingConfig, generator: torch.Generator) -> DeterministicActor:
        layers = (sizes.observation, *config.hidden, sizes.action)
        return DeterministicActor(sizes.stack, layers, generator, output_gain=0.01)

    def __init__(self, sizes: Sizes, config: TrainingConfig, generator: torch.Generator):
        super().__init__(config, generator)
        self.act_with(self.make_actor(sizes, config, generator))
        shape = (self.members, sizes.stack, sizes.observation, sizes.action)
        self.critics = Critic(*shape, config.hidden, generator, config.layer_norm)
        self.target_actor = copy.deepcopy(self.actor).requires_grad_(False)
        self.target_critics = copy.deepcopy(self.critics).requires_grad_(False)
        self.optimise("critics", self.critics.parameters())

    @torch.no_grad()
    def explore(self, observation: Tensor, noise: Tensor) -> Tensor:
        return (self.actor(observation) + self.config.noise * noise).clamp(-1.0, 1.0)

    def improve(self, observation: Tensor) -> None:
        """One step of the actor up the first critic's value, and one of all targets towards their networks."""
        loss = -self.critics(observation, self.actor(observation))[0].mean(-1)
        self.descend("actor", loss.sum())
        self.follow(self.target_critics, self.critics)
        self.follow(self.target_actor, self.actor)
