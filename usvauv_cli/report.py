"""Output of the commands in the terminal: tables of metrics, summary of a mission, live table of a training run."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain

from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table

from usvauv.cli import tables
from usvauv.cli.console import LINE_EVERY
from usvauv.cli.evaluation.comparison import Comparison, labels, words
from usvauv.cli.tables import Column, column_tables
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.record.trace import Trace
from usvauv.env.scenario import Scenario

# Those shown by default, by task, between ARPS and those of positions; of a plugin's task, all of its own.
BY_TASK = {"data-collection": ("delivered_mbit", "ec"), "station-keeping": ("target_distance", "ec")}
LONGEST_NAME = {1: 30, 2: 24, 3: 16}  # by the number of columns with names


def metrics_tables(comparison: Comparison, scenario: Scenario, seed: int, wide: bool) -> None:
    """Print mean ± standard deviation over the episodes of each policy, boat strategy and target rule.

    Args:
        comparison: of the episodes.
        scenario, seed: what was run.
        wide: all figures in three tables of any width, instead of those that matter most in one that fits.
    """
    first, count = comparison.combinations[0], comparison.episodes
    nodes = scenario.task_definition.targets == "nodes"
    parts = column_tables(nodes, comparison.of_task)
    episodes = "1 episode" if count == 1 else f"{count} episodes"
    about = f"{scenario.name}, seed {seed}, {episodes}"
    several = comparison.combinations
    varied = ["policy", *(name for name in ("usv", "targets") if len({getattr(which, name) for which in several}) > 1)]
    about += "".join(f", {name} {getattr(first, name)}" for name in ("usv", "targets") if name not in varied)
    print(tables.wrapped(f"{about.removesuffix(', targets ')}: mean ± standard deviation"))
    if not wide:
        middle = BY_TASK.get(scenario.task, comparison.of_task)
        everything = {column.name: column for part in parts.values() for column in part}
        names = ("arps", *middle, "position_error_rms", "fix_availability")
        parts = {"": [everything[name] for name in names]}
    for shown in filter(None, parts.values()):
        print()
        _table(comparison, varied, shown, tables.UNLIMITED if wide else 0)
    if said := dependence(comparison, "arps"):
        print("\n" + tables.wrapped(said))
    if not wide:
        print("\nrms: of the positions' error; fixes: share of seconds with one. More: --wide")


def _table(comparison: Comparison, varied: Sequence[str], shown: Sequence[Column], limit: int) -> None:
    """One table, then the names that were shortened."""
    cells: list[list[str]] = []
    for which in comparison.combinations:
        spreads = []
        for name, _, digits, *_ in shown:
            mean, deviation = comparison.score(which, name).mean, comparison.deviation(which, name)
            spreads.append("–" if math.isnan(mean) else f"{mean:.{digits}f} ± {deviation:.{digits}f}")
        cells.append([*(getattr(which, name) for name in varied), *spreads])
    long = [] if limit else [name for row in cells for name in row[: len(varied)]]
    short = tables.shortened(long, LONGEST_NAME[len(varied)])
    headings = [*varied, *(column.heading.replace(",", "") for column in shown)]
    brief_cells = [[short.get(cell, cell) for cell in row] for row in cells]
    tables.print_table(headings, brief_cells, len(varied), limit)
    for name, brief in short.items():
        if name != brief:
            print(tables.wrapped(f"{brief} = {name}", 2))


def intervals(comparison: Comparison, name: str) -> list[str]:
    """A figure of each combination so far, and its difference to the reference, with 95 % intervals, as lines."""
    names = labels(comparison.combinations)
    short = tables.shortened(names, LONGEST_NAME[1])
    lines = [f"{name} of {comparison.episodes} episodes, with 95 % intervals:"]
    for which, label in zip(comparison.combinations, names, strict=True):
        line = f"  {short[label]}: {words(comparison.score(which, name))}"
        if which != comparison.reference:
            line += f", difference {words(comparison.difference(which, name), sign=True)}"
        lines.append(line)
    if said := dependence(comparison, name):
        lines.append(said)
    return lines


def dependence(comparison: Comparison, name: str) -> str:
    """What it means for a figure that episodes share seas; empty where they do not."""
    effective = comparison.effective(name)
    if comparison.seas == 1 < comparison.episodes:
        return f"{comparison.episodes} episodes share one sea: without intervals, for nothing is known of other seas"
    if not 0 < comparison.seas < comparison.episodes or effective > 0.95 * comparison.episodes:
        return ""
    shared = f"{comparison.episodes} episodes on {comparison.seas} seas"
    return f"{shared} tell as much of {name} as {effective:.0f} episodes on seas of their own"


def mission_summary(row: EpisodeMetrics, trace: Trace) -> None:
    """Print the metrics of one mission as sentences."""
    minutes, seconds = divmod(round(float(trace.time[-1])), 60)
    if trace.scenario.task == "station-keeping":
        done = f"  {row.target_distance:.2f} m off station in the mean for {row.energy_wh:.1f} Wh (EC {row.ec:.1f} W)"
    else:
        done = (
            f"  {row.services} services brought {row.delivered_mbit:.1f} Mbit (SDR {row.sdr:.2f} Mbit/s)"
            f" for {row.energy_wh:.1f} Wh (EC {row.ec:.1f} W)"
        )
    heave = trace.boat_surface[:, 0, :, 0]
    boats = "boat" if heave.shape[1] == 1 else "boats"
    lines = [
        f"{row.scenario}, policy {row.policy}, boat {row.usv}, seed {row.seed}: {minutes} min {seconds} s of mission",
        f"{done}; ARPS {row.arps:.2f}",
        f"  positions are {row.position_error_median:.2f} m off in the median, {row.position_error_rms:.2f} m rms,"
        f" {row.position_error_p95:.2f} m at 95 %; the {boats} heaved from {heave.min():+.2f} to {heave.max():+.2f} m",
        f"  {row.collisions} steps too close, {row.border} moves refused at the border,"
        f" {row.overflow} node-steps of overflow",
        f"  usable fixes in {row.fix_availability:.1%} of the steps, at most {row.outage_longest:.0f} s without one",
    ]
    if trace.scenario.task == "data-collection":
        of_task = row.of_task
        lines.append(
            f"  data {of_task['aoi_mean']:.0f} s old in the mean, {of_task['aoi_peak']:.0f} s before a service;"
            f" {of_task['lost_mbit']:.1f} Mbit lost, {of_task['joule_per_mbit']:.0f} J/Mbit"
        )
    print("\n".join(tables.wrapped(line, 4) for line in lines))


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
    """Figures of several runs as those of one: means, and as text the evaluations' score with its deviation."""
    scores = [own["evaluation"]["arps"] for own in figures]
    return mean_of(figures) | {"score": mean_and_spread(scores, 2)}


