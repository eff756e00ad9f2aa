"""`usvauv eval`: policies, boats and target rules in the same seeded worlds, as a table in the terminal."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from usvauv.cli import terminal
from usvauv.cli.commands import options
from usvauv.cli.terminal import counted
from usvauv.kernels.errors import UserError, choices


def evaluate(
    context: typer.Context,
    scenario: options.ScenarioName = "extreme",
    policy: Annotated[
        list[str] | None,
        typer.Option(
            callback=options.of_kind("policy"),
            help=f"{options.POLICIES}; may be repeated. Default: the one listed for the scenario.",
        ),
    ] = None,
    usv: Annotated[
        list[str] | None,
        typer.Option(help=f"{options.BOATS}; may be repeated. Default: the scenario's."),
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option(help=f"{options.TARGETS}; may be repeated. Default: the scenario's."),
    ] = None,
    episodes: Annotated[int, typer.Option(callback=options.bounded(1), help="Episodes for each combination.")] = 20,
    seed: options.Seed = 0,
    out: Annotated[Path, typer.Option(help="CSV to write, one row an episode.")] = Path("metrics.csv"),
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue from OUT.csv.partial, left by the same command when it stopped.")
    ] = False,
    chosen_score: Annotated[
        str | None,
        typer.Option(
            "--score",
            metavar="COLUMN",
            help="Figure of merit for the comparison in words and for --until-halfwidth."
            " Default: data collected, or distance to stations, in words; arps for --until-halfwidth.",
        ),
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Policy, boat or rule; differences are from the first combination with it. Default: the first.",
        ),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            "--until-halfwidth",
            metavar="X",
            callback=options.bounded(0),
            help="Stop before --episodes when the 95 % intervals of all differences in --score are at most ± X.",
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
    quiet: options.Quiet = False,
    plugins: options.Plugins = None,
) -> None:
    """Compare policies, boats and target rules in the same worlds: means and differences.

    Differences are from the first combination, with 95 % intervals. The CSV has a row per episode.

    Rows are kept in OUT.csv.partial until all are complete, so that `--resume` can continue after Ctrl-C or a crash.

    **Examples:**

    `usvauv eval --episodes 50`

    `usvauv eval extreme --policy straight:1.4 --policy crab --usv fim --usv hold:100,100 --out metrics.csv`

    `usvauv eval --policy runs/mine/best --set auv.count=2 --seed 7`

    `usvauv eval --policy mine:Best --policy straight`

    `usvauv eval --policy pace --targets tour --targets rollout`

    `usvauv eval --usv fim --usv centroid --report comparison`, then open *comparison/index.html*

    `usvauv eval --policy clear --policy pace --episodes 100000 --until-halfwidth 0.05`
    """
    setting = options.scenario_of(scenario, overrides, quiet=quiet)

    from usvauv.cli.evaluation.batches import batches, combinations, definition, first_difference
    from usvauv.cli.evaluation.comparison import RANKED, Comparison
    from usvauv.cli.evaluation.comparison_tables import headline, intervals, metrics_tables
    from usvauv.cli.evaluation.ranking import ahead
    from usvauv.cli.web_report.episodes import Recordings, front_episodes
    from usvauv.env.record.evaluation import WORLDS_PER_BATCH, batch_size
    from usvauv.env.record.metrics import FIGURES, task_metrics
    from usvauv.env.storage.result_tables import growing_table
    from usvauv.policies import loading

    out = options.writable(context, out, "--out", (".csv",))
    names = list(dict.fromkeys(policy or [loading.default(setting)]))
    for name in names:
        options.check_policy(name, setting)
    scenarios = combinations(setting, names, usv or [None], targets or [None])
    figures = (*FIGURES, *(name for name, metric in task_metrics.items() if metric.belongs_to(setting.task)))
    score = options.choice("--score", chosen_score or "arps", figures)
    reference = next((which for which in scenarios if against in (None, *filter(None, which))), None)
    if reference is None:
        parts = dict.fromkeys(part for which in scenarios for part in which if part)
        raise UserError(f"--against {against!r}: {choices(against, parts)}")
    options.check_regime(setting)
    if report_folder:
        if resume:
            raise UserError("--report: cannot go with --resume: its figures are of missions that are not run again")
        options.make_folder(report_folder, "--report")
        options.writable(context, report_folder / "index.html", "--report", (".html",))
    options.preparing(setting, arch, quiet)
    recordings = Recordings(len(scenarios))
    kept = front_episodes(len(scenarios)) if report_folder else 0
    merit = chosen_score or headline(setting)
    ranked = tuple(dict.fromkeys((*RANKED, merit)))
    comparison = Comparison(list(scenarios), reference, kept, setting.random_seas, ranked)
    with growing_table(out, resume, force) as table:
        decides = definition(setting, scenarios, seed, arch)
        about = table.about
        if about is None:
            size = min(batch_size(chosen, episodes) for chosen in scenarios.values())
            if size < min(WORLDS_PER_BATCH, episodes):
                typer.echo(f"batches of {counted(size, 'episode')}: memory holds no more", err=True)
            about = {"definition": decides, "batch": size}
            table.begin(about)
        elif difference := first_difference(about["definition"], decides):
            raise UserError(f"{table.path}: is of another command: {difference}; --force without --resume starts again")
        try:
            steps = len(scenarios) * episodes * setting.mission.steps
            with terminal.progress("evaluating", steps, quiet) as advance:
                makers = loading.named(*names)
                on_trace = recordings.add if report_folder else lambda trace, first: None
                for batch in batches(scenarios, makers, episodes, about["batch"], seed, arch, table, advance, on_trace):
                    comparison.add(batch)
                    advance(0, intervals(comparison, score))
                    if until is not None and (comparison.reached(score, until) or comparison.floor(score) > until):
                        break
        except (KeyboardInterrupt, UserError):
            if table.count:
                there = f"{counted(table.count, 'complete episode')} kept in {table.path}"
                typer.echo(f"stopped; {there}; --resume continues from there")
            raise
        table.finish()
    metrics_tables(comparison, setting, seed, wide, merit, ahead(comparison, merit))
    if until is not None:
        print("\n".join(intervals(comparison, score)))
        if (floor := comparison.floor(score)) > until:
            typer.echo(
                f"--until-halfwidth {until:g}: cannot be reached: the episodes share"
                f" {counted(comparison.seas, 'sea')} (sea.realisations), which leaves"
                f" {'no interval' if math.isinf(floor) else f'± {floor:.2g}'} however many episodes there are"
            )
        elif not comparison.reached(score, until):
            typer.echo(f"--until-halfwidth {until:g}: not reached in {comparison.episodes} episodes")
    typer.echo(f"{counted(table.count, 'episode')} written to {out}")
    if report_folder:
        from usvauv.cli.web_report import page

        written = page.write(report_folder, setting, seed, comparison, recordings, merit)
        typer.echo(f"report: {written.resolve()}")
