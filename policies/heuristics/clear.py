"""Travelling to the target clear of the nearest other AUV."""

from __future__ import annotations

from torch import Tensor

from usvauv.env.world.world import World
from usvauv.policies.guidance import clear_of_others
from usvauv.policies.heuristics.pace import Pace


class Clear(Pace):
    """As `pace`, on a track over ground that the nearest other AUV repels, see `guidance.clear_of_others`.

    Positions are the estimated ones.
    """

    reference = "clear_price"

    def __init__(self, name: str, world: World, argument: float) -> None:
        super().__init__(name, world, argument)
        self._others = self.layout.slice("others")

    def track(self, observation: Tensor) -> Tensor:
        scenario = self.scenario
        others = observation[..., self._others].unflatten(-1, (scenario.auv.count - 1, 2)) * scenario.area.diagonal
        return clear_of_others(super().track(observation), others, scenario.auv.safe_distance)
