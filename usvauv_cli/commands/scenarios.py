"""`usvauv scenarios`: list the shipped scenarios, or print one as documented TOML."""

from __future__ import annotations

from typing import Annotated

import typer

from usvauv.cli.commands.options import Overrides, Plugins


def scenarios(
    scenario: Annotated[str | None, typer.Argument(metavar="[SCENARIO]", help="Name or path to print.")] = None,
    overrides: Overrides = None,
    plugins: Plugins = None,
) -> None:
    """List the shipped scenarios, or print one as TOML in which every field is explained.

    **Example:** `usvauv scenarios extreme --set auv.count=4 > mine.toml`, then `usvauv simulate mine.toml`
    """
    from usvauv.cli import tables
    from usvauv.env import Scenario

    if scenario:
        typer.echo(Scenario.load(scenario, overrides or ()).to_toml(), nl=False)
        return
    for name in Scenario.shipped():
        typer.echo(tables.wrapped(f"{name:16} {Scenario.load(name).description}", 17))
