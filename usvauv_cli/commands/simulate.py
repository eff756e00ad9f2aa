"""`usvauv simulate`, `replay` and `live`: missions as a video, drawn again from their traces, or in a browser tab."""

from __future__ import annotations

import math
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usvauv.cli import terminal
from usvauv.cli.commands import options
from usvauv.cli.terminal import counted, duration
from usvauv.kernels.errors import UserError
from usvauv.kernels.interruption import stoppable

if TYPE_CHECKING:
    from usvauv.env import Scenario, Trace
    from usvauv.env.record.metrics import EpisodeMetrics
    from usvauv.env.record.recorder import Diverged

Run = tuple[str, str | None, str | None]  # names of policy, boat strategy and target rule; None: the scenario's


def simulate(
    context: typer.Context,
    scenario: options.ScenarioName = "extreme",
    policy: options.Policy = None,
    usv: options.Usv = None,
    targets: options.Targets = None,
    seed: options.Seed = 0,
    duration: Annotated[
        float | None,
        typer.Option(
            callback=options.bounded(0.1, options.LONGEST),
            help="Seconds to simulate, in whole mission steps; default an episode.",
        ),
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="POLICY|usv=BOAT|targets=RULE",
            callback=options.of_kind("policy"),
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
    trace: Annotated[
        Path | None,
        typer.Option(help="Also save the whole mission as NetCDF; with --compare the first of the two."),
    ] = None,
    arch: options.Arch = "auto",
    overrides: options.Overrides = None,
    force: options.Force = False,
    quiet: options.Quiet = False,
    plugins: options.Plugins = None,
) -> None:
    """Simulate one mission, with the sea solved live, and show it as a video.

    With `--view sea --at` it is simulated to the end of what is shown, unless `--duration` or `--trace` asks for more;
    the map's plots show all of it.

    **Examples:**

    `usvauv simulate`

    `usvauv simulate ideal --policy straight:1.5 --usv hold:100,100 --duration 300 --out calm.mp4`

    `usvauv simulate --seed 7 --trace storm.nc --set current.count=8`

    `usvauv simulate --view both --theme light --speedup 20 --out storm.webm`

    `usvauv simulate --view sea --speedup 1 --at 100:130 --follow usv --out real-time.mp4`

    `usvauv simulate wide --compare usv=fim --out boats.mp4`
    """
    setting = options.scenario_of(scenario, overrides, quiet=quiet)

    from usvauv.env.record.metrics import episode_metrics
    from usvauv.env.record.recorder import check_room
    from usvauv.env.world.strategy_choice import StrategyChoice
    from usvauv.policies import loading

    out = out or Path(f"usvauv-{setting.name}.mp4")
    video = options.checked_video(context, out)
    out = video.path
    if trace:
        options.writable(context, trace, "--trace", (".nc",))
    step = setting.mission.step
    steps = max(1, round(duration / step)) if duration else setting.mission.steps
    options.check_shown(video, steps * step, setting)
    if view == "sea" and video.end is not None and not (duration or trace):
        steps = min(steps, max(1, math.ceil(video.end / step - 1e-9)))
    check_room(setting, 1, steps)
    steering = policy or loading.default(setting)
    runs: list[Run] = [(steering, usv, targets)]
    if compare and compare.startswith("usv="):
        runs.append((steering, compare.removeprefix("usv="), targets))
    elif compare and compare.startswith("targets="):
        runs.append((steering, usv, compare.removeprefix("targets=")))
    elif compare:
        runs.append((compare, usv, targets))
    for steered_by, boat, rule in runs:
        options.check_policy(steered_by, setting.with_targets(rule))
        StrategyChoice.parse(boat, setting)
    options.check_regime(setting)
    options.preparing(setting, arch, quiet)
    recorded, problem = [], None
    for run in runs:
        shown, problem = simulated(run, setting, seed, steps, arch, out, quiet)
        recorded.append(shown)
        if problem:
            break
    if trace:
        recorded[0].save(trace)  # now, so that it is there whatever becomes of the video
    with terminal.progress("drawing", len(video.moments(recorded)), quiet) as advance:
        written = video.write(recorded, advance)
    for each in recorded:
        mission_summary(episode_metrics(each)[0], each)
    typer.echo(f"{'picture' if out.suffix.lower() == '.png' else 'video'}: {out.resolve()}")
    for line in filter(None, (written.part, written.remark)):
        typer.echo(line)
    if trace:
        typer.echo(f"trace: {trace.resolve()}")
    if problem:
        raise problem  # what was written shows the steps before


def simulated(
    run: Run, scenario: Scenario, seed: int, steps: int, arch: str, out: Path, quiet: bool
) -> tuple[Trace, Diverged | None]:
    """The record of a mission on a finely resolved sea, for the file `out`, and what ended it before its time."""
    from usvauv.env import World
    from usvauv.env.record.recorder import Diverged, record
    from usvauv.env.storage.files import OutputError
    from usvauv.env.storage.memory import give_back
    from usvauv.policies import loading

    policy, usv, targets = run
    world = World(scenario.with_targets(targets), 1, seed, usv, fine_sea=True, arch=arch)
    act = loading.acting(policy, world)
    with terminal.progress("simulating", steps, quiet) as advance:
        try:
            return record(world, act, policy, steps=steps, surface=True, on_step=lambda _: advance(1)), None
        except Diverged as error:
            return error.trace, error
        except OutputError as error:  # of what is kept on the disk until the file is written
            raise OutputError(f"{out}: {error}") from None
        finally:
            give_back()  # drawing takes more than simulating


def replay(
    context: typer.Context,
    traces: Annotated[
        list[Path],
        typer.Argument(
            metavar="TRACE.nc [TRACE.nc]",
            callback=options.of_kind("trace"),
            help="Trace from simulate --trace; two are compared.",
        ),
    ],
    episode: Annotated[int, typer.Option(help="Episode to draw, if the trace has several, from 0.")] = 0,
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
    """Draw a recorded mission as a video or a picture, without simulating it again, or write it as GeoJSON.

    GeoJSON has the area, the tracks with their times, nodes and services, in longitude and latitude.

    **Examples:**

    `usvauv replay mission.nc --view both --theme light --out mission.webm`

    `usvauv replay mission.nc --at 120 --out moment.png`

    `usvauv replay mission.nc --view sea --speedup 1 --at 120:150 --follow auv:1 --out close.mp4`

    `usvauv replay fim.nc belief.nc --out compared.mp4`

    `usvauv replay mission.nc --out mission.geojson`
    """
    out = out or Path(f"{traces[0].stem}.mp4")
    mapped = out.suffix.lower() == ".geojson"
    if len(traces) > (1 if mapped else 2):
        raise UserError(
            f"{len(traces)} traces: {f'--out {out} takes one' if mapped else 'at most two can be compared'}"
        )
    if mapped:
        for name in ("follow", "at", "size", "fps", "speedup"):
            if (value := context.params[name]) is not None:
                raise UserError(f"--{name} {value}: is for videos and pictures; {out} shows the whole area and mission")
        options.writable(context, out, "--out", (".geojson",))
    video = None if mapped else options.checked_video(context, out)
    recorded = [options.loaded(path, episode).episode(episode) for path in traces]
    if video is None:
        from usvauv.env.exchange import geojson

        features = geojson.of_mission(recorded[0])
        geojson.write(out, features)
        typer.echo(f"{counted(len(features), 'feature')}: {out.resolve()}")
        return
    length = min(float(trace.time[-1]) for trace in recorded)
    options.check_shown(video, length, *(trace.scenario for trace in recorded))
    with terminal.progress("drawing", len(video.moments(recorded))) as advance:
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
    port: Annotated[int, typer.Option(help="Port of this machine that serves the tab; 0 takes a free one.")] = 0,
    open_tab: Annotated[bool, typer.Option("--open/--no-open", help="Open the tab in the default browser.")] = False,
    arch: options.Arch = "auto",
    overrides: options.Overrides = None,
    plugins: options.Plugins = None,
) -> None:
    """Simulate one mission in a browser tab, in perspective or as a map, and change it while it runs.

    The printed address contains a secret token, without which other users of this machine have no access; other
    machines cannot connect. Needs the extra *live*: `pip install "usvauv[live]"`. Ctrl-C ends it.

    **Examples:**

    `usvauv live`

    `usvauv live wide --policy pace --open`
    """
    setting = options.scenario_of(scenario, overrides).with_targets(targets)

    from usvauv.cli.live.server import Show, listen, serve
    from usvauv.cli.live.session import Session
    from usvauv.env.world.strategy_choice import StrategyChoice
    from usvauv.policies import loading

    options.check_policy(policy or loading.default(setting), setting)
    StrategyChoice.parse(usv, setting)
    options.check_regime(setting)
    with listen(port) as listening, serve(listening, f"usvauv {setting.name}") as (server, address):
        options.preparing(setting, arch)
        session = Session(setting, seed, usv, policy, arch)
        show = Show(server, session)
        typer.echo(f"live: {address} (Ctrl-C ends it)")
        if open_tab:
            webbrowser.open(address)
        with stoppable() as stop:
            show.run(stop)
        stop.raise_if_asked()


def mission_summary(row: EpisodeMetrics, trace: Trace) -> None:
    """Print the metrics of one mission in sentences."""
    scenario, found = trace.scenario, row.of_task
    heave = trace.boat_surface[:, 0, :, 0]
    boats = "boats" if heave.shape[1] > 1 else "boat"
    touched = f", {counted(row.grounded, 'step')} on the bed, {row.surfaced} at the surface"
    energy = f"; {boats} {row.boat_energy_wh:.0f} Wh" if scenario.boat.metered else ""
    if row.spent:
        energy += f"; {counted(row.spent, 'AUV')} with a spent battery, the first after {duration(row.spent_first)}"
    lines = [
        f"{row.scenario}{scenario.change}, seed {row.seed}, policy {row.policy}, {boats} {row.usv}:"
        f" {duration(float(trace.time[-1]))} of mission",
        f"energy: AUVs {row.energy_wh:.1f} Wh; mean power of one under way (EC) {row.ec:.0f} W{energy}",
        f"position error: {row.position_error_rms:.2f} m rms, median {row.position_error_median:.2f} m,"
        f" 95th percentile {row.position_error_p95:.2f} m",
        f"fixes: usable in {row.fix_availability:.1%} of the time, longest gap {duration(row.outage_longest)}",
        f"safety: {counted(row.collisions, 'step')} with two AUVs closer than {scenario.auv.collision_distance:g} m,"
        f" {counted(row.border, 'move')} stopped at the border{touched if scenario.auv.dynamic else ''}",
        f"sea: the {boats} heaved from {heave.min():+.2f} to {heave.max():+.2f} m",
        f"score: average reward per step (ARPS) {row.arps:.2f}",
    ]
    if scenario.task == "station-keeping":
        lines.insert(1, f"stations: AUVs are off theirs by {row.target_distance:.2f} m on average")
    if scenario.task_definition.targets == "moving":
        lines.insert(
            1,
            f"targets: error {found['track_error_mean']:.1f} m on average, median {found['track_error_median']:.1f} m,"
            f" within 20 m in {found['track_close']:.0%} of the time",
        )
    if scenario.task == "data-collection":
        before, cost = found["aoi_peak"], found["joule_per_mbit"]
        lines[1:2] = [
            f"data: {row.delivered_mbit:.1f} Mbit from {counted(row.services, 'service')} of nodes,"
            f" {found['lost_mbit']:.1f} Mbit lost to full buffers"
            f"{'' if math.isnan(cost) else f'; {cost:.0f} J/Mbit'}",
            f"age of the data: {found['aoi_mean']:.0f} s on average"
            f"{'' if math.isnan(before) else f', {before:.0f} s just before a service'}",
            lines[1],
        ]
        lines[-1] += f", sum of data rates (SDR) {row.sdr:.2f} Mbit/s"
    indented = [lines[0], *(f"  {line}".replace(" -", " −") for line in lines[1:])]
    print("\n".join(terminal.wrapped(line, 4) for line in indented))
