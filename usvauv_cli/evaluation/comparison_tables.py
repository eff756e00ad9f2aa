"""Output of a comparison: figures of merit as columns of tables, printed tables, and sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from usvauv.cli import terminal
from usvauv.cli.evaluation.comparison import Comparison, Estimate, words
from usvauv.cli.terminal import counted
from usvauv.env.record.tracking_metrics import TASKS
from usvauv.env.scenario import Scenario
from usvauv.env.storage.result_tables import Combination

# Those shown by default, by task, between ARPS and those of positions; of a plugin's task, all of its own.
BY_TASK = {
    "data-collection": ("delivered_mbit", "ec"),
    "station-keeping": ("target_distance", "ec"),
    **dict.fromkeys(TASKS, ("track_error_median", "track_error_mean", "track_close", "covered")),
}
LONGEST_NAME = {1: 30, 2: 24, 3: 16}  # by the number of columns with names

# By task; of others ARPS.
HEADLINES = {
    "data-collection": "delivered_mbit",
    "station-keeping": "target_distance",
    **dict.fromkeys(TASKS, "track_error_mean"),
}
PHRASES = {
    "arps": ("reward per step", "{one} earns {by} {way} reward per step than {other}", "more", "less"),
    "delivered_mbit": ("data", "{one} collects {by} Mbit {way} than {other}", "more", "less"),
    "energy_wh": ("energy", "{one} uses {by} Wh {way} than {other}", "more", "less"),
    "target_distance": (
        "distance to stations",
        "{one} keeps {by} m {way} its stations than {other}",
        "farther from",
        "nearer to",
    ),
    "track_error_mean": (
        "error of targets",
        "{one} errs by {by} m {way} about the targets than {other}",
        "more",
        "less",
    ),
}  # of a figure: what it is, a sentence, and the words for a positive and for a negative difference


class Column(NamedTuple):
    """A figure of merit."""

    name: str  # of its column in the CSV
    heading: str  # name and unit
    digits: int  # after the point, in the terminal
    about: str
    better: str = ""  # "more", "less" or neither


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
OF_BOATS = (Column("boat_energy_wh", "boat, Wh", 0, "energy of all boats", "less"),)
OF_BATTERIES = (
    Column("spent", "spent", 2, "AUVs whose battery is spent at the end", "less"),
    Column("spent_first", "first spent, s", 0, "when the first battery was spent", "more"),
)
OF_STATIONS = (Column("target_distance", "off station, m", 2, "mean distance of the AUVs to their targets", "less"),)
OF_MOVING = (Column("target_distance", "to target, m", 1, "mean distance of the AUVs to their targets"),)
OF_NODES = (
    Column("delivered_mbit", "data, Mbit", 1, "data collected from the nodes", "more"),
    Column("services", "services", 1, "completed services of nodes", "more"),
    Column("sdr", "SDR, Mbit/s", 2, "sum over the services of their data rates", "more"),
)
OF_KIND = {"nodes": OF_NODES, "auvs": OF_STATIONS, "moving": OF_MOVING}  # by `Task.targets`
OF_TASK = {
    column.name: column
    for column in (
        Column("lost_mbit", "lost, Mbit", 1, "data lost at full buffers", "less"),
        Column("aoi_mean", "age, s", 0, "age of the data, mean over nodes and time", "less"),
        Column("aoi_peak", "peak age, s", 0, "age just before a service, mean over services", "less"),
        Column("aoi_largest", "largest age, s", 0, "largest age of any node at any time", "less"),
        Column("jain", "Jain's index", 3, "evenness of the data collected by node: 1 if equal", "more"),
        Column("joule_per_mbit", "J/Mbit", 0, "energy over data collected", "less"),
        Column("track_error_mean", "error, m", 1, "error of the AUVs' estimates of targets", "less"),
        Column("track_error_median", "median, m", 1, "its median", "less"),
        Column("track_error_p95", "95 %, m", 1, "its 95th percentile", "less"),
        Column("track_error_rms", "rms, m", 1, "its root mean square", "less"),
        Column("track_bound", "bound, m", 1, "the least of an estimator told of places, water and turns", "less"),
        Column("track_close", "in 20 m", 2, "share of targets and steps with an error up to 20 m", "more"),
        Column("track_nees", "NEES/2", 2, "squared error over its covariance, halved: 1 if consistent"),
        Column("covered", "in 150 m", 2, "share of targets and steps with an AUV within 150 m", "more"),
        Column("out_of_range", "lost", 3, "share of targets and steps without an AUV in range", "less"),
    )
}
POSITIONS = (
    Column("position_error_median", "median, m", 2, "error of the boat's estimates of the AUVs' positions", "less"),
    Column("position_error_rms", "rms, m", 2, "root mean square of that error", "less"),
    Column("position_error_p95", "95 %, m", 2, "95th percentile of that error", "less"),
    Column("own_error_rms", "own rms, m", 2, "error of an AUV's estimate of its own position", "less"),
    Column("fix_error_rms", "fix rms, m", 2, "error of a fix, from the AUV's position when it sent the signal", "less"),
    Column("fix_availability", "fixes", 2, "share of steps and AUVs with a usable fix", "more"),
    Column("fix_wrapped", "wrapped", 3, "share of usable fixes that are wrong by whole turns of a phase", "less"),
    Column("fix_dropped", "dropped", 3, "share of detected fixes that the receiver does not use", "less"),
    Column("outage_longest", "outage, s", 0, "longest time of an AUV without a usable fix", "less"),
)
COLUMNS = {
    column.name: column
    for column in (
        *(*WORK, *OF_BOATS, *OF_BATTERIES, *OF_VEHICLES, *OF_STATIONS, *OF_NODES),
        *(*OF_TASK.values(), *POSITIONS),
    )
}


def column_tables(scenario: Scenario, comparison: Comparison) -> dict[str, list[Column]]:
    """Columns of each table by its title; those of batteries only where one was spent."""
    kind, of_task = scenario.task_definition.targets, comparison.of_task
    spent = any(comparison.score(which, "spent").mean > 0 for which in comparison.combinations)
    energy = [*(OF_BOATS if scenario.boat.metered else ()), *(OF_BATTERIES if spent else ())]
    vehicles = OF_VEHICLES if scenario.auv.dynamic else ()
    own = [OF_TASK.get(name, Column(name, name, 2, "a figure of a plugin")) for name in of_task]
    return {
        "Work": [*WORK[:1], *OF_KIND[kind], *WORK[1:], *energy, *vehicles],
        "Age, losses and cost of data" if kind == "nodes" else "Of the task": own,
        "Positions and fixes": list(POSITIONS),
    }


def metrics_tables(
    comparison: Comparison, scenario: Scenario, seed: int, wide: bool, score: str, said_ahead: Sequence[str]
) -> None:
    """Print mean ± standard deviation over the episodes of each policy, boat strategy and target rule, differences to
    the reference in the same worlds with their intervals, and sentences on who is ahead.

    `wide`: all figures in three tables of any width, instead of those that matter most in one that fits.
    """
    first, count = comparison.combinations[0], comparison.episodes
    parts = column_tables(scenario, comparison)
    about = f"{scenario.name}{scenario.change}, seed {seed}, {counted(count, 'episode')}"
    several = comparison.combinations
    varied = ["policy", *(name for name in ("usv", "targets") if len({getattr(which, name) for which in several}) > 1)]
    about += "".join(f", {name} {getattr(first, name)}" for name in ("usv", "targets") if name not in varied)
    shown_as = ": mean ± standard deviation" if count > 1 else ""
    print(terminal.wrapped(f"{about.removesuffix(', targets ')}{shown_as}"))
    if not wide:
        middle = BY_TASK.get(scenario.task, comparison.of_task)
        everything = {column.name: column for part in parts.values() for column in part}
        names = ("arps", *middle, "position_error_rms", "fix_availability")
        parts = {"": [everything[name] for name in names]}
    limit = terminal.UNLIMITED if wide else 0
    for shown in filter(None, parts.values()):
        print()
        _table(comparison, varied, shown, limit)
    if len(several) > 1:
        name = labels(several)[several.index(comparison.reference)]
        print("\n" + terminal.wrapped(f"difference from {name}, same worlds: mean ± half of its 95 % interval"))
        for shown in filter(None, parts.values()):
            print()
            _table(comparison, varied, shown, limit, less=True)
        print()
        print(*(terminal.wrapped(said, 2) for said in said_ahead), sep="\n")
    if said := dependence(comparison, score):
        print("\n" + terminal.wrapped(said))
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
            spreads.append(words(comparison.difference(which, name), sign=True) if less else spread.replace("-", "−"))
        cells.append([*(getattr(which, name) for name in varied), *spreads])
    long = [] if limit else [name for row in cells for name in row[: len(varied)]]
    short = terminal.shortened(long, LONGEST_NAME[len(varied)])
    headings = [*varied, *(column.heading.replace(",", "") for column in shown)]
    brief_cells = [[short.get(cell, cell) for cell in row] for row in cells]
    terminal.print_table(headings, brief_cells, len(varied), limit)
    for name, brief in short.items():
        if name != brief and not less:
            print(terminal.wrapped(f"{brief} = {name}", 2))


def intervals(comparison: Comparison, name: str) -> list[str]:
    """A figure of each combination so far, and its difference to the reference, with 95 % intervals, as lines."""
    names = labels(comparison.combinations)
    short = terminal.shortened(names, LONGEST_NAME[1])
    lines = [f"{name}, mean of {counted(comparison.episodes, 'episode')} with 95 % interval:"]
    for which, label in zip(comparison.combinations, names, strict=True):
        line = f"  {short[label]}: {words(comparison.score(which, name))}"
        if which != comparison.reference:
            line += f", difference {words(comparison.difference(which, name), sign=True)}"
        lines.append(line)
    if said := dependence(comparison, name):
        lines.append(said)
    return lines


def labels(combinations: Sequence[Combination]) -> list[str]:
    """Short names: of each combination the parts that differ among all, the policy if nothing does."""
    differ = [len(set(parts)) > 1 for parts in zip(*combinations, strict=True)]
    differ[0] |= not any(differ)
    return [" · ".join(p for p, shown in zip(parts, differ, strict=True) if shown and p) for parts in combinations]


def headline(scenario: Scenario) -> str:
    """The figure by which combinations are compared first: the collected data, or the distance to the stations."""
    return HEADLINES.get(scenario.task, "arps")


def sentence(less: Estimate, one: str, other: str, name: str) -> str:
    """A difference as a sentence: "belief collects 30 ± 9 Mbit more than fim".

    `less` is a figure, a column of the CSV, of `one` minus that of `other` in the same worlds, with its interval. If
    the interval contains 0, there is no difference beyond chance.
    """
    what, phrase, *ways = PHRASES.get(name) or _plain(name)
    if not less.n:
        return f"{what}: no world has it for both {one} and {other}"
    if less.mean == 0 and less.half == 0:
        return f"{what}: {one} and {other} are equal in every world"
    if abs(less.mean) <= less.half:
        unit = COLUMNS[name].heading.partition(", ")[2] if name in COLUMNS else ""
        by = f"{words(less, sign=True)} {unit}".rstrip()
        return f"{what}: no difference beyond chance between {one} and {other} ({by})"
    said = phrase.format(one=one, other=other, by=words(less._replace(mean=abs(less.mean))), way=ways[less.mean < 0])
    if math.isnan(less.half):
        said += f" ({'one world' if less.n == 1 else 'fewer than two seas'}: no interval)"
    return said if less.half != 0 else f"{said} in every world"


def _plain(name: str) -> tuple[str, str, str, str]:
    """Words for a figure without its own; those of positions have headings that mean nothing alone."""
    column = COLUMNS.get(name)
    what, _, unit = column.heading.partition(", ") if column else (name, "", "")
    if column in POSITIONS:
        what = name.replace("_", " ")
    phrase = f"{what} is {{by}}{f' {unit}' if unit else ''} {{way}} with {{one}} than with {{other}}"
    return what, phrase, "higher", "lower"


def phrase(name: str) -> str:
    """What a figure is, in words."""
    return (PHRASES.get(name) or _plain(name))[0]


def sentences(comparison: Comparison, name: str) -> list[str]:
    """A sentence on a figure of each combination but the reference."""
    short = dict(zip(comparison.combinations, labels(comparison.combinations), strict=True))
    return [
        sentence(comparison.difference(which, name), short[which], short[comparison.reference], name)
        for which in comparison.combinations
        if which != comparison.reference
    ]


def dependence(comparison: Comparison, name: str) -> str:
    """A sentence on the effect of shared seas on a figure; empty if episodes do not share them."""
    effective = comparison.effective(name)
    if comparison.seas == 1 < comparison.episodes:
        return f"no intervals: all {comparison.episodes} episodes have one sea, which tells nothing about others"
    if not 0 < comparison.seas < comparison.episodes or effective > 0.95 * comparison.episodes:
        return ""
    shared = f"{comparison.episodes} episodes share {counted(comparison.seas, 'sea')}"
    return f"{shared}: the mean of {name} is as certain as from {effective:.0f} episodes with a sea each"
