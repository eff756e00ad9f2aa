"""The episodes of an evaluation, batch after batch with all combinations, and what decides their results."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import metadata
from itertools import product
from pathlib import Path
from typing import Any

from usvauv.cli.evaluation.comparison import Comparison
from usvauv.env import plugins
from usvauv.env.record.evaluation import MakePolicy, evaluate_batch
from usvauv.env.record.trace import Trace
from usvauv.env.scenario import Scenario
from usvauv.env.storage import text_files
from usvauv.env.storage.tables import Combination, GrowingTable
from usvauv.env.world.boat_strategies import StrategyChoice
from usvauv.env.world.world import World
from usvauv.kernels import runtime
from usvauv.policies.loading import source
from usvauv.policies.policy import PolicyError


def combinations(
    scenario: Scenario, policies: Sequence[str], usv: Sequence[str | None], targets: Sequence[str | None]
) -> dict[Combination, Scenario]:
    """Each policy with each boat strategy and target rule, and the scenario with that rule; None: the scenario's.

    Raises:
        ScenarioError: an unknown strategy or rule.
    """
    strategies = [StrategyChoice.parse(name, scenario).name for name in usv]
    settings = [scenario.with_targets(rule) for rule in targets]
    to_nodes = scenario.task_definition.targets == "nodes"
    return {
        Combination(name, strategy, chosen.nodes.target_rule if to_nodes else ""): chosen
        for strategy, chosen, name in product(strategies, settings, policies)
    }


def definition(scenario: Scenario, combinations: Iterable[Combination], seed: int, arch: str) -> dict[str, Any]:
    """What tells an evaluation from another but for the number of episodes. Taichi runs from here on.

    Raises:
        PolicyError: a file of which the results are made cannot be read.
    """
    policies, boats, rules = (list(dict.fromkeys(parts)) for parts in zip(*combinations, strict=True))
    decides = {
        "scenario": scenario.to_dict(),
        "policies": [text_files.readable(name) for name in policies],
        "boats": boats,
        "targets": [text_files.readable(name) for name in rules],
        "seed": seed,
        "files": {text_files.readable(str(path)): digest for path, digest in digests(policies, (*boats, *rules))},
        "kernels on": runtime.start(arch).arch,
        "version": metadata.version("usvauv"),
    }
    return json.loads(json.dumps(decides))


def digests(policies: Iterable[str], others: Iterable[str]) -> list[tuple[Path, str]]:
    """Files, with hashes of their content, that decide results beside a scenario: plugins, learned rules, weights, the
    files of MODULE:CLASS.

    Args:
        policies: names.
        others: names of boat strategies and target rules.

    Raises:
        PolicyError: one cannot be read.
    """
    learned = [Path(name.partition(":")[2]) for name in others if name.startswith("learned:")]
    of_policies = [path for policy in filter(None, policies) if (path := source(policy))]
    return [(path, _digest(path)) for path in (*plugins.loaded(), *learned, *of_policies)]


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise PolicyError(f"{path}: cannot be read: {error.strerror}") from None


def first_difference(one: Any, other: Any, name: str = "") -> str:
    """The first value in which two definitions differ, in words; empty: in none."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys((*one, *other)):
            if found := first_difference(one.get(key), other.get(key), f"{name}.{key}".lstrip(".")):
                return found
        return ""
    return "" if one == other else f"{name} = {json.dumps(one)[:200]}, here {json.dumps(other)[:200]}"


def run(
    scenarios: Mapping[Combination, Scenario],
    policies: Mapping[str, MakePolicy],
    episodes: int,
    size: int,
    seed: int,
    arch: str,
    table: GrowingTable,
    comparison: Comparison,
    enough: Callable[[], bool],
    on_step: Callable[[int], None],
    on_trace: Callable[[Trace, int], None],
) -> None:
    """Run what the table does not have yet.

    Args:
        scenarios: of each combination; they differ in their target rules.
        policies: by name.
        episodes: of each combination, at most.
        size: worlds of a batch.
        seed, arch: as `World` takes them.
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

    for first in range(0, episodes, size):
        count = min(size, episodes - first)
        batch = {}
        for which, scenario in scenarios.items():
            taken = table.take(which, first, count)
            if taken is None:
                world = World(scenario, count, seed, which.usv, first_world=first, arch=arch)
                make = policies[which.policy]
                rows = [row.columns() for row in evaluate_batch(world, first, which.policy, make, step, on_trace)]
                table.append(which, rows)
                batch[which] = rows
            else:
                before += count * scenario.mission.steps
                batch[which] = taken
        comparison.add(batch)
        if enough():
            return
