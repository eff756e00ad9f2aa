"""Threads of Taichi's kernels on a CPU."""

import contextlib
import os
from pathlib import Path

THREADS = Path("/proc/self/task")  # on Linux


def threads() -> set[int]:
    """Numbers of this process's threads; none where the system does not tell them."""
    return {int(thread.name) for thread in THREADS.iterdir()} if THREADS.exists() else set()


def bind(created: set[int], count: int) -> None:
    """Keep each of the `count` threads of kernels, the last of the `created`, on a core of its own if they have all.

    Else Linux often wakes two on the same core and leaves them there until a short loop has ended: a step of thousands
    of worlds takes a tenth longer. With fewer threads than cores other processes may have the same plan, and the same
    cores. Where the system does not allow it, threads stay as they are.
    """
    cores = sorted(os.sched_getaffinity(0)) if created else []
    if len(cores) == count:
        with contextlib.suppress(OSError):
            for thread, core in zip(sorted(created)[-count:], cores, strict=True):
                os.sched_setaffinity(thread, {core})
