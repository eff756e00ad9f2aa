"""Frames: features of an observation for a network, and the world's action for what the network answers.

The world's observation and action are in world axes, in which a network has to learn every heading separately. In the
target's frame x′ points from the AUV to its target and y′ to the left of it, and an action is a course relative to that
bearing and a speed, so that "straight to the target" is a constant. The bearing and the own position stay among the
features, so no information is lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from kernels.registry import Registry
from policies.guidance import TINY, SpeedToFly, command, crab, rotate, unit, unrotate
from policies.policy import PolicyError
from usvauv_env.scenario import Scenario
from usvauv_env.world.observation import ObservationLayout

ACTION_SIZE = 2
BORDER_MARGIN = 4.0  # m, more than a step at full speed
PRICE, PRICE_GAIN = 30.0, 4.0  # W and 1: prices from half a watt to above a kilowatt, for all speeds in any current


@dataclass(frozen=True)
class Layout:
    """Where things are in the observation of one AUV of a team of K (positions are over the area's diagonal).

    | index       | quantity                                                                     |
    |-------------|------------------------------------------------------------------------------|
    | 0 … 2K−3    | dx, dy to each other AUV, in order of their index                            |
    | 2K−2, 2K−1  | dx, dy to the target                                                         |
    | 2K, 2K+1    | own x, y                                                                     |
    | 2K+2        | 1 if the last move was refused at the border                                 |
    | 2K+3        | share of nodes that overflow                                                 |
    | from 2K+4   | nothing; or the current's speed; or its speed, x and y component; or these   |
    |             | and x, y components at the points of the current profile, m/s                |
    """

    num_auvs: int
    current: int

    @classmethod
    def of(cls, scenario: Scenario) -> Layout:
        return cls(scenario.auv.count, ObservationLayout.of(scenario).size - 2 * scenario.auv.count - 4)

    @property
    def size(self) -> int:
        return 2 * self.num_auvs + 4 + self.current

    @property
    def has_velocity(self) -> bool:
        """Whether the current's components at the AUV are observed."""
        return self.current >= 3

    def others(self, observation: Tensor) -> Tensor:
        """(..., K − 1, 2)"""
        return observation[..., : 2 * (self.num_auvs - 1)].unflatten(-1, (self.num_auvs - 1, 2))

    def target(self, observation: Tensor) -> Tensor:
        """(..., 2)"""
        return observation[..., 2 * self.num_auvs - 2 : 2 * self.num_auvs]

    def position(self, observation: Tensor) -> Tensor:
        """The AUV's own, (..., 2)"""
        return observation[..., 2 * self.num_auvs : 2 * self.num_auvs + 2]

    def velocity(self, observation: Tensor) -> Tensor:
        """Of the water at the AUV, (..., 2), m/s; zero where its components are not observed."""
        if not self.has_velocity:
            return torch.zeros_like(self.target(observation))
        first = 2 * self.num_auvs + 5
        return observation[..., first : first + 2]


class Frame:
    """What stands between the world and a network.

    Attributes:
        any_team: whether the number of features is the same for any number of AUVs.
        features: F, number of features of one AUV.
    """

    any_team: ClassVar[bool] = False
    features: int

    def __init__(self, scenario: Scenario):
        self.scenario = scenario
        self.layout = Layout.of(scenario)

    def encode(self, observation: Tensor) -> Tensor:
        """Features (W, K, F) of observations (W, K, O)."""
        raise NotImplementedError

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        """The world's actions (W, K, 2) for a network's actions (W, K, 2) in [−1, 1]."""
        raise NotImplementedError


class WorldFrame(Frame):
    """Features are the observation, actions the world's."""

    def __init__(self, scenario: Scenario):
        super().__init__(scenario)
        self.features = self.layout.size

    def encode(self, observation: Tensor) -> Tensor:
        return observation.clone()

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        return action


class TargetFrame(Frame):
    """Features and actions relative to the bearing of the target.

    Features (all positions over the area's diagonal, c = current / top speed):
    distance to the target and its closeness, bearing (cos, sin), nearest other AUV (x′, y′), sum over the others of
    closeness times direction (x′, y′), largest closeness, own x and y, border flag, share overflowing, then nothing |
    ‖c‖ | ‖c‖, c′_x, c′_y | these and c′_x, c′_y at each point of the current profile. Closeness of a distance d is
    exp(−d / (2 safe distances)). The number of features does not depend on the number of AUVs.

    Actions: a_0 is the course, π a_0 left of the target's bearing; a_1 the speed, linear from the lowest at −1 to the
    highest at 1.
    """

    any_team = True

    def __init__(self, scenario: Scenario):
        super().__init__(scenario)
        self.features = 13 + self.layout.current
        self.reach = max(2.0 * scenario.auv.safe_distance, 1.0) / scenario.area.diagonal

    def encode(self, observation: Tensor) -> Tensor:
        layout = self.layout
        target = layout.target(observation)
        bearing = unit(target)
        distance = target.norm(dim=-1, keepdim=True)
        parts = [distance, torch.exp(-distance / self.reach), bearing, self._others(observation, bearing)]
        rest = observation[..., 2 * layout.num_auvs :]
        parts.append(rest[..., :4])
        if layout.current:
            current = rest[..., 4:] / self.scenario.auv.speed_max
            parts.append(current[..., :1])
            if layout.has_velocity:
                arrows = current[..., 1:].unflatten(-1, (-1, 2))
                parts.append(unrotate(arrows, bearing.unsqueeze(-2)).flatten(-2))
        return torch.cat(parts, -1)

    def _others(self, observation: Tensor, bearing: Tensor) -> Tensor:
        """Nearest other AUV and sum of closeness, (..., 5); zeros for a single AUV."""
        if self.layout.num_auvs == 1:
            return observation.new_zeros((*observation.shape[:-1], 5))
        others = unrotate(self.layout.others(observation), bearing.unsqueeze(-2))
        distance = others.norm(dim=-1, keepdim=True)
        nearest = others.gather(-2, distance.argmin(-2, keepdim=True).expand_as(others[..., :1, :])).squeeze(-2)
        closeness = torch.exp(-distance / self.reach)
        crowding = (closeness * others / distance.clamp_min(TINY)).sum(-2)
        return torch.cat((nearest, crowding, closeness.amax(-2)), -1)

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        auv = self.scenario.auv
        speed = auv.speed_min + (auv.speed_max - auv.speed_min) * (action[..., 1] + 1.0) / 2.0
        return command(self._course(observation, action), speed, self.scenario)

    def _course(self, observation: Tensor, action: Tensor) -> Tensor:
        """The course that a_0 commands, a unit vector in world axes, (..., 2)."""
        course = math.pi * action[..., 0]
        relative = torch.stack((torch.cos(course), torch.sin(course)), -1)
        return rotate(relative, unit(self.layout.target(observation)))


class GuidedFrame(TargetFrame):
    """Features as `TargetFrame`; actions go through an autopilot that knows the current at the AUV.

    a_0 is the course over ground, π a_0 left of the target's bearing, held against the current by `crab`; a_1 the price
    of time, `PRICE` e^(4 a_1) W, from which `SpeedToFly` gives the speed through the water. A constant action is then a
    sensible controller in any current; what remains to be learned is collision avoidance and the choice of the route.
    Where the current's components are not observed, still water is assumed. There the lowest speed is optimal for all
    low prices, so a_1 = 0 stands for the highest of these; around a lower one exploration would not change the speed.
    Within `BORDER_MARGIN` of the border a course that leads out is turned along it.
    """

    def __init__(self, scenario: Scenario):
        super().__init__(scenario)
        self.speed_to_fly = SpeedToFly(scenario)
        self.price = PRICE if self.layout.has_velocity else self.speed_to_fly.free_price()

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        track = self._clear_of_border(observation, self._course(observation, action))
        current = self.layout.velocity(observation)
        speed = self.speed_to_fly(track, self.price * torch.exp(PRICE_GAIN * action[..., 1]), current)
        return command(crab(track, speed, current), speed, self.scenario)

    def _clear_of_border(self, observation: Tensor, track: Tensor) -> Tensor:
        """A course over ground (unit vectors, (..., 2)) that does not lead out of the area."""
        area = self.scenario.area
        position = self.layout.position(observation) * area.diagonal
        side = torch.tensor([area.width, area.length], dtype=position.dtype, device=position.device)
        outwards = ((position < BORDER_MARGIN) & (track < 0.0)) | ((position > side - BORDER_MARGIN) & (track > 0.0))
        along = torch.where(outwards, 0.0, track)
        return torch.where(along.norm(dim=-1, keepdim=True) > TINY, unit(along), track)


FRAMES: Registry[type[Frame]] = Registry("frame", PolicyError)
FRAMES.register("guided", GuidedFrame)
FRAMES.register("target", TargetFrame)
FRAMES.register("world", WorldFrame)
