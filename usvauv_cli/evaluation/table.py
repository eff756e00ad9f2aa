"""What `usvauv eval` compares, from Python, as a table of pandas: `evaluate`, also in the package itself."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from usvauv import policies as by_name
from usvauv.cli.evaluation.comparison import Comparison
from usvauv.cli.evaluation.differences import headline, sentences
from usvauv.cli.evaluation.run import combinations
from usvauv.env.record import evaluation
from usvauv.env.record.evaluation import MakePolicy
from usvauv.env.record.metrics import FIGURES
from usvauv.env.scenario import Scenario
from usvauv.env.storage.tables import Combination


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
    episode by episode, which is far sharper than comparing two means. Intervals are as
    `usvauv.cli.evaluation.comparison` says. `usvauv.env.evaluate` gives the single episodes.

    >>> table = evaluate("wide", usv=["fim", "belief"], episodes=40)
    >>> table.loc["delivered_mbit"]

    Args:
        scenario: a scenario, or what `Scenario.load` takes.
        policies: of the AUVs: a name or several, as `policies.load` takes them, or a name in the table → class or
            function that takes the world and gives something with `act`, or a function: observations (W, K, O) →
            actions (W, K, 2) in [−1, 1]. Default: the scenario's.
        usv, targets: strategies of the boat and target rules, by name. Default: the scenario's.
        episodes: of each combination, at least 1.
        seed, arch: as `World` takes them.

    Returns:
        A row for each figure and combination, with the index figure, policy, usv, targets. Its columns: `mean` over the
        episodes, and `half` of its 95 % interval, so that the interval is mean ± half; `difference`, mean over the
        worlds of the figure less that of the first combination in the same world, and `difference_half`, both NaN in
        the first combination's row; `episodes` that have the figure: the energy for each Mbit, say, only those that
        brought in data.

        Figures are named as in the CSV of `usvauv eval`, with the unit where it is not obvious. `attrs["sentences"]`
        has what `usvauv eval` says of the differences in words.

    Raises:
        UserError: an argument that cannot be used, or what `Scenario.load`, `World` and `record` raise.
    """
    setting = Scenario.of(scenario)
    if isinstance(policies, Mapping):
        makers = dict(policies)
    else:
        names = [policies or by_name.default(setting)] if policies is None or isinstance(policies, str) else policies
        for name in names:
            by_name.check(name, setting)
        makers = by_name.named(*names)
    found = combinations(setting, list(makers), _several(usv), _several(targets))
    comparison = Comparison(list(found), seas=setting.random_seas)
    comparison.add(
        {
            which: [
                row.columns()
                for row in evaluation.evaluate(
                    chosen,
                    {which.policy: makers[which.policy]},
                    episodes=episodes,
                    seed=seed,
                    usv=which.usv,
                    arch=arch,
                )
            ]
            for which, chosen in found.items()
        }
    )
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
    table.attrs["sentences"] = sentences(comparison, headline(setting))
    return table


def _several(names: str | Sequence[str] | None) -> Sequence[str | None]:
    return [names] if names is None or isinstance(names, str) else names
