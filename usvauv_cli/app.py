"""The `usvauv` command: registers the commands, turns a user's error into one line and exit code 2.

Each command's module imports what it needs when it runs, so that `--help` answers at once.
"""

from __future__ import annotations

import sys
from importlib import metadata
from typing import Annotated, NoReturn

import typer

from kernels.errors import UserError
from usvauv_cli.commands import evaluate, export, plan, reproduce, scenarios, sea, simulate, train

INTERRUPTED = 130  # what a shell reports for Ctrl-C

app = typer.Typer(
    name="usvauv",
    help="USV–AUV collaboration under extreme seas: simulate to a video, train policies, evaluate to a table.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command("simulate")(simulate.simulate)
app.command("train")(train.train)
app.command("eval")(evaluate.evaluate)
app.command("export")(export.export)
app.command("reproduce")(reproduce.reproduce)
app.command("plan")(plan.plan)
app.command("sea")(sea.sea)
app.command("scenarios")(scenarios.scenarios)


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


def main() -> NoReturn:
    """Entry point of the installed command."""
    try:
        code = app(standalone_mode=False)
    except UserError as error:
        code = _fail(str(error))
    except (KeyboardInterrupt, typer.Abort):
        print("stopped", file=sys.stderr)
        code = INTERRUPTED
    except Exception as error:
        # The command-line library's own usage errors, whichever copy of it typer brings along.
        explain = getattr(error, "format_message", None)
        if explain is None:
            raise
        message = " ".join(explain().split())
        code = _fail(message) if message else 2  # without a message help was asked for by naming no command
    sys.exit(code or 0)


def _fail(message: str) -> int:
    print(f"error: {message}", file=sys.stderr)
    return 2
