"""Policies without learning: the yardsticks a learned one has to beat."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from kernels.planning import zermelo
from policies.frames import Layout
from policies.guidance import SpeedToFly, command, crab, unit
from policies.policy import Policy, PolicyError
from usvauv_env.scenario import Scenario

RENEWAL = 10.0  # s, after which Zermelo's problem is solved anew
SPACING = 4.0  # m, of the grid on which it is solved
LEAST_CELLS = 16  # along a side of a small area
MARGIN = 1.0  # m, that it keeps from the border, where a move may be refused
SAME_GOAL = 0.1  # m, within which a target is the one it was


class ConstantSpeed(Policy):
    """A heuristic that travels at one speed through the water."""

    reference: str

    def __init__(self, name: str, scenario: Scenario, speed: float | None):
        super().__init__(name, scenario)
        auv = scenario.auv
        self.speed = getattr(scenario.reference, self.reference) if speed is None else speed
        if not auv.speed_min <= self.speed <= auv.speed_max:
            raise PolicyError(
                f"policy {name}: speed must lie between {auv.speed_min:g} and {auv.speed_max:g} m/s in "
                f"scenario {scenario.name!r}"
            )

    def bearing(self, observation: Tensor) -> Tensor:
        """Unit vector towards the measured target, (W, K, 2)."""
        return unit(Layout.of(self.scenario).target(observation))


class Straight(ConstantSpeed):
    """Heads for the target through the water."""

    reference = "straight_speed"

    def act(self, observation: Tensor) -> Tensor:
        return command(self.bearing(observation), self.speed, self.scenario)


class Crab(ConstantSpeed):
    """Heads so that the track over ground points at the target, see `guidance.crab`."""

    reference = "crab_speed"

    def attach(self, world) -> None:
        self.world = world

    def act(self, observation: Tensor) -> Tensor:
        bearing = self.bearing(observation)
        heading = crab(bearing, torch.full_like(bearing[..., 0], self.speed), self.world.current().to(bearing))
        return command(heading, self.speed, self.scenario)


class Pace(Policy):
    """As `crab`, but at the speed through the water that `guidance.SpeedToFly` makes of a price of time."""

    def __init__(self, name: str, scenario: Scenario, price: float | None):
        super().__init__(name, scenario)
        self.price = scenario.reference.pace_price if price is None else price
        if not (math.isfinite(self.price) and self.price >= 0.0):
            raise PolicyError(f"policy {name}: the price of time must be at least 0 W")
        self.speed_to_fly = SpeedToFly(scenario)

    def attach(self, world) -> None:
        self.world = world

    def act(self, observation: Tensor) -> Tensor:
        track = unit(Layout.of(self.scenario).target(observation))
        current = self.world.current().to(track)
        speed = self.speed_to_fly(track, torch.full_like(track[..., 0], self.price), current)
        return command(crab(track, speed, current), speed, self.scenario)


class Zermelo(Crab):
    """The way through the true current that takes the least time at one speed through the water: a limit.

    It knows the current everywhere in the area, as it is at the moment, but for the storm (Zermelo's problem, see
    `kernels.planning.zermelo`). The way is found anew when the target changes and every `RENEWAL` seconds. Where there
    is none it does as `crab`.
    """

    reference = "zermelo_speed"

    def attach(self, world) -> None:
        super().attach(world)
        area = self.scenario.area
        columns, rows = (max(LEAST_CELLS, math.ceil(side / SPACING)) + 1 for side in (area.width, area.length))
        team = (world.num_worlds, world.num_auvs)

        def zeros(*shape: int) -> Tensor:
            return torch.zeros(shape, device=world.device)

        self.flow = zeros(world.num_worlds, rows, columns, 2)
        self.cost, self.velocity = zeros(*team, rows, columns), zeros(*team, 2)
        self.goal, self.age = zeros(*team, 2), torch.full(team, math.inf, device=world.device)
        self.speeds, self.rates = torch.tensor([self.speed], device=world.device), torch.ones(1, device=world.device)

    def act(self, observation: Tensor) -> Tensor:
        auv, area, world = self.scenario.auv, self.scenario.area, self.world
        position = area.diagonal * observation[..., 2 * auv.count : 2 * auv.count + 2] - MARGIN
        away = area.diagonal * Layout.of(self.scenario).target(observation)
        goal = position + away
        new = (goal - self.goal).norm(dim=-1) > SAME_GOAL
        self.age = torch.where(new, math.inf, self.age + self.scenario.mission.step)
        due = (self.age >= RENEWAL) & (away.norm(dim=-1) > auv.hover_radius)
        circle = {"size": (area.width - 2 * MARGIN, area.length - 2 * MARGIN), "radius": auv.hover_radius}
        if due.any():
            self.age[due] = 0.0
            self.goal[due] = goal[due]
            world.current_field(self.flow, due.any(1), MARGIN)
            zermelo.solve(self.flow, self.goal, due.byte(), self.speeds, self.rates, self.cost, **circle)
        current = world.current().contiguous()
        zermelo.steer(self.flow, goal, position, current, self.speeds, self.rates, self.cost, self.velocity, **circle)
        speed = self.velocity.norm(dim=-1)
        course = command(unit(self.velocity), speed, self.scenario)
        return torch.where(speed.unsqueeze(-1) > 0.0, course, super().act(observation))


class Keep(Policy):
    """Goes to its target and stays there: the velocity over ground that would reach it in one step, as fast as it may.

    For the task station-keeping; it knows the current at the AUV and the place that was measured.
    """

    def attach(self, world) -> None:
        self.world = world

    def act(self, observation: Tensor) -> Tensor:
        auv, step = self.scenario.auv, self.scenario.mission.step
        away = Layout.of(self.scenario).target(observation) * self.scenario.area.diagonal
        velocity = away / step - self.world.current().to(observation)
        speed = velocity.norm(dim=-1).clamp(auv.speed_min, auv.speed_max)
        return command(unit(velocity), speed, self.scenario)


class Random(Policy):
    """Uniform actions, drawn anew in every step; the n-th step after `attach` is a function of the seed alone.

    The draw is a hash of (seed, step, world, AUV, component), so it is the same for any number of worlds.
    """

    def __init__(self, name: str, scenario: Scenario, seed: int = 0):
        super().__init__(name, scenario)
        self.seed = seed
        self.step = 0

    def attach(self, world) -> None:
        self.step = 0

    def act(self, observation: Tensor) -> Tensor:
        worlds, auvs = observation.shape[:2]
        index = torch.arange(worlds * auvs * 2, device=observation.device) + (self.step << 32)
        self.step += 1
        bits = mix(mix(index) ^ mix(torch.full_like(index, self.seed)))
        uniform = (bits >> 40 & 0xFFFFFF).float() / 2.0**24
        return (2.0 * uniform - 1.0).view(worlds, auvs, 2)


def mix(x: Tensor) -> Tensor:
    """SplitMix64's finaliser on int64, whose products wrap (Steele, Lea, Flood 2014, doi 10.1145/2660193.2660195)."""
    x = x + signed(0x9E3779B97F4A7C15)
    x = (x ^ (x >> 30 & (1 << 34) - 1)) * signed(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> 27 & (1 << 37) - 1)) * signed(0x94D049BB133111EB)
    return x ^ (x >> 31 & (1 << 33) - 1)


def signed(constant: int) -> int:
    """The two's complement of a 64-bit constant, as torch's int64 wants it."""
    return constant - (1 << 64) if constant >= 1 << 63 else constant
