"""Travelling to the target clear of the nearest other AUV."""

from __future__ import annotations

from torch import Tensor

from policies.guidance import TINY, unit
from policies.heuristics.pace import Pace
from usvauv_env.world.world import World

REACH = 1.5  # safe distances


class Clear(Pace):
    """As `pace`, on a track over ground that the nearest other AUV repels.

    The track is the direction of t + (r − 1) r² n with r = ρ₀/ρ, where t points at the target, n away from the nearest
    other AUV at the distance ρ < ρ₀, and ρ₀ = `REACH` safe distances; beyond ρ₀ it is t. The second term is the
    negative gradient of Khatib's artificial potential ½ η (1/ρ − 1/ρ₀)² with η = ρ₀³ (doi 10.1177/027836498600500106).
    The terms are of equal size at ρ = 0.68 ρ₀, just above the safe distance. Positions are the estimated ones.
    """

    reference = "clear_price"

    def __init__(self, name: str, world: World, argument: float) -> None:
        super().__init__(name, world, argument)
        self._others = self.layout.slice("others")

    def track(self, observation: Tensor) -> Tensor:
        towards = super().track(observation)
        if self.scenario.auv.count == 1:
            return towards
        others = observation[..., self._others].unflatten(-1, (-1, 2)) * self.scenario.area.diagonal
        distance, nearest = others.norm(dim=-1, keepdim=True).min(-2, keepdim=True)
        away = -unit(others.gather(-2, nearest.expand_as(others[..., :1, :]))).squeeze(-2)
        ratio = REACH * self.scenario.auv.safe_distance / distance.squeeze(-2).clamp_min(TINY)
        return unit(towards + (ratio - 1.0).clamp_min(0.0) * ratio.square() * away)
