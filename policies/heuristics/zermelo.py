"""The quickest path through a current that is known everywhere: a reference with perfect knowledge."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from usvauv.env.world.world import World
from usvauv.kernels.planning import zermelo
from usvauv.policies.guidance import command, unit
from usvauv.policies.heuristics.travel import Crab

RENEWAL = 10.0  # s between two solutions of Zermelo's problem for the same target
SPACING = 4.0  # m, of the grid on which it is solved
LEAST_CELLS = 16  # along a side of a small area
MARGIN = 1.0  # m between the grid and the border, where a move may be refused
SAME_GOAL = 0.1  # m, largest shift of a target that counts as the same one


class Zermelo(Crab):
    """Follows the quickest path at one speed through the water, given the whole current: a reference.

    It uses the present current everywhere in the area, without the storm (Zermelo's problem, see
    `usvauv.kernels.planning.zermelo`). The path is solved for when the target changes and every `RENEWAL` seconds.
    Where no path exists it acts as `crab`.
    """

    reference = "zermelo_speed"

    def __init__(self, name: str, world: World, argument: float) -> None:
        super().__init__(name, world, argument)
        area = self.scenario.area
        columns, rows = (max(LEAST_CELLS, math.ceil(side / SPACING)) + 1 for side in (area.width, area.length))
        team = (world.num_worlds, world.num_auvs)
        alike: Any = {"dtype": torch.float32, "device": world.device}

        def zeros(*shape: int) -> Tensor:
            return torch.zeros(shape, **alike)

        self.flow = zeros(world.num_worlds, rows, columns, 2)
        self.cost, self.velocity = zeros(*team, rows, columns), zeros(*team, 2)
        self.goal, self.age = zeros(*team, 2), torch.full(team, math.inf, **alike)
        self.speeds, self.rates = torch.tensor([argument], **alike), torch.ones(1, **alike)

    def act(self, observation: Tensor) -> Tensor:
        auv, area, world = self.scenario.auv, self.scenario.area, self.world
        position = area.diagonal * self.position(observation) - MARGIN
        offset = area.diagonal * self.target(observation)
        goal = position + offset
        new = (goal - self.goal).norm(dim=-1) > SAME_GOAL
        self.age = torch.where(new, math.inf, self.age + self.scenario.mission.step)
        due = (self.age >= RENEWAL) & (offset.norm(dim=-1) > auv.hover_radius)
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
