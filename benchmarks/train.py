"""Seconds of training until a policy reaches two targets in `extreme`: our trainer beside Stable-Baselines3's SAC.

    python -m benchmarks.train --json

The targets are values of arps, the mean of 32 episodes in worlds that are not trained in: 95 % of the way from `random`
to `straight` at its best speed, and `straight` itself. A target is reached where two evaluations in a row, after the
first gradient update, are at or above it; the first of the two gives seconds, updates, world-steps, agent-steps, and
the processor seconds of all threads of this process, on which other programs have little effect ("cpu_seconds").
Evaluations of all learners come after the same times of training, at least `SPACING` and `GROWTH` of the time so far
apart; their own time, imports, compilation of kernels and construction of worlds are not counted. The evaluation at 0 s
is the untrained policy's.

"ours" is `usvauv train`, "ours_shared" the same with one network for all AUVs; both use the guided frame, whose
autopilot makes an untrained policy a good heuristic. "ours_target_frame" is shared and without autopilot; its course is
relative to the target's bearing, so an untrained policy heads for the target. "ours_world_axes" has neither.
Stable-Baselines3 learns one policy for all AUVs through the adapter `usvauv.env.interfaces.sb3_env`:
"sb3_defaults" in 4 worlds (8 environments) with all its defaults, "sb3_tuned" in as many worlds as ours and with our
settings wherever it has them (batch, learning rate, n-step returns, sizes of networks, updates, exploration before
learning), "sb3_tuned_our_frame" the same with our features and actions. torch uses one thread, kernels all.

A run that does not reach both targets within `--limit` seconds ends there; a ratio to it is then marked as a lower
bound. Progress goes to stderr; Ctrl-C ends the benchmark with the finished runs. With all defaults it takes some 40
minutes a seed.
"""

from __future__ import annotations

import importlib
import math
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import torch

from benchmarks.machine import command_line, describe, show
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.policies.algorithms import algorithms
from usvauv.policies.training.meter import Meter

SCENARIO = "extreme"
EPISODES = 32
EVALUATION_SEED = 1_000_003  # none of the training seeds
SPACING, GROWTH = 1.0, 0.05  # between two evaluations: seconds, and share of the time so far
TARGET_SHARE = 0.95  # of the way from `random` to `straight`
COSTS = ("seconds", "cpu_seconds", "updates", "world_steps", "agent_steps")
SB3_VARIANTS = ("sb3_defaults", "sb3_tuned", "sb3_tuned_our_frame")

Act = Callable[[torch.Tensor], torch.Tensor]


class Evaluator:
    """arps of a policy, in the same `EPISODES` episodes for all."""

    def __init__(self) -> None:
        self.world = World(Scenario.load(SCENARIO), EPISODES, EVALUATION_SEED)

    def __call__(self, act: Act) -> float:
        world, meter = self.world, Meter(self.world)
        world.rewind()
        observation = world.reset()
        for _ in range(world.steps):
            observation, _, _, _, info = world.step(act(observation))
            meter.add(info)
        return meter.figures()["arps"]

    def score(self, name: str) -> float:
        """arps of a policy by name."""
        return self(policies.load(name, self.world).act)


class Course:
    """One training run: a clock that stops during evaluations, and their results.

    Args:
        name: shown with the progress.
        evaluator: gives the arps of a policy.
        targets: arps to pass, by name.
        limit: seconds of training after which the run ends.
    """

    def __init__(self, name: str, evaluator: Evaluator, targets: dict[str, float], limit: float) -> None:
        self.name, self.evaluator, self.targets, self.limit = name, evaluator, targets, limit
        self.looks: list[dict[str, float]] = []
        self._spent = [0.0, 0.0]  # wall and CPU seconds until the last evaluation
        self._since = self._clocks()

    @staticmethod
    def _clocks() -> tuple[float, float]:
        return time.perf_counter(), time.process_time()

    def look(self, act: Act, updates: int, world_steps: int) -> bool:
        """Evaluate if one is due; returns whether the run is over."""
        spent = self._spent
        if self.looks:
            spent = [done + now - since for done, now, since in zip(spent, self._clocks(), self._since, strict=True)]
            pause = max(SPACING, GROWTH * spent[0])
            if spent[0] - self._spent[0] < pause and spent[0] < self.limit:
                return False
        self._spent = spent
        arps = self.evaluator(act)
        self.looks.append(
            {
                "seconds": spent[0],
                "cpu_seconds": spent[1],
                "updates": updates,
                "world_steps": world_steps,
                "agent_steps": world_steps * self.evaluator.world.num_auvs,
                "arps": arps,
            }
        )
        print(f"{self.name}: {spent[0]:.1f} s, {updates} updates, arps {arps:.3f}", file=sys.stderr, flush=True)
        self._since = self._clocks()
        return spent[0] >= self.limit or None not in self.passed().values()

    def passed(self) -> dict[str, dict[str, float] | None]:
        """For each target the evaluation that passed it."""
        learned = [look for look in self.looks if look["updates"] > 0]
        found = {}
        for name, target in self.targets.items():
            found[name] = next((one for one, two in pairwise(learned) if min(one["arps"], two["arps"]) >= target), None)
        return found


