"""Guidance towards a point: headings in a current, economical speeds, and the world's commands."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels.mission.motion import travelling_power

TINY = 1e-9
SPEEDS = 33  # number of speeds among which `SpeedToFly` chooses
LEAST_ADVANCE = 0.05  # m/s over ground, lower bound on headway
REACH = 1.5  # safe distances within which the nearest other AUV repels
NEAREST = 1e-3  # m, smaller distances between AUVs repel like it
HOPELESS = 1e6  # J/m, above every cost with headway


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


def crab(track: Tensor, speed: Tensor, current: Tensor) -> Tensor:
    """Heading (unit vector, (..., 2)) whose track over ground is `track` (unit vector), at a speed (...) in a current.

    The angle between heading and track has the sine −c_⊥ / V, where c_⊥ is the component of the current across the
    track and V the speed. A component above V cannot be compensated; the heading is then opposite to it.
    """
    sine = (-unrotate(current, track)[..., 1] / speed).clamp(-1.0, 1.0)
    return rotate(torch.stack(((1.0 - sine.square()).clamp_min(0.0).sqrt(), sine), -1), track)


def clear_of_others(towards: Tensor, others: Tensor, safe_distance: float) -> Tensor:
    """Track over ground (unit vectors, (..., 2)) towards a target, repelled by the nearest other AUV.

    The direction of t + (r − 1) r² n with r = ρ₀/ρ, where t points at the target, n away from the nearest other AUV at
    the distance ρ < ρ₀, and ρ₀ = `REACH` safe distances; beyond ρ₀ it is t. The second term is the negative gradient of
    Khatib's artificial potential ½ η (1/ρ − 1/ρ₀)² with η = ρ₀³ (doi 10.1177/027836498600500106). The terms have the
    same size at ρ = 0.68 ρ₀, just above the safe distance.

    Args:
        towards: t, unit vectors (..., 2).
        others: offsets of the other AUVs, (..., K − 1, 2), m; there may be none.
        safe_distance: m.
    """
    if others.shape[-2] == 0:
        return towards
    distance, nearest = others.norm(dim=-1, keepdim=True).min(-2, keepdim=True)
    away = -unit(others.gather(-2, nearest.expand_as(others[..., :1, :]))).squeeze(-2)
    ratio = REACH * safe_distance / distance.squeeze(-2).clamp_min(NEAREST)
    return unit(towards + (ratio - 1.0).clamp_min(0.0) * ratio.square() * away)


class SpeedToFly:
    """The speed through the water of least cost per metre over ground when time has a price.

    V = argmin (P(V) + λ) / (√(V² − c_⊥²) + c_∥) for a power P, a price of time λ and a current with components c_∥
    along and c_⊥ across the track: faster against the current, slower with it. In gliding this is MacCready's rule
    (speed to fly). Where no speed makes headway it is the one that loses least ground.
    """

    def __init__(self, scenario: Scenario) -> None:
        auv = scenario.auv
        self.speeds = torch.linspace(auv.speed_min, auv.speed_max, SPEEDS)
        self.power = torch.tensor([travelling_power(speed) for speed in self.speeds.tolist()])

    def free_price(self) -> float:
        """Highest price of time for which the lowest speed is optimal in still water, W; 0 if it is the only one."""
        lowest, higher = self.speeds[:2].tolist()
        power_lowest, power_higher = self.power[:2].tolist()
        if higher == lowest:
            return 0.0
        return max((power_higher * lowest - power_lowest * higher) / (higher - lowest), 0.0)

    def __call__(self, track: Tensor, price: Tensor, current: Tensor) -> Tensor:
        """Speeds (...), m/s, for tracks (unit vectors, (..., 2)), prices (...), W, and currents (..., 2), m/s."""
        speeds, power = self.speeds, self.power = self.speeds.to(track), self.power.to(track)  # copied but once
        along, across = unrotate(current, track).split(1, -1)
        advance = (speeds.square() - across.square()).clamp_min(0.0).sqrt() + along
        cost = (power + price.unsqueeze(-1)) / advance.clamp_min(LEAST_ADVANCE)
        return speeds[torch.where(advance > LEAST_ADVANCE, cost, HOPELESS - advance).argmin(-1)]
