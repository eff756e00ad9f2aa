"""Data collected with each boat strategy, by range, ping interval, drift and number of boats, in the same worlds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from usvauv.cli.evaluation.comparison import interval
from usvauv.cli.reproduction.paper import Settings, markdown_table, picture_pair, rounded, spread, titled_figure
from usvauv.cli.sweep.run_folder import Piece
from usvauv.cli.sweep.study import Evaluation, StudyRun, define
from usvauv.env.render.figures import Figure, write_pair
from usvauv.env.render.style import Ground, looks
from usvauv.env.scenario import Scenario
from usvauv.env.storage.result_tables import write_rows

NAME = "collaboration"
WIDE = "wide"  # the scenario in which the boat's strategy decides
STEERING = "pace"
CENTRE = "hold:300,300"
STRATEGIES = (CENTRE, "centroid", "fim", "visit", "belief")
FIGURES = ("delivered_mbit", "aoi_mean", "own_error_rms", "own_error_p95", "fix_availability", "outage_longest")
SUMMARY = ("axis", "value", "boat", "episodes", "share", *FIGURES, "mbit95", "belief_more", "belief_more95")


@dataclass(frozen=True)
class Axis:
    """One thing that is varied."""

    name: str  # with its unit
    points: Mapping[float, tuple[str, ...]]  # value → changes of the scenario
    boats: tuple[str, ...] = STRATEGIES  # compared


def _level(decibel: int) -> tuple[str, ...]:
    return (f"acoustics.source_level={decibel}",)


BASE = _level(146)
NEAR = _level(144)
AXES = (
    Axis("slant range of replies, m", {170: NEAR, 210: BASE, 290: _level(149), 5600: _level(187)}),
    Axis(
        "time between pings at 210 m, s",
        {1.0: BASE} | {s: (*BASE, f"channel.interval={s:g}") for s in (10.0, 30.0)},
    ),
    Axis(
        "error of an AUV's velocity at 210 m, m/s",
        {s: (*BASE, f"navigation.velocity_bias={s}") for s in (0.03, 0.2)} | {0.1: BASE},
    ),
    Axis(
        "number of boats at 170 m",
        {1.0: NEAR} | {n: (*NEAR, f"boat.count={n:g}") for n in (2.0, 3.0, 4.0)},
        ("centroid", "fim", "visit", "belief"),
    ),
)
PERFECT = (
    "channel.schedule=every-step",
    "navigation.sensor=none",
    "acoustics.source_level=250",
    "acoustics.sound_speed_error=0",
    *(f"usbl.{name}_error=0" for name in ("attitude", "alignment", "heading", "lever_arm", "gnss")),
)


def missions(settings: Settings, boat: str, changes: tuple[str, ...]) -> Piece:
    """Episodes of `wide` with one strategy of the boat."""
    run = StudyRun(scenario=WIDE, set=(*settings.overrides, *changes), policy=STEERING, usv=boat)
    evaluation = Evaluation(episodes=settings.wide_episodes, seed=settings.test_seed)
    task = ", ".join(changes) if changes != PERFECT else "perfect fixes"
    return Piece(definition=define(run, evaluation, NAME), method=f"{STEERING}, boat {boat}", task=task)


def runs(settings: Settings) -> list[Piece]:
    """The runs that the figure needs."""
    found = [(boat, changes) for axis in AXES for changes in axis.points.values() for boat in axis.boats]
    return [missions(settings, *each) for each in dict.fromkeys([(CENTRE, PERFECT), *found])]


def points(settings: Settings, folder: Path) -> Iterator[dict[str, Any]]:
    """All points of all axes, from the rows of the episodes: a row of `SUMMARY` each.

    "share" is of the data that AUVs with perfect fixes collect; `FIGURES` are means over episodes; "belief_more" is
    the gain of `belief` in the same worlds, Mbit; "mbit95", "belief_more95" are half the width of intervals.
    """

    def columns(boat: str, changes: tuple[str, ...]) -> dict[str, np.ndarray]:
        rows = missions(settings, boat, changes).rows(folder)
        return {name: np.array([float(row[name]) for row in rows]) for name in FIGURES}

    seas = Scenario.load(WIDE, settings.overrides).random_seas
    most = columns(CENTRE, PERFECT)["delivered_mbit"].mean()
    for axis in AXES:
        for value, changes in sorted(axis.points.items()):
            best = columns("belief", changes)["delivered_mbit"]
            for boat in axis.boats:
                found = columns(boat, changes)
                data = found["delivered_mbit"]
                more = best - data
                means = [float(np.nanmean(values)) for values in found.values()]
                about = (axis.name, value, boat, len(data), float(data.mean() / most), *means)
                about += (interval(data, seas).half, float(more.mean()), interval(more, seas).half)
                yield dict(zip(SUMMARY, about, strict=True))


def make(settings: Settings, folder: Path, place: Path) -> list[str]:
    """Write collaboration.csv, a pair of .png, and .pdf; returns what the page has of it: a table for each axis."""
    found = list(points(settings, folder))
    write_rows(place / f"{NAME}.csv", SUMMARY, found)
    write_pair(place / f"{NAME}.png", partial(_draw, found), pdf=True)
    most = found[0]["delivered_mbit"] / found[0]["share"]
    head = ["", "boat", "Mbit", "of perfect", "gain of `belief`", "age, s", "own rms, p95, m", "fixes", "outage, s"]
    sections = [
        f"{found[0]['episodes']} episodes of `wide` for each, the same worlds for all; AUVs are steered by"
        f" `{STEERING}`. With perfect fixes they collect {rounded(most, 1)} Mbit. ± is half the 95 %"
        " interval of a mean, or of the mean difference in the same worlds. Age is that of information (mean over nodes"
        " and time), own the error of the AUVs' own position estimates, fixes the share of AUVs and seconds with a"
        " fix, outage the longest time in an episode that any AUV is without a fix.",
        picture_pair(NAME, "Data by the boat's strategy, range, ping interval, drift and number of boats"),
    ]
    for axis in AXES:
        rows = (
            [
                f"{row['value']:g}",
                f"`{row['boat']}`",
                spread(row["delivered_mbit"], row["mbit95"], 1),
                f"{100 * row['share']:.1f} %",
                "" if row["boat"] == "belief" else spread(row["belief_more"], row["belief_more95"], 1),
                rounded(row["aoi_mean"], 0),
                f"{rounded(row['own_error_rms'], 1)}, {rounded(row['own_error_p95'], 1)}",
                rounded(row["fix_availability"]),
                rounded(row["outage_longest"], 0),
            ]
            for row in found
            if row["axis"] == axis.name
        )
        sections += [f"## {axis.name[0].upper()}{axis.name[1:]}", markdown_table(head, rows)]
    return sections


def _draw(found: Sequence[dict[str, Any]], ground: Ground) -> Figure:
    drawn = titled_figure(
        7.6,
        "Data collected with each boat strategy",
        f"data of 8 AUVs over those with perfect fixes; {found[0]['episodes']} episodes of {WIDE}, the same for all;"
        " bars: 95 % of the mean",
        ground,
    )  # fmt: skip
    room = {"left": 0.08, "right": 0.98, "bottom": 0.14, "top": 0.88, "wspace": 0.06, "hspace": 0.28}
    most = found[0]["delivered_mbit"] / found[0]["share"]
    panels = drawn.subplots(2, 2, sharey=True, gridspec_kw=room)
    marks = looks(STRATEGIES, ground.colours)
    for axes, axis in zip(panels.flat, AXES, strict=True):
        places = {value: n for n, value in enumerate(sorted(axis.points))}
        for n, boat in enumerate(axis.boats):
            own = [row for row in found if (row["axis"], row["boat"]) == (axis.name, boat)]
            x = [places[row["value"]] + 0.05 * (n - 0.5 * (len(axis.boats) - 1)) for row in own]
            share, bars = [100 * row["share"] for row in own], [100 * row["mbit95"] / most for row in own]
            colour, marker = marks[boat]
            axes.errorbar(x, share, bars, color=colour, marker=marker, ms=5, lw=1.4, capsize=2, label=boat)
        axes.set(xticks=list(places.values()), xticklabels=[f"{value:g}" for value in places], xlabel=axis.name)
    for axes in panels[:, 0]:
        axes.set(ylim=(None, 103), ylabel="data, % of that with perfect fixes")
    drawn.legend(*panels[0, 0].get_legend_handles_labels(), loc="lower center", ncols=5)
    return drawn
