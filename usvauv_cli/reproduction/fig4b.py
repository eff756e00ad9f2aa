"""Fig. 4(b): error of the AUVs' positions by the boat's strategy, beside the bound of a single fix."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usvauv_cli import figure_theme
from usvauv_cli.figure_theme import TEXT
from usvauv_cli.reproduction import figure, paper
from usvauv_cli.reproduction.fixes import BOUND, FixErrors, results
from usvauv_cli.reproduction.settings import PHYSICAL, STRATEGIES, Settings
from usvauv_cli.reproduction.work import Piece
from usvauv_env.record.table import read_rows, write_rows
from usvauv_env.render.palette import looks

NAME = "fig4b"
SCENARIOS = (paper.CONDITIONS["ESC"], PHYSICAL)
TIMES = ("scenario", "strategy", "time", "median", "lower_quartile", "upper_quartile")
SUMMARY = ("scenario", "strategy", "episodes", "median", "low95", "high95", "p95", "paper")
LOOKS = looks(STRATEGIES) | {BOUND: (TEXT, "")}
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
    """Write fig4b.csv (levels), fig4b-over-time.csv, .png and .pdf; returns the levels."""
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
    _draw(over_time, levels, place / NAME)
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


def _draw(over_time: dict[tuple[str, str], list[dict[str, str]]], levels: list[Level], place: Path) -> None:
    drawn = figure.titled_figure(
        13.2, 6.0,
        "Fig. 4(b): error of the AUVs' positions by the boat's strategy",
        f"median over {levels[0].episodes} episodes and AUVs steered by straight, band from quartile to quartile;"
        " dotted: the paper's levels, in the strategies' colours",
    )  # fmt: skip
    grid = drawn.add_gridspec(1, 2, left=0.06, right=0.985, bottom=0.17, top=0.82, wspace=0.08)
    left = drawn.add_subplot(grid[0, 0])
    panels = (left, drawn.add_subplot(grid[0, 1], sharey=left))
    for axes, scenario in zip(panels, SCENARIOS, strict=True):
        for strategy in (*STRATEGIES, BOUND):
            rows, (colour, marker) = over_time[scenario, strategy], LOOKS[strategy]
            time, median = (np.array([float(row[name]) for row in rows]) for name in ("time", "median"))
            if strategy == BOUND:
                axes.plot(time, median, color=colour, lw=1.2, ls=(0, (4, 2)), label="bound of a single fix", zorder=4)
                continue
            low, high = (np.array([float(row[name]) for row in rows]) for name in ("lower_quartile", "upper_quartile"))
            axes.fill_between(time, low, high, color=colour, alpha=0.12, lw=0)
            axes.plot(time, median, marker, ls="-", ms=5, markevery=0.1, color=colour, lw=1.3, label=strategy)
            if strategy in paper.FIG_4B:
                axes.axhline(paper.FIG_4B[strategy], color=colour, lw=1.4, ls=":")
        axes.set(yscale="log", xlabel="time, s", xlim=(0, time[-1]))
        noise = "the demonstration's noise" if axes is left else "noise and sea as physics has them"
        figure.style_plot(axes, f"{scenario}: {noise}")
        if axes is left:
            axes.set_ylabel("horizontal error, m")
        else:
            axes.tick_params(labelleft=False)
    figure_theme.log_ticks(left.yaxis)
    handles, labels = left.get_legend_handles_labels()
    drawn.legend(handles, labels, loc="lower center", ncols=5, frameon=False, labelcolor=TEXT, fontsize=9.5)
    figure.save(drawn, place)
