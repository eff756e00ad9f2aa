"""Heuristics that travel to the target or hold a station, with the current at the AUV known."""

from __future__ import annotations

import math
from typing import ClassVar

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels.mission.observation import DEPTH_UNIT
from usvauv.policies.guidance import SpeedToFly, angle, clear_of_others, command, components, crab, unit
from usvauv.policies.heuristics import heuristics
from usvauv.policies.policy import Heuristic, HeuristicWorld, by_pieces, number


class ConstantSpeed(Heuristic):
    """A heuristic whose argument is its speed through the water, m/s.

    Attributes:
        reference: field of the scenario's section `reference` with the default speed.
    """

    reference: ClassVar[str]
    parameter = ("SPEED", "m/s")
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
    """Heads straight for the target at one speed through the water; the current carries it off course."""

    reference = "straight_speed"

    def act(self, observation: Tensor) -> Tensor:
        return command(self.bearing(observation), self.argument, self.scenario)


class Helm(ConstantSpeed):
    """Heads straight for the target at cruise depth or altitude by rudder, stern plane and propeller themselves.

    Each command, a share of its limit, is proportional to the error of heading, pitch or speed, and to the rate of turn
    or pitch. The desired pitch is proportional to the error of depth.
    """

    reference = "straight_speed"

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> float:
        if scenario.auv.action != "fins":
            raise ValueError(f'commands fins: needs auv.action = "fins", not "{scenario.auv.action}"')
        return super().parse(text, scenario)

    def act(self, observation: Tensor) -> Tensor:
        x, y = self.bearing(observation).unbind(-1)
        cos, sin, pitch, _ = observation[..., self.layout.slice("attitude")].unbind(-1)
        below, above = (DEPTH_UNIT * observation[..., self.layout.slice("depth")]).unbind(-1)
        u, _, _, _, pitching, turning, *_ = observation[..., self.layout.slice("motion")].unbind(-1)
        if altitude := self.scenario.auv.altitude:
            below = altitude - above
        off = angle(components(cos * x + sin * y, sin * x - cos * y))  # to starboard
        rudder = 0.5 * off - 0.5 * turning
        stern = pitch - (0.1 * below).clamp(-0.35, 0.35) + 0.5 * pitching
        propeller = 0.4 * self.argument + 0.3 * (self.argument - u)
        return torch.stack((rudder, stern, propeller), -1).clamp(-1.0, 1.0)


class Crab(ConstantSpeed):
    """Heads up the current so that its track over ground leads to the target, at one speed. See `guidance.crab`."""

    reference = "crab_speed"

    def act(self, observation: Tensor) -> Tensor:
        bearing = self.bearing(observation)
        heading = crab(bearing, torch.full_like(bearing[..., 0], self.argument), self.world.current().to(bearing))
        return command(heading, self.argument, self.scenario)


class Pace(Heuristic):
    """Steers as `crab` does, at the most economical speed for a price of time. See `guidance.SpeedToFly`.

    Attributes:
        reference: field of the scenario's section `reference` with the default price.
    """

    reference: ClassVar[str] = "pace_price"
    parameter = ("PRICE", "W")
    argument: float

    def __init__(self, name: str, world: HeuristicWorld, argument: float) -> None:
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
        return by_pieces(self._actions, observation, self.world.current().to(observation))[0]

    def _actions(self, observation: Tensor, current: Tensor) -> tuple[Tensor]:
        """Actions of all worlds in a current at the AUVs, (W, K, 2), m/s."""
        track = self.track(observation)
        price = torch.full_like(track[..., 0], self.argument)
        return (command(*self.speed_to_fly.steer(track, price, current), self.scenario),)


class Clear(Pace):
    """Steers as `pace` does, and keeps clear of the nearest other AUV.

    That AUV repels the track over ground, see `guidance.clear_of_others`; positions are estimates.
    """

    reference = "clear_price"

    def __init__(self, name: str, world: HeuristicWorld, argument: float) -> None:
        super().__init__(name, world, argument)
        self._others = self.layout.slice("others")

    def clear(self, track: Tensor, observation: Tensor) -> Tensor:
        """A track over ground, unit vectors (W, K, 2), repelled by the nearest other AUV."""
        scenario = self.scenario
        others = observation[..., self._others].unflatten(-1, (scenario.auv.count - 1, 2)) * scenario.area.diagonal
        return clear_of_others(track, others, scenario.auv.safe_distance)

    def track(self, observation: Tensor) -> Tensor:
        return self.clear(super().track(observation), observation)


class Keep(Heuristic):
    """Keeps station: the velocity over ground that reaches the target in one step, within the limits of speed.

    It uses the current at the AUV and the measured position.
    """

    def act(self, observation: Tensor) -> Tensor:
        auv, step = self.scenario.auv, self.scenario.mission.step
        offset = self.target(observation) * self.scenario.area.diagonal
        velocity = offset / step - self.world.current().to(observation)
        speed = velocity.norm(dim=-1).clamp(auv.speed_min, auv.speed_max)
        return command(unit(velocity), speed, self.scenario)


heuristics.register("straight", Straight)
heuristics.register("helm", Helm)
heuristics.register("crab", Crab)
heuristics.register("pace", Pace)
heuristics.register("clear", Clear)
heuristics.register("keep", Keep)
