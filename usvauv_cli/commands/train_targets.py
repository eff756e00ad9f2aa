"""`usvauv train-targets`: learn which node is next."""

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
    Usv,
    at_least,
    writable,
)

BASELINES = ("tour", "rollout:40", "rollout:90")


def train_targets(
    scenario: ScenarioName = "survey",
    out: Annotated[Path, typer.Option(help="File of the learned rule, JSON.")] = Path("targets.json"),
    iterations: Annotated[int, typer.Option(help="Episodes of all worlds to learn from.")] = 100,
    worlds: Annotated[int, typer.Option(help="Worlds stepped together.")] = 128,
    seed: Seed = 0,
    policy: Annotated[str | None, typer.Option(help="Who steers; default: the scenario's best heuristic.")] = None,
    usv: Usv = "centroid",
    arch: Arch = "auto",
    overrides: Overrides = None,
    plugins: Plugins = None,
) -> None:
    """Learn a target rule: which node an AUV heads for next, from what `nodes.information` lets it know.

    Every few iterations it is evaluated in other worlds, beside `tour` and `rollout` in the same; the best so far is in
    the file, which `--targets learned:FILE` takes. Ctrl-C ends the run and keeps it.

    **Examples:**

    `usvauv train-targets`

    `usvauv train-targets survey --set nodes.information=own-visits --out own.json`

    `usvauv eval survey --policy clear --targets learned:own.json --targets tour`
    """
    from usvauv import policies
    from usvauv.env import Scenario
    from usvauv.policies.decisions import NODES, DecisionTrainer
    from usvauv.policies.training.provenance import provenance

    at_least("--iterations", iterations, 1)
    at_least("--worlds", worlds, 1)
    writable(out, "--out", (".json",))
    setting = Scenario.load(scenario, overrides or ())
    steering = policy or policies.default(setting)
    config = replace(NODES.settings, iterations=iterations, worlds=worlds, seed=seed)
    trainer = DecisionTrainer(NODES, setting, steering, config, usv, arch=arch)
    about = {"scenario": setting.name, "information": setting.nodes.information, "policy": steering, **provenance({})}
    learn(trainer, BASELINES, out, about)
