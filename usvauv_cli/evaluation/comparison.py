"""Means with 95 % intervals of combinations of policy, boat strategy and target rule.

All combinations run in the same worlds, so the difference of two is taken episode by episode: the worlds' common
effects cancel. Episodes on the same random sea are not independent. So the variance of a mean is that of the sums of
deviations over each of the G seas that occur,

    var x̄ = G/(G − 1) Σ_g (Σ_{i in g} (x_i − x̄))² / n²,

and the interval is x̄ ± t √var with Student's t for G − 1 degrees of freedom; with a sea for each episode, t s/√n. Only
sums are kept, whose size does not grow with the number of episodes. The intervals assume normal means over seas.

**Rare events.** The mean of a count that is most often 0, such as `collisions`, is far from normal. A mean x̄ with
variance V is that of N = x̄²/V events, each worth x̄/N, and V is at least x̄/n, that of single events. With Byar's
approximation u(N) = (N + 1) (1 − 1/(9 (N + 1)) + z/(3 √(N + 1)))³ of the upper limit of a Poisson number, half of the
interval is at least (x̄/N) (u(N) − N), the longer side; without any event it is u(0)/n. A difference of counts is one of
two counts, of the worlds with more and of those with fewer, whose halves are added in squares. Events that come in
bursts widen the interval once some have occurred; where none has, u(0)/n is the limit of single events.

Sources: Cameron and Miller (2015), "A practitioner's guide to cluster-robust inference", J. Human Resources 50, 317,
doi 10.3368/jhr.50.2.317, §II and §VI; Breslow and Day (1987), "Statistical Methods in Cancer Research II", IARC, p. 69.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from usvauv.env.record.metrics import COLUMNS, FIGURES
from usvauv.env.storage.result_tables import Combination

LEVEL, NORMAL = 0.95, 1.959964  # and z of the normal distribution with that
# Figures that count rare events, or what is lost by them, and the least that an event is worth.
COUNTS = {"collisions": 1, "border": 1, "surfaced": 1, "grounded": 1, "spent": 1, "overflow": 1, "lost_mbit": 0}


class Estimate(NamedTuple):
    """A mean and half of its 95 % interval over n episodes; NaN: no mean for n = 0, no interval for n = 1."""

    mean: float
    half: float
    n: int


@lru_cache(100)
def t_quantile(freedom: int) -> float:
    """t with P(|T| < t) = 95 % for Student's T with a whole number ν of degrees of freedom.

    With t = √ν tan θ the density of θ is proportional to cos^(ν−1) θ, which Gauss–Legendre quadrature integrates.
    """
    nodes, weights = np.polynomial.legendre.leggauss(64)

    def area(end: float) -> float:
        return end * float(weights @ np.exp((freedom - 1) * 0.5 * np.log1p(-(np.sin(0.5 * end * (nodes + 1)) ** 2))))

    low, high = 0.0, min(0.5 * math.pi, 12 / math.sqrt(freedom))  # beyond is nothing
    whole = area(high)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if area(middle) < LEVEL * whole else (low, middle)
    return math.sqrt(freedom) * math.tan(low)


class Moments:
    """Mean and spread of F figures over values that are added in parts; a figure's NaN are left out.

    Parts are joined by Chan, Golub & LeVeque 1983, doi:10.1080/00031305.1983.10483115, about the first value, so that
    equal values have a spread of exactly 0. Values alternate among `seas` random seas; 0: each has its own.
    """

    def __init__(self, figures: int, seas: int = 0) -> None:
        self._turn = 0  # of the next value
        self._of_sea = np.zeros((2, seas, figures))  # number of values on a sea, and their sum less the first
        self._n = np.zeros(figures)
        self._first = np.full(figures, np.nan)
        self._mean = np.zeros(figures)  # less the first
        self._squares = np.zeros(figures)  # sum of squared deviations from the mean

    def add(self, values: np.ndarray) -> None:
        """Add values, (any number, F)."""
        known = ~np.isnan(values)
        n = known.sum(axis=0)
        first = values[known.argmax(axis=0), np.arange(values.shape[1])]
        self._first = np.where(self._n > 0, self._first, first)
        shifted = np.where(known, values - self._first, 0.0)
        if seas := self._of_sea.shape[1]:
            sea = (self._turn + np.arange(len(values))) % seas
            np.add.at(self._of_sea[0], sea, known)
            np.add.at(self._of_sea[1], sea, shifted)
            self._turn = (self._turn + len(values)) % seas
        mean = shifted.sum(axis=0) / np.maximum(n, 1)
        squares = np.where(known, (shifted - mean) ** 2, 0.0).sum(axis=0)
        total, apart = self._n + n, mean - self._mean
        share = n / np.maximum(total, 1)
        self._squares += squares + apart**2 * self._n * share
        self._mean += apart * share
        self._n = total

    def estimate(self, figure: int) -> Estimate:
        """Mean and interval of a figure."""
        n = int(self._n[figure])
        mean = float(self._first[figure] + self._mean[figure]) if n else math.nan
        variance, freedom = self._variance(figure)
        return Estimate(mean, t_quantile(freedom) * math.sqrt(variance) if freedom else math.nan, n)

    def half_of_events(self, figure: int, least: float) -> float:
        """Half of the interval of a count's mean, at least that of a Poisson number of events of a `least` size."""
        mean, half, n = self.estimate(figure)
        variance, freedom = self._variance(figure)
        if not freedom:
            return half
        variance = max(variance, least * mean / n)
        events, worth = (mean**2 / variance, variance / mean) if variance else (0.0, least / n)
        next_event = events + 1
        most = next_event * (1 - 1 / (9 * next_event) + NORMAL / (3 * math.sqrt(next_event))) ** 3
        return max(half, worth * (most - events))

    def effective(self, figure: int) -> float:
        """Number of values, each on its own sea, whose mean would be as precise."""
        n, (variance, freedom) = int(self._n[figure]), self._variance(figure)
        alone = self.deviation(figure) ** 2
        return min(n, alone / variance) if freedom and variance > 0 else n

    def floor(self, figure: int) -> float:
        """Half of the interval, below which more values on the same seas hardly bring it.

        Of the variance V of the mean with ν degrees of freedom, W is the part of the values within seas; from the rest
        three standard errors are taken, of the variance (4 (V − W) W + 2 W²)/ν. ∞: all values are on one sea.
        """
        variance, freedom = self._variance(figure)
        n, seas = self._n[figure], freedom + 1
        if self._of_sea.shape[1] == 1:
            return math.inf
        if not self._of_sea.shape[1] or not freedom or n <= seas:
            return 0.0
        count, total = self._of_sea[:, :, figure]
        apart = float(np.sum(count * (total / np.maximum(count, 1) - self._mean[figure]) ** 2))
        within = max(self._squares[figure] - apart, 0.0) / (n - seas) / n
        between = max(variance - within, 0.0)
        error = math.sqrt((4 * between * within + 2 * within**2) / freedom)
        return t_quantile(freedom) * math.sqrt(max(between - 3 * error, 0.0))

    def _variance(self, figure: int) -> tuple[float, int]:
        """Variance of the mean, and its degrees of freedom; (0, 0): unknown."""
        n, (count, total) = int(self._n[figure]), self._of_sea[:, :, figure]
        if count.max(initial=0) <= 1:
            return (self.deviation(figure) ** 2 / n, n - 1) if n > 1 else (0.0, 0)
        seas = int(np.count_nonzero(count))
        if seas < 2:
            return 0.0, 0
        apart = total - count * self._mean[figure]
        return seas / (seas - 1) * float(np.sum(apart**2)) / n**2, seas - 1

    def deviation(self, figure: int) -> float:
        """Standard deviation of a figure; 0 of one value."""
        return math.sqrt(self._squares[figure] / max(self._n[figure] - 1, 1))


