"""Holding a station, for the task station-keeping."""

from __future__ import annotations

from torch import Tensor

from usvauv.policies.guidance import command, unit
from usvauv.policies.heuristics.heuristic import Heuristic


class Keep(Heuristic):
    """Commands the velocity over ground that reaches the target in one step, within the limits of speed.

    It knows the current at the AUV and the measured position.
    """

    def act(self, observation: Tensor) -> Tensor:
        auv, step = self.scenario.auv, self.scenario.mission.step
        offset = self.target(observation) * self.scenario.area.diagonal
        velocity = offset / step - self.world.current().to(observation)
        speed = velocity.norm(dim=-1).clamp(auv.speed_min, auv.speed_max)
        return command(unit(velocity), speed, self.scenario)
