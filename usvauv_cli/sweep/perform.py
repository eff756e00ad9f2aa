"""Runs on an engine until all are done or Ctrl-C, shown in the terminal: a live table, elsewhere a line for each run
that ends.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType

from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table

from usvauv.cli import tables
from usvauv.cli.sweep.clusters import OnRay, OnSlurm
from usvauv.cli.sweep.engine import Ended, Engine, Task, conduct, reported, signs_in
from usvauv.cli.sweep.local import Local
from usvauv.cli.sweep.run import FAILURE, Piece, perform
from usvauv.cli.sweep.study import Resources
from usvauv.cli.sweep.summary import LONGEST
from usvauv.env import plugins
from usvauv.env.storage import memory
from usvauv.env.storage.files import atomic_write
from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError

MOST_ROWS = 14  # of running runs
MEASURED = 20.0  # seconds of work by which the time of the whole is estimated
MOST_JOBS = 1000  # of a Slurm array at a time, unless told otherwise


def engine(resources: Resources, folder: Path, ray: str | None, slurm: str | None, jobs: int | None) -> Engine:
    """The engine that options choose; `jobs` are by default as many as there are cores and memory for.

    Raises:
        UserError: options that exclude each other, or an engine that is not there.
    """
    if ray not in (None, "local") and jobs is not None:
        raise UserError(f"--jobs {jobs}: must go without --ray {ray}, whose resources decide")
    room = [runtime.available_cores() / resources.cores, memory.available() / (resources.memory * 1e9)]
    if resources.gpu:
        room.append(1 / resources.gpu)
    here = jobs or max(1, int(min(room)))
    needs = resources.cores, resources.memory, resources.gpu
    if ray is not None:
        return OnRay(ray, here, *needs)
    if slurm is not None:
        return OnSlurm(folder / "slurm", slurm, jobs or MOST_JOBS, *needs, resources.hours)
    return Local(here, resources.cores)


def perform_all(
    pieces: Sequence[Piece], folder: Path, make_engine: Callable[[], Engine], threads: int, arch: str
) -> str:
    """Do what is left of runs; returns which failed in words, empty if none did. The others are done then.

    Args:
        pieces: runs of different definitions.
        folder: of everything; it exists and is locked.
        make_engine: called if something is left.
        threads: of a run.
        arch: as `usvauv.kernels.runtime.start` takes it.

    Raises:
        KeyboardInterrupt: after Ctrl-C, when what was running is saved.
    """
    left = {piece.key: piece for piece in pieces if not piece.finished(folder)}
    if not left:
        print(f"all {len(pieces)} runs are done already; nothing is left to do")
        return ""
    done = len(pieces) - len(left)
    print(f"{len(left)} of {len(pieces)} runs to do" + (f", {done} are done" if done else ""), flush=True)
    files = tuple(plugins.loaded())
    with signs_in(folder.resolve()) as signs, Board(list(left.values())) as board:

        def ended(result: Ended) -> None:
            if result.how != "done":
                place = left[result.name].place(folder)
                place.mkdir(parents=True, exist_ok=True)
                with atomic_write(place / FAILURE) as partial_file:
                    partial_file.write_text(f"{result.details or result.words}\n", encoding="utf-8")
            board.ended(result)

        def watch() -> None:
            found = {key: reported(signs, key) for key in board.unfinished}
            board.update({key: units for key, units in found.items() if units is not None})

        tasks = [
            Task(
                key,
                partial(perform, piece.definition, piece.evaluate, piece.place(folder).resolve()),
                signs,
                threads,
                arch,
                files,
            )
            for key, piece in left.items()
        ]
        conduct(make_engine(), tasks, signs, ended, watch)
    if not board.failed:
        return ""
    where = folder / "runs"
    return f"{board.failed} of {len(pieces)} runs failed, see {where}/*/{FAILURE}; the same command tries them again"


class Board:
    """Shows runs while it is a context.

    Attributes:
        unfinished: keys of the runs that have not ended.
        failed: number of those that failed.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self._pieces = {piece.key: piece for piece in pieces}
        self._work = {key: piece.work for key, piece in self._pieces.items()}
        self._short = tables.shortened([name for piece in pieces for name in (piece.method, piece.task)], LONGEST)
        self.unfinished = dict.fromkeys(self._pieces)
        self.failed = 0
        self._begun = time.monotonic()
        self._done, self._seen = dict[str, float](), set[str]()  # work done by run, runs that have reported some
        self._measured, self._before = 0.0, 0.0  # when the first one did, and work that was done before it was watched
        self._console = Console(markup=False, emoji=False, highlight=False)
        self._live = Live(console=self._console, refresh_per_second=4, transient=True)

    def __enter__(self) -> Board:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()

    def ended(self, result: Ended) -> None:
        """Show that a run has ended; the last line of one that failed stays."""
        del self.unfinished[result.name]
        self._done[result.name] = self._work[result.name]
        bad = result.how != "done"
        self.failed += bad
        if bad or not self._console.is_terminal:
            piece, number = self._pieces[result.name], len(self._pieces) - len(self.unfinished)
            words = f"failed: {result.words}" if bad else "done"
            line = f"{number}/{len(self._pieces)} {piece.method} in {piece.task}, seed {piece.seed}: {words}"
            left = self._left() if self.unfinished else ""
            self._console.print(tables.wrapped(f"{line}{left} ({result.name})", 2), soft_wrap=True)

    def update(self, done: Mapping[str, float]) -> None:
        """Show how much work is done of the runs that have begun."""
        self._done |= done
        new = {key: units for key, units in done.items() if units and key not in self._seen}
        if new and not self._seen:  # the time before includes compilation
            self._measured, self._before = time.monotonic(), sum(self._done.values())
        else:
            self._before += sum(new.values())  # a resumed run begins with what it had
        self._seen |= new.keys()
        self._live.update(self.table())

    def _left(self) -> str:
        """Expected time in words; empty until enough work is done to measure its rate."""
        taken, done = time.monotonic() - self._measured, sum(self._done.values()) - self._before
        if not self._seen or taken < MEASURED or done <= 0:
            return ""
        left = sum(self._work.values()) - sum(self._done.values())
        return f", about {duration(max(left, 0.0) * taken / done)} left"

    def table(self) -> RenderableType:
        """The live table: it fits 80 columns and 20 lines."""
        running = [key for key in self._done if key in self.unfinished]
        done, waiting = len(self._pieces) - len(self.unfinished) - self.failed, len(self.unfinished) - len(running)
        head = f"{done} of {len(self._pieces)} done, {len(running)} running, {waiting} waiting, {self.failed} failed"
        table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
        for heading in ("method", "task", "seed", "done"):
            table.add_column(heading, justify="left" if heading in ("method", "task") else "right", no_wrap=True)
        for key in running[:MOST_ROWS]:
            piece, share = self._pieces[key], min(self._done[key] / self._work[key], 1.0)
            table.add_row(self._short[piece.method], self._short[piece.task], str(piece.seed), f"{share:.0%}")
        return Group(f"{head}; {duration(time.monotonic() - self._begun)}{self._left()}", table)


def duration(seconds: float) -> str:
    """A time in words."""
    minutes = round(seconds / 60)
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
