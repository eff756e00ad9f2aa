"""Frames: conversion between a world's observations and actions and a network's.

The world's observation and action are in world axes, in which a network has to learn every heading separately. In the
target's frame x′ points from the AUV to its target and y′ to the left of it, and an action is a course relative to that
bearing and a speed, so that "straight to the target" is a constant. The bearing and the AUV's own position are among
the features, so no information is lost.
"""

from __future__ import annotations

import math
import threading
from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels.guidance import courses
from usvauv.kernels.guidance.acting import Acting, Conversion, Steering
from usvauv.kernels.guidance.lanes import FIRST, OFFSET, Start
from usvauv.kernels.mission.tasks.tracking import SPREAD
from usvauv.kernels.mission.tasks.tracking_outlook import EACH, MOST, OWN, SIDES, STEPS
from usvauv.kernels.mission.tasks.tracking_outlook import TURN as RUDDER
from usvauv.kernels.registry import Registry
from usvauv.policies.guidance import (
    SpeedToFly,
    clear_of_others,
    command,
    components,
    nearest,
    polar,
    rotate,
    unit,
    unrotate,
)
from usvauv.policies.heuristics.passing import Pass
from usvauv.policies.heuristics.tracking import Circle, leash
from usvauv.policies.heuristics.travel import Helm
from usvauv.policies.names import PolicyError
from usvauv.policies.networks import Sizes
from usvauv.policies.steering import BORDER_MARGIN, PRICE_GAIN, Rules, reach, steering

PASSING_TERMS = ("current", "service", "next", "attitude", "motion")  # which `PassingFrame` needs
TURN = OFFSET * math.pi  # rad, largest offset of a heading
LEAST_SPREAD = 1e-3  # of a target's place, over the radius of `circle`
FARTHEST = 2.0  # leashes of `tree`, see `RudderFrame`
PRICE = 80.0  # W, with `PRICE_GAIN` prices from 1.5 W to some kilowatts, for all speeds in any current
RELATIVE = ("others", "target")  # terms that `TargetFrame` replaces by its own features
CURRENTS = ("current_speed", "current", "current_profile")
VECTORS = {
    "current": 2,
    "current_profile": None,
    "next": 2,
    "attitude": 2,
    "track": 4,
}  # how many of their numbers are vectors


class Frame:
    """Features for a network, and the world's actions for the network's.

    Attributes:
        any_team: whether the number of features is the same for any number of AUVs.
        features: F, number of features of one AUV.
        actions: number of actions of the network for one AUV.
        choices, own, each: see `usvauv.policies.networks.Sizes`.
        standardised: whether the network gets features of zero mean and unit variance.
        teacher: name of a heuristic, whose actions `choice` can tell; empty without one.
        start: name of the policy equal to the network's action 0, near which learning begins; empty without one.
    """

    any_team: ClassVar[bool] = False
    choices: ClassVar[int] = 0
    own: ClassVar[int] = 0
    each: ClassVar[int] = 0
    standardised: ClassVar[bool] = True
    teacher: ClassVar[str] = ""
    features: int
    actions: int = 2
    start: str = ""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.layout = ObservationLayout.of(scenario)
        self._places = dict(self.layout)

    def sizes(self, shared: bool) -> Sizes:
        """Shape of networks, one for all AUVs or one for each."""
        stack = 1 if shared else self.scenario.auv.count
        return Sizes(stack, self.features, self.actions, self.choices, self.own, self.each)

    def term(self, observation: Tensor, name: str) -> Tensor:
        """A term of the observation, (W, K, n), see `usvauv.kernels.mission.observation`.

        Raises:
            KeyError: the scenario does not have it.
        """
        return observation[..., self._places[name]]

    def shared(self, observation: Tensor) -> tuple[Tensor, ...]:
        """Tensors (W, K, ...) that `encode` and `decode` both need; both take them as further arguments."""
        return ()

    @abstractmethod
    def encode(self, observation: Tensor) -> Tensor:
        """Features (W, K, F) of observations (W, K, O)."""
        raise NotImplementedError

    @abstractmethod
    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        """The world's actions (W, K, A) for a network's actions (W, K, `actions`) in [−1, 1]."""
        raise NotImplementedError

    def choice(self, observation: Tensor, command: Tensor) -> Tensor:
        """The network's actions (W, K, `actions`) that come nearest to the world's, of a frame with a teacher."""
        raise NotImplementedError

    def acting(
        self, worlds: int, mean: Tensor, deviation: Tensor, weights: Sequence[Tensor], biases: Sequence[Tensor]
    ) -> Acting | None:
        """A kernel with the same results as `encode`, actors and `decode`; None: there is none.

        Args:
            worlds: W. mean, deviation: statistics that standardise features, (F,); may change in place.
            weights, biases: of the actors, see `usvauv.policies.networks.StackedMLP`.
        """
        steering = self.steering() if type(self) in COMPILED else None
        return steering and Acting(steering, worlds, mean, deviation, weights, biases)

    def conversion(self, worlds: int) -> Conversion | None:
        """Kernels with the same results as `encode` and `decode`, for W worlds; None: there are none."""
        steering = self.steering() if type(self) in COMPILED else None
        return steering and Conversion(steering, worlds, self.features, self.actions)

    def steering(self) -> Steering | None:
        """What the kernels need; None: there are none."""
        return None


