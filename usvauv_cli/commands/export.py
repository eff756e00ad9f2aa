"""`usvauv export`: traces for other programs, and learned policies as ONNX."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from usvauv.cli.commands import options
from usvauv.cli.usage import expect
from usvauv.kernels.errors import UserError


def export(
    context: typer.Context,
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help="With --to a trace (.nc); else a trained policy by name, or a checkpoint."
        ),
    ],
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO",
            callback=options.of_kind("scenario"),
            help="For a policy: shipped name or path of a TOML file. Default: the scenario of its training.",
        ),
    ] = None,
    to: Annotated[
        str | None,
        typer.Option(metavar="FORMAT", help="Format of a trace: mcap, rrd, parquet or csv."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="For a trace: the file, or the folder of tables, to write. Default: TRACE.mcap, TRACE.rrd, TRACE."
        ),
    ] = None,
    episode: Annotated[
        int | None, typer.Option(help="Episode for mcap and rrd, if the trace has several, from 0. Default: 0.")
    ] = None,
    onnx: Annotated[
        Path | None, typer.Option(help="For a policy: the ONNX file to write. Default: POLICY.onnx.")
    ] = None,
    overrides: options.Overrides = None,
    force: options.Force = False,
    plugins: options.Plugins = None,
) -> None:
    """Write a recorded run for other tools, or a learned policy as ONNX.

    **A trace** of `simulate --trace`, with `--to`: *mcap* is one episode as messages of ROS 2, for Foxglove, RViz
    and PlotJuggler; *rrd* is one for the Rerun viewer; *parquet* and *csv* are a folder of tables with all episodes,
    for pandas, R, DuckDB and spreadsheets. *mcap* and *parquet* need the extra `export`, *rrd* the extra
    `rerun`.

    **A policy**, without `--to`: the world's observation (N, K, O) in, its action (N, K, A) out, any N.
    The file contains all steps between the two, with the meaning of each number and the training settings as metadata.
    It runs in onnxruntime without usvauv. Writing it needs the extra `onnx`.

    **Examples:**

    `usvauv export mission.nc --to mcap`

    `usvauv export missions.nc --to parquet --out tables`

    `usvauv export sac-extreme --onnx boat.onnx`

    `usvauv export runs/mine extreme --set auv.speed_max=2.0 --onnx slower.onnx`
    """
    if to is not None:
        for option, value in (("SCENARIO", scenario), ("--onnx", onnx), ("--set", (overrides or [None])[0])):
            if value is not None:
                raise UserError(f"{option} {value}: is for a policy; --to writes a trace")
        expect("trace", source)
        _export_trace(context, Path(source), to, out, episode or 0)
        return
    if source.endswith(".nc"):
        from usvauv.env.exchange import WRITERS

        raise UserError(f"{source}: is a trace, which needs --to: {', '.join(WRITERS)}")
    from usvauv.env.scenario import Scenario
    from usvauv.env.world.observation_layout import ObservationLayout
    from usvauv.policies import loading
    from usvauv.policies.export import export as write

    expect("policy", source)
    for option, value in (("--out", out), ("--episode", episode)):
        if value is not None:
            raise UserError(f"{option} {value}: is for a trace, which needs --to; a policy is written by --onnx")
    if overrides and scenario is None:
        raise UserError("--set: name the scenario whose fields it changes, after the policy")
    setting = None if scenario is None else Scenario.load(scenario, overrides or ())
    path = onnx or Path(f"{Path(source).name.removesuffix('.safetensors')}.onnx")
    path = options.writable(context, path, "--onnx", (".onnx",))
    player = loading.load_learned(source, setting)
    write(player, path)
    auv, size = player.scenario.auv, ObservationLayout.of(player.scenario).size
    shapes = f"observation (N, {auv.count}, {size}), action (N, {auv.count}, {auv.action_size})"
    typer.echo(f"onnx: {path.resolve()}: {shapes}")


def _export_trace(context: typer.Context, path: Path, to: str, out: Path | None, episode: int) -> None:
    from usvauv.env.exchange import FOLDERS, WRITERS, export_trace

    if options.choice("--to", to, WRITERS) in FOLDERS:
        target = out or Path(path.stem)
    else:
        target = options.writable(context, out or Path(f"{path.stem}.{to}"), "--out", (f".{to}",))
    trace = options.loaded(path, episode)
    if to in FOLDERS:
        options.make_folder(target)
        options.keep_others(context, target, "--out")
    export_trace(trace, to, target, episode)
    typer.echo(f"{to}: {target.resolve()}")
