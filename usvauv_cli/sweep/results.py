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

from usvauv.cli.sweep import report, summary
from usvauv.cli.sweep.engine import Engine
from usvauv.cli.sweep.perform import perform_all
from usvauv.cli.sweep.study import Study
from usvauv.cli.words import counted
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.scenario import Scenario
from usvauv.env.storage.files import atomic_write, locked
from usvauv.env.storage.tables import write_rows
from usvauv.kernels.errors import UserError

TABLE = "results.csv"
FIRST = ("run", "method", "task", "training_seed")


def sweep(study: Study, folder: Path, make_engine: Callable[[], Engine]) -> None:
    """Do what is left of a study, write its tables and print its summary.

    Args:
        study: what is wanted.
        folder: of everything; it exists.
        make_engine: called if something is left.

    Raises:
        UserError: a run failed; all others are done.
        KeyboardInterrupt: after Ctrl-C, when what was running is saved.
    """
    with locked(folder):
        failure = perform_all(study.runs, folder, make_engine, study.resources.cores, study.resources.arch)
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
    print(f"report: {report.write_report(folder, study, results)}")


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
