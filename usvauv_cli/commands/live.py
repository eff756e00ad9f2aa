"""`usvauv live`: a mission that runs in a browser tab on this machine."""

from __future__ import annotations

import webbrowser
from typing import Annotated

import typer

from usvauv.cli.commands.options import (
    POLICIES,
    Arch,
    Overrides,
    Plugins,
    ScenarioName,
    Seed,
    Targets,
    Usv,
    check_regime,
    preparing,
    warn_team_size,
)
from usvauv.kernels.interruption import stoppable


def live(
    scenario: ScenarioName = "extreme",
    policy: Annotated[
        str | None,
        typer.Option(help=f"{POLICIES}. Default: the one that usvauv policies lists for the scenario."),
    ] = None,
    usv: Usv = None,
    targets: Targets = None,
    seed: Seed = 0,
    port: Annotated[int, typer.Option(help="Port of this machine to serve the tab at; 0 takes a free one.")] = 0,
    open_tab: Annotated[bool, typer.Option("--open/--no-open", help="Open the tab in the default browser.")] = False,
    arch: Arch = "auto",
    overrides: Overrides = None,
    plugins: Plugins = None,
) -> None:
    """Simulate one mission in a browser tab, in perspective or as a map, and change it while it runs.

    The address that is printed holds a secret, without which nobody on this machine gets anything; other machines
    cannot connect. Needs the extra *live*: `pip install "usvauv[live]"`. Ctrl-C ends it.

    **Examples:**

    `usvauv live`

    `usvauv live wide --policy sac-wide --open`
    """
    from usvauv.cli.live.server import Show, listen, serve
    from usvauv.cli.live.session import Session
    from usvauv.env import Scenario

    setting = Scenario.load(scenario, overrides or ()).with_targets(targets)
    check_regime(setting)
    with listen(port) as listening, serve(listening, f"usvauv {setting.name}") as (server, address):
        preparing(setting, arch)
        session = Session(setting, seed, usv, policy, arch)
        warn_team_size(session.policy, setting)
        show = Show(server, session)
        typer.echo(f"live: {address} (Ctrl-C ends it)")
        if open_tab:
            webbrowser.open(address)
        with stoppable() as stop:
            show.run(stop)
        stop.raise_if_asked()
