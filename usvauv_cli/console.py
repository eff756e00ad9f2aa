"""Progress of long work in the terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text

from usvauv.cli.words import duration

SHOW_AFTER = 2.0  # seconds of work; shorter work shows nothing
LINE_EVERY = 10.0  # seconds between lines where the output is not a terminal


class Advance(Protocol):
    """Takes the number of units just done, and lines that say how things stand, which replace those before."""

    def __call__(self, units: int, lines: Sequence[str] | None = None) -> None: ...


@contextmanager
def progress(description: str, total: int) -> Iterator[Advance]:
    """Show the progress of long work and the time left; the function it gives takes the number of units just done.

    A terminal gets a bar that is removed at the end, below the lines; a file or pipe gets a line every `LINE_EVERY`
    seconds, and below it the lines if they are new; work shorter than `SHOW_AFTER` shows nothing. All of it goes to
    standard error.
    """
    console = Console(file=sys.stderr)
    begun = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task = bar.add_task(description, total=total)
    done, shown, first, started = 0, begun + SHOW_AFTER - LINE_EVERY, 0, 0.0
    said: list[str] = []
    new = False
    live = Live(
        get_renderable=lambda: Group(*(Text(line) for line in said), bar.get_renderable()),
        console=console,
        transient=True,
    )

    def advance(units: int, lines: Sequence[str] | None = None) -> None:
        nonlocal done, shown, first, started, new
        if lines is not None:
            said[:], new = lines, True
        done += units
        now = time.monotonic()
        if not first:  # the time until the first unit includes compilation
            first, started = done, now
        bar.update(task, advance=units)
        if now - begun < SHOW_AFTER:
            return
        if console.is_terminal:
            live.start()
        elif now - shown >= LINE_EVERY and first < done < total:
            shown = now
            left = (now - started) * (total - done) / (done - first)
            print(f"{description}: {done / total:.0%}, {duration(left, rough=True)} left", file=sys.stderr, flush=True)
            if new:
                print(*said, sep="\n", file=sys.stderr, flush=True)
                new = False

    try:
        yield advance
    finally:
        live.stop()