def train_ours(course: Course, config: policies.TrainingConfig) -> None:
    """Train with our trainer until the course is over."""
    run = policies.TrainingRun(World(Scenario.load(SCENARIO), config.num_worlds, config.seed), config)
    trainer, over = policies.Trainer(run), False
    course.look(run.policy().act, 0, 0)

    def look(figures: list[dict[str, Any]]) -> None:
        nonlocal over
        over = course.look(run.policy().act, run.learner.updates, run.steps)
        if over:
            trainer.stop()

    trainer.train(sys.maxsize, look)
    if not over:
        raise KeyboardInterrupt


def train_stable_baselines3(course: Course, variant: str, seed: int) -> None:
    """Train with Stable-Baselines3's SAC until the course is over."""
    model, act, num_auvs = importlib.import_module("benchmarks.stable_baselines3_sac").learner(variant, SCENARIO, seed)
    callbacks = importlib.import_module("stable_baselines3.common.callbacks")

    class Look(callbacks.BaseCallback):
        def _on_training_start(self) -> None:
            course.look(act, 0, 0)

        def _on_step(self) -> bool:
            return not course.look(act, model._n_updates, model.num_timesteps // num_auvs)

    model.learn(sys.maxsize, callback=Look())
    model.get_env().close()


def summarise(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Median and all values of each cost of each target; null where it was not reached."""
    return {
        target: {
            name: figures([math.inf if run["passed"][target] is None else run["passed"][target][name] for run in runs])
            for name in COSTS
        }
        for target in runs[0]["passed"]
    }


def figures(values: list[float]) -> dict[str, Any]:
    """Median and all, with null for infinity."""
    median = statistics.median_low(values)
    return {
        "median": median if median < math.inf else None,
        "all": [value if value < math.inf else None for value in values],
    }


def contestants(algorithm: str) -> dict[str, Callable[[Course, int], None]]:
    """The learners, by name."""
    config = policies.TrainingConfig(algorithm=algorithm)
    everyone: dict[str, Callable[[Course, int], None]] = {
        name: lambda course, seed, changes=changes: train_ours(course, replace(config, seed=seed, **changes))
        for name, changes in (
            ("ours", {}),
            ("ours_shared", {"shared": True}),
            ("ours_target_frame", {"shared": True, "frame": "target"}),
            ("ours_world_axes", {"frame": "world"}),
        )
    }
    for variant in SB3_VARIANTS:
        everyone[variant] = lambda course, seed, variant=variant: train_stable_baselines3(course, variant, seed)
    return everyone


def measure(algorithm: str, seeds: int, limit: float, only: list[str]) -> dict[str, Any]:
    """All figures."""
    machine = describe()
    evaluator = Evaluator()
    reference = {name: evaluator.score(name) for name in ("random", "straight", "crab")}
    near = reference["random"] + TARGET_SHARE * (reference["straight"] - reference["random"])
    targets = {"95_percent": near, "straight": reference["straight"]}
    everyone = {name: train for name, train in contestants(algorithm).items() if name in only}
    results: dict[str, Any] = {name: {"runs": []} for name in everyone}
    turns = [(seed, name) for seed in range(seeds) for name in everyone]
    for seed, name in turns:
        course = Course(f"{name}, seed {seed}", evaluator, targets, limit)
        try:
            everyone[name](course, seed)
        except ImportError as error:
            results[name]["reason"] = f"cannot be imported: {error}"
            continue
        except KeyboardInterrupt:
            print("stopped: only finished runs are counted", file=sys.stderr)
            break
        untrained = course.looks[0]["arps"]
        run = {"seed": seed, "untrained_arps": untrained, "passed": course.passed(), "looks": course.looks}
        results[name]["runs"].append(run)
    for result in results.values():
        if result["runs"]:
            result |= summarise(result["runs"])
    return {
        "machine": machine,
        "algorithm": algorithm,
        "limit_seconds": limit,
        "reference_arps": reference,
        "targets": targets,
        "learners": results,
        "ratios": ratios(results, targets, limit),
    }


def ratios(results: dict[str, Any], targets: dict[str, float], limit: float) -> dict[str, dict[str, Any]]:
    """For each target and variant of Stable-Baselines3, how many times the median seconds of "ours" it took."""
    learned = {name: result for name, result in results.items() if result["runs"]}
    if "ours" not in learned:
        return {}
    return {
        target: {
            name: ratio(learned["ours"][target]["seconds"]["median"], result[target]["seconds"]["median"], limit)
            for name, result in learned.items()
            if name.startswith("sb3")
        }
        for target in targets
    }


def ratio(ours: float | None, other: float | None, limit: float) -> dict[str, Any] | None:
    """Time of the other over ours; null if ours did not reach the target, a lower bound if only the other did not."""
    if ours is None:
        return None
    return {"times": (other or limit) / ours, "lower_bound": other is None}


def main() -> None:
    parser = command_line(__doc__)
    names = list(contestants("sac"))
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--algorithm", choices=list(algorithms), default="sac", help="of ours")
    parser.add_argument("--seeds", type=int, default=3, help="runs of each learner, seeds 0, 1, …")
    parser.add_argument("--limit", type=float, default=600.0, help="training time after which a run ends, s")
    parser.add_argument("--only", nargs="+", choices=names, default=names, help="who runs", metavar="NAME")
    arguments = parser.parse_args()
    show(measure(arguments.algorithm, arguments.seeds, arguments.limit, arguments.only), arguments.json)


if __name__ == "__main__":
    main()
