"""A study from its file to its results: what is left is done, then tables are written.

DIR/runs/HASH/      a run, see `usvauv_cli.sweep.run`
DIR/results.csv     one row for each run and episode: `FIRST`, then the columns of `usvauv eval`
DIR/summary.json    see `usvauv_cli.sweep.summary`
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from kernels.errors import UserError
from usvauv_cli.engines.conduct import Engine, conduct, signs_in
from usvauv_cli.engines.task import Ended, Task, reported
from usvauv_cli.sweep import summary
from usvauv_cli.sweep.board import Board
from usvauv_cli.sweep.run import FAILURE, RESULT, Perform, finished
from usvauv_cli.sweep.study import Planned, Study
from usvauv_env import plugins
from usvauv_env.files import atomic_write
from usvauv_env.lock import locked
from usvauv_env.record.table import read_rows, write_rows

FIRST = ("run", "method", "task", "training_seed")


def place_of(folder: Path, planned: Planned) -> Path:
    """Folder of a run."""
    return folder / "runs" / planned.key


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
        left = [planned for planned in study.runs if not finished(place_of(folder, planned))]
        if left:
            done = len(study.runs) - len(left)
            print(f"{len(left)} of {len(study.runs)} runs to do" + (f", {done} are done" if done else ""), flush=True)
            failed = _perform(study, left, folder, names, engine)
        else:
            print(f"all {len(study.runs)} runs are done already; nothing is left to do")
            failed = 0
        rows = [
            {**dict(zip(FIRST, (planned.key, *names[planned.key], planned.run.seed), strict=True)), **row}
            for planned in study.runs
            if finished(place_of(folder, planned))
            for row in read_rows(place_of(folder, planned) / RESULT)
        ]
        if rows:
            _write(rows, study, folder)
    if failed:
        raise UserError(
            f"{failed} of {len(study.runs)} runs failed, see {folder / 'runs'}/*/{FAILURE}; the same command tries them"
            " again"
        )


def _perform(
    study: Study, left: list[Planned], folder: Path, names: summary.Labels, engine: Callable[[], Engine]
) -> int:
    """Do runs; returns how many failed."""
    arch = "cuda" if study.resources.gpu else "cpu"
    performs = {planned.key: Perform(planned.definition, place_of(folder, planned).resolve()) for planned in left}
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

        tasks = [Task(key, perform, signs, study.resources.cores, arch, files) for key, perform in performs.items()]
        conduct(engine(), tasks, signs, ended, watch)
        return board.failed


def _write(rows: list[dict[str, Any]], study: Study, folder: Path) -> None:
    """Write the tables and print the summary."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    write_rows(folder / "results.csv", columns, rows)
    results = summary.summary(summary.figures(rows, study.evaluation.score), study.evaluation)
    with atomic_write(folder / "summary.json") as partial:
        partial.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    summary.show(results)
    print(f"{len(rows)} episodes written to {folder / 'results.csv'}, summary to {folder / 'summary.json'}")
