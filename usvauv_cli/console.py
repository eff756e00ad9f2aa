"""Progress of long work in the terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

PATIENCE = 2.0  # seconds of work before it is worth showing
LINE_EVERY = 10.0  # seconds between lines where the output is not a terminal


@contextmanager
def progress(description: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show how far long work is and how long it still takes; the function it gives is told of units done.

    A terminal gets a bar that vanishes at the end; a file or pipe gets a line now and then; work shorter than
    `PATIENCE` shows nothing. All of it goes to standard error.
    """
    console = Console(file=sys.stderr)
    begun = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task = bar.add_task(description, total=total)
    done, shown, first, started = 0, begun + PATIENCE - LINE_EVERY, 0, 0.0

    def advance(units: int) -> None:
        nonlocal done, shown, first, started
        done += units
        now = time.monotonic()
        if not first:  # what came before the first unit, such as compiling, says nothing about the rate
            first, started = done, now
        bar.update(task, advance=units)
        if now - begun < PATIENCE:
            return
        if console.is_terminal:
            bar.start()
        elif now - shown >= LINE_EVERY and first < done < total:
            shown = now
            left = (now - started) * (total - done) / (done - first)
            print(f"{description}: {done / total:.0%}, {left:.0f} s left", file=sys.stderr, flush=True)

    try:
        yield advance
    finally:
        bar.stop()
