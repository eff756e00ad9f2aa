"""A table or figure from its pieces of work to its page."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from usvauv import policies
from usvauv.cli.reproduction import collaboration, fig3, fig4a, fig4b, page, pool, settings, table2
from usvauv.cli.reproduction.runs import Learned
from usvauv.cli.reproduction.settings import Settings
from usvauv.cli.reproduction.work import Piece
from usvauv.env.storage.files import atomic_write
from usvauv.kernels.errors import UserError

FIGURES = ("table2", "fig3", "fig4a", "fig4b")
TARGETS = (*FIGURES, "all", collaboration.NAME)
TITLES = {
    "table2": "Table 2, made again",
    "fig3": "Fig. 3, made again",
    "fig4a": "Fig. 4(a), made again",
    "fig4b": "Fig. 4(b), made again",
    "all": "Table 2 and Figures 3 and 4 of the paper, made again",
    collaboration.NAME: "When the boat decides the mission",
}
CLOCK = "time.json"


def reproduce(
    target: str, wanted: Settings, folder: Path, jobs: int, command: str, say: Callable[[str], None] = print
) -> Path:
    """Train and evaluate what a target needs and is not there yet, write its tables, figures and page.

    Args:
        target: one of `TARGETS`.
        wanted: settings of the reproduction.
        folder: of all results; it exists.
        jobs: pieces of work at a time.
        command: command line that makes the page, printed on it.
        say: called with what is going to be done, in words.

    Returns:
        Path of the page.

    Raises:
        UserError: unknown target, or a folder begun with other settings.
        KeyboardInterrupt: after Ctrl-C, when everything is saved.
    """
    if target not in TARGETS:
        raise UserError(f"{target}: must be one of {', '.join(TARGETS)}")
    settings.record(wanted, folder)
    names = FIGURES if target == "all" else (target,)
    pieces = needed(names, wanted)
    say(plan(pieces, wanted, folder))
    with stopwatch(folder, jobs):
        pool.run(pieces, wanted, folder, jobs, say)
        sections = make(names, wanted, folder)
    if target != collaboration.NAME:
        sections.append(page.conventions_section(wanted))
    path = folder / ("reproduction.md" if target == "all" else f"{target}.md")
    page.write(path, TITLES[target], [*sections, made(pieces, wanted, folder, command)])
    return path


def needed(names: Sequence[str], wanted: Settings) -> list[Piece]:
    """The pieces of work for some targets, each once; a run that one of them wants tested is tested."""
    makers = {"table2": table2, "fig3": fig3, "fig4a": fig4a, "fig4b": fig4b, collaboration.NAME: collaboration}
    pieces = list(dict.fromkeys(piece for name in names for piece in makers[name].pieces(wanted)))
    tested = {(p.method, p.trained_in, p.seed) for p in pieces if isinstance(p, Learned) and p.tested}
    return [
        piece
        for piece in pieces
        if not isinstance(piece, Learned) or piece.tested or (piece.method, piece.trained_in, piece.seed) not in tested
    ]


def plan(pieces: Sequence[Piece], wanted: Settings, folder: Path) -> str:
    """What is done and what is left, in a sentence."""
    left = [piece for piece in pieces if piece.left(wanted, folder) > 0]
    if not left:
        return "everything is trained and evaluated"
    runs = sum(isinstance(piece, Learned) for piece in left)
    done = f", {len(pieces) - len(left)} are done" if len(left) < len(pieces) else ""
    return (
        f"{len(left)} pieces of work, {runs} of them training runs of {wanted.steps:,} world-steps with their tests"
        f"{done}; how long it takes is measured on the first"
    )


def make(names: Sequence[str], wanted: Settings, folder: Path) -> list[str]:
    """Write tables and figures of some targets; returns their sections of the page."""
    results = folder / page.RESULTS
    results.mkdir(exist_ok=True)
    makers = {
        "table2": lambda: page.table2_section(table2.make(wanted, folder, results), wanted),
        "fig3": lambda: page.fig3_section(fig3.make(wanted, folder, results), wanted),
        "fig4a": lambda: page.fig4a_section(fig4a.make(wanted, folder, results)),
        "fig4b": lambda: page.fig4b_section(fig4b.make(folder, results), wanted),
        collaboration.NAME: lambda: page.collaboration_section(collaboration.make(folder, results)),
    }
    return [makers[name]() for name in names]


def made(pieces: Sequence[Piece], wanted: Settings, folder: Path, command: str) -> str:
    """Section of the page on how it was made."""
    runs = [piece for piece in pieces if isinstance(piece, Learned)]
    commits = {run.about(folder)["commit"] for run in runs}
    clock = json.loads((folder / CLOCK).read_text(encoding="utf-8"))
    taken = [f"Time taken: {pool.duration(clock['seconds'])} with {clock['jobs']} at a time on {os.cpu_count()} cores."]
    if runs:
        learning = sum(policies.read_run(run.place(folder))[2]["seconds"] for run in runs)
        taken.append(f"The {len(runs)} training runs took {pool.duration(learning)}, one after the other.")
    return page.made_section(command, wanted, commits, taken)


@contextmanager
def stopwatch(folder: Path, jobs: int) -> Iterator[None]:
    """Add the time of the block to that of earlier calls, however it ends."""
    path, begun = folder / CLOCK, time.monotonic()
    try:
        yield
    finally:
        before = json.loads(path.read_text(encoding="utf-8"))["seconds"] if path.exists() else 0.0
        with atomic_write(path) as partial:
            seconds = before + time.monotonic() - begun
            partial.write_text(json.dumps({"seconds": seconds, "jobs": jobs}) + "\n", encoding="utf-8")
