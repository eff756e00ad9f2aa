"""What a run of a study costs, how many runs an hour workers of this machine do, and what many machines would do.

    python -m benchmarks.scale
    python -m benchmarks.scale --jobs 1 2 4

The run is `usvauv train extreme` as it is by default: SAC, 256 worlds, 2 million world-steps. Its pieces are timed on
one core, best of several times; the whole is their sum. What many cores and cards would do is computed from it and from
figures of network and disk that are assumed, and printed with it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from benchmarks.machine import best_time, command_line, describe
from usvauv import policies
from usvauv.cli.commands.train import STEPS
from usvauv.cli.sweep.engine import Engine, Local, Signs, Task, conduct, signs_in
from usvauv.cli.sweep.perform import OnRay
from usvauv.cli.sweep.study import Resources
from usvauv.env import Scenario, World
from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError
from usvauv.policies import TrainingConfig
from usvauv.policies.training.figures import EVALUATION_EPISODES, EVALUATION_SEED_OFFSET
from usvauv.policies.training.saving import save
from usvauv.policies.training.trainer import SeedStack, usual_evaluations

ROOT = Path(__file__).parents[1]
SCENARIO = "extreme"
IMPORTS = "import usvauv.env; from usvauv import policies"
FIRST_STEP = (
    f"import time; {IMPORTS}; begun = time.perf_counter(); from usvauv.env import Scenario, World;"
    f"world = World(Scenario.load('{SCENARIO}'), 4, 0); observation = world.reset();"
    "world.step(policies.load('clear', world).act(observation)); print(time.perf_counter() - begun)"
)
TASKS = 200  # that do nothing
DISK = 1e9  # bytes a second of a shared file system, assumed
LATENCY, LINK = 30e-6, 50e9  # s of an exchange between cards and bytes a second of a link, assumed
STUDY = """
[common]
scenario = "extreme"
policy = "clear"
seed = [0, 1, 2, 3, 4, 5, 6, 7]
[[runs]]
[evaluation]
episodes = 64
[resources]
memory = 1.0
"""


@dataclass(frozen=True)
class Costs:
    """Seconds of the pieces of a run; bytes of a checkpoint and of an update's gradients, and their number of parts."""

    start: float
    compiling: float
    cached: float
    step: float
    update: float
    together: float
    evaluation: float
    save: float
    bytes: int
    gradients: int
    exchanges: int

    @property
    def whole(self) -> float:
        """Seconds of a run whose kernels another one has compiled."""
        steps = STEPS / TrainingConfig().num_worlds
        return self.start + self.cached + steps * self.together + evaluations() * (self.evaluation + self.save)


def evaluations() -> int:
    """Evaluations of a run, with the first."""
    return usual_evaluations(STEPS) + 1


def child(code: str, **variables: str) -> tuple[float, str]:
    """Seconds of a process of Python's, and what it printed last."""
    begun = time.perf_counter()
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, **variables}, capture_output=True, text=True, check=True
    )
    return time.perf_counter() - begun, (done.stdout.splitlines() or [""])[-1]


def costs() -> Costs:
    """Time all pieces."""
    torch.set_num_threads(1)
    scenario, config = Scenario.load(SCENARIO), TrainingConfig()
    world = World(scenario, config.num_worlds, config.seed)
    judges = World(scenario, EVALUATION_EPISODES, config.seed + EVALUATION_SEED_OFFSET)
    with TemporaryDirectory() as folder:
        run = policies.TrainingRun(world, config, Path(folder))
        policies.Trainer(run).train(config.before_learning + 20 * config.num_worlds)
        batch = partial(run.replay.sample, config.batch, config.n_step, config.gamma, [run.generator])
        action = torch.zeros(config.num_worlds, world.num_auvs, 2, device=world.device)

        def episode() -> None:
            world.reset()
            for _ in range(world.steps):
                world.step(action)

        policy, optimisers = run.policy(), run.learner.optimisers.values()
        with ThreadPoolExecutor(1) as pool:
            together = best_time(partial(SeedStack([run]).step, pool, STEPS))
        return Costs(
            start=min(child(IMPORTS)[0] for _ in range(3)),
            compiling=float(child(FIRST_STEP, TI_OFFLINE_CACHE_FILE_PATH=str(Path(folder, "cache")))[1]),
            cached=min(float(child(FIRST_STEP)[1]) for _ in range(3)),
            step=best_time(episode) / world.steps,
            update=best_time(lambda: run.learner.learn(batch(run.scale * run.gain))),
            together=together,
            evaluation=best_time(lambda: policies.figures_of_merit(judges, policy), rounds=1),
            save=best_time(lambda: save(run)),
            bytes=Path(folder, "last.safetensors").stat().st_size,
            gradients=sum(4 * value.numel() for each in optimisers for value in each.parameters),
            exchanges=len(optimisers),
        )


