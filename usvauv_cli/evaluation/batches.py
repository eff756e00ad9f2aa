"""The episodes of an evaluation, batch by batch with all combinations, everything that decides their results, and
`evaluate`, which compares policies from Python and returns a pandas table; the package `usvauv` exports it too.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import metadata
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usvauv.cli.evaluation.comparison import Comparison
from usvauv.cli.evaluation.comparison_tables import headline
from usvauv.cli.evaluation.ranking import ahead
from usvauv.env.record.evaluation import MakePolicy, batch_size, evaluate_batch
from usvauv.env.record.metrics import FIGURES
from usvauv.env.record.trace import Trace
from usvauv.env.scenario import Scenario
from usvauv.env.storage.files import readable
from usvauv.env.storage.result_tables import Combination, GrowingTable
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.env.world.world import World
from usvauv.kernels import runtime
from usvauv.policies import loading
from usvauv.policies.inputs import digests

if TYPE_CHECKING:
    import pandas as pd


def combinations(
    scenario: Scenario, policies: Sequence[str], usv: Sequence[str | None], targets: Sequence[str | None]
) -> dict[Combination, Scenario]:
    """Each policy with each boat strategy and target rule, and the scenario with that rule; None: the scenario's."""
    strategies = [StrategyChoice.parse(name, scenario).name for name in usv]
    settings = [scenario.with_targets(rule) for rule in targets]
    to_nodes = scenario.task_definition.targets == "nodes"
    return {
        Combination(name, strategy, chosen.nodes.target_rule if to_nodes else ""): chosen
        for strategy, chosen, name in product(strategies, settings, policies)
    }


def definition(scenario: Scenario, combinations: Iterable[Combination], seed: int, arch: str) -> dict[str, Any]:
    """Everything that distinguishes evaluations, except the number of episodes. Taichi runs from here on."""
    policies, boats, rules = (list(dict.fromkeys(parts)) for parts in zip(*combinations, strict=True))
    decides = {
        "scenario": scenario.to_dict(),
        "policies": [readable(name) for name in policies],
        "boats": boats,
        "targets": rules,
        "seed": seed,
        "files": digests([scenario.with_targets(rule or None) for rule in rules], policies),
        "kernels on": runtime.start(arch).arch,
        "version": metadata.version("usvauv"),
    }
    return json.loads(json.dumps(decides))


def first_difference(one: Any, other: Any, name: str = "") -> str:
    """The first value that differs between two definitions, in words; empty: none."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys((*one, *other)):
            if found := first_difference(one.get(key), other.get(key), f"{name}.{key}".lstrip(".")):
                return found
        return ""
    before, here = ("not given" if value is None else json.dumps(value)[:200] for value in (one, other))
    return "" if one == other else f"{name} {'' if one is None else '= '}{before}, here {here}"


def batches(
    scenarios: Mapping[Combination, Scenario],
    policies: Mapping[str, MakePolicy],
    episodes: int,
    size: int,
    seed: int,
    arch: str,
    table: GrowingTable | None = None,
    on_step: Callable[[int], None] = lambda worlds: None,
    on_trace: Callable[[Trace, int], None] = lambda trace, first: None,
) -> Iterator[Mapping[Combination, Sequence[Mapping[str, Any]]]]:
    """Rows of all combinations, in batches of `size` worlds.

    Args:
        table: whose rows are not run again, and to which others are added.
        on_step: called with the number of worlds stepped, also for steps of an earlier process.
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
            taken = table.take(which, first, count) if table else None
            if taken is None:
                world = World(scenario, count, seed, which.usv, first_world=first, arch=arch)
                make = policies[which.policy]
                taken = [row.columns() for row in evaluate_batch(world, first, which.policy, make, step, on_trace)]
                del world  # before the next one
                if table:
                    table.append(which, taken)
            else:
                before += count * scenario.mission.steps
            batch[which] = taken
        yield batch


def evaluate(
    scenario: Scenario | str | Path,
    policies: str | Sequence[str] | Mapping[str, MakePolicy] | None = None,
    *,
    usv: str | Sequence[str] | None = None,
    targets: str | Sequence[str] | None = None,
    episodes: int = 20,
    seed: int = 0,
    arch: str = "auto",
) -> pd.DataFrame:
    """Run each policy with each boat strategy and target rule in the same seeded worlds, and compare them.

    Episode e of every combination takes place in world e of the seed. So differences to the first combination are taken
    episode by episode, which is far more precise than comparing two means. `usvauv.cli.evaluation.comparison` describes
    the intervals. `usvauv.env.record.evaluation.run_episodes` returns the single episodes.

    >>> table = evaluate("wide", usv=["fim", "belief"], episodes=40)
    >>> table.loc["delivered_mbit"]

    Args:
        scenario: a scenario, or an argument of `Scenario.load`.
        policies: of the AUVs: one or several names, as for `policies.load`, or a name in the table → class or function
            that takes the world and returns an object with `act`, or a function: observations (W, K, O) → actions
            (W, K, 2) in [−1, 1]. Default: the scenario's.
        usv, targets: boat strategies and target rules, by name. Default: the scenario's.
        episodes: per combination, at least 1.
        seed, arch: as for `World`.

    Returns:
        A row for each figure and combination, with the index figure, policy, usv, targets. Its columns: `mean` over the
        episodes, and `half` of its 95 % interval, so that the interval is mean ± half; `difference`, the mean over the
        worlds of the figure minus that of the first combination in the same world, and `difference_half`, both NaN in
        the first combination's row; `episodes`, the number that have the figure: for energy per Mbit, for example, only
        those with collected data.

        Figures are named as in the CSV of `usvauv eval`, with the unit where it is not obvious. `attrs["sentences"]`
        has the sentences of `usvauv eval` on the differences.

    Raises:
        UserError: an argument that cannot be used; also errors of `Scenario.load`, `World` and `record`.
    """
    import pandas as pd

    setting = Scenario.of(scenario)
    if isinstance(policies, Mapping):
        makers = dict(policies)
    else:
        names = [policies or loading.default(setting)] if policies is None or isinstance(policies, str) else policies
        for name in names:
            loading.check(name, setting)
        makers = loading.named(*names)
    found = combinations(setting, list(makers), _several(usv), _several(targets))
    comparison = Comparison(list(found), seas=setting.random_seas)
    size = min(batch_size(chosen, episodes) for chosen in found.values())
    for batch in batches(found, makers, episodes, size, seed, arch):
        comparison.add(batch)
    rows = []
    for figure in (*FIGURES, *comparison.of_task):
        for which in found:
            score, less = comparison.score(which, figure), comparison.difference(which, figure)
            if which == comparison.reference:
                less = less._replace(mean=math.nan, half=math.nan)
            rows.append((figure, *which, score.mean, score.half, less.mean, less.half, score.n))
    index = ["figure", *Combination._fields]
    columns = ["mean", "half", "difference", "difference_half", "episodes"]
    table = pd.DataFrame(rows, columns=[*index, *columns]).set_index(index)
    table.attrs["sentences"] = ahead(comparison, headline(setting))
    return table


def _several(names: str | Sequence[str] | None) -> Sequence[str | None]:
    return [names] if names is None or isinstance(names, str) else names
