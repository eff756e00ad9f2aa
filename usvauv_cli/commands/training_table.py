"""Output of `usvauv train` during a run: a live table, or lines if the output is not a terminal."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any

from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table

from usvauv.cli import terminal
from usvauv.cli.commands.training_curve import HEIGHT, curve
from usvauv.cli.evaluation.comparison import Estimate, interval, words
from usvauv.cli.terminal import LINE_EVERY, counted, duration, redraws


def mean_of(several: Sequence[Mapping]) -> dict:
    """Mean of each number of records alike, also within records in them; what is no number is the first one's."""
    means = dict(several[0])
    for name, value in means.items():
        values = [record[name] for record in several]
        if isinstance(value, Mapping):
            means[name] = mean_of(values)
        elif isinstance(value, float):
            means[name] = statistics.fmean(values)
    return means


def of_seeds(figures: Sequence[dict]) -> dict:
    """Figures of several runs as those of one: means, the margin's interval over the runs, and as text the evaluations'
    score with its deviation; those of a single run as they are."""
    if len(figures) == 1:
        return figures[0]
    evaluations = [own["evaluation"] for own in figures]
    scores = [own["arps"] for own in evaluations]
    score = f"{statistics.fmean(scores):.2f} ± {statistics.stdev(scores):.2f}"
    means: dict[str, Any] = mean_of(figures) | {"score": score}
    if all("margin" in own for own in evaluations):
        margin = interval([own["margin"] for own in evaluations])
        means["evaluation"] |= {"margin": margin.mean, "margin_half": margin.half}
    return means


@contextmanager
def training(baseline: dict, algorithm: str, scenario: str) -> Iterator[Callable[[dict, Sequence[dict]], None]]:
    """Show a training run as a live table with its curve, outside a terminal as lines; the function it gives takes new
    figures and all evaluations so far."""
    console = Console(markup=False, emoji=False)
    title = f"{algorithm} in {scenario}"
    if redraws(console):
        with Live(console=console, refresh_per_second=4) as live:

            def draw(figures: dict, evaluations: Sequence[dict]) -> None:
                """The table, and under way the curve of the margin where there is room for it."""
                room = console.height >= TALL and figures["steps"] < figures["total"]
                lines = curve(evaluations, baseline["policy"]) if room else []
                live.update(Group(training_table(figures, baseline, title), *lines))

            yield draw
        return
    policy, start = baseline["policy"], baseline["start"]
    begins = f"an untrained network steers much like {start}; " if start else ""
    margin = f"the margin is that over {policy} (ARPS {baseline['arps']:.2f}) in the same episodes"
    print(terminal.wrapped(f"training {title}: {begins}{margin}", 2))
    printed = -LINE_EVERY

    def show(figures: dict, evaluations: Sequence[dict]) -> None:
        """One line, at most every `LINE_EVERY` seconds and at the end."""
        nonlocal printed
        if figures["seconds"] - printed < LINE_EVERY and figures["steps"] < figures["total"]:
            return
        printed = figures["seconds"]
        evaluated = f"at {figures['evaluated_at']:,} {evaluation(figures, policy)}"
        print(f"{_share(figures)}: ARPS {figures['arps']:.2f} in training; {evaluated}", flush=True)

    yield show


def evaluation(figures: dict, baseline: str) -> str:
    """Score of an evaluation, and its margin over the baseline with the 95 % interval."""
    return f"ARPS {_score(figures)} in evaluation{_margin(figures, f', margin over {baseline} ')}"


def _margin(figures: dict, before: str) -> str:
    """The margin over the baseline after some words; empty in a run of an earlier version."""
    found = figures["evaluation"]
    if "margin" not in found:
        return ""
    return f"{before}{words(Estimate(found['margin'], found.get('margin_half', math.nan), 1), sign=True)}"


def _score(figures: dict) -> str:
    """The evaluation's score, of several seeds with its spread."""
    return figures.get("score", f"{figures['evaluation']['arps']:.2f}")


def _share(figures: dict) -> str:
    """The share of a run that is done, and the time left, which nobody knows before updates have begun."""
    known = figures["updates"] and figures["steps"] < figures["total"]
    left = f", {duration(figures['eta'], rough=True)} left" if known else ""
    return f"{min(figures['steps'] / figures['total'], 1):.0%}{left}"


TRAINED = {
    "arps": ("ARPS", "arps"),
    "sdr": ("SDR, Mbit/s", "sdr"),
    "ec": ("EC, W", "ec"),
    "services": ("services", "services"),
    "collisions": ("collisions", "collisions"),
    "border": ("refused moves", "border"),
    "position_error_mean": ("position error, m", "position_error"),
}  # of an evaluation → in words, of the training worlds
TALL = 24 + HEIGHT + 3  # lines of a terminal that holds table and curve
PAIRS, LONGEST_TERM = 3, 13  # a line, and columns of a name, of reward terms and figures of the learner


def training_table(figures: dict, baseline: dict, title: str) -> RenderableType:
    """The live table: progress, figures of the training worlds beside evaluation and baseline, reward, learner.

    It fits 80 columns and, with up to 15 terms of reward, 22 lines.
    """
    steps = f"{figures['steps']:,} of {figures['total']:,} world-steps, {figures['steps_per_second']:,.0f} a second"
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    evaluated = f"evaluation at {figures['evaluated_at']:,}"
    (brief,) = terminal.shortened([baseline["policy"]], 20).values()
    for heading in ("", "training worlds", evaluated, brief):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for name, (label, training) in TRAINED.items():
        values = figures.get(training), figures["evaluation"].get(name), baseline[name]
        cells = ["" if value is None else f"{value:.2f}" for value in values]
        if name == "arps":
            cells[1] = _score(figures)
        table.add_row(label, *cells)
    terms = Table.grid(padding=(0, 1, 0, 0))
    for place in range(1 + 2 * PAIRS):
        terms.add_column(justify="left" if not place or place % 2 else "right", no_wrap=True)
    for group in ("reward", "learner"):
        short = terminal.shortened(figures[group], LONGEST_TERM)
        pairs = [(short[name], f"{value:.3g}") for name, value in figures[group].items()]
        for first in range(0, len(pairs), PAIRS):
            terms.add_row("" if first else group, *chain.from_iterable(pairs[first : first + PAIRS]))
    (named,) = terminal.shortened([title], 40).values()
    margin = _margin(figures, f"margin over {brief} in ARPS: ")
    about = "; ".join(filter(None, (margin, baseline["start"] and f"began near {baseline['start']}")))
    done = f"{steps}, {counted(figures['updates'], 'update')}"
    return Group(f"training {named}: {_share(figures)}", done, table, about, terms)
