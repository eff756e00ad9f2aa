"""`usvauv train`: learn a policy, watch it learn, keep the best."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from kernels.errors import UserError
from kernels.interruption import Interrupted
from usvauv_cli.commands.options import (
    Arch,
    Overrides,
    Plugins,
    ScenarioName,
    Seed,
    Targets,
    Usv,
    at_least,
    make_folder,
)

if TYPE_CHECKING:
    from policies import Trainer, TrainingConfig
    from usvauv_env import Scenario

STEPS = 2_000_000


def train(
    scenario: ScenarioName = "extreme",
    algorithm: Annotated[str, typer.Option(help="sac, td3 or ddpg.")] = "sac",
    steps: Annotated[
        int | None,
        typer.Option(
            help="World-steps in all: one step of W worlds counts W. Default 2000000; with --resume, as begun."
        ),
    ] = None,
    worlds: Annotated[int, typer.Option(help="Worlds stepped together.")] = 128,
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="Folder of the run; default runs/SCENARIO-ALGORITHM-SEED.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in --out, as it was begun.")] = False,
    shared: Annotated[bool, typer.Option("--shared", help="One network for all AUVs instead of one each.")] = False,
    learn: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Change one setting of the learning; may be repeated."),
    ] = None,
    usv: Usv = None,
    targets: Targets = None,
    arch: Arch = "auto",
    overrides: Overrides = None,
    plugins: Plugins = None,
) -> None:
    """Train a policy with SAC, TD3 or DDPG and keep its best and last checkpoint, with TensorBoard files beside them.

    Before the first step and now and then it is evaluated on worlds it is not trained in, beside `clear` on the
    same worlds (`keep` in station-keeping). Ctrl-C ends the run cleanly; `--resume` goes on.

    **Examples:**

    `usvauv train`

    `usvauv train ideal --algorithm td3 --steps 500000 --out runs/first`

    `usvauv train --shared --learn hidden=128,128 --learn updates=4 --set reward.power=-0.006`

    `usvauv train --out runs/first --resume --steps 1000000`

    `torchrun --nproc-per-node 2 -m usvauv_cli train --out runs/second`
    """
    import policies
    from policies.checkpoint import clean
    from policies.evaluation import EVALUATION_EPISODES, EVALUATION_SEED_OFFSET
    from policies.training.provenance import provenance
    from policies.training.ranks import joined
    from usvauv_cli import report
    from usvauv_env import Scenario, World
    from usvauv_env.lock import locked

    with joined(arch) as ranks, ExitStack() as stack:

        def begin() -> tuple[Path, Scenario, TrainingConfig, int, dict[str, Any]]:
            """What is to be done, where, and how it was begun; the folder is this process's from here on."""
            at_least("--steps", STEPS if steps is None else steps, 1)
            at_least("--worlds", worlds, 1)
            if resume and (overrides or learn or targets):
                raise UserError(
                    "--set, --learn, --targets: a resumed run keeps the scenario and settings it was begun with"
                )
            setting = Scenario.load(scenario, overrides or ()).with_targets(targets)
            config = policies.TrainingConfig(algorithm=algorithm, num_worlds=worlds, seed=seed, shared=shared)
            config = config.changed(learn or ())
            ranks.share(worlds)
            place = out or Path("runs") / f"{setting.name}-{algorithm}-{seed}"
            if not resume:
                make_folder(place)
            elif not place.is_dir():
                raise UserError(f"--out {place}: there is no run to resume")
            stack.enter_context(locked(place))
            clean(place)
            if resume:
                setting, config, begun = policies.read_run(place)
                return place, setting, config, steps or begun.get("total", STEPS), begun
            if (place / "last").exists():
                raise UserError(f"--out {place}: holds a run already; go on with --resume, or choose another folder")
            return place, setting, config, steps or STEPS, {}

        place, setting, config, total, begun = ranks.from_first(begin)
        usv = begun.get("usv", usv)
        typer.echo("compiling the world …")
        mine = ranks.share(config.num_worlds)
        batch = config.num_worlds if ranks.count > 1 else None
        world = World(setting, mine.stop - mine.start, config.seed, usv, first_world=mine.start, batch=batch, arch=arch)
        name, baseline, evaluate = policies.default(setting), {}, None
        if ranks.leads:
            evaluation_worlds = World(
                setting, EVALUATION_EPISODES, config.seed + EVALUATION_SEED_OFFSET, usv, arch=arch
            )
            typer.echo(f"evaluating {name} …")
            baseline = policies.evaluate(evaluation_worlds, name) | {"policy": name}
            evaluate = partial(policies.evaluate, evaluation_worlds)
        about = provenance(begun, ranks.command) | {"usv": world.strategy.name, "total": total}
        trainer = policies.Trainer(world, config, place, evaluate, about, ranks=ranks)
        if resume:
            trainer.resume()
        if ranks.leads and total <= config.before_learning:
            typer.echo(
                f"warning: --steps {total}: nothing will be learned: the first update comes after"
                f" {config.before_learning} world-steps (warmup = {config.warmup})",
                err=True,
            )
        shown = report.training(baseline, config.algorithm, setting.name)
        with shown if ranks.leads else nullcontext(lambda figures: None) as show:
            trainer.train(total, partial(_show, show, trainer))
        if ranks.leads:
            if trainer.stopped:
                again = "".join(f" --plugin {file}" for file in plugins or ())
                typer.echo(
                    f"stopped at {trainer.steps} of {total} world-steps; go on with: --out {place} --resume{again}"
                )
            learned = max(trainer.history, key=lambda row: row["arps"])["updates"] > 0
            typer.echo(
                f"best arps {trainer.best:.3f}{'' if learned else ', of the untrained policy'}"
                f" ({name} {baseline['arps']:.3f}) in {place / 'best'}"
            )
    trainer.interruption.raise_if_asked()


def _show(show: Callable[[dict], None], trainer: Trainer, figures: dict) -> None:
    """Show figures; when nobody reads them any more, stop the run, so that it is saved."""
    try:
        show(figures)
    except Interrupted as closed:
        trainer.interruption.ask(closed.signum)
