"""The folder of a report: the self-contained page `index.html`, and its figures as PDF; and a player of recorded
missions in a notebook's cell.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from usvauv.cli.evaluation.comparison import Comparison, words
from usvauv.cli.evaluation.comparison_tables import COLUMNS, column_tables, dependence, headline, labels
from usvauv.cli.evaluation.ranking import FEW, ahead, ranked
from usvauv.cli.web_report import document
from usvauv.cli.web_report.document import INK, MUTED, colour, dash, marker
from usvauv.cli.web_report.episodes import (
    ERRORS,
    PERIODS,
    Recording,
    Recordings,
    collects_data,
    combination_of,
    error_quantiles,
    front_episodes,
    player_data,
    thinned,
)
from usvauv.cli.web_report.maps import trajectories
from usvauv.cli.web_report.multiples import ages, errors_of_each
from usvauv.env.record.trace import Trace
from usvauv.env.render.figures import Figure, WrittenOut
from usvauv.env.scenario import Scenario
from usvauv.env.storage.result_tables import Combination
from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError

NEAR = 0.005  # difference of means that share a label, of each
SHARE = 4  # of the data of a report's player, that of a cell has one part in so many
WIDE = 640  # px
TALL = 900  # px, until the page in it says how tall it is
FRAME = Markup('<iframe title="{}" srcdoc="{}" style="width:100%;max-width:{}px;height:{}px;border:0"></iframe>')


def write(
    folder: Path,
    scenario: Scenario,
    seed: int,
    comparison: Comparison,
    recordings: Recordings,
    score: str | None = None,
) -> Path:
    """Write the PDFs, then the page; each file appears only when it is complete."""
    several, score = comparison.combinations, score or headline(scenario)
    order = ranked(comparison, score) if len(several) > FEW else several
    recorded = {which: recordings[which] for which in order if which in recordings}
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
        sentences=ahead(comparison, score),
        ranks=_ranks(comparison, order, score) if len(several) > FEW else None,
        dependence=dependence(comparison, score),
        reference=" · ".join(filter(None, comparison.reference)),
        tables=_tables(comparison, scenario),
        pictures=document.pictures(folder, _figures(comparison, scenario, recorded)),
        player=document.json_for_script(
            player_data(scenario, list(_names(comparison, recorded)), [each.episode for each in recorded.values()])
        ),
        shown=next(iter(recorded.values())).episode,
        omitted=len(several) - len(recorded),
    )


def _names(comparison: Comparison, recordings: Iterable[Combination]) -> Iterator[str]:
    """Short names of those recorded, of many after their rank."""
    short = dict(zip(comparison.combinations, labels(comparison.combinations), strict=True))
    many = len(short) > FEW
    return (f"{rank} {short[which]}" if many else short[which] for rank, which in enumerate(recordings, 1))


def _ranks(comparison: Comparison, order: Sequence[Combination], score: str) -> dict[str, Any]:
    """The table of ranks: headings, and rows of a combination, its mean of the score, its difference to the best, and
    both of the reward per step.
    """
    names = list(dict.fromkeys((score, "arps")))
    rows = []
    for which in order:
        row: dict[str, Any] = {"combination": which, "cells": []}
        for name in names:
            less = comparison.apart(which, order[0], name) if which != order[0] else None
            clear = less is not None and abs(less.mean) > less.half
            difference = words(less, sign=True) if less else ""
            row["cells"].append(
                {"mean": words(comparison.score(which, name)), "difference": difference, "excludes_zero": clear}
            )
        rows.append(row)
    return {"headings": [COLUMNS[name].heading if name in COLUMNS else name for name in names], "rows": rows}


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
        for title, found in column_tables(scenario, comparison).items()
        if found
    ]


def _cell(comparison: Comparison, which: Combination, name: str) -> dict[str, Any]:
    """A figure of a combination, of how many episodes where not all have it, and its difference to the reference's."""
    score, less = comparison.score(which, name), comparison.difference(which, name)
    return {
        "mean": words(score),
        "few": score.n if 0 < score.n < comparison.episodes else None,
        "difference": "" if which == comparison.reference else words(less, sign=True),
        "excludes_zero": abs(less.mean) > less.half,
    }


