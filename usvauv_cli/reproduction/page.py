"""A table or figure from its runs to its page in Markdown.

Figures and tables stand in `paper.RESULTS` beside the page and are linked relative to it, so that both can be moved
together.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from usvauv.cli.reproduction import collaboration, fig4, learning, paper
from usvauv.cli.reproduction.paper import FULL, QUICK, Settings, best
from usvauv.cli.sweep.engine import Engine
from usvauv.cli.sweep.perform import perform_all
from usvauv.cli.sweep.run_folder import Piece, seconds
from usvauv.cli.terminal import counted, duration
from usvauv.env.storage.files import atomic_write, inside, locked
from usvauv.kernels.errors import UserError
from usvauv.policies import checkpoint
from usvauv.policies.training.figures import EVALUATION_SEED_OFFSET


class Target(NamedTuple):
    """A table or figure: title of its page, what it shows, its runs, what draws it and gives what the page has of it.

    `pace` is the work of runs that is done in a second on two cores, as measured for all of `PAPER` and for `WIDE`.
    """

    title: str
    about: str
    runs: Callable[[Settings], list[Piece]]
    make: Callable[[Settings, Path, Path], list[str]]
    pace: float = 23.7e6 / (67 * 60)


PAPER = {
    "table2": Target(
        "Table 2, reproduced",
        "Table 2: DDPG, SAC, TD3, the baseline and heuristics, in ideal and extreme sea",
        learning.table_runs,
        learning.make_table,
    ),
    "fig3": Target(
        "Fig. 3, reproduced",
        "Figure 3: learning curves of the three algorithms",
        partial(learning.learned_runs, methods=learning.LEARNING),
        learning.make_curves,
    ),
    "fig4a": Target(
        "Fig. 4(a), reproduced",
        "Figure 4(a): tracks of the AUVs and the boat in extreme sea",
        fig4.track_runs,
        fig4.make_tracks,
    ),
    "fig4b": Target(
        "Fig. 4(b), reproduced", "Figure 4(b): position errors by where the boat is", fig4.error_runs, fig4.make_errors
    ),
}
WIDE = Target(
    "When the boat decides the mission",
    "boat strategies in wide, by range of hearing, ping interval, drift and number of boats",
    collaboration.runs,
    collaboration.make,
    1.99e6 / (10 * 60),
)
TARGETS = (*PAPER, "all", collaboration.NAME)


def listed() -> Iterator[tuple[str, str]]:
    """Each target, with what it shows, and about how long it takes, in whole minutes."""
    for name in TARGETS:
        wanted = list(PAPER.values()) if name == "all" else [PAPER.get(name, WIDE)]
        about, took = "all of these on one page" if name == "all" else wanted[0].about, []
        for settings in (FULL, QUICK):
            work = {piece.key: piece.work / each.pace for each in wanted for piece in each.runs(settings)}
            took.append(duration(60 * math.ceil(sum(work.values()) / 60)))
        yield name, f"{about[0].upper()}{about[1:]}; about {took[0]} on two cores, {took[1]} with --quick."


def reproduce(
    target: str, settings: Settings, folder: Path, make_engine: Callable[[], Engine], threads: int, command: str
) -> Path:
    """Train and evaluate what a target needs and is not there yet, write its tables, figures and page.

    Raises:
        UserError: a run failed; all others are done.
        KeyboardInterrupt: after Ctrl-C, when everything is saved.
    """
    title, name, wanted = "Table 2 and Figures 3 and 4 of the paper, reproduced", "reproduction", list(PAPER.values())
    if target != "all":
        wanted = [PAPER.get(target, WIDE)]
        title, name = wanted[0].title, target
    with locked(folder):
        pieces = list({piece.key: piece for each in wanted for piece in each.runs(settings)}.values())
        if failure := perform_all(pieces, folder, make_engine, threads, "auto"):
            raise UserError(failure)
        results = folder / paper.RESULTS
        inside(folder, results).mkdir(exist_ok=True)
        sections = [section for each in wanted for section in each.make(settings, folder, results)]
        if wanted != [WIDE]:
            sections += conventions(settings)
        page = folder / f"{name}.md"
        with atomic_write(page) as partial_file:
            text = "\n\n".join([f"# {title}", *sections, *how_made(pieces, settings, folder, command)])
            partial_file.write_text(f"{text}\n", encoding="utf-8")
    return page


def conventions(settings: Settings) -> list[str]:
    """Every convention: the fields of scenarios that hold them, the paper's or demonstration's beside ours, and the
    training settings of every method."""
    scenarios = [settings.scenario(name) for name in (paper.CONDITIONS["ESC"], paper.PHYSICAL)]
    head = ["", "paper (P) or demonstration (D)", "field", *(f"`{scenario.name}`" for scenario in scenarios)]
    fields = [
        [*((about, theirs) if i == 0 else ("", "")), f"`{field}`", *(_shown(attrgetter(field)(of)) for of in scenarios)]
        for about, theirs, names in paper.CONVENTIONS
        for i, field in enumerate(names)
    ]
    columns = [asdict(method.config) for method in settings.methods]
    trained = [[f"`{name}`", *(_shown(of[name]) for of in columns)] for name in columns[0] if name != "seed"]
    trained.append(["boat", *(f"`{method.usv}`" for method in settings.methods)])
    changes = (", ".join(f"`{change}`" for change in method.learning) for method in settings.methods)
    trained.append(["scenario while learning", *changes])
    return [
        "## Conventions",
        paper.EXPLAINED.strip(),
        "Fields of the scenarios that decide what the numbers are; `usvauv scenarios paper-extreme` prints all:",
        paper.markdown_table(head, fields),
        "Settings of the training runs:",
        paper.markdown_table(["", *(method.title for method in settings.methods)], trained),
    ]


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return " × ".join(map(str, value))
    return value if isinstance(value, str) else json.dumps(value)


def how_made(pieces: Sequence[Piece], settings: Settings, folder: Path, command: str) -> list[str]:
    """How the page was made."""
    trained = [piece for piece in pieces if piece.definition["training"]]
    lines = []
    if trained:
        seeds = ", ".join(map(str, settings.seeds))
        first, last = (settings.seeds[place] + EVALUATION_SEED_OFFSET for place in (0, -1))
        commits = {best(piece, folder)["commit"] for piece in trained}
        lines = [
            f"Seeds of the training runs: {seeds}; of the worlds that choose a run's policy: {first} to {last}; of the"
            f" worlds tested in: {settings.test_seed}.",
            f"Training: {settings.steps:,} world-steps a run, {settings.evaluations} evaluations of {settings.judged}"
            f" episodes. Tests: {settings.episodes} episodes a run and condition.",
            f"Commits: {', '.join(sorted(commits))}.",
        ]
    taken = sum(seconds(piece.place(folder)) or 0.0 for piece in pieces)
    lines.append(f"Time taken: {duration(taken, rough=True)} for {counted(len(pieces), 'run')}, one after the other.")
    if trained:
        learning = sum(checkpoint.read_run(piece.place(folder))[2]["seconds"] for piece in trained)
        lines.append(f"The {len(trained)} trainings took {duration(learning, rough=True)} of it.")
    return ["## How it was made", f"    {command}", "\n".join(f"- {line}" for line in lines)]
