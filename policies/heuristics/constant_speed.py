"""Travelling to the target at one speed through the water."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.policies.guidance import command, crab, unit
from usvauv.policies.heuristics.heuristic import Heuristic, number


class ConstantSpeed(Heuristic):
    """A heuristic whose argument is its speed through the water, m/s.

    Attributes:
        reference: field of the scenario's section `reference` with the default speed.
    """

    reference: ClassVar[str]
    argument: float

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> float:
        default = getattr(scenario.reference, cls.reference)
        speed = default if text is None else number(text, "a speed in m/s, such as 1.5")
        low, high = scenario.auv.speed_min, scenario.auv.speed_max
        if not low <= speed <= high:
            raise ValueError(f"speed must lie between {low:g} and {high:g} m/s in scenario {scenario.name!r}")
        return speed

    def bearing(self, observation: Tensor) -> Tensor:
        """Unit vector towards the measured target, (W, K, 2)."""
        return unit(self.target(observation))


class Straight(ConstantSpeed):
    """Heads for the target through the water."""

    reference = "straight_speed"

    def act(self, observation: Tensor) -> Tensor:
        return command(self.bearing(observation), self.argument, self.scenario)


class Crab(ConstantSpeed):
    """Heads so that the track over ground points at the target, see `guidance.crab`."""

    reference = "crab_speed"

    def act(self, observation: Tensor) -> Tensor:
        bearing = self.bearing(observation)
        heading = crab(bearing, torch.full_like(bearing[..., 0], self.argument), self.world.current().to(bearing))
        return command(heading, self.argument, self.scenario)
