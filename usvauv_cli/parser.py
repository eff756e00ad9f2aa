"""The commands and their common options.

Each command's module imports what it needs when it runs, so that `--help` answers at once.
"""

from __future__ import annotations

from importlib import metadata
from typing import Annotated

import typer

from usvauv.cli.commands import evaluate, inspect, plan, sea, simulate, train, train_targets

app = typer.Typer(
    name="usvauv",
    help="USV–AUV collaboration under extreme seas: simulate to a video, train policies, evaluate to a table.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command("simulate")(simulate.simulate)
app.command("replay")(simulate.replay)
app.command("live")(simulate.live)
app.command("train")(train.train)
app.command("train-targets")(train_targets.train_targets)
app.command("eval")(evaluate.evaluate)
app.command("export")(simulate.export)
app.command("sweep")(evaluate.sweep)
app.command("reproduce")(evaluate.reproduce)
app.command("plan")(plan.plan)
app.command("sea")(sea.sea)
app.command("scenarios")(inspect.scenarios)
app.command("policies")(inspect.policies)
app.command("boats")(inspect.boats)
app.command("targets")(inspect.targets)
app.command("doctor")(inspect.doctor)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"usvauv {metadata.version('usvauv')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """The options of `usvauv` itself; the app's help text stands above."""
