"""Guidance towards a point, along a line, round a circle: courses, headings in a current, economical speeds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels.errors import UserError
from usvauv.kernels.guidance import courses
from usvauv.kernels.guidance.courses import LEAST
from usvauv.kernels.mission.auvs.motion import travelling_power
from usvauv.kernels.vehicles.fleet import Fleet
from usvauv.kernels.vehicles.vehicle import Actuators, Command

LEVEL_TIME = 1.0  # s
SPEEDS = 33  # number of speeds among which `SpeedToFly` chooses
REACH = 1.5  # safe distances within which the nearest other AUV repels


def components(x: Tensor, y: Tensor) -> Tensor:
    """Vectors (..., 2) of components (...), which lie apart in memory, so that operations go over many at once."""
    return torch.stack((x, y)).movedim(0, -1)


def length(vector: Tensor) -> Tensor:
    """Euclidean norm (...) of vectors (..., 2)."""
    x, y = vector.unbind(-1)
    return torch.sqrt(x * x + y * y)


def polar(vector: Tensor) -> tuple[Tensor, Tensor]:
    """Direction (..., 2) and length (...) of vectors (..., 2); (1, 0) and `LEAST` for a zero vector."""
    direction, size = courses.direction(vector.unbind(-1))
    return components(*direction), size


def angle(vector: Tensor) -> Tensor:
    """Angle (...) of vectors (..., 2) from the x axis to the left, from −π to π; 0 of a zero vector.

    Torch's `atan2` gives other bits in the last few numbers of a tensor than in those before.
    """
    x, y = vector.unbind(-1)
    x = x + LEAST
    half_plane = torch.atan(y / x)
    return torch.where(x < 0.0, half_plane + torch.copysign(torch.full_like(y, math.pi), y), half_plane)


def unit(vector: Tensor) -> Tensor:
    """Direction of vectors (..., 2); (1, 0) for a zero vector."""
    return polar(vector)[0]


def turn(direction: Tensor, cosine: Tensor, sine: Tensor) -> Tensor:
    """Vectors (..., 2) turned to the left by an angle of this cosine and sine, (...)."""
    return components(*courses.turn(direction.unbind(-1), cosine, sine))


def rotate(vector: Tensor, direction: Tensor) -> Tensor:
    """Components in world axes of a vector given along and left of `direction`; both (..., 2)."""
    return turn(direction, *vector.unbind(-1))


def along_and_left(vector: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
    """Components (...) along and left of `direction` of a vector given in world axes; both (..., 2)."""
    return courses.unrotate(vector.unbind(-1), direction.unbind(-1))


def unrotate(vector: Tensor, direction: Tensor) -> Tensor:
    """Components along and left of `direction`, as vectors (..., 2), of a vector given in world axes."""
    return components(*along_and_left(vector, direction))


def nearest(distance: Tensor, vectors: Tensor) -> tuple[Tensor, Tensor]:
    """The least of distances (..., n), and the vector (..., 2) of the first AUV that has it, of (..., n, 2)."""
    if distance.shape[-1] == 1:
        return distance[..., 0], vectors[..., 0, :]
    first = distance.argmin(-1)[..., None, None].expand(*vectors.shape[:-2], 1, vectors.shape[-1])
    return distance.amin(-1), vectors.gather(-2, first)[..., 0, :]  # `take_along_dim` would fix N in an export


def cruise_depth(scenario: Scenario) -> float:
    """The action that commands the cruise depth, linear from −1 at the least depth to 1 at the greatest."""
    auv = scenario.auv
    share = 2.0 * (auv.depth - auv.depth_min) / (auv.depth_max - auv.depth_min) - 1.0
    return min(max(share, -1.0), 1.0)


def command(direction: Tensor, speed: Tensor | float, scenario: Scenario) -> Tensor:
    """The world's action for a course (unit vector, (..., 2)) and a speed through the water (..., m/s).

    Its shape is (..., 2), or (..., 3) with the cruise depth if actions include a depth.

    Raises:
        UserError: actions are those of fins.
    """
    auv = scenario.auv
    if auv.action == "fins":
        raise UserError('auv.action = "fins": this policy commands course and speed: use "vector" or "vector-depth"')
    each = speed if isinstance(speed, Tensor) else torch.full_like(direction[..., 0], speed)
    velocity = (direction * (each / auv.speed_max)[..., None]).clip(-1.0, 1.0)
    if auv.action == "vector":
        return velocity
    return torch.cat((velocity, torch.full_like(velocity[..., :1], cruise_depth(scenario))), -1)


def crab(track: Tensor, speed: Tensor, current: Tensor) -> Tensor:
    """Heading (unit vector, (..., 2)) whose track over ground is `track` (unit vector), at a speed (...) in a current.

    The angle between heading and track has the sine −c_⊥ / V, where c_⊥ is the component of the current across the
    track and V the speed. A component above V cannot be compensated; the heading is then opposite to it.
    """
    return components(*courses.crab(track.unbind(-1), speed, along_and_left(current, track)[1]))


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
    directions, distances = polar(others)
    distance, direction = nearest(distances, directions)
    return components(*courses.repelled(towards.unbind(-1), direction.unbind(-1), distance, REACH * safe_distance))


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
        lead: distance travelled before the vehicle has turned, m; the track is computed that far ahead.
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
        lead: distance travelled before the vehicle has turned, m; without it a slow one stays outside the circle.
    """
    track, bend = courses.round_circle(to_centre.unbind(-1), radius, lookahead, turn)
    return turned(components(*track), lead, bend)


