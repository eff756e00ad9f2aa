"""The worlds that a policy is trained in, and the noise by which it explores them."""

from __future__ import annotations

import math
from typing import Any, Protocol

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario


class TrainingWorld(Protocol):
    """W worlds of K AUVs, stepped, truncated and reset together; `usvauv.env.world.world.World` is one.

    Attributes:
        scenario: sizes, speed limits, layout of the observation, form of the action.
        num_worlds: W.
        num_auvs: K.
        steps: steps of an episode.
        device: where its tensors live.
        reward_names: names of the R terms of the reward.
        measure_names: names of the M measures; "power", "hovering", "service_rate", "border" and "position_error" are
            among them.
    """

    scenario: Scenario
    num_worlds: int
    num_auvs: int
    steps: int
    device: torch.device
    reward_names: tuple[str, ...]
    measure_names: tuple[str, ...]

    def reset(self) -> Tensor:
        """Begin the next episode of all worlds; returns observations (W, K, O)."""
        ...

    def step(self, action: Tensor, /) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Advance all worlds by one step of actions (W, K, 2) in [−1, 1].

        Returns:
            observation (W, K, O); reward (W, K); horizon_ended (W, K): the value's horizon ends here, the episode
            continues; truncated (W, K): the episode is over, the same for all; info with "reward_terms" (W, K, R) and
            "measures" (W, K, M). The caller copies tensors that it keeps beyond the next step.
        """
        ...

    def state(self) -> dict[str, Tensor]:
        """Everything that decides the future of the worlds, as copies."""
        ...

    def load_state(self, state: dict[str, Tensor], /) -> None:
        """Restore a state that `state` returned."""
        ...


class CorrelatedNoise:
    """Standard normal noise whose neighbours in time have correlation ρ: ε ← ρ ε + √(1 − ρ²) ξ.

    A course or speed tried for a single mission step changes the return by less than its noise. Correlated noise holds
    it for about 1/(1 − ρ) steps, and n-step returns credit it. This is the process of Ornstein and Uhlenbeck,
    as in DDPG's paper (arXiv:1509.02971), sampled at the mission's step.

    Args:
        shape: of the noise of one step.
        correlation: ρ, at least 0 and below 1.
        generator: source of the normal numbers, on the device of the noise.
    """

    def __init__(self, shape: tuple[int, ...], correlation: float, generator: torch.Generator) -> None:
        self.correlation = correlation
        self.generator = generator
        self.value = self._draw(shape)

    def _draw(self, shape: tuple[int, ...]) -> Tensor:
        return torch.randn(shape, dtype=torch.float32, generator=self.generator, device=self.generator.device)

    def step(self) -> Tensor:
        """The noise of the next step."""
        rho = self.correlation
        self.value = rho * self.value + math.sqrt(1.0 - rho * rho) * self._draw(self.value.shape)
        return self.value
