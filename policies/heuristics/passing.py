"""Collecting data in passing (`nodes.service = "passing"`): circling about a node, or going by it to the next one."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import DataLink, reference_rate
from usvauv.kernels.vehicles.definition import vehicles
from usvauv.policies.guidance import command, crab, follow_circle, unit, unrotate
from usvauv.policies.heuristics.travel import Clear
from usvauv.policies.policy import HeuristicWorld

INSIDE = 0.85  # share of the radius of service used by paths: positions and currents are uncertain
LOOKAHEAD = 0.5  # of a circle, over its radius
RADII = 200  # number of radii among which the best is chosen
LEAST_STEPS = 3.0  # mission steps in which an AUV at its lowest speed travels the least radius
FAR = 1e3  # m
BORDER = 3.0  # m, distance of a circle from the border
LEAST_GROUND = 0.2  # m/s made good, lower bound when times are computed


def turning_radius(scenario: Scenario) -> float:
    """Least radius on which the AUVs of a scenario turn, m."""
    return float(vehicles[scenario.auv.model].turning) if scenario.auv.dynamic else 0.0


def loiter_radius(site: Site) -> float:
    """Radius of the circle about a node on which data are collected fastest, m.

    On a circle of radius R the slant range is constant, and with it the rate r(√(R² + h²)), h the AUVs' height over the
    mean bed. R is at least the vehicle's turning radius and its distance in `LEAST_STEPS` mission steps at its lowest
    speed, and, if that is not less, at most ½ (ρ + `nodes.margin` − `BORDER`), ρ = `INSIDE` times the radius of
    service: then a circle inside the area is within ρ of a node at the least distance from the border. Among radii of
    equal rates it is the largest, which is reached first: over most of its range a modem's rate is at its ceiling.
    """
    s = site.scenario
    least = max(turning_radius(s), LEAST_STEPS * s.mission.step * s.auv.speed_min)
    within = INSIDE * s.service_radius
    most = max(least, min(within, 0.5 * (within + s.nodes.margin - BORDER)))
    link = DataLink.of(site)

    def rate(radius: float) -> float:
        return round(link.rate(s.nodes, math.hypot(radius, s.height_over_nodes)), 9)

    return max((least + (most - least) * n / RADII for n in range(RADII + 1)), key=lambda R: (rate(R), R))


def exit_distance(start: Tensor, direction: Tensor, centre: Tensor, radius: float) -> Tensor:
    """Distance from a point along a direction (unit vectors) out of a circle, m; 0 if the line misses it."""
    offset = centre - start
    along = (offset * direction).sum(-1)
    half = (radius**2 - offset.square().sum(-1) + along.square()).clamp_min(0.0).sqrt()
    return (along + half).clamp_min(0.0)


class Loiter(Clear):
    """Goes to a circle about its node, and circles there at the lowest speed until the data are out.

    The radius is that of `loiter_radius`, the course that of `guidance.follow_circle`; near the border the circle's
    centre lies farther inside the area than the node. The AUV keeps the centre on its present side. On the way its
    speed is that of a price of time, in range that of price 0, and it keeps clear of others as `clear` does.
    """

    reference = "loiter_price"

    def __init__(self, name: str, world: HeuristicWorld, argument: float) -> None:
        super().__init__(name, world, argument)
        site = Site(self.scenario)
        self._service, self._next = self.layout.slice("service"), self.layout.slice("next")
        self.radius, self.turn = loiter_radius(site), turning_radius(self.scenario)
        self.inside = INSIDE * self.scenario.service_radius
        self.buffer_time = self.scenario.nodes.payload / reference_rate(site)  # s, to collect a full buffer

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> float:
        if not scenario.collects_in_passing:
            raise ValueError(f"needs nodes.service = passing, which scenario {scenario.name!r} does not have")
        return super().parse(text, scenario)

    def circling(self, offset: Tensor, observation: Tensor, course: Tensor) -> Tensor:
        """Direction over ground on a tangent to the circle about a node at an offset (m), or round it, (W, K, 2)."""
        area = self.scenario.area
        here = self.position(observation) * area.diagonal
        least = self.radius + BORDER
        sides = offset.new_tensor((area.width, area.length))
        offset = torch.minimum((here + offset).clamp_min(least), (sides - least).clamp_min(0.0)) - here
        left = unrotate(offset, course)[..., 1] > 0.0
        return follow_circle(offset, self.radius, LOOKAHEAD * self.radius, torch.where(left, 1.0, -1.0))

    def reachable(self, aim: Tensor, course: Tensor) -> Tensor:
        """Direction to a place at an offset (m), or straight on while it lies inside the vehicle's turning circles.

        A vehicle that turns towards such a place circles it for ever (Dubins 1957, doi 10.2307/2372560).
        """
        along, left = unrotate(aim, course).unbind(-1)
        within = along.square() + (left.abs() - self.turn).square() < self.turn**2
        return torch.where(within.unsqueeze(-1), course, unit(aim))

    def plan(self, offset: Tensor, observation: Tensor, course: Tensor) -> tuple[Tensor, Tensor]:
        """Direction over ground (W, K, 2) and highest speed over ground (W, K) with a node at an offset, m and m/s.

        Args:
            course: present direction over ground, unit vectors (W, K, 2).
        """
        within = (observation[..., self._service][..., 0] > 0.5) | (offset.norm(dim=-1) < self.inside)
        return self.circling(offset, observation, course), torch.where(within, 0.0, math.inf).to(offset)

    def steer(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Heading (unit vectors, (W, K, 2)) and speed through the water (W, K), m/s."""
        current = self.world.current().to(observation)
        course = unit(self.world.water_velocity().to(observation) + current)
        track, most = self.plan(self.target(observation) * self.scenario.area.diagonal, observation, course)
        track = self.clear(track, observation)
        prices = torch.stack((torch.full_like(most, self.argument), torch.zeros_like(most)))
        fast, slow = self.speed_to_fly(track[None], prices, current[None]).unbind()
        along = (current * track).sum(-1)
        speed = torch.maximum(torch.minimum(fast, most - along), slow)
        return crab(track, speed, current), speed

    def act(self, observation: Tensor) -> Tensor:
        return command(*self.steer(observation), self.scenario)


