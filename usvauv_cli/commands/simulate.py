"""`usvauv simulate`, `replay`, `export` and `live`: missions as a video, drawn again from their traces, for other
programs, or in a browser tab; and learned policies as ONNX.
"""

from __future__ import annotations

import webbrowser
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usvauv.cli.commands import options
from usvauv.kernels.errors import UserError, choices
from usvauv.kernels.interruption import stoppable

if TYPE_CHECKING:
    from usvauv.env import Scenario, Trace
    from usvauv.env.record.recorder import Diverged


def simulate(
    context: typer.Context,
    scenario: options.ScenarioName = "extreme",
    policy: options.Policy = None,
    usv: options.Usv = None,
    targets: options.Targets = None,
    seed: options.Seed = 0,
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
    out: options.VideoOut = None,
    view: options.ViewOption = "map",
    theme: options.ThemeOption = "dark",
    size: options.Size = None,
    fps: options.Fps = None,
    speedup: options.Speedup = None,
    at: options.At = None,
    follow: options.Follow = None,
    trace: Annotated[Path | None, typer.Option(help="Also save everything that happened, as NetCDF.")] = None,
    arch: options.Arch = "auto",
    overrides: options.Overrides = None,
    force: options.Force = False,
    plugins: options.Plugins = None,
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
    from usvauv.cli import report
    from usvauv.env import Scenario
    from usvauv.env.record.metrics import episode_metrics
    from usvauv.env.world.boat_strategies import StrategyChoice

    setting = Scenario.load(scenario, overrides or ())
    out = out or Path(f"usvauv-{setting.name}.mp4")
    video = options.checked_video(context, out)
    options.check_follow(video, setting)
    if trace:
        options.writable(context, trace, "--trace", (".nc",))
    options.at_least("--duration", 1.0 if duration is None else duration, 0.1)
    runs = [Run(policy or policies.default(setting), usv, targets)]
    if compare:
        runs.append(runs[0].but(compare))
    for run in runs:
        policies.check(run.policy, run.scenario(setting))
        options.warn_team_size(run.policy, setting)
        StrategyChoice.parse(run.usv, setting)
    options.check_regime(setting)
    options.warn_reflections(setting)
    options.preparing(setting, arch)
    recorded, problem = [], None
    for run in runs:
        shown, problem = simulated(run, setting, seed, duration, arch)
        recorded.append(shown)
        if problem:
            break
    with report.progress("drawing", len(video.moments(recorded))) as advance:
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
    from usvauv.cli import report
    from usvauv.env import World
    from usvauv.env.record.recorder import Diverged, record
    from usvauv.env.storage.memory import give_back

    world = World(run.scenario(scenario), 1, seed, run.usv, fine_sea=True, arch=arch)
    act = policies.acting(run.policy, world)
    steps = max(1, round(duration / world.scenario.mission.step)) if duration else world.steps
    with report.progress("simulating", steps) as advance:
        try:
            return record(world, act, run.policy, steps=steps, surface=True, on_step=lambda _: advance(1)), None
        except Diverged as error:
            return error.trace, error
        finally:
            give_back()  # drawing takes more than simulating


def replay(
    context: typer.Context,
    traces: Annotated[
        list[Path],
        typer.Argument(metavar="TRACE.nc [TRACE.nc]", help="Of simulate --trace; two are compared."),
    ],
    episode: Annotated[int, typer.Option(help="Which episode of a trace of several, from 0.")] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Video (.mp4, .webm, .gif, .webp), picture (.png), or .geojson for a map; default TRACE.mp4."
        ),
    ] = None,
    view: options.ViewOption = "map",
    theme: options.ThemeOption = "dark",
    size: options.Size = None,
    fps: options.Fps = None,
    speedup: options.Speedup = None,
    at: options.At = None,
    follow: options.Follow = None,
    force: options.Force = False,
    plugins: options.Plugins = None,
) -> None:
    """Draw a recorded mission as a video or a picture, without simulating it again, or write it for a map.

    GeoJSON has the area, the tracks with their times, nodes and services, in longitude and latitude.

    **Examples:**

    `usvauv replay mission.nc --view both --theme light --out mission.webm`

    `usvauv replay mission.nc --at 120 --out moment.png`

    `usvauv replay mission.nc --view sea --speedup 1 --at 120:150 --follow auv:1 --out close.mp4`

    `usvauv replay fim.nc belief.nc --out compared.mp4`

    `usvauv replay mission.nc --out mission.geojson`
    """
    from usvauv.cli import report
    from usvauv.cli.tables import counted
    from usvauv.env import Trace
    from usvauv.env.exchange import geojson

    out = out or Path(f"{traces[0].stem}.mp4")
    mapped = out.suffix.lower() == geojson.ENDING
    if len(traces) > (1 if mapped else 2):
        raise UserError(
            f"{len(traces)} traces: {f'--out {out} takes one' if mapped else 'at most two can be compared'}"
        )
    if mapped and follow:
        raise UserError(f"--follow {follow}: {out} shows the whole area")
    if mapped:
        options.writable(context, out, "--out", (geojson.ENDING,))
    video = None if mapped else options.checked_video(context, out)
    recorded = [Trace.load(path) for path in traces]
    for path, trace in zip(traces, recorded, strict=True):
        worlds = trace.power.shape[1]
        if not 0 <= episode < worlds:
            raise UserError(f"--episode {episode}: {path} has episodes 0 to {worlds - 1}")
    recorded = [trace.episode(episode) for trace in recorded]
    if video:
        options.check_follow(video, *(trace.scenario for trace in recorded))
    if video is None:
        features = geojson.of_mission(recorded[0])
        geojson.write(out, features)
        typer.echo(f"{counted(len(features), 'feature')}: {out.resolve()}")
        return
    with report.progress("drawing", len(video.moments(recorded))) as advance:
        summary = video.write(recorded, advance)
    typer.echo(f"{counted(summary.frames, 'frame')}: {summary.path.resolve()}")
    for line in filter(None, (summary.part, summary.remark)):
        typer.echo(line)