class WorldFrame(Frame):
    """Features are the observation, actions the world's."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.features, self.actions = self.layout.size, scenario.auv.action_size

    def encode(self, observation: Tensor) -> Tensor:
        return observation.clone()

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        return action


def in_pairs(vectors: Tensor) -> Tensor:
    """Vectors (..., n, 2) from their components in sequence, (..., 2 n)."""
    return vectors.reshape(*vectors.shape[:-1], -1, 2)


def joined(parts: Sequence[Tensor]) -> Tensor:
    """Parts (..., n) side by side, each number of all AUVs one after the other in memory."""
    return torch.cat([part.movedim(-1, 0) for part in parts]).movedim(0, -1)


class TargetFrame(Frame):
    """Features and actions relative to the bearing of the target.

    Features (positions over the area's diagonal): distance to the target and its closeness, bearing (cos, sin), nearest
    other AUV (x′, y′), sum over the others of closeness times direction (x′, y′), largest closeness; then the other
    terms of the observation in their order, with currents over the top speed and their components along x′ and y′.
    Closeness of a distance d is exp(−d / (2 safe distances)). The number of features does not depend on K.

    Actions: a_0 is the course, π a_0 left of the target's bearing; a_1 the speed, linear from the lowest at −1 to the
    highest at 1.
    """

    any_team = True

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.features = FIRST + sum(place.stop - place.start for name, place in self.layout if name not in RELATIVE)
        self.start = f"straight:{(scenario.auv.speed_min + scenario.auv.speed_max) / 2:g}"
        self.reach = reach(scenario)

    def encode(self, observation: Tensor) -> Tensor:
        bearing, distance = polar(self.term(observation, "target"))
        return joined(self._describe(observation, bearing, distance[..., None]))

    def _describe(self, observation: Tensor, bearing: Tensor, distance: Tensor) -> list[Tensor]:
        """The features in parts, (..., n)."""
        closeness = torch.exp(-distance / self.reach)
        parts = [distance, closeness, bearing, *self._others(observation, bearing)]
        for name in self.layout.terms:
            if name in RELATIVE:
                continue
            value = self.term(observation, name)
            if name in CURRENTS:
                value = value / self.scenario.auv.speed_max
            if name in VECTORS:
                vectors = value[..., : VECTORS[name]]
                turned = unrotate(in_pairs(vectors), bearing[..., None, :])
                parts.append(turned.reshape(vectors.shape))
                value = value[..., vectors.shape[-1] :]
            parts.append(value)
        return parts

    def _others(self, observation: Tensor, bearing: Tensor) -> list[Tensor]:
        """Nearest other AUV and sum of closeness, (..., 2), and largest closeness, (..., 1); zeros for a single AUV."""
        if self.layout.num_auvs == 1:
            return [torch.zeros_like(bearing), torch.zeros_like(bearing), torch.zeros_like(bearing[..., :1])]
        others = unrotate(in_pairs(self.term(observation, "others")), bearing[..., None, :])
        distance, close, pull = courses.closeness(others.unbind(-1), -1.0 / self.reach)
        if self.layout.num_auvs == 2:
            return [others[..., 0, :], components(*pull)[..., 0, :], close]
        return [
            nearest(distance, others)[1],
            components(*pull).sum(-2),
            close.amax(-1)[..., None],
        ]

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        auv = self.scenario.auv
        speed = auv.speed_min + (auv.speed_max - auv.speed_min) * (action[..., 1] + 1.0) / 2.0
        return command(self._course(action, unit(self.term(observation, "target"))), speed, self.scenario)

    def steering(self) -> Steering | None:
        return steering(self.scenario, Start.TARGET, rules=self._rules())

    def _rules(self) -> Rules:
        """Where the features after the first ones come from."""
        rules: list[tuple[int, int, int, float]] = []
        for name, place in self.layout:
            if name in RELATIVE:
                continue
            columns = range(place.start, place.stop)
            scale, vectors = self.scenario.auv.speed_max if name in CURRENTS else 1.0, columns[: VECTORS.get(name, 0)]
            for x in vectors[::2]:
                rules += [(x, x + 1, 1, scale), (x, x + 1, 2, scale)]
            rules += [(x, x, 0, scale) for x in columns[len(vectors) :]]
        return rules

    def _course(self, action: Tensor, ahead: Tensor) -> Tensor:
        """The course that a_0 commands, π a_0 left of `ahead`; unit vectors in world axes, (..., 2)."""
        return components(*courses.turned(ahead.unbind(-1), action[..., 0]))


class GuidedFrame(TargetFrame):
    """Features as `TargetFrame`; actions go through an autopilot, which compensates the current at the AUV.

    a_0 is the course over ground, π a_0 left of the track of the heuristic `clear`, held against the current by `crab`;
    a_1 the price of time, `PRICE` e^(4 a_1) W, from which `SpeedToFly` gives the speed through the water. Action 0 is
    `clear`. Where the current's components are not observed, still water is assumed. There the lowest speed is optimal
    for all low prices, and a_1 = 0 stands for the highest of these; around a lower one exploration would not change the
    speed. Within `BORDER_MARGIN` of the border a course that leads out is turned along it.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.speed_to_fly = SpeedToFly(scenario)
        self.price = PRICE if "current" in self.layout else self.speed_to_fly.free_price()
        self.start = f"clear:{self.price:.3g}"

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        others, metre = in_pairs(self.term(observation, "others")), self.scenario.area.diagonal
        target = unit(self.term(observation, "target"))
        clear = clear_of_others(target, others * metre, self.scenario.auv.safe_distance)
        track = self._clear_of_border(observation, self._course(action, clear))
        observed = "current" in self.layout
        current = self.term(observation, "current") if observed else torch.zeros_like(track)
        price = self.price * torch.exp(PRICE_GAIN * action[..., 1])
        return command(*self.speed_to_fly.steer(track, price, current), self.scenario)

    def steering(self) -> Steering | None:
        speeds = self.speed_to_fly.speeds, self.speed_to_fly.power
        return steering(self.scenario, Start.CLEAR, self.price, speeds, rules=self._rules())

    def _clear_of_border(self, observation: Tensor, track: Tensor) -> Tensor:
        """A course over ground (unit vectors, (..., 2)) that does not lead out of the area."""
        area = self.scenario.area
        position = self.term(observation, "position") * area.diagonal
        ends = area.width - BORDER_MARGIN, area.length - BORDER_MARGIN
        return components(*courses.clear_of_border(position.unbind(-1), track.unbind(-1), BORDER_MARGIN, ends))


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


class RudderFrame(Frame):
    """Features of all targets, the observation term `outlook`; an action is the last rudder or a neighbour of it.

    Farther from its target than `FARTHEST` leashes of `tree` an AUV returns as by `circle`: where its targets are lost,
    rewards teach nothing.

    Raises:
        PolicyError: AUVs do not turn by rudders.
    """

    any_team = True
    choices, own, each = len(SIDES), len(OWN) + len(EACH), len(EACH)
    standardised = False
    teacher = "tree"
    actions = 1

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        if "outlook" not in self.layout:
            raise PolicyError(f"training: frame = 'rudder': scenario {scenario.name!r} does not observe outlook")
        place = self.layout.slice("outlook")
        self.features = place.stop - place.start
        self.seen = Observed(self)
        self.circle = Circle("circle", self.seen, scenario.reference.circle_radius)
        self.farthest = FARTHEST * leash(scenario)  # m

    def encode(self, observation: Tensor) -> Tensor:
        return self.term(observation, "outlook").clone()

    def _headings(self, observation: Tensor) -> Tensor:
        """Courses by the choices, unit vectors, (W, K, `choices`, 2)."""
        rudders = torch.arange(-MOST, MOST + 1, device=observation.device)
        last = (self.term(observation, "outlook")[..., : 2 * MOST + 1] * rudders).sum(-1, keepdim=True)
        turn = RUDDER * (last + torch.tensor(STEPS, device=observation.device)).clamp(-MOST, MOST)
        course = unit(self.term(observation, "track")[..., 2:4])
        return rotate(components(turn.cos(), turn.sin()), course.unsqueeze(-2))

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        index = action.long().unsqueeze(-1).expand(*action.shape, 2)
        heading = self._headings(observation).gather(-2, index).squeeze(-2)
        self.seen.observation = observation
        circling, _ = self.circle.steer(observation)
        away = self.term(observation, "target").norm(dim=-1, keepdim=True) * self.scenario.area.diagonal
        heading = torch.where(away > self.farthest, circling, heading)
        return command(heading, self.scenario.auv.speed_max, self.scenario)

    def choice(self, observation: Tensor, command: Tensor) -> Tensor:
        ahead = (self._headings(observation) * command.unsqueeze(-2)).sum(-1)
        return ahead.argmax(-1, keepdim=True).to(command)


class FinsFrame(TargetFrame):
    """Features as `TargetFrame`; actions are offsets from the commands of the heuristic `helm` to fins and propeller.

    Action 0 is `helm` at the scenario's speed for `straight`.

    Raises:
        PolicyError: actions are not those of fins.
    """

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


frames: Registry[type[Frame]] = Registry("frame", PolicyError, Frame)
frames.register("guided", GuidedFrame)
frames.register("target", TargetFrame)
frames.register("world", WorldFrame)
frames.register("passing", PassingFrame)
frames.register("circling", CirclingFrame)
frames.register("rudder", RudderFrame)
frames.register("fins", FinsFrame)
COMPILED = (GuidedFrame, TargetFrame, PassingFrame)  # a frame derived from them may compute something else
