"""Options that several commands share, declared once."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from kernels.errors import UserError

ScenarioName = Annotated[str, typer.Argument(metavar="SCENARIO", help="Shipped name or path of a TOML file.")]
Seed = Annotated[int, typer.Option(help="Seed from 0 up; the same seed gives the same result.")]
Arch = Annotated[str, typer.Option(help="Where the kernels run: auto, cpu, cuda, vulkan or metal.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="SECTION.FIELD=VALUE", help="Change one field of the scenario; may be repeated."),
]
Usv = Annotated[str, typer.Option(help="Boat: fim, fim-greedy, fim-horizon (with a tracker), hold:X,Y, centroid.")]


def _load_plugins(files: list[Path] | None) -> list[Path] | None:
    """Import the plugins of installed distributions, then those named; eager, so before any other argument counts."""
    from usvauv_env import plugins

    plugins.load_installed()
    for file in files or ():
        plugins.load(file)
    return files


Plugins = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        metavar="FILE",
        callback=_load_plugins,
        is_eager=True,
        help="Python file that adds tasks, boat strategies, policies and more; may be repeated.",
    ),
]


def at_least(option: str, value: float, least: float) -> None:
    """Refuse a number that is too small or infinite, naming the option, the value and the limit.

    Raises:
        UserError: `value` is below `least`, or not finite.
    """
    if not least <= value < math.inf:
        raise UserError(f"{option} {value}: must be at least {least}, and finite")


def writable(path: Path, option: str = "--out") -> Path:
    """The path itself, when a file can be created there; `option` is what gave it.

    Raises:
        UserError: it is a folder, its folder is missing, or it cannot be written.
    """
    if path.is_dir():
        raise UserError(f"{option} {path}: is a folder, expected a file name")
    if not path.parent.is_dir():
        raise UserError(f"{option} {path}: the folder {path.parent} does not exist")
    probe = path.with_name(path.name + ".partial")
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise UserError(f"{option} {path}: cannot be written: {error.strerror}") from None
    return path
