"""`usvauv train-targets`: train the choice of the next node."""

from __future__ import annotations

import math
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from usvauv.cli import terminal
from usvauv.cli.commands import options
from usvauv.cli.terminal import duration
from usvauv.kernels.errors import UserError

BASELINES = ("tour", "rollout:40", "rollout:90")


def train_targets(
    context: typer.Context,
    scenario: options.ScenarioName = "survey",
    out: Annotated[Path, typer.Option(help="File of the learned rule, JSON.")] = Path("targets.json"),
    iterations: Annotated[
        int, typer.Option(callback=options.bounded(1), help="Episodes of all worlds to learn from.")
    ] = 100,
    worlds: Annotated[int, typer.Option(callback=options.bounded(1), help="Worlds simulated in parallel.")] = 128,
    seed: options.Seed = 0,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue from OUT.json.partial, left by the same command when it stopped.")
    ] = False,
    policy: Annotated[
        str | None,
        typer.Option(
            callback=options.of_kind("policy"), help="Policy of the AUVs; default: the scenario's best heuristic."
        ),
    ] = None,
    usv: options.Usv = "centroid",
    arch: options.Arch = "auto",
    overrides: options.Overrides = None,
    force: options.Force = False,
    plugins: options.Plugins = None,
) -> None:
    """Learn a target rule: which node an AUV heads for next, from the information that `nodes.information` gives it.

    Every few iterations the rule is evaluated in other worlds and compared with `tour` and `rollout` there. The best so
    far is in the file, for `--targets learned:FILE`. The state of the run is kept in OUT.json.partial until the end, so
    that `--resume` can continue after Ctrl-C or a crash, to the same result.

    **Examples:**

    `usvauv train-targets`

    `usvauv train-targets survey --set nodes.information=own-visits --out own.json`

    `usvauv eval survey --policy clear --targets learned:own.json --targets tour`
    """
    from usvauv import policies
    from usvauv.cli.evaluation.run import definition, first_difference
    from usvauv.env import Scenario
    from usvauv.env.storage.files import locked
    from usvauv.env.storage.tables import Combination
    from usvauv.env.world.boat_strategies import StrategyChoice
    from usvauv.policies.checkpoint import TRAINING, provenance, read
    from usvauv.policies.decisions import DecisionConfig, DecisionTrainer

    options.writable(context, out, "--out", (".json",))
    context.with_resource(locked(out, out.with_name(f".{out.name}.lock")))
    last = out.with_name(f"{out.name}.partial")
    if resume and not last.exists():
        raise UserError(f"{last}: is not there; without it there is nothing to resume")
    if last.exists() and not (resume or force):
        raise UserError(f"{last}: is of an earlier run; --resume goes on with it, --force begins anew")
    setting = Scenario.load(scenario, overrides or ())
    options.check_regime(setting)
    steering = policy or policies.default(setting)
    config = DecisionConfig(iterations=iterations, worlds=worlds, seed=seed)
    options.check_policy(steering, setting)
    StrategyChoice.parse(usv, setting)
    decides = definition(setting, [Combination(steering, usv or "", "")], seed, arch) | {"training": asdict(config)}
    begun: dict[str, Any] = {}
    if resume:
        kept = read(last, TRAINING)[0]
        if difference := first_difference(kept.get("definition"), decides):
            raise UserError(f"{last}: is of another command: {difference}; --force without --resume begins anew")
        begun = {**kept["about"], "steps": kept["iteration"]}
    options.preparing(setting, arch)
    trainer = DecisionTrainer(setting, steering, config, usv, arch=arch)
    if resume:
        trainer.resume(last)
    about = {"scenario": setting.name, "information": setting.nodes.information, "policy": steering}
    against = ", ".join(f"{name} {trainer.evaluate_other(name):.1f}" for name in BASELINES)
    typer.echo(terminal.wrapped(f"in evaluation, Mbit: {against}", 2))
    first, started = trainer.iteration, time.monotonic()
    for result in trainer.train(out, about | provenance(begun), last, decides):
        left = (time.monotonic() - started) * (iterations - result.iteration) / (result.iteration - first)
        typer.echo(
            f"iteration {result.iteration} of {iterations}: {result.sampled:.1f} Mbit while exploring,"
            f" {result.evaluated:.1f} in evaluation, best {trainer.best:.1f}"
            f"{f'; {duration(left, rough=True)} left' if left else ''}"
        )
    if trainer.iteration == iterations:
        last.unlink()
    else:
        typer.echo(
            f"stopped after {trainer.iteration} of {iterations} iterations; the same command with --resume goes on"
        )
    if math.isfinite(trainer.best):
        typer.echo(terminal.wrapped(f"best {trainer.best:.1f} Mbit ({against}) in {out}", 2))
    trainer.interruption.raise_if_asked()
