"""Proximal policy optimisation on whole rollouts.

Schulman et al., "Proximal policy optimization algorithms", 2017, arXiv:1707.06347, with generalised advantages
(Schulman et al., "High-dimensional continuous control using generalized advantage estimation", ICLR 2016,
arXiv:1506.02438).
"""

from __future__ import annotations

from types import MappingProxyType

import torch
from torch import Tensor

from usvauv.policies.algorithms.learner import Batch, Learner, Rollout, Settings
from usvauv.policies.networks import AttentiveMLP, ChoiceActor, GaussianActor, Sizes, StackedMLP

CLIP = 0.2  # largest change of a probability's ratio that is learned from
TRACE = 0.9  # λ
DEVIATION = 0.2  # of actions before the tanh, at first
LEAST_DEVIATION = 1e-6  # of advantages
MAX_GRADIENT_NORM = 1.0  # of an actor; larger gradients, after its deviation has become small, would spoil it
MAX_LOG_RATIO = 20.0  # ln r, beyond which r would soon be infinite


class PPO(Learner[GaussianActor | ChoiceActor]):
    """A value V of states and a Gaussian actor π, which learn in some epochs of minibatches of each rollout.

    With R the reward while an action is held and Γ the discount of the value after it (`Batch`), π_0 the actor and V_0
    the value that the rollout began with, and δ_t = R_t + Γ_t V_0(s′_t) − V_0(s_t):

        advantage    A_t = δ_t + Γ_t λ A_{t+1}, but A_t = δ_t where no further action of the episode follows
        value        minimises mean (V(s) − y)², y = A + V_0(s)
        actor        maximises mean min(r Â, clip(r, 1 ± `CLIP`) Â), r = π(a|s)/π_0(a|s), Â being A scaled to mean 0 and
                     deviation 1 in the rollout; in a rollout of a teacher's actions mean ln π(a|s) instead
    """

    chooses = True
    on_policy = True
    max_gradient_norm = MappingProxyType({"actor": MAX_GRADIENT_NORM})
    defaults = MappingProxyType(
        {
            "num_worlds": 128,
            "shared": True,
            "gamma": 0.98,
            "n_step": 4,
            "batch": 4096,
            "updates": 3,
            "correlation": 0.0,
        }
    )

    def __init__(self, sizes: Sizes, config: Settings, generator: torch.Generator) -> None:
        super().__init__(sizes, config, generator)
        self.set_actor(self.make_actor(sizes, config, generator))
        if sizes.each:
            self.value: StackedMLP = AttentiveMLP(sizes, config.hidden, 1, generator)
        else:
            self.value = StackedMLP(sizes.stack, (sizes.observation, *config.hidden, 1), generator, config.layer_norm)
        self.add_optimiser("value", self.value.parameters())

    @staticmethod
    def make_actor(sizes: Sizes, config: Settings, generator: torch.Generator) -> GaussianActor | ChoiceActor:
        if sizes.choices:
            return ChoiceActor.undecided(sizes, config.hidden, generator)
        actor = GaussianActor.near_zero(sizes, config.hidden, generator)
        actor.set_deviation(DEVIATION)
        return actor

    @torch.no_grad()
    def explore(self, observation: Tensor, noise: Tensor) -> Tensor:
        return self.actor.draw(observation, noise)

    def learn(self, batch: Batch) -> dict[str, Tensor]:
        return self.update(batch)  # which averages after each gradient step

    def update(self, batch: Batch) -> dict[str, Tensor]:
        assert isinstance(batch, Rollout)
        observation, action = batch.observation.flatten(1, 2), batch.action.flatten(1, 2)
        with torch.no_grad():
            value = self.value(observation).view_as(batch.reward)
            after = self.value(batch.next_observation.flatten(1, 2)).view_as(batch.reward)
            advantage = advantages(batch, value, after).flatten(1)
            target = advantage + value.flatten(1)
            advantage -= advantage.mean(-1, keepdim=True)
            advantage /= advantage.std(-1, correction=0, keepdim=True) + LEAST_DEVIATION
            before = self.actor.log_density(observation, action)
        networks, count = target.shape
        rows = [each.flatten(0, 1) for each in (observation, action, target, advantage, before)]
        first, figures = count * torch.arange(networks, device=target.device).unsqueeze(-1), []
        for _ in range(self.config.updates):
            for index in (first + self.permutation(count)).tensor_split(batch.parts, -1):
                own = index.flatten()  # `index_select` takes a third of the time of an index
                part = (each.index_select(0, own).unflatten(0, index.shape) for each in rows)
                figures.append(self._step(*part, taught=batch.taught))
        self.updates += 1
        return dict(zip(("value_loss", "value", "divergence"), torch.stack(figures).mean(0), strict=True))

    def _step(
        self, observation: Tensor, action: Tensor, target: Tensor, advantage: Tensor, before: Tensor, taught: bool
    ) -> Tensor:
        """Learn from a minibatch; the figures of `update`."""
        value = self.value(observation).squeeze(-1)
        value_loss = (value - target).square().mean(-1)
        log_density = self.actor.log_density(observation, action)
        log_ratio = (log_density - before).clamp(max=MAX_LOG_RATIO)
        ratio = log_ratio.exp()
        gain = torch.minimum(ratio * advantage, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * advantage)
        if taught:
            gain = log_density
        self.gradient_step(("value", "actor"), value_loss.sum() - gain.mean(-1).sum())
        self.average()
        return torch.stack((value_loss.mean(), value.mean(), (ratio - 1.0 - log_ratio).mean())).detach()


def advantages(rollout: Rollout, value: Tensor, after: Tensor) -> Tensor:
    """Generalised advantages (S, T, B) from the values (S, T, B) of observations and next observations."""
    found = rollout.reward + rollout.discount * after - value
    weight = TRACE * rollout.discount * rollout.follows.unsqueeze(-1)
    for t in reversed(range(found.shape[1] - 1)):
        found[:, t] += weight[:, t] * found[:, t + 1]
    return found
