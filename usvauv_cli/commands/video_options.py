"""Options of the commands that draw a mission, declared once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usvauv.cli.commands.options import at_least, parse_size, writable
from usvauv.kernels.errors import UserError

if TYPE_CHECKING:
    from usvauv.cli.mission_video import VideoSettings

VideoOut = Annotated[
    Path | None,
    typer.Option(help="Video (.mp4, .webm, .gif, .webp) or picture (.png) to write; default usvauv-SCENARIO.mp4."),
]
Size = Annotated[str, typer.Option(metavar="WxH", help="Frame size in pixels.")]
Fps = Annotated[int, typer.Option(help="Frames a second, at most.")]
Speedup = Annotated[
    float | None,
    typer.Option(help="Seconds of mission in a second of video; default one mission step a frame."),
]
ViewOption = Annotated[str, typer.Option("--view", help="map (from above, with plots), sea (in perspective), or both.")]
ThemeOption = Annotated[str, typer.Option("--theme", help="dark or light.")]
At = Annotated[float | None, typer.Option(help="Moment that a picture shows, s of mission; default its end.")]


def video_settings(
    out: Path, size: str, fps: int, speedup: float | None, view: str, theme: str, at: float | None
) -> VideoSettings:
    """What the options ask for, checked before long work.

    Raises:
        UserError: an option has a value that is not allowed, or the file cannot be written.
    """
    from usvauv.cli.mission_video import ENDINGS, VideoSettings
    from usvauv.env.render.frames import VIEWS, Look
    from usvauv.env.render.style import THEMES

    at_least("--fps", fps, 1)
    if speedup is not None:
        at_least("--speedup", speedup, 0.01)
    if at is not None:
        at_least("--at", at, 0.0)
    if view not in VIEWS:
        raise UserError(f"--view {view!r}: must be one of {', '.join(VIEWS)}")
    if theme not in THEMES:
        raise UserError(f"--theme {theme!r}: must be one of {', '.join(THEMES)}")
    settings = VideoSettings(parse_size(size), fps, speedup, Look(view, theme), at)
    settings.check(writable(out, "--out", ENDINGS))
    return settings
