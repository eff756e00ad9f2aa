"""Processes of this machine, each with cores of its own where there are enough."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import NamedTuple

from usvauv.cli.sweep.engine import Ended, Task
from usvauv.kernels.interruption import SIGNALS, deferred, in_thread

THREADS = "OMP_NUM_THREADS"  # environment variable that libraries read when they are loaded
LOST = "a process was ended from outside, perhaps for lack of memory"


class _Worker(NamedTuple):
    """A process and this end of its pipe; `place` is which cores it has."""

    process: SpawnProcess
    pipe: Connection
    place: int


class Local:
    """Up to `jobs` processes, which are kept for further tasks; one that dies takes only its own task with it.

    Args:
        jobs: processes at a time.
        threads: of each; with `jobs` · `threads` cores or more each has as many cores, which no other has.
    """

    def __init__(self, jobs: int, threads: int) -> None:
        self._threads = threads
        self._free = list(range(jobs))[::-1]  # places
        self._cores = _apart(jobs, threads)
        self._waiting: deque[Task] = deque()
        self._idle: list[_Worker] = []
        self._busy: dict[Connection, tuple[_Worker, str]] = {}

    def submit(self, tasks: Sequence[Task]) -> None:
        self._waiting += tasks

    def wait(self, seconds: float) -> list[Ended]:
        while self._waiting and (self._idle or self._free):
            worker = self._idle.pop() if self._idle else self._begin(self._free.pop())
            task = self._waiting.popleft()
            self._busy[worker.pipe] = worker, task.name
            with suppress(OSError):  # it has died; its pipe is at its end below
                worker.pipe.send(task)
        results = []
        for pipe in connection.wait(list(self._busy), seconds):
            assert isinstance(pipe, Connection)
            worker, name = self._busy.pop(pipe)
            try:
                results.append(pipe.recv())
                self._idle.append(worker)
            except (EOFError, OSError):
                worker.process.join()
                pipe.close()
                self._free.append(worker.place)
                reason = worker.process.exitcode or 0
                by = f" by signal {-reason}" if reason < 0 else ""
                results.append(
                    Ended(name, "lost", f"its process was ended{by} from outside, perhaps for lack of memory")
                )
        return results

    def cancel(self, names: Sequence[str]) -> None:
        self._waiting = deque(task for task in self._waiting if task.name not in names)
        for worker, name in list(self._busy.values()):
            if name in names:  # sent to a process that is still starting
                worker.process.kill()

    def close(self) -> None:
        for worker in [*self._idle, *(worker for worker, _ in self._busy.values())]:
            worker.pipe.close()
            worker.process.join()

    def _begin(self, place: int) -> _Worker:
        context = multiprocessing.get_context("spawn")  # a running Taichi does not survive a fork
        here, there = context.Pipe()
        process = context.Process(target=_serve, args=(there, self._cores[place]), daemon=True)
        with _signals_kept_here(), _environment(THREADS, str(self._threads)), _in_root():
            process.start()
        there.close()
        return _Worker(process, here, place)


def _apart(jobs: int, threads: int) -> list[set[int] | None]:
    """Cores of each place, disjoint; None where there are too few, or where the system does not say."""
    if not hasattr(os, "sched_getaffinity"):
        return [None] * jobs
    cores = sorted(os.sched_getaffinity(0))
    if jobs * threads > len(cores):
        return [None] * jobs
    return [set(cores[place * threads : (place + 1) * threads]) for place in range(jobs)]


def _serve(pipe: Connection, cores: set[int] | None) -> None:
    """Do what comes through the pipe, until its other end is closed."""
    threading.excepthook = in_thread
    if cores:
        os.sched_setaffinity(0, cores)
    with suppress(EOFError, OSError):
        while True:
            pipe.send(pipe.recv()())


@contextmanager
def _signals_kept_here() -> Iterator[None]:
    """Let processes that are started get neither Ctrl-C nor SIGTERM: this one handles them for all."""
    with deferred():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _in_root() -> Iterator[None]:
    """Let processes that are started begin in the root folder: imports fail in a folder that is removed meanwhile."""
    here = os.open(".", getattr(os, "O_PATH", os.O_RDONLY))  # the former also where it may not be listed
    try:
        os.chdir("/")
        yield
    finally:
        os.fchdir(here)
        os.close(here)


@contextmanager
def _environment(name: str, value: str) -> Iterator[None]:
    """Let processes that are started have an environment variable."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