def interval(values: np.ndarray | Sequence[float], seas: int = 0) -> Estimate:
    """Mean and 95 % interval of the figures (n,) of episodes 0, 1, … that take turns on so many random seas.

    `Scenario.random_seas` has their number.
    """
    moments = Moments(1, seas)
    moments.add(np.asarray(values, np.float64)[:, None])
    return moments.estimate(0)


def words(value: Estimate, sign: bool = False) -> str:
    """Mean ± half of the interval with two digits; without an interval the mean with three, or a whole number.

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


RANKED = ("arps", "delivered_mbit", "target_distance")  # figures of which all pairs are compared
LEAST_EPISODES = 64  # before an interval is believed to be short


def _more_and_less(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.maximum(values, 0.0), np.maximum(-values, 0.0)


def _difference(moments: Moments, place: int, parts: tuple[int, int], name: str) -> Estimate:
    """Mean and interval of a difference, whose parts above and below 0 stand at other places."""
    found = moments.estimate(place)
    if name not in COUNTS:
        return found
    return found._replace(half=max(found.half, math.hypot(*(moments.half_of_events(p, COUNTS[name]) for p in parts))))


class Comparison:
    """Means of all figures, differences to one combination, and the first episodes of each."""

    def __init__(
        self,
        combinations: Sequence[Combination],
        reference: Combination | None = None,
        kept: int = 0,
        seas: int = 0,
        ranked: Sequence[str] = RANKED,
    ) -> None:
        self.combinations = tuple(combinations)
        self.seas = seas  # random ones among which episodes alternate; 0: each has its own, or all are alike
        self.reference = reference or self.combinations[0]  # the others are compared with it
        # Energy, Wh, and data, Mbit, of the first `kept` episodes of each, for a figure.
        self.points: dict[Combination, list[tuple[float, float]]] = {which: [] for which in self.combinations}
        self.episodes = 0  # of each
        self.of_task: tuple[str, ...] = ()  # names of the figures that belong to the task
        self._kept = kept
        self._first, self._second = np.triu_indices(len(self.combinations), 1)  # of each pair
        self._pairs = {name: Moments(3 * len(self._first), seas) for name in ranked}  # difference, more, less
        self._places: dict[str, int] = {}
        self._counts: list[str] = []
        self._scores: dict[Combination, Moments] = {}
        self._differences: dict[Combination, Moments] = {}  # of counts also what is more and what is less

    def add(self, batch: Mapping[Combination, Sequence[Mapping[str, Any]]]) -> None:
        """Add rows of the CSV, with the same episodes in the same order for every combination."""
        rows = batch[self.reference]
        if not self._places:
            self.of_task = tuple(name for name in rows[0] if name not in COLUMNS)
            self._places = {name: place for place, name in enumerate((*FIGURES, *self.of_task))}
            self._counts = [name for name in COUNTS if name in self._places]
            self._scores = {which: Moments(len(self._places), self.seas) for which in self.combinations}
            count = len(self._places) + 2 * len(self._counts)
            self._differences = {which: Moments(count, self.seas) for which in self.combinations}
        values = {which: np.array([[float(row[n]) for n in self._places] for row in batch[which]]) for which in batch}
        drawn = [self._places[name] for name in ("energy_wh", "delivered_mbit")]
        counts = [self._places[name] for name in self._counts]
        for which, found in values.items():
            self._scores[which].add(found)
            less = found - values[self.reference]
            self._differences[which].add(np.hstack([less, *_more_and_less(less[:, counts])]))
            points = self.points[which]
            points += [tuple(row) for row in found[: self._kept - len(points), drawn].tolist()]
        for name, moments in self._pairs.items():
            of_each = np.stack([values[which][:, self._places[name]] for which in self.combinations], axis=1)
            less = of_each[:, self._first] - of_each[:, self._second]
            moments.add(np.hstack([less, *_more_and_less(less)]))
        self.episodes += len(rows)

    def score(self, which: Combination, name: str) -> Estimate:
        """Mean and interval of a figure over the episodes that have it."""
        moments, place = self._scores[which], self._places[name]
        found = moments.estimate(place)
        return found._replace(half=moments.half_of_events(place, COUNTS[name])) if name in COUNTS else found

    def deviation(self, which: Combination, name: str) -> float:
        """Standard deviation of a figure over the episodes that have it."""
        return self._scores[which].deviation(self._places[name])

    def difference(self, which: Combination, name: str) -> Estimate:
        """Mean and interval of a figure minus the reference's in the same world, over worlds where both have it."""
        moments, place = self._differences[which], self._places[name]
        if name not in COUNTS or which == self.reference:
            return moments.estimate(place)
        more = len(self._places) + self._counts.index(name)
        return _difference(moments, place, (more, more + len(self._counts)), name)

    def apart(self, one: Combination, other: Combination, name: str) -> Estimate:
        """Mean and interval of a ranked figure of one combination minus that of another, over worlds with both."""
        places = self.combinations.index(one), self.combinations.index(other)
        count = len(self._first)
        pair = int(np.flatnonzero((self._first == min(places)) & (self._second == max(places)))[0])
        found = _difference(self._pairs[name], pair, (count + pair, 2 * count + pair), name)
        return found if places[0] < places[1] else found._replace(mean=-found.mean)

    def half(self, name: str) -> float:
        """Half of the widest interval of a difference; with one combination, of its mean.

        ∞: there is none, or one of length 0: values that are all equal so far do not show how much others may differ.
        """
        others = [which for which in self.combinations if which != self.reference]
        halves = [self.difference(which, name).half for which in others] or [self.score(self.reference, name).half]
        return max(half if half > 0 else math.inf for half in halves)

    def floor(self, name: str) -> float:
        """Limit of `half` with many more episodes on the same seas; 0 while it is unknown."""
        if self.episodes < max(LEAST_EPISODES, 2 * self.seas):
            return 0.0
        return max(moments.floor(self._places[name]) for moments in self._decisive)

    def effective(self, name: str) -> float:
        """Number of episodes, each on its own sea, as precise for a figure; the least of all combinations."""
        return min(moments.effective(self._places[name]) for moments in self._scores.values())

    @property
    def _decisive(self) -> list[Moments]:
        others = [which for which in self.combinations if which != self.reference]
        return [self._differences[which] for which in others] or [self._scores[self.reference]]

    def reached(self, name: str, half: float) -> bool:
        """Whether these intervals are at most ± `half`, from enough episodes."""
        return self.episodes >= LEAST_EPISODES and self.half(name) <= half
