"""Table 2 and Fig. 3: sum data rate, energy consumption and reward of every method, and of two during training."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from usvauv.cli.reproduction import paper
from usvauv.cli.reproduction.paper import HEURISTICS, Settings, heuristic, learned, markdown_table, rounded, spread
from usvauv.cli.sweep.run_folder import Piece
from usvauv.env.render.figures import Figure, Line2D, write_pair
from usvauv.env.render.style import Ground, looks
from usvauv.env.storage.result_tables import write_rows
from usvauv.kernels.mission.auvs.motion import travelling_power
from usvauv.policies import checkpoint

Row = dict[str, Any]  # of table2.csv, see `pool`
OURS, PAPER = ("mean", "sd"), ("paper", "paper_sd")  # ends of the names of columns
OTHERS = ("services", "delivered_mbit", "collisions", "border", "arps_without_eq5")
LOWEST_EC = min(figures["ec"][0] for figures in paper.TABLE_2.values())
NEAR = 0.05  # relative difference up to which two ECs count as equal
LEARNING = ("ddpg", "sac")  # methods of Fig. 3
CURVE_COLUMNS = ("method", "condition", "run", "steps", "episode_equivalents", "updates", *paper.FIGURES)
DASHES = {"ISC": "-", "ESC": (0, (4, 2))}


def learned_runs(settings: Settings, methods: Sequence[str]) -> list[Piece]:
    """The runs of some methods, in both conditions, of all seeds."""
    scenarios = paper.CONDITIONS.values()
    return [learned(settings, key, name, seed) for seed in settings.seeds for key in methods for name in scenarios]


def table_runs(settings: Settings) -> list[Piece]:
    """The runs that Table 2 needs; Fig. 3 takes those of `LEARNING`."""
    keys = [method.key for method in settings.methods]
    return [*learned_runs(settings, keys), *(heuristic(settings, policy) for policy in HEURISTICS)]


def table_rows(settings: Settings, folder: Path) -> list[Row]:
    """All rows: the paper's reading (trained in ISC, tested in both), trained in ESC, heuristics."""
    runs = {
        (method.key, method.title, trained_in): [learned(settings, method.key, name, s) for s in settings.seeds]
        for trained_in, name in paper.CONDITIONS.items()
        for method in settings.methods
    } | {(policy, policy, ""): [heuristic(settings, policy)] for policy in HEURISTICS}
    return [
        pool(*about, condition, [[row for row in piece.rows(folder) if row["scenario"] == name] for piece in pieces])
        for about, pieces in runs.items()
        for condition, name in paper.CONDITIONS.items()
    ]


def pool(key: str, title: str, trained_in: str, tested_in: str, tests: Sequence[Sequence[dict[str, str]]]) -> Row:
    """A row of our table over the episodes of several runs, given as rows of their tests.

    "row" is as the paper names its rows; "runs" counts training runs, "untrained_runs" those which had no better policy
    than the one before the first update. Of a figure: mean and sample standard deviation over all episodes, that of
    the means of the runs (empty for fewer than two), and the paper's value with its ± (empty where there is none).
    """
    trained = [test[0] for test in tests if test[0]["run"] != ""]
    printed = paper.printed(key, tested_in)
    row: Row = {
        "row": f"{title} ({tested_in})",
        "method": key,
        "trained_in": trained_in,
        "tested_in": tested_in,
        "usv": tests[0][0]["usv"],
        "runs": len(trained),
        "untrained_runs": sum(int(test["updates"]) == 0 for test in trained),
        "episodes": sum(len(test) for test in tests),
    }
    for name in (*paper.FIGURES, *OTHERS):
        values = [[value(episode, name) for episode in test] for test in tests]
        pooled = [number for run in values for number in run]
        row[f"{name}_mean"] = statistics.fmean(pooled)
        if name in paper.FIGURES:
            row[f"{name}_sd"] = statistics.stdev(pooled)
            row[f"{name}_runs_sd"] = statistics.stdev(map(statistics.fmean, values)) if len(trained) > 1 else ""
            row[f"{name}_paper"], row[f"{name}_paper_sd"] = printed.get(name, ("", ""))
    return row


def value(row: dict[str, str], name: str) -> float:
    """A figure of an episode; `arps_without_eq5` is its arps without the collaboration term."""
    if name == "arps_without_eq5":
        return float(row["arps"]) - float(row["collaboration"])
    return float(row[name])


