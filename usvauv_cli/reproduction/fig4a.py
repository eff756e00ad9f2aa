"""Fig. 4(a): where the AUVs and the boat go in an episode, with the policy learned by DDPG in ESC."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from usvauv import policies
from usvauv.cli.reproduction import figure, paper
from usvauv.cli.reproduction.runs import Learned
from usvauv.cli.reproduction.settings import PHYSICAL, Settings
from usvauv.env import Trace, World
from usvauv.env.record.metrics import EpisodeMetrics, episode_metrics
from usvauv.env.record.recorder import record
from usvauv.env.render.figure_theme import OUTLINE, Ground, write_pair
from usvauv.env.storage.tables import write_rows
from usvauv.kernels import runtime
from usvauv.kernels.flow import vortex

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
    """Write fig4a.csv, a pair of .png, and .pdf; returns the metrics of the episodes shown."""
    traces = voyages(settings, folder)
    write_rows(results / f"{NAME}.csv", COLUMNS, (row for item in traces.items() for row in _rows(*item)))
    write_pair(results / f"{NAME}.png", partial(_draw, traces), pdf=True)
    return {name: episode_metrics(trace)[0] for name, trace in traces.items()}


def _tracks(trace: Trace) -> dict[str, np.ndarray]:
    """Vehicle → (T, 2) m."""
    auvs = {f"AUV {k + 1}": trace.auv_position[:, 0, k] for k in range(trace.auv_position.shape[2])}
    return {**auvs, "USV": trace.boat_position[:, 0, 0]}


def _rows(name: str, trace: Trace) -> Iterator[dict[str, Any]]:
    for vehicle, track in _tracks(trace).items():
        for time, (x, y) in zip(trace.time, track, strict=True):
            yield dict(zip(COLUMNS, (name, float(time), vehicle, float(x), float(y)), strict=True))


def _draw(traces: dict[str, Trace], ground: Ground) -> Figure:
    first = next(iter(traces.values()))
    drawn = figure.titled_figure(
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
    axes.plot(*trace.node_position[0].T, "^", ms=5.5, color=NODE, mec=OUTLINE, mew=0.6, zorder=3)
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
