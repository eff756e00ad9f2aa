"""`usvauv train-targets`: learn which node is next."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from usvauv.cli import tables
from usvauv.cli.commands.options import (
    Arch,
    Force,
    Overrides,
    Plugins,
    ScenarioName,
    Seed,
    Usv,
    at_least,
    writable,
)
from usvauv.kernels.interruption import Interrupted

if TYPE_CHECKING:
    from usvauv.policies.decisions import DecisionTrainer

BASELINES = ("tour", "rollout:40", "rollout:90")


def train_targets(
    context: typer.Context,
    scenario: ScenarioName = "survey",
    out: Annotated[Path, typer.Option(help="File of the learned rule, JSON.")] = Path("targets.json"),
    iterations: Annotated[int, typer.Option(help="Episodes of all worlds to learn from.")] = 100,
    worlds: Annotated[int, typer.Option(help="Worlds stepped together.")] = 128,
    seed: Seed = 0,
    policy: Annotated[str | None, typer.Option(help="Who steers; default: the scenario's best heuristic.")] = None,
    usv: Usv = "centroid",
    arch: Arch = "auto",
    overrides: Overrides = None,
    force: Force = False,
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
    from usvauv.policies.checkpoint import provenance
    from usvauv.policies.decisions import DecisionConfig, DecisionTrainer

    at_least("--iterations", iterations, 1)
    at_least("--worlds", worlds, 1)
    writable(context, out, "--out", (".json",))
    setting = Scenario.load(scenario, overrides or ())
    steering = policy or policies.default(setting)
    config = DecisionConfig(iterations=iterations, worlds=worlds, seed=seed)
    trainer = DecisionTrainer(setting, steering, config, usv, arch=arch)
    about = {"scenario": setting.name, "information": setting.nodes.information, "policy": steering, **provenance({})}
    _learn(trainer, BASELINES, out, about)


def _learn(trainer: DecisionTrainer, baselines: Sequence[str], out: Path, about: dict[str, Any]) -> None:
    """Train, with a line for each evaluation beside baselines in the same worlds; Ctrl-C keeps the best weights."""
    iterations = trainer.config.iterations
    against = ", ".join(f"{name} {trainer.evaluate_other(name):.1f}" for name in baselines)
    typer.echo(tables.wrapped(f"evaluation, Mbit: {against}", 2))
    begun = time.monotonic()
    try:
        for result in trainer.train(out, about):
            typer.echo(
                f"iteration {result.iteration} of {iterations}: {result.sampled:.1f} Mbit drawn,"
                f" evaluation {result.evaluated:.1f}, best {trainer.best:.1f};"
                f" {(time.monotonic() - begun) * (iterations / result.iteration - 1):.0f} s left"
            )
    except Interrupted:
        typer.echo(f"stopped after {trainer.iteration} of {iterations} iterations")
        if math.isfinite(trainer.best):
            typer.echo(f"best {trainer.best:.1f} Mbit in {out}")
        raise
    typer.echo(tables.wrapped(f"best {trainer.best:.1f} Mbit ({against}) in {out}", 2))
