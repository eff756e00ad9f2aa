"""`usvauv train`: train a policy, show its progress, keep the best."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usvauv.cli import terminal
from usvauv.cli.commands import options
from usvauv.kernels.errors import UserError
from usvauv.kernels.interruption import Interrupted

if TYPE_CHECKING:
    from usvauv.env import World
    from usvauv.policies import LearnedPolicy, TrainingRun

STEPS = 2_000_000
MOST_SEEDS = 1024
FOLDER = "seed-"  # and the seed: the folder of one of several runs


def train(
    scenario: options.ScenarioName = "extreme",
    algorithm: Annotated[
        str | None,
        typer.Option(help="sac, td3, ddpg or ppo; by default ppo for data in passing, tracking and fins, else sac."),
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(
            callback=options.bounded(1),
            help="Steps of all worlds together: one step of W worlds is W. Default 2000000; with --resume, as begun.",
        ),
    ] = None,
    worlds: Annotated[
        int | None,
        typer.Option(callback=options.bounded(1), help="Worlds simulated in parallel. Default 256; with ppo 128."),
    ] = None,
    seed: options.Seed = 0,
    seeds: Annotated[
        int,
        typer.Option(
            callback=options.bounded(1, MOST_SEEDS),
            help="Runs trained together that differ only in the seed: --seed and the following ones.",
        ),
    ] = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the run; default runs/SCENARIO-ALGORITHM-SEED. Several seeds: one folder each inside it."
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the run in --out with its own settings.")] = False,
    shared: Annotated[
        bool | None,
        typer.Option("--shared/--each", help="One network for all AUVs, or one each. Default each; with ppo shared."),
    ] = None,
    learn: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE", help="Change one setting of the training, such as updates=4; may be repeated."
        ),
    ] = None,
    log: Annotated[
        str, typer.Option(help="Log for the curves: tensorboard, beside the checkpoints, or wandb (extra `wandb`).")
    ] = "tensorboard",
    usv: options.Usv = None,
    targets: options.Targets = None,
    arch: options.Arch = "auto",
    overrides: options.Overrides = None,
    quiet: options.Quiet = False,
    plugins: options.Plugins = None,
) -> None:
    """Train a policy with SAC, TD3, DDPG or PPO and keep its best and last checkpoint, with curves for TensorBoard
    beside them or in Weights & Biases.

    An untrained network steers much like a heuristic, most often `clear`. The policy is evaluated before training and
    three to ten times during it, in other worlds, against the scenario's default heuristic: its margin is shown with a
    95 % interval. Ctrl-C ends the run cleanly; `--resume` continues it.

    **Examples:**

    `usvauv train`

    `usvauv train ideal --algorithm td3 --steps 500000 --out runs/first`

    `usvauv train --shared --learn hidden=128,128 --learn updates=4 --set reward.power=-0.006`

    `usvauv train --out runs/first --resume --steps 1000000`

    `usvauv train ideal --seeds 8 --out runs/eight`
    """
    setting = options.scenario_of(scenario, overrides, quiet=quiet).with_targets(targets)

    from usvauv import policies
    from usvauv.cli.commands import training_table
    from usvauv.cli.commands.training_curve import curve
    from usvauv.env import World
    from usvauv.env.record.metrics import mean_figures
    from usvauv.env.storage.files import inside, locked
    from usvauv.env.world.strategy_choice import StrategyChoice
    from usvauv.kernels import runtime
    from usvauv.policies.checkpoint import LAST, clean, path_of, provenance
    from usvauv.policies.inputs import changed, digests
    from usvauv.policies.names import default_heuristic
    from usvauv.policies.training.figures import EVALUATION_EPISODES, EVALUATION_SEED_OFFSET
    from usvauv.policies.training.meter import check_log

    with ExitStack() as stack:
        check_log(log)
        if resume and seeds != 1:
            raise UserError("--seeds: a resumed run keeps the seeds it was begun with")
        kept = {"--set": overrides, "--learn": learn, "--usv": usv, "--targets": targets}
        kept |= {"--worlds": worlds, "--shared": shared}
        if resume and (given := ", ".join(name for name, value in kept.items() if value or value is False)):
            raise UserError(f"{given}: a resumed run keeps the scenario and settings it was begun with")
        options.check_regime(setting)
        StrategyChoice.parse(usv, setting)
        config = policies.TrainingConfig.of(setting, algorithm=algorithm, num_worlds=worlds, seed=seed, shared=shared)
        config = config.changed(learn or ())
        last = seed + seeds - 1
        replace(config, seed=last)  # refuses one that is too large
        name = f"{setting.name}-{config.algorithm}-{seed if seeds == 1 else f'{seed}-to-{last}'}"
        place = out or Path("runs") / name
        if not resume:
            options.make_folder(place)
        elif not place.is_dir():
            raise UserError(f"--out {place}: there is no run to resume")
        stack.enter_context(locked(place))
        clean(place)
        folders = _folders(place)
        if not resume:
            if any(path_of(folder, LAST).exists() for folder in (place, *folders.values())):
                raise UserError(
                    f"--out {place}: holds a run already; continue it with --resume, or choose another folder"
                )
            folders = {own: place / f"{FOLDER}{own}" for own in range(seed, last + 1)} if seeds > 1 else {}
        for folder in folders.values():
            options.make_folder(inside(place, folder))
            stack.enter_context(locked(folder))
            clean(folder)
        folders = folders or {seed: place}
        stack.enter_context(_telling_what_is_lost(place, [path_of(folder, LAST) for folder in folders.values()]))
        saved = [folder for folder in folders.values() if path_of(folder, LAST).exists()]
        found = {folder: policies.read_run(folder) for folder in saved or (folders.values() if resume else ())}
        setting, config, begun = next(iter(found.values()), (setting, config, {}))
        for own, folder in folders.items():  # one that a killed process had not saved yet begins as the others did
            found.setdefault(folder, (setting, replace(config, seed=own), {}))
        boats, total = begun.get("usv", usv), steps or begun.get("total", STEPS)
        options.preparing(setting, arch, quiet)
        runs: list[TrainingRun] = []
        files = digests([setting])
        for folder, (setting, config, begun) in found.items():
            if different := changed(begun, files):
                typer.echo(
                    f"warning: {', '.join(different)}: changed since {folder} was saved; the run continues with what is"
                    " there now, and its result is of both; another --out begins anew",
                    err=True,
                )
            world = World(setting, config.num_worlds, config.seed, boats, arch=arch)
            about = provenance(begun, files) | {"usv": world.strategy.name, "total": total}
            runs.append(policies.TrainingRun(world, config, folder, provenance=about))
            if begun:
                policies.resume(runs[-1])
        if (done := min(run.steps for run in runs)) >= total:
            typer.echo(f"nothing to do: {done} of {total} world-steps are done; a larger --steps continues the run")
            return
        several, first, config = place not in found, runs[0], runs[0].config
        trainer = policies.Trainer(*runs, log=log, threads=runtime.start(arch).threads)
        name = default_heuristic(setting)
        if not quiet:
            typer.echo(f"evaluating {name} …")
        baselines = []
        for run in runs:
            judged_in = run.config.seed + EVALUATION_SEED_OFFSET
            evaluation_worlds = World(setting, EVALUATION_EPISODES, judged_in, boats, arch=arch)
            rows = policies.evaluated(evaluation_worlds, name)
            baselines.append(mean_figures(rows))
            run.evaluate = partial(_beside, evaluation_worlds, [row.arps for row in rows])
        baseline = training_table.mean_of(baselines) | {"policy": name, "start": first.frame.start}
        if total <= config.before_learning:
            typer.echo(
                f"warning: --steps {total}: nothing will be learned: the first update comes after"
                f" {config.before_learning} world-steps",
                err=True,
            )
        elif config.frame == "guided" and not setting.auv.dynamic and not quiet:
            typer.echo(
                f"AUVs that are points gain little over {first.frame.start}, where training begins; from"
                " --learn frame=target it begins far below and rises towards it"
            )
        title = setting.name
        if several:
            title += f", seeds {', '.join(str(run.config.seed) for run in runs)}"
        shown_by = training_table.training(baseline, config.algorithm, title)
        with nullcontext(lambda *figures: None) if quiet else shown_by as show:

            def watch(figures: list[dict]) -> None:
                try:
                    show(training_table.of_seeds(figures), _evaluations(runs))
                except Interrupted as closed:  # the reader of standard output has gone
                    trainer.interruption.ask(closed.signum)

            trainer.train(total, watch)
        if trainer.stopped:
            again = "".join(f" --plugin {file}" for file in plugins or ())
            done = min(run.steps for run in runs)
            typer.echo(f"stopped at {done} of {total} world-steps; continue with: --out {place} --resume{again}")
        bests = [run.kept for run in runs]
        learned = all(best["updates"] > 0 for best in bests)
        shown = training_table.evaluation(training_table.of_seeds([{"evaluation": best} for best in bests]), name)
        told = f"best policy{'' if learned else ', the untrained one'}: {shown}"
        where = place / f"{FOLDER}*" if several else place
        typer.echo(terminal.wrapped(f"{told}, in {where}/best.safetensors", 2))
        for line in curve(_evaluations(runs), name):
            typer.echo(line)
        if learned:  # the best of several evaluations in the same episodes
            own = place / f"{FOLDER}{config.seed}" if several else place
            typer.echo(f"compare them in other episodes: usvauv eval {setting.name} --policy {own} --policy {name}")
    trainer.interruption.raise_if_asked()


@contextmanager
def _telling_what_is_lost(place: Path, states: Sequence[Path]) -> Iterator[None]:
    """Say, where Ctrl-C comes before any of the states is saved, that there is nothing to resume."""
    try:
        yield
    except KeyboardInterrupt:
        if not any(state.exists() for state in states):
            typer.echo(f"stopped before training; nothing in {place} to resume: the same command begins anew")
        raise


def _folders(out: Path) -> dict[int, Path]:
    """The folders of several seeds' runs in `out`, by seed."""
    found = {path.name.removeprefix(FOLDER): path for path in out.glob(f"{FOLDER}*") if path.is_dir()}
    seeds = (seed for seed in found if seed.isascii() and seed.isdecimal())
    return {int(seed): found[seed] for seed in sorted(seeds, key=int)}


def _evaluations(runs: Sequence[TrainingRun]) -> list[dict]:
    """All evaluations so far, those of several runs as one."""
    from usvauv.cli.commands.training_table import of_seeds

    each = zip(*(run.history for run in runs), strict=False)
    return [of_seeds([{"evaluation": row} for row in rows])["evaluation"] for rows in each]


def _beside(worlds: World, baseline: Sequence[float], policy: LearnedPolicy) -> dict[str, float]:
    """Figures of a policy in an evaluation, with its margin in ARPS over those of a baseline in the same episodes, and
    half of the margin's 95 % interval where there is one."""
    from usvauv import policies
    from usvauv.cli.evaluation.comparison import interval
    from usvauv.env.record.metrics import mean_figures

    rows = policies.evaluated(worlds, policy)
    margins = [row.arps - score for row, score in zip(rows, baseline, strict=True)]
    mean, half, _ = interval(margins, worlds.scenario.random_seas)
    return mean_figures(rows) | {"margin": mean} | ({"margin_half": half} if math.isfinite(half) else {})
