"""Output of commands in the terminal: text and tables of its width, progress of long work, and formatted numbers.

Text and tables are as wide as the terminal, or 80 columns wide if the output goes to a file or a pipe.
"""

from __future__ import annotations

import re
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

WIDTH = 80
UNLIMITED = 100_000
SHOW_AFTER = 2.0  # seconds of work; shorter work shows nothing
KEPT = "\N{NO-BREAK SPACE}"
LINE_EVERY = 10.0  # seconds between lines where the output is not a terminal


def width() -> int:
    """Columns of the terminal on standard output; `WIDTH` if it is not a terminal."""
    from rich.console import Console  # here, as it takes long to import

    console = Console()
    return console.width if console.is_terminal else WIDTH


def redraws(console: Console) -> bool:
    """Whether text can be overwritten: on a terminal, except a dumb one, where rich does not show it."""
    return console.is_terminal and not console.is_dumb_terminal


def wrapped(text: str, indent: int = 0) -> str:
    """Text in lines that fit, broken only at spaces, but not behind a number; lines after the first are indented."""
    text = re.sub(r"(?<=\d) (?=\S)", KEPT, text)
    lines = textwrap.wrap(text, width(), subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines).replace(KEPT, " ")


def shortened(names: Iterable[str], longest: int) -> dict[str, str]:
    """Name → the name without its middle where it is longer than `longest` ≥ 8; different names stay different."""
    short: dict[str, str] = {}
    for name in dict.fromkeys(names):
        brief, tail = name, longest - longest // 3 - 1
        if len(name) > longest:
            brief = f"{name[: longest // 3]}…{name[-tail:]}"
        for number in range(2, len(short) + 2):
            if brief not in short.values():
                break
            brief = f"{number}…{name[-(longest - len(str(number)) - 1) :]}"
        short[name] = brief
    return short


def print_table(headings: Sequence[str], rows: Sequence[Sequence[str]], names: int = 1, limit: int = 0) -> None:
    """Print a table in as many parts below each other as needed to fit into `limit` columns of text, by default
    `width()`. No cell is cut. The first `names` columns hold names, aligned left and repeated in each part.
    """
    from rich import box
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table

    limit = limit or width()
    console = Console(width=UNLIMITED, height=1, markup=False, emoji=False)  # without a height a dumb one has a width

    def part(places: Sequence[int]) -> Table:
        table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
        shown = [*range(names), *places]
        for place in shown:
            table.add_column(headings[place], justify="left" if place < names else "right", no_wrap=True)
        for row in rows:
            table.add_row(*(row[place] for place in shown))
        return table

    left = list(range(names, len(headings)))
    while left:
        fitting = len(left)
        while fitting > 1 and Measurement.get(console, console.options, part(left[:fitting])).maximum > limit:
            fitting -= 1
        console.print(part(left[:fitting]))
        left = left[fitting:]
        if left:
            console.print()


@contextmanager
def progress(description: str, total: int, quiet: bool = False) -> Iterator[Callable[..., None]]:
    """Show the progress of long work and the time left; yields a function of the number of units just done and of
    status lines, which replace the previous ones.

    A terminal gets a bar that is removed at the end, below the lines; a file, a pipe or a dumb terminal gets a line
    every `LINE_EVERY` seconds, and below it the lines if they are new; work shorter than `SHOW_AFTER` shows nothing.
    All of it goes to standard error; `quiet` shows nothing.
    """
    if quiet:
        yield lambda units, lines=None: None
        return
    from rich.console import Console, Group
    from rich.live import Live
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    console = Console(file=sys.stderr)
    begun = time.monotonic()
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=console, transient=True, disable=not redraws(console))
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
        if redraws(console):
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


def duration(seconds: float, rough: bool = False) -> str:
    """A time in the units that fit: "7.5 s", "30 s", "16 min 40 s", "2 h 5 min"; roughly, from 1 s on: "17 min"."""
    if rough:
        seconds = max(seconds if seconds < 120 else 60 * round(seconds / 60), 1)
    elif seconds < 10:
        return f"{seconds:.3g} s"
    whole = round(seconds)
    if whole >= 5400:
        parts = (whole // 3600, "h"), (whole // 60 % 60, "min")
    elif whole >= (120 if rough else 60):
        parts = (whole // 60, "min"), (whole % 60, "s")
    else:
        parts = ((whole, "s"),)
    return " ".join(f"{number} {unit}" for number, unit in parts if number)


def size(count: float) -> str:
    """Bytes to three digits, in one unit."""
    for unit, length in (("GB", 1e9), ("MB", 1e6)):
        if count >= 0.95 * length:
            return f"{count / length:.3g} {unit}"
    return f"{max(count / 1e3, 1):.0f} kB"


def counted(number: int, noun: str) -> str:
    """A number of things: "1 step", "0 steps", "12,000 steps"."""
    return f"{number:,} {noun if number == 1 else f'{noun}s'}"
