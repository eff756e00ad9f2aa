"""Differences between combinations in words: which of two has more of a figure, by how much, and whether by chance."""

from __future__ import annotations

import math

from usvauv.cli.evaluation.comparison import Comparison, Estimate, labels, words
from usvauv.cli.tables import COLUMNS, POSITIONS
from usvauv.cli.words import counted
from usvauv.env.scenario import Scenario

HEADLINES = {"data-collection": "delivered_mbit", "station-keeping": "target_distance"}  # by task; of others ARPS
PHRASES = {
    "arps": ("reward per step", "{one} earns {by} {way} reward per step than {other}", "more", "less"),
    "delivered_mbit": ("data", "{one} brings in {by} Mbit {way} than {other}", "more", "less"),
    "energy_wh": ("energy", "{one} uses {by} Wh {way} than {other}", "more", "less"),
    "target_distance": (
        "distance to stations",
        "{one} keeps {by} m {way} its stations than {other}",
        "farther from",
        "nearer to",
    ),
}  # of a figure: what it is, a sentence, and the words for a positive and for a negative difference


def headline(scenario: Scenario) -> str:
    """The figure by which combinations are compared first: the data brought in, or the distance to the stations."""
    return HEADLINES.get(scenario.task, "arps")


def sentence(less: Estimate, one: str, other: str, name: str, alone: str = "fewer than two seas: no interval") -> str:
    """A difference as a sentence: "belief brings in 30 ± 9 Mbit more than fim".

    Args:
        less: the figure of `one` less that of `other` in the same worlds, with its interval. Where that holds 0 there
            is no difference beyond chance.
        one, other: what is compared.
        name: of the figure, a column of the CSV.
        alone: what is said where several worlds have no interval.
    """
    what, phrase, *ways = PHRASES.get(name) or _plain(name)
    if not less.n:
        return f"{what}: no world has it for both {one} and {other}"
    if less.mean == 0 and less.half == 0:
        return f"{what}: {one} and {other} are equal in every world"
    if abs(less.mean) <= less.half:
        unit = COLUMNS[name].heading.partition(", ")[2] if name in COLUMNS else ""
        return (
            f"{what}: no difference beyond chance between {one} and {other} ({words(less, sign=True)} {unit}".rstrip()
            + ")"
        )
    said = phrase.format(one=one, other=other, by=words(less._replace(mean=abs(less.mean))), way=ways[less.mean < 0])
    if math.isnan(less.half):
        said += " (one world: no interval)" if less.n == 1 else f" ({alone})"
    return said if less.half != 0 else f"{said} in every world"


def _plain(name: str) -> tuple[str, str, str, str]:
    """The words of a figure that has none of its own; those of positions have headings that mean nothing alone."""
    column = COLUMNS.get(name)
    what, _, unit = column.heading.partition(", ") if column else (name, "", "")
    if column in POSITIONS:
        what = name.replace("_", " ")
    return (
        what,
        f"{what} is {{by}}{f' {unit}' if unit else ''} {{way}} with {{one}} than with {{other}}",
        "higher",
        "lower",
    )


def sentences(comparison: Comparison, name: str) -> list[str]:
    """A sentence on a figure of each combination but the reference."""
    short = dict(zip(comparison.combinations, labels(comparison.combinations), strict=True))
    return [
        sentence(comparison.difference(which, name), short[which], short[comparison.reference], name)
        for which in comparison.combinations
        if which != comparison.reference
    ]


def dependence(comparison: Comparison, name: str) -> str:
    """What it means for a figure that episodes share seas; empty where they do not."""
    effective = comparison.effective(name)
    if comparison.seas == 1 < comparison.episodes:
        return f"no intervals: all {comparison.episodes} episodes are on one sea, which says nothing of other seas"
    if not 0 < comparison.seas < comparison.episodes or effective > 0.95 * comparison.episodes:
        return ""
    shared = f"{comparison.episodes} episodes take turns on {counted(comparison.seas, 'sea')}"
    return f"{shared}: the mean of {name} is as certain as from {effective:.0f} episodes with a sea each"
