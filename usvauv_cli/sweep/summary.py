"""Comparison of methods from few runs: aggregates, performance profiles, probability of improvement, bootstrap
intervals, as JSON and as tables of at most 80 columns.

By the definitions of Agarwal, Schwarzer, Castro, Courville and Bellemare, "Deep reinforcement learning at the edge of
the statistical precipice" (NeurIPS 2021, arXiv:2108.13264) and of their library rliable. A method's scores are a list
with an array for each task, with one score per run; functions of them reduce the last axis, so they accept resamples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from usvauv.cli import terminal
from usvauv.cli.evaluation import comparison
from usvauv.cli.evaluation.comparison import digits
from usvauv.cli.evaluation.comparison_tables import sentence
from usvauv.cli.sweep.study import Evaluation

Scores = Sequence[np.ndarray]  # one array a task, (…, N) over its runs
LEVEL = 0.95  # of intervals
REPEATS = 2000  # resamples
SHOWN = (0.0, 0.25, 0.5, 0.75, 0.9)  # of the profiles that are printed
COMPARED = 20  # methods of which all pairs are compared
CURVE = np.linspace(0, 1, 41)  # of those in the JSON
LONGEST = 24  # columns of a name


class Interval(NamedTuple):
    """A figure, a number or an array, and its 95 % interval; NaN where no task has two runs."""

    value: Any
    low: Any
    high: Any


def interquartile_mean(scores: Scores) -> np.ndarray:
    """Mean of the middle half of the runs of all tasks."""
    ordered = np.sort(np.concatenate(scores, axis=-1), axis=-1)
    count = ordered.shape[-1]
    return ordered[..., count // 4 : count - count // 4].mean(-1)


def mean(scores: Scores) -> np.ndarray:
    """Mean over tasks of the mean of their runs."""
    return np.mean([task.mean(-1) for task in scores], axis=0)


def median(scores: Scores) -> np.ndarray:
    """Median over tasks of the mean of their runs."""
    return np.median([task.mean(-1) for task in scores], axis=0)


def profile(scores: Scores, levels: np.ndarray) -> np.ndarray:
    """Performance profile (…, L): share of runs with a score above each of L levels, mean over tasks."""
    return np.mean([(task[..., None, :] > levels[:, None]).mean(-1) for task in scores], axis=0)


def improvement(scores: Scores, others: Scores) -> np.ndarray:
    """Probability that a run of one method is better than one of another on the same task; equal ones count half.

    The Mann–Whitney statistic of each task over the number of pairs, mean over tasks.
    """
    pairs = [(one[..., :, None], other[..., None, :]) for one, other in zip(scores, others, strict=True)]
    return np.mean([((a > b) + 0.5 * (a == b)).mean((-2, -1)) for a, b in pairs], axis=0)


def interval(figure: Callable[..., np.ndarray], *methods: Scores, repeats: int = REPEATS, seed: int = 0) -> Interval:
    """A figure of one or two methods with its percentile interval of the stratified bootstrap: within each task as many
    runs are drawn, with replacement, as there are.
    """
    value = figure(*methods)
    if all(len(task) < 2 for scores in methods for task in scores):
        return Interval(value, value * np.nan, value * np.nan)
    draw = np.random.default_rng(seed)
    resampled = [[task[draw.integers(len(task), size=(repeats, len(task)))] for task in scores] for scores in methods]
    tail = 50 * (1 - LEVEL)
    return Interval(value, *np.percentile(figure(*resampled), [tail, 100 - tail], axis=0))


def normalised(tasks: Sequence[Sequence[np.ndarray]]) -> list[list[np.ndarray]]:
    """Scores (task → method → runs) scaled in each task, so that the worst run of any method is 0 and the best 1.

    Where all runs are equal they are 1.
    """
    scaled = []
    for methods in tasks:
        every = np.concatenate(methods)
        low, span = every.min(), np.ptp(every)
        scaled.append([(runs - low) / span if span else np.ones_like(runs) for runs in methods])
    return scaled


def scores(rows: Iterable[Mapping[str, Any]], score: str) -> dict[str, dict[str, np.ndarray]]:
    """Task → method → mean score of each run over the episodes that have it."""
    episodes: dict[tuple[str, str, str], list[float]] = {}
    for row in rows:
        value = float(row.get(score) or "nan")
        if not math.isnan(value):
            episodes.setdefault((row["task"], row["method"], row["run"]), []).append(value)
    found: dict[str, dict[str, list[float]]] = {}
    for (task, method, _), values in episodes.items():
        found.setdefault(task, {}).setdefault(method, []).append(float(np.mean(values)))
    return {task: {m: np.array(v) for m, v in methods.items()} for task, methods in found.items()}


def differences(rows: Iterable[Mapping[str, Any]], score: str, seas: Mapping[str, int]) -> list[dict[str, Any]]:
    """Differences of each method's score from that of the task's first method, with a sentence, by task and method.

    Runs of the same seed are evaluated in the same worlds, so the difference is taken episode by episode. Over several
    seeds, of which each is another training and other worlds, the interval is that of the seeds' means; of one seed
    that of its episodes, see `usvauv.cli.evaluation.comparison`, which says nothing of other trainings. `seas` has the
    number of random seas by task, as `Scenario.random_seas`.
    """
    found: dict[str, dict[str, dict[tuple[int, int], list[float]]]] = {}
    for row in rows:
        value, place = float(row.get(score) or "nan"), (int(row["training_seed"]), int(row["episode"]))
        found.setdefault(row["task"], {}).setdefault(row["method"], {}).setdefault(place, []).append(value)
    told = []
    for task, methods in found.items():
        first, *others = methods
        for method in others:
            places = sorted(methods[method].keys() & methods[first].keys())
            less = np.array([np.mean(methods[method][at]) - np.mean(methods[first][at]) for at in places])
            of = np.array([seed for seed, _ in places])
            seeds = np.unique(of[~np.isnan(less)])
            if len(seeds) > 1:
                value = comparison.interval(np.array([np.nanmean(less[of == seed]) for seed in seeds]))
            else:
                value = comparison.interval(less if len(less) else np.full(1, np.nan), seas[task])
            said = sentence(value, method, first, score)
            if len(seeds) == 1 < value.n:
                said += ", of one run each"
            told.append(
                {
                    "task": task,
                    "method": method,
                    "over": first,
                    "difference": None if math.isnan(value.mean) else value.mean,
                    "half": None if math.isnan(value.half) else value.half,
                    "sentence": said if len(found) == 1 else f"{task}: {said}",
                }
            )
    return told


def summary(
    found: Mapping[str, Mapping[str, np.ndarray]], evaluation: Evaluation, told: Sequence[Mapping[str, Any]] = ()
) -> dict[str, Any]:
    """Statistics of a study as JSON values; None stands for what cannot be known. `told` are its `differences`.

    Aggregates, profiles and probabilities are over the tasks in which every method has a run, with scores scaled as
    `normalised` does it. Of more than `COMPARED` methods only the one of highest interquartile mean is
    compared with the others.
    """
    methods = list(dict.fromkeys(method for task in found.values() for method in task))
    shared = [task for task in found.values() if all(method in task for method in methods)]
    sign = 1.0 if evaluation.better == "higher" else -1.0
    scaled = normalised([[sign * task[method] for method in methods] for task in shared])
    of = {method: [task[place] for task in scaled] for place, method in enumerate(methods)} if shared else {}
    aggregates: dict[str, Callable[..., np.ndarray]] = {
        "iqm": interquartile_mean,
        "median": median,
        "mean": mean,
    }
    pairs = list(combinations(of, 2))
    if len(of) > COMPARED:
        best = max(of, key=lambda method: float(interquartile_mean(of[method])))
        pairs = [(best, other) for other in of if other != best]
    curve = partial(profile, levels=CURVE)
    return {
        **evaluation.model_dump(),
        "differences": list(told),
        "tasks": {
            task: {m: {"runs": len(v), **as_json(interval(mean, [v]))} for m, v in methods_of.items()}
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
            {"method": one, "over": other, **as_json(interval(improvement, of[one], of[other]))} for one, other in pairs
        ],
    }


def as_json(value: Interval) -> dict[str, float | None]:
    """An interval as JSON values."""
    return {name: None if math.isnan(number) else float(number) for name, number in value._asdict().items()}


def show(results: Mapping[str, Any]) -> None:
    """Print the summary with its differences, if there is a score."""
    if not results["tasks"]:
        return
    methods = list(dict.fromkeys(method for task in results["tasks"].values() for method in task))
    short = terminal.shortened([*methods, *results["tasks"]], LONGEST)
    score = results["score"]
    print(terminal.wrapped(f"{score}, mean over runs, with 95 % intervals of the bootstrap over runs:"))
    rows = [
        [short[task], short[method], str(about["runs"]), in_words(about)]
        for task, of_methods in results["tasks"].items()
        for method, about in of_methods.items()
    ]
    terminal.print_table(["task", "method", "runs", score], rows, 2)
    for less in results["differences"]:
        print(terminal.wrapped(less["sentence"], 2))
    if len(results["aggregates"]) > 1:
        print("\n" + terminal.wrapped("Scores scaled so that in each task the worst run is 0 and the best 1:"))
        rows = [[short[m], *map(in_words, figures_of.values())] for m, figures_of in results["aggregates"].items()]
        terminal.print_table(["method", "IQM", "median", "mean"], rows)
        print("\n" + terminal.wrapped("Share of runs above a scaled score (performance profile):"))
        rows = [
            [short[m], *(f"{_at(profile, level)['value']:.0%}" for level in SHOWN)]
            for m, profile in results["profiles"].items()
        ]
        terminal.print_table(["method", *(f"> {level:g}" for level in SHOWN)], rows)
        print("\n" + terminal.wrapped("Probability that a run is better than one of another method:"))
        rows = [[short[pair["method"]], short[pair["over"]], in_words(pair)] for pair in results["improvement"]]
        terminal.print_table(["method", "over", "probability"], rows, 2)
    for name, brief in short.items():
        if name != brief:
            print(terminal.wrapped(f"{brief} = {name}", 2))


def _at(profile: Sequence[Mapping[str, Any]], level: float) -> Mapping[str, Any]:
    return min(profile, key=lambda point: abs(point["above"] - level))


def in_words(about: Mapping[str, Any]) -> str:
    """A figure with its interval, of which half has two digits; without one a figure of three."""
    value, low, high = about["value"], about["low"], about["high"]
    places = digits(value, math.nan if low is None else (high - low) / 2)
    return f"{value:.{places}f}" if low is None else f"{value:.{places}f} [{low:.{places}f}, {high:.{places}f}]"
