"""What a study says: tables of at most 80 columns, and the same numbers as JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from usvauv_cli import tables
from usvauv_cli.sweep import statistics
from usvauv_cli.sweep.statistics import Interval, interval
from usvauv_cli.sweep.study import OF_TRAINING, Evaluation, Planned

LEVELS = (0.0, 0.25, 0.5, 0.75, 0.9)  # of the profiles that are printed
CURVE = tuple(float(level) for level in np.linspace(0, 1, 41))  # of those in the JSON
LONGEST = 24  # columns of a name
Labels = dict[str, tuple[str, str]]  # key of a run → method, task
Figures = Mapping[str, Mapping[str, np.ndarray]]  # task → method → mean score of each run


def labels(runs: Sequence[Planned]) -> Labels:
    """Method and task of each run, in words: what acts, and in which scenario; of settings and changes those that are
    not the same in all runs.
    """
    settings = {
        planned.key: [f"{name}={getattr(planned.run, name)}" for name in OF_TRAINING[:-1] if _given(planned, name)]
        + list(planned.run.learn)
        for planned in runs
    }
    same = _in_all([settings[planned.key] for planned in runs if planned.run.algorithm])
    changes = _in_all([planned.run.set for planned in runs])
    boats = len({planned.definition["usv"] for planned in runs}) > 1
    found: Labels = {}
    for planned in runs:
        run, usv = planned.run, planned.definition["usv"]
        varying = [text for text in settings[planned.key] if text not in same]
        parts = [run.policy or run.algorithm, *varying, usv if boats else "", run.targets]
        task = [planned.scenario.name, *(change for change in run.set if change not in changes)]
        found[planned.key] = run.name or " · ".join(filter(None, parts)), " ".join(task)
    return found


def _given(planned: Planned, name: str) -> bool:
    return name in planned.run.model_fields_set


def _in_all(lists: Sequence[Sequence[str]]) -> set[str]:
    return set.intersection(*map(set, lists)) if lists else set()


def figures(rows: Iterable[Mapping[str, Any]], score: str) -> Figures:
    """Mean score of each run over the episodes that have it."""
    episodes: dict[tuple[str, str, str], list[float]] = {}
    for row in rows:
        value = float(row.get(score) or "nan")
        if not math.isnan(value):
            episodes.setdefault((row["task"], row["method"], row["run"]), []).append(value)
    found: dict[str, dict[str, list[float]]] = {}
    for (task, method, _), values in episodes.items():
        found.setdefault(task, {}).setdefault(method, []).append(float(np.mean(values)))
    return {task: {m: np.array(v) for m, v in methods.items()} for task, methods in found.items()}


def summary(found: Figures, evaluation: Evaluation) -> dict[str, Any]:
    """Statistics of a study as JSON values; None stands for what cannot be known.

    Aggregates, profiles and probabilities are over the tasks in which every method has a run, with scores scaled as
    `statistics.normalised` does it.
    """
    methods = list(dict.fromkeys(method for task in found.values() for method in task))
    shared = [task for task in found.values() if all(method in task for method in methods)]
    sign = 1.0 if evaluation.better == "higher" else -1.0
    scaled = statistics.normalised([[sign * task[method] for method in methods] for task in shared])
    of = {method: [task[place] for task in scaled] for place, method in enumerate(methods)} if shared else {}
    aggregates: dict[str, Callable[..., np.ndarray]] = {
        "iqm": statistics.interquartile_mean,
        "median": statistics.median,
        "mean": statistics.mean,
    }
    curve = {level: partial(statistics.above, level=level) for level in CURVE}
    return {
        **evaluation.model_dump(),
        "tasks": {
            task: {m: {"runs": len(v), **_json(interval(statistics.mean, [v]))} for m, v in methods_of.items()}
            for task, methods_of in found.items()
        },
        "aggregates": {m: {name: _json(interval(f, s)) for name, f in aggregates.items()} for m, s in of.items()},
        "profiles": {m: [{"above": t, **_json(interval(f, s))} for t, f in curve.items()] for m, s in of.items()},
        "improvement": [
            {"method": one, "over": other, **_json(interval(statistics.improvement, of[one], of[other]))}
            for one, other in combinations(of, 2)
        ],
    }


def _json(value: Interval) -> dict[str, float | None]:
    return {name: None if math.isnan(number) else number for name, number in value._asdict().items()}


def show(results: Mapping[str, Any]) -> None:
    """Print the summary."""
    methods = list(dict.fromkeys(method for task in results["tasks"].values() for method in task))
    short = tables.shortened([*methods, *results["tasks"]], LONGEST)
    score = results["score"]
    print(tables.wrapped(f"{score}, mean over runs, with 95 % intervals of the bootstrap over runs:"))
    rows = [
        [short[task], short[method], str(about["runs"]), _words(about)]
        for task, of_methods in results["tasks"].items()
        for method, about in of_methods.items()
    ]
    tables.print_table(["task", "method", "runs", score], rows, 2)
    if len(results["aggregates"]) > 1:
        print("\n" + tables.wrapped("Scores scaled so that in each task the worst run is 0 and the best 1:"))
        rows = [[short[m], *map(_words, figures_of.values())] for m, figures_of in results["aggregates"].items()]
        tables.print_table(["method", "IQM", "median", "mean"], rows)
        print("\n" + tables.wrapped("Share of runs above a scaled score (performance profile):"))
        rows = [
            [short[m], *(f"{_at(profile, level)['value']:.0%}" for level in LEVELS)]
            for m, profile in results["profiles"].items()
        ]
        tables.print_table(["method", *(f"> {level:g}" for level in LEVELS)], rows)
        print("\n" + tables.wrapped("Probability that a run is better than one of another method:"))
        rows = [[short[pair["method"]], short[pair["over"]], _words(pair)] for pair in results["improvement"]]
        tables.print_table(["method", "over", "probability"], rows, 2)
    for name, brief in short.items():
        if name != brief:
            print(tables.wrapped(f"{brief} = {name}", 2))


def _at(profile: Sequence[Mapping[str, Any]], level: float) -> Mapping[str, Any]:
    return min(profile, key=lambda point: abs(point["above"] - level))


def _words(about: Mapping[str, Any]) -> str:
    """A figure with its interval, to two digits after the point."""
    value, low, high = about["value"], about["low"], about["high"]
    return f"{value:.2f}" if low is None else f"{value:.2f} [{low:.2f}, {high:.2f}]"
