"""What few runs say about methods: aggregates, performance profiles, probability of improvement, bootstrap intervals.

By the definitions of Agarwal, Schwarzer, Castro, Courville and Bellemare, "Deep reinforcement learning at the edge of
the statistical precipice" (NeurIPS 2021, arXiv:2108.13264) and of their library rliable. A method's scores are a list
with an array for each task, of one score a run; functions of them reduce the last axis, so that they take resamples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

Scores = Sequence[np.ndarray]  # one array a task, (…, N) over its runs
LEVEL = 0.95  # of intervals
REPEATS = 2000  # resamples


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