class Pass(Loiter):
    """Goes by its node on the way to the next one, so fast that the data are out as it leaves the range.

    The line to the next node is bent towards this one as far as needed: with the time t for the data and the lowest
    speed V the chord in range is at least V t, so that the line passes at √(ρ² − (V t/2)²) or nearer, ρ being `INSIDE`
    times the radius of service. In range the speed is the rest of the chord divided by the rest of t, at most that of
    the price of time. While even the lowest speed is too fast, the AUV circles as `loiter` does.
    """

    reference = "pass_price"

    def plan(self, offset: Tensor, observation: Tensor, course: Tensor) -> tuple[Tensor, Tensor]:
        serving, left = observation[..., self._service].unbind(-1)
        time = left * self.buffer_time + self.scenario.mission.step * (2.0 - serving)
        within = offset.norm(dim=-1) < self.inside
        after = self.following(offset, observation, torch.where(within.unsqueeze(-1), course, unit(offset)))
        slowest = self.scenario.auv.speed_min
        share = ((offset * after).sum(-1) / after.square().sum(-1).clamp_min(1e-6)).clamp(0.0, 1.0).unsqueeze(-1)
        aside = share * after - offset
        farthest = (self.inside**2 - (0.5 * slowest * time).square()).clamp_min(0.0).sqrt().unsqueeze(-1)
        via = offset + aside * (farthest / aside.norm(dim=-1, keepdim=True).clamp_min(1e-6)).clamp(max=1.0)
        near = max(0.5 * self.turn, 2.0 * slowest * self.scenario.mission.step)
        passed = within & ((share[..., 0] <= 0.0) | (via.norm(dim=-1) < near))
        via = torch.where(passed.unsqueeze(-1), 0.0, via)
        chord = via.norm(dim=-1) + exit_distance(via, unit(after - via), offset, self.inside)
        aim = torch.where(passed.unsqueeze(-1), after, via)
        direction = self.reachable(aim, course)
        drift = (self.world.current().to(direction) * direction).sum(-1)
        short = within & (chord < (slowest + drift).clamp_min(LEAST_GROUND) * time)
        most = torch.where(within, torch.where(short, 0.0, chord / time), math.inf)
        return torch.where(short.unsqueeze(-1), self.circling(offset, observation, course), direction), most

    def following(self, offset: Tensor, observation: Tensor, on: Tensor) -> Tensor:
        """Offset of the node after the target, m; if unknown, through the target in the direction `on`."""
        step = observation[..., self._next] * self.scenario.area.diagonal
        return torch.where(step.norm(dim=-1, keepdim=True) > 0.0, offset + step, offset + FAR * on)
