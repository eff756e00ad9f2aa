"""Output of the commands in the terminal: progress, tables of metrics, summary of a mission, table of a training."""

from __future__ import annotations

import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any, Protocol

from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from usvauv.cli import tables
from usvauv.cli.evaluation.comparison import (
    Comparison,
    Estimate,
    dependence,
    headline,
    interval,
    labels,
    sentences,
    words,
)
from usvauv.cli.tables import Column, column_tables, counted, duration
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.record.trace import Trace
from usvauv.env.scenario import Scenario

# Those shown by default, by task, between ARPS and those of positions; of a plugin's task, all of its own.
BY_TASK = {"data-collection": ("delivered_mbit", "ec"), "station-keeping": ("target_distance", "ec")}
LONGEST_NAME = {1: 30, 2: 24, 3: 16}  # by the number of columns with names

SHOW_AFTER = 2.0  # seconds of work; shorter work shows nothing
LINE_EVERY = 10.0  # seconds between lines where the output is not a terminal


def metrics_tables(comparison: Comparison, scenario: Scenario, seed: int, wide: bool, score: str | None = None) -> None:
    """Print mean ± standard deviation over the episodes of each policy, boat strategy and target rule, differences to
    the reference in the same worlds with their intervals, and a sentence on the headline of each.

    Args:
        comparison: of the episodes.
        scenario, seed: what was run.
        score: figure of the sentence, by default `headline`.
        wide: all figures in three tables of any width, instead of those that matter most in one that fits.
    """
    first, count = comparison.combinations[0], comparison.episodes
    parts = column_tables(scenario, comparison.of_task)
    about = f"{scenario.name}, seed {seed}, {counted(count, 'episode')}"
    several = comparison.combinations
    varied = ["policy", *(name for name in ("usv", "targets") if len({getattr(which, name) for which in several}) > 1)]
    about += "".join(f", {name} {getattr(first, name)}" for name in ("usv", "targets") if name not in varied)
    shown_as = ": mean ± standard deviation" if count > 1 else ""
    print(tables.wrapped(f"{about.removesuffix(', targets ')}{shown_as}"))
    if not wide:
        middle = BY_TASK.get(scenario.task, comparison.of_task)
        everything = {column.name: column for part in parts.values() for column in part}
        names = ("arps", *middle, "position_error_rms", "fix_availability")
        parts = {"": [everything[name] for name in names]}
    limit = tables.UNLIMITED if wide else 0
    for shown in filter(None, parts.values()):
        print()
        _table(comparison, varied, shown, limit)
    score = score or headline(scenario)
    if len(several) > 1:
        name = labels(several)[several.index(comparison.reference)]
        print("\n" + tables.wrapped(f"less {name} in the same world: mean ± half of its 95 % interval"))
        for shown in filter(None, parts.values()):
            print()
            _table(comparison, varied, shown, limit, less=True)
        print()
        for said in sentences(comparison, score):
            print(tables.wrapped(said, 2))
    if said := dependence(comparison, score):
        print("\n" + tables.wrapped(said))
    if not wide:
        print("\nrms: error of the AUVs' estimated positions; fixes: share of steps with one")
        print("all figures: --wide")


def _table(
    comparison: Comparison, varied: Sequence[str], shown: Sequence[Column], limit: int, less: bool = False
) -> None:
    """One table, of means or of differences (`less`), then the names that were shortened."""
    cells: list[list[str]] = []
    for which in comparison.combinations:
        if less and which == comparison.reference:
            continue
        spreads = []
        for name, _, digits, *_ in shown:
            (mean, _, n), deviation = comparison.score(which, name), comparison.deviation(which, name)
            spread = "–" if math.isnan(mean) else f"{mean:.{digits}f}{f' ± {deviation:.{digits}f}' if n > 1 else ''}"
            spreads.append(words(comparison.difference(which, name), sign=True) if less else spread)
        cells.append([*(getattr(which, name) for name in varied), *spreads])
    long = [] if limit else [name for row in cells for name in row[: len(varied)]]
    short = tables.shortened(long, LONGEST_NAME[len(varied)])
    headings = [*varied, *(column.heading.replace(",", "") for column in shown)]
    brief_cells = [[short.get(cell, cell) for cell in row] for row in cells]
    tables.print_table(headings, brief_cells, len(varied), limit)
    for name, brief in short.items():
        if name != brief and not less:
            print(tables.wrapped(f"{brief} = {name}", 2))


