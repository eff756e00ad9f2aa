"""What a policy is: something that turns observations into actions."""

from __future__ import annotations

from torch import Tensor

from kernels.errors import UserError
from usvauv_env.scenario import Scenario


class PolicyError(UserError, ValueError):
    """A policy cannot be used; the message is one line that names it and what is allowed."""


class Policy:
    """Acts for all AUVs of all worlds at once; deterministic.

    Attributes:
        name: what it is called in tables.
        scenario: the numbers it was made for: sizes, speed limits, form of the action.
        any_team: whether it serves any number of AUVs.
    """

    any_team = False

    def __init__(self, name: str, scenario: Scenario):
        self.name = name
        self.scenario = scenario

    def check(self, world) -> None:
        """Refuse a world, or a scenario, whose observation or action this policy was not made for.

        Raises:
            PolicyError: task, number of AUVs, observed current or form of the action differ.
        """
        scenario, team = getattr(world, "scenario", world), self.scenario.auv.count
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

    def attach(self, world) -> None:
        """Called before a run in `world`."""

    def act(self, observation: Tensor) -> Tensor:
        """Actions (W, K, 2) in [−1, 1] for observations (W, K, O)."""
        raise NotImplementedError
