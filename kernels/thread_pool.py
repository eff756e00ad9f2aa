"""Threads of Taichi's kernels on a CPU."""

import os
import sys


def threads() -> set[int]:
    """Numbers of this process's threads, on Linux."""
    return {int(name) for name in os.listdir("/proc/self/task")} if sys.platform == "linux" else set()


def bind(created: set[int], count: int) -> None:
    """Keep each of the `count` threads of kernels, the last of the `created`, on a core of its own if they have all.

    Else Linux often wakes two on the same core and leaves them there until a short loop has ended: a step of thousands
    of worlds takes a tenth longer. With fewer threads than cores other processes may have the same plan, and the same
    cores.
    """
    cores = sorted(os.sched_getaffinity(0)) if created else []
    if len(cores) == count:
        for thread, core in zip(sorted(created)[-count:], cores, strict=True):
            os.sched_setaffinity(thread, {core})
