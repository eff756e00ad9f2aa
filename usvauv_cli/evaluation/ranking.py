"""Which of several combinations is best: their order by a figure, and sentences on who is ahead."""

from __future__ import annotations

import math
from collections.abc import Sequence

from usvauv.cli.evaluation.comparison import Comparison
from usvauv.cli.evaluation.comparison_tables import COLUMNS, labels, phrase, sentences
from usvauv.env.storage.result_tables import Combination

FEW = 3  # combinations, each of which has a sentence of its own


def ranked(comparison: Comparison, name: str) -> list[Combination]:
    """The combinations from the best mean of a figure to the worst; those without the figure come last."""
    sign = 1 if name in COLUMNS and COLUMNS[name].better == "less" else -1

    def place(which: Combination) -> float:
        mean = comparison.score(which, name).mean
        return math.inf if math.isnan(mean) else sign * mean

    return sorted(comparison.combinations, key=place)


def within_chance(comparison: Comparison, best: Combination, name: str) -> list[Combination]:
    """The others whose paired difference to one has an interval with 0."""
    others = [which for which in comparison.combinations if which != best]
    found = ((which, comparison.apart(which, best, name)) for which in others)
    return [which for which, less in found if abs(less.mean) <= less.half]


def named_figures(comparison: Comparison, score: str) -> Sequence[str]:
    """The score, and the reward where another combination than the best in the score earns more beyond chance."""
    best, earning = (ranked(comparison, name)[0] for name in (score, "arps"))
    less = comparison.apart(earning, best, "arps") if earning != best else None
    return (score, "arps") if less and abs(less.mean) > less.half else (score,)


def ahead(comparison: Comparison, score: str) -> list[str]:
    """Who is ahead, by each of `named_figures`: a sentence on each of few combinations, or one on the best of many."""
    names = named_figures(comparison, score) if len(comparison.combinations) > 1 else ()
    if len(comparison.combinations) <= FEW:
        return [said for name in names for said in sentences(comparison, name)]
    return [_best(comparison, name) for name in names]


def _best(comparison: Comparison, name: str) -> str:
    best = ranked(comparison, name)[0]
    label = labels(comparison.combinations)[comparison.combinations.index(best)]
    if math.isnan(comparison.score(best, name).half):
        return f"{phrase(name)}: best is {label}, without an interval"
    count = len(within_chance(comparison, best, name))
    others = f"{count} others are" if count > 1 else "1 other is" if count else "no other is"
    return f"{phrase(name)}: best is {label}; {others} within chance of it"
