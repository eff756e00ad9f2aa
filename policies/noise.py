"""Exploration noise that remembers itself."""

from __future__ import annotations

import math

import torch
from torch import Tensor


class CorrelatedNoise:
    """Standard normal noise whose neighbours in time have correlation ρ: ε ← ρ ε + √(1 − ρ²) ξ.

    One mission step is short: a course or speed tried for a single step hardly changes what follows, and its value
    drowns in that of everything else. Tried for about 1/(1 − ρ) steps, and credited by n-step returns, it shows. This
    is the process of Ornstein and Uhlenbeck, as in DDPG's paper (arXiv:1509.02971), sampled at the mission's step.
    """

    def __init__(self, shape: tuple[int, ...], correlation: float, generator: torch.Generator):
        self.correlation = correlation
        self.generator = generator
        self.value = self._fresh(shape)

    def _fresh(self, shape: tuple[int, ...]) -> Tensor:
        return torch.randn(shape, generator=self.generator, device=self.generator.device)

    def step(self) -> Tensor:
        """The noise of the next step."""
        rho = self.correlation
        self.value = rho * self.value + math.sqrt(1.0 - rho * rho) * self._fresh(self.value.shape)
        return self.value
