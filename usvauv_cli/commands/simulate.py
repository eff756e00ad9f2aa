"""`usvauv simulate`: one mission on a live, finely resolved sea, or two side by side, to a video."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usvauv.cli.commands.options import (
    POLICIES,
    Arch,
    At,
    Follow,
    Force,
    Fps,
    Overrides,
    Plugins,
    ScenarioName,
    Seed,
    Size,
    Speedup,
    Targets,
    ThemeOption,
    Usv,
    VideoOut,
    ViewOption,
    at_least,
    check_follow,
    check_regime,
    checked_video,
    preparing,
    warn_reflections,
    warn_team_size,
    writable,
)

if TYPE_CHECKING:
    from usvauv.env import Scenario, Trace
    from usvauv.env.record.recorder import Diverged


def simulate(
    context: typer.Context,
    scenario: ScenarioName = "extreme",
    policy: Annotated[
        str | None,
        typer.Option(help=f"{POLICIES}. Default: the one that usvauv policies lists for the scenario."),
    ] = None,
    usv: Usv = None,
    targets: Targets = None,
    seed: Seed = 0,
    duration: Annotated[
        float | None, typer.Option(help="Seconds to simulate, in whole mission steps; default an episode.")
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="POLICY|usv=BOAT|targets=RULE",
            help="Show the same world with another policy, boat or target rule beside it.",
        ),
    ] = None,
    out: VideoOut = None,
    view: ViewOption = "map",
    theme: ThemeOption = "dark",
    size: Size = None,
    fps: Fps = None,
    speedup: Speedup = None,
    at: At = None,
    follow: Follow = None,
    trace: Annotated[Path | None, typer.Option(help="Also save everything that happened, as NetCDF.")] = None,
    arch: Arch = "auto",
    overrides: Overrides = None,
    force: Force = False,
    plugins: Plugins = None,
) -> None:
    """Simulate one mission, with the sea solved live, and show it as a video.

    **Examples:**

    `usvauv simulate`

    `usvauv simulate ideal --policy straight:1.5 --usv hold:100,100 --duration 300 --out calm.mp4`

    `usvauv simulate --seed 7 --trace storm.nc --set current.count=8`

    `usvauv simulate --view both --theme light --speedup 20 --out storm.webm`

    `usvauv simulate --view sea --speedup 1 --at 100:130 --follow usv --out real-time.mp4`

    `usvauv simulate wide --compare usv=fim --out boats.mp4`
    """
    from usvauv import policies
    from usvauv.cli import console, report
    from usvauv.env import Scenario
    from usvauv.env.record.metrics import episode_metrics
    from usvauv.env.world.boat_strategies import StrategyChoice

    setting = Scenario.load(scenario, overrides or ())
    out = out or Path(f"usvauv-{setting.name}.mp4")
    video = checked_video(context, out, size, fps, speedup, view, theme, at, follow)
    check_follow(video, setting)
    if trace:
        writable(context, trace, "--trace", (".nc",))
    at_least("--duration", 1.0 if duration is None else duration, 0.1)
    runs = [Run(policy or policies.default(setting), usv, targets)]
    if compare:
        runs.append(runs[0].but(compare))
    for run in runs:
        policies.check(run.policy, run.scenario(setting))
        warn_team_size(run.policy, setting)
        StrategyChoice.parse(run.usv, setting)
    check_regime(setting)
    warn_reflections(setting)
    preparing(setting, arch)
    recorded, problem = [], None
    for run in runs:
        shown, problem = simulated(run, setting, seed, duration, arch)
        recorded.append(shown)
        if problem:
            break
    with console.progress("drawing", len(video.moments(recorded))) as advance:
        written = video.write(recorded, advance)
    if trace:
        recorded[0].save(trace)
    for each in recorded:
        report.mission_summary(episode_metrics(each)[0], each)
    typer.echo(f"{'picture' if out.suffix.lower() == '.png' else 'video'}: {out.resolve()}")
    for line in filter(None, (written.part, written.remark)):
        typer.echo(line)
    if trace:
        typer.echo(f"trace: {trace.resolve()}")
    if problem:
        raise problem  # what was written shows the steps before


@dataclass(frozen=True)
class Run:
    """Names of a policy, a boat strategy and a target rule; None for the scenario's."""

    policy: str
    usv: str | None
    targets: str | None

    def but(self, text: str) -> Run:
        """The same with another policy, or with usv=BOAT or targets=RULE."""
        name, equals, value = text.partition("=")
        if equals and name in ("usv", "targets"):
            return replace(self, **{name: value})
        return replace(self, policy=text)

    def scenario(self, scenario: Scenario) -> Scenario:
        return scenario.with_targets(self.targets)


def simulated(
    run: Run, scenario: Scenario, seed: int, duration: float | None, arch: str
) -> tuple[Trace, Diverged | None]:
    """The record of a mission on a finely resolved sea, and what ended it before its time."""
    from usvauv import policies
    from usvauv.cli import console
    from usvauv.env import World
    from usvauv.env.record.recorder import Diverged, record
    from usvauv.env.storage.memory import give_back

    world = World(run.scenario(scenario), 1, seed, run.usv, fine_sea=True, arch=arch)
    act = policies.acting(run.policy, world)
    steps = max(1, round(duration / world.scenario.mission.step)) if duration else world.steps
    with console.progress("simulating", steps) as advance:
        try:
            return record(world, act, run.policy, steps=steps, surface=True, on_step=lambda _: advance(1)), None
        except Diverged as error:
            return error.trace, error
        finally:
            give_back()  # drawing takes more than simulating