def live(
    scenario: options.ScenarioName = "extreme",
    policy: options.Policy = None,
    usv: options.Usv = None,
    targets: options.Targets = None,
    seed: options.Seed = 0,
    port: Annotated[int, typer.Option(help="Port of this machine to serve the tab at; 0 takes a free one.")] = 0,
    open_tab: Annotated[bool, typer.Option("--open/--no-open", help="Open the tab in the default browser.")] = False,
    arch: options.Arch = "auto",
    overrides: options.Overrides = None,
    plugins: options.Plugins = None,
) -> None:
    """Simulate one mission in a browser tab, in perspective or as a map, and change it while it runs.

    The address that is printed holds a secret, without which nobody on this machine gets anything; other machines
    cannot connect. Needs the extra *live*: `pip install "usvauv[live]"`. Ctrl-C ends it.

    **Examples:**

    `usvauv live`

    `usvauv live wide --policy sac-wide --open`
    """
    from usvauv.cli.live.server import Show, listen, serve
    from usvauv.cli.live.session import Session
    from usvauv.env import Scenario

    setting = Scenario.load(scenario, overrides or ()).with_targets(targets)
    options.check_regime(setting)
    with listen(port) as listening, serve(listening, f"usvauv {setting.name}") as (server, address):
        options.preparing(setting, arch)
        session = Session(setting, seed, usv, policy, arch)
        options.warn_team_size(session.policy, setting)
        show = Show(server, session)
        typer.echo(f"live: {address} (Ctrl-C ends it)")
        if open_tab:
            webbrowser.open(address)
        with stoppable() as stop:
            show.run(stop)
        stop.raise_if_asked()