def make_table(settings: Settings, folder: Path, place: Path) -> list[str]:
    """Write table2.csv, a pair of .png, and .pdf; returns what the page has of it: the paper's rows beside ours, all
    tests, the heuristics.
    """
    rows = table_rows(settings, folder)
    write_rows(place / "table2.csv", list(rows[0]), rows)
    write_pair(place / "table2.png", partial(_draw_table, rows, settings), pdf=True)
    own = [row for row in rows if row["trained_in"] == "ISC" and row["sdr_paper"]]
    head = [f"{name.upper()}{whose}" for name in paper.FIGURES for whose in (", paper", ", here")]
    beside = (
        [row["row"], *(_spread(row, name, *what) for name in paper.FIGURES for what in (PAPER, OURS))] for row in own
    )
    above = {name: sum(row[f"{name}_mean"] > row[f"{name}_paper"] for row in own) for name in ("sdr", "arps")}
    frugal = sum(row["ec_mean"] <= LOWEST_EC * (1 + NEAR) for row in own)
    all_head = ["", "trained in", "tested in", "runs", "SDR Mbit/s", "EC W", "ARPS", "± of runs' ARPS"]
    all_head += ["ARPS without Eq. 5", "services", "collisions", "runs not above untrained"]
    return [
        "## Table 2",
        "Trained in ISC, tested in the condition named. The paper has one row for the baseline; here it is tested in"
        " both.",
        markdown_table(["", *head], beside),
        f"Of these {len(own)} rows, {above['sdr']} have a higher SDR than the paper's row and {above['arps']} a higher"
        f" ARPS; {frugal} have an EC of at most {rounded(LOWEST_EC * (1 + NEAR), 1)} W, which is {100 * NEAR:g} % above"
        " the paper's lowest.",
        _room(rows, settings),
        _weighted(rows),
        paper.picture_pair("table2", "SDR, EC and ARPS of every method, ours and the paper's"),
        f"All tests, mean ± standard deviation over {rows[0]['episodes']} episodes; the last column is the number of"
        " runs whose best policy was that before the first update:",
        markdown_table(all_head, (_cells(row) for row in rows)),
    ]


def _spread(row: Row, name: str, centre: str, deviation: str) -> str:
    return spread(row[f"{name}_{centre}"], row[f"{name}_{deviation}"])


def _room(rows: Sequence[Row], settings: Settings) -> str:
    """Number of services that the lowest EC allows, at their energy with `straight`."""
    straight = next(row for row in rows if (row["method"], row["tested_in"]) == ("straight", "ISC"))
    auv = settings.scenario(paper.CONDITIONS["ISC"]).auv
    travelling, limit = travelling_power(auv, auv.speed_min), LOWEST_EC * (1 + NEAR)
    services, sdr, ec = (straight[f"{name}_mean"] for name in ("services", "sdr", "ec"))
    share = (limit - travelling) / (ec - travelling)
    return (
        f"Travelling at the lowest speed, {auv.speed_min:g} m/s, takes {rounded(travelling, 1)} W; the rest of EC is"
        f" hovering, which each service needs: `straight` in ISC has {rounded(services, 1)} services at"
        f" {rounded(ec, 1)} W. At that energy per service {rounded(limit, 1)} W allow"
        f" {rounded(share * services, 1)} services, an SDR of {rounded(share * sdr)}; more services"
        " have a higher EC."
    )


def _weighted(rows: Sequence[Row]) -> str:
    """The method that learned from other weights, beside the paper's SAC."""
    row = next(row for row in rows if (row["method"], row["trained_in"], row["tested_in"]) == ("data", "ISC", "ISC"))
    sdr, ec = (paper.printed("sac", "ISC")[name][0] for name in ("sdr", "ec"))
    return (
        f"**{row['row'].removesuffix(' (ISC)')}** is trained with other reward weights and tested like the"
        f" others: an SDR of {rounded(row['sdr_mean'])} at {rounded(row['ec_mean'], 1)} W, where the paper's SAC (ISC)"
        f" has {rounded(sdr)} at {rounded(ec, 1)} W."
    )


def _cells(row: Row) -> list[str]:
    """A row of the table of all tests."""
    title, runs = row["row"].removesuffix(f" ({row['tested_in']})"), row["runs"]
    return [
        title if runs else f"`{title}`",
        row["trained_in"],
        row["tested_in"],
        str(runs) if runs else "",
        *(_spread(row, name, *OURS) for name in paper.FIGURES),
        rounded(row["arps_runs_sd"]) if runs > 1 else "",
        rounded(row["arps_without_eq5_mean"]),
        rounded(row["services_mean"], 1),
        rounded(row["collisions_mean"]),
        str(row["untrained_runs"]) if runs else "",
    ]


