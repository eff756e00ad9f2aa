"""How a learned policy sees an observation and commands an action.

The world's observation and action are in world axes. A network that reads and answers in them has to learn every
heading separately. In the target's frame, x′ points from the AUV to its target, y′ to the left of it, and the action is
a course relative to that bearing and a speed; "straight to the target" is then a constant, whatever the bearing.
Nothing is lost: the bearing itself and the own position stay among the features.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from usvauv_env.scenario import Scenario

ACTION_SIZE = 2
CURRENT_COMPONENTS = {"none": 0, "speed": 1, "vector": 3}
TINY = 1e-9


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
    | from 2K+4   | nothing; or the current's speed; or its speed, x and y component, m/s        |
    """

    num_auvs: int
    current: int

    @classmethod
    def of(cls, scenario: Scenario) -> Layout:
        return cls(scenario.auv.count, CURRENT_COMPONENTS[scenario.observation.current])

    @property
    def size(self) -> int:
        return 2 * self.num_auvs + 4 + self.current

    def others(self, observation: Tensor) -> Tensor:
        """(..., K − 1, 2)"""
        return observation[..., : 2 * (self.num_auvs - 1)].unflatten(-1, (self.num_auvs - 1, 2))

    def target(self, observation: Tensor) -> Tensor:
        """(..., 2)"""
        return observation[..., 2 * self.num_auvs - 2 : 2 * self.num_auvs]


def unit(vector: Tensor) -> Tensor:
    """Direction of vectors (..., 2); (1, 0) for a zero vector."""
    length = vector.norm(dim=-1, keepdim=True)
    east = torch.zeros_like(vector)
    east[..., 0] = 1.0
    return torch.where(length > TINY, vector / length.clamp_min(TINY), east)


def rotate(vector: Tensor, direction: Tensor) -> Tensor:
    """Components in world axes of a vector given along and left of `direction`; both (..., 2)."""
    along, left = vector.unbind(-1)
    x, y = direction.unbind(-1)
    return torch.stack((along * x - left * y, along * y + left * x), -1)


def unrotate(vector: Tensor, direction: Tensor) -> Tensor:
    """Components along and left of `direction` of a vector given in world axes; both (..., 2)."""
    vx, vy = vector.unbind(-1)
    x, y = direction.unbind(-1)
    return torch.stack((vx * x + vy * y, vy * x - vx * y), -1)


def command(direction: Tensor, speed: Tensor | float, scenario: Scenario) -> Tensor:
    """The world's action (..., 2) for a course (unit vector, (..., 2)) and a speed through the water (..., m/s)."""
    auv = scenario.auv
    speed = torch.as_tensor(speed, dtype=direction.dtype, device=direction.device)
    if auv.action == "vector":
        return (direction * (speed / auv.speed_max).unsqueeze(-1)).clamp(-1.0, 1.0)
    span = auv.speed_max - auv.speed_min
    throttle = 2.0 * (speed - auv.speed_min) / span - 1.0 if span > 0 else torch.zeros_like(speed)
    heading = torch.atan2(direction[..., 1], direction[..., 0]) / math.pi
    return torch.stack((heading, throttle.expand_as(heading)), -1).clamp(-1.0, 1.0)


class WorldFrame:
    """Features are the observation as it is, actions are the world's."""

    name = "world"

    def __init__(self, scenario: Scenario):
        self.features = Layout.of(scenario).size

    def encode(self, observation: Tensor) -> Tensor:
        return observation.clone()

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        return action


class TargetFrame:
    """Features and actions about the bearing of the target.

    Features (all positions over the area's diagonal, c = current / top speed):
    distance to the target and its closeness, bearing (cos, sin), nearest other AUV (x′, y′), sum over the others of
    closeness times direction (x′, y′), largest closeness, own x and y, border flag, share overflowing, then nothing |
    ‖c‖ | ‖c‖, c′_x, c′_y. Closeness of a distance d is exp(−d / (2 safe distances)). The number of features does not
    depend on the number of AUVs.

    Actions: a_0 is the course, π a_0 left of the target's bearing; a_1 the speed, linear from the lowest at −1 to the
    highest at 1.
    """

    name = "target"

    def __init__(self, scenario: Scenario):
        self.layout = Layout.of(scenario)
        self.scenario = scenario
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
            if layout.current == 3:
                parts.append(unrotate(current[..., 1:], bearing))
        return torch.cat(parts, -1)

    def _others(self, observation: Tensor, bearing: Tensor) -> Tensor:
        """Nearest other AUV and sum of closeness, (..., 5); zeros for a single AUV."""
        if self.layout.num_auvs == 1:
            return observation.new_zeros((*observation.shape[:-1], 5))
        others = unrotate(self.layout.others(observation), bearing.unsqueeze(-2))
        distance = others.norm(dim=-1, keepdim=True)
        nearest = torch.take_along_dim(others, distance.argmin(-2, keepdim=True), -2).squeeze(-2)
        closeness = torch.exp(-distance / self.reach)
        crowding = (closeness * others / distance.clamp_min(TINY)).sum(-2)
        return torch.cat((nearest, crowding, closeness.amax(-2)), -1)

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        auv = self.scenario.auv
        course = math.pi * action[..., 0]
        relative = torch.stack((torch.cos(course), torch.sin(course)), -1)
        speed = auv.speed_min + (auv.speed_max - auv.speed_min) * (action[..., 1] + 1.0) / 2.0
        return command(rotate(relative, unit(self.layout.target(observation))), speed, self.scenario)


FRAMES = {frame.name: frame for frame in (TargetFrame, WorldFrame)}
