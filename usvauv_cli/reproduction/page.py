"""The Markdown page: the paper's numbers beside ours, figures, conventions, how it was made.

Figures and tables stand in `RESULTS` beside the page and are linked relative to it, so that both can be moved together.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from usvauv.cli.reproduction import collaboration, conventions, fig3, fig4a, fig4b, paper, table2
from usvauv.cli.reproduction.fixes import BOUND
from usvauv.cli.reproduction.settings import PHYSICAL, Settings
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.storage.files import atomic_write
from usvauv.kernels.mission.motion import travelling_power
from usvauv.policies.training.figures import EVALUATION_SEED_OFFSET

RESULTS = "reproduction"
LOWEST_EC = min(figures["ec"][0] for figures in paper.TABLE_2.values())
NEAR = 0.05  # relative difference up to which two ECs count as equal


def write(path: Path, title: str, sections: Iterable[str]) -> None:
    """Write a page of a title and sections; it appears only when it is complete."""
    with atomic_write(path) as partial:
        partial.write_text("\n\n".join([f"# {title}", *sections]) + "\n", encoding="utf-8")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def number(value: float, digits: int = 2) -> str:
    """A number with a typographic minus sign."""
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def spread(centre: float, deviation: float, digits: int = 2) -> str:
    """Centre ± deviation."""
    return f"{number(centre, digits)} ± {number(deviation, digits)}"


def picture(name: str, about: str) -> str:
    """A figure for light and for dark pages, with links to its other formats."""
    pair = (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{RESULTS}/{name}-dark.png">'
        f'<img alt="{about}" src="{RESULTS}/{name}-light.png"></picture>'
    )
    return f"{pair}\n\nAs [PDF]({RESULTS}/{name}.pdf), as [CSV]({RESULTS}/{name}.csv)."


def table2_section(rows: Sequence[table2.Row], settings: Settings) -> str:
    """Table 2: its rows beside ours, all tests, the heuristics."""
    own = [row for row in rows if row.trained_in == "ISC" and row.printed]
    head = [f"{name.upper()}{whose}" for name in paper.FIGURES for whose in (", paper", ", here")]
    beside = (
        [row.name, *(spread(*pair) for n in paper.FIGURES for pair in (row.printed[n], (row.mean[n], row.sd[n])))]
        for row in own
    )
    above = {name: sum(row.mean[name] > row.printed[name][0] for row in own) for name in ("sdr", "arps")}
    frugal = sum(row.mean["ec"] <= LOWEST_EC * (1 + NEAR) for row in own)
    all_head = ["", "trained in", "tested in", "runs", "SDR Mbit/s", "EC W", "ARPS", "± of runs' ARPS"]
    all_head += ["ARPS without Eq. 5", "services", "collisions", "runs not above untrained"]
    parts = [
        "## Table 2",
        "Trained in ISC, tested in the condition named. The paper has one row for the baseline; here it is tested in"
        " both.",
        table(["", *head], beside),
        f"Of these {len(own)} rows, {above['sdr']} have a higher SDR than the paper's row and {above['arps']} a higher"
        f" ARPS; {frugal} have an EC of at most {number(LOWEST_EC * (1 + NEAR), 1)} W, which is {100 * NEAR:g} % above"
        " the paper's lowest.",
        _room(rows, settings),
        _weighted(rows),
        picture(table2.NAME, "SDR, EC and ARPS of every method, ours and the paper's"),
        f"All tests, mean ± standard deviation over {rows[0].episodes} episodes; the last column is the number of runs"
        " whose best policy was that before the first update:",
        table(all_head, (_all_cells(row) for row in rows)),
    ]
    return "\n\n".join(parts)


def _room(rows: Sequence[table2.Row], settings: Settings) -> str:
    """Number of services that the lowest EC allows, at their energy with `straight`."""
    straight = next(row for row in rows if row.key == "straight" and row.tested_in == "ISC")
    speed = settings.scenario(paper.CONDITIONS["ISC"]).auv.speed_min
    travelling, limit = travelling_power(speed), LOWEST_EC * (1 + NEAR)
    mean = straight.mean
    share = (limit - travelling) / (mean["ec"] - travelling)
    return (
        f"Travelling at the lowest speed, {speed:g} m/s, takes {number(travelling, 1)} W; the rest of EC is hovering,"
        f" which each service needs: `straight` in ISC has {number(mean['services'], 1)} services at"
        f" {number(mean['ec'], 1)} W. At that price {number(limit, 1)} W leave room for"
        f" {number(share * mean['services'], 1)} services, an SDR of {number(share * mean['sdr'])}; whoever serves more"
        " has a higher EC."
    )


def _weighted(rows: Sequence[table2.Row]) -> str:
    """The method that learned from other weights, beside the paper's SAC."""
    row = next(row for row in rows if row.key == "data" and (row.trained_in, row.tested_in) == ("ISC", "ISC"))
    sdr, ec = (paper.printed("sac", "ISC")[name][0] for name in ("sdr", "ec"))
    return (
        f"**{row.title}** learns from a reward with other weights and is tested like the others: an SDR of"
        f" {number(row.mean['sdr'])} at {number(row.mean['ec'], 1)} W, where the paper's SAC (ISC) has {number(sdr)} at"
        f" {number(ec, 1)} W."
    )


