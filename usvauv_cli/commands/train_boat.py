"""`usvauv train-boat`: learn which AUV the boat visits next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from usvauv.cli.commands.decisions import learn
from usvauv.cli.commands.options import (
    Arch,
    Overrides,
    Plugins,
    ScenarioName,
    Seed,
    Targets,
    at_least,
    writable,
)

BASELINES = ("visit", "belief")


def train_boat(
    scenario: ScenarioName = "wide",
    out: Annotated[Path, typer.Option(help="File of the learned boat, JSON.")] = Path("boat.json"),
    iterations: Annotated[int, typer.Option(help="Episodes of all worlds to learn from.")] = 100,
    worlds: Annotated[int, typer.Option(help="Worlds stepped together.")] = 128,
    seed: Seed = 0,
    policy: Annotated[str | None, typer.Option(help="Who steers; default: the scenario's best heuristic.")] = None,
    targets: Targets = None,
    arch: Arch = "auto",
    overrides: Overrides = None,
    plugins: Plugins = None,
) -> None:
    """Learn a boat strategy: which AUV the boat visits next, with the AUVs' steering and target rule as they are.

    Every few iterations it is evaluated in other worlds, beside `visit` and `belief` in the same; the best so far is in
    the file, which `--usv learned:FILE` takes. Ctrl-C ends the run and keeps it.

    **Examples:**

    `usvauv train-boat`

    `usvauv train-boat wide --set acoustics.source_level=140 --out boat140.json`

    `usvauv eval wide --usv learned:boat.json --usv visit`
    """
    from usvauv import policies
    from usvauv.env import Scenario
    from usvauv.kernels.errors import UserError
    from usvauv.policies.decisions import VISITS, DecisionTrainer
    from usvauv.policies.training.provenance import provenance

    at_least("--iterations", iterations, 1)
    at_least("--worlds", worlds, 1)
    writable(out, "--out", (".json",))
    setting = Scenario.load(scenario, overrides or ()).with_targets(targets)
    if setting.task_definition.targets != "nodes":
        raise UserError(f"scenario {setting.name!r}: task {setting.task!r} brings in no data to learn from")
    steering = policy or policies.default(setting)
    config = replace(VISITS.settings, iterations=iterations, worlds=worlds, seed=seed)
    trainer = DecisionTrainer(VISITS, setting, steering, config, arch=arch)
    about = {"scenario": setting.name, "targets": setting.nodes.target_rule, "policy": steering, **provenance({})}
    learn(trainer, BASELINES, out, about)
