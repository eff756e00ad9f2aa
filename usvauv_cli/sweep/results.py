"""A study from its file to its results: remaining runs are performed, then tables are written.

DIR/runs/HASH/      a run, see `usvauv.cli.sweep.run_folder`
DIR/results.csv     one row for each run and episode: `FIRST`, then the columns of `usvauv eval`; also as .parquet
DIR/summary.json    see `usvauv.cli.sweep.summary`
DIR/report/         a page: results of `summary.summary` as tables and figures, training curves, and all runs
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from usvauv.cli import terminal
from usvauv.cli.sweep import summary
from usvauv.cli.sweep.engine import Engine
from usvauv.cli.sweep.perform import perform_all
from usvauv.cli.sweep.run_folder import FAILURE, Piece, seconds
from usvauv.cli.sweep.study import Study
from usvauv.cli.terminal import counted
from usvauv.cli.web_report import document
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.render.figures import Axes, Figure
from usvauv.env.scenario import Scenario
from usvauv.env.storage.files import atomic_write, inside, locked, writing
from usvauv.env.storage.result_tables import write_rows
from usvauv.kernels.errors import UserError
from usvauv.policies import checkpoint
from usvauv.policies.names import PolicyError

TABLE = "results.csv"
FIRST = ("run", "method", "task", "training_seed")

NAMES = {"iqm": "interquartile mean", "median": "median", "mean": "mean"}
ROW = 0.15  # inches of a row of points
TITLE = 54  # letters
Values = Mapping[str, Any]  # "value", "low" and "high", of which the last two may be None
Curve = Sequence[tuple[float, Values]]  # world-steps, score

METHODS, TASKS, PAIRS = 12, 12, 15  # that are legible in figures
LONGEST, WORDS = 40, 240  # letters of a name in a figure, of a failure


def sweep(study: Study, folder: Path, make_engine: Callable[[], Engine], quiet: bool = False) -> None:
    """Perform the remaining runs of a study, write its tables and print its summary; `quiet` shows no progress.

    Raises:
        UserError: a run failed; all others are done.
        KeyboardInterrupt: after Ctrl-C, when what was running is saved.
    """
    with locked(folder):
        resources = study.resources
        failure = perform_all(study.runs, folder, make_engine, resources.cores, resources.arch, quiet)
        write_results(study, folder)
    if failure:
        raise UserError(failure)


def write_results(study: Study, folder: Path) -> None:
    """Write the tables and the page, and print the summary."""
    done = [piece for piece in study.runs if piece.finished(folder)]

    def rows() -> Iterator[dict[str, Any]]:
        for piece in done:
            first = dict(zip(FIRST, (piece.key, piece.method, piece.task, piece.seed), strict=True))
            for row in piece.rows(folder):
                yield {**first, **row}

    if done:
        columns = dict.fromkeys(name for row in rows() for name in row)
        write_rows(folder / TABLE, list(columns), rows())
        parquet = _write_parquet(folder / TABLE)
        print(f"{counted(len(done) * study.evaluation.episodes, 'episode')} written to {folder / TABLE}{parquet}")
    score = study.evaluation.score
    seas = {piece.task: Scenario.from_dict(piece.definition["scenario"]).random_seas for piece in done}
    told = summary.differences(rows(), score, seas)
    results = summary.summary(summary.scores(rows(), score), study.evaluation, told)
    with atomic_write(folder / "summary.json") as partial:
        partial.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    summary.show(results)
    print(f"summary: {folder / 'summary.json'}")
    print(f"report: {write_report(folder, study, results)}")


def _write_parquet(table: Path) -> str:
    """The table as Parquet beside it, with numbers as such; returns what is to be said of it."""
    path = table.with_suffix(".parquet")
    try:
        from pyarrow import csv, parquet, string
    except ImportError:
        path.unlink(missing_ok=True)
        return "; there is no Parquet file without pyarrow (extra 'scale')"
    text = [*FIRST[:3], *(part.name for part in fields(EpisodeMetrics) if part.type == "str")]
    options = csv.ConvertOptions(column_types=dict.fromkeys(text, string()), strings_can_be_null=False)
    with atomic_write(path) as partial, table.open("rb") as source, partial.open("wb") as target:
        parquet.write_table(csv.read_csv(source, convert_options=options), target)
    return " and .parquet"


def write_report(folder: Path, study: Study, results: Mapping[str, Any]) -> Path:
    """Write DIR/report/index.html and its figures as PDF; returns the page."""
    place = folder / "report"
    with writing(place):
        inside(folder, place).mkdir(exist_ok=True)
        for path in place.glob("*.pdf"):
            path.unlink()
    runs = [_row(folder, piece) for piece in study.runs]
    runs.sort(key=lambda row: row["how"] == "done")  # in the order of the study but for that
    methods = list(dict.fromkeys(method for task in results["tasks"].values() for method in task))
    counts = {how: sum(row["how"] == how for row in runs) for how in ("done", "failed", "not run")}
    return document.write(
        place,
        "sweep/report.html",
        f"{study.path.stem}: study by usvauv",
        {"summary": f"The study file, {study.path}", "text": study.text},
        arch=study.resources.arch,
        study=study,
        counts={how: count for how, count in counts.items() if count},
        results=results,
        methods=methods,
        ahead=results["differences"][:PAIRS],
        runs=runs,
        figures_of=f"{METHODS} methods and {TASKS} tasks" * (len(methods) > METHODS or len(results["tasks"]) > TASKS),
        words=summary.in_words,
        pictures=document.pictures(place, _figures(study, results, _learning(folder, study))),
    )


def _row(folder: Path, piece: Piece) -> dict[str, Any]:
    """A run in the table of runs."""
    place = piece.place(folder)
    how, words, took = "not run", "", seconds(place)
    if piece.finished(folder):
        how = "done"
    elif (place / FAILURE).is_file():
        lines = inside(place, place / FAILURE).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        how, words = "failed", lines[-1][:WORDS] if lines else ""
    about = {"key": piece.key, "method": piece.method, "task": piece.task, "seed": piece.seed}
    return {**about, "how": how, "seconds": took, "words": words}


def _learning(folder: Path, study: Study) -> dict[str, dict[str, Curve]]:
    """Score of the evaluations during the trainings that are done: task → method → curve."""
    found: dict[str, dict[str, list[dict[float, float]]]] = {}
    for piece in study.runs:
        if piece.definition["training"] and piece.finished(folder):
            with suppress(PolicyError):
                history = checkpoint.read_history(piece.place(folder))
                scores = {row["steps"]: row[study.evaluation.score] for row in history if study.evaluation.score in row}
                if scores:
                    found.setdefault(piece.task, {}).setdefault(piece.method, []).append(scores)
    return {task: {m: _mean_curve(runs) for m, runs in methods.items()} for task, methods in found.items()}


def _mean_curve(runs: list[dict[float, float]]) -> Curve:
    """Mean over runs with its interval at the steps that all of them have."""
    return [
        (step, summary.as_json(summary.interval(summary.mean, [np.array([run[step] for run in runs])])))
        for step in sorted(set.intersection(*map(set, runs)))
    ]


def _figures(
    study: Study, results: Mapping[str, Any], learning: Mapping[str, Mapping[str, Curve]]
) -> Iterator[document.Drawn]:
    """The figures for which there are numbers, as `document.pictures` takes them."""
    score = study.evaluation.score
    methods = list(dict.fromkeys(method for task in results["tasks"].values() for method in task))[:METHODS]
    short = terminal.shortened(methods, LONGEST)

    def shown(of: Mapping[str, Any]) -> dict[str, Any]:
        return {method: about for method, about in of.items() if method in short}

    if tasks := {task: shown(of) for task, of in islice(results["tasks"].items(), TASKS)}:
        about = "Mean over runs, with 95 % intervals of the bootstrap over runs."
        yield "scores", partial(draw_scores, tasks, short, score), "Scores", about
    if len(results["aggregates"]) > 1:
        pairs = [pair for pair in results["improvement"] if {pair["method"], pair["over"]} <= short.keys()][:PAIRS]
        about = "Scaled so that in each task the worst run is 0 and the best 1."
        aggregates = shown(results["aggregates"])
        yield "aggregates", partial(draw_aggregates, aggregates, short), "Scores over all tasks", about
        about = "The higher the line, the better; where lines cross, neither method is better throughout."
        yield "profiles", partial(draw_profiles, shown(results["profiles"]), short), "Performance profiles", about
        about = (
            "That a run of the one is better than one of the other on the same task. An interval that holds 0.5 tells"
            " nothing."
        )
        yield "improvement", partial(draw_improvement, pairs, short), "Probability of improvement", about
    learned = {task: shown(of) for task, of in learning.items()}
    if learned := {task: of for task, of in islice(learned.items(), TASKS) if of}:
        about = "Mean over runs of the evaluations during the training, in worlds of their own, with 95 % intervals."
        yield "learning", partial(draw_learning, learned, short, score), "Learning", about


def draw_scores(tasks: Mapping[str, Mapping[str, Values]], methods: Mapping[str, str], score: str) -> Figure:
    """Mean score of each method, a plot for each task; `methods` has names in the order of their colours."""
    heights = [ROW * len(of) + 0.42 for of in tasks.values()]
    figure = document.new(sum(heights) + 0.25, document.points(methods.values()))
    plots = figure.subplots(len(tasks), 1, squeeze=False, height_ratios=heights).ravel()
    for axes, (task, of_methods) in zip(plots, tasks.items(), strict=True):
        _rows(axes, [(list(methods).index(method), value) for method, value in of_methods.items()])
        axes.set_title(document.truncated(task, TITLE), loc="left", pad=3)
    plots[-1].set_xlabel(score)
    return figure


def draw_aggregates(of_methods: Mapping[str, Mapping[str, Values]], methods: Mapping[str, str]) -> Figure:
    """Interquartile mean, median and mean of scaled scores, side by side."""
    figure = document.new(ROW * len(of_methods) + 0.65, document.points(methods.values()))
    plots = figure.subplots(1, len(NAMES), sharex=True)
    for axes, (name, words) in zip(plots, NAMES.items(), strict=True):
        _rows(axes, [(list(methods).index(method), of[name]) for method, of in of_methods.items()])
        axes.set_title(words, loc="left", pad=3)
        axes.set_xlim(-0.02, 1.02)
    plots[1].set_xlabel("scaled score")
    return figure


def draw_profiles(of_methods: Mapping[str, Sequence[Values]], methods: Mapping[str, str]) -> Figure:
    """Share of runs above a scaled score, with bands of 95 %."""
    figure = document.new(2.2, document.lines(methods.values()))
    axes = figure.add_subplot()
    for method, profile in of_methods.items():
        _curve(axes, list(methods).index(method), [(point["above"], point) for point in profile])
    axes.set(xlabel="scaled score τ", ylabel="share of runs above τ", xlim=(0, 1), ylim=(-0.02, 1.02))
    document.style_axes(axes)
    return figure


def draw_improvement(pairs: Sequence[Values], methods: Mapping[str, str]) -> Figure:
    """Probability that a run of one method is better than one of another, for each pair."""
    figure = document.new(0.32 * len(pairs) + 0.55)
    axes = figure.add_subplot()
    _rows(axes, [(list(methods).index(pair["method"]), pair) for pair in pairs])
    names = [[document.truncated(methods[pair[which]], 24) for which in ("method", "over")] for pair in pairs]
    axes.set_yticks(range(0, -len(pairs), -1), [f"{one}\nover {other}" for one, other in names])
    axes.axvline(0.5, color=document.MUTED, lw=0.8, zorder=1)
    axes.set(xlim=(-0.02, 1.02), xlabel="probability of improvement")
    return figure


def draw_learning(tasks: Mapping[str, Mapping[str, Curve]], methods: Mapping[str, str], score: str) -> Figure:
    """Mean score of evaluations during the training, with bands of 95 % over seeds, a plot for each task."""
    drawn = {method for of_methods in tasks.values() for method in of_methods}
    lines = zip(methods, document.lines(methods.values()), strict=True)
    figure = document.new(1.75 * len(tasks) + 0.25, [line for method, line in lines if method in drawn])
    plots = figure.subplots(len(tasks), 1, squeeze=False).ravel()
    for axes, (task, of_methods) in zip(plots, tasks.items(), strict=True):
        for method, curve in of_methods.items():
            _curve(axes, list(methods).index(method), curve)
        axes.set_title(document.truncated(task, TITLE), loc="left", pad=3)
        axes.set_ylabel(score)
        document.style_axes(axes)
    plots[-1].set_xlabel("world-steps")
    return figure


def _rows(axes: Axes, rows: Sequence[tuple[int, Values]]) -> None:
    """A point with its interval in each row, of method number i."""
    for place, (i, about) in enumerate(rows):
        ink, ends = document.colour(i), [about["low"], about["high"]]
        if about["low"] is not None:
            axes.plot(ends, [-place, -place], color=ink, lw=1.2, solid_capstyle="butt")
        axes.plot(about["value"], -place, document.marker(i), color=ink, ms=4.5, mec=document.INK, mew=0.6, zorder=5)
    document.style_axes(axes)
    axes.set_yticks([])
    axes.set_ylim(0.6 - len(rows), 0.6)


def _curve(axes: Axes, i: int, curve: Curve) -> None:
    """A line of method number i, with its band."""
    at = [place for place, _ in curve]
    low, value, high = (
        [math.nan if about[name] is None else about[name] for _, about in curve] for name in ("low", "value", "high")
    )
    axes.fill_between(at, low, high, color=document.colour(i), alpha=0.15, lw=0)
    axes.plot(at, value, color=document.colour(i), ls=document.dash(i))