def _all_cells(row: table2.Row) -> list[str]:
    learned = row.runs > 0
    return [
        row.title,
        row.trained_in,
        row.tested_in,
        str(row.runs) if learned else "",
        *(spread(row.mean[name], row.sd[name]) for name in paper.FIGURES),
        number(row.runs_sd["arps"]) if row.runs > 1 else "",
        number(row.mean["arps_without_eq5"]),
        number(row.mean["services"], 1),
        number(row.mean["collisions"]),
        str(row.untrained_runs) if learned else "",
    ]


def fig3_section(curves: Sequence[Mapping[str, Any]], settings: Settings) -> str:
    """Fig. 3: the curves, and where they begin and end."""
    rows = []
    for method in fig3.METHODS:
        for condition in paper.CONDITIONS:
            title = f"{settings.method(method).title} ({condition})"
            cells = []
            for name in paper.FIGURES:
                _, mean, low, high = fig3.band(curves, method, condition, name)
                end = f"{number(mean[-1])} ({number(low[-1])} to {number(high[-1])})"
                cells += [number(paper.TABLE_2[method, condition][name][0]), number(mean[0]), end]
            rows.append([title, *cells])
    head = [f"{name.upper()}, {what}" for name in paper.FIGURES for what in ("Table 2", "start", "end")]
    points = len({row["steps"] for row in curves})
    parts = [
        "## Fig. 3",
        f"Evaluations on worlds not trained in, {settings.judged} episodes each, at {points} times of"
        f" {len(settings.seeds)} runs, without exploration; the first is of the policy before any update. The paper"
        " prints no numbers with its curves, so Table 2's stand beside. In brackets: the worst and the best run.",
        picture(fig3.NAME, "SDR, EC and ARPS against training, DDPG and SAC in ISC and ESC"),
        table(["", *head], rows),
    ]
    return "\n\n".join(parts)


def fig4a_section(episodes: dict[str, EpisodeMetrics]) -> str:
    """Fig. 4(a): the episodes shown and their figures."""
    cells = (
        [
            f"`{name}`",
            *(number(getattr(row, figure)) for figure in paper.FIGURES),
            str(row.services),
            str(row.collisions),
            str(row.border),
            number(row.position_error_median, 3),
        ]
        for name, row in episodes.items()
    )
    policy = next(iter(episodes.values())).policy
    parts = [
        "## Fig. 4(a)",
        f"One episode in ESC and, with the same policy, one in `{PHYSICAL}`, whose currents it was never trained"
        f" in. Policy: {policy}, the run whose best policy scored highest on the worlds it was chosen by. The paper"
        " gives no numbers for its trajectories.",
        picture(fig4a.NAME, "Trajectories of AUVs and USV"),
        table(["", "SDR", "EC", "ARPS", "services", "collisions", "refused moves", "median error, m"], cells),
    ]
    return "\n\n".join(parts)


