"""Memory: how much is free, refusing requests that do not fit before allocating, and rows on the disk instead."""

from __future__ import annotations

import ctypes
import math
import mmap
import os
import resource
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import torch

from usvauv.env.storage.files import OutputError
from usvauv.kernels.errors import UserError

SHARE = 0.8  # of the free memory that one request may take
CGROUP = Path("/sys/fs/cgroup")
ANOTHER = "(TMPDIR names another folder)"
PLACE = "/var/tmp"  # of rows on the disk; unlike /tmp never in memory


class MemoryNeeded(UserError, MemoryError):
    """Something asked for does not fit into memory; one line says what, how much it takes and how much is free."""


def available(device: torch.device | None = None) -> int:
    """Free bytes: of a GPU, or of this machine within the limits of its control group."""
    if device is not None and device.type == "cuda":
        return torch.cuda.mem_get_info(device)[0]
    free = [_meminfo(), _cgroup("memory.max", "memory.current"), _limit()]
    return max(0, min(number for number in free if number is not None))


def require(number: float, what: str, device: torch.device | None = None) -> None:
    """Refuse what takes more bytes than `SHARE` of those free.

    Args:
        number: bytes.
        what: what takes them, for the message, with the fields or options that decide it.
        device: where; default the machine's memory.

    Raises:
        MemoryNeeded: it does.
    """
    free = available(device)
    if number > SHARE * free:
        raise MemoryNeeded(
            f"{what}: takes about {words(number)} of memory; allowed are {words(SHARE * free)},"
            f" {SHARE:.0%} of the {words(free)} that are free"
        )


def give_back() -> None:
    """Return freed memory to the system; glibc keeps it, after compiling kernels tens of MB."""
    if trim := getattr(ctypes.CDLL(None), "malloc_trim", None):
        trim(0)


def words(number: float) -> str:
    """Bytes to three digits, in one unit."""
    for unit, size in (("TiB", 2.0**40), ("GiB", 2.0**30)):
        if number >= size:
            return f"{number / size:.3g} {unit}"
    return f"{number / 2**20:.3g} MiB"


def _meminfo() -> int:
    """Memory available without swapping; without /proc, all physical memory."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) << 10 for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError):
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _cgroup(limit: str, used: str) -> int | None:
    try:
        return int((CGROUP / limit).read_text()) - int((CGROUP / used).read_text())
    except (OSError, ValueError):  # none, or "max"
        return None


def _limit() -> int | None:
    """Memory left by an address space limit (ulimit -v)."""
    try:
        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft == resource.RLIM_INFINITY:
            return None
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        return soft - pages * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return None


class StoredRows(np.memmap):
    """An array (T, …) of a file, to be read row by row: earlier rows are not kept in memory."""

    _mmap: mmap.mmap  # of numpy.memmap

    def __getitem__(self, key: Any) -> Any:
        self._mmap.madvise(mmap.MADV_DONTNEED)
        return np.asarray(super().__getitem__(key))


class RowsOnDisk:
    """Rows (…) float32 that are appended to a file without a name, as long as the context lasts.

    The file goes with the last array of it. It lies in the folder that the environment variable TMPDIR names, or in
    `PLACE`.

    Args:
        rows: how many are expected. shape: of a row. what: they are, with the user's file, for the message.

    Raises:
        OutputError: the file cannot be made, or the disk lacks the room.
    """

    def __init__(self, rows: int, shape: tuple[int, ...], what: str) -> None:
        folder = os.environ.get("TMPDIR") or (PLACE if os.access(PLACE, os.W_OK) else tempfile.gettempdir())
        self._shape, self._count, self._folder, self._what = shape, 0, folder, what
        needed = 4.0 * rows * math.prod(shape)
        with self._writing():
            free = shutil.disk_usage(folder).free
            if needed > free:
                raise OutputError(
                    f"{what}: takes {words(needed)} of disk; {words(free)} are free in {folder} {ANOTHER}"
                )
            self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 (closed with the context)

    def __enter__(self) -> RowsOnDisk:
        return self

    def __exit__(self, *problem: object) -> None:
        with suppress(OSError):  # of a full disk, which `append` has reported
            self._file.close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = error.strerror or error
            raise OutputError(f"{self._what}: cannot be kept in {self._folder} meanwhile: {reason} {ANOTHER}") from None

    def append(self, rows: np.ndarray) -> None:
        """Append rows (N, …).

        Raises:
            OutputError: the disk is full.
        """
        with self._writing():
            self._file.write(np.ascontiguousarray(rows, np.float32).data)
        self._count += len(rows)

    def array(self) -> np.ndarray:
        """All rows so far, (T, …), not to be written to."""
        with self._writing():
            self._file.flush()
        shape = self._count, *self._shape
        if 0 in shape:  # nothing can be mapped
            return np.zeros(shape, np.float32)
        return StoredRows(self._file, np.float32, "r", shape=shape)


def extremes(rows: np.ndarray) -> tuple[float, float]:
    """Lowest and highest number, 0 among them."""
    lowest = min((float(row.min(initial=0.0)) for row in rows), default=0.0)
    return lowest, max((float(row.max(initial=0.0)) for row in rows), default=0.0)
