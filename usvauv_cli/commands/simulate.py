"""`usvauv simulate`: one mission on a live, finely resolved sea, to a video."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from usvauv_cli.commands.options import (
    POLICIES,
    Arch,
    Overrides,
    Plugins,
    ScenarioName,
    Seed,
    Targets,
    Usv,
    at_least,
    parse_size,
    tell_of_team,
    writable,
)


def simulate(
    scenario: ScenarioName = "extreme",
    policy: Annotated[
        str | None,
        typer.Option(help=f"{POLICIES}. Default: clear, or the heuristic of another task."),
    ] = None,
    usv: Usv = None,
    targets: Targets = None,
    seed: Seed = 0,
    duration: Annotated[
        float | None, typer.Option(help="Seconds to simulate, in whole mission steps; default an episode.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="MP4 to write; default usvauv-SCENARIO.mp4.")] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Frame size in pixels.")] = "1280x720",
    fps: Annotated[int, typer.Option(help="Frames a second; one frame is one mission step.")] = 30,
    trace: Annotated[Path | None, typer.Option(help="Also save everything that happened, as NetCDF.")] = None,
    arch: Arch = "auto",
    overrides: Overrides = None,
    plugins: Plugins = None,
) -> None:
    """Simulate one mission, with the sea solved live, and show it as a video.

    **Examples:**

    `usvauv simulate`

    `usvauv simulate ideal --policy straight:1.5 --usv hold:100,100 --duration 300 --out calm.mp4`

    `usvauv simulate --seed 7 --trace storm.nc --set current.count=8`
    """
    import policies
    from usvauv_cli import console, encoder, report
    from usvauv_env import Scenario, World
    from usvauv_env.memory import require
    from usvauv_env.record.metrics import episode_metrics
    from usvauv_env.record.recorder import Diverged, record

    width, height = parse_size(size)
    at_least("--fps", fps, 1)
    at_least("--duration", 1.0 if duration is None else duration, 0.1)
    setting = Scenario.load(scenario, overrides or ()).with_targets(targets)
    out = writable(out or Path(f"usvauv-{setting.name}.mp4"))
    if trace:
        writable(trace, "--trace")
    require(encoder.video_bytes(width, height), f"--size {size}")  # before the mission is simulated
    name = policy or policies.default(setting)
    policies.check(name, setting)
    tell_of_team(name, setting)
    world = World(setting, 1, seed, usv, fine_sea=True, arch=arch)
    act = policies.acting(name, world)
    steps = round(duration / setting.mission.step) if duration else world.steps
    problem = None
    with console.progress("simulating", steps) as advance:
        try:
            recorded = record(world, act, name, steps=max(1, steps), surface=True, on_step=lambda _: advance(1))
        except Diverged as error:
            recorded, problem = error.trace, error
    with console.progress("drawing", len(recorded.time)) as advance:
        encoder.render(recorded, out, (width, height), fps, progress=advance)
    if trace:
        recorded.save(trace)
    report.mission_summary(episode_metrics(recorded)[0], recorded)
    typer.echo(f"video: {out.resolve()}")
    if trace:
        typer.echo(f"trace: {trace.resolve()}")
    if problem:
        raise problem  # what was written shows the steps before
