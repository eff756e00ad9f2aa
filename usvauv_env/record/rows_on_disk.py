"""Rows of an array in a temporary file, for what would not fit into memory: the sea of every step of a mission."""

from __future__ import annotations

import math
import mmap
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from usvauv.env.files import OutputError, writing
from usvauv.env.memory import words

PLACE = "/var/tmp"  # unlike /tmp never in memory


class StoredRows(np.memmap):
    """An array (T, …) of a file, to be read row by row: what was read before is not kept in memory."""

    _mmap: mmap.mmap  # of numpy.memmap

    def __getitem__(self, key: Any) -> Any:
        self._mmap.madvise(mmap.MADV_DONTNEED)
        return np.asarray(super().__getitem__(key))


class RowsOnDisk:
    """Rows (…) float32 that are appended to a file without a name, as long as the context lasts.

    The file goes with the last array of it. It lies in the folder that the environment variable TMPDIR names, or in
    `PLACE`.
    """

    def __init__(self, rows: int, shape: tuple[int, ...], what: str) -> None:
        """
        Args:
            rows: how many are expected.
            shape: of a row.
            what: they are, for the message.

        Raises:
            OutputError: the file cannot be made, or the disk lacks the room.
        """
        folder = os.environ.get("TMPDIR") or (PLACE if os.access(PLACE, os.W_OK) else tempfile.gettempdir())
        self._shape, self._count, self._folder = shape, 0, Path(folder)
        needed = 4.0 * rows * math.prod(shape)
        with writing(self._folder):
            free = shutil.disk_usage(folder).free
            if needed > free:
                raise OutputError(
                    f"{what}: takes {words(needed)} of disk; {words(free)} are free in {folder} (TMPDIR names another)"
                )
            self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 (closed with the context)

    def __enter__(self) -> RowsOnDisk:
        return self

    def __exit__(self, *problem: object) -> None:
        with suppress(OSError):  # of a full disk, which was told
            self._file.close()

    def append(self, rows: np.ndarray) -> None:
        """Append rows (N, …).

        Raises:
            OutputError: the disk is full.
        """
        with writing(self._folder):
            self._file.write(np.ascontiguousarray(rows, np.float32).data)
        self._count += len(rows)

    def array(self) -> np.ndarray:
        """All rows so far, (T, …), not to be written to."""
        with writing(self._folder):
            self._file.flush()
        shape = self._count, *self._shape
        if 0 in shape:  # nothing can be mapped
            return np.zeros(shape, np.float32)
        return StoredRows(self._file, np.float32, "r", shape=shape)


def extremes(rows: np.ndarray) -> tuple[float, float]:
    """Lowest and highest number, 0 among them."""
    lowest = min((float(row.min(initial=0.0)) for row in rows), default=0.0)
    return lowest, max((float(row.max(initial=0.0)) for row in rows), default=0.0)
