"""Tables of results as CSV files with a header: written whole, or grown on the disk by batches of episodes.

A growing table survives what ends the process, and is taken up again. Beside OUT.csv it is OUT.csv.partial: a line with
what defines its rows, the header of the CSV, and the rows of one batch after the other. A batch counts when all its
rows are there. `finish` puts the rows of each combination together in OUT.csv.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from usvauv.env.storage import text_files
from usvauv.env.storage.files import OutputError, atomic_write, open_locked, writing
from usvauv.kernels.errors import UserError
from usvauv.kernels.interruption import deferred

MARK = b"# usvauv eval "


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
    """What was evaluated: a policy, a boat strategy and a target rule, empty where the task has none."""

    policy: str
    usv: str
    targets: str


TEXTS = {*Combination._fields, "scenario"}  # columns that are no numbers
LONGEST = 2**24  # bytes of each of the first lines


class _Row(NamedTuple):
    """A row that was read, with the place in the file behind it."""

    combination: Combination
    episode: int
    values: dict[str, str]
    end: int


class GrowingTable:
    """The partial table of a CSV, locked for this process while the context lasts.

    First come calls of `take` for the batches that the file may have, in the order in which they were appended; from
    the first that it has not, those of `append`.

    Attributes:
        path: of the partial file.
        about: what `begin` was given by the process that began the file; None: there is none yet.
        count: rows that were taken and appended.
    """

    def __init__(self, out: Path, resume: bool, columns: Sequence[str]) -> None:
        """Open the partial file of `out`, whose rows have these columns.

        Raises:
            UserError: there is none to `resume`, or one that is not to be resumed.
            OutputError: the file cannot be written, another process has it, or it is another thing or damaged.
        """
        self._columns = list(columns)
        self.path = out.with_name(f"{out.name}.partial")
        self.count = 0
        self._out = out
        self._places: dict[Combination, list[tuple[int, int]]] = {}
        if resume and not self.path.exists():
            raise UserError(f"{self.path}: is not there; without it there is nothing to resume")
        with writing(self.path):
            self._file = open_locked(self.path, self.path)
        try:
            with writing(self.path):
                self.about, self._header, self._end = self._opening()
                if self.about is None:
                    self._file.truncate(0)
            if self.about is not None and not resume:
                raise UserError(
                    f"{self.path}: holds episodes of an earlier run; take it up with --resume, or remove it"
                )
        except BaseException:
            self._file.close()
            raise
        self._ahead = self._rows()
        self._next = next(self._ahead, None)

    def __enter__(self) -> GrowingTable:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._file.closed:
            return
        self._ahead.close()
        with suppress(OSError):  # the folder may be gone
            if os.fstat(self._file.fileno()).st_size == 0:
                self.path.unlink()
        self._file.close()

    def begin(self, about: Mapping[str, Any]) -> None:
        """Set what defines the rows of a new table; it is written before the first of them."""
        self.about = dict(about)

    def take(self, combination: Combination, first: int, count: int) -> list[dict[str, str]] | None:
        """Rows of the next batch, if it is that of these episodes.

        Otherwise all that the file still has is dropped: a batch that was cut, or one of another length.
        """
        rows, begin = [], self._end
        while (row := self._next) and len(rows) <= count and row[:2] == (combination, first + len(rows)):
            rows.append(row.values)
            self._end, self._next = row.end, next(self._ahead, None)
        if len(rows) == count:
            self._placed(combination, begin, count)
            return rows
        self._end, self._next = begin, None
        return None

    def append(self, combination: Combination, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the rows of a batch, and wait until they are on the disk.

        Raises:
            OutputError: the file cannot be written.
        """
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, self._columns)
        if not self._header:
            writer.writeheader()
            self._header = text.getvalue().encode()
            self._write(MARK + json.dumps(self.about, allow_nan=False).encode() + b"\n" + self._header)
            text.seek(0)
            text.truncate()
        writer.writerows(rows)
        begin = self._end
        self._write(text.getvalue().encode(errors="backslashreplace"))
        self._placed(combination, begin, len(rows))

    def finish(self) -> None:
        """Write the CSV: combination by combination, in the order in which they came; the partial file is removed.

        Raises:
            OutputError: the CSV cannot be written; the partial file stays.
        """
        with atomic_write(self._out) as partial, partial.open("wb") as target, self.path.open("rb") as source:
            target.write(self._header)
            for places in self._places.values():
                for begin, end in places:
                    source.seek(begin)
                    target.write(source.read(end - begin))
        self._ahead.close()
        self._file.close()
        with writing(self.path):
            self.path.unlink()

    def _placed(self, combination: Combination, begin: int, count: int) -> None:
        self._places.setdefault(combination, []).append((begin, self._end))
        self.count += count

    def _write(self, data: bytes) -> None:
        with writing(self.path), deferred():
            self._file.truncate(self._end)
            self._file.seek(self._end)
            view = memoryview(data)
            while view:
                view = view[self._file.write(view) :]
            os.fsync(self._file.fileno())
            self._end += len(data)

    def _opening(self) -> tuple[dict[str, Any] | None, bytes, int]:
        """What defines the rows, the CSV's header, and where the rows begin; None of a file that was cut before."""
        with self.path.open("rb") as file:
            first, header = file.readline(LONGEST), file.readline(LONGEST)
        if not (first.startswith(MARK) or MARK.startswith(first)):
            raise OutputError(f"{self.path}: is not of an evaluation that was stopped; remove it or take another --out")
        if not header.endswith(b"\n"):
            return None, b"", 0
        try:
            about = text_files.parse(first[len(MARK) :].decode(), "JSON")
            right = isinstance(about.get("definition"), dict) and type(about.get("batch")) is int and about["batch"] > 0
            if not right or next(csv.reader([header.decode()])) != self._columns:
                raise ValueError
        except (ValueError, csv.Error):
            raise OutputError(
                f"{self.path}: its first lines are damaged, or of another version; remove it or take another --out"
            ) from None
        return about, header, len(first) + len(header)

    def _rows(self) -> Generator[_Row]:
        """Rows of the file up to the first that is not whole, or no row of numbers."""
        end = self._end

        def lines() -> Generator[str]:
            nonlocal end
            for line in file:
                if not line.endswith(b"\n"):
                    return
                end += len(line)
                yield line.decode()

        with self.path.open("rb") as file, suppress(csv.Error, ValueError):
            file.seek(end)
            for values in csv.reader(lines()):
                row = dict(zip(self._columns, values, strict=True))
                if any(math.isinf(float(text)) for name, text in row.items() if name not in TEXTS):
                    return
                yield _Row(Combination(*(row[name] for name in Combination._fields)), int(row["episode"]), row, end)
