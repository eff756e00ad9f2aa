"""What the boat's strategy brings in, by range, ping interval, drift and number of boats; the same worlds for all."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from usvauv import policies
from usvauv.cli.engines.training import EVALUATION_STEP
from usvauv.cli.reproduction import figure
from usvauv.cli.reproduction.settings import WIDE, Settings
from usvauv.cli.reproduction.work import Piece, Work
from usvauv.env import World
from usvauv.env.record.metrics import COLUMNS, episode_metrics
from usvauv.env.record.recorder import record
from usvauv.env.render.figure_theme import Ground, write_pair
from usvauv.env.render.style import looks
from usvauv.env.storage.tables import read_rows, write_rows

NAME = "collaboration"
STEERING = "pace"
CENTRE = "hold:300,300"
STRATEGIES = (CENTRE, "centroid", "fim", "visit", "belief")
FIGURES = ("delivered_mbit", "aoi_mean", "own_error_rms", "own_error_p95", "fix_availability", "outage_longest")
SUMMARY = ("axis", "value", "boat", "episodes", "share", *FIGURES, "mbit95", "belief_more", "belief_more95")


@dataclass(frozen=True)
class Missions:
    """Episodes of `wide` with one strategy of the boat; one row of metrics each.

    Attributes:
        name: in file names.
        boat: the strategy.
        changes: of the scenario.
    """

    name: str
    boat: str
    changes: tuple[str, ...]

    def result(self, folder: Path) -> Path:
        """Table of the episodes."""
        boat = self.boat.replace(":", "-").replace(",", "-")
        return folder / "evaluations" / f"{WIDE}-{self.name}-{boat}.csv"

    def left(self, settings: Settings, folder: Path) -> float:
        steps = settings.scenario(WIDE).mission.steps
        return 0 if self.result(folder).exists() else EVALUATION_STEP * steps

    def run(self, work: Work) -> None:
        settings = work.settings
        scenario = settings.scenario(WIDE, self.changes)
        world = World(scenario, settings.wide_episodes, settings.test_seed, self.boat)
        trace = record(world, policies.load(STEERING, world).act, STEERING, on_step=work.step)
        rows = (row.columns() for row in episode_metrics(trace))
        names = (*COLUMNS, "aoi_mean")
        write_rows(self.result(work.folder), names, ({name: row[name] for name in names} for row in rows))


@dataclass(frozen=True)
class Axis:
    """One thing that is varied.

    Attributes:
        name: what it is, with its unit.
        points: value → name in file names, and changes of the scenario.
        boats: strategies compared.
    """

    name: str
    points: Mapping[float, tuple[str, tuple[str, ...]]]
    boats: tuple[str, ...] = STRATEGIES

    def missions(self, value: float, boat: str) -> Missions:
        """The missions of one point."""
        name, changes = self.points[value]
        return Missions(name, boat, changes)


def _level(decibel: int) -> tuple[str, tuple[str, ...]]:
    return f"{decibel}dB", (f"acoustics.source_level={decibel}",)


BASE = _level(142)
NEAR = _level(140)
AXES = (
    Axis("replies understood to, m", {150: NEAR, 200: BASE, 300: _level(145), 850: _level(187)}),
    Axis(
        "time between pings at 200 m, s",
        {1.0: BASE} | {s: (f"ping-{s:g}s", (*BASE[1], f"channel.interval={s:g}")) for s in (10.0, 30.0)},
    ),
    Axis(
        "error of an AUV's velocity at 200 m, m/s",
        {s: (f"drift-{s}", (*BASE[1], f"navigation.velocity_bias={s}")) for s in (0.03, 0.2)} | {0.1: BASE},
    ),
    Axis(
        "number of boats at 150 m",
        {1.0: NEAR} | {n: (f"{n:g}-boats", (*NEAR[1], f"boat.count={n:g}")) for n in (2.0, 3.0, 4.0)},
        ("centroid", "fim", "visit", "belief"),
    ),
)
PERFECT = Missions(
    "perfect",
    CENTRE,
    (
        "channel.schedule=every-step",
        "navigation.sensor=none",
        "acoustics.source_level=250",
        "acoustics.sound_speed_error=0",
        *(f"usbl.{name}_error=0" for name in ("attitude", "alignment", "heading", "lever_arm", "gnss")),
    ),
)


@dataclass(frozen=True)
class Point:
    """Figures of a strategy at one value of an axis; an interval is half the width at 95 %.

    Attributes:
        share: of the data that AUVs with perfect fixes bring in.
        means: of `FIGURES` over episodes.
        interval: of the data, Mbit.
        more: what `belief` brings in more in the same worlds, Mbit. more_interval: of that.
    """

    axis: str
    value: float
    boat: str
    episodes: int
    share: float
    means: dict[str, float]
    interval: float
    more: float
    more_interval: float


def pieces(settings: Settings) -> list[Piece]:
    """The pieces of work that the figure needs."""
    found = (axis.missions(value, boat) for axis in AXES for value in axis.points for boat in axis.boats)
    return list(dict.fromkeys([PERFECT, *found]))


def half_width(values: np.ndarray) -> float:
    """Half the width of the 95 % interval of a mean."""
    return 1.96 * float(values.std(ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else math.nan


def points(folder: Path) -> Iterator[Point]:
    """All points of all axes, from the tables of the episodes."""

    def columns(missions: Missions) -> dict[str, np.ndarray]:
        rows = read_rows(missions.result(folder))
        return {name: np.array([float(row[name]) for row in rows]) for name in FIGURES}

    most = columns(PERFECT)["delivered_mbit"].mean()
    for axis in AXES:
        for value in sorted(axis.points):
            best = columns(axis.missions(value, "belief"))["delivered_mbit"]
            for boat in axis.boats:
                found = columns(axis.missions(value, boat))
                data = found["delivered_mbit"]
                means = {name: float(np.nanmean(values)) for name, values in found.items()}
                share, more = float(data.mean() / most), best - data
                yield Point(
                    axis.name, value, boat, len(data), share, means, half_width(data), float(more.mean()),
                    half_width(more),
                )  # fmt: skip


def make(folder: Path, place: Path) -> list[Point]:
    """Write collaboration.csv, a pair of .png, and .pdf; returns the points."""
    found = list(points(folder))
    rows = (
        (p.axis, p.value, p.boat, p.episodes, p.share, *p.means.values(), p.interval, p.more, p.more_interval)
        for p in found
    )
    write_rows(place / f"{NAME}.csv", SUMMARY, (dict(zip(SUMMARY, row, strict=True)) for row in rows))
    write_pair(place / f"{NAME}.png", partial(_draw, found), pdf=True)
    return found


def _draw(found: Sequence[Point], ground: Ground) -> Figure:
    drawn = figure.titled_figure(
        7.6,
        "What the boat's strategy brings in",
        f"data of 8 AUVs over those with perfect fixes; {found[0].episodes} episodes of {WIDE}, the same for all;"
        " bars: 95 % of the mean",
        ground,
    )  # fmt: skip
    room = {"left": 0.08, "right": 0.98, "bottom": 0.14, "top": 0.88, "wspace": 0.06, "hspace": 0.28}
    most = found[0].means["delivered_mbit"] / found[0].share
    panels = drawn.subplots(2, 2, sharey=True, gridspec_kw=room)
    marks = looks(STRATEGIES, ground.colours)
    for axes, axis in zip(panels.flat, AXES, strict=True):
        places = {value: n for n, value in enumerate(sorted(axis.points))}
        for n, boat in enumerate(axis.boats):
            own = [p for p in found if (p.axis, p.boat) == (axis.name, boat)]
            x = [places[p.value] + 0.05 * (n - 0.5 * (len(axis.boats) - 1)) for p in own]
            share, bars = [100 * p.share for p in own], [100 * p.interval / most for p in own]
            colour, marker = marks[boat]
            axes.errorbar(x, share, bars, color=colour, marker=marker, ms=5, lw=1.4, capsize=2, label=boat)
        axes.set(xticks=list(places.values()), xticklabels=[f"{value:g}" for value in places], xlabel=axis.name)
    for axes in panels[:, 0]:
        axes.set(ylim=(None, 103), ylabel="data, % of that with perfect fixes")
    drawn.legend(*panels[0, 0].get_legend_handles_labels(), loc="lower center", ncols=5)
    return drawn
