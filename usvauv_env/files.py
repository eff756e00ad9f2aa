"""Writing files so that a reader never finds half of one, and so that a failure is one line that names the file."""

from __future__ import annotations

import errno
import io
import os
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from usvauv.kernels.errors import UserError

# How libraries that do not raise OSError name the system's error number: HDF5, safetensors.
ERROR_NUMBER = re.compile(r"\b(?:errno = |os error |code: )(\d+)")
THIS_HOST = platform.node().replace("/", "_") or "host"


class OutputError(UserError, ValueError):
    """A file cannot be written as asked; the message is one line that names its path."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the system's refusal to write `path`, by whichever library it is reported, into one line.

    Raises:
        OutputError: the system refused; other exceptions pass.
    """
    try:
        yield
    except Exception as error:
        reason = None if isinstance(error, UserError) else _reason(error)
        if reason is None:
            raise
        raise OutputError(f"{path}: cannot be written: {reason}") from None


def _reason(error: Exception) -> str | None:
    """The system's words for an error; None if it is not the system's."""
    number = error.errno if isinstance(error, OSError) else None
    if number is None and (found := ERROR_NUMBER.search(str(error))):
        number = int(found.group(1))
    if number is not None:
        return os.strerror(number)
    return next(iter(str(error).splitlines()), type(error).__name__) if isinstance(error, OSError) else None


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """An empty file beside `path` for the block to fill, which takes the place of `path` when the block succeeds.

    After an error or Ctrl-C it is removed, and what stood at `path` before stays as it was. What a killed process left
    is removed by the next one that writes `path` on the same host.

    Raises:
        OutputError: `path` is a folder or a device, its folder is missing, or the system refuses to write; checked on
            entry, so before long work in the block.
    """
    with writing(path):
        target, partial = _claim(path)
        try:
            yield partial
            sync(partial)
            os.replace(partial, target)
        finally:
            partial.unlink(missing_ok=True)


def check_place(path: Path) -> None:
    """Refuse a path that `atomic_write` would refuse, before long work.

    Raises:
        OutputError: as `atomic_write`.
    """
    with writing(path):
        _claim(path)[1].unlink()


def _claim(path: Path) -> tuple[Path, Path]:
    """The file to be written, behind all links, and an empty file beside it."""
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        number = errno.EISDIR if target.is_dir() else errno.EINVAL
        raise OSError(number, os.strerror(number))
    _remove_stale(target)
    partial = target.with_name(f"{target.name}.{THIS_HOST}-{os.getpid()}.partial")
    partial.touch()
    return target, partial


def _remove_stale(path: Path) -> None:
    """Remove what dead processes of this host left of `path`."""
    if os.name != "posix":  # elsewhere asking for a process by its number can end it
        return
    ours = re.compile(re.escape(f"{path.name}.{THIS_HOST}-") + r"(\d+)\.partial")
    for name in os.listdir(path.parent):
        if (match := ours.fullmatch(name)) and not _alive(int(match.group(1))):
            path.with_name(name).unlink(missing_ok=True)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass
    return True


def sync(path: Path) -> None:
    """Wait until a file or folder is on the disk, so that a power cut does not undo a later rename alone."""
    if path.is_dir() and os.name != "posix":
        return
    number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)


class HDF5File(io.FileIO):
    """A file to be written by HDF5, which crashes the process when it cannot close a file.

    HDF5 is told that every write succeeded; `check` raises the first one that failed. Nor does HDF5 survive an
    exception while it calls these methods: use it within `usvauv.kernels.interruption.deferred`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._error: OSError | None = None

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        length = len(view)
        try:
            while len(view) and self._error is None:
                view = view[super().write(view) or 0 :]
        except OSError as error:
            self._error = error
        return length

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self._error = self._error or error
            return self.tell() if size is None else size

    def check(self) -> None:
        """Raise the first error of writing.

        Raises:
            OSError: a write failed.
        """
        if self._error is not None:
            raise self._error


@contextmanager
def hdf5_file(path: Path) -> Iterator[HDF5File]:
    """As `atomic_write`, a file for HDF5, which is to be closed by HDF5 before the block ends.

    Raises:
        OutputError: as `atomic_write`.
    """
    with atomic_write(path) as partial, HDF5File(partial) as file:
        yield file
        file.check()
