"""Fig. 4: tracks of AUVs and boat in an episode, and the error of the AUVs' positions by boat strategy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from usvauv.cli.reproduction import paper
from usvauv.cli.sweep.run_folder import Piece
from usvauv.env import Trace, World
from usvauv.env.record.metrics import episode_metrics
from usvauv.env.record.recorder import record
from usvauv.env.render.figures import Axes, Figure, Line2D, log_ticks, withStroke, write_pair
from usvauv.env.render.style import OUTLINE, Ground, looks, web
from usvauv.env.storage.result_tables import read_rows, write_rows
from usvauv.kernels import runtime
from usvauv.kernels.flow import vortex
from usvauv.policies import checkpoint, loading

ESC = paper.CONDITIONS["ESC"]
SCENARIOS = (ESC, paper.PHYSICAL)
METHOD = "ddpg"  # whose policy steers in Fig. 4(a)
TRACKS = ("scenario", "time", "vehicle", "x", "y")
ARROWS = 11  # a side
NODE = "#35d07f"
TIMES = ("scenario", "strategy", "time", "median", "lower_quartile", "upper_quartile")
SUMMARY = ("scenario", "strategy", "episodes", "median", "low95", "high95", "p95", "paper")
RESAMPLES = 4000


def track_runs(settings: paper.Settings) -> list[Piece]:
    """The runs that Fig. 4(a) needs, beside the two episodes."""
    return [paper.learned(settings, METHOD, ESC, seed) for seed in settings.seeds]


def voyages(settings: paper.Settings, folder: Path) -> dict[str, Trace]:
    """Scenario → trace of the first episode of `test_seed` with the run whose best policy scored highest in its
    evaluations; kept as NetCDF and not simulated again.
    """
    run = max(track_runs(settings), key=lambda run: paper.best(run, folder)["score"])
    traces = {}
    for name in SCENARIOS:
        path = run.place(folder) / f"voyage-{name}.nc"
        if not path.exists():
            scenario = settings.scenario(name, ("observation.current=speed",))
            world = World(scenario, 1, settings.test_seed)
            policy = loading.load(checkpoint.path_of(run.place(folder), checkpoint.BEST), world)
            record(world, policy.act, f"{run.method}, run {run.seed}").save(path)
        traces[name] = Trace.load(path)
    return traces


def make_tracks(settings: paper.Settings, folder: Path, place: Path) -> list[str]:
    """Write fig4a.csv, a pair of .png, and .pdf; returns what the page has of it: the episodes and their figures."""
    traces = voyages(settings, folder)
    write_rows(place / "fig4a.csv", TRACKS, (row for item in traces.items() for row in _rows(*item)))
    write_pair(place / "fig4a.png", partial(_draw_tracks, traces), pdf=True)
    episodes = {name: episode_metrics(trace)[0] for name, trace in traces.items()}
    cells = (
        [
            f"`{name}`",
            *(paper.rounded(getattr(row, figure)) for figure in paper.FIGURES),
            str(row.services),
            str(row.collisions),
            str(row.border),
            paper.rounded(row.position_error_median, 3),
        ]
        for name, row in episodes.items()
    )
    policy = next(iter(episodes.values())).policy
    return [
        "## Fig. 4(a)",
        f"One episode in ESC and, with the same policy, one in `{paper.PHYSICAL}`, whose currents it was never trained"
        f" in. Policy: {policy}, the run whose best policy scored highest on the worlds it was chosen by. The paper"
        " gives no numbers for its trajectories.",
        paper.picture_pair("fig4a", "Trajectories of AUVs and USV"),
        paper.markdown_table(
            ["", "SDR", "EC", "ARPS", "services", "collisions", "refused moves", "median error, m"], cells
        ),
    ]


def _tracks(trace: Trace) -> dict[str, np.ndarray]:
    """Vehicle → (T, 2) m."""
    auvs = {f"AUV {k + 1}": trace.auv_position[:, 0, k] for k in range(trace.auv_position.shape[2])}
    return {**auvs, "USV": trace.boat_position[:, 0, 0]}


def _rows(name: str, trace: Trace) -> Iterator[dict[str, Any]]:
    for vehicle, track in _tracks(trace).items():
        for time, (x, y) in zip(trace.time, track, strict=True):
            yield dict(zip(TRACKS, (name, float(time), vehicle, float(x), float(y)), strict=True))


def _draw_tracks(traces: dict[str, Trace], ground: Ground) -> Figure:
    first = next(iter(traces.values()))
    drawn = paper.titled_figure(
        6.0,
        "Fig. 4(a): an episode with the policy learned by DDPG in ESC",
        f"{first.policy}, world seed {first.seed}, {first.time[-1]:g} s; arrows: vortices' current halfway,"
        " each panel with its own scale",
        ground,
    )  # fmt: skip
    room = {"left": 0.075, "right": 0.975, "bottom": 0.14, "top": 0.79, "wspace": 0.2}
    for axes, (name, trace) in zip(drawn.subplots(1, 2, gridspec_kw=room), traces.items(), strict=True):
        row = episode_metrics(trace)[0]
        axes.set_title(f"{name}\nSDR {row.sdr:.2f} Mbit/s, EC {row.ec:.1f} W, services {row.services}")
        _map(axes, trace, ground)
    auvs = zip(range(first.power.shape[2]), ground.colours, strict=False)
    lines = [Line2D([], [], color=colour, label=f"AUV {k + 1}") for k, colour in auvs]
    lines.append(Line2D([], [], color=ground.text, lw=1.0, label="USV"))
    places = (
        ("o", ground.muted, "none", "start"),
        ("s", ground.muted, "none", "end"),
        ("^", NODE, NODE, "sensor node"),
    )
    lines += [Line2D([], [], ls="none", marker=m, color=c, mfc=f, label=words) for m, c, f, words in places]
    drawn.legend(handles=lines, loc="lower center", ncols=len(lines))
    return drawn


def _map(axes: Axes, trace: Trace, ground: Ground) -> None:
    area, shadow = trace.scenario.area, [withStroke(linewidth=2.4, foreground=ground.card)]
    axes.grid(visible=False)
    _current(axes, trace, ground)
    axes.plot(*trace.node_position[0].T, "^", ms=5.5, color=NODE, mec=web(OUTLINE), mew=0.6, zorder=3)
    for k, (vehicle, track) in enumerate(_tracks(trace).items()):
        boat = vehicle == "USV"
        colour = ground.text if boat else ground.colours[k]
        axes.plot(*track.T, color=colour, lw=0.8 if boat else 1.1, alpha=0.55 if boat else 0.9, zorder=4 + (not boat))
        for marker, (x, y) in (("o", track[0]), ("s", track[-1])):
            axes.plot(x, y, marker, ms=9, mfc="none", mec=colour, mew=1.8, path_effects=shadow, zorder=6, clip_on=False)
    axes.set(xlim=(0, area.width), ylim=(0, area.length), aspect="equal", xlabel="x (east), m", ylabel="y (north), m")


def _current(axes: Axes, trace: Trace, ground: Ground) -> None:
    """Arrows of the vortices' current at half time."""
    area = trace.scenario.area
    x, y = ((np.arange(ARROWS) + 0.5) * side / ARROWS for side in (area.width, area.length))
    points = np.stack(np.meshgrid(x, y), -1).reshape(1, -1, 2)
    device = runtime.start().device
    centres, places = (
        torch.tensor(np.asarray(array, np.float32), device=device)
        for array in (trace.vortex[len(trace.time) // 2], points)
    )
    velocity = vortex.sample_current(centres, places)[0].cpu().numpy()
    fastest = float(np.hypot(*velocity.T).max())
    if fastest == 0.0:
        return
    spacing = area.width / ARROWS
    arrows = axes.quiver(
        *points[0].T, *velocity.T, color=ground.water, alpha=0.6, pivot="mid", angles="xy",
        scale_units="xy", scale=fastest / (1.1 * spacing), width=0.0028, zorder=2,
    )  # fmt: skip
    axes.quiverkey(
        arrows, 0.9, 1.09, fastest, f"{fastest:.2g} m/s", labelpos="W", labelcolor=ground.muted,
        fontproperties={"size": 9},
    )  # fmt: skip


def error_runs(settings: paper.Settings) -> list[Piece]:
    """The runs that Fig. 4(b) needs."""
    return [paper.fix_errors(settings, scenario, usv) for scenario in SCENARIOS for usv in paper.STRATEGIES]


def make_errors(settings: paper.Settings, folder: Path, place: Path) -> list[str]:
    """Write fig4b.csv (levels), fig4b-over-time.csv, a pair of .png, and .pdf; returns what the page has: levels
    beside the paper's and the bound.
    """
    levels, over_time = [], {}
    for scenario in SCENARIOS:
        for strategy in (*paper.STRATEGIES, paper.BOUND):
            run = paper.fix_errors(settings, scenario, "fim" if strategy == paper.BOUND else strategy)
            levels.append(level(scenario, strategy, [row for row in run.rows(folder) if row["strategy"] == strategy]))
            rows = read_rows(run.place(folder) / paper.OVER_TIME)
            over_time[scenario, strategy] = [row for row in rows if row["strategy"] == strategy]
    write_rows(place / "fig4b.csv", SUMMARY, levels)
    named = ({"scenario": scenario, **row} for (scenario, _), rows in over_time.items() for row in rows)
    write_rows(place / "fig4b-over-time.csv", TIMES, named)
    write_pair(place / "fig4b.png", partial(_draw_errors, over_time, levels), pdf=True)
    bounds = {row["scenario"]: row["median"] for row in levels if row["strategy"] == paper.BOUND}
    cells = (
        [
            f"`{row['scenario']}`",
            paper.BOUND if row["strategy"] == paper.BOUND else f"`{row['strategy']}`",
            f"{row['paper']:g}" if row["paper"] and row["scenario"] == ESC else "",
            f"{row['median']:.3g} ({row['low95']:.3g} to {row['high95']:.3g})",
            f"{row['p95']:.3g}" if row["p95"] else "",
            f"{row['median'] / bounds[row['scenario']]:.2f}",
        ]
        for row in levels
    )
    ideal = bounds[ESC] / paper.FIG_4B["fim"]
    return [
        "## Fig. 4(b)",
        f"Medians over {levels[0]['episodes']} episodes ({len(settings.seeds)} seeds × {settings.fix_episodes}) of an"
        " episode's median horizontal error over steps and AUVs, in brackets the 95 % interval by the bootstrap; AUVs"
        " steered by `straight`, so that every strategy has the same tracks to follow. The paper's levels are read off"
        " its figure to one digit. In `paper-extreme` `fim` maximises Eq. 2 as the paper does, in `extreme` the"
        " information on all positions. The bound is the error of a single fix by a level array that is at every moment"
        " at the D-optimal place.",
        paper.picture_pair("fig4b", "Error of the AUVs' positions over time by the boat's strategy"),
        f"Over time as [CSV]({paper.RESULTS}/fig4b-over-time.csv).",
        paper.markdown_table(
            ["scenario", "boat", "paper, m", "median, m", "95th percentile, m", "median over bound"], cells
        ),
        f"The paper's level with planning is {ideal:.0f} times below the bound at the demonstration's own noise: with"
        " Eq. 1's array and Table 1's level no place of the boat gives such fixes. What can be compared is the order of"
        " the strategies and the factors between them.",
    ]


def level(scenario: str, strategy: str, rows: Sequence[dict[str, str]]) -> dict[str, Any]:
    """Errors of a strategy in a scenario, from its rows over episodes, m: a row of `SUMMARY`.

    "median" is over episodes, of an episode's median over steps and AUVs, "low95" and "high95" its interval by the
    bootstrap over episodes; "p95" the median of an episode's 95th percentile, None for the bound; "paper" what the
    paper's figure shows, None where it shows nothing.
    """
    medians = np.array([float(row["median"]) for row in rows])
    drawn = np.random.default_rng(0).integers(0, len(medians), (RESAMPLES, len(medians)))
    low, high = map(float, np.quantile(np.median(medians[drawn], axis=1), (0.025, 0.975)))
    largest = [float(row["p95"]) for row in rows if row["p95"]]
    p95 = float(np.median(largest)) if largest else None
    about = (scenario, strategy, len(rows), float(np.median(medians)), low, high, p95, paper.FIG_4B.get(strategy))
    return dict(zip(SUMMARY, about, strict=True))


def _draw_errors(
    over_time: dict[tuple[str, str], list[dict[str, str]]], levels: list[dict[str, Any]], ground: Ground
) -> Figure:
    drawn = paper.titled_figure(
        5.4,
        "Fig. 4(b): error of the AUVs' positions by the boat's strategy",
        f"median over {levels[0]['episodes']} episodes and AUVs steered by straight, band from quartile to quartile;\n"
        "dotted: the paper's levels, in the strategies' colours",
        ground,
    )  # fmt: skip
    room = {"left": 0.08, "right": 0.97, "bottom": 0.19, "top": 0.75, "wspace": 0.1}
    panels = drawn.subplots(1, 2, sharey=True, gridspec_kw=room)
    marks = looks(paper.STRATEGIES, ground.colours) | {paper.BOUND: (ground.text, "")}
    for axes, scenario in zip(panels, SCENARIOS, strict=True):
        for strategy in (*paper.STRATEGIES, paper.BOUND):
            rows, (colour, marker) = over_time[scenario, strategy], marks[strategy]
            time, median = (np.array([float(row[name]) for row in rows]) for name in ("time", "median"))
            if strategy == paper.BOUND:
                axes.plot(time, median, color=colour, lw=1.2, ls=(0, (4, 2)), label="bound of a single fix", zorder=4)
                continue
            low, high = (np.array([float(row[name]) for row in rows]) for name in ("lower_quartile", "upper_quartile"))
            axes.fill_between(time, low, high, color=colour, alpha=0.12, lw=0)
            axes.plot(time, median, marker, ls="-", ms=5, markevery=0.1, color=colour, lw=0.9, label=strategy)
            if strategy in paper.FIG_4B:
                axes.axhline(paper.FIG_4B[strategy], color=colour, lw=1.4, ls=":")
        noise = "noise and sea as physics has them" if scenario == paper.PHYSICAL else "the demonstration's noise"
        axes.set(yscale="log", xlabel="time, s", xlim=(0, time[-1]), title=f"{scenario}: {noise}")
    panels[0].set_ylabel("horizontal error, m")
    log_ticks(panels[0].yaxis)
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="lower center", ncols=5)
    return drawn
