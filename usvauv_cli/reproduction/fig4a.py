"""Fig. 4(a): where the AUVs and the boat go in an episode, with the policy learned by DDPG in ESC."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

import policies
from kernels import runtime
from kernels.flow import vortex
from usvauv_cli.figure_theme import MUTED, OUTLINE, TEXT, WATER, web
from usvauv_cli.reproduction import figure, paper
from usvauv_cli.reproduction.runs import Learned
from usvauv_cli.reproduction.settings import PHYSICAL, Settings
from usvauv_env import Trace, World
from usvauv_env.record.metrics import EpisodeMetrics, episode_metrics
from usvauv_env.record.recorder import record
from usvauv_env.record.table import write_rows
from usvauv_env.render import style

NAME = "fig4a"
COLUMNS = ("scenario", "time", "vehicle", "x", "y")
METHOD = "ddpg"
ARROWS = 11  # a side
NODE = "#35d07f"


def pieces(settings: Settings) -> list[Learned]:
    """The pieces of work that the figure needs, beside the two episodes."""
    return [Learned(METHOD, paper.CONDITIONS["ESC"], seed, False) for seed in settings.seeds]


def expert(settings: Settings, folder: Path) -> Learned:
    """The run whose best policy scored highest in its evaluations."""
    return max(pieces(settings), key=lambda run: run.about(folder)["score"])


def voyages(settings: Settings, folder: Path) -> dict[str, Trace]:
    """Scenario → trace of the first episode of `test_seed`; kept as NetCDF and not simulated again."""
    run, traces = expert(settings, folder), {}
    for name in (paper.CONDITIONS["ESC"], PHYSICAL):
        path = folder / "evaluations" / f"voyage-{name}.nc"
        if not path.exists():
            scenario = settings.scenario(name, ("observation.current=speed",))
            world = World(scenario, 1, settings.test_seed)
            policy = policies.load(run.place(folder) / "best", world)
            path.parent.mkdir(exist_ok=True)
            record(world, policy.act, f"{settings.method(METHOD).title}, run {run.seed}").save(path)
        traces[name] = Trace.load(path)
    return traces


def make(settings: Settings, folder: Path, results: Path) -> dict[str, EpisodeMetrics]:
    """Write fig4a.csv, .png and .pdf; returns the metrics of the episodes shown."""
    traces = voyages(settings, folder)
    write_rows(results / f"{NAME}.csv", COLUMNS, (row for item in traces.items() for row in _rows(*item)))
    _draw(traces, results / NAME)
    return {name: episode_metrics(trace)[0] for name, trace in traces.items()}


def _tracks(trace: Trace) -> dict[str, np.ndarray]:
    """Vehicle → (T, 2) m."""
    auvs = {f"AUV {k + 1}": trace.auv_position[:, 0, k] for k in range(trace.auv_position.shape[2])}
    return {**auvs, "USV": trace.boat_position[:, 0, 0]}


def _rows(name: str, trace: Trace) -> Iterator[dict[str, Any]]:
    for vehicle, track in _tracks(trace).items():
        for time, (x, y) in zip(trace.time, track, strict=True):
            yield dict(zip(COLUMNS, (name, float(time), vehicle, float(x), float(y)), strict=True))


def _draw(traces: dict[str, Trace], place: Path) -> None:
    first = next(iter(traces.values()))
    drawn = figure.titled_figure(
        13.2, 7.75,
        "Fig. 4(a): an episode with the policy learned by DDPG in ESC",
        f"{first.policy}, world seed {first.seed}, {first.time[-1]:g} s; arrows: vortices' current halfway,"
        " each panel with its own scale",
    )  # fmt: skip
    grid = drawn.add_gridspec(1, 2, left=0.055, right=0.985, bottom=0.12, top=0.855, wspace=0.13)
    for column, (name, trace) in enumerate(traces.items()):
        axes = drawn.add_subplot(grid[0, column])
        row = episode_metrics(trace)[0]
        figure.style_plot(axes, f"{name}: SDR {row.sdr:.2f} Mbit/s, EC {row.ec:.1f} W, services {row.services}")
        _map(axes, trace)
    lines = [Line2D([], [], color=web(style.auv_colour(k)), label=f"AUV {k + 1}") for k in range(first.power.shape[2])]
    lines.append(Line2D([], [], color=TEXT, lw=1.0, label="USV"))
    places = (("o", MUTED, "none", "start"), ("s", MUTED, "none", "end"), ("^", NODE, NODE, "sensor node"))
    lines += [Line2D([], [], ls="none", marker=m, color=c, mfc=f, label=words) for m, c, f, words in places]
    drawn.legend(handles=lines, loc="lower center", ncols=len(lines), frameon=False, labelcolor=TEXT, fontsize=9.5)
    figure.save(drawn, place)


def _map(axes: Axes, trace: Trace) -> None:
    area, shadow = trace.scenario.area, [withStroke(linewidth=2.4, foreground=OUTLINE)]
    axes.grid(visible=False)
    _current(axes, trace)
    axes.plot(*trace.node_position[0].T, "^", ms=5.5, color=NODE, mec=OUTLINE, mew=0.6, zorder=3)
    for k, (vehicle, track) in enumerate(_tracks(trace).items()):
        boat = vehicle == "USV"
        colour = TEXT if boat else web(style.auv_colour(k))
        axes.plot(*track.T, color=colour, lw=0.8 if boat else 1.1, alpha=0.55 if boat else 0.9, zorder=4 + (not boat))
        for marker, (x, y) in (("o", track[0]), ("s", track[-1])):
            axes.plot(x, y, marker, ms=9, mfc="none", mec=colour, mew=1.8, path_effects=shadow, zorder=6, clip_on=False)
    axes.set(xlim=(0, area.width), ylim=(0, area.length), aspect="equal", xlabel="x (east), m", ylabel="y (north), m")


def _current(axes: Axes, trace: Trace) -> None:
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
        *points[0].T, *velocity.T, color=WATER, alpha=0.6, pivot="mid", angles="xy",
        scale_units="xy", scale=fastest / (1.1 * spacing), width=0.0028, zorder=2,
    )  # fmt: skip
    axes.quiverkey(
        arrows, 0.93, 1.025, fastest, f"{fastest:.2g} m/s", labelpos="W", labelcolor=MUTED, fontproperties={"size": 9}
    )
