"""The folder of a report: `index.html`, which holds all that it shows, and its figures as PDF."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup

from kernels import runtime
from usvauv_cli.web_report import columns, document, figures, scores
from usvauv_cli.web_report.player import player_data
from usvauv_cli.web_report.recordings import Recordings, collects_data
from usvauv_cli.web_report.scores import Combination, Episodes
from usvauv_env.record.metrics import EpisodeMetrics
from usvauv_env.scenario import Scenario

FRONT_EPISODES = 2400  # points of episodes in the figure of the front


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


def write(folder: Path, scenario: Scenario, rows: Sequence[EpisodeMetrics], recordings: Recordings) -> Path:
    """Write the PDFs, then the page; each file appears only when it is complete.

    Args:
        folder: which is there.
        scenario: what was run, but for the target rule.
        rows: of all combinations.
        recordings: of the same evaluation.

    Returns:
        The page.

    Raises:
        OutputError: a file cannot be written.
    """
    episodes = scores.by_combination(rows)
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
        count=max(len(found) for found in episodes.values()),
        combinations=len(episodes),
        seed=rows[0].seed,
        reference=" · ".join(filter(None, next(iter(episodes)))),
        tables=_tables(episodes, scenario, list(rows[0].of_task)),
        pictures=_pictures(episodes, scenario, recordings, folder),
        player=Markup(_json(_player(scenario, recordings))),
        shown=next(iter(recordings.values())).episode,
        omitted=len(episodes) - len(recordings),
    )


def _json(data: Any) -> str:
    """JSON that does not end the script element it stands in."""
    return json.dumps(data, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")


def _tables(
    episodes: Mapping[Combination, Episodes], scenario: Scenario, of_task: Collection[str]
) -> list[dict[str, Any]]:
    """Tables of scores: title, columns, and rows of a combination and its cells."""
    nodes = collects_data(scenario)
    return [
        {
            "title": title,
            "columns": found,
            "rows": [
                {"combination": which, "cells": [_cell(own, episodes, column.name) for column in found]}
                for which, own in episodes.items()
            ],
        }
        for title, found in columns.tables(nodes, of_task).items()
        if found
    ]


def _cell(own: Episodes, episodes: Mapping[Combination, Episodes], name: str) -> Cell:
    reference = next(iter(episodes.values()))
    score, less = scores.score(own, name), scores.difference(own, reference, name)
    return Cell(
        scores.words(score),
        score.n if 0 < score.n < len(own) else None,
        "" if own is reference else scores.words(less, sign=True),
        abs(less.mean) > less.half,
    )


def _pictures(
    episodes: Mapping[Combination, Episodes], scenario: Scenario, recordings: Recordings, folder: Path
) -> list[document.Picture]:
    """The figures that the task has; their PDFs are written."""
    names = scores.labels(list(episodes))[: len(recordings)]
    scored, recorded = list(episodes.values())[: len(names)], list(recordings.values())
    nodes = collects_data(scenario)
    drawn = max(FRONT_EPISODES // len(names), 1)
    duration = scenario.mission.steps * scenario.mission.step
    points = len(recorded[0].episode.tracks[0])
    made: list[document.Picture] = []

    def add(*parts: Any) -> None:
        made.append(document.picture(folder, *parts))

    if nodes:
        some = f", the first {drawn} of each" if drawn < max(map(len, scored)) else ""
        add(
            "front",
            figures.front(names, scored, drawn),
            "Data and energy",
            figures.about_front(names, scored),
            f"Small and faint: episodes{some}; large: their means with 95 % intervals. Better is further up and left.",
        )
    if any(recording.fixes.any() for recording in recorded):
        add(
            "errors",
            figures.errors(names, recorded, duration),
            "Errors of fixes",
            figures.about_errors(names, recorded),
            "Of all usable fixes of all episodes. Above: the median in each hundredth of the mission, and for the"
            " first combination a band that holds 90 %. Below: the share of fixes with a smaller error, which is known"
            " to 6 %.",
        )
    steps = scenario.mission.steps
    thinned = f"; each way is drawn through {points} of {steps} points" if points < steps else ""
    add(
        "trajectories",
        figures.trajectories(names, recorded, scenario),
        "Ways of AUVs and boat",
        f"Maps of {scenario.area.width:g} by {scenario.area.length:g} m for {', '.join(names)}.",
        f"The first episode, world 0, the same for all{thinned}.",
    )
    if nodes:
        add(
            "ages",
            figures.ages(names, recorded, scenario),
            "Age of data by node",
            figures.about_ages(names, recorded),
            "Mean age of the data of each node over the first episode; older data are drawn larger and stronger.",
        )
    return made


def _player(scenario: Scenario, recordings: Recordings) -> dict[str, Any]:
    names = scores.labels(list(recordings))
    return player_data(scenario, names, [recording.episode for recording in recordings.values()])
