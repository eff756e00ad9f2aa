"""One process at a time in a folder, or with a file."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path

from usvauv.env.files import OutputError, writing

NAME = ".lock"
UNSUPPORTED = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
FAR = 1 << 30  # where Windows locks a byte, so that the process id before it can be read

if sys.platform == "win32":
    import msvcrt

    def _acquire(file: FileIO) -> None:
        file.seek(FAR)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _acquire(file: FileIO) -> None:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes that ask for the same lock out of `folder`.

    The operating system holds the lock and drops it when this process ends, however it ends: a lock file left by a
    killed process locks nothing, even if its process id is in use again. Where the file system knows no locks, nobody
    is kept out.

    Raises:
        OutputError: another process holds it, which is named, or the folder cannot be written.
    """
    path = folder / NAME
    with writing(folder):
        file = open_locked(path, folder)
    try:
        with writing(folder):
            file.seek(0)
            file.truncate()
            file.write(str(os.getpid()).encode())
        yield
    finally:
        with suppress(OSError):  # the folder may be gone, and Windows removes no open file
            path.unlink()
        file.close()


def open_locked(path: Path, place: Path) -> FileIO:
    """A file, created where it is missing, that nobody else can open with this function before it is closed.

    Args:
        path: of the file; a process id in it is that of its holder.
        place: what is locked by it, for the message.

    Raises:
        OutputError: another process has it.
        OSError: the system's refusal.
    """
    while True:
        file = FileIO(os.open(path, os.O_RDWR | os.O_CREAT, 0o666), "r+")
        try:
            _acquire(file)
            if os.fstat(file.fileno()).st_ino == path.stat().st_ino:
                return file
        except FileNotFoundError:
            pass  # as below
        except OSError as error:
            if error.errno in UNSUPPORTED:
                return file
            file.seek(0)
            holder = file.read(20).decode(errors="replace").strip()
            file.close()
            if error.errno not in (errno.EAGAIN, errno.EACCES, errno.EDEADLK):
                raise
            by = f"process {holder}" if holder.isdigit() else "another process"
            raise OutputError(f"{place}: {by} is writing there") from None
        file.close()  # its holder has removed it in the meantime
