"""Features brought to one scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

CLIP = 8.0
LEAST_DEVIATION = 1e-3  # of a feature that is scaled


@dataclass(frozen=True)
class Standardizer:
    """Features of zero mean and unit variance: (f − mean) / deviation, clipped to ±`CLIP`; mean and deviation (F,)."""

    mean: Tensor
    deviation: Tensor

    @classmethod
    def identity(cls, features: int, device: torch.device) -> Standardizer:
        """Statistics that change nothing but the largest features."""
        return cls(torch.zeros(features, device=device), torch.ones(features, device=device))

    @classmethod
    def of(cls, samples: Tensor, over_all: Callable[[Tensor], Tensor] | None = None) -> Standardizer:
        """Statistics of features (..., F). One that varies by less than `LEAST_DEVIATION` keeps its own scale.

        Args:
            samples: the features.
            over_all: mean of a tensor over several processes, each with samples of its own; None: there is one.
        """
        flat = samples.flatten(0, -2)
        mean, deviation = flat.mean(0), flat.std(0, correction=0)
        if over_all is not None:
            joint = over_all(mean)
            mean, deviation = joint, over_all(deviation.square() + (mean - joint).square()).sqrt()
        return cls(mean, torch.where(deviation > LEAST_DEVIATION, deviation, torch.ones_like(deviation)))

    def copy_(self, other: Standardizer) -> None:
        """Take over the statistics of another, for everyone who shares this one."""
        self.mean.copy_(other.mean)
        self.deviation.copy_(other.deviation)

    def __call__(self, features: Tensor) -> Tensor:
        return ((features - self.mean) / self.deviation).clamp(-CLIP, CLIP)
