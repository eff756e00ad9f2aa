"""Figures of merit of policies in the same seeded worlds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from usvauv.env.record.metrics import EpisodeMetrics, episode_metrics
from usvauv.env.record.recorder import EACH, check_room, record, trace_bytes
from usvauv.env.record.trace import Trace
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.storage import memory
from usvauv.env.world.world import World
from usvauv.kernels.errors import UserError

WORLDS_PER_BATCH = 128  # at most

Act = Callable[[Tensor], Tensor]


class Actor(Protocol):
    """An object that acts: observations (W, K, O) → actions (W, K, 2) in [−1, 1]."""

    def act(self, observation: Tensor, /) -> Tensor:
        """Actions for observations."""
        ...


MakePolicy = Callable[[World], Actor | Act]


def run_episodes(
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
    """Run each policy on the same seeded worlds; returns one row for each policy and episode, in this order.

    Episode e of every policy takes place in world e of the seed, so rows of the same episode are paired. Worlds are
    stepped in batches, see `batch_size`.

    Args:
        scenario: a scenario, or an argument of `Scenario.load`.
        policies: name in the rows → class or function that takes the world and returns an object with `act`, or a
            function: observations (W, K, O) → actions (W, K, 2) in [−1, 1]. Called anew for each batch.
        episodes: per policy, at least 1.
        seed, usv, targets, arch: as for `World`.
        on_step: called after each step with the number of worlds stepped.
        on_batch: called with the rows of each batch when its episodes are complete.
        on_trace: called before that with the batch's trace and the number of its first episode.

    Raises:
        UserError: `episodes` is below 1; also errors of `Scenario.load`, `World` and `record`.
    """
    scenario = Scenario.of(scenario).with_targets(targets)
    rows, size = [], batch_size(scenario, episodes)
    for name, make in policies.items():
        for first in range(0, episodes, size):
            worlds = World(scenario, min(size, episodes - first), seed, usv, first_world=first, arch=arch)
            batch = evaluate_batch(worlds, first, name, make, on_step, on_trace)
            on_batch(batch)
            rows += batch
    return rows


def batch_size(scenario: Scenario, episodes: int) -> int:
    """Number of worlds that are stepped together: `WORLDS_PER_BATCH`, halved until their records fit into memory.

    The batch changes no episode, unless a policy of your own acts otherwise in another one, see `docs/extending.md`.

    Raises:
        UserError: `episodes` is below 1.
        MemoryNeeded: the record of one does not.
    """
    if episodes < 1:
        raise UserError(f"episodes = {episodes}: must be at least 1")
    size, steps = min(WORLDS_PER_BATCH, episodes), scenario.mission.steps
    check_room(scenario, 1, steps)
    shared, free = EACH * steps, memory.SHARE * memory.available()
    one = trace_bytes(scenario, 1, steps) - shared
    while size > 1 and shared + size * one > free:
        size = (size + 1) // 2
    return size


def evaluate_batch(
    worlds: World,
    first: int,
    name: str,
    make: MakePolicy,
    on_step: Callable[[int], None] = lambda world_steps: None,
    on_trace: Callable[[Trace, int], None] = lambda trace, first: None,
) -> list[EpisodeMetrics]:
    """Rows of a policy in one episode of some worlds, the first of which has number `first`; see `run_episodes`.

    Raises:
        UserError: as `record`.
    """
    count = worlds.num_worlds
    trace = record(worlds, act_of(make(worlds)), name, on_step=lambda _: on_step(count))
    rows = episode_metrics(trace, first)
    on_trace(trace, first)
    return rows


def act_of(policy: Any) -> Act:
    """The method `act` of an object that has one; a function itself. Arrays of NumPy that it returns become tensors."""
    act = getattr(policy, "act", policy)

    def in_tensors(observation: Tensor) -> Tensor:
        action = act(observation)
        if isinstance(action, np.ndarray):
            action = torch.as_tensor(action, dtype=torch.float32, device=observation.device)
        return action

    return in_tensors if callable(act) else act