def nothing(signs: Signs) -> None:
    """A piece of work that is done at once."""


def dispatch(engine: Engine) -> float:
    """Seconds that an engine takes for a task which does nothing, once its processes have begun."""
    ends: list[float] = []
    with TemporaryDirectory() as folder, signs_in(Path(folder)) as signs:
        tasks = [Task(f"{number}", nothing, signs, 1, "cpu") for number in range(TASKS)]
        conduct(engine, tasks, signs, lambda ended: ends.append(time.perf_counter()))
    return (ends[-1] - ends[TASKS // 2]) / (TASKS - 1 - TASKS // 2)


def engines() -> dict[str, float]:
    """Seconds a task of each engine that is there."""
    found = {"processes of this machine": dispatch(Local(2, 1))}
    with suppress(UserError):  # Ray is not installed
        found["Ray on this machine"] = dispatch(OnRay("local", 2, Resources(memory=0.5)))
    return found


def runs_an_hour(jobs: int) -> float:
    """Runs an hour of a study of eight evaluations with so many workers; kernels are compiled."""
    with TemporaryDirectory() as folder:
        study = Path(folder, "study.toml")
        study.write_text(STUDY, encoding="utf-8")
        command = ["-m", "usvauv.cli", "sweep", str(study), "--jobs", str(jobs), "--out", str(Path(folder, "out"))]
        begun = time.perf_counter()
        subprocess.run([sys.executable, *command], cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
        return 8 * 3600 / (time.perf_counter() - begun)


def on_paper(found: Costs, overheads: dict[str, float]) -> None:
    """Print what follows for 1,000 cores and 8 cards."""
    whole, written = found.whole, evaluations() * found.bytes
    print(f"\na run on one core: {whole:.0f} s; 1,000 cores: {3.6e6 / whole:,.0f} runs per hour")
    for name, overhead in overheads.items():
        print(f"{name}: one process that dispatches runs supplies {whole / overhead:,.0f} cores")
    print(f"checkpoints, {DISK / 1e9:g} GB/s assumed: {DISK * whole / written:,.0f} cores fill the file system")
    bucket = found.gradients * 2 * 7 / 8 / LINK
    exchange = found.exchanges * LATENCY + bucket
    print(
        f"8 cards, {LATENCY * 1e6:g} µs an exchange and {LINK / 1e9:g} GB/s assumed: {found.gradients:,} bytes of an"
        f" update take {exchange * 1e6:.0f} µs, {bucket * 1e6:.0f} of them for the bytes; an update that takes a card"
        f" less than {exchange * 9e3:.1f} ms loses more than a tenth by that"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line(__doc__)
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2], help="workers of the study of evaluations")
    chosen = parser.parse_args(arguments)
    runtime.start("cpu", threads=1)
    print(describe())
    found = costs()
    rows = {
        "start: imports": f"{found.start:.2f} s",
        "first step, kernels compiled": f"{found.compiling:.2f} s",
        "first step, kernels in Taichi's cache": f"{found.cached:.2f} s",
        f"step of {TrainingConfig().num_worlds} worlds": f"{found.step * 1e3:.1f} ms",
        "update": f"{found.update * 1e3:.1f} ms",
        "step with its updates": f"{found.together * 1e3:.1f} ms",
        "evaluation": f"{found.evaluation:.2f} s",
        "checkpoint": f"{found.save * 1e3:.0f} ms, {found.bytes / 1e6:.1f} MB",
    }
    overheads = engines()
    rows |= {f"dispatch of a run, {name}": f"{overhead * 1e3:.1f} ms" for name, overhead in overheads.items()}
    print("| piece, one core | cost |\n| --- | --- |")
    print("\n".join(f"| {name} | {cost} |" for name, cost in rows.items()))
    print("\n| workers | runs per hour: 64 episodes of `clear` each |\n| --- | --- |")
    for jobs in chosen.jobs:
        print(f"| {jobs} | {runs_an_hour(jobs):.0f} |", flush=True)
    on_paper(found, overheads)


if __name__ == "__main__":
    main()
