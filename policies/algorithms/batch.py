"""What a learner learns from in one update."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Batch:
    """n-step transitions of S independent learners, B each.

    Attributes:
        observation: (S, B, F) features at step t.
        action: (S, B, A) action taken there.
        reward: (S, B) Σ γ^i r_{t+i} over the m ≤ n steps until the value's horizon or the episode ends.
        discount: (S, B) weight of the value of `next_observation`: γ^m, or 0 where the value's horizon ended.
        next_observation: (S, B, F) features at step t + m.
    """

    observation: Tensor
    action: Tensor
    reward: Tensor
    discount: Tensor
    next_observation: Tensor
