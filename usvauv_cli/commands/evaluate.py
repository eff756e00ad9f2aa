"""`usvauv eval`: each policy with each boat strategy on the same seeded worlds, to a CSV, a table and a page."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from kernels.errors import DivergenceError
from usvauv_cli.commands.options import (
    BOATS,
    POLICIES,
    TARGETS,
    Arch,
    Overrides,
    Plugins,
    ScenarioName,
    Seed,
    at_least,
    make_folder,
    tell_of_team,
    writable,
)

ROW_BYTES = 2000.0  # of memory, of an episode's figures


def evaluate(
    scenario: ScenarioName = "extreme",
    policy: Annotated[
        list[str] | None,
        typer.Option(help=f"{POLICIES}; may be repeated. Default: clear (or that of another task) and straight."),
    ] = None,
    usv: Annotated[
        list[str] | None,
        typer.Option(help=f"{BOATS}; may be repeated. Default: the scenario's."),
    ] = None,
    targets: Annotated[
        list[str] | None,
        typer.Option(help=f"{TARGETS}; may be repeated. Default: the scenario's."),
    ] = None,
    episodes: Annotated[int, typer.Option(help="Episodes for each combination.")] = 20,
    seed: Seed = 0,
    out: Annotated[Path, typer.Option(help="CSV to write, one row an episode.")] = Path("metrics.csv"),
    wide: Annotated[bool, typer.Option("--wide", help="All figures, in tables of any width.")] = False,
    report_folder: Annotated[
        Path | None,
        typer.Option("--report", metavar="DIR", help="Folder for a page with intervals, figures and a player."),
    ] = None,
    arch: Arch = "auto",
    overrides: Overrides = None,
    plugins: Plugins = None,
) -> None:
    """Run policies on the same seeded worlds, write one CSV row an episode, print mean ± standard deviation.

    **Examples:**

    `usvauv eval --episodes 50`

    `usvauv eval extreme --policy straight:1.4 --policy crab --usv fim --usv hold:100,100 --out metrics.csv`

    `usvauv eval --policy runs/mine/best --set auv.count=2 --seed 7`

    `usvauv eval --policy mine:Best --policy straight`

    `usvauv eval --policy pace --targets tour --targets rollout`

    `usvauv eval --usv fim --usv centroid --report comparison`, then open *comparison/index.html*
    """
    import policies
    import usvauv_env
    from usvauv_cli import console, report
    from usvauv_cli.web_report.recordings import Recordings
    from usvauv_env import EpisodeMetrics, Scenario
    from usvauv_env.memory import require
    from usvauv_env.record.table import write_rows
    from usvauv_env.world.boat_strategies import StrategyChoice

    at_least("--episodes", episodes, 1)
    setting = Scenario.load(scenario, overrides or ())
    writable(out, "--out", (".csv",))
    names = list(dict.fromkeys(policy or [policies.default(setting), "straight"]))
    for name in names:
        policies.check(name, setting)
        tell_of_team(name, setting)
    strategies = [StrategyChoice.parse(name, setting).name for name in usv or [None]]
    settings = [setting.with_targets(rule) for rule in targets or [None]]
    if report_folder:
        make_folder(report_folder, "--report")
        writable(report_folder / "index.html", "--report", (".html",))
    require(ROW_BYTES * len(names) * len(strategies) * len(settings) * episodes, f"--episodes {episodes}: their rows")
    recordings = Recordings(len(names) * len(strategies) * len(settings))
    rows: list[EpisodeMetrics] = []
    total = len(names) * len(strategies) * len(settings) * episodes * setting.mission.steps
    try:
        with console.progress("evaluating", total) as advance:
            for strategy, chosen in product(strategies, settings):
                usvauv_env.evaluate(
                    chosen,
                    policies.named(*names),
                    episodes=episodes,
                    seed=seed,
                    usv=strategy,
                    arch=arch,
                    on_step=advance,
                    on_batch=rows.extend,
                    on_trace=recordings.add if report_folder else lambda trace, first: None,
                )
    except (KeyboardInterrupt, DivergenceError):
        if rows:
            write_rows(out, list(rows[0].columns()), (row.columns() for row in rows))
            typer.echo(f"stopped; the {len(rows)} episodes that are complete are in {out}")
        raise
    write_rows(out, list(rows[0].columns()), (row.columns() for row in rows))
    report.metrics_tables(rows, setting.task, wide)
    typer.echo(f"{len(rows)} episodes written to {out}")
    if report_folder:
        from usvauv_cli.web_report import page

        typer.echo(f"report: {page.write(report_folder, setting, rows, recordings).resolve()}")
