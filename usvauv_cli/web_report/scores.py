"""Means of figures of merit with 95 % intervals, and paired differences between what was evaluated.

All combinations run in the same worlds, so the difference of two is taken episode by episode: what the worlds have in
common cancels. Intervals are Student's t, mean ± t s/√n; they take the mean of the episodes as normal.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

from usvauv_env.record.metrics import EpisodeMetrics

LEVEL = 0.95


class Combination(NamedTuple):
    """What was evaluated: a policy, a boat strategy and a target rule, empty where the task has none."""

    policy: str
    usv: str
    targets: str


class Estimate(NamedTuple):
    """A mean and half of its 95 % interval over n episodes; NaN: no mean of none, no interval of one."""

    mean: float
    half: float
    n: int


Episodes = Mapping[int, Mapping[str, Any]]  # number → figures by the name of their column


@cache
def t_quantile(freedom: int) -> float:
    """t with P(|T| < t) = 95 % for Student's T with a whole number of degrees of freedom.

    Source of the finite sums: Abramowitz & Stegun, "Handbook of Mathematical Functions", 26.7.3 and 26.7.4.
    """

    def within(angle: float) -> float:
        cosine = math.cos(angle)
        odd = freedom % 2
        term, total = (cosine if odd else 1.0), 0.0
        for i in range(1 + odd, freedom, 2):
            total += term
            term *= i / (i + 1) * cosine * cosine
        return 2 / math.pi * (angle + math.sin(angle) * total) if odd else math.sin(angle) * total

    low, high = 0.0, math.pi / 2
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if within(middle) < LEVEL else (low, middle)
    return math.sqrt(freedom) * math.tan(low)


def estimate(values: Sequence[float]) -> Estimate:
    """Mean and interval of the values that are not NaN."""
    known = [float(value) for value in values if not math.isnan(value)]
    n = len(known)
    mean = statistics.fmean(known) if known else math.nan
    half = t_quantile(n - 1) * statistics.stdev(known) / math.sqrt(n) if n > 1 else math.nan
    return Estimate(mean, half, n)


def by_combination(rows: Sequence[EpisodeMetrics]) -> dict[Combination, Episodes]:
    """The episodes of each combination, in the order of their first rows."""
    found: dict[Combination, dict[int, Mapping[str, Any]]] = {}
    for row in rows:
        found.setdefault(Combination(row.policy, row.usv, row.targets), {})[row.episode] = row.columns()
    return dict(found)


def score(episodes: Episodes, name: str) -> Estimate:
    """Mean and interval of a figure over the episodes that have it."""
    return estimate([row[name] for row in episodes.values()])


def difference(episodes: Episodes, reference: Episodes, name: str) -> Estimate:
    """Mean and interval of a figure less that of the reference in the same world, over worlds where both have it."""
    return estimate([row[name] - reference[world][name] for world, row in episodes.items() if world in reference])


def labels(combinations: Sequence[Combination]) -> list[str]:
    """Short names: of each combination the parts that differ among all, the policy if nothing does."""
    differ = [len(set(parts)) > 1 for parts in zip(*combinations, strict=True)]
    differ[0] |= not any(differ)
    return [" · ".join(p for p, shown in zip(parts, differ, strict=True) if shown and p) for parts in combinations]


def words(value: Estimate, sign: bool = False) -> str:
    """Mean ± half of the interval, which has two digits; without an interval a mean of three, or a whole one.

    A mean that is NaN is –. Neither has more than four digits after the point.
    """
    mean, half, _ = value
    if math.isnan(mean):
        return "–"
    places = digits(mean, half)
    text = f"{mean:{'+' if sign and mean else ''},.{places}f}"
    return (f"{text} ± {half:,.{places}f}" if half > 0 else text).replace("-", "−")


def digits(mean: float, half: float) -> int:
    """Digits after the point so that half of an interval has two digits; see `words`."""
    whole = not half > 0 and mean == int(mean)
    scale = half if half > 0 else abs(mean) / 10
    return 0 if whole else min(max(1 - math.floor(math.log10(scale)), 0), 4)