def level_power(scenario: Scenario, speeds: Sequence[float]) -> list[float]:
    """Power of an AUV that travels straight and level at speeds through the water (m/s), W.

    For a point its power law; for a vehicle with dynamics its mean over `LEVEL_TIME`, trimmed, in still water.
    """
    auv = scenario.auv
    if not auv.dynamic:
        return [travelling_power(auv, speed) for speed in speeds]
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
    (speed to fly). If no speed makes headway, V is the one that loses least ground.
    """

    def __init__(self, scenario: Scenario) -> None:
        auv = scenario.auv
        self.speeds = torch.linspace(auv.speed_min, auv.speed_max, SPEEDS, dtype=torch.float32, device="cpu")
        power = level_power(scenario, self.speeds.tolist())
        self.power = torch.tensor(power, dtype=torch.float32, device="cpu")

    def free_price(self) -> float:
        """Highest price of time for which the lowest speed is optimal in still water, W; 0 if it is the only one."""
        lowest, higher = self.speeds[:2].tolist()
        power_lowest, power_higher = self.power[:2].tolist()
        if higher == lowest:
            return 0.0
        return max((power_higher * lowest - power_lowest * higher) / (higher - lowest), 0.0)

    def __call__(self, track: Tensor, price: Tensor, current: Tensor) -> Tensor:
        """Speeds (...), m/s, for tracks (unit vectors, (..., 2)), prices (...), W, and currents (..., 2), m/s."""
        return self.best(price, *along_and_left(current, track))

    def steer(self, track: Tensor, price: Tensor, current: Tensor) -> tuple[Tensor, Tensor]:
        """Headings of `crab` (unit vectors, (..., 2)) and the speeds."""
        along, across = along_and_left(current, track)
        speed = self.best(price, along, across)
        return components(*courses.crab(track.unbind(-1), speed, across)), speed

    def best(self, price: Tensor, along: Tensor, across: Tensor) -> Tensor:
        """Speeds (...), m/s, by the components of the current along and across the track, (...), m/s."""
        self.speeds, self.power = self.speeds.to(along), self.power.to(along)  # copied only once
        speeds, power = (table.reshape(-1, *along.ndim * [1]) for table in (self.speeds, self.power))
        cost = courses.cost_of_way(power, price, courses.advance(speeds, along, across))
        return torch.where(cost > cost.amin(0), math.inf, speeds).amin(0)  # of equal costs the lowest speed
