"""A policy that was learned: whitened features, a stack of actor networks, a frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import torch
from torch import Tensor

from policies.frames import FRAMES
from policies.networks import StackedMLP
from policies.policy import Policy, PolicyError
from policies.replay import stack, unstack
from usvauv_env.scenario import Scenario

CLIP = 8.0


@dataclass
class Whitening:
    """Brings features to zero mean and unit variance: (f − mean) / deviation, cut off at ±8; mean, deviation (F,)."""

    mean: Tensor
    deviation: Tensor

    @classmethod
    def identity(cls, features: int, device: torch.device) -> Whitening:
        return cls(torch.zeros(features, device=device), torch.ones(features, device=device))

    @classmethod
    def of(cls, samples: Tensor) -> Whitening:
        """Measured on features (..., F). One that hardly varies there keeps its own scale."""
        flat = samples.flatten(0, -2)
        deviation = flat.std(0, correction=0)
        return cls(flat.mean(0), torch.where(deviation > 1e-3, deviation, torch.ones_like(deviation)))

    def __call__(self, features: Tensor) -> Tensor:
        return ((features - self.mean) / self.deviation).clamp(-CLIP, CLIP)


class LearnedPolicy(Policy):
    """Actors, one for each AUV or a shared one, behind a frame.

    Attributes:
        any_team: whether it serves any number of AUVs.
        about: JSON of its checkpoint, how it was made.
    """

    def __init__(
        self,
        name: str,
        scenario: Scenario,
        frame: str,
        whitening: Whitening,
        actor: StackedMLP,
        shared: bool,
        about: Mapping[str, Any] = MappingProxyType({}),
    ):
        super().__init__(name, scenario)
        self.frame = FRAMES[frame](scenario)
        self.whitening = whitening
        self.actor = actor
        self.shared = shared
        self.about = about
        self.any_team = shared and self.frame.any_team

    def for_scenario(self, scenario: Scenario) -> LearnedPolicy:
        """The same actors in another scenario.

        Raises:
            PolicyError: task, number of AUVs, observed current or form of the action differ.
        """
        team = self.scenario.auv.count
        for quantity, own, needed in (
            ("task", self.scenario.task, scenario.task),
            ("number of AUVs", team, team if self.any_team else scenario.auv.count),
            ("observed current", self.scenario.observation.current, scenario.observation.current),
            ("action form", self.scenario.auv.action, scenario.auv.action),
        ):
            if own != needed:
                raise PolicyError(
                    f"policy {self.name}: made for {quantity} {own}, but scenario {scenario.name!r} has {needed}"
                )
        return LearnedPolicy(self.name, scenario, self.frame.name, self.whitening, self.actor, self.shared, self.about)

    @torch.no_grad()
    def act(self, observation: Tensor) -> Tensor:
        features = self.whitening(self.frame.encode(observation))
        action = unstack(self.actor(stack(features, self.shared)), observation.shape[1])
        return self.frame.decode(observation, action)
