"""`usvauv sweep`: a study of many runs, each done once, on this machine, Ray or Slurm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usvauv.cli.commands.options import Plugins, at_least, make_folder
from usvauv.kernels.errors import UserError

if TYPE_CHECKING:
    from usvauv.cli.engines.conduct import Engine
    from usvauv.cli.sweep.study import Resources

MOST_JOBS = 1000  # of a Slurm array at a time, unless told otherwise


def sweep(
    study: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="File that names the runs.")],
    out: Annotated[Path | None, typer.Option(help="Folder of everything; default studies/STUDY.")] = None,
    ray: Annotated[
        str | None, typer.Option(metavar="local|auto|ADDRESS", help="Run on Ray: begun here, found, or at an address.")
    ] = None,
    slurm: Annotated[
        str | None, typer.Option(metavar="PARTITION", help="Run under Slurm, in that partition (or several: a,b).")
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(help="Runs at a time; default as many as there are cores and memory for (Slurm: 1000)."),
    ] = None,
    plugins: Plugins = None,
) -> None:
    """Train and evaluate what a study file names; write one CSV row an episode and a summary with
    intervals.

    What is done is kept in the folder and not done again, whatever the engine. Ctrl-C ends it cleanly; the same command
    goes on. A run that fails is shown with its last line; the others go on, and the exit code is 2.

    **Examples:**

    `usvauv sweep examples/study.toml`

    `usvauv sweep examples/study.toml --out first --jobs 2`

    `usvauv sweep examples/study.toml --ray auto`

    `usvauv sweep examples/study.toml --slurm batch --jobs 100`
    """
    from usvauv.cli.sweep import results
    from usvauv.cli.sweep.study import read

    at_least("--jobs", 1 if jobs is None else jobs, 1)
    if ray is not None and slurm is not None:
        raise UserError("--ray, --slurm: must not both be given")
    wanted = read(study)
    folder = out or Path("studies") / study.stem
    make_folder(folder)
    try:
        results.sweep(wanted, folder, lambda: _engine(wanted.resources, folder, ray, slurm, jobs))
    except KeyboardInterrupt:
        typer.echo(f"what is done is kept in {folder}; the same command goes on")
        raise


def _engine(resources: Resources, folder: Path, ray: str | None, slurm: str | None, jobs: int | None) -> Engine:
    from usvauv.cli.engines.local import Local
    from usvauv.cli.engines.on_ray import OnRay
    from usvauv.cli.engines.on_slurm import OnSlurm
    from usvauv.env.storage import memory
    from usvauv.kernels import runtime

    if ray not in (None, "local") and jobs is not None:
        raise UserError(f"--jobs {jobs}: must go without --ray {ray}, whose resources decide")
    room = [runtime.available_cores() / resources.cores, memory.available() / (resources.memory * 1e9)]
    if resources.gpu:
        room.append(1 / resources.gpu)
    here = jobs or max(1, int(min(room)))
    needs = resources.cores, resources.memory, resources.gpu
    if ray is not None:
        return OnRay(ray, here, *needs)
    if slurm is not None:
        return OnSlurm(folder / "slurm", slurm, jobs or MOST_JOBS, *needs, resources.hours)
    return Local(here, resources.cores)
