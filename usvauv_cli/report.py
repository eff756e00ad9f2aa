"""Output of the commands in the terminal: tables of metrics, summary of a mission, live table of a training run."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import groupby

from rich.console import Console
from rich.live import Live
from rich.table import Table

from usvauv_cli.console import LINE_EVERY
from usvauv_env.record.metrics import EpisodeMetrics, values_of
from usvauv_env.record.trace import Trace

SHOWN = {
    "sdr": "SDR Mbit/s",
    "ec": "EC W",
    "arps": "ARPS",
    "services": "services",
    "delivered_mbit": "Mbit",
    "energy_wh": "Wh",
    "collisions": "collisions",
    "border": "border",
}
OF_TASK = {
    "lost_mbit": "lost Mbit",
    "aoi_mean": "age s",
    "aoi_peak": "peak age s",
    "aoi_largest": "largest age s",
    "jain": "Jain's index",
    "joule_per_mbit": "J/Mbit",
}
POSITIONS = {
    "position_error_median": "median m",
    "position_error_rms": "rms m",
    "position_error_p95": "95 % m",
    "own_error_rms": "own rms m",
    "fix_error_rms": "fix rms m",
    "fix_availability": "fixes",
    "fix_wrapped": "wrapped",
    "fix_dropped": "dropped",
    "outage_longest": "outage s",
}


def metrics_tables(rows: Sequence[EpisodeMetrics]) -> None:
    """Print mean ± standard deviation over the episodes of each policy and boat strategy.

    Three tables: figures of all tasks, those of this task if it has any, and those of positions and fixes.
    """
    _table(rows, f"{rows[0].scenario}, seed {rows[0].seed}: mean ± standard deviation over episodes", SHOWN)
    of_task = {name: OF_TASK.get(name, name) for name in rows[0].of_task}
    if of_task:
        _table(rows, rows[0].scenario, of_task)
    _table(rows, f"{rows[0].scenario}: errors of positions, of the AUVs' own, and of fixes", POSITIONS)


def _table(rows: Sequence[EpisodeMetrics], title: str, shown: Mapping[str, str]) -> None:
    """Figures by the name of their column, under the title given for it."""
    table = Table(title=title)
    table.add_column("policy", no_wrap=True)
    table.add_column("usv", no_wrap=True)
    several = len({row.targets for row in rows}) > 1
    if several:
        table.add_column("targets", no_wrap=True)
    table.add_column("n", justify="right")
    for heading in shown.values():
        table.add_column(heading, justify="right", no_wrap=True)
    for (policy, usv, rule), group in groupby(rows, key=lambda row: (row.policy, row.usv, row.targets)):
        episodes = list(group)
        cells = []
        for name in shown:
            values = values_of(episodes, name)
            spread = statistics.stdev(values) if len(values) > 1 else 0.0
            mean = statistics.fmean(values)
            cells.append(f"{mean:.2f} ± {spread:.2f}" if math.isfinite(mean) else "–")  # no episode has it
        table.add_row(policy, usv, *([rule] if several else []), str(len(episodes)), *cells)
    Console(width=None if Console().is_terminal else 170).print(table)


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
    print("\n".join(lines))


@contextmanager
def training(baseline: dict, algorithm: str, scenario: str) -> Iterator[Callable[[dict], None]]:
    """Show a training run as a live table, outside a terminal as lines; the function it gives takes new figures."""
    console = Console()
    title = f"{algorithm} in {scenario}"
    if not console.is_terminal:
        yield _line_printer(baseline, title)
        return
    with Live(console=console, refresh_per_second=4) as live:
        yield lambda figures: live.update(training_table(figures, baseline, title))


def _line_printer(baseline: dict, title: str) -> Callable[[dict], None]:
    """Function that prints figures as one line, at most every `LINE_EVERY` seconds and at the end."""
    printed = -LINE_EVERY

    def show(figures: dict) -> None:
        nonlocal printed
        if figures["seconds"] - printed < LINE_EVERY and figures["steps"] < figures["total"]:
            return
        printed = figures["seconds"]
        print(
            f"{title}: {figures['steps']:,} of {figures['total']:,} world-steps, {figures['eta']:.0f} s left;"
            f" arps {figures['arps']:.2f}, sdr {figures['sdr']:.2f}, ec {figures['ec']:.1f};"
            f" evaluation at {figures['evaluated_at']:,}: arps {figures['evaluation']['arps']:.2f}"
            f" ({baseline['policy']} {baseline['arps']:.2f})",
            flush=True,
        )

    return show


def training_table(figures: dict, baseline: dict, title: str) -> Table:
    """The live table: progress, figures of the training worlds, reward by term, evaluation beside the baseline."""
    done, total = figures["steps"], figures["total"]
    minutes, seconds = divmod(round(figures["eta"]), 60)
    table = Table(title=f"training {title}: {done / total:.0%}, {minutes} min {seconds} s left", title_justify="left")
    table.add_column("what")
    table.add_column("training worlds", justify="right")
    table.add_column(f"evaluation at {figures['evaluated_at']:,}", justify="right")
    table.add_column(baseline["policy"], justify="right")
    table.add_row("world-steps", f"{done:,} of {total:,}", "", "")
    table.add_row("world-steps/s", f"{figures['steps_per_second']:,.0f}", "", "")
    table.add_row("updates", f"{figures['updates']:,}", "", "")
    evaluation = figures["evaluation"]
    for name in ("arps", "sdr", "ec", "services", "collisions", "border", "position_error_mean"):
        now = figures.get("position_error" if name == "position_error_mean" else name)
        shown = ("" if value is None else f"{value:.2f}" for value in (now, evaluation.get(name), baseline[name]))
        table.add_row(name, *shown)
    for group in ("reward", "learner"):
        for name, value in figures[group].items():
            table.add_row(f"{group}: {name}", f"{value:.3f}", "", "")
    return table
