"""Collecting data in passing (`nodes.service = "passing"`): circling about a node, or going by it to the next one."""

from __future__ import annotations

import math
import threading
from typing import ClassVar

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import DataLink, reference_rate
from usvauv.kernels.guidance import courses
from usvauv.kernels.guidance.acting import Guiding, Steering
from usvauv.kernels.guidance.lanes import Start
from usvauv.kernels.guidance.passing import BORDER, loiter, passing
from usvauv.kernels.vehicles.definition import vehicles
from usvauv.policies.guidance import command, components, unit
from usvauv.policies.heuristics import heuristics
from usvauv.policies.heuristics.travel import Clear
from usvauv.policies.policy import HeuristicWorld
from usvauv.policies.steering import Rules, steering

INSIDE = 0.85  # share of the radius of service used by paths: positions and currents are uncertain
RADII = 200  # number of radii among which the best is chosen
LEAST_STEPS = 3.0  # mission steps in which an AUV at its lowest speed travels the least radius


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


class _Workspace(threading.local):
    """The kernel of a heuristic and its memory, separate in each thread.

    Attributes:
        worlds: for which it is made.
    """

    guide: Guiding | None = None
    worlds: int = 0


class Loiter(Clear):
    """Goes to a circle about its node, and circles there at the lowest speed until the data are out.

    The radius is that of `loiter_radius`, the course that of `guidance.follow_circle`; near the border the circle's
    centre lies farther inside the area than the node. The AUV keeps the centre on its present side. On the way its
    speed is that of a price of time, in range that of price 0, and it keeps clear of others as `clear` does.
    """

    reference = "loiter_price"
    start: ClassVar[Start] = Start.LOITER

    def __init__(self, name: str, world: HeuristicWorld, argument: float) -> None:
        super().__init__(name, world, argument)
        s, site = self.scenario, Site(self.scenario)
        turning, slowest = turning_radius(s), s.auv.speed_min
        self.task = (  # as in `Task` of `usvauv.kernels.guidance.passing`
            s.area.width,
            s.area.length,
            loiter_radius(site),
            INSIDE * s.service_radius,
            turning,
            max(0.5 * turning, 2.0 * slowest * s.mission.step),
            slowest,
            s.mission.step,
            s.nodes.payload / reference_rate(site),
        )
        self._own = _Workspace()

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> float:
        if not scenario.collects_in_passing:
            raise ValueError(f"needs nodes.service = passing, which scenario {scenario.name!r} does not have")
        return super().parse(text, scenario)

    def steering(self, rules: Rules = ()) -> Steering | None:
        """What its kernels need, with rules of features; None where there are none."""
        speeds = self.speed_to_fly.speeds, self.speed_to_fly.power
        return steering(self.scenario, self.start, self.argument, speeds, self.task, rules)

    def vector(self, observation: Tensor, term: str) -> tuple[Tensor, ...]:
        """Components (W, K) of a term of the observation, m."""
        return (observation[..., self.layout.slice(term)] * self.scenario.area.diagonal).unbind(-1)

    def plan(self, observation: Tensor, course: Tensor, current: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
        """Direction over ground and highest speed over ground, m/s; numbers (W, K).

        Args:
            course: present direction over ground, unit vectors (W, K, 2).
            current: at the AUVs, (W, K, 2), m/s.
        """
        here, offset = self.vector(observation, "position"), self.vector(observation, "target")
        serving, _ = observation[..., self.layout.slice("service")].unbind(-1)
        return loiter(here, offset, course.unbind(-1), serving, self.task)

    def steer(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Heading (unit vectors, (W, K, 2)) and speed through the water (W, K), m/s."""
        current = self.world.current().to(observation)
        course = unit(self.world.water_velocity().to(observation) + current)
        wanted, most = self.plan(observation, course, current)
        track = self.clear(components(*wanted), observation).unbind(-1)
        along, across = courses.unrotate(current.unbind(-1), track)
        prices = torch.stack((torch.full_like(most, self.argument), torch.zeros_like(most)))
        fast, slow = self.speed_to_fly.best(prices, along[None], across[None]).unbind()
        speed = torch.maximum(torch.minimum(fast, most - along), slow)
        return components(*courses.crab(track, speed, across)), speed

    def act(self, observation: Tensor) -> Tensor:
        own, worlds = self._own, len(observation)
        if own.worlds != worlds:
            made = self.steering()
            own.guide, own.worlds = made and Guiding(made, worlds), worlds
        if own.guide:
            return own.guide(observation, self.world.current(), self.world.water_velocity())
        return command(*self.steer(observation), self.scenario)


class Pass(Loiter):
    """Goes by its node on the way to the next one, so fast that the data are out as it leaves the range.

    The line to the next node is bent towards this one as far as needed: with the time t for the data and the lowest
    speed V the chord in range is at least V t, so that the line passes at √(ρ² − (V t/2)²) or nearer, ρ being `INSIDE`
    times the radius of service. In range the speed is the rest of the chord divided by the rest of t, at most that of
    the price of time. While even the lowest speed is too fast, the AUV circles as `loiter` does.
    """

    reference = "pass_price"
    start = Start.PASS

    def plan(self, observation: Tensor, course: Tensor, current: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
        here, offset = self.vector(observation, "position"), self.vector(observation, "target")
        following, service = self.vector(observation, "next"), observation[..., self.layout.slice("service")]
        return passing(here, offset, following, course.unbind(-1), current.unbind(-1), *service.unbind(-1), self.task)


heuristics.register("loiter", Loiter)
heuristics.register("pass", Pass)
