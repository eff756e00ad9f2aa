"""Fig. 4(b): error of the AUVs' positions by the boat's strategy, beside the bound of a single fix."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from usvauv.cli.reproduction import figure, paper
from usvauv.cli.reproduction.fixes import BOUND, FixErrors, results
from usvauv.cli.reproduction.settings import PHYSICAL, STRATEGIES, Settings
from usvauv.cli.reproduction.work import Piece
from usvauv.env.render.figure_theme import Ground, log_ticks, write_pair
from usvauv.env.render.style import looks
from usvauv.env.storage.tables import read_rows, write_rows

NAME = "fig4b"
SCENARIOS = (paper.CONDITIONS["ESC"], PHYSICAL)
TIMES = ("scenario", "strategy", "time", "median", "lower_quartile", "upper_quartile")
SUMMARY = ("scenario", "strategy", "episodes", "median", "low95", "high95", "p95", "paper")
RESAMPLES = 4000


@dataclass(frozen=True)
class Level:
    """Errors of a strategy in a scenario, m.

    Attributes:
        episodes: number of episodes.
        median: over episodes, of an episode's median over steps and AUVs. low, high: its 95 % interval by the
            bootstrap over episodes.
        p95: median over episodes of an episode's 95th percentile; None for the bound.
        paper: what the paper's figure shows; None where it shows nothing.
    """

    scenario: str
    strategy: str
    episodes: int
    median: float
    low: float
    high: float
    p95: float | None
    paper: float | None


def pieces(settings: Settings) -> list[Piece]:
    """The pieces of work that the figure needs."""
    return [FixErrors(scenario, usv) for scenario in SCENARIOS for usv in STRATEGIES]


def make(folder: Path, place: Path) -> list[Level]:
    """Write fig4b.csv (levels), fig4b-over-time.csv, a pair of .png, and .pdf; returns the levels."""
    levels = [level(folder, scenario, row) for scenario in SCENARIOS for row in (*STRATEGIES, BOUND)]
    cells = ((v.scenario, v.strategy, v.episodes, v.median, v.low, v.high, v.p95, v.paper) for v in levels)
    write_rows(place / f"{NAME}.csv", SUMMARY, (dict(zip(SUMMARY, row, strict=True)) for row in cells))
    over_time = {(v.scenario, v.strategy): read_rows(results(folder, v.scenario, v.strategy)[0]) for v in levels}
    named = (
        {"scenario": scenario, "strategy": strategy, **row}
        for (scenario, strategy), rows in over_time.items()
        for row in rows
    )
    write_rows(place / f"{NAME}-over-time.csv", TIMES, named)
    write_pair(place / f"{NAME}.png", partial(_draw, over_time, levels), pdf=True)
    return levels


def level(folder: Path, scenario: str, strategy: str) -> Level:
    """The level of a strategy, from its table over episodes."""
    rows = read_rows(results(folder, scenario, strategy)[1])
    medians = np.array([float(row["median"]) for row in rows])
    drawn = np.random.default_rng(0).integers(0, len(medians), (RESAMPLES, len(medians)))
    low, high = np.quantile(np.median(medians[drawn], axis=1), (0.025, 0.975))
    largest = [float(row["p95"]) for row in rows if row["p95"]]
    return Level(
        scenario=scenario,
        strategy=strategy,
        episodes=len(rows),
        median=float(np.median(medians)),
        low=float(low),
        high=float(high),
        p95=float(np.median(largest)) if largest else None,
        paper=paper.FIG_4B.get(strategy),
    )


def _draw(over_time: dict[tuple[str, str], list[dict[str, str]]], levels: list[Level], ground: Ground) -> Figure:
    drawn = figure.titled_figure(
        5.4,
        "Fig. 4(b): error of the AUVs' positions by the boat's strategy",
        f"median over {levels[0].episodes} episodes and AUVs steered by straight, band from quartile to quartile;\n"
        "dotted: the paper's levels, in the strategies' colours",
        ground,
    )  # fmt: skip
    room = {"left": 0.08, "right": 0.97, "bottom": 0.19, "top": 0.75, "wspace": 0.1}
    panels = drawn.subplots(1, 2, sharey=True, gridspec_kw=room)
    marks = looks(STRATEGIES, ground.colours) | {BOUND: (ground.text, "")}
    for axes, scenario in zip(panels, SCENARIOS, strict=True):
        for strategy in (*STRATEGIES, BOUND):
            rows, (colour, marker) = over_time[scenario, strategy], marks[strategy]
            time, median = (np.array([float(row[name]) for row in rows]) for name in ("time", "median"))
            if strategy == BOUND:
                axes.plot(time, median, color=colour, lw=1.2, ls=(0, (4, 2)), label="bound of a single fix", zorder=4)
                continue
            low, high = (np.array([float(row[name]) for row in rows]) for name in ("lower_quartile", "upper_quartile"))
            axes.fill_between(time, low, high, color=colour, alpha=0.12, lw=0)
            axes.plot(time, median, marker, ls="-", ms=5, markevery=0.1, color=colour, lw=0.9, label=strategy)
            if strategy in paper.FIG_4B:
                axes.axhline(paper.FIG_4B[strategy], color=colour, lw=1.4, ls=":")
        noise = "noise and sea as physics has them" if scenario == PHYSICAL else "the demonstration's noise"
        axes.set(yscale="log", xlabel="time, s", xlim=(0, time[-1]), title=f"{scenario}: {noise}")
    panels[0].set_ylabel("horizontal error, m")
    log_ticks(panels[0].yaxis)
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="lower center", ncols=5)
    return drawn
