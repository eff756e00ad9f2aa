"""Base of all policies."""

from __future__ import annotations

from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels.errors import UserError


class PolicyError(UserError, ValueError):
    """A policy cannot be used; the message is one line that names it and what is allowed."""


class Policy:
    """Actions for observations of all AUVs of all worlds at once, without exploration.

    Attributes:
        name: what it is called in tables.
        scenario: that of the world it acts in: sizes, speed limits, form of the action.
    """

    def __init__(self, name: str, scenario: Scenario) -> None:
        self.name = name
        self.scenario = scenario

    def act(self, observation: Tensor) -> Tensor:
        """Actions (W, K, A) in [−1, 1] for observations (W, K, O)."""
        raise NotImplementedError
