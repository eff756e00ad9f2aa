"""What is known of combinations of policy, boat strategy and target rule while their episodes come in.

All combinations run in the same worlds, so the difference of two is taken episode by episode: what the worlds have in
common cancels. Kept are sums, whose size does not grow with the number of episodes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from usvauv.cli.evaluation.estimates import Estimate, Moments
from usvauv.env.record.growing_table import Combination
from usvauv.env.record.metrics import COLUMNS, FIGURES

LEAST_EPISODES = 64  # before an interval is believed to be short


class Comparison:
    """Means of all figures, differences to one combination, and the first episodes of each.

    Attributes:
        combinations: in order.
        reference: what the others are compared with.
        points: energy, Wh, and data, Mbit, of the first `kept` episodes of each, for a figure.
        episodes: of each.
        of_task: names of the figures that belong to the task.
    """

    def __init__(
        self, combinations: Sequence[Combination], reference: Combination | None = None, kept: int = 0
    ) -> None:
        self.combinations = tuple(combinations)
        self.reference = reference or self.combinations[0]
        self.points: dict[Combination, list[tuple[float, float]]] = {which: [] for which in self.combinations}
        self.episodes = 0
        self.of_task: tuple[str, ...] = ()
        self._kept = kept
        self._places: dict[str, int] = {}
        self._scores: dict[Combination, Moments] = {}
        self._differences: dict[Combination, Moments] = {}

    def add(self, batch: Mapping[Combination, Sequence[Mapping[str, Any]]]) -> None:
        """Take rows of the CSV, of the same episodes in the same order for every combination."""
        rows = batch[self.reference]
        if not self._places:
            self.of_task = tuple(name for name in rows[0] if name not in COLUMNS)
            self._places = {name: place for place, name in enumerate((*FIGURES, *self.of_task))}
            self._scores = {which: Moments(len(self._places)) for which in self.combinations}
            self._differences = {which: Moments(len(self._places)) for which in self.combinations}
        values = {which: np.array([[float(row[n]) for n in self._places] for row in batch[which]]) for which in batch}
        drawn = [self._places[name] for name in ("energy_wh", "delivered_mbit")]
        for which, found in values.items():
            self._scores[which].add(found)
            self._differences[which].add(found - values[self.reference])
            points = self.points[which]
            points += [tuple(row) for row in found[: self._kept - len(points), drawn].tolist()]
        self.episodes += len(rows)

    def score(self, which: Combination, name: str) -> Estimate:
        """Mean and interval of a figure over the episodes that have it."""
        return self._scores[which].estimate(self._places[name])

    def deviation(self, which: Combination, name: str) -> float:
        """Standard deviation of a figure over the episodes that have it."""
        return self._scores[which].deviation(self._places[name])

    def difference(self, which: Combination, name: str) -> Estimate:
        """Mean and interval of a figure less the reference's in the same world, over worlds where both have it."""
        return self._differences[which].estimate(self._places[name])

    def half(self, name: str) -> float:
        """Half of the widest interval of a difference, of one combination alone that of its mean.

        ∞: there is none, or one of length 0. Values that are all equal so far do not tell how much others may differ.
        """
        others = [which for which in self.combinations if which != self.reference]
        found = [self.difference(which, name) for which in others] or [self.score(self.reference, name)]
        return max(estimate.half if estimate.half > 0 else math.inf for estimate in found)

    def reached(self, name: str, half: float) -> bool:
        """Whether these intervals are at most ± `half`, of enough episodes."""
        return self.episodes >= LEAST_EPISODES and self.half(name) <= half


def labels(combinations: Sequence[Combination]) -> list[str]:
    """Short names: of each combination the parts that differ among all, the policy if nothing does."""
    differ = [len(set(parts)) > 1 for parts in zip(*combinations, strict=True)]
    differ[0] |= not any(differ)
    return [" · ".join(p for p, shown in zip(parts, differ, strict=True) if shown and p) for parts in combinations]
