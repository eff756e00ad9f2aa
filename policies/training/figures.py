"""Figures of a training run: gathered while it runs, found by an evaluation, written for TensorBoard."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from usvauv.env.record.metrics import EpisodeMetrics, episode_metrics, mean_figures
from usvauv.env.record.recorder import record
from usvauv.env.storage.files import writing
from usvauv.env.world.world import World
from usvauv.policies.learned import LearnedPolicy
from usvauv.policies.loading import acting
from usvauv.policies.training.exploration import TrainingWorld
from usvauv.policies.training.ranks import ALONE, Ranks


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


EVALUATION_EPISODES = 32
EVALUATION_SEED_OFFSET = 1_000_003  # evaluation worlds are never those trained in


def figures_of_merit(
    worlds: World, policy: str | Path | LearnedPolicy, on_step: Callable[[int], None] = lambda done: None
) -> dict[str, float]:
    """Mean of every figure over the episodes of `evaluated`."""
    return mean_figures(evaluated(worlds, policy, on_step))


def evaluated(
    worlds: World, policy: str | Path | LearnedPolicy, on_step: Callable[[int], None] = lambda done: None
) -> list[EpisodeMetrics]:
    """Figures of the first episode of each of `worlds`, the same episode in every call.

    Args:
        policy: a name as `load` takes it, or a learned policy for the worlds' scenario.
        on_step: called with the number of steps done.
    """
    learned = isinstance(policy, LearnedPolicy)
    act, name = (policy.act, policy.name) if learned else (acting(policy, worlds), str(policy))
    worlds.rewind()
    return episode_metrics(record(worlds, act, name, on_step=on_step))


AXES = ("steps", "total", "seconds", "eta", "evaluated_at")  # figures that are no curves of their own


@contextmanager
def scalar_writer(directory: Path, first_step: int) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """A function that writes the figures of a step; what is in the directory from `first_step` on is discarded.

    Raises:
        OutputError: the directory cannot be written.
    """
    from torch.utils.tensorboard import SummaryWriter  # takes a second to import

    with writing(directory), SummaryWriter(directory, purge_step=first_step) as writer:

        def write(figures: Mapping[str, Any]) -> None:
            for name, value in figures.items():
                if isinstance(value, Mapping):
                    for part, number in value.items():
                        writer.add_scalar(f"{name}/{part}", number, figures["steps"])
                elif name not in AXES:
                    writer.add_scalar(f"run/{name}", value, figures["steps"])

        yield write
