"""Speed and memory of the mission's video: frames a second by size, beside an animation by matplotlib.

    python -m benchmarks.video [--json] [--frames 1000]

A mission of `extreme` is recorded once. `likeness` is the correlation of neighbouring frames, as they are decoded. Each
size and the animation run in processes of their own. The animation shows what the map and its panel show, in plainer
form: sea, current, boat, AUVs, trails, ellipses, nodes, figures, the fixes around each AUV, the plot of errors and a
section, with artists whose data are replaced. Each frame is drawn whole, as `FuncAnimation` does, and encoded by the
same encoder. Then the peak of the resident memory of the commands `simulate` and `replay` at 1280 × 720, of a short and
a long mission, each in a process of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import av
import numpy as np

from benchmarks.machine import command_line, describe, show
from usvauv import policies
from usvauv.env import Scenario, Trace, World
from usvauv.env.record.metrics import position_error
from usvauv.env.record.recorder import record
from usvauv.env.render.frames import VIEWS
from usvauv.env.render.video import video_file, write_video

SIZES = ("640x360", "1280x720", "1920x1080", "3840x2160")
BASELINE = "matplotlib"
ANIMATED = 60  # frames of the animation, which is slow
MISSIONS = (300, 1200)  # steps of those that the commands show
COMMAND = """
from usvauv.cli.app import run
code = run()
from benchmarks.video import peak_memory
print(peak_memory())
raise SystemExit(code)
"""


def recorded(frames: int) -> tuple[Trace, float]:
    """A mission of `extreme` on the finely resolved sea, and how long that took once kernels were compiled, s."""
    world = World(Scenario.load("extreme", [f"mission.duration={frames}"]), 1, 0, fine_sea=True)
    act = policies.acting("clear", world)
    record(world, act, "clear", steps=2, surface=True)
    begin = time.perf_counter()
    return record(world, act, "clear", surface=True), time.perf_counter() - begin


def peak_memory() -> float:
    """Largest resident memory of this process so far, MB."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1e3


def drawn(trace: Trace, size: tuple[int, int], view: str, out: Path) -> dict[str, float]:
    """Frames a second of a view, and peak memory; caches of kernels and letters are warm."""
    write_video(trace, out, view=view, size=size, speedup=3000.0)
    begin = time.perf_counter()
    summary = write_video(trace, out, view=view, size=size, speedup=30.0)
    return {
        "frames_per_second": summary.frames / (time.perf_counter() - begin),
        "peak_memory_mb": peak_memory(),
        "kilobytes_per_frame": out.stat().st_size / summary.frames / 1e3,
        "likeness": likeness(out),
    }


def likeness(video: Path) -> float:
    """Mean correlation of the grey pixels of neighbouring frames: 1 if they are alike."""
    with av.open(str(video)) as file:
        frames = (frame.to_ndarray(format="gray").ravel().astype(np.float32) for frame in file.decode(video=0))
        return float(np.mean([np.corrcoef(one, other)[0, 1] for one, other in pairwise(frames)]))


