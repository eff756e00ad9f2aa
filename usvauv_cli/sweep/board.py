"""How a study goes, in the terminal: a live table, elsewhere a line for each run that ends."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from types import TracebackType

from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table

from usvauv.cli import tables
from usvauv.cli.engines.task import Ended
from usvauv.cli.sweep.study import Planned
from usvauv.cli.sweep.summary import LONGEST, Labels

MOST_ROWS = 14  # of running runs


class Board:
    """Shows the runs of a study while it is a context.

    Attributes:
        unfinished: keys of the runs that have not ended.
        failed: number of those that failed.
    """

    def __init__(self, runs: Sequence[Planned], names: Labels) -> None:
        self._runs = {planned.key: planned for planned in runs}
        self._names, self._short = names, tables.shortened([part for pair in names.values() for part in pair], LONGEST)
        self.unfinished = dict.fromkeys(self._runs)
        self.failed = 0
        self._begun, self._shares = time.monotonic(), dict[str, float]()
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
        """Tell that a run has ended; the last line of one that failed stays."""
        del self.unfinished[result.name]
        self._shares.pop(result.name, None)
        bad = result.how != "done"
        self.failed += bad
        if bad or not self._console.is_terminal:
            method, task = self._names[result.name]
            number = len(self._runs) - len(self.unfinished)
            words = f"failed: {result.words}" if bad else "done"
            line = f"{number}/{len(self._runs)} {method} in {task}, seed {self._runs[result.name].run.seed}: {words}"
            self._console.print(tables.wrapped(f"{line} ({result.name})", 2), soft_wrap=True)

    def update(self, shares: Mapping[str, float]) -> None:
        """Show how far runs are that have begun, as shares of their work."""
        self._shares = dict(shares)
        self._live.update(self.table())

    def table(self) -> RenderableType:
        """The live table: it fits 80 columns and 20 lines."""
        done = len(self._runs) - len(self.unfinished) - self.failed
        waiting = len(self.unfinished) - len(self._shares)
        minutes, seconds = divmod(round(time.monotonic() - self._begun), 60)
        head = f"{done} of {len(self._runs)} done, {len(self._shares)} running, {waiting} waiting, {self.failed} failed"
        table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
        for heading in ("method", "task", "seed", "done"):
            table.add_column(heading, justify="left" if heading in ("method", "task") else "right", no_wrap=True)
        for key, share in list(self._shares.items())[:MOST_ROWS]:
            method, task = (self._short[name] for name in self._names[key])
            table.add_row(method, task, str(self._runs[key].run.seed), f"{min(share, 1.0):.0%}")
        return Group(f"{head}; {minutes} min {seconds} s", table)
