"""Runs on an engine until all are done or Ctrl-C, shown in the terminal: bars, elsewhere a line for each run
that ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TaskProgressColumn, TextColumn, TimeRemainingColumn

from usvauv.cli import tables, words
from usvauv.cli.sweep.clusters import OnRay, OnSlurm
from usvauv.cli.sweep.engine import Ended, Engine, Task, conduct, remove_signs, reported, signs_in
from usvauv.cli.sweep.local import Local
from usvauv.cli.sweep.run import FAILURE, Piece, perform
from usvauv.cli.sweep.study import Resources
from usvauv.cli.sweep.summary import LONGEST
from usvauv.env import plugins
from usvauv.env.storage import memory
from usvauv.env.storage.files import atomic_write, inside
from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError

MOST_ROWS = 14  # of running runs
RECENT = 300.0  # seconds of work by which the time of the rest is estimated
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
        return OnSlurm(inside(folder, folder / "slurm"), slurm, jobs or MOST_JOBS, *needs, resources.hours)
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
        remove_signs(folder)  # of a killed command, whose runs went on elsewhere
        print(f"nothing to do: {words.counted(len(pieces), 'run')} done already")
        return ""
    done = len(pieces) - len(left)
    print(
        f"{len(left)} of {words.counted(len(pieces), 'run')} to do" + (f", {done} done already" if done else ""),
        flush=True,
    )
    files = tuple(plugins.loaded())
    with signs_in(folder) as signs, Board(list(left.values())) as board:

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
    failed = f"{board.failed} of {words.counted(len(pieces), 'run')} failed"
    return f"{failed}, see {where}/*/{FAILURE}; the same command tries them again"


class Board:
    """Shows runs while it is a context.

    Attributes:
        unfinished: keys of the runs that have not ended.
        failed: number of those that failed.
        bars: of all work and of the runs that have begun.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self._pieces = {piece.key: piece for piece in pieces}
        self._work = {key: piece.work for key, piece in self._pieces.items()}
        self._short = tables.shortened([name for piece in pieces for name in (piece.method, piece.task)], LONGEST)
        self.unfinished = dict.fromkeys(self._pieces)
        self.failed = 0
        self._done = dict[str, float]()  # work by run
        self._rows = dict[str, TaskID]()
        self._console = Console(markup=False, emoji=False, highlight=False)
        self.bars = Progress(
            *(TextColumn(f"{{task.{field}}}", markup=False) for field in ("description", "fields[task]")),
            BarColumn(8),
            TaskProgressColumn(),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
            speed_estimate_period=RECENT,
        )
        self._all = self.bars.add_task("", total=sum(self._work.values()), task="")
        self.update({})

    def __enter__(self) -> Board:
        self.bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bars.stop()

    def ended(self, result: Ended) -> None:
        """Show that a run has ended; the last line of one that failed stays."""
        del self.unfinished[result.name]
        if result.name in self._rows:
            self.bars.remove_task(self._rows.pop(result.name))
        bad = result.how != "done"
        self.failed += bad
        self.update({result.name: self._work[result.name]})
        if bad or not self._console.is_terminal:
            piece, number = self._pieces[result.name], len(self._pieces) - len(self.unfinished)
            how = f"failed: {result.words}" if bad else "done"
            line = f"{number}/{len(self._pieces)} {piece.method} in {piece.task}, seed {piece.seed}: {how}"
            left = self.bars.tasks[0].time_remaining
            line += f", about {words.duration(left, rough=True)} left" if left and self.unfinished else ""
            self._console.print(tables.wrapped(f"{line} ({result.name})", 2), soft_wrap=True)

    def update(self, done: Mapping[str, float]) -> None:
        """Show how much work is done of runs."""
        self._done |= done
        for key, units in done.items():
            if key in self.unfinished:
                if key not in self._rows:
                    piece = self._pieces[key]
                    method, task = (self._short[name] for name in (piece.method, piece.task))
                    self._rows[key] = self.bars.add_task(method, total=self._work[key], task=f"{task} {piece.seed}")
                self.bars.update(self._rows[key], completed=min(units, self._work[key]))
        for place, row in enumerate(self._rows.values()):
            self.bars.update(row, visible=place < MOST_ROWS)
        count, waiting = len(self._pieces), len(self.unfinished) - len(self._rows)
        ended = count - len(self.unfinished)
        state = f"{len(self._rows)} running, {waiting} waiting, {self.failed} failed"
        self.bars.update(
            self._all, completed=sum(self._done.values()), description=f"{ended} of {count} ended", task=state
        )
