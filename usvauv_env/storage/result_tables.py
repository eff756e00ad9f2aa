"""Tables of results as CSV files with a header: written whole, or extended on the disk by batches of episodes.

A growing table survives the end of the process, and can be continued. It is the folder OUT.csv.partial next to OUT.csv:
`ABOUT`, with the definition of its rows, and a CSV for each batch, either complete or absent. `finish` joins the rows
of each combination in OUT.csv.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from usvauv.env.storage.files import LOCK, OutputError, TextFileError, atomic_write, inside, locked, read_text, writing
from usvauv.kernels.errors import UserError

ABOUT = "evaluation.json"


def write_rows(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows whose keys are the columns; the file appears only when it is complete, its folder if it is missing.

    Raises:
        OutputError: the file cannot be written.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with (
        atomic_write(path) as partial,
        partial.open("w", newline="", encoding="utf-8", errors="backslashreplace") as stream,
    ):
        writer = csv.DictWriter(stream, columns)
        writer.writeheader()
        writer.writerows(rows)


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of such a file, column → text."""
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


class Combination(NamedTuple):
    """An evaluated combination: policy, boat strategy and target rule, empty if the task has none."""

    policy: str
    usv: str
    targets: str


class GrowingTable:
    """The batches of a table that is not complete yet, see `growing_table`.

    Attributes:
        path: of their folder.
        about: what `begin` was given by the process that began it; None: there is none yet.
        count: rows that were taken and appended.
    """

    def __init__(self, out: Path, path: Path, about: dict[str, Any] | None) -> None:
        self._out, self.path, self.about, self.count = out, path, about, 0
        self._files: dict[Combination, list[Path]] = {}

    def begin(self, about: Mapping[str, Any]) -> None:
        """Set what defines the rows of a new table; it is written with the first of them."""
        self.about = dict(about)

    def take(self, combination: Combination, first: int, count: int) -> list[dict[str, str]] | None:
        """Rows of the batch of these episodes, if they are there; combinations come in the same order each time."""
        path = self._place(combination, first, count)
        return self._counted(combination, path, read_rows(path)) if path.exists() else None

    def append(self, combination: Combination, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the rows of a batch, and wait until they are on the disk.

        Raises:
            OutputError: the file cannot be written.
        """
        if not (self.path / ABOUT).exists():
            with atomic_write(self.path / ABOUT) as partial:
                partial.write_text(json.dumps(self.about, allow_nan=False), encoding="utf-8")
        path = self._place(combination, rows[0]["episode"], len(rows))
        write_rows(path, list(rows[0]), rows)
        self._counted(combination, path, rows)

    def finish(self) -> None:
        """Write the CSV: combination by combination, in the order in which they came; the batches are removed.

        Raises:
            OutputError: the CSV cannot be written; the batches stay.
        """
        files = [path for own in self._files.values() for path in own]
        write_rows(self._out, list(read_rows(files[0])[0]), (row for path in files for row in read_rows(path)))
        _remove(self.path)

    def _place(self, combination: Combination, first: int, count: int) -> Path:
        self._files.setdefault(combination, [])
        return inside(self.path, self.path / f"{list(self._files).index(combination)}-{first}-{count}.csv")

    def _counted(self, combination: Combination, path: Path, rows: Any) -> Any:
        self._files[combination].append(path)
        self.count += len(rows)
        return rows


def _own(path: Path) -> list[Path]:
    """Files of a growing table in its folder, also those that a killed process left incomplete."""
    return [*path.glob("*-*-*.csv*"), *path.glob(f"{ABOUT}*")]


def _remove(path: Path) -> None:
    with writing(path):
        for file in _own(path):
            file.unlink()


def begun(out: Path) -> Path:
    """The folder of the growing table of a CSV."""
    return out.with_name(f"{out.name}.partial")


@contextmanager
def growing_table(out: Path, resume: bool, force: bool = False) -> Iterator[GrowingTable]:
    """The growing table of a CSV, which this process has for itself; nothing is left of one without batches.

    Args:
        out: the CSV.
        resume: go on with the one that is there.
        force: else remove it and begin anew.

    Raises:
        UserError: there is none to `resume`, or one that is neither to be resumed nor removed.
        OutputError: its folder cannot be written, another process has it, or what it says of itself is damaged.
    """
    path = begun(out)
    inside(out.parent, path)
    if resume and not path.exists():
        raise UserError(f"{path}: does not exist, so there is nothing to resume")
    if path.exists() and not path.is_dir():
        raise OutputError(f"{path}: is not a folder; remove it or choose another --out")
    with writing(path):
        path.mkdir(exist_ok=True)
    try:
        with locked(path):
            about = None
            if not (path / ABOUT).exists():
                if others := {*path.iterdir()} - {path / LOCK, *_own(path)}:
                    held = f"holds {min(others).name}, which no evaluation wrote"
                    raise OutputError(f"{path}: {held}; remove the folder or choose another --out")
            elif resume:
                about = read_text(inside(path, path / ABOUT), "JSON")
            elif force:
                _remove(path)
            else:
                raise UserError(
                    f"{path}: holds episodes of an earlier run; --resume continues it, --force starts again"
                )
            yield GrowingTable(out, path, about)
    except TextFileError as error:
        raise OutputError(f"{path / ABOUT}: {error}; remove {path} or choose another --out") from None
    finally:
        with suppress(OSError):  # of batches that are kept
            path.rmdir()
