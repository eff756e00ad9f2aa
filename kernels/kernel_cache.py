"""The folder in which Taichi caches compiled kernels, checked before Taichi starts.

Taichi 1.7 neither repairs nor replaces a damaged index, or a kernel's file that is cut off or missing: it ends, or
compiles the kernel at each start. Such a folder is emptied here, and Taichi makes all files anew.
"""

import contextlib
import os
import struct
import sys
import time
from pathlib import Path

INDEX, LOCK = "ticache.tcb", "ticache.lock"
LEFT_BEHIND = 60.0  # seconds; Taichi holds the lock of its cache for a few
VERSION = struct.Struct("<Q3H")  # of the index: its length, and Taichi's version
COUNTS, LENGTH, ENTRY = struct.Struct("<2Q"), struct.Struct("<Q"), struct.Struct("<3Q")


def check(folder: Path, version: tuple[int, ...]) -> None:
    """Empty the folder where its index and its files differ, with a line on standard error.

    A lock that a killed process left is removed: Taichi waits a quarter of a second for it, then continues without the
    folder, as each later process would. While another process writes, nothing is looked at.

    Args:
        folder: the one given to Taichi; need not exist.
        version: of Taichi; an index of another one is left to it.
    """
    lock, index = folder / LOCK, folder / INDEX
    with contextlib.suppress(OSError):
        try:
            os.close(os.open(lock, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
        except FileExistsError:
            if time.time() - lock.stat().st_mtime < LEFT_BEHIND:
                return
        try:
            if index.exists() and not _agrees(index.read_bytes(), folder, version):
                for file in (index, *folder.glob("*.tic")):
                    file.unlink()
                print(f"usvauv: compiled kernels in {folder}: damaged, are made anew", file=sys.stderr)
        finally:
            lock.unlink()


def _agrees(data: bytes, folder: Path, version: tuple[int, ...]) -> bool:
    """Whether the index can be read to its end, and names kernels whose files have the sizes that it tells."""
    try:
        length, *written_by = VERSION.unpack_from(data)
        if length == len(data) and tuple(written_by) != version:
            return True
        _, count = COUNTS.unpack_from(data, VERSION.size)
        place = VERSION.size + COUNTS.size
        for _ in range(count):
            names = []
            for _ in range(2):
                (letters,) = LENGTH.unpack_from(data, place)
                place += LENGTH.size + letters
                names.append(data[place - letters : place].decode())
            size, *_ = ENTRY.unpack_from(data, place)
            place += ENTRY.size
            if names[0] != names[1] or (folder / f"{names[0]}.tic").stat().st_size != size:
                return False
    except (struct.error, UnicodeDecodeError, OSError, ValueError):
        return False
    return place == length == len(data)
