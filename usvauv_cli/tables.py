"""Tables and numbers in words, in the terminal and on pages: how tables are printed, the figures of merit that are
their columns, durations, sizes and counts.

Text and tables are as wide as the terminal, or 80 columns where the output goes to a file or a pipe.
"""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from usvauv.env.scenario import Scenario

WIDTH = 80
UNLIMITED = 100_000


def width() -> int:
    """Columns of the terminal that is standard output; `WIDTH` where it is none."""
    from rich.console import Console  # here, as it takes long to import

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
    from rich import box
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table

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


class Column(NamedTuple):
    """A figure of merit.

    Attributes:
        name: of its column in the CSV.
        heading: name and unit.
        digits: after the point, in the terminal.
        about: what it is.
        better: "more", "less" or neither.
    """

    name: str
    heading: str
    digits: int
    about: str
    better: str = ""


WORK = (
    Column("arps", "ARPS", 2, "reward per step, summed over the AUVs", "more"),
    Column("energy_wh", "energy, Wh", 1, "energy of all AUVs", "less"),
    Column("ec", "EC, W", 1, "mean power of an AUV without its time of hovering", "less"),
    Column("collisions", "collisions", 2, "steps of two AUVs closer than the collision distance", "less"),
    Column("border", "refused moves", 2, "moves refused at the border of the area", "less"),
)
OF_VEHICLES = (
    Column("surfaced", "at surface", 2, "steps of an AUV in which it touched the surface", "less"),
    Column("grounded", "on bed", 2, "steps of an AUV in which it touched the bed", "less"),
)
OF_STATIONS = (Column("target_distance", "off station, m", 2, "mean distance of the AUVs to their targets", "less"),)
OF_NODES = (
    Column("delivered_mbit", "data, Mbit", 1, "data collected from the nodes", "more"),
    Column("services", "services", 1, "completed services of nodes", "more"),
    Column("sdr", "SDR, Mbit/s", 2, "sum over the services of their data rates", "more"),
)
OF_TASK = {
    column.name: column
    for column in (
        Column("lost_mbit", "lost, Mbit", 1, "data that full buffers lost", "less"),
        Column("aoi_mean", "age, s", 0, "age of the data, mean over nodes and time", "less"),
        Column("aoi_peak", "peak age, s", 0, "age just before a service, mean over services", "less"),
        Column("aoi_largest", "largest age, s", 0, "largest age of any node at any time", "less"),
        Column("jain", "Jain's index", 3, "how even data come in from the nodes: 1 if all bring the same", "more"),
        Column("joule_per_mbit", "J/Mbit", 0, "energy over data collected", "less"),
    )
}
POSITIONS = (
    Column("position_error_median", "median, m", 2, "error of the boat's estimates of the AUVs' positions", "less"),
    Column("position_error_rms", "rms, m", 2, "the same, root mean square", "less"),
    Column("position_error_p95", "95 %, m", 2, "the same, 95th percentile", "less"),
    Column("own_error_rms", "own rms, m", 2, "error of where an AUV takes itself to be", "less"),
    Column("fix_error_rms", "fix rms, m", 2, "error of a fix, against where its signal left the AUV", "less"),
    Column("fix_availability", "fixes", 2, "share of steps and AUVs with a usable fix", "more"),
    Column("fix_wrapped", "wrapped", 3, "share of usable fixes that are wrong by whole turns of a phase", "less"),
    Column("fix_dropped", "dropped", 3, "share of detected fixes that the receiver does not use", "less"),
    Column("outage_longest", "outage, s", 0, "longest time of an AUV without a usable fix", "less"),
)
COLUMNS = {
    column.name: column for column in (*WORK, *OF_VEHICLES, *OF_STATIONS, *OF_NODES, *OF_TASK.values(), *POSITIONS)
}


def column_tables(scenario: Scenario, of_task: Collection[str]) -> dict[str, list[Column]]:
    """Columns of each table by its title; `of_task` are the names of the task's own figures."""
    nodes, vehicles = scenario.task_definition.targets == "nodes", OF_VEHICLES if scenario.auv.dynamic else ()
    own = [OF_TASK.get(name, Column(name, name, 2, "a figure of a plugin")) for name in of_task]
    return {
        "Work": [*WORK[:1], *(OF_NODES if nodes else OF_STATIONS), *WORK[1:], *vehicles],
        "Age, losses and cost of data" if nodes else "Of the task": own,
        "Positions and fixes": list(POSITIONS),
    }


def duration(seconds: float, rough: bool = False) -> str:
    """A time in the units that fit: "7.5 s", "30 s", "16 min 40 s", "2 h 5 min".

    Args:
        seconds: the time.
        rough: it is an estimate, of 1 s at least: "17 min".
    """
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


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number of things: "1 step", "0 steps", "12,000 steps"."""
    return f"{number:,} {noun if number == 1 else plural or f'{noun}s'}"
