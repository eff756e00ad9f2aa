"""Travelling to the target at the speed that a price of time makes best."""

from __future__ import annotations

import math
from typing import ClassVar

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.world.world import World
from usvauv.policies.guidance import SpeedToFly, command, crab, unit
from usvauv.policies.heuristics.heuristic import Heuristic, number


class Pace(Heuristic):
    """As `crab`, at the speed through the water that `guidance.SpeedToFly` gives for a price of time in W.

    Attributes:
        reference: field of the scenario's section `reference` with the default price.
    """

    reference: ClassVar[str] = "pace_price"
    argument: float

    def __init__(self, name: str, world: World, argument: float) -> None:
        super().__init__(name, world, argument)
        self.speed_to_fly = SpeedToFly(self.scenario)

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> float:
        default = getattr(scenario.reference, cls.reference)
        price = default if text is None else number(text, "a price of time in W, such as 40")
        if not (math.isfinite(price) and price >= 0.0):
            raise ValueError("the price of time must be at least 0 W")
        return price

    def track(self, observation: Tensor) -> Tensor:
        """Direction over ground, unit vectors (W, K, 2)."""
        return unit(self.target(observation))

    def act(self, observation: Tensor) -> Tensor:
        track = self.track(observation)
        current = self.world.current().to(track)
        speed = self.speed_to_fly(track, torch.full_like(track[..., 0], self.argument), current)
        return command(crab(track, speed, current), speed, self.scenario)
