"""Figures of merit: those of a policy in the worlds of an evaluation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from usvauv.env.record.metrics import EpisodeMetrics, episode_metrics, mean_figures
from usvauv.env.record.recorder import record
from usvauv.env.world.world import World
from usvauv.policies.learned import LearnedPolicy
from usvauv.policies.loading import acting

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
        policy: a name as for `load`, or a learned policy for the worlds' scenario.
        on_step: called with the number of steps done.
    """
    learned = isinstance(policy, LearnedPolicy)
    act, name = (policy.act, policy.name) if learned else (acting(policy, worlds), str(policy))
    worlds.rewind()
    return episode_metrics(record(worlds, act, name, on_step=on_step))
