"""Table 2: sum data rate, energy consumption and reward of every method in both conditions."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from usvauv.cli.reproduction import figure, paper
from usvauv.cli.reproduction.runs import Heuristic, Learned
from usvauv.cli.reproduction.settings import HEURISTICS, Settings
from usvauv.cli.reproduction.work import Piece
from usvauv.env.render.figure_theme import Ground, write_pair
from usvauv.env.render.style import looks
from usvauv.env.storage.tables import read_rows, write_rows

NAME = "table2"
OTHERS = ("services", "delivered_mbit", "collisions", "border", "arps_without_eq5")
COLUMNS = (
    *("row", "method", "trained_in", "tested_in", "usv", "runs", "untrained_runs", "episodes"),
    *(f"{name}_{what}" for name in paper.FIGURES for what in ("mean", "sd", "runs_sd", "paper", "paper_sd")),
    *(f"{name}_mean" for name in OTHERS),
)


@dataclass(frozen=True)
class Row:
    """A row of our table.

    Attributes:
        key, title: the method's, or a heuristic's name.
        trained_in: condition it was trained in, "" for a heuristic. tested_in: condition.
        usv: the boat's strategy.
        runs: number of training runs pooled, 0 for a heuristic.
        untrained_runs: how many of them had no better policy than the one before the first update.
        episodes: number of episodes pooled.
        mean, sd: figure → mean over all these episodes, and their sample standard deviation.
        runs_sd: figure → sample standard deviation of the means of the runs; NaN for fewer than two.
    """

    key: str
    title: str
    trained_in: str
    tested_in: str
    usv: str
    runs: int
    untrained_runs: int
    episodes: int
    mean: dict[str, float]
    sd: dict[str, float]
    runs_sd: dict[str, float]

    @property
    def name(self) -> str:
        """As the paper names its rows."""
        return f"{self.title} ({self.tested_in})"

    @property
    def printed(self) -> dict[str, tuple[float, float]]:
        """The paper's row for it; empty where there is none."""
        return paper.printed(self.key, self.tested_in)


def pieces(settings: Settings) -> list[Piece]:
    """The pieces of work that the table needs."""
    scenarios = paper.CONDITIONS.values()
    runs = [Learned(m.key, name, s, True) for s in settings.seeds for m in settings.methods for name in scenarios]
    return [*runs, *(Heuristic(policy, name) for policy in HEURISTICS for name in scenarios)]


def rows(settings: Settings, folder: Path) -> list[Row]:
    """All rows: the paper's reading (trained in ISC, tested in both), trained in ESC, heuristics."""
    table = []
    for trained, name in paper.CONDITIONS.items():
        for method in settings.methods:
            runs = [Learned(method.key, name, seed, True).results(folder) for seed in settings.seeds]
            for tested, scenario in paper.CONDITIONS.items():
                tests = [read_rows(results[scenario]) for results in runs]
                table.append(pool(method.key, method.title, trained, tested, tests))
    for policy in HEURISTICS:
        for tested, scenario in paper.CONDITIONS.items():
            tests = [read_rows(Heuristic(policy, scenario).result(folder))]
            table.append(pool(policy, f"`{policy}`", "", tested, tests))
    return table


def pool(key: str, title: str, trained_in: str, tested_in: str, tests: Sequence[Sequence[dict[str, str]]]) -> Row:
    """Statistics over the episodes of several runs, given as rows of their tests."""
    values = {name: [[value(row, name) for row in test] for test in tests] for name in (*paper.FIGURES, *OTHERS)}
    pooled = {name: [v for run in runs for v in run] for name, runs in values.items()}
    means = {name: [statistics.fmean(run) for run in runs] for name, runs in values.items()}
    learned = [test[0] for test in tests if test[0]["run"] != ""]
    return Row(
        key=key,
        title=title,
        trained_in=trained_in,
        tested_in=tested_in,
        usv=tests[0][0]["usv"],
        runs=len(learned),
        untrained_runs=sum(int(row["updates"]) == 0 for row in learned),
        episodes=sum(len(test) for test in tests),
        mean={name: statistics.fmean(v) for name, v in pooled.items()},
        sd={name: statistics.stdev(v) for name, v in pooled.items()},
        runs_sd={name: statistics.stdev(v) if len(v) > 1 else math.nan for name, v in means.items()},
    )


def value(row: dict[str, str], name: str) -> float:
    """A figure of an episode; `arps_without_eq5` is its arps without the collaboration term."""
    if name == "arps_without_eq5":
        return float(row["arps"]) - float(row["collaboration"])
    return float(row[name])


def make(settings: Settings, folder: Path, results: Path) -> list[Row]:
    """Write table2.csv, a pair of .png, and .pdf; returns what they show."""
    table = rows(settings, folder)
    write_rows(results / f"{NAME}.csv", COLUMNS, (_cells(row) for row in table))
    write_pair(results / f"{NAME}.png", partial(_draw, table, settings), pdf=True)
    return table


def _cells(row: Row) -> dict[str, object]:
    cells: dict[str, object] = {"row": row.name.replace("`", ""), "method": row.key}
    for name in ("trained_in", "tested_in", "usv", "runs", "untrained_runs", "episodes"):
        cells[name] = getattr(row, name)
    for name in paper.FIGURES:
        printed = row.printed.get(name, ("", ""))
        numbers = (row.mean[name], row.sd[name], row.runs_sd[name] if row.runs > 1 else "", *printed)
        columns = ("mean", "sd", "runs_sd", "paper", "paper_sd")
        cells |= {f"{name}_{what}": number for what, number in zip(columns, numbers, strict=True)}
    return cells | {f"{name}_mean": row.mean[name] for name in OTHERS}


def _draw(table: Sequence[Row], settings: Settings, ground: Ground) -> Figure:
    """Ours and the paper's, row by row, one panel a figure."""
    shown = [row for row in table if row.trained_in in ("ISC", "")]
    drawn = figure.titled_figure(
        1.85 + 0.3 * len(shown),
        "Table 2: ours beside the paper's",
        f"trained in ISC, tested in both; mean ± standard deviation over {shown[0].episodes} episodes of"
        f" {len(settings.seeds)} runs of {settings.steps:,} world-steps",
        ground,
    )  # fmt: skip
    height = drawn.get_figheight()
    room = {"left": 0.16, "right": 0.98, "top": 1 - 1.15 / height, "bottom": 0.4 / height, "wspace": 0.08}
    panels = drawn.subplots(1, 3, sharey=True, gridspec_kw=room)
    looked = looks(figure.METHODS, ground.colours)
    for axes, (name, words) in zip(panels, figure.NAMES.items(), strict=True):
        for y, row in enumerate(shown):
            colour, marker = looked.get(row.key, (ground.muted, "o"))
            axes.errorbar(row.mean[name], y - 0.14, xerr=row.sd[name], fmt=marker, ms=6, lw=1.6, color=colour)
            if name in row.printed:
                centre, spread = row.printed[name]
                axes.errorbar(centre, y + 0.2, xerr=spread, fmt="D", ms=5, mfc="none", lw=1.0, color=ground.text)
        axes.set(ylim=(len(shown) - 0.4, -0.6), yticks=range(len(shown)), title=words)
        axes.set_yticklabels([row.name.replace("`", "") for row in shown])
    marks = [
        Line2D([], [], marker="o", ls="-", color=ground.muted, label="ours"),
        Line2D([], [], marker="D", ls="-", mfc="none", color=ground.text, label="paper"),
    ]
    drawn.legend(handles=marks, loc="upper right", bbox_to_anchor=(0.985, 0.985), ncols=2)
    return drawn
