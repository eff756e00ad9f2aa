"""The folder in which Taichi caches compiled kernels, checked before Taichi starts.

Taichi 1.7 neither repairs nor replaces a damaged file, or a missing one that its index lists: it ends, or compiles the
kernel at each start. Damaged files are renamed here, with the index, and Taichi makes both anew.
"""

import contextlib
import hashlib
import os
import re
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path

INDEX, LOCK, DAMAGED = "ticache.tcb", "ticache.lock", ".damaged"
SEEN = "usvauv.seen"  # size and time of each kernel's file that was found whole, so that it is read once
LEFT_BEHIND = 60.0  # seconds; Taichi holds the lock of its cache for a few
PATIENCE = 2.0  # seconds to wait for the lock
KERNEL = re.compile(r"T[0-9a-f]{64}")
HEAD = struct.Struct("<4sIQQ")  # of a kernel's file: mark, architecture, bytes of its description and of its code
DIGEST = 64  # letters after them
ARCHITECTURES = 16  # more than Taichi has
VERSION = struct.Struct("<Q3H")  # of the index: its length, and Taichi's version
COUNTS, LENGTH, ENTRY = struct.Struct("<2Q"), struct.Struct("<Q"), struct.Struct("<3Q")


def check(folder: Path, version: tuple[int, ...]) -> None:
    """Set aside what is damaged in the folder, with a line on standard error, and a lock that a killed process left.

    Taichi waits a quarter of a second for a lock, then continues without the folder, as each later process would. While
    another process writes, nothing is looked at.

    Args:
        folder: the one given to Taichi; need not exist.
        version: of Taichi; an index of another one is left to it.
    """
    with contextlib.suppress(OSError), _locked(folder):
        broken = _damaged_kernels(folder)
        index = folder / INDEX
        if broken or (index.exists() and not _agrees(index.read_bytes(), folder, version)):
            for name in filter(lambda name: (folder / name).exists(), (*broken, INDEX)):
                os.replace(folder / name, folder / (name + DAMAGED))
            print(
                f"usvauv: compiled kernels in {folder}: damaged files, renamed to *{DAMAGED}, are made anew",
                file=sys.stderr,
            )


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Holding the lock that Taichi takes to read and write; an OSError if another process keeps it."""
    lock, start = folder / LOCK, time.monotonic()
    while True:
        try:
            os.close(os.open(lock, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
            break
        except FileExistsError:
            if time.time() - lock.stat().st_mtime > LEFT_BEHIND:
                lock.unlink()
            elif time.monotonic() - start > PATIENCE:
                raise
            else:
                time.sleep(0.02)
    try:
        yield
    finally:
        lock.unlink()


def _damaged_kernels(folder: Path) -> list[str]:
    """Names of the kernels' files that are not whole."""
    files = {entry.name: entry.stat() for entry in os.scandir(folder) if entry.name.endswith(".tic")}
    stamps = {f"{name} {stat.st_size} {stat.st_mtime_ns}": name for name, stat in files.items()}
    seen, new = folder / SEEN, stamps.keys()
    if seen.exists():
        new = new - set(seen.read_text(errors="replace").splitlines())
    damaged = {stamp for stamp in new if not _is_whole((folder / stamps[stamp]).read_bytes())}
    if new:
        seen.write_text("\n".join(stamps.keys() - damaged))
    return sorted(stamps[stamp] for stamp in damaged)


def _is_whole(data: bytes) -> bool:
    """Whether a kernel's file is as Taichi wrote it: its lengths and the SHA-256 of description and code."""
    if len(data) < HEAD.size + DIGEST:
        return False
    mark, arch, description, code = HEAD.unpack_from(data)
    digest = hashlib.sha256(data[HEAD.size : -DIGEST]).hexdigest().encode()
    sized = len(data) == HEAD.size + description + code + DIGEST
    return mark == b"TIC\0" and arch < ARCHITECTURES and sized and data[-DIGEST:] == digest


def _agrees(data: bytes, folder: Path, version: tuple[int, ...]) -> bool:
    """Whether the index can be read to its end, and names kernels that are there."""
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
            file = folder / f"{names[0]}.tic"
            if names[0] != names[1] or not KERNEL.fullmatch(names[0]) or file.stat().st_size != size:
                return False
    except (struct.error, UnicodeDecodeError, OSError):
        return False
    return place == length == len(data)
