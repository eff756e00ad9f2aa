"""`usvauv sea`: the sea of a scenario alone, as a video, as CF-NetCDF or as a figure."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usvauv.cli import terminal
from usvauv.cli.commands import options
from usvauv.cli.terminal import counted
from usvauv.kernels.errors import DivergenceError, UserError
from usvauv.kernels.interruption import stoppable

if TYPE_CHECKING:
    from usvauv.cli.sea_view.figure import SeaFigure
    from usvauv.cli.sea_view.video import SeaVideo
    from usvauv.env.sea.sea_file import SeaFile
    from usvauv.env.sea.simulation import SeaSimulation

    Sink = SeaFile | SeaFigure | SeaVideo  # a file that is made of the records of a sea

FIGURES = (".png", ".pdf", ".svg")
FORMATS = (".mp4", ".nc", *FIGURES)
SPEED = 2.0  # of a video without --interval, over that of the sea
FIGURE_INTERVAL = 0.5  # s between records of a figure; the shortest waves of a storm have periods above 2 s


def sea(
    context: typer.Context,
    scenario: options.ScenarioName = "extreme",
    duration: Annotated[
        float, typer.Option(callback=options.bounded(0.1, options.LONGEST), help="Seconds of sea.")
    ] = 60.0,
    resolution: Annotated[
        float | None, typer.Option(metavar="M", help="Grid spacing, m. Default: the scenario's sea.fine_cells.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Video .mp4, data .nc or figure .png, .pdf, .svg; default usvauv-sea-SCENARIO.mp4."),
    ] = None,
    seed: options.Seed = 0,
    interval: Annotated[
        float | None,
        typer.Option(
            callback=options.bounded(1e-3),
            help="Seconds of sea from one frame or record to the next. Default: a video plays at twice the speed; data"
            " come each sea.update_interval, for a figure each 0.5 s.",
        ),
    ] = None,
    fps: Annotated[
        int | None, typer.Option(callback=options.bounded(1, 1000), help="Frames a second of a video; default 30.")
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Frame size of a video in pixels; default 1280x720.")
    ] = None,
    arch: options.Arch = "auto",
    overrides: options.Overrides = None,
    force: options.Force = False,
    plugins: options.Plugins = None,
) -> None:
    """Simulate the sea alone: long waves, storm and current, the same as in `simulate` with this seed.

    The ending of `--out` selects the format:

    **.mp4** a video: map with current, the surface from the side, a section along the waves, the level in the middle;

    **.nc** CF-1.11 NetCDF for xarray, Panoply or ParaView: *elevation* and the long waves' depth-averaged velocity *u*,
    *v* over (time, y, x), and the current; x is east, y north, times count from the start. A
    scenario with a place and a date has longitudes, latitudes and true times in it;

    **.png**, **.pdf**, **.svg** a figure: maps at four times, a section over time, the level in the middle and its
    spectrum.

    Ctrl-C ends it early and keeps what has been written.

    **Examples:**

    `usvauv sea --duration 60 --out storm.mp4`

    `usvauv sea extreme --duration 600 --resolution 2 --out storm.nc --seed 3`

    `usvauv sea --out calm.png --set storm.spectrum=none --set sea.irregular_rms=0.5`
    """
    setting = options.scenario_of(scenario, overrides)

    from usvauv.env.render.style import clock
    from usvauv.env.sea.simulation import SeaSimulation, cells
    from usvauv.env.world.mission_parameters import first_vortices

    out = out or Path(f"usvauv-sea-{setting.name}.mp4")
    out = options.writable(context, out, "--out", FORMATS)
    kind = out.suffix.lower()
    for option, value in (("--fps", fps), ("--size", size)):
        if value is not None and kind != ".mp4":
            raise UserError(f"{option} {value}: is for videos; --out {out} is not one")
    fps, pixels = 30 if fps is None else fps, options.parse_size(size or "1280x720")
    if interval is None:
        interval = {".mp4": SPEED / fps, ".nc": setting.sea.update_interval}.get(kind, FIGURE_INTERVAL)
    if interval > duration:
        raise UserError(f"--duration {duration:g}: must not be shorter than --interval, {interval:g} s")
    shape = cells(setting, resolution)
    # Real currents are read for as long as the mission lasts.
    longer = setting.mission.model_copy(update={"duration": max(setting.mission.duration, duration)})
    setting = setting.model_copy(update={"mission": longer})

    records = round(duration / interval) + 1
    water = SeaSimulation(setting, seed, shape, interval, first_vortices(setting, seed, arch))
    typer.echo(describe(water, records))
    options.check_regime(setting)
    if kind == ".mp4":
        typer.echo(f"{records / fps:.3g} s of video at {fps} frames a second, played at {fps * interval:g} × real time")
    begun = time.perf_counter()
    made, problem = 0, None
    with (
        stoppable() as stop,
        sink(out, water, records, pixels, fps) as file,
        terminal.progress("solving and writing", records) as advance,
    ):
        stop.raise_if_asked()
        while made < records and (not made or not stop.asked):
            try:
                if made:
                    water.advance()
            except DivergenceError as error:
                problem = error
                break
            file.add(water)
            made += 1
            advance(1)
    cost = f"{terminal.size(out.stat().st_size)} in {terminal.duration(time.perf_counter() - begun, rough=True)}"
    typer.echo(f"{ {'.mp4': 'video', '.nc': 'data'}.get(kind, 'figure') }: {out.resolve()} ({cost})")
    if made < records:
        typer.echo(f"stopped at {clock(water.time)} of {clock((records - 1) * interval)}; the file holds that much")
        if problem:
            raise problem
        stop.raise_if_asked()


def describe(water: SeaSimulation, records: int) -> str:
    """Grid and time steps in two lines."""
    area, (dx, dy) = water.scenario.area, water.spacing
    spacing = f"{dx:.3g} m" if abs(dx / dy - 1) < 1e-3 else f"{dx:.3g} × {dy:.3g} m"
    solved = "as many solver steps as it takes"  # by the nonlinear solver, which chooses them step by step
    if substeps := getattr(water.long_waves, "substeps", None):
        solved = f"{counted(substeps, 'solver step')} of {water.interval / substeps:.3g} s"
    return (
        f"{water.scenario.name}, seed {water.seed}: {area.width:g} × {area.length:g} m of sea on"
        f" {len(water.x)} × {len(water.y)} cells of {spacing}\n"
        f"{(records - 1) * water.interval:g} s in {counted(records - 1, 'step')} of {water.interval:.4g} s, each of"
        f" {solved}"
    )


def sink(out: Path, water: SeaSimulation, records: int, pixels: tuple[int, int], fps: int) -> Sink:
    """The file that the suffix of `out` asks for; it appears when the context ends, and not at all after an error."""
    kind = out.suffix.lower()
    if kind == ".nc":
        from usvauv.env.sea.sea_file import SeaFile

        return SeaFile(out, water)
    from usvauv.env.sea.simulation import survey

    if kind == ".mp4":
        from usvauv.cli.sea_view.video import SeaVideo

        expected = survey(water.scenario, water.seed, (records - 1) * water.interval)
        return SeaVideo(out, water, expected, records, pixels, fps)
    from usvauv.cli.sea_view.figure import SeaFigure

    return SeaFigure(out, water, records)
