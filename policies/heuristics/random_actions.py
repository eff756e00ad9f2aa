"""Random actions, the same in every run and batch."""

from __future__ import annotations

import torch
from torch import Tensor

from usvauv.env.world.world import World
from usvauv.policies.heuristics import heuristics
from usvauv.policies.policy import Heuristic

SEED = 0


class Random(Heuristic):
    """Uniform actions, drawn anew in every step: the lower end of every comparison.

    The n-th action is the same in every run. The draw is a hash of (seed, step, index of the world, AUV, component), so
    it is the same in any batch.
    """

    def __init__(self, name: str, world: World, argument: None = None) -> None:
        super().__init__(name, world, argument)
        self.actions = world.action_size
        self.first = world.num_auvs * self.actions * torch.from_numpy(world.seeds.index).to(world.device)
        self.step = 0

    def act(self, observation: Tensor) -> Tensor:
        worlds, auvs = observation.shape[:2]
        within = torch.arange(auvs * self.actions, device=observation.device)
        index = self.first[:, None] + within + (self.step << 32)
        self.step += 1
        bits = mix(mix(index) ^ mix(torch.full_like(index, SEED)))
        uniform = (bits >> 40 & 0xFFFFFF).float() / 2.0**24
        return (2.0 * uniform - 1.0).view(worlds, auvs, self.actions)


def mix(x: Tensor) -> Tensor:
    """SplitMix64's finaliser on int64, whose products wrap (Steele, Lea, Flood 2014, doi 10.1145/2660193.2660195)."""
    x = x + signed(0x9E3779B97F4A7C15)
    x = (x ^ (x >> 30 & (1 << 34) - 1)) * signed(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> 27 & (1 << 37) - 1)) * signed(0x94D049BB133111EB)
    return x ^ (x >> 31 & (1 << 33) - 1)


def signed(constant: int) -> int:
    """Two's complement of a 64-bit constant, for torch's int64."""
    return constant - (1 << 64) if constant >= 1 << 63 else constant


heuristics.register("random", Random)