def _figures(
    comparison: Comparison, scenario: Scenario, recordings: Mapping[Combination, Recording]
) -> Iterator[document.Drawn]:
    """The figures that the task has, as `document.pictures` takes them."""
    names, many = list(_names(comparison, recordings)), len(comparison.combinations) > FEW
    recorded, steps = list(recordings.values()), scenario.mission.steps
    drawn, points = front_episodes(len(comparison.combinations)), len(recorded[0].episode.tracks[0])
    some = f"episodes, the first {drawn} of each" if drawn < comparison.episodes else "episodes"
    thinned = f"; each way is drawn through {points} of {steps} points" if points < steps else ""
    if collects_data(scenario):
        about = (
            "Means with 95 % intervals, by their ranks."
            if many
            else (f"Small and faint: {some}; large: their means with 95 % intervals.")
        )
        shown = list(recordings)
        draw = partial(front_of_many, shown, comparison) if many else partial(front, names, shown, comparison)
        yield "front", draw, "Data and energy", f"{about} Better is further up and left."
    kinds = ("targets", "positions") if recorded[0].targets.any() else ("positions", "fixes")
    if many:
        about = f"Of {ERRORS_OF[kinds[0]]} over the mission, of all episodes: the median in each"
        about += " hundredth, and a band that holds 90 %. Grey: the median of the first."
        draw = partial(errors_of_each, names, recorded, steps * scenario.mission.step, kinds[0])
        yield "errors", draw, f"Errors of {kinds[0]}", about
    else:
        yield _errors_of_few(names, recorded, steps * scenario.mission.step, kinds)
    ways = " Thin and grey: the ways of the targets." if recorded[0].episode.targets else ""
    about = f"The first episode, world 0, the same for all{thinned}.{ways}"
    yield "trajectories", partial(trajectories, names, recorded, scenario), "Tracks of AUVs and boat", about
    if collects_data(scenario):
        about = "Of the nodes in the first episode: the median age of their data, and a band that holds 80 % of them."
        if len(names) > 1:
            about += " Grey: the median of the first."
        yield "ages", partial(ages, names, recorded), "Age of data", about


ERRORS_OF = {
    "targets": "the team's estimates of targets",
    "positions": "the boat's estimates of the AUVs' positions",
    "fixes": "usable fixes",
}


def _errors_of_few(
    names: Sequence[str], recorded: Sequence[Recording], duration: float, kinds: tuple[str, str]
) -> document.Drawn:
    left, right = (ERRORS_OF[kind] for kind in kinds)
    about = (
        f"Left: of {left}, at each step; right: of {right}. Of all episodes."
        " Above: the median in each hundredth of the mission, and for the first combination a band that holds 90 %."
        " Below: the share with a smaller error, which is known to 6 %."
    )
    return "errors", partial(errors, names, recorded, duration, kinds), f"Errors of {kinds[0]} and {kinds[1]}", about


