"""Pieces of work in parallel processes, with progress, until all is done or Ctrl-C."""

from __future__ import annotations

import multiprocessing
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from pathlib import Path

from kernels.errors import UserError
from kernels.interruption import SIGNALS, deferred, in_thread, stoppable
from usvauv_cli import console
from usvauv_cli.reproduction.settings import Settings
from usvauv_cli.reproduction.work import Piece, Stopped, Work
from usvauv_env import plugins

FIRST_PIECE = 20.0  # seconds of work by which the time of the whole is estimated
REPORT = 0.2  # seconds between reports of a process

_work: Work  # of a process of the pool


def run(pieces: Sequence[Piece], settings: Settings, folder: Path, jobs: int, say: Callable[[str], None]) -> None:
    """Do what is left of the pieces, `jobs` at a time; with one job in this process.

    Args:
        say: called with the expected time in words, once it is known.

    Raises:
        KeyboardInterrupt: after Ctrl-C, when everything is saved.
    """
    left = {piece: piece.left(settings, folder) for piece in pieces}
    todo = [piece for piece in pieces if left[piece] > 0]
    if not todo:
        return
    total = round(sum(left.values()))
    with console.progress("reproducing", total) as bar:
        advance = _Expectation(bar, total, say)
        if jobs == 1:
            _alone(todo, settings, folder, advance)
        else:
            _together(todo, settings, folder, min(jobs, len(todo)), advance)


class _Expectation:
    """Passes progress on to a bar, and after `FIRST_PIECE` tells the expected time of the whole."""

    def __init__(self, bar: Callable[[int], None], total: int, say: Callable[[str], None]) -> None:
        self._bar, self._total, self._say = bar, total, say
        self._done, self._first, self._begun, self._told = 0.0, 0.0, 0.0, False

    def __call__(self, units: float) -> None:
        now = time.monotonic()
        before, self._done = self._done, self._done + units
        self._bar(round(self._done) - round(before))
        if not self._begun:  # the time until the first report includes compilation
            self._begun, self._first = now, self._done
        elif not self._told and now - self._begun > FIRST_PIECE:
            self._told = True
            whole = (self._total - self._first) * (now - self._begun) / (self._done - self._first)
            self._say(f"expected time, by the first {now - self._begun:.0f} s of it: {duration(whole)}")


def duration(seconds: float) -> str:
    """A time in words."""
    minutes = round(seconds / 60)
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


def _alone(pieces: Sequence[Piece], settings: Settings, folder: Path, advance: Callable[[float], None]) -> None:
    with stoppable() as stop, suppress(Stopped):
        for piece in pieces:
            stop.raise_if_asked()
            piece.run(Work(settings, folder, advance, lambda: stop.asked))
    stop.raise_if_asked()


def _together(
    pieces: Sequence[Piece], settings: Settings, folder: Path, jobs: int, advance: Callable[[float], None]
) -> None:
    context = multiprocessing.get_context("spawn")  # a running Taichi does not survive a fork
    reports, stop = context.Queue(), context.Event()
    start = (settings, folder, jobs, plugins.loaded(), reports, stop)
    with ProcessPoolExecutor(jobs, context, _begin, start) as pool:
        try:
            with _signals_kept_here():
                running = [pool.submit(_run, piece) for piece in pieces]
            while not all(future.done() for future in running):
                _take(reports, advance, REPORT)
                for future in running:
                    if future.done():
                        future.result()
        except BrokenProcessPool:
            raise UserError("a process was ended from outside, perhaps for lack of memory; try --jobs 1") from None
        finally:
            stop.set()
            with deferred():
                pool.shutdown(cancel_futures=True)
    _take(reports, advance, REPORT)


def _take(reports: Queue[float], advance: Callable[[float], None], patience: float) -> None:
    """Pass on all waiting reports; wait up to `patience` seconds for the first."""
    try:
        while True:
            advance(reports.get(timeout=patience))
            patience = 0.0
    except queue.Empty:
        pass


@contextmanager
def _signals_kept_here() -> Iterator[None]:
    """Let processes that are started get neither Ctrl-C nor SIGTERM: this one handles them for all."""
    with deferred():
        if not hasattr(signal, "pthread_sigmask"):
            yield
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(
    settings: Settings, folder: Path, jobs: int, plugin_files: Sequence[Path], reports: Queue[float], stop: Event
) -> None:
    """Set up a process of the pool, with the plugins of the process that began it."""
    global _work
    from kernels import runtime

    threading.excepthook = in_thread
    plugins.load_installed()
    for file in plugin_files:
        plugins.load(file)
    runtime.start(threads=max(1, runtime.available_cores() // jobs))
    parent = multiprocessing.parent_process()
    done, told = 0.0, 0.0

    def advance(units: float) -> None:
        nonlocal done, told
        done += units
        if time.monotonic() - told > REPORT:
            reports.put(done)
            done, told = 0.0, time.monotonic()

    _work = Work(settings, folder, advance, lambda: stop.is_set() or parent is None or not parent.is_alive())


def _run(piece: Piece) -> None:
    """Do a piece in a process of the pool until it is done or stopped."""
    try:
        if not _work.stopping():
            piece.run(_work)
    except Stopped:
        pass