def animated(trace: Trace, size: tuple[int, int], out: Path) -> dict[str, float]:
    """Frames a second of an animation by matplotlib, with artists updated in place."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Ellipse

    figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    area, panel = figure.add_axes((0.04, 0.06, 0.5, 0.88)), figure.add_axes((0.62, 0.36, 0.36, 0.2))
    section = figure.add_axes((0.62, 0.08, 0.36, 0.18))
    side, auvs = trace.scenario.area, range(trace.power.shape[2])
    sea = area.imshow(trace.surface[0], origin="lower", extent=(0, side.width, 0, side.length), cmap="ocean")
    figure.colorbar(sea, ax=area)
    grid = np.stack(np.meshgrid(*(np.linspace(0, length, 24) for length in (side.width, side.length))), -1)
    arrows = area.quiver(grid[..., 0], grid[..., 1], *np.ones((2, 24, 24)), color="w", alpha=0.4)
    nodes = area.scatter(*trace.node_position[0].T, c=trace.backlog[0, 0], cmap="RdYlGn_r", zorder=2)
    (boat,) = area.plot([], [], "w^", ms=12)
    trails = [area.plot([], [], lw=2)[0] for _ in auvs]
    ellipses = [area.add_patch(Ellipse((0, 0), 1, 1, fill=False, color="w")) for _ in auvs]
    labels = [area.text(0, 0, f"AUV {auv + 1}", color="w") for auv in auvs]
    title = figure.suptitle("")
    error = position_error(trace)[:, 0]
    panel.set(xlim=(0, trace.time[-1]), ylim=(0.01, error.max()), yscale="log", xlabel="s", ylabel="position error, m")
    panel.grid()
    curves = [panel.plot([], [])[0] for _ in auvs]
    insets = [figure.add_axes((0.6 + 0.4 * auv / len(auvs), 0.64, 0.36 / len(auvs), 0.22)) for auv in auvs]
    fixes = [inset.scatter([], [], s=4) for inset in insets]
    for inset in insets:
        inset.set(xlim=(-2, 2), ylim=(-2, 2), aspect="equal")
    offset = (trace.fix - trace.heard_position)[:, 0]
    along = np.linspace(0, side.width, trace.surface.shape[2])
    (water,) = section.plot(along, np.zeros_like(along))
    (below,) = section.plot([], [], "o")
    section.set(xlim=(0, side.width), ylim=(-trace.scenario.area.depth, 15))
    begin = time.perf_counter()
    frames = min(ANIMATED, len(trace.time))
    with video_file(out, *size, 30) as append:
        for t in range(frames):
            sea.set_data(trace.surface[t])
            turn = grid[..., None, :] - trace.vortex[t, 0, :, :2]
            strength = trace.vortex[t, 0, :, 2] / (
                2 * np.pi * (np.square(turn).sum(-1) + trace.vortex[t, 0, :, 3] ** 2)
            )
            arrows.set_UVC(-(strength * turn[..., 1]).sum(-1), (strength * turn[..., 0]).sum(-1))
            nodes.set_array(trace.backlog[t, 0])
            boat.set_data(trace.boat_position[t, 0, :, 0], trace.boat_position[t, 0, :, 1])
            for auv in auvs:
                trails[auv].set_data(*trace.auv_position[max(0, t - 120) : t + 1, 0, auv].T)
                curves[auv].set_data(trace.time[: t + 1], error[: t + 1, auv])
                ellipses[auv].set_center(trace.estimate[t, 0, auv])
                ellipses[auv].set(width=4 * trace.estimate_covariance[t, 0, auv, 0] ** 0.5)
                ellipses[auv].set(height=4 * trace.estimate_covariance[t, 0, auv, 2] ** 0.5)
                labels[auv].set_position(trace.auv_position[t, 0, auv])
                fixes[auv].set_offsets(offset[max(0, t - 59) : t + 1, auv])
            row = int(trace.boat_position[t, 0, 0, 1] / side.length * (trace.surface.shape[1] - 1))
            water.set_ydata(trace.surface[t, row])
            below.set_data(trace.auv_position[t, 0, :, 0], np.full(len(auvs), -trace.scenario.auv.depth))
            title.set_text(f"{trace.time[t]:.0f} s, {trace.delivered[: t + 1, 0].sum():.1f} Mbit")
            canvas.draw()
            append(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., 2::-1]))
    return {"frames_per_second": frames / (time.perf_counter() - begin)}


def child(trace: Path, size: str, what: str) -> dict[str, float]:
    """Measure one thing in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.video", "--trace", str(trace), "--size", size, "--what", what]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # as `usvauv` sets it
    result = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    return json.loads(result.stdout.splitlines()[-1])


def memory_of(command: str, *arguments: object) -> float:
    """Peak memory of `usvauv` with a command, MB."""
    line = [sys.executable, "-c", COMMAND, command, *map(str, arguments)]
    return float(subprocess.run(line, check=True, capture_output=True, text=True).stdout.splitlines()[-1])


def commands(folder: Path) -> dict[str, list[float]]:
    """Peak memory (MB) of simulating, also with the trace kept, and of drawing that trace, for each of `MISSIONS`."""
    trace, out = folder / "kept.nc", ("--out", folder / "command.mp4", "--force")
    found: dict[str, list[float]] = {"simulate": [], "simulate --trace": [], "replay": []}
    for steps in MISSIONS:
        simulate = "simulate", "--duration", steps, *out
        found["simulate"].append(memory_of(*simulate))
        found["simulate --trace"].append(memory_of(*simulate, "--trace", trace))
        found["replay"].append(memory_of("replay", trace, *out))
    return found


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON only")
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--trace", type=Path, help="(of a child) the mission")
    parser.add_argument("--size", default="1280x720", help="(of a child)")
    parser.add_argument("--what", help="(of a child) a view, or the animation")
    arguments = parser.parse_args()
    if arguments.what:
        width, height = map(int, arguments.size.split("x"))
        trace, out = Trace.load(arguments.trace), arguments.trace.with_suffix(".mp4")
        if arguments.what == BASELINE:
            print(json.dumps(animated(trace, (width, height), out)))
        else:
            print(json.dumps(drawn(trace, (width, height), arguments.what, out)))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mission.nc"
        trace, simulating = recorded(arguments.frames)
        trace.save(path)
        by_size = {size: child(path, size, "map") for size in SIZES}
        by_view = {view: child(path, "1280x720", view) for view in VIEWS}
        baseline = child(path, "1280x720", BASELINE)
        by_command = commands(Path(folder))
    result = {
        "machine": describe(),
        "frames": arguments.frames,
        "sizes": [{"size": size, **figures} for size, figures in by_size.items()],
        "views": {view: figures["frames_per_second"] for view, figures in by_view.items()},
        "commands_peak_memory_mb": by_command,
        "simulating_s": simulating,
        "matplotlib": baseline["frames_per_second"],
        "ratio": by_view["map"]["frames_per_second"] / baseline["frames_per_second"],
    }
    show(result, arguments.json)


if __name__ == "__main__":
    main()
