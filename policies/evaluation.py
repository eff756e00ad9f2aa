"""How well a policy does while it is being learned."""

from __future__ import annotations

from collections.abc import Callable

from policies.policy import Policy
from usvauv_env import World
from usvauv_env.record.metrics import episode_metrics, mean_figures
from usvauv_env.record.recorder import record

EVALUATION_EPISODES = 32
EVALUATION_SEED_OFFSET = 1_000_003  # evaluation worlds are never those trained in


def judge(worlds: World, policy: Policy, on_step: Callable[[int], None] = lambda done: None) -> dict[str, float]:
    """Mean of every figure over the first episode of all `worlds`, the same episode in every call."""
    policy.attach(worlds)
    worlds.rewind()
    return mean_figures(episode_metrics(record(worlds, policy.act, policy.name, on_step=on_step)))
