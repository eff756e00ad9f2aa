"""`usvauv reproduce`: the paper's table and figures made again, the paper's numbers beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from usvauv.cli.commands.options import Plugins, at_least, make_folder


def reproduce(
    target: Annotated[
        str, typer.Argument(metavar="TARGET", help="table2, fig3, fig4a, fig4b, all of these, or collaboration.")
    ],
    out: Annotated[Path, typer.Option(help="Folder of everything; the same one goes on.")],
    quick: Annotated[bool, typer.Option("--quick", help="A small version, in minutes.")] = False,
    jobs: Annotated[int | None, typer.Option(help="Pieces of work at a time; default the number of cores.")] = None,
    plugins: Plugins = None,
) -> None:
    """Train and evaluate what a table or figure of the paper needs; write CSV, PNG, PDF and a page with the paper's
    numbers beside ours and every convention named. `collaboration` compares the boat's strategies where they decide.

    What is done is kept in the folder and not done again. Ctrl-C ends it cleanly; the same command goes on.

    **Examples:**

    `usvauv reproduce all --quick --out quick`

    `usvauv reproduce table2 --out full`
    """
    from usvauv.cli.reproduction.settings import FULL, QUICK
    from usvauv.cli.reproduction.targets import reproduce
    from usvauv.env.storage.files import locked
    from usvauv.kernels import runtime

    jobs = runtime.available_cores() if jobs is None else jobs
    at_least("--jobs", jobs, 1)
    make_folder(out)
    options = [*(["--quick"] if quick else []), *(f"--plugin {file}" for file in plugins or ())]
    command = " ".join(["usvauv reproduce", target, *options])
    try:
        with locked(out):
            path = reproduce(target, QUICK if quick else FULL, out, jobs, f"{command} --out DIR", typer.echo)
    except KeyboardInterrupt:
        typer.echo(f"what is done is kept; go on with: {command} --out {out}")
        raise
    typer.echo(f"page: {path.resolve()}")
