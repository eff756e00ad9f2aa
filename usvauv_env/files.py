"""Writing files so that a reader never finds half of one."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kernels.errors import UserError


class OutputError(UserError, ValueError):
    """A file cannot be written as asked; the message is one line that names its path."""


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """An empty file beside `path` for the block to fill, which takes the place of `path` when the block succeeds.

    After an error or Ctrl-C it is removed, and what stood at `path` before stays as it was.

    Raises:
        OutputError: `path` is a folder, its folder is missing, or the system refuses to write; checked on entry, so
            before long work in the block.
    """
    partial = path.with_name(path.name + ".partial")
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        try:
            partial.touch()
            yield partial
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
