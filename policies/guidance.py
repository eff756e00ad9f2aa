"""Guidance towards a point, along a line, round a circle: courses, headings in a current, economical speeds.

Most functions take tensors, or arrays of NumPy, of which an operation on a few AUVs takes a fraction of the time. Both
give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels.mission.motion import travelling_power
from usvauv.kernels.vehicles.fleet import Fleet
from usvauv.kernels.vehicles.vehicle import Actuators, Command
from usvauv.policies.policy import PolicyError

TINY = 1e-9
LEAST = 1e-18  # added to no effect, but that a zero vector has a direction; its square is above zero
LEVEL_TIME = 1.0  # s
SPEEDS = 33  # number of speeds among which `SpeedToFly` chooses
LEAST_ADVANCE = 0.05  # m/s over ground, lower bound on headway
REACH = 1.5  # safe distances within which the nearest other AUV repels
NEAREST = 1e-3  # m, smaller distances between AUVs repel like it
HOPELESS = 1e6  # J/m, above every cost with headway

Array = TypeVar("Array", Tensor, np.ndarray)


def functions(array: Tensor | np.ndarray) -> Any:
    """The module whose functions take such an array: torch or NumPy."""
    return torch if isinstance(array, Tensor) else np


def by_torch(function: Callable[..., Tensor], *arrays: Array) -> Array:
    """A function of which NumPy has other last bits, such as exp and √, as torch has it."""
    if isinstance(arrays[0], Tensor):
        return function(*arrays)
    return function(*map(torch.from_numpy, arrays)).numpy()


def as_kind(array: Tensor | np.ndarray, *tensors: Tensor) -> tuple[Any, ...]:
    """Tensors on the device of `array` as arrays of its kind."""
    return tensors if isinstance(array, Tensor) else tuple(tensor.numpy() for tensor in tensors)


def of_components(vector: Array) -> tuple[Array, Array]:
    """The components (...) of vectors (..., 2)."""
    x, y = vector.unbind(-1) if isinstance(vector, Tensor) else (vector[..., 0], vector[..., 1])
    return x, y


def components(x: Array, y: Array) -> Array:
    """Vectors (..., 2) of components (...), which lie apart in memory, so that operations go over many at once."""
    pair: Any = x, y
    if isinstance(x, Tensor):
        return torch.stack(pair).movedim(0, -1)
    vector = np.empty((2, *x.shape), x.dtype)
    vector[0], vector[1] = pair
    return vector.transpose(*range(1, vector.ndim), 0)


def length(vector: Array) -> Array:
    """Euclidean norm (...) of vectors (..., 2)."""
    x, y = of_components(vector)
    return by_torch(torch.sqrt, x * x + y * y)


def polar(vector: Array) -> tuple[Array, Array]:
    """Direction (..., 2) and length (...) of vectors (..., 2); (1, 0) and `LEAST` for a zero vector."""
    x, y = of_components(vector)
    x = x + LEAST
    size = by_torch(torch.sqrt, x * x + y * y)
    return components(x / size, y / size), size


def unit(vector: Array) -> Array:
    """Direction of vectors (..., 2); (1, 0) for a zero vector."""
    return polar(vector)[0]


def turn(direction: Array, cosine: Array, sine: Array) -> Array:
    """Vectors (..., 2) turned to the left by an angle of this cosine and sine, (...)."""
    x, y = of_components(direction)
    return components(cosine * x - sine * y, cosine * y + sine * x)


def rotate(vector: Array, direction: Array) -> Array:
    """Components in world axes of a vector given along and left of `direction`; both (..., 2)."""
    return turn(direction, *of_components(vector))


def along_and_left(vector: Array, direction: Array) -> tuple[Array, Array]:
    """Components (...) along and left of `direction` of a vector given in world axes; both (..., 2)."""
    vx, vy = of_components(vector)
    x, y = of_components(direction)
    return vx * x + vy * y, vy * x - vx * y


def unrotate(vector: Array, direction: Array) -> Array:
    """`along_and_left` as vectors (..., 2)."""
    return components(*along_and_left(vector, direction))


def nearest(distance: Array, vectors: Array) -> tuple[Array, Array]:
    """The least of distances (..., n), and the vector (..., 2) of the first AUV that has it, of (..., n, 2)."""
    if distance.shape[-1] == 1:
        return distance[..., 0], vectors[..., 0, :]
    take: Any = torch.take_along_dim if isinstance(distance, Tensor) else np.take_along_axis
    first = distance.argmin(-1)[..., None, None]
    return functions(distance).amin(distance, -1), take(vectors, first, -2)[..., 0, :]


def command(direction: Array, speed: Array | float, scenario: Scenario) -> Array:
    """The world's action for a course (unit vector, (..., 2)) and a speed through the water (..., m/s).

    (..., 2), or where actions have a depth too (..., 3) with the cruise depth.

    Raises:
        PolicyError: actions are those of fins.
    """
    auv, of = scenario.auv, functions(direction)
    if auv.action == "fins":
        raise PolicyError('auv.action = "fins": this policy commands course and speed: use "vector" or "vector-depth"')
    each: Any = speed if isinstance(speed, Tensor | np.ndarray) else of.full_like(direction[..., 0], speed)
    if auv.action != "polar":
        velocity = (direction * (each / auv.speed_max)[..., None]).clip(-1.0, 1.0)
        if auv.action == "vector":
            return velocity
        share = 2.0 * (auv.depth - auv.depth_min) / (auv.depth_max - auv.depth_min) - 1.0
        depth = of.full_like(velocity[..., :1], min(max(share, -1.0), 1.0))
        return of.concatenate((velocity, depth), -1)
    span = auv.speed_max - auv.speed_min
    throttle = 2.0 * (each - auv.speed_min) / span - 1.0 if span > 0 else of.zeros_like(each)
    x, y = of_components(direction)
    heading = by_torch(torch.atan2, y, x) / math.pi
    return components(heading, of.broadcast_to(throttle, heading.shape)).clip(-1.0, 1.0)


def crab(track: Array, speed: Array, current: Array) -> Array:
    """Heading (unit vector, (..., 2)) whose track over ground is `track` (unit vector), at a speed (...) in a current.

    The angle between heading and track has the sine −c_⊥ / V, where c_⊥ is the component of the current across the
    track and V the speed. A component above V cannot be compensated; the heading is then opposite to it.
    """
    return _crab(track, speed, along_and_left(current, track)[1])


def _crab(track: Array, speed: Array, across: Array) -> Array:
    """The same by the component of the current across the track, (...)."""
    sine = (-across / speed).clip(-1.0, 1.0)
    return turn(track, by_torch(torch.sqrt, (1.0 - sine * sine).clip(0.0)), sine)


def clear_of_others(towards: Array, others: Array, safe_distance: float) -> Array:
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
    directions, distances = polar(others)
    distance, direction = nearest(distances, directions)
    ratio = (1.0 / distance.clip(NEAREST)) * (REACH * safe_distance)
    return unit(towards - ((ratio - 1.0).clip(0.0) * (ratio * ratio))[..., None] * direction)


def turned(track: Tensor, lead: float, curvature: Tensor) -> Tensor:
    """A track as it is `lead` metres further on a path with this curvature (..., 1/m, positive to the left)."""
    angle = lead * curvature
    return turn(track, angle.cos(), angle.sin())


def follow_line(to_point: Tensor, direction: Tensor, lookahead: float, lead: float = 0.0) -> Tensor:
    """Track over ground (unit vectors, (..., 2)) along a straight line, by line of sight with a lookahead distance.

    Towards the point on the line that lies Δ ahead of the AUV's projection: the angle to the line is −atan(e/Δ), where
    e is the cross-track error. Where the track is kept, e = e₀ exp(−x/Δ) over the way x along the line, at any speed
    (Breivik and Fossen 2009, "Guidance laws for autonomous underwater vehicles", doi 10.5772/6696). In a current the
    heading is `crab(track, speed, current)`, so that no error stays.

    Args:
        to_point: from the AUV to any point of the line, (..., 2), m.
        direction: of the line, unit vectors (..., 2).
        lookahead: Δ, m. Below the vehicle's turning radius it swings about the line.
        lead: metres that the vehicle goes on before it has turned; the track is that of so much later.
    """
    error = -unrotate(to_point, direction)[..., 1] / lookahead
    ahead = components(torch.ones_like(error), -error)
    course = unit(ahead)
    bend = course[..., 0].square() * -course[..., 1] / lookahead
    return turned(rotate(course, direction), lead, bend)


def follow_circle(
    to_centre: Tensor, radius: float, lookahead: float, turn: Tensor | float = 1.0, lead: float = 0.0
) -> Tensor:
    """Track over ground (unit vectors, (..., 2)) towards a circle and round it.

    The tangent turned towards the circle by atan((d − R)/Δ), where d is the distance from the centre: line of sight on
    the tangent, and the orbit's vector field of Nelson et al. (2007), doi 10.1109/TRO.2007.898976. Where the track is
    kept, (d − R)/d = C exp(−R φ/Δ) over the angle φ gone round, so that it tends to R from inside and from outside.

    Args:
        to_centre: from the AUV to the centre, (..., 2), m.
        radius: R, m; above the vehicle's turning radius.
        lookahead: Δ, m.
        turn: 1 anticlockwise, −1 clockwise, (...).
        lead: metres that the vehicle goes on before it has turned; without it a slow one flies outside the circle.
    """
    distance = to_centre.norm(dim=-1)
    turn = torch.as_tensor(turn, dtype=to_centre.dtype, device=to_centre.device)
    inward = unit(to_centre)
    outside = (distance - radius) / lookahead
    course = unit(components(outside, -turn.expand_as(outside)))  # along and left of the way to the centre
    cosine, sine = -turn * course[..., 1], course[..., 0]
    bend = turn * (cosine / distance.clamp_min(0.5 * radius) - cosine.square() * sine / lookahead)
    return turned(rotate(course, inward), lead, bend)


def level_power(scenario: Scenario, speeds: Sequence[float]) -> list[float]:
    """Power of an AUV that travels straight and level at speeds through the water (m/s), W.

    Of a point its law; of a vehicle with dynamics what it takes in `LEVEL_TIME`, trimmed, in still water.
    """
    auv = scenario.auv
    if not auv.dynamic:
        return [travelling_power(speed) for speed in speeds]
    fleet = Fleet(len(speeds), auv.model, dict(getattr(scenario, auv.model, ())))
    fleet.set(Command, speed=speeds, depth=auv.depth)
    fleet.trim()
    fleet.set(Actuators, propeller=fleet.numpy("propeller"))
    steps = round(LEVEL_TIME / fleet.substep)
    fleet.flight(steps)()
    return (fleet.numpy("energy") / (steps * fleet.substep)).tolist()


class SpeedToFly:
    """The speed through the water of least cost per metre over ground when time has a price.

    V = argmin (P(V) + λ) / (√(V² − c_⊥²) + c_∥) for a power P, a price of time λ and a current with components c_∥
    along and c_⊥ across the track: faster against the current, slower with it. In gliding this is MacCready's rule
    (speed to fly). Where no speed makes headway it is the one that loses least ground.
    """

    def __init__(self, scenario: Scenario) -> None:
        auv = scenario.auv
        self.speeds = torch.linspace(auv.speed_min, auv.speed_max, SPEEDS)
        self.power = torch.tensor(level_power(scenario, self.speeds.tolist()))

    def free_price(self) -> float:
        """Highest price of time for which the lowest speed is optimal in still water, W; 0 if it is the only one."""
        lowest, higher = self.speeds[:2].tolist()
        power_lowest, power_higher = self.power[:2].tolist()
        if higher == lowest:
            return 0.0
        return max((power_higher * lowest - power_lowest * higher) / (higher - lowest), 0.0)

    def __call__(self, track: Array, price: Array, current: Array) -> Array:
        """Speeds (...), m/s, for tracks (unit vectors, (..., 2)), prices (...), W, and currents (..., 2), m/s."""
        return self._best(price, *along_and_left(current, track))

    def steer(self, track: Array, price: Array, current: Array) -> tuple[Array, Array]:
        """Headings of `crab` (unit vectors, (..., 2)) and the speeds."""
        along, across = along_and_left(current, track)
        speed = self._best(price, along, across)
        return _crab(track, speed, across), speed

    def _best(self, price: Array, along: Array, across: Array) -> Array:
        """Speeds (...) by the components of the current along and across the track, (...)."""
        of, like = functions(along), (SPEEDS, *along.ndim * [1])
        if isinstance(along, Tensor):
            self.speeds, self.power = self.speeds.to(along), self.power.to(along)  # copied but once
        speeds, power = (table.reshape(like) for table in as_kind(along, self.speeds, self.power))
        advance = by_torch(torch.sqrt, (speeds * speeds - across * across).clip(0.0))
        advance += along
        cost = (power + price) / advance.clip(LEAST_ADVANCE)
        cost = of.where(advance > LEAST_ADVANCE, cost, HOPELESS - advance)
        return of.amin(of.where(cost > of.amin(cost, 0), math.inf, speeds), 0)  # of equal costs the lowest speed
