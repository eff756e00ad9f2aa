"""`usvauv replay`: a recorded mission, or two side by side, drawn again without simulating."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kernels.errors import UserError
from usvauv_cli.commands.options import Plugins
from usvauv_cli.commands.video_options import (
    At,
    Fps,
    Size,
    Speedup,
    ThemeOption,
    VideoOut,
    ViewOption,
    video_settings,
)


def replay(
    traces: Annotated[
        list[Path],
        typer.Argument(metavar="TRACE.nc [TRACE.nc]", help="Of simulate --trace; two are compared."),
    ],
    episode: Annotated[int, typer.Option(help="Which episode of a trace of several, from 0.")] = 0,
    out: VideoOut = None,
    view: ViewOption = "map",
    theme: ThemeOption = "dark",
    size: Size = "1280x720",
    fps: Fps = 30,
    speedup: Speedup = None,
    at: At = None,
    plugins: Plugins = None,
) -> None:
    """Draw a recorded mission as a video or a picture, without simulating it again.

    **Examples:**

    `usvauv replay mission.nc --view both --theme light --out mission.webm`

    `usvauv replay mission.nc --at 120 --out moment.png`

    `usvauv replay fim.nc belief.nc --out compared.mp4`
    """
    from usvauv_cli import console, mission_video
    from usvauv_env import Trace

    if len(traces) > 2:
        raise UserError(f"{len(traces)} traces: at most two can be compared")
    out = out or Path(f"{traces[0].stem}.mp4")
    settings = video_settings(out, size, fps, speedup, view, theme, at)
    recorded = [Trace.load(path) for path in traces]
    for path, trace in zip(traces, recorded, strict=True):
        worlds = trace.power.shape[1]
        if not 0 <= episode < worlds:
            raise UserError(f"--episode {episode}: {path} has episodes 0 to {worlds - 1}")
    recorded = [trace.episode(episode) for trace in recorded]
    with console.progress("drawing", mission_video.frames(recorded, out, settings)) as advance:
        summary = mission_video.render(recorded, out, settings, advance)
    typer.echo(f"{summary.frames} frames: {summary.path.resolve()}")
