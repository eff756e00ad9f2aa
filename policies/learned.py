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
from usvauv.kernels import runtime
from usvauv.kernels.guidance.network import CLIP, Actors
from usvauv.policies.frames import frames
from usvauv.policies.names import PolicyError
from usvauv.policies.networks import DeterministicActor, GaussianActor, StackedMLP, stack, unstack
from usvauv.policies.policy import Policy, by_pieces

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
    def of(cls, samples: Tensor) -> Standardizer:
        """Statistics of features (..., F). A feature that varies by less than `LEAST_DEVIATION` is not scaled."""
        flat = samples.flatten(0, -2)
        mean, deviation = flat.mean(0), flat.std(0, correction=0)
        return cls(mean, torch.where(deviation > LEAST_DEVIATION, deviation, torch.ones_like(deviation)))

    def copy_(self, other: Standardizer) -> None:
        """Copy the statistics of another in place, so that all holders of this object use them."""
        self.mean.copy_(other.mean)
        self.deviation.copy_(other.deviation)

    def __call__(self, features: Tensor) -> Tensor:
        return ((features - self.mean) / self.deviation).clamp(-CLIP, CLIP)


class _Workspace(threading.local):
    """The compiled form of a policy and its memory, separate in each thread.

    Attributes:
        act: actions (W, K, A) for observations (W, K, O).
        bound: shape of the observations, and the memory addresses of the actors' and the features' numbers.
    """

    act: Callable[[Tensor], Tensor]
    bound: tuple[torch.Size, list[int]] | None = None


class LearnedPolicy(Policy):
    """Actors, one for each AUV or a shared one, behind a frame; deterministic.

    Args:
        frame: name of a frame, see `frames.frames`.
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
        with frames.calling(frame):
            self.frame = frames[frame](scenario)
        if not self.frame.standardised:  # whose features are as many as there are targets
            standardizer = Standardizer.identity(self.frame.features, standardizer.mean.device)
        self.standardizer = standardizer
        self.actor = actor
        self.shared = shared
        self.about = about
        self.any_team = shared and self.frame.any_team
        self._workspace = _Workspace()

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy, also by `pickle` in another process, is made anew, as kernels and their memory cannot be copied."""
        made_of = self.name, self.scenario, self.frame_name, self.standardizer, self.actor, self.shared
        return type(self), (*made_of, dict(self.about))

    def for_scenario(self, scenario: Scenario) -> LearnedPolicy:
        """A policy of the same actors in another scenario.

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
        own, layers = self._workspace, self.actor.layers()
        # Torch moves tensors that it sends to another process.
        parts = self.standardizer.mean, self.standardizer.deviation, *layers[0], *layers[1]
        bound = observation.shape, [part.data_ptr() for part in parts]
        if own.bound != bound:
            own.act, own.bound = self._compiled(observation.shape), bound
        with frames.calling(self.frame_name):
            return own.act(observation.detach())

    def _compiled(self, shape: torch.Size) -> Callable[[Tensor], Tensor]:
        """A function that acts for observations of a shape: on a CPU by kernels, whose results for a world depend only
        on it.

        A matrix product of torch gives other bits in batches of other sizes.
        """
        scenario, frame = self.scenario, self.frame
        known = type(self.actor) in (DeterministicActor, GaussianActor) and not self.actor.layer_norm
        fits = self.shared or shape[1] == scenario.auv.count
        if not (known and fits and runtime.start().on_cpu):
            return lambda observation: by_pieces(lambda seen: (self.actions(seen),), observation)[0]
        parts = self.standardizer.mean, self.standardizer.deviation, *self.actor.layers()
        # Memory made in torch's inference mode could not be written outside it.
        with frames.calling(self.frame_name), torch.inference_mode(False):
            whole = shape[1:] == (scenario.auv.count, frame.layout.size)
            if whole and (made := frame.acting(shape[0], *parts)):
                return made
            actors = Actors((shape[0], shape[1], frame.features), frame.actions, *parts)

        def act(observation: Tensor) -> Tensor:
            features, *shared = by_pieces(encode, observation)
            return by_pieces(decode, observation, actors(features), *shared)[0]

        def encode(observation: Tensor) -> tuple[Tensor, ...]:
            shared = frame.shared(observation)
            return frame.encode(observation, *shared), *shared

        def decode(*given: Tensor) -> tuple[Tensor]:
            return (frame.decode(*given),)

        return act

    def actions(self, observation: Tensor) -> Tensor:
        """Actions for observations of all worlds at once in torch, with gradients."""
        with frames.calling(self.frame_name):
            shared = self.frame.shared(observation)
            features = self.standardizer(self.frame.encode(observation, *shared))
            action = unstack(self.actor(stack(features, self.shared)), features.shape[1])
            return self.frame.decode(observation, action, *shared)
