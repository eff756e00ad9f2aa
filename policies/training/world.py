"""What training needs of a world."""

from __future__ import annotations

from typing import Any, Protocol

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario


class TrainingWorld(Protocol):
    """W worlds of K AUVs, stepped, truncated and reset together; `usvauv.env.World` is one.

    Attributes:
        scenario: sizes, speed limits, layout of the observation, form of the action.
        num_worlds: W.
        num_auvs: K.
        steps: steps of an episode.
        device: where its tensors live.
        reward_names: names of the R terms of the reward.
        measure_names: names of the M measures; "power", "hovering", "service_rate", "border" and "position_error" are
            among them.
        common_state: names in `state` of what all worlds have in common; the first axis of the others is W. Read where
            several processes train.
    """

    scenario: Scenario
    num_worlds: int
    num_auvs: int
    steps: int
    device: torch.device
    reward_names: tuple[str, ...]
    measure_names: tuple[str, ...]
    common_state: tuple[str, ...]

    def reset(self) -> Tensor:
        """Begin the next episode of all worlds; returns observations (W, K, O)."""
        ...

    def step(self, action: Tensor, /) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Advance all worlds by one step of actions (W, K, 2) in [−1, 1].

        Returns:
            observation (W, K, O); reward (W, K); horizon_ended (W, K): the value's horizon ends here, the episode goes
            on; truncated (W, K): the episode is over, the same for all; info with "reward_terms" (W, K, R) and
            "measures" (W, K, M). The caller copies what it keeps beyond the next step.
        """
        ...

    def state(self) -> dict[str, Tensor]:
        """Everything that decides the future of the worlds, as copies."""
        ...

    def load_state(self, state: dict[str, Tensor], /) -> None:
        """Go back to a state."""
        ...
