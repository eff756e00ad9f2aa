"""The folder of a report, `index.html`, which holds all that it shows, and its figures as PDF; and recorded missions
that play in a cell of a notebook.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup

from usvauv.cli import tables
from usvauv.cli.evaluation.comparison import Comparison, dependence, headline, labels, sentences, words
from usvauv.cli.web_report import document, figures
from usvauv.cli.web_report.episodes import Recordings, collects_data, front_episodes, player_data, thinned
from usvauv.env.record.trace import Trace
from usvauv.env.render.plain_matplotlib import Figure
from usvauv.env.scenario import Scenario
from usvauv.env.storage.tables import Combination
from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError

SHARE = 4  # of the data of a report's player, that of a cell has one part in so many
WIDE = 640  # px
TALL = 900  # px, until the page in it says how tall it is
FRAME = Markup('<iframe title="{}" srcdoc="{}" style="width:100%;max-width:{}px;height:{}px;border:0"></iframe>')


class Cell(NamedTuple):
    """A figure of a combination in words, and its difference to the first combination's, empty for that one.

    Attributes:
        few: number of episodes that have the figure, where not all have it.
        excludes_zero: whether the interval of the difference does.
    """

    mean: str
    few: int | None
    difference: str
    excludes_zero: bool


def write(
    folder: Path,
    scenario: Scenario,
    seed: int,
    comparison: Comparison,
    recordings: Recordings,
    score: str | None = None,
) -> Path:
    """Write the PDFs, then the page; each file appears only when it is complete.

    Args:
        folder: which is there.
        scenario: what was run, but for the target rule.
        seed: of the worlds.
        comparison: of all combinations, with the points of their first `front_episodes`.
        recordings: of the same evaluation.
        score: figure of the sentences in the head, by default `headline`.

    Returns:
        The page.

    Raises:
        OutputError: a file cannot be written.
    """
    several, score = comparison.combinations, score or headline(scenario)
    return document.write(
        folder,
        "web_report/page.html",
        f"{scenario.name}: evaluation by usvauv",
        {
            "summary": "The scenario as TOML; boat strategy and target rule are those of each combination",
            "text": scenario.to_toml(),
        },
        arch=runtime.start().arch,
        script=Markup(document.text("web_report/player.js")),
        scenario=scenario,
        count=comparison.episodes,
        combinations=len(several),
        seed=seed,
        sentences=sentences(comparison, score),
        dependence=dependence(comparison, score),
        reference=" · ".join(filter(None, comparison.reference)),
        tables=_tables(comparison, scenario),
        pictures=document.pictures(folder, _figures(comparison, scenario, recordings)),
        player=document.json_for_script(_player(scenario, recordings)),
        shown=next(iter(recordings.values())).episode,
        omitted=len(several) - len(recordings),
    )


def _tables(comparison: Comparison, scenario: Scenario) -> list[dict[str, Any]]:
    """Tables of scores: title, columns, and rows of a combination and its cells."""
    return [
        {
            "title": title,
            "columns": found,
            "rows": [
                {"combination": which, "cells": [_cell(comparison, which, column.name) for column in found]}
                for which in comparison.combinations
            ],
        }
        for title, found in tables.column_tables(scenario, comparison.of_task).items()
        if found
    ]


def _cell(comparison: Comparison, which: Combination, name: str) -> Cell:
    score, less = comparison.score(which, name), comparison.difference(which, name)
    return Cell(
        words(score),
        score.n if 0 < score.n < comparison.episodes else None,
        "" if which == comparison.reference else words(less, sign=True),
        abs(less.mean) > less.half,
    )


def _figures(comparison: Comparison, scenario: Scenario, recordings: Recordings) -> list[tuple[str, Figure, str, str]]:
    """The figures that the task has, as `document.pictures` takes them."""
    names = labels(comparison.combinations)[: len(recordings)]
    recorded, steps = list(recordings.values()), scenario.mission.steps
    drawn, points = front_episodes(len(comparison.combinations)), len(recorded[0].episode.tracks[0])
    some = f", the first {drawn} of each" if drawn < comparison.episodes else ""
    thinned = f"; each way is drawn through {points} of {steps} points" if points < steps else ""
    made = [
        (
            "errors",
            figures.errors(names, recorded, steps * scenario.mission.step),
            "Errors of positions and fixes",
            "Left: of the boat's estimates of the AUVs' positions, at each step; right: of usable fixes. Of all"
            " episodes. Above: the median in each hundredth of the mission, and for the first combination a band that"
            " holds 90 %. Below: the share with a smaller error, which is known to 6 %.",
        ),
        (
            "trajectories",
            figures.trajectories(names, recorded, scenario),
            "Tracks of AUVs and boat",
            f"The first episode, world 0, the same for all{thinned}.",
        ),
    ]
    if not collects_data(scenario):
        return made
    front = (
        "front",
        figures.front(names, comparison),
        "Data and energy",
        f"Small and faint: episodes{some}; large: their means with 95 % intervals. Better is further up and left.",
    )
    ages = (
        "ages",
        figures.ages(names, recorded, scenario),
        "Age of data by node",
        "Mean age of the data of each node over the first episode; older data are drawn larger and stronger.",
    )
    return [front, *made, ages]


def _player(scenario: Scenario, recordings: Recordings) -> dict[str, Any]:
    names = labels(list(recordings))
    return player_data(scenario, names, [recording.episode for recording in recordings.values()])


@dataclass(frozen=True)
class Player:
    """What a cell of a notebook shows of recorded missions: world 0 of each. The page in it needs nothing else.

    Attributes:
        traces: to choose from, of missions in one area.
    """

    traces: tuple[Trace, ...] = field(repr=False)

    def _repr_html_(self) -> str:
        scenario = self.traces[0].scenario
        episodes = [thinned(trace, SHARE * len(self.traces)) for trace in self.traces]
        names = labels([Combination(each.policy, each.usv, _rule(each)) for each in self.traces])
        player = document.json_for_script(player_data(scenario, names, episodes))
        page = document.filled(
            "web_report/cell.html",
            policy=document.NOTHING_EXTERNAL,
            style=document.style(),
            player=document.block("web_report/page.html", "player", player=player, shown=episodes[0]),
            script=Markup(document.text("web_report/player.js")),
        )
        return FRAME.format(f"{scenario.name}: {', '.join(names)}", page, WIDE, TALL)


def play(*traces: Trace) -> Player:
    """Recorded missions as a player in a notebook: boat, AUVs, nodes and estimates, as in the page of `usvauv eval`.

    In IPython a trace that ends a cell is shown so by itself.

    Args:
        traces: one, or several to choose from, such as of the same world with different strategies.

    Raises:
        UserError: there is none, or their areas differ.
    """
    areas = {(each.scenario.area.width, each.scenario.area.length, each.scenario.current.period) for each in traces}
    if len(areas) != 1:
        raise UserError(f"traces: of {len(areas)} areas; must be of one")
    return Player(traces)


def _rule(trace: Trace) -> str:
    return trace.scenario.nodes.target_rule if collects_data(trace.scenario) else ""