def _draw_table(rows: Sequence[Row], settings: Settings, ground: Ground) -> Figure:
    """Ours and the paper's, row by row, one panel a figure."""
    shown = [row for row in rows if row["trained_in"] in ("ISC", "")]
    drawn = paper.titled_figure(
        1.85 + 0.3 * len(shown),
        "Table 2: ours and the paper's",
        f"trained in ISC, tested in both; mean ± standard deviation over {shown[0]['episodes']} episodes of"
        f" {len(settings.seeds)} runs of {settings.steps:,} world-steps",
        ground,
    )  # fmt: skip
    height = drawn.get_figheight()
    room = {"left": 0.16, "right": 0.98, "top": 1 - 1.15 / height, "bottom": 0.4 / height, "wspace": 0.08}
    panels = drawn.subplots(1, 3, sharey=True, gridspec_kw=room)
    looked = looks([method.key for method in paper.METHODS], ground.colours)
    for axes, (name, words) in zip(panels, paper.TITLES.items(), strict=True):
        for y, row in enumerate(shown):
            colour, marker = looked.get(row["method"], (ground.muted, "o"))
            mean, deviation, centre, spread = (row[f"{name}_{what}"] for what in (*OURS, *PAPER))
            axes.errorbar(mean, y - 0.14, xerr=deviation, fmt=marker, ms=6, lw=1.6, color=colour)
            if centre:
                axes.errorbar(centre, y + 0.2, xerr=spread, fmt="D", ms=5, mfc="none", lw=1.0, color=ground.text)
        axes.set(ylim=(len(shown) - 0.4, -0.6), yticks=range(len(shown)), title=words)
        axes.set_yticklabels([row["row"] for row in shown])
    marks = [
        Line2D([], [], marker="o", ls="-", color=ground.muted, label="ours"),
        Line2D([], [], marker="D", ls="-", mfc="none", color=ground.text, label="paper"),
    ]
    drawn.legend(handles=marks, loc="upper right", bbox_to_anchor=(0.985, 0.985), ncols=2)
    return drawn


def curves(settings: Settings, folder: Path) -> list[dict[str, object]]:
    """One row for each evaluation of each run."""
    found = []
    for method in LEARNING:
        for condition, name in paper.CONDITIONS.items():
            episode = settings.scenario(name).mission.steps
            for seed in settings.seeds:
                for point in checkpoint.read_history(learned(settings, method, name, seed).place(folder)):
                    about = (method, condition, seed, point["steps"], point["steps"] / episode, point["updates"])
                    figures = (point[name] for name in paper.FIGURES)
                    found.append(dict(zip(CURVE_COLUMNS, (*about, *figures), strict=True)))
    return found


def band(curves: Sequence[Mapping[str, Any]], method: str, condition: str, name: str) -> np.ndarray:
    """World-steps, then mean, minimum and maximum over the runs of a figure, (4, evaluations)."""
    points: dict[int, list[float]] = {}
    for row in curves:
        if (row["method"], row["condition"]) == (method, condition):
            points.setdefault(row["steps"], []).append(row[name])
    return np.array([(steps, np.mean(values), min(values), max(values)) for steps, values in points.items()]).T


def make_curves(settings: Settings, folder: Path, place: Path) -> list[str]:
    """Write fig3.csv, a pair of .png, and .pdf; returns what the page has of it: curves, their beginnings and ends."""
    found = curves(settings, folder)
    write_rows(place / "fig3.csv", CURVE_COLUMNS, found)
    write_pair(place / "fig3.png", partial(_draw_curves, found, settings), pdf=True)
    rows = []
    for method in LEARNING:
        for condition in paper.CONDITIONS:
            title = f"{settings.method(method).title} ({condition})"
            cells = []
            for name in paper.FIGURES:
                _, mean, low, high = band(found, method, condition, name)
                end = f"{rounded(mean[-1])} ({rounded(low[-1])} to {rounded(high[-1])})"
                cells += [rounded(paper.TABLE_2[method, condition][name][0]), rounded(mean[0]), end]
            rows.append([title, *cells])
    head = [f"{name.upper()}, {what}" for name in paper.FIGURES for what in ("Table 2", "start", "end")]
    points = len({row["steps"] for row in found})
    return [
        "## Fig. 3",
        f"Evaluations on worlds not trained in, {settings.judged} episodes each, at {points} times of"
        f" {len(settings.seeds)} runs, without exploration; the first is of the policy before any update. The paper"
        " gives no numbers with its curves, so Table 2's are given. In brackets: the worst and the best run.",
        paper.picture_pair("fig3", "SDR, EC and ARPS against training, DDPG and SAC in ISC and ESC"),
        markdown_table(["", *head], rows),
    ]


def _draw_curves(found: list[dict], settings: Settings, ground: Ground) -> Figure:
    drawn = paper.titled_figure(
        5.0,
        "Fig. 3: learning in ideal and extreme sea conditions",
        f"mean over {len(settings.seeds)} runs, band from the worst to the best run; each point {settings.judged}"
        " episodes of worlds not trained in;\nmarks at the right: the paper's Table 2, ◁ ISC and ◇ ESC",
        ground,
    )  # fmt: skip
    room = {"left": 0.055, "right": 0.98, "bottom": 0.2, "top": 0.66, "wspace": 0.2}
    panels = drawn.subplots(1, 3, gridspec_kw=room)
    episode = settings.scenario(paper.CONDITIONS["ISC"]).mission.steps / 1000
    looked = looks([method.key for method in paper.METHODS], ground.colours)
    for axes, (name, words) in zip(panels, paper.TITLES.items(), strict=True):
        for method in LEARNING:
            colour, marker = looked[method]
            for condition, dash in DASHES.items():
                steps, mean, low, high = band(found, method, condition, name)
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
