"""Pieces of work in parallel processes, with progress, until all is done or Ctrl-C."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from usvauv.cli import console
from usvauv.cli.engines.local import finish
from usvauv.cli.engines.task import Signs, Stopped
from usvauv.cli.reproduction.settings import Settings
from usvauv.cli.reproduction.work import Piece, Work
from usvauv.kernels.interruption import stoppable

FIRST_PIECE = 20.0  # seconds of work by which the time of the whole is estimated


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
            work = {str(number): _Run(piece, settings, folder) for number, piece in enumerate(todo)}
            finish(work, folder, min(jobs, len(todo)), advance)


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


@dataclass(frozen=True)
class _Run:
    """Does a piece in a process of its own."""

    piece: Piece
    settings: Settings
    folder: Path

    def __call__(self, signs: Signs) -> None:
        self.piece.run(Work(self.settings, self.folder, signs.advance, signs.stopping))
