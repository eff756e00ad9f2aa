"""Text and tables of the commands, as wide as the terminal, or 80 columns where the output goes to a file or a pipe."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

WIDTH = 80
UNLIMITED = 100_000


def width() -> int:
    """Columns of the terminal that is standard output; `WIDTH` where it is none."""
    console = Console()
    return console.width if console.is_terminal else WIDTH


def wrapped(text: str, indent: int = 0) -> str:
    """Text in lines that fit, broken at spaces alone; those after the first are indented."""
    lines = textwrap.wrap(text, width(), subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)
    return "\n".join(lines)


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
    """Print a table, in as many parts below each other as it takes to fit. No cell is cut.

    Args:
        headings: of the columns.
        rows: cells.
        names: number of leading columns that hold names; they are aligned left and repeated in each part.
        limit: columns of text; by default `width()`.
    """
    limit = limit or width()
    console = Console(width=UNLIMITED, markup=False, emoji=False)

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