def intervals(comparison: Comparison, name: str) -> list[str]:
    """A figure of each combination so far, and its difference to the reference, with 95 % intervals, as lines."""
    names = labels(comparison.combinations)
    short = tables.shortened(names, LONGEST_NAME[1])
    lines = [f"{name}, mean of {counted(comparison.episodes, 'episode')} with 95 % interval:"]
    for which, label in zip(comparison.combinations, names, strict=True):
        line = f"  {short[label]}: {words(comparison.score(which, name))}"
        if which != comparison.reference:
            line += f", difference {words(comparison.difference(which, name), sign=True)}"
        lines.append(line)
    if said := dependence(comparison, name):
        lines.append(said)
    return lines


def mission_summary(row: EpisodeMetrics, trace: Trace) -> None:
    """Print the metrics of one mission in sentences."""
    scenario, found = trace.scenario, row.of_task
    heave = trace.boat_surface[:, 0, :, 0]
    boats = "boats" if heave.shape[1] > 1 else "boat"
    touched = f", {counted(row.grounded, 'step')} on the bed, {row.surfaced} at the surface"
    lines = [
        f"{row.scenario}, seed {row.seed}, policy {row.policy}, {boats} {row.usv}:"
        f" {duration(float(trace.time[-1]))} of mission",
        f"energy: {row.energy_wh:.1f} Wh; mean power of an AUV under way (EC) {row.ec:.0f} W",
        f"position error: {row.position_error_rms:.2f} m rms, median {row.position_error_median:.2f} m,"
        f" 95th percentile {row.position_error_p95:.2f} m",
        f"fixes: usable in {100 * row.fix_availability:.1f} % of the time, longest gap {duration(row.outage_longest)}",
        f"safety: {counted(row.collisions, 'step')} with two AUVs closer than {scenario.auv.collision_distance:g} m,"
        f" {counted(row.border, 'move')} stopped at the border{touched if scenario.auv.dynamic else ''}",
        f"sea: the {boats} heaved from {heave.min():+.2f} to {heave.max():+.2f} m".replace("-", "−"),
        f"score: average reward per step (ARPS) {row.arps:.2f}",
    ]
    if scenario.task == "station-keeping":
        lines.insert(1, f"stations: AUVs are off theirs by {row.target_distance:.2f} m on average")
    if scenario.task == "data-collection":
        before, cost = found["aoi_peak"], found["joule_per_mbit"]
        lines[1:2] = [
            f"data: {row.delivered_mbit:.1f} Mbit from {counted(row.services, 'service')} of nodes,"
            f" {found['lost_mbit']:.1f} Mbit lost to full buffers"
            f"{'' if math.isnan(cost) else f'; {cost:.0f} J/Mbit'}",
            f"age of the data: {found['aoi_mean']:.0f} s on average"
            f"{'' if math.isnan(before) else f', {before:.0f} s just before a service'}",
            lines[1],
        ]
        lines[-1] += f", sum of data rates (SDR) {row.sdr:.2f} Mbit/s"
    print("\n".join(tables.wrapped(line if line is lines[0] else f"  {line}", 4) for line in lines))


def mean_of(several: Sequence[Mapping]) -> dict:
    """Mean of each number of records alike, also within records in them; what is no number is the first one's."""
    first, means = several[0], {}
    for name, value in first.items():
        values = [record[name] for record in several]
        if isinstance(value, Mapping):
            means[name] = mean_of(values)
        else:
            means[name] = statistics.fmean(values) if isinstance(value, float) else value
    return means


