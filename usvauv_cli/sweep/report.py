"""The page of a study: what `summary.summary` says as tables and figures, how the trainings went, and all runs."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from usvauv import policies
from usvauv.cli import tables
from usvauv.cli.sweep import figures, statistics, summary
from usvauv.cli.sweep.run import FAILURE, finished, seconds
from usvauv.cli.sweep.study import Planned, Study
from usvauv.cli.web_report import document
from usvauv.env.storage.files import writing
from usvauv.policies.policy import PolicyError

# What is shown at most, so that the page stays below 3 MB.
METHODS, TASKS = 12, 12  # of figures
MOST_METHODS, MOST_TASKS = 300, 24  # of tables
PAIRS, MOST_PAIRS = 15, 300
MOST_RUNS = 1000
LONGEST, WORDS, TEXT = 40, 240, 200_000  # letters of a name in a figure, of a failure, of the study file


class Row(NamedTuple):
    """A run in the table of runs; `seconds` is None where it is not known."""

    key: str
    method: str
    task: str
    seed: int
    how: str
    seconds: float | None
    words: str


def write(folder: Path, study: Study, names: summary.Labels, results: Mapping[str, Any]) -> Path:
    """Write DIR/report/index.html and its figures as PDF; returns the page.

    Args:
        folder: of the study.
        study: of which the page is.
        names: method and task of its runs.
        results: of `summary.summary`.

    Raises:
        OutputError: a file cannot be written.
    """
    place = folder / "report"
    with writing(place):
        place.mkdir(exist_ok=True)
    runs = [_row(folder, planned, names) for planned in study.runs]
    runs.sort(key=lambda row: row.how == "done")  # in the order of the study but for that
    methods = list(dict.fromkeys(method for task in results["tasks"].values() for method in task))
    counts = {how: sum(row.how == how for row in runs) for how in ("done", "failed", "not run")}
    return document.write(
        place,
        "sweep/report.html",
        f"{study.path.stem}: study by usvauv",
        {"summary": f"The study file, {study.path}", "text": study.text[:TEXT]},
        arch=study.resources.arch,
        study=study,
        counts={how: count for how, count in counts.items() if count},
        results=results,
        methods=methods[:MOST_METHODS],
        tasks=list(results["tasks"])[:MOST_TASKS],
        pairs=results["improvement"][:MOST_PAIRS],
        runs=runs[:MOST_RUNS],
        left_out=[
            f"{shown} of {there} {what}"
            for what, shown, there in (
                ("methods", MOST_METHODS, len(methods)),
                ("tasks", MOST_TASKS, len(results["tasks"])),
                ("pairs", MOST_PAIRS, len(results["improvement"])),
                ("runs", MOST_RUNS, len(runs)),
            )
            if there > shown
        ],
        figures_of=f"{METHODS} methods and {TASKS} tasks"
        if len(methods) > METHODS or len(results["tasks"]) > TASKS
        else "",
        words=summary.in_words,
        pictures=_pictures(place, study, results, _learning(folder, study, names)),
    )


def _row(folder: Path, planned: Planned, names: summary.Labels) -> Row:
    place = planned.place(folder)
    how, words, took = "not run", "", seconds(place)
    if finished(place):
        how = "done"
    elif (place / FAILURE).is_file():
        lines = (place / FAILURE).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        how, words = "failed", lines[-1][:WORDS] if lines else ""
    return Row(planned.key, *names[planned.key], planned.run.seed, how, took, words)


def _learning(folder: Path, study: Study, names: summary.Labels) -> dict[str, dict[str, figures.Curve]]:
    """Score of the evaluations during the trainings that are done: task → method → curve."""
    found: dict[str, dict[str, list[dict[float, float]]]] = {}
    for planned in study.runs:
        place, (method, task) = planned.place(folder), names[planned.key]
        if planned.run.algorithm and finished(place):
            with suppress(PolicyError):
                history = policies.read_history(place)
                scores = {row["steps"]: row[study.evaluation.score] for row in history if study.evaluation.score in row}
                if scores:
                    found.setdefault(task, {}).setdefault(method, []).append(scores)
    return {task: {m: _curve(runs) for m, runs in methods.items()} for task, methods in found.items()}


def _curve(runs: list[dict[float, float]]) -> figures.Curve:
    """Mean over runs with its interval at the steps that all of them have."""
    return [
        (step, summary.as_json(statistics.interval(statistics.mean, [np.array([run[step] for run in runs])])))
        for step in sorted(set.intersection(*map(set, runs)))
    ]


def _pictures(
    place: Path, study: Study, results: Mapping[str, Any], learning: Mapping[str, Mapping[str, figures.Curve]]
) -> list[document.Picture]:
    """The figures for which there are numbers; PDFs of others are removed."""
    score, words = study.evaluation.score, summary.in_words
    tasks = dict(islice(results["tasks"].items(), TASKS))
    methods = list(dict.fromkeys(method for task in results["tasks"].values() for method in task))[:METHODS]
    short = tables.shortened(methods, LONGEST)
    tasks = {task: {m: about for m, about in of.items() if m in short} for task, of in tasks.items()}
    made: list[document.Picture] = []

    def add(*parts: Any) -> None:
        made.append(document.picture(place, *parts))

    if tasks:
        add(
            "scores",
            figures.scores(tasks, short, score),
            "Scores",
            "; ".join(f"{m} in {task}: {words(about)}" for task, of in tasks.items() for m, about in of.items()),
            "Mean over runs, with 95 % intervals of the bootstrap over runs.",
        )
    if len(results["aggregates"]) > 1:
        of = {m: about for m, about in results["aggregates"].items() if m in short}
        add(
            "aggregates",
            figures.aggregates(of, short),
            "Scores over all tasks",
            "; ".join(f"{m}: interquartile mean {words(about['iqm'])}" for m, about in of.items()),
            "Scaled so that in each task the worst run is 0 and the best 1.",
        )
        add(
            "profiles",
            figures.profiles({m: profile for m, profile in results["profiles"].items() if m in short}, short),
            "Performance profiles",
            f"Share of runs above a scaled score, for {', '.join(of)}.",
            "The higher the line, the better; where lines cross, neither method is better throughout.",
        )
        pairs = [pair for pair in results["improvement"] if {pair["method"], pair["over"]} <= short.keys()][:PAIRS]
        add(
            "improvement",
            figures.improvement(pairs, short),
            "Probability of improvement",
            "; ".join(f"{pair['method']} over {pair['over']}: {words(pair)}" for pair in pairs),
            "That a run of the one is better than one of the other on the same task. An interval that holds 0.5 tells"
            " nothing.",
        )
    learned = {task: {m: curve for m, curve in of.items() if m in short} for task, of in learning.items()}
    learned = {task: of for task, of in islice(learned.items(), TASKS) if of}
    if learned:
        ends = (f"{m} in {task} ends at {words(c[-1][1])}" for task, of in learned.items() for m, c in of.items())
        add(
            "learning",
            figures.learning(learned, short, score),
            "Learning",
            "; ".join(ends),
            "Mean over runs of the evaluations during the training, in worlds of their own, with 95 % intervals.",
        )
    for path in place.glob("*.pdf"):
        if path.stem not in {picture.name for picture in made}:
            path.unlink()
    return made
