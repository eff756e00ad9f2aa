"""Figures of merit of policies in the same seeded worlds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from torch import Tensor

from kernels.errors import UserError
from usvauv_env.record.metrics import EpisodeMetrics, episode_metrics
from usvauv_env.record.recorder import record
from usvauv_env.record.trace import Trace
from usvauv_env.scenario import Scenario
from usvauv_env.world.world import World

WORLDS_PER_BATCH = 128

Act = Callable[[Tensor], Tensor]


class Actor(Protocol):
    """What acts: observations (W, K, O) → actions (W, K, 2) in [−1, 1]."""

    def act(self, observation: Tensor, /) -> Tensor:
        """Actions for observations."""
        ...


MakePolicy = Callable[[World], Actor | Act]


def evaluate(
    scenario: Scenario | str | Path,
    policies: Mapping[str, MakePolicy],
    *,
    episodes: int = 20,
    seed: int = 0,
    usv: str | None = None,
    targets: str | None = None,
    arch: str = "auto",
    on_step: Callable[[int], None] = lambda world_steps: None,
    on_batch: Callable[[list[EpisodeMetrics]], None] = lambda rows: None,
    on_trace: Callable[[Trace, int], None] = lambda trace, first: None,
) -> list[EpisodeMetrics]:
    """Run each policy on the same seeded worlds; one row for each policy and episode, in this order.

    Episode e of every policy takes place in world e of the seed, so rows of the same episode are paired. Worlds are
    stepped in batches of `WORLDS_PER_BATCH`, which changes no figure.

    Args:
        scenario: a scenario, or what `Scenario.load` takes.
        policies: name in the rows → class or function that takes the world and gives something with `act`, or a
            function: observations (W, K, O) → actions (W, K, 2) in [−1, 1]. Called anew for each batch.
        episodes: of each policy, at least 1.
        seed, usv, targets, arch: as `World` takes them.
        on_step: called after each step with the number of worlds that made it.
        on_batch: called with the rows of each batch when its episodes are complete.
        on_trace: called before that with the batch's trace and the number of its first episode.

    Raises:
        UserError: `episodes` is below 1, or what `Scenario.load`, `World` and `record` raise.
    """
    if episodes < 1:
        raise UserError(f"episodes = {episodes}: must be at least 1")
    scenario = Scenario.of(scenario)
    rows = []
    for name, make in policies.items():
        for first in range(0, episodes, WORLDS_PER_BATCH):
            worlds = min(WORLDS_PER_BATCH, episodes - first)
            world = World(scenario, worlds, seed, usv, targets, first_world=first, arch=arch)
            trace = record(world, act_of(make(world)), name, on_step=lambda _, n=worlds: on_step(n))
            batch = episode_metrics(trace, first)
            on_trace(trace, first)
            on_batch(batch)
            rows += batch
    return rows


def act_of(policy: Any) -> Act:
    """The method `act` of an object that has it; a function itself."""
    return getattr(policy, "act", policy)
