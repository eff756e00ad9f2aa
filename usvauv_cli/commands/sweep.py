"""`usvauv sweep` and `reproduce`: many runs, each performed once."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from usvauv.cli.commands import options
from usvauv.kernels.errors import UserError

Ray = Annotated[
    str | None,
    typer.Option(
        metavar="local|auto|ADDRESS", help="Run on Ray: started here (local), found (auto), or at an address."
    ),
]
Slurm = Annotated[
    str | None, typer.Option(metavar="PARTITION", help="Run under Slurm, in that partition (or several: a,b).")
]
Jobs = Annotated[
    int | None,
    typer.Option(
        callback=options.bounded(1),
        help="Runs at a time; default as many as there are cores and memory for (Slurm: 1000).",
    ),
]


def sweep(
    study: Annotated[
        Path,
        typer.Argument(metavar="STUDY.toml", callback=options.of_kind("study"), help="File that names the runs."),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder of all results; default studies/STUDY.")] = None,
    ray: Ray = None,
    slurm: Slurm = None,
    jobs: Jobs = None,
    quiet: options.Quiet = False,
    plugins: options.Plugins = None,
) -> None:
    """Train and evaluate what a study file names; write a CSV row per episode and a summary with intervals.

    Finished runs are kept in the folder and not repeated, whatever the engine. Ctrl-C ends the study cleanly; the same
    command continues it. A run that fails is shown with its last line; the others continue, and the exit code is 2.

    **Examples:**

    `usvauv sweep examples/study.toml`

    `usvauv sweep examples/study.toml --out first --jobs 2`

    `usvauv sweep examples/study.toml --ray auto`

    `usvauv sweep examples/study.toml --slurm batch --jobs 100`
    """
    from usvauv.cli.sweep import results
    from usvauv.cli.sweep.perform import engine
    from usvauv.cli.sweep.study import read
    from usvauv.env.scenario import Scenario

    _check(ray, slurm)
    wanted = read(study)
    different = {json.dumps(run.definition["scenario"]): run.definition["scenario"] for run in wanted.runs}
    options.check_regime(*(Scenario.from_dict(scenario) for scenario in different.values()))
    folder = out or Path("studies") / study.stem
    options.make_folder(folder)
    try:
        results.sweep(wanted, folder, lambda: engine(wanted.resources, folder, ray, slurm, jobs), quiet)
    except KeyboardInterrupt:
        typer.echo(f"finished runs are kept in {folder}; run the same command to continue")
        raise


def reproduce(
    target: Annotated[str | None, typer.Argument(metavar="TARGET", help="What to make; without it, a list.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of all results; the same folder continues.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A small version, in minutes.")] = False,
    ray: Ray = None,
    slurm: Slurm = None,
    jobs: Jobs = None,
    plugins: options.Plugins = None,
) -> None:
    """Reproduce the paper's table and figures: train, evaluate, and write a page with the paper's numbers beside ours.

    Without a target: list them with their approximate times. A page comes with CSV, PNG and PDF, and lists every
    convention. `collaboration` is not in the paper: it compares boat strategies where they decide the mission.

    Finished parts are kept in the folder and not repeated. Ctrl-C ends it cleanly; the same command continues.

    **Examples:**

    `usvauv reproduce`

    `usvauv reproduce all --quick --out quick`

    `usvauv reproduce table2 --out full`
    """
    from usvauv.cli.commands.inspect import show
    from usvauv.cli.reproduction.page import TARGETS, listed, reproduce
    from usvauv.cli.reproduction.paper import FULL, QUICK
    from usvauv.cli.sweep.perform import engine
    from usvauv.cli.sweep.study import Resources
    from usvauv.kernels import runtime

    _check(ray, slurm)
    if target is None:
        show("Targets of `usvauv reproduce TARGET --out FOLDER`:", listed())
        return
    options.choice("TARGET", target, TARGETS)
    if out is None:
        raise UserError("--out: needed, the folder of the results")
    options.make_folder(out)
    given = [*(["--quick"] if quick else []), *(f"--plugin {file}" for file in plugins or ())]
    command = " ".join(["usvauv reproduce", target, *given, "--out DIR"])
    resources = Resources(cores=max(1, runtime.available_cores() // jobs) if jobs else 1)
    try:
        page = reproduce(
            target, QUICK if quick else FULL, out, lambda: engine(resources, out, ray, slurm, jobs), resources.cores,
            command,
        )  # fmt: skip
    except KeyboardInterrupt:
        typer.echo(f"finished runs are kept in {out}; run the same command to continue")
        raise
    typer.echo(f"page: {page.resolve()}")


def _check(ray: str | None, slurm: str | None) -> None:
    if ray is not None and slurm is not None:
        raise UserError("--ray, --slurm: must not both be given")
