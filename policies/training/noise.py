"""Exploration noise that is correlated in time."""

from __future__ import annotations

import math

import torch
from torch import Tensor


class CorrelatedNoise:
    """Standard normal noise whose neighbours in time have correlation ρ: ε ← ρ ε + √(1 − ρ²) ξ.

    A course or speed tried for a single mission step changes the return too little to be told from noise. Correlated
    noise holds it for about 1/(1 − ρ) steps, and n-step returns credit it. This is the process of Ornstein and
    Uhlenbeck, as in DDPG's paper (arXiv:1509.02971), sampled at the mission's step.

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
        return torch.randn(shape, generator=self.generator, device=self.generator.device)

    def step(self) -> Tensor:
        """The noise of the next step."""
        rho = self.correlation
        self.value = rho * self.value + math.sqrt(1.0 - rho * rho) * self._draw(self.value.shape)
        return self.value
