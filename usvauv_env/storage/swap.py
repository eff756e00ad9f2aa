"""Replacing a folder by another in one step."""

from __future__ import annotations

import ctypes
import errno
import os
import sys
from pathlib import Path

AT_FDCWD, RENAME_EXCHANGE = -100, 2  # Linux, renameat2(2)
RENAME_SWAP = 2  # macOS, renamex_np(2)
OLD = "-old"  # ending of a folder that is on its way out


def replace_folder(new: Path, place: Path) -> None:
    """Put the folder `new` at `place`; what was there is then at `new`, or nothing.

    On Linux and macOS both names are exchanged at once: at every moment there is a folder at `place`. Where the system
    cannot do that, `place` is renamed before: a process killed in between leaves it as NEW-old, see `found`.

    Raises:
        OSError: refused; `place` is as before.
    """
    try:
        _exchange(new, place)
    except FileNotFoundError:
        os.replace(new, place)
    except NotImplementedError:
        old = new.with_name(new.name + OLD)
        os.replace(place, old)
        try:
            os.replace(new, place)
        except OSError:
            os.replace(old, place)
            raise
        os.replace(old, new)


def found(place: Path) -> Path:
    """Where the folder of `place` is: there, or where a `replace_folder` of now or of a killed process put it."""
    if not place.exists():
        old = [path for path in place.parent.glob(f".{place.name}-*{OLD}") if path.is_dir()]
        if old:
            return max(old, key=lambda path: path.stat().st_mtime_ns)
    return place


def _exchange(one: Path, other: Path) -> None:
    """Exchange two names.

    Raises:
        NotImplementedError: this system or file system cannot.
        OSError: refused, also because one of them does not exist.
    """
    names = os.fsencode(one), os.fsencode(other)
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "darwin":
            failed = library.renamex_np(*names, RENAME_SWAP)
        else:
            failed = library.renameat2(AT_FDCWD, names[0], AT_FDCWD, names[1], RENAME_EXCHANGE)
    except (AttributeError, TypeError, OSError):  # no such function, or no such library as on Windows
        raise NotImplementedError from None
    if failed:
        number = ctypes.get_errno()
        if number in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP):
            raise NotImplementedError
        raise OSError(number, os.strerror(number), str(other))
