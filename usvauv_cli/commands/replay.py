"""`usvauv replay`: a recorded mission, or two side by side, drawn again without simulating, or as GeoJSON."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from usvauv.cli.commands.options import (
    At,
    Follow,
    Force,
    Fps,
    Plugins,
    Size,
    Speedup,
    ThemeOption,
    ViewOption,
    check_follow,
    checked_video,
    writable,
)
from usvauv.kernels.errors import UserError


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
    view: ViewOption = "map",
    theme: ThemeOption = "dark",
    size: Size = None,
    fps: Fps = None,
    speedup: Speedup = None,
    at: At = None,
    follow: Follow = None,
    force: Force = False,
    plugins: Plugins = None,
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
    from usvauv.cli import console
    from usvauv.cli.words import counted
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
        writable(context, out, "--out", (geojson.ENDING,))
    video = None if mapped else checked_video(context, out, size, fps, speedup, view, theme, at, follow)
    recorded = [Trace.load(path) for path in traces]
    for path, trace in zip(traces, recorded, strict=True):
        worlds = trace.power.shape[1]
        if not 0 <= episode < worlds:
            raise UserError(f"--episode {episode}: {path} has episodes 0 to {worlds - 1}")
    recorded = [trace.episode(episode) for trace in recorded]
    if video:
        check_follow(video, *(trace.scenario for trace in recorded))
    if video is None:
        features = geojson.of_mission(recorded[0])
        geojson.write(out, features)
        typer.echo(f"{counted(len(features), 'feature')}: {out.resolve()}")
        return
    with console.progress("drawing", len(video.moments(recorded))) as advance:
        summary = video.write(recorded, advance)
    typer.echo(f"{counted(summary.frames, 'frame')}: {summary.path.resolve()}")
    for line in filter(None, (summary.part, summary.remark)):
        typer.echo(line)