def mean_and_spread(values: Sequence[float], digits: int) -> str:
    """The mean, of several with their standard deviation."""
    spread = f" ± {statistics.stdev(values):.{digits}f}" if len(values) > 1 else ""
    return f"{statistics.fmean(values):.{digits}f}{spread}"


@contextmanager
def training(baseline: dict, algorithm: str, scenario: str) -> Iterator[Callable[[dict], None]]:
    """Show a training run as a live table, outside a terminal as lines; the function it gives takes new figures."""
    console = Console(markup=False, emoji=False)
    title = f"{algorithm} in {scenario}"
    if not console.is_terminal:
        print(tables.wrapped(f"training {title}; evaluation beside {baseline['policy']}, arps {baseline['arps']:.2f}"))
        yield _print_lines()
        return
    with Live(console=console, refresh_per_second=4) as live:
        yield lambda figures: live.update(training_table(figures, baseline, title))


def _print_lines() -> Callable[[dict], None]:
    """Function that prints figures as one line, at most every `LINE_EVERY` seconds and at the end."""
    printed = -LINE_EVERY

    def show(figures: dict) -> None:
        nonlocal printed
        if figures["seconds"] - printed < LINE_EVERY and figures["steps"] < figures["total"]:
            return
        printed = figures["seconds"]
        print(
            f"{_share(figures)}: arps {figures['arps']:.2f}, ec {figures['ec']:.1f};"
            f" evaluation at {figures['evaluated_at']}: arps {_score(figures)}",
            flush=True,
        )

    return show


def _score(figures: dict) -> str:
    """The evaluation's score, of several seeds with its spread."""
    return figures.get("score", f"{figures['evaluation']['arps']:.2f}")


def _share(figures: dict) -> str:
    """How much of a run is done, and the time left."""
    hours, seconds = divmod(round(figures["eta"]), 3600)
    return f"{figures['steps'] / figures['total']:.0%}, {hours}:{seconds // 60:02d}:{seconds % 60:02d} left"


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
    return Group(f"training {named}: {_share(figures)}", f"{steps}, {figures['updates']:,} updates", table, "", terms)
