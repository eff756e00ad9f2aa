"""Tasks in processes, possibly on other machines: the definition of an engine, running all tasks on one, and the engine
of this machine, `Local`.

Processes that share only a file system communicate through files in a folder SIGNS: SIGNS/NAME holds how much of a task
is done; SIGNS/stop, or the removal of the folder, asks all tasks to stop.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import connection, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Literal, NamedTuple, Protocol
from uuid import uuid4

from usvauv.env.storage.files import inside, writing
from usvauv.kernels.errors import UserError, in_words, text_of
from usvauv.kernels.interruption import SIGNALS, deferred, in_thread

SIGNS = ".signs"
STOP = "stop"  # the sign to stop
REPORT = 0.3  # seconds between two looks at a sign, and between two reports
ATTEMPTS = 3  # at a piece that does not end by itself
UNFINISHED = ("lost", "stopped")

THREADS = "OMP_NUM_THREADS"  # environment variable that libraries read when they are loaded
LOST = "a process was ended from outside, perhaps for lack of memory"


class Stopped(Exception):
    """Work was stopped on request; its results so far are saved."""


class Ended(NamedTuple):
    """How a piece of work ended: it is lost if its process or machine ended before it did."""

    name: str  # of the piece
    how: Literal["done", "stopped", "failed", "lost"]
    words: str = ""  # why it failed, in one line
    details: str = ""  # traceback of an unexpected error


class Signs:
    """The report of a piece of work, and whether it is to stop."""

    def __init__(self, folder: Path, name: str) -> None:
        self._stop, self._report = folder / STOP, folder / name
        self._parent = multiprocessing.parent_process()
        self._done, self._written, self._looked, self._asked = 0.0, 0.0, 0.0, False

    def advance(self, units: float) -> None:
        """Report that much more work as done."""
        self._done += units
        if time.monotonic() - self._written > REPORT:
            self._written = time.monotonic()
            with suppress(OSError):  # the next report replaces one that is lost
                self._report.write_text(repr(self._done), encoding="ascii")

    def stopping(self) -> bool:
        """Whether to stop: it was asked for, or what began this piece has ended, or its command was given again."""
        if not self._asked and time.monotonic() - self._looked > REPORT:
            self._looked = time.monotonic()
            orphaned = self._parent is not None and not self._parent.is_alive()
            self._asked = orphaned or self._stop.exists() or not self._stop.parent.exists()
        return self._asked


def reported(folder: Path, name: str) -> float | None:
    """Work that a piece has reported as done; None: it has not begun."""
    try:
        return float((folder / name).read_text(encoding="ascii"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError):  # it is being written
        return 0.0


@dataclass(frozen=True)
class Task:
    """A piece of work with what its process needs; it can be pickled, and is called in that process."""

    name: str  # of the piece and of its file of signs
    do: Callable[[Signs], None]  # does it, unless it is done already
    signs: Path  # folder of the signs; it exists
    threads: int  # of Taichi's kernels
    arch: str = "auto"  # as `usvauv.kernels.runtime.start` takes it
    plugins: tuple[Path, ...] = ()  # files to load first
    directory: Path = field(default_factory=Path.cwd)  # where relative paths begin

    def __call__(self) -> Ended:
        """Perform the piece in this process; any exception becomes the answer."""
        from usvauv.env import plugins
        from usvauv.kernels import runtime

        signs = Signs(self.signs, self.name)
        try:
            if signs.stopping():
                return Ended(self.name, "stopped")
            signs.advance(0.0)
            os.chdir(self.directory)
            plugins.load_installed()
            for file in self.plugins:
                plugins.load(file)
            runtime.start(self.arch, self.threads)
            self.do(signs)
        except Stopped:
            return Ended(self.name, "stopped")
        except UserError as error:
            details = traceback.format_exc() if error.__cause__ else ""  # of what a plugin raised
            return Ended(self.name, "failed", text_of(error) or in_words(error), details)
        except (Exception, SystemExit) as error:
            return Ended(self.name, "failed", in_words(error), traceback.format_exc())
        return Ended(self.name, "done")


class Engine(Protocol):
    """Something that runs tasks in processes of its own."""

    def submit(self, tasks: Sequence[Task]) -> None:
        """Take tasks, to run each when there is room for it."""
        ...

    def wait(self, seconds: float) -> list[Ended]:
        """The tasks that have ended since the last call; waits up to that long for the first."""
        ...

    def cancel(self, names: Sequence[str]) -> None:
        """Forget tasks that have not begun."""
        ...

    def close(self) -> None:
        """End the processes, none of which has a task."""
        ...


@contextmanager
def signs_in(folder: Path) -> Iterator[Path]:
    """A new folder for signs below `folder`, which is removed at the end. Those of others there are removed first, so
    that what they left running on other machines stops.
    """
    signs = inside(folder, folder / SIGNS) / uuid4().hex
    with writing(signs):
        remove_signs(folder)
        signs.mkdir(parents=True)
    try:
        yield signs
    finally:
        with deferred():
            remove_signs(folder)


def remove_signs(folder: Path) -> None:
    """Remove the signs below a folder; they are renamed first, so that nobody reports there meanwhile."""
    with suppress(OSError):
        inside(folder, folder / SIGNS).rename(folder / f"{SIGNS}-{uuid4().hex}")
    for gone in folder.glob(f"{SIGNS}-*"):
        shutil.rmtree(gone, ignore_errors=True)


def conduct(
    engine: Engine,
    tasks: Sequence[Task],
    signs: Path,
    ended: Callable[[Ended], None],
    watch: Callable[[], None] = lambda: None,
) -> None:
    """Run tasks and close the engine. What ends it early, as Ctrl-C does, asks those that run to stop, and waits."""
    left, attempts = {task.name: task for task in tasks}, Counter()

    def collect() -> Iterator[Ended]:
        for result in engine.wait(REPORT):
            attempts[result.name] += 1
            if result.how not in UNFINISHED or attempts[result.name] == ATTEMPTS:
                del left[result.name]
            yield result

    try:
        engine.submit(tasks)
        while left:
            for result in collect():
                if result.name in left:
                    engine.submit([left[result.name]])
                else:
                    ended(result)
            watch()
    except BaseException:
        with deferred():
            (signs / STOP).touch()
            waiting = [name for name in left if reported(signs, name) is None]
            engine.cancel(waiting)
            running = left.keys() - set(waiting)
            while running:
                running -= {result.name for result in engine.wait(REPORT)}
        raise
    finally:
        with deferred():
            engine.close()


class _Worker(NamedTuple):
    """A process and this end of its pipe; `place` is which cores it has."""

    process: SpawnProcess
    pipe: Connection
    place: int


class Local:
    """Up to `jobs` processes, which are kept for further tasks; one that dies takes only its own task with it.

    With `jobs` · `threads` cores or more each has as many cores, which no other has.
    """

    def __init__(self, jobs: int, threads: int) -> None:
        os.environ[THREADS] = str(threads)  # for the processes; this one has loaded its libraries
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
                why = f"its process was ended{by} from outside, perhaps for lack of memory"
                results.append(Ended(name, "lost", why))
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
        with _signals_kept_here(), chdir("/"):  # imports fail in a folder that is removed meanwhile
            process.start()
        there.close()
        return _Worker(process, here, place)


def _apart(jobs: int, threads: int) -> list[set[int] | None]:
    """Cores of each place, disjoint; None where there are too few, or where the system does not say."""
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
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
    resource_tracker.ensure_running()  # which, as it starts, unblocks them
    with deferred():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
