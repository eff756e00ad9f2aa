"""Figures of a training run, gathered over a window of steps."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from usvauv.policies.training.ranks import ALONE, Ranks
from usvauv.policies.training.world import TrainingWorld


class Meter:
    """Sums rewards and measures of the worlds, on their device, and gives the figures that reports show.

    `services`, `sdr` and `border` are scaled to one episode of one world.
    """

    def __init__(self, world: TrainingWorld) -> None:
        self.world = world
        self.reset()

    def reset(self) -> None:
        """Begin a new window."""
        device = self.world.device
        self.terms = torch.zeros(len(self.world.reward_names), dtype=torch.float64, device=device)
        self.measures = torch.zeros(len(self.world.measure_names), dtype=torch.float64, device=device)
        self.services = torch.zeros((), dtype=torch.int64, device=device)
        self.rows = 0
        self.losses: list[dict[str, Tensor]] = []

    def add(self, info: dict[str, Tensor]) -> None:
        """Count one step of all worlds."""
        measures = info["measures"]
        self.terms += info["reward_terms"].sum((0, 1))
        self.measures += measures.sum((0, 1))
        self.services += (measures[..., self.world.measure_names.index("service_rate")] > 0).sum()
        self.rows += 1

    def figures(self, ranks: Ranks = ALONE) -> dict[str, Any]:
        """Means over the window, and over the worlds of all ranks: arps, sdr, ec, services, border, position_error;
        "reward", each term for a step and summed over AUVs; "learner", each figure of the updates.
        """
        world = self.world
        worlds = torch.tensor(world.num_worlds, dtype=torch.float64, device=world.device)
        terms, measures, services, worlds = ranks.mean((self.terms, self.measures, self.services.double(), worlds), 1.0)
        world_steps = max(self.rows, 1) * int(worlds)
        episodes = world_steps / world.steps
        auv_steps = world_steps * world.num_auvs
        terms = (terms / world_steps).tolist()
        sums = dict(zip(world.measure_names, measures.tolist(), strict=True))
        names = self.losses[0] if self.losses else ()
        losses = [torch.stack([loss[name] for loss in self.losses]).mean() for name in names]
        losses = ranks.mean(losses, world.num_worlds / int(worlds)) if losses else losses
        return {
            "arps": sum(terms),
            "sdr": sums["service_rate"] / episodes,
            "ec": sums["power"] / max(auv_steps - sums["hovering"], 1.0),
            "services": int(services) / episodes,
            "border": sums["border"] / episodes,
            "position_error": sums["position_error"] / auv_steps,
            "reward": dict(zip(world.reward_names, terms, strict=True)),
            "learner": dict(zip(names, map(float, losses), strict=True)),
        }