@dataclass(frozen=True)
class Player:
    """A notebook cell's view of recorded missions: world 0 of each. The page in it is self-contained.

    Attributes:
        traces: to choose from, of missions in one area.
    """

    traces: tuple[Trace, ...] = field(repr=False)

    def _repr_html_(self) -> str:
        scenario = self.traces[0].scenario
        episodes = [thinned(trace, SHARE * len(self.traces)) for trace in self.traces]
        names = labels([combination_of(each) for each in self.traces])
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

    IPython shows a trace that ends a cell automatically.

    Args:
        traces: one, or several to choose from, for example of the same world with different strategies.

    Raises:
        UserError: no traces, or their areas differ.
    """
    areas = {(each.scenario.area.width, each.scenario.area.length, each.scenario.current.period) for each in traces}
    if len(areas) != 1:
        raise UserError(f"traces: of {len(areas)} areas; must be of one")
    return Player(traces)


def front_of_many(shown: Sequence[Combination], comparison: Comparison) -> Figure:
    """Data over energy: means with their intervals, and the ranks at each place."""
    figure = document.new(3.0)
    axes = figure.add_subplot()
    look = {"fmt": "o", "color": colour(0), "ms": 3.5, "ecolor": MUTED, "elinewidth": 0.6}
    ranks: dict[tuple[float, float], list[str]] = {}
    for rank, which in enumerate(shown, 1):
        energy, data = (comparison.score(which, column) for column in ("energy_wh", "delivered_mbit"))
        halves = (data.half, energy.half) if energy.n > 1 else (None, None)
        axes.errorbar(energy.mean, data.mean, *halves, **look)
        place = energy.mean, data.mean
        near = (at for at in ranks if np.allclose(at, place, rtol=NEAR))
        ranks.setdefault(next(near, place), []).append(str(rank))
    for place, names in ranks.items():
        axes.annotate(", ".join(names), place, (3, 3), textcoords="offset points", fontsize=7)
    axes.set(xlabel="energy of all AUVs, Wh", ylabel="data collected, Mbit")
    document.style_axes(axes)
    return figure


def front(names: Sequence[str], shown: Sequence[Combination], comparison: Comparison) -> Figure:
    """Data over energy: the episodes of `points` of each combination faint, means with their intervals."""
    figure = document.new(2.5, document.points(names, 5))
    axes = figure.add_subplot()
    for i, which in enumerate(shown):
        energy, data = (comparison.score(which, column) for column in ("energy_wh", "delivered_mbit"))
        axes.plot(*zip(*comparison.points[which], strict=True), marker(i), color=colour(i), ms=2.6, alpha=0.35, mew=0)
        if energy.n > 1:
            axes.errorbar(
                energy.mean, data.mean, data.half, energy.half, fmt="none", color=colour(i), elinewidth=1.2,
                capsize=2, zorder=5 + i,
            )  # fmt: skip
        size = 8 - 3 * i / len(names)  # equal means lie upon each other
        axes.plot(energy.mean, data.mean, marker(i), color=colour(i), ms=size, mec=INK, mew=0.6, zorder=5 + i)
    axes.set(xlabel="energy of all AUVs, Wh", ylabel="data collected, Mbit")
    document.style_axes(axes)
    return figure


def errors(names: Sequence[str], recordings: Sequence[Recording], duration: float, kinds: tuple[str, str]) -> Figure:
    """Errors of two kinds, attributes of the recordings, side by side: over time, the median and of the first
    combination what holds 90 %, and their distribution.
    """
    figure = document.new(3.6, document.lines(names))
    plots = figure.subplots(2, 2, sharex="row", sharey="row")
    time = (np.arange(PERIODS) + 0.5) / PERIODS * duration
    reach = []
    for column, kind in enumerate(kinds):
        over_time, whole = plots[:, column]
        over_time.set_title(kind, loc="left", pad=3)
        for i, recording in enumerate(recordings):
            counts = getattr(recording, kind)
            low, median, high = error_quantiles(counts, (0.05, 0.5, 0.95))
            if i == 0:
                over_time.fill_between(time, low, high, color=colour(0), alpha=0.18, lw=0)
            over_time.plot(time, median, color=colour(i), ls=dash(i))
            count = counts.sum(axis=0)
            if count.any():
                whole.plot(ERRORS[1:], np.cumsum(count) / count.sum(), color=colour(i), ls=dash(i))
                reach += list(error_quantiles(count, (0.0005, 0.9995)))
        over_time.set(xlabel="time, s", xlim=(0, duration), yscale="log")
        whole.set(xlabel="error, m", ylim=(0, 1.02), xscale="log", xlim=(min(reach), max(reach) * 1.06))
        for axis in (over_time.yaxis, whole.xaxis):
            axis.set_major_formatter(WrittenOut())
            axis.set_minor_formatter(WrittenOut())
    plots[0, 0].set_ylabel("error, m")
    plots[1, 0].set_ylabel("share below it")
    for axes in plots.ravel():
        document.style_axes(axes)
    return figure
