"""`usvauv eval`, `sweep` and `reproduce`: policies on the same seeded worlds, and many runs, each done once."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from usvauv.cli.commands import options
from usvauv.kernels.errors import UserError, choices

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
    int | None, typer.Option(help="Runs at a time; default as many as there are cores and memory for (Slurm: 1000).")
]


def evaluate(
    context: typer.Context,
    scenario: options.ScenarioName = "extreme",
    policy: Annotated[
        list[str] | None,
        typer.Option(help=f"{options.POLICIES}; may be repeated. Default: that of simulate, and straight."),
    ] = None,
    usv: Annotated[
        list[str] | None,
        typer.Option(help=f"{options.BOATS}; may be repeated. Default: the scenario's."),
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option(help=f"{options.TARGETS}; may be repeated. Default: the scenario's."),
    ] = None,
    episodes: Annotated[int, typer.Option(help="Episodes for each combination.")] = 20,
    seed: options.Seed = 0,
    out: Annotated[Path, typer.Option(help="CSV to write, one row an episode.")] = Path("metrics.csv"),
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with OUT.csv.partial, which the same command left when it stopped.")
    ] = False,
    chosen_score: Annotated[
        str | None,
        typer.Option(
            "--score",
            metavar="COLUMN",
            help="Figure of merit that is compared in words, and whose interval --until-halfwidth watches."
            " Default: data collected, or distance to stations, in words; else arps.",
        ),
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Policy, boat or rule; differences are to the first combination that has it. Default: the first.",
        ),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            "--until-halfwidth",
            metavar="X",
            help="End when the 95 % intervals of all differences in --score are at most ± X, before --episodes.",
        ),
    ] = None,
    wide: Annotated[bool, typer.Option("--wide", help="Print all figures, in tables wider than the terminal.")] = False,
    report_folder: Annotated[
        Path | None,
        typer.Option("--report", metavar="DIR", help="Folder for a page with intervals, figures and a player."),
    ] = None,
    arch: options.Arch = "auto",
    overrides: options.Overrides = None,
    force: options.Force = False,
    plugins: options.Plugins = None,
) -> None:
    """Compare policies, boats and target rules in the same worlds: means, and who is ahead by how much.

    Differences are to the first combination, with 95 % intervals. A CSV gets a row per episode.

    Rows are kept in OUT.csv.partial until all are there, so that `--resume` can go on after Ctrl-C or a crash.

    **Examples:**

    `usvauv eval --episodes 50`

    `usvauv eval extreme --policy straight:1.4 --policy crab --usv fim --usv hold:100,100 --out metrics.csv`

    `usvauv eval --policy runs/mine/best --set auv.count=2 --seed 7`

    `usvauv eval --policy mine:Best --policy straight`

    `usvauv eval --policy pace --targets tour --targets rollout`

    `usvauv eval --usv fim --usv centroid --report comparison`, then open *comparison/index.html*

    `usvauv eval --policy clear --policy pace --episodes 100000 --until-halfwidth 0.05`
    """
    from usvauv import policies
    from usvauv.cli import report
    from usvauv.cli.evaluation import run
    from usvauv.cli.evaluation.comparison import Comparison
    from usvauv.cli.evaluation.run import combinations, definition, first_difference
    from usvauv.cli.tables import counted
    from usvauv.cli.web_report.episodes import Recordings, front_episodes
    from usvauv.env import Scenario
    from usvauv.env.record.evaluation import WORLDS_PER_BATCH, batch_size
    from usvauv.env.record.metrics import FIGURES, task_metrics
    from usvauv.env.storage.tables import growing_table

    options.at_least("--episodes", episodes, 1)
    if until is not None:
        options.at_least("--until-halfwidth", until, 0)
    setting = Scenario.load(scenario, overrides or ())
    options.writable(context, out, "--out", (".csv",))
    names = list(dict.fromkeys(policy or [policies.default(setting), "straight"]))
    for name in names:
        policies.check(name, setting)
        options.warn_team_size(name, setting)
    scenarios = combinations(setting, names, usv or [None], targets or [None])
    figures = (*FIGURES, *(name for name, metric in task_metrics.items() if metric.task == setting.task))
    score = chosen_score or "arps"
    if score not in figures:
        raise UserError(f"--score {score!r}: {choices(score, figures)}")
    reference = next((which for which in scenarios if against in (None, *filter(None, which))), None)
    if reference is None:
        parts = dict.fromkeys(part for which in scenarios for part in which if part)
        raise UserError(f"--against {against!r}: {choices(against, parts)}")
    if report_folder:
        if resume:
            raise UserError("--report: cannot go with --resume: its figures are of missions that are not run again")
        options.make_folder(report_folder, "--report")
        options.writable(context, report_folder / "index.html", "--report", (".html",))
    options.check_regime(setting)
    options.preparing(setting, arch)
    recordings = Recordings(len(scenarios))
    kept = front_episodes(len(scenarios)) if report_folder else 0
    comparison = Comparison(list(scenarios), reference, kept, setting.random_seas)
    with growing_table(out, resume) as table:
        decides = definition(setting, scenarios, seed, arch)
        about = table.about
        if about is None:
            kinds = {which[1:]: chosen for which, chosen in scenarios.items()}
            size = min(batch_size(chosen, episodes, strategy, arch) for (strategy, _), chosen in kinds.items())
            if size < min(WORLDS_PER_BATCH, episodes):
                typer.echo(f"batches of {counted(size, 'episode')}: what fits into memory", err=True)
            about = {"definition": decides, "batch": size}
            table.begin(about)
        elif difference := first_difference(about["definition"], decides):
            raise UserError(f"{table.path}: is of another command: {difference}")
        try:
            with report.progress("evaluating", len(scenarios) * episodes * setting.mission.steps) as advance:

                def enough() -> bool:
                    advance(0, report.intervals(comparison, score))
                    return until is not None and (comparison.reached(score, until) or comparison.floor(score) > until)

                run.run(
                    scenarios,
                    policies.named(*names),
                    episodes,
                    about["batch"],
                    seed,
                    arch,
                    table,
                    comparison,
                    enough,
                    advance,
                    recordings.add if report_folder else lambda trace, first: None,
                )
        except (KeyboardInterrupt, UserError):
            if table.count:
                there = f"{counted(table.count, 'complete episode')} kept in {table.path}"
                typer.echo(f"stopped; {there}; --resume goes on from there")
            raise
        table.finish()
    report.metrics_tables(comparison, setting, seed, wide, chosen_score)
    if until is not None:
        print("\n".join(report.intervals(comparison, score)))
        if (floor := comparison.floor(score)) > until:
            typer.echo(
                f"--until-halfwidth {until:g}: cannot be reached: episodes take turns on only"
                f" {counted(comparison.seas, 'sea')} (sea.realisations), which leaves"
                f" {'no interval' if math.isinf(floor) else f'± {floor:.2g}'} however many episodes there are"
            )
        elif not comparison.reached(score, until):
            typer.echo(f"--until-halfwidth {until:g}: not reached in {comparison.episodes} episodes")
    typer.echo(f"{counted(table.count, 'episode')} written to {out}")
    if report_folder:
        from usvauv.cli.web_report import page

        typer.echo(
            f"report: {page.write(report_folder, setting, seed, comparison, recordings, chosen_score).resolve()}"
        )


def sweep(
    study: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="File that names the runs.")],
    out: Annotated[Path | None, typer.Option(help="Folder of everything; default studies/STUDY.")] = None,
    ray: Ray = None,
    slurm: Slurm = None,
    jobs: Jobs = None,
    plugins: options.Plugins = None,
) -> None:
    """Train and evaluate what a study file names; write a CSV row per episode and a summary with intervals.

    What is done is kept in the folder and not done again, whatever the engine. Ctrl-C ends it cleanly; the same command
    goes on. A run that fails is shown with its last line; the others go on, and the exit code is 2.

    **Examples:**

    `usvauv sweep examples/study.toml`

    `usvauv sweep examples/study.toml --out first --jobs 2`

    `usvauv sweep examples/study.toml --ray auto`

    `usvauv sweep examples/study.toml --slurm batch --jobs 100`
    """
    from usvauv.cli.sweep import results
    from usvauv.cli.sweep.perform import engine
    from usvauv.cli.sweep.study import read
    from usvauv.env import Scenario

    _check(ray, slurm, jobs)
    wanted = read(study)
    different = {json.dumps(run.definition["scenario"]): run.definition["scenario"] for run in wanted.runs}
    options.check_regime(*(Scenario.from_dict(scenario) for scenario in different.values()))
    folder = out or Path("studies") / study.stem
    options.make_folder(folder)
    try:
        results.sweep(wanted, folder, lambda: engine(wanted.resources, folder, ray, slurm, jobs))
    except KeyboardInterrupt:
        typer.echo(f"what is done is kept in {folder}; the same command goes on")
        raise


def reproduce(
    target: Annotated[str | None, typer.Argument(metavar="[TARGET]", help="What to make; without it, a list.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of everything; the same one goes on.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A small version, in minutes.")] = False,
    ray: Ray = None,
    slurm: Slurm = None,
    jobs: Jobs = None,
    plugins: options.Plugins = None,
) -> None:
    """Make the paper's table and figures again: train, evaluate, and write a page with the paper's numbers beside ours.

    Without a target: list them, with about how long each takes. A page comes with CSV, PNG and PDF, and names every
    convention. `collaboration` is not of the paper: it compares boat strategies where they decide the mission.

    What is done is kept in the folder and not done again. Ctrl-C ends it cleanly; the same command goes on.

    **Examples:**

    `usvauv reproduce`

    `usvauv reproduce all --quick --out quick`

    `usvauv reproduce table2 --out full`
    """
    from usvauv.cli.commands.inspect import show
    from usvauv.cli.reproduction.page import listed, reproduce
    from usvauv.cli.reproduction.paper import FULL, QUICK
    from usvauv.cli.sweep.perform import engine
    from usvauv.cli.sweep.study import Resources
    from usvauv.cli.tables import duration
    from usvauv.kernels import runtime

    _check(ray, slurm, jobs)
    if target is None:
        both = zip(listed(FULL), listed(QUICK), strict=True)
        rows = [
            (
                name,
                f"{about[0].upper()}{about[1:]}; about {duration(full)} on two cores, {duration(quick)} with --quick.",
            )
            for (name, about, full), (_, _, quick) in both
        ]
        show("Targets of `usvauv reproduce TARGET --out FOLDER`:", rows)
        return
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
        typer.echo(f"what is done is kept in {out}; the same command goes on")
        raise
    typer.echo(f"page: {page.resolve()}")


def _check(ray: str | None, slurm: str | None, jobs: int | None) -> None:
    options.at_least("--jobs", 1 if jobs is None else jobs, 1)
    if ray is not None and slurm is not None:
        raise UserError("--ray, --slurm: must not both be given")
