"""A study from its file to its results: what is left is done, then tables are written.

DIR/runs/HASH/      a run, see `usvauv.cli.sweep.run`
DIR/results.csv     one row for each run and episode: `FIRST`, then the columns of `usvauv eval`; also as .parquet
DIR/summary.json    see `usvauv.cli.sweep.summary`
DIR/report/         see `usvauv.cli.sweep.report`
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from usvauv.cli.engines.conduct import Engine, conduct, signs_in
from usvauv.cli.engines.task import Ended, Task, reported
from usvauv.cli.sweep import report, summary
from usvauv.cli.sweep.board import Board
from usvauv.cli.sweep.run import FAILURE, RESULT, Perform, finished
from usvauv.cli.sweep.study import Planned, Study
from usvauv.env import plugins
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.storage.files import atomic_write, locked
from usvauv.env.storage.tables import read_rows, write_rows
from usvauv.kernels.errors import UserError

TABLE = "results.csv"
FIRST = ("run", "method", "task", "training_seed")


def sweep(study: Study, folder: Path, engine: Callable[[], Engine]) -> None:
    """Do what is left of a study, write its tables and print its summary.

    Args:
        study: what is wanted.
        folder: of everything; it exists.
        engine: makes one; called if something is left.

    Raises:
        UserError: a run failed; all others are done.
        KeyboardInterrupt: after Ctrl-C, when what was running is saved.
    """
    names = summary.labels(study.runs)
    with locked(folder):
        left = [planned for planned in study.runs if not finished(planned.place(folder))]
        if left:
            done = len(study.runs) - len(left)
            print(f"{len(left)} of {len(study.runs)} runs to do" + (f", {done} are done" if done else ""), flush=True)
            failed = _perform(study, left, folder, names, engine)
        else:
            print(f"all {len(study.runs)} runs are done already; nothing is left to do")
            failed = 0
        write(study, folder, names)
    if failed:
        raise UserError(
            f"{failed} of {len(study.runs)} runs failed, see {folder / 'runs'}/*/{FAILURE}; the same command tries them"
            " again"
        )


def _perform(
    study: Study, left: list[Planned], folder: Path, names: summary.Labels, engine: Callable[[], Engine]
) -> int:
    """Do runs; returns how many failed."""
    performs = {planned.key: Perform(planned.definition, planned.place(folder).resolve()) for planned in left}
    work = {key: perform.work for key, perform in performs.items()}
    files = tuple(plugins.loaded())
    with signs_in(folder.resolve()) as signs, Board(left, names) as board:

        def ended(result: Ended) -> None:
            if result.how != "done":
                place = performs[result.name].place
                place.mkdir(parents=True, exist_ok=True)
                with atomic_write(place / FAILURE) as partial:
                    partial.write_text(f"{result.details or result.words}\n", encoding="utf-8")
            board.ended(result)

        def watch() -> None:
            done = {key: reported(signs, key) for key in board.unfinished}
            board.update({key: units / work[key] for key, units in done.items() if units is not None})

        tasks = [
            Task(key, perform, signs, study.resources.cores, study.resources.arch, files)
            for key, perform in performs.items()
        ]
        conduct(engine(), tasks, signs, ended, watch)
        return board.failed


def write(study: Study, folder: Path, names: summary.Labels) -> None:
    """Write the tables and the page, and print the summary."""
    done = [planned for planned in study.runs if finished(planned.place(folder))]

    def rows() -> Iterator[dict[str, Any]]:
        for planned in done:
            first = dict(zip(FIRST, (planned.key, *names[planned.key], planned.run.seed), strict=True))
            for row in read_rows(planned.place(folder) / RESULT):
                yield {**first, **row}

    if done:
        columns = dict.fromkeys(name for row in rows() for name in row)
        write_rows(folder / TABLE, list(columns), rows())
        parquet = _write_parquet(folder / TABLE)
        print(f"{len(done) * study.evaluation.episodes} episodes written to {folder / TABLE}{parquet}")
    results = summary.summary(summary.figures(rows(), study.evaluation.score), study.evaluation)
    with atomic_write(folder / "summary.json") as partial:
        partial.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    summary.show(results)
    print(f"summary: {folder / 'summary.json'}")
    print(f"report: {report.write(folder, study, names, results)}")


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
    with atomic_write(path) as partial:
        parquet.write_table(csv.read_csv(table, convert_options=options), partial)
    return " and .parquet"