def fig4b_section(levels: Sequence[fig4b.Level], settings: Settings) -> str:
    """Fig. 4(b): levels beside the paper's and the bound."""
    bounds = {level.scenario: level.median for level in levels if level.strategy == BOUND}
    cells = (
        [
            f"`{level.scenario}`",
            level.strategy if level.strategy == BOUND else f"`{level.strategy}`",
            f"{level.paper:g}" if level.paper and level.scenario == paper.CONDITIONS["ESC"] else "",
            f"{level.median:.3g} ({level.low:.3g} to {level.high:.3g})",
            f"{level.p95:.3g}" if level.p95 else "",
            f"{level.median / bounds[level.scenario]:.2f}",
        ]
        for level in levels
    )
    ideal = bounds[paper.CONDITIONS["ESC"]] / paper.FIG_4B["fim"]
    parts = [
        "## Fig. 4(b)",
        f"Medians over {levels[0].episodes} episodes ({len(settings.seeds)} seeds × {settings.fix_episodes}) of an"
        " episode's median horizontal error over steps and AUVs, in brackets the 95 % interval by the bootstrap; AUVs"
        " steered by `straight`, so that every strategy has the same ways to follow. The paper's levels are read off"
        " its figure to one digit. In `paper-extreme` `fim` maximises Eq. 2 as the paper does, in `extreme` the"
        " information on all positions. The bound is the error of a single fix by a level array that is at every moment"
        " at the D-optimal place.",
        picture(fig4b.NAME, "Error of the AUVs' positions over time by the boat's strategy"),
        f"Over time as [CSV]({RESULTS}/{fig4b.NAME}-over-time.csv).",
        table(["scenario", "boat", "paper, m", "median, m", "95th percentile, m", "median over bound"], cells),
        f"The paper's level with planning is {ideal:.0f} times below the bound at the demonstration's own noise: with"
        " Eq. 1's array and Table 1's level no place of the boat gives such fixes. What can be compared is the order of"
        " the strategies and the factors between them.",
    ]
    return "\n\n".join(parts)


def collaboration_section(found: Sequence[collaboration.Point]) -> str:
    """What the boat's strategy brings in, a table for each axis."""
    most = found[0].means["delivered_mbit"] / found[0].share
    head = ["", "boat", "Mbit", "of perfect", "`belief` brings more", "age, s", "own rms, p95, m", "fixes", "outage, s"]
    parts = [
        f"{found[0].episodes} episodes of `wide` for each, the same worlds for all; AUVs are steered by"
        f" `{collaboration.STEERING}`. With perfect fixes they bring in {number(most, 1)} Mbit. ± is half the 95 %"
        " interval of a mean, or of the mean difference in the same worlds. Age is that of information (mean over nodes"
        " and time), own the error of where AUVs take themselves to be, fixes the share of AUVs and seconds with one,"
        " outage an episode's longest time without a fix of some AUV.",
        picture(collaboration.NAME, "Data by the boat's strategy, range, ping interval, drift and number of boats"),
    ]
    for axis in collaboration.AXES:
        rows = (
            [
                f"{p.value:g}",
                f"`{p.boat}`",
                spread(p.means["delivered_mbit"], p.interval, 1),
                f"{100 * p.share:.1f} %",
                "" if p.boat == "belief" else spread(p.more, p.more_interval, 1),
                number(p.means["aoi_mean"], 0),
                f"{number(p.means['own_error_rms'], 1)}, {number(p.means['own_error_p95'], 1)}",
                number(p.means["fix_availability"]),
                number(p.means["outage_longest"], 0),
            ]
            for p in found
            if p.axis == axis.name
        )
        parts += [f"## {axis.name[0].upper()}{axis.name[1:]}", table(head, rows)]
    return "\n\n".join(parts)


def conventions_section(settings: Settings) -> str:
    """Every convention, and the settings of every method."""
    parts = [
        "## Conventions",
        conventions.EXPLAINED.strip(),
        "Fields of the scenarios that decide what the numbers are; `usvauv scenarios paper-extreme` prints all:",
        conventions.scenario_table(settings),
        "Settings of the training runs:",
        conventions.method_table(settings),
    ]
    return "\n\n".join(parts)


def made_section(command: str, settings: Settings, commits: Collection[str], taken: Sequence[str]) -> str:
    """How the page was made; `commits` of the training runs, if there were any."""
    seeds = ", ".join(map(str, settings.seeds))
    last = settings.seeds[0], settings.seeds[-1]
    offset = [f"{seed + EVALUATION_SEED_OFFSET}" for seed in last]
    if not commits:
        return "\n\n".join(["## How it was made", f"    {command}", "\n".join(f"- {line}" for line in taken)])
    lines = [
        "## How it was made",
        f"    {command}",
        f"- Seeds of the training runs: {seeds}; of the worlds that choose a run's policy: {offset[0]} to {offset[1]};"
        f" of the worlds tested in: {settings.test_seed}.",
        f"- Training: {settings.steps:,} world-steps a run, {settings.evaluations} evaluations of {settings.judged}"
        f" episodes. Tests: {settings.episodes} episodes a run and condition.",
        f"- Commits: {', '.join(sorted(commits))}.",
        *(f"- {line}" for line in taken),
    ]
    return "\n\n".join([*lines[:2], "\n".join(lines[2:])])
