"""Fig. 3: sum data rate, energy consumption and reward while DDPG and SAC learn, in both conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from usvauv import policies
from usvauv.cli.reproduction import figure, paper
from usvauv.cli.reproduction.runs import Learned
from usvauv.cli.reproduction.settings import Settings
from usvauv.cli.reproduction.work import Piece
from usvauv.env.render.figure_theme import Ground, write_pair
from usvauv.env.render.style import looks
from usvauv.env.storage.tables import write_rows

NAME = "fig3"
METHODS = ("ddpg", "sac")
COLUMNS = ("method", "condition", "run", "steps", "episode_equivalents", "updates", *paper.FIGURES)
DASHES = {"ISC": "-", "ESC": (0, (4, 2))}


def pieces(settings: Settings) -> list[Piece]:
    """The pieces of work that the figure needs."""
    scenarios = paper.CONDITIONS.values()
    return [Learned(method, name, seed, False) for seed in settings.seeds for method in METHODS for name in scenarios]


def curves(settings: Settings, folder: Path) -> list[dict[str, object]]:
    """One row for each evaluation of each run."""
    table = []
    for method in METHODS:
        for condition, name in paper.CONDITIONS.items():
            episode = settings.scenario(name).mission.steps
            for seed in settings.seeds:
                for point in policies.read_history(Learned(method, name, seed, False).place(folder)):
                    about = (method, condition, seed, point["steps"], point["steps"] / episode, point["updates"])
                    figures = (point[name] for name in paper.FIGURES)
                    table.append(dict(zip(COLUMNS, (*about, *figures), strict=True)))
    return table


def band(table: Sequence[Mapping[str, Any]], method: str, condition: str, name: str) -> np.ndarray:
    """World-steps, then mean, minimum and maximum over the runs of a figure, (4, evaluations)."""
    points: dict[int, list[float]] = {}
    for row in table:
        if (row["method"], row["condition"]) == (method, condition):
            points.setdefault(row["steps"], []).append(row[name])
    return np.array([(steps, np.mean(values), min(values), max(values)) for steps, values in points.items()]).T


def make(settings: Settings, folder: Path, results: Path) -> list[dict[str, object]]:
    """Write fig3.csv, a pair of .png, and .pdf; returns what they show."""
    table = curves(settings, folder)
    write_rows(results / f"{NAME}.csv", COLUMNS, table)
    write_pair(results / f"{NAME}.png", partial(_draw, table, settings), pdf=True)
    return table


def _draw(table: list[dict], settings: Settings, ground: Ground) -> Figure:
    drawn = figure.titled_figure(
        5.0,
        "Fig. 3: learning in ideal and extreme sea conditions",
        f"mean over {len(settings.seeds)} runs, band from the worst to the best run; each point {settings.judged}"
        " episodes of worlds not trained in;\nmarks at the right: the paper's Table 2, ◁ ISC and ◇ ESC",
        ground,
    )  # fmt: skip
    room = {"left": 0.055, "right": 0.98, "bottom": 0.2, "top": 0.66, "wspace": 0.2}
    panels = drawn.subplots(1, 3, gridspec_kw=room)
    episode = settings.scenario(paper.CONDITIONS["ISC"]).mission.steps / 1000
    looked = looks(figure.METHODS, ground.colours)
    for axes, (name, words) in zip(panels, figure.NAMES.items(), strict=True):
        for method in METHODS:
            colour, marker = looked[method]
            for condition, dash in DASHES.items():
                steps, mean, low, high = band(table, method, condition, name)
                label = f"{settings.method(method).title} ({condition})"
                axes.fill_between(steps / 1000, low, high, color=colour, alpha=0.13, lw=0)
                every = max(1, len(steps) // 6)
                axes.plot(steps / 1000, mean, marker, ls=dash, lw=1.8, ms=5, markevery=every, color=colour, label=label)
                printed = paper.TABLE_2[method, condition][name][0]
                mark = "<" if condition == "ISC" else (4, 0, 0)
                axes.plot(steps[-1] * 1.03 / 1000, printed, marker=mark, ms=7, mfc="none", color=colour, clip_on=False)
        axes.set_xlabel("thousand world-steps")
        above = axes.secondary_xaxis(
            "top", functions=(lambda x: np.divide(x, episode), lambda x: np.multiply(x, episode))
        )
        above.set_xlabel("episode equivalents")
        above.spines["top"].set_visible(False)
        axes.set_title(words, pad=36)
    drawn.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=4, handlelength=3.5)
    return drawn
