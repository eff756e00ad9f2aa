"""How much memory is free, refusing what does not fit before any of it is taken, and giving back what is not used."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

import torch

from usvauv.kernels.errors import UserError

SHARE = 0.8  # of what is free that one thing may take
CGROUP = Path("/sys/fs/cgroup")


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
    """Return to the system what was freed; glibc keeps it, after compiling kernels tens of MB."""
    if os.name == "posix" and (trim := getattr(ctypes.CDLL(None), "malloc_trim", None)):
        trim(0)


def words(number: float) -> str:
    """Bytes to three digits, in one unit."""
    for unit, size in (("TiB", 2.0**40), ("GiB", 2.0**30)):
        if number >= size:
            return f"{number / size:.3g} {unit}"
    return f"{number / 2**20:.3g} MiB"


def _meminfo() -> int:
    """What the kernel could hand out without swapping; without /proc, all physical memory."""
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
    """What an address space limit (ulimit -v) leaves."""
    try:
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft == resource.RLIM_INFINITY:
            return None
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        return soft - pages * os.sysconf("SC_PAGE_SIZE")
    except (ImportError, OSError, ValueError):
        return None