def of_seeds(figures: Sequence[dict]) -> dict:
    """Figures of several runs as those of one: means, the margin's interval over the runs, and as text the evaluations'
    score with its deviation."""
    evaluations = [own["evaluation"] for own in figures]
    scores = [own["arps"] for own in evaluations]
    spread = f" ± {statistics.stdev(scores):.2f}" if len(scores) > 1 else ""
    means: dict[str, Any] = mean_of(figures) | {"score": f"{statistics.fmean(scores):.2f}{spread}"}
    if all("margin" in own for own in evaluations):
        margin = interval([own["margin"] for own in evaluations])
        means["evaluation"] |= {"margin": margin.mean, "margin_half": margin.half}
    return means


@contextmanager
def training(baseline: dict, algorithm: str, scenario: str) -> Iterator[Callable[[dict], None]]:
    """Show a training run as a live table, outside a terminal as lines; the function it gives takes new figures."""
    console = Console(markup=False, emoji=False)
    title = f"{algorithm} in {scenario}"
    if not console.is_terminal:
        print(tables.wrapped(f"training {title}: {beginning(baseline)}", 2))
        yield _print_lines(baseline["policy"])
        return
    with Live(console=console, refresh_per_second=4) as live:
        yield lambda figures: live.update(training_table(figures, baseline, title))


def _print_lines(baseline: str) -> Callable[[dict], None]:
    """Function that prints figures as one line, at most every `LINE_EVERY` seconds and at the end."""
    printed = -LINE_EVERY

    def show(figures: dict) -> None:
        nonlocal printed
        if figures["seconds"] - printed < LINE_EVERY and figures["steps"] < figures["total"]:
            return
        printed = figures["seconds"]
        print(
            f"{_share(figures)}: ARPS {figures['arps']:.2f} in training;"
            f" at {figures['evaluated_at']:,} {evaluation(figures, baseline)}",
            flush=True,
        )

    return show


def beginning(baseline: dict) -> str:
    """Where a training run begins, and what its margin is."""
    start = baseline["start"]
    begins = f"an untrained network steers much like {start}; " if start else ""
    return f"{begins}the margin is that over {baseline['policy']} (ARPS {baseline['arps']:.2f}) in the same episodes"


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
    """How much of a run is done, and the time left."""
    left = f", {duration(figures['eta'], rough=True)} left" if figures["steps"] < figures["total"] else ""
    return f"{figures['steps'] / figures['total']:.0%}{left}"


TRAINED = {
    "arps": ("ARPS", "arps"),
    "sdr": ("SDR, Mbit/s", "sdr"),
    "ec": ("EC, W", "ec"),
    "services": ("services", "services"),
    "collisions": ("collisions", "collisions"),
    "border": ("refused moves", "border"),
    "position_error_mean": ("position error, m", "position_error"),
}  # of an evaluation → in words, of the training worlds
PAIRS, LONGEST_TERM = 3, 13  # a line, and columns of a name, of reward terms and figures of the learner


def training_table(figures: dict, baseline: dict, title: str) -> RenderableType:
    """The live table: progress, figures of the training worlds beside evaluation and baseline, reward, learner.

    It fits 80 columns and, with up to 15 terms of reward, 22 lines.
    """
    steps = f"{figures['steps']:,} of {figures['total']:,} world-steps, {figures['steps_per_second']:,.0f} a second"
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    evaluated = f"evaluation at {figures['evaluated_at']:,}"
    (brief,) = tables.shortened([baseline["policy"]], 20).values()
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
        short = tables.shortened(figures[group], LONGEST_TERM)
        pairs = [(short[name], f"{value:.3g}") for name, value in figures[group].items()]
        for first in range(0, len(pairs), PAIRS):
            terms.add_row("" if first else group, *chain.from_iterable(pairs[first : first + PAIRS]))
    (named,) = tables.shortened([title], 40).values()
    margin = _margin(figures, f"margin over {brief} in ARPS: ")
    about = "; ".join(filter(None, (margin, baseline["start"] and f"began near {baseline['start']}")))
    done = f"{steps}, {counted(figures['updates'], 'update')}"
    return Group(f"training {named}: {_share(figures)}", done, table, about, terms)


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
