"""Learned policies: a frame, standardised features, a stack of actor networks."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels.guidance import CLIP, Acting
from usvauv.policies.frames import FRAMES
from usvauv.policies.networks import DeterministicActor, GaussianActor, StackedMLP, stack, unstack
from usvauv.policies.policy import Policy, PolicyError, by_pieces

LEAST_DEVIATION = 1e-3  # of a feature that is scaled


@dataclass(frozen=True)
class Standardizer:
    """Features of zero mean and unit variance: (f − mean) / deviation, clipped to ±`CLIP`; mean and deviation (F,)."""

    mean: Tensor
    deviation: Tensor

    @classmethod
    def identity(cls, features: int, device: torch.device) -> Standardizer:
        """Zero mean and unit deviation: only features beyond ±`CLIP` change."""
        return cls(*(torch.full((features,), value, dtype=torch.float32, device=device) for value in (0.0, 1.0)))

    @classmethod
    def of(cls, samples: Tensor, over_all: Callable[[Tensor], Tensor] | None = None) -> Standardizer:
        """Statistics of features (..., F). A feature that varies by less than `LEAST_DEVIATION` is not scaled.

        Args:
            samples: the features.
            over_all: mean of a tensor over several processes, each with its own samples; None: one process.
        """
        flat = samples.flatten(0, -2)
        mean, deviation = flat.mean(0), flat.std(0, correction=0)
        if over_all is not None:
            joint = over_all(mean)
            mean, deviation = joint, over_all(deviation.square() + (mean - joint).square()).sqrt()
        return cls(mean, torch.where(deviation > LEAST_DEVIATION, deviation, torch.ones_like(deviation)))

    def copy_(self, other: Standardizer) -> None:
        """Copy the statistics of another in place, so that all holders of this object use them."""
        self.mean.copy_(other.mean)
        self.deviation.copy_(other.deviation)

    def __call__(self, features: Tensor) -> Tensor:
        return ((features - self.mean) / self.deviation).clamp(-CLIP, CLIP)


class _Kernel(threading.local):
    """A kernel that acts, with separate memory in each thread.

    Attributes:
        made: the kernel; None: there is none.
        bound: shape of its observations, and the memory addresses of the actors' and the features' numbers.
    """

    made: Acting | None = None
    bound: tuple[torch.Size, list[int]] | None = None


class LearnedPolicy(Policy):
    """Actors, one for each AUV or a shared one, behind a frame; deterministic.

    Args:
        frame: name of a frame, see `frames.FRAMES`.
        about: JSON of its checkpoint, with its provenance.

    Attributes:
        any_team: whether it can act for any number of AUVs.
    """

    def __init__(
        self,
        name: str,
        scenario: Scenario,
        frame: str,
        standardizer: Standardizer,
        actor: StackedMLP,
        shared: bool,
        about: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        super().__init__(name, scenario)
        self.frame_name = frame
        with FRAMES.calling(frame):
            self.frame = FRAMES[frame](scenario)
        self.standardizer = standardizer
        self.actor = actor
        self.shared = shared
        self.about = about
        self.any_team = shared and self.frame.any_team
        self._kernel = _Kernel()

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy, also by `pickle` in another process, is made anew, as kernels and their memory cannot be copied."""
        made_of = self.name, self.scenario, self.frame_name, self.standardizer, self.actor, self.shared
        return type(self), (*made_of, dict(self.about))

    def for_scenario(self, scenario: Scenario) -> LearnedPolicy:
        """The same actors in another scenario.

        Raises:
            PolicyError: task, number of AUVs, observed terms or form of the action differ.
        """
        team = self.scenario.auv.count
        for quantity, own, needed in (
            ("task", self.scenario.task, scenario.task),
            ("number of AUVs", team, team if self.any_team else scenario.auv.count),
            ("observed current", self.scenario.observation.current, scenario.observation.current),
            ("extra observation terms", self.scenario.observation.extra, scenario.observation.extra),
            ("action form", self.scenario.auv.action, scenario.auv.action),
        ):
            if own != needed:
                raise PolicyError(
                    f"policy {self.name}: made for {quantity} {own}, but scenario {scenario.name!r} has {needed}"
                )
        return LearnedPolicy(
            self.name, scenario, self.frame_name, self.standardizer, self.actor, self.shared, self.about
        )

    def act(self, observation: Tensor) -> Tensor:
        own, layers = self._kernel, self.actor.layers()
        # Torch moves tensors that it sends to another process.
        parts = self.standardizer.mean, self.standardizer.deviation, *layers[0], *layers[1]
        bound = observation.shape, [part.data_ptr() for part in parts]
        if own.bound != bound:
            own.made, own.bound = self._kernel_for(observation.shape), bound
        return own.made(observation.detach()) if own.made else by_pieces(self.actions, observation)

    def _kernel_for(self, shape: torch.Size) -> Acting | None:
        """A kernel for observations of a shape; None: there is none, for example for a part of a team."""
        plain = type(self.actor) in (DeterministicActor, GaussianActor) and not self.actor.layer_norm
        if not plain or shape[1:] != (self.scenario.auv.count, self.frame.layout.size):
            return None
        # Memory made in torch's inference mode could not be written outside it.
        with FRAMES.calling(self.frame_name), torch.inference_mode(False):
            return self.frame.acting(
                shape[0], self.standardizer.mean, self.standardizer.deviation, *self.actor.layers()
            )

    def actions(self, observation: Tensor) -> Tensor:
        """The same for all worlds at once, with gradients."""
        with FRAMES.calling(self.frame_name):
            features = self.standardizer(self.frame.encode(observation))
            action = unstack(self.actor(stack(features, self.shared)), features.shape[1])
            return self.frame.decode(observation, action)
