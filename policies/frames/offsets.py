"""Frames whose actions are offsets from what a heuristic commands."""

from __future__ import annotations

import math
import threading
from types import MappingProxyType

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels.guidance import courses
from usvauv.kernels.guidance.acting import Steering
from usvauv.kernels.guidance.lanes import OFFSET
from usvauv.kernels.mission.tasks.tracking import SPREAD
from usvauv.policies.frames.frame import Frame
from usvauv.policies.frames.target import TargetFrame, in_pairs
from usvauv.policies.guidance import command, components, rotate, unit, unrotate
from usvauv.policies.heuristics.passing import Pass
from usvauv.policies.heuristics.tracking import Circle
from usvauv.policies.heuristics.travel import Helm
from usvauv.policies.names import PolicyError

PASSING_TERMS = ("current", "service", "next", "attitude", "motion")  # which `PassingFrame` needs
TURN = OFFSET * math.pi  # rad, largest offset of a heading
LEAST_SPREAD = 1e-3  # of a target's place, over the radius of `circle`


class Observed(threading.local):
    """A `HeuristicWorld` made of the observation; separate in each thread.

    Attributes:
        observation: the present one, (W, K, O).
    """

    observation: Tensor

    def __init__(self, frame: Frame) -> None:
        self.scenario, self.layout, self.term = frame.scenario, frame.layout, frame.term

    def current(self) -> Tensor:
        observed = self.observation if "current" in self.layout else torch.zeros_like(self.observation)
        return self.term(observed, "current" if "current" in self.layout else "position")

    def water_velocity(self) -> Tensor:
        forward, starboard = self.term(self.observation, "motion")[..., :2].unbind(-1)
        return rotate(components(forward, -starboard), self.term(self.observation, "attitude")[..., :2])


class OffsetFrame(TargetFrame):
    """Features as `TargetFrame`, and the velocity through the water that a heuristic commands; actions are offsets
    from it.

    a_0 turns the heading by up to `TURN` to the left, a_1 adds to the speed, 1 being the span from the lowest to the
    highest; the sum is kept within these. Where they are equal, there is no a_1. Action 0 is the heuristic at the
    scenario's own price or radius.

    Attributes:
        heuristic: has `steer`, which gives heading and speed.
    """

    defaults = MappingProxyType({"renewal": False})
    heuristic: Pass | Circle

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.features += 2
        self.actions = 1 if scenario.auv.speed_min == scenario.auv.speed_max else 2
        self.seen = Observed(self)

    def shared(self, observation: Tensor) -> tuple[Tensor, ...]:
        """Heading (unit vectors, (W, K, 2)) and speed (W, K), m/s, of the heuristic."""
        self.seen.observation = observation
        return self.heuristic.steer(observation)

    def encode(self, observation: Tensor, *shared: Tensor) -> Tensor:
        heading, speed = shared or self.shared(observation)
        velocity = heading * (speed / self.scenario.auv.speed_max).unsqueeze(-1)
        bearing = unit(self.term(observation, "target"))
        return torch.cat((super().encode(observation), unrotate(velocity, bearing)), -1)

    def decode(self, observation: Tensor, action: Tensor, *shared: Tensor) -> Tensor:
        auv = self.scenario.auv
        heading, speed = shared or self.shared(observation)
        if self.actions == 2:
            speed = speed + action[..., 1] * (auv.speed_max - auv.speed_min)
        heading = components(*courses.turned(heading.unbind(-1), OFFSET * action[..., 0]))
        return command(heading, speed.clamp(auv.speed_min, auv.speed_max), self.scenario)


class PassingFrame(OffsetFrame):
    """`OffsetFrame` from `pass`.

    Raises:
        PolicyError: the observation lacks one of `PASSING_TERMS`.
    """

    heuristic: Pass

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        if missing := [name for name in PASSING_TERMS if name not in self.layout]:
            raise PolicyError(
                f"training: frame = 'passing': scenario {scenario.name!r} does not observe {', '.join(missing)}"
            )
        price = scenario.reference.pass_price
        self.start = f"pass:{price:g}"
        self.heuristic = Pass(self.start, self.seen, price)

    def steering(self) -> Steering | None:
        x, fastest = self.layout.size, self.scenario.auv.speed_max
        velocity = (x, x + 1, 1, fastest), (x, x + 1, 2, fastest)
        return self.heuristic.steering((*self._rules(), *velocity))


class CirclingFrame(OffsetFrame):
    """Features of an AUV's target and of its own motion; actions as `OffsetFrame`, from `circle`.

    Features, vectors along and left of the target's bearing and over the top speed: d/(d + R), d the distance to the
    target and R the radius of `circle`; velocities of the target and of the AUV through the water; logarithms of the
    standard deviations of the target's place along the bearing and across, over R, and their correlation; the velocity
    by `circle`.

    Raises:
        PolicyError: there are no tracks of targets.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        if "track" not in self.layout:
            raise PolicyError(f"training: frame = 'circling': scenario {scenario.name!r} does not observe track")
        self.features = 10
        self.radius = scenario.reference.circle_radius
        self.start = f"circle:{self.radius:g}"
        self.heuristic = Circle(self.start, self.seen, self.radius)

    def _describe(self, observation: Tensor, bearing: Tensor, distance: Tensor) -> list[Tensor]:
        track, away = self.term(observation, "track"), distance * self.scenario.area.diagonal
        velocities = unrotate(in_pairs(track[..., :4]), bearing[..., None, :]) / self.scenario.auv.speed_max
        deviations = (track[..., 4:6] * (SPREAD / self.radius)).clamp_min(LEAST_SPREAD).log()
        return [away / (away + self.radius), velocities.flatten(-2), deviations, track[..., 6:]]


class FinsFrame(TargetFrame):
    """Features as `TargetFrame`; actions are offsets from the commands of the heuristic `helm` to fins and propeller.

    Action 0 is `helm` at the scenario's speed for `straight`.

    Raises:
        PolicyError: actions are not those of fins.
    """

    defaults = MappingProxyType({"renewal": False})
    actions = 3

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        if scenario.auv.action != "fins":
            raise PolicyError(f"training: frame = 'fins': scenario {scenario.name!r} has {scenario.auv.action} actions")
        speed = scenario.reference.straight_speed
        self.start = f"helm:{speed:g}"
        self.heuristic = Helm(self.start, Observed(self), speed)

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        return (self.heuristic.act(observation) + action).clamp(-1.0, 1.0)
