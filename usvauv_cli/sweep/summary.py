"""What a study says: tables of at most 80 columns, and the same numbers as JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from usvauv.cli import tables
from usvauv.cli.evaluation.comparison import digits
from usvauv.cli.sweep import statistics
from usvauv.cli.sweep.statistics import Interval, interval
from usvauv.cli.sweep.study import OF_TRAINING, Evaluation, Planned

LEVELS = (0.0, 0.25, 0.5, 0.75, 0.9)  # of the profiles that are printed
COMPARED = 20  # methods of which all pairs are compared
CURVE = np.linspace(0, 1, 41)  # of those in the JSON
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
    `statistics.normalised` does it. Of more than `COMPARED` methods only the one of highest interquartile mean is
    compared with the others.
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
    pairs = list(combinations(of, 2))
    if len(of) > COMPARED:
        best = max(of, key=lambda method: float(statistics.interquartile_mean(of[method])))
        pairs = [(best, other) for other in of if other != best]
    curve = partial(statistics.profile, levels=CURVE)
    return {
        **evaluation.model_dump(),
        "tasks": {
            task: {m: {"runs": len(v), **as_json(interval(statistics.mean, [v]))} for m, v in methods_of.items()}
            for task, methods_of in found.items()
        },
        "aggregates": {m: {name: as_json(interval(f, s)) for name, f in aggregates.items()} for m, s in of.items()},
        "profiles": {
            m: [
                {"above": float(at), **as_json(Interval(*point))}
                for at, *point in zip(CURVE, *interval(curve, s), strict=True)
            ]
            for m, s in of.items()
        },
        "improvement": [
            {"method": one, "over": other, **as_json(interval(statistics.improvement, of[one], of[other]))}
            for one, other in pairs
        ],
    }


def as_json(value: Interval) -> dict[str, float | None]:
    """An interval as JSON values."""
    return {name: None if math.isnan(number) else float(number) for name, number in value._asdict().items()}


def show(results: Mapping[str, Any]) -> None:
    """Print the summary, if there is a score."""
    if not results["tasks"]:
        return
    methods = list(dict.fromkeys(method for task in results["tasks"].values() for method in task))
    short = tables.shortened([*methods, *results["tasks"]], LONGEST)
    score = results["score"]
    print(tables.wrapped(f"{score}, mean over runs, with 95 % intervals of the bootstrap over runs:"))
    rows = [
        [short[task], short[method], str(about["runs"]), in_words(about)]
        for task, of_methods in results["tasks"].items()
        for method, about in of_methods.items()
    ]
    tables.print_table(["task", "method", "runs", score], rows, 2)
    if len(results["aggregates"]) > 1:
        print("\n" + tables.wrapped("Scores scaled so that in each task the worst run is 0 and the best 1:"))
        rows = [[short[m], *map(in_words, figures_of.values())] for m, figures_of in results["aggregates"].items()]
        tables.print_table(["method", "IQM", "median", "mean"], rows)
        print("\n" + tables.wrapped("Share of runs above a scaled score (performance profile):"))
        rows = [
            [short[m], *(f"{_at(profile, level)['value']:.0%}" for level in LEVELS)]
            for m, profile in results["profiles"].items()
        ]
        tables.print_table(["method", *(f"> {level:g}" for level in LEVELS)], rows)
        print("\n" + tables.wrapped("Probability that a run is better than one of another method:"))
        rows = [[short[pair["method"]], short[pair["over"]], in_words(pair)] for pair in results["improvement"]]
        tables.print_table(["method", "over", "probability"], rows, 2)
    for name, brief in short.items():
        if name != brief:
            print(tables.wrapped(f"{brief} = {name}", 2))


def _at(profile: Sequence[Mapping[str, Any]], level: float) -> Mapping[str, Any]:
    return min(profile, key=lambda point: abs(point["above"] - level))


def in_words(about: Mapping[str, Any]) -> str:
    """A figure with its interval, of which half has two digits; without one a figure of three."""
    value, low, high = about["value"], about["low"], about["high"]
    places = digits(value, math.nan if low is None else (high - low) / 2)
    return f"{value:.{places}f}" if low is None else f"{value:.{places}f} [{low:.{places}f}, {high:.{places}f}]"