def export(
    context: typer.Context,
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help="With --to a trace, a .nc file; else a trained policy by name, or a checkpoint."
        ),
    ],
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="[SCENARIO]",
            help="Of a policy: shipped name or path of a TOML file. Default: as it was trained.",
        ),
    ] = None,
    to: Annotated[
        str | None,
        typer.Option(metavar="FORMAT", help="Format of a trace: mcap, rrd, parquet or csv."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Of a trace: the file, or the folder of the tables, to write. Default: TRACE.mcap, TRACE.rrd, TRACE."
        ),
    ] = None,
    episode: Annotated[
        int | None, typer.Option(help="Of a trace of several: the episode in mcap and rrd, from 0. Default: 0.")
    ] = None,
    onnx: Annotated[
        Path | None, typer.Option(help="Of a policy: the ONNX file to write. Default: POLICY.onnx.")
    ] = None,
    overrides: options.Overrides = None,
    force: options.Force = False,
    plugins: options.Plugins = None,
) -> None:
    """Write a recorded run for other tools, or a learned policy as ONNX.

    **A trace** of `simulate --trace`, with `--to`: *mcap* is one episode as messages of ROS 2, for Foxglove, RViz
    and PlotJuggler; *rrd* is one for the Rerun viewer; *parquet* and *csv* are a folder of tables, all episodes in
    them, for pandas, R, DuckDB and spreadsheets. *mcap* and *parquet* need the extra `export`, *rrd* the extra
    `rerun`.

    **A policy**, without `--to`: the world's observation (N, K, O) in, its action (N, K, A) out, any N.
    Everything between the two is inside. What each number is, and how the policy was trained, travels as metadata.
    It runs in onnxruntime and needs nothing of usvauv. Writing it needs the extra `onnx`.

    **Examples:**

    `usvauv export mission.nc --to mcap`

    `usvauv export missions.nc --to parquet --out tables`

    `usvauv export sac-extreme --onnx boat.onnx`

    `usvauv export runs/mine extreme --set auv.speed_max=2.0 --onnx slower.onnx`
    """
    if to is None:
        for option, value in (("--out", out), ("--episode", episode)):
            if value is not None:
                raise UserError(f"{option} {value}: is for a trace, which needs --to; a policy is written by --onnx")
        _export_policy(context, source, scenario, onnx, overrides or ())
        return
    for option, value in (("SCENARIO", scenario), ("--onnx", onnx), ("--set", (overrides or [None])[0])):
        if value is not None:
            raise UserError(f"{option} {value}: is for a policy; --to writes a trace")
    _export_trace(context, Path(source), to, out, episode or 0)


def _export_policy(
    context: typer.Context, policy: str, scenario: str | None, onnx: Path | None, overrides: list[str] | tuple[()]
) -> None:
    from usvauv import policies
    from usvauv.env import Scenario
    from usvauv.env.world.observation import ObservationLayout
    from usvauv.policies.export import export as write

    if overrides and scenario is None:
        raise UserError("--set: name the scenario whose fields it changes, after the policy")
    setting = None if scenario is None else Scenario.load(scenario, overrides)
    path = options.writable(
        context, onnx or Path(f"{Path(policy).name.removesuffix('.safetensors')}.onnx"), "--onnx", (".onnx",)
    )
    player = policies.load_learned(policy, setting)
    write(player, path)
    auv, size = player.scenario.auv, ObservationLayout.of(player.scenario).size
    shapes = f"observation (N, {auv.count}, {size}), action (N, {auv.count}, {auv.action_size})"
    typer.echo(f"onnx: {path.resolve()}: {shapes}")


def _export_trace(context: typer.Context, path: Path, to: str, out: Path | None, episode: int) -> None:
    from usvauv.env import Trace
    from usvauv.env.exchange import FOLDERS, WRITERS, export_trace

    if to not in WRITERS:
        raise UserError(f"--to {to!r}: {choices(to, WRITERS)}")
    if to in FOLDERS:
        target = out or Path(path.stem)
    else:
        target = options.writable(context, out or Path(f"{path.stem}.{to}"), "--out", (f".{to}",))
    trace = Trace.load(path)
    episodes = trace.power.shape[1]
    if not 0 <= episode < episodes:
        raise UserError(f"--episode {episode}: {path} has episodes 0 to {episodes - 1}")
    if to in FOLDERS:
        options.make_folder(target)
        options.keep_others(context, target, "--out")
    export_trace(trace, to, target, episode)
    typer.echo(f"{to}: {target.resolve()}")
