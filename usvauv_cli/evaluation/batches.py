"""The episodes of an evaluation, batch after batch, each with all combinations, so that pairs are complete."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from usvauv.cli.evaluation.comparison import Comparison
from usvauv.env.record.evaluation import MakePolicy, evaluate_batch
from usvauv.env.record.growing_table import Combination, GrowingTable
from usvauv.env.record.trace import Trace
from usvauv.env.scenario import Scenario
from usvauv.env.world.world import World


@dataclass(frozen=True)
class Plan:
    """What is run.

    Attributes:
        scenarios: of each combination; they differ in their target rules.
        policies: by name.
        episodes: of each combination, at most.
        seed, arch: as `World` takes them.
    """

    scenarios: Mapping[Combination, Scenario]
    policies: Mapping[str, MakePolicy]
    episodes: int
    seed: int
    arch: str


def run(
    plan: Plan,
    size: int,
    table: GrowingTable,
    comparison: Comparison,
    enough: Callable[[], bool],
    on_step: Callable[[int], None],
    on_trace: Callable[[Trace, int], None],
) -> None:
    """Run what the table does not have yet.

    Args:
        plan: what is run.
        size: worlds of a batch.
        table: gets the rows.
        comparison: gets them when a batch is complete in all combinations.
        enough: asked then whether to end.
        on_step: called with the number of worlds that made a step, or had made it in an earlier process.
        on_trace: called with the trace of a batch and the number of its first episode.
    """
    before = 0

    def step(worlds: int) -> None:
        nonlocal before
        on_step(before + worlds)
        before = 0

    for first in range(0, plan.episodes, size):
        count = min(size, plan.episodes - first)
        batch = {}
        for which, scenario in plan.scenarios.items():
            taken = table.take(which, first, count)
            if taken is None:
                world = World(scenario, count, plan.seed, which.usv, first_world=first, arch=plan.arch)
                make = plan.policies[which.policy]
                rows = [row.columns() for row in evaluate_batch(world, first, which.policy, make, step, on_trace)]
                table.append(which, rows)
                batch[which] = rows
            else:
                before += count * scenario.mission.steps
                batch[which] = taken
        comparison.add(batch)
        if enough():
            return
