"""Soak: a week of simulated time in one mission, a week of missions of a quarter of an hour, and an hour of training.

    python -m tests.trials.soak --seconds 604800 --minutes 60 --seed 1

Every `SAMPLES`-th part of the way are noted: the speed, the resident memory, the open files, and the largest amount of
each quantity of the state. Printed are the medians of the first and of the last third. A quantity that is not finite, a
median of memory or files in the last third above the first's by more than `GROWTH`, or a speed below the first's by
more than `SLOWING`, ends the trial with exit code 1.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn

SAMPLES = 60
GROWTH = {"memory MiB": 0.02, "open files": 0.0}  # share
SLOWING = 0.25
EPISODE = 900  # steps

Sample = dict[str, float]


def resources(done: int, since: float) -> Sample:
    """What the process holds, and how many steps a second it did since a moment."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return {
        "steps/s": done / (time.perf_counter() - since),
        "memory MiB": pages * resource.getpagesize() / 2**20,
        "open files": len(os.listdir("/proc/self/fd")),
    }


def quantities(world: World) -> Sample:
    """Largest amounts of the state's quantities."""
    auv, boat = world.auv, world.boat
    return {
        "power W": float(auv[..., AuvColumn.power].max()),
        "current m/s": float(world.current().norm(dim=-1).max()),
        "position error m": float(auv[..., AuvColumn.position_error].max()),
        "elevation m": float(boat[..., BoatColumn.elevation].abs().max()),
        "level of the sea m": float(np.abs(world.sea.elevation()).max()),
        "reward": float(world.reward.abs().max()),
        "outside m": float(max(-auv[..., :2].min(), auv[..., :2].max() - world.scenario.area.width, 0.0)),
        "not finite": float(
            sum((~torch.isfinite(getattr(world, name))).sum() for name in ("auv", "boat", "observation"))
        ),
    }


def missions(seconds: int, episode: int, seed: int) -> Iterator[Sample]:
    """Steps of one world that heads for its targets, in episodes of a length (steps)."""
    world = World(Scenario.load("extreme", [f"mission.duration={episode}"]), 1, seed)
    observation = world.reset()
    policy = policies.load("crab", world)
    since, done = time.perf_counter(), 0
    for step in range(1, seconds + 1):
        observation, *_, truncated, _ = world.step(policy.act(observation))
        if truncated[0, 0]:
            observation = world.reset()
        if step * SAMPLES // seconds > (step - 1) * SAMPLES // seconds:
            yield resources(step - done, since) | quantities(world)
            since, done = time.perf_counter(), step


def training(minutes: float, seed: int) -> list[Sample]:
    """Training of the default algorithm in 256 worlds of `extreme`, with a checkpoint about every half minute."""
    world = World(Scenario.load("extreme"), 256, seed)
    samples: list[Sample] = []
    with tempfile.TemporaryDirectory() as folder:
        run = policies.TrainingRun(world, policies.TrainingConfig(num_worlds=256, seed=seed), folder)
        trainer = policies.Trainer(run, evaluations=4000)
        end, since, before = time.monotonic() + 60 * minutes, time.perf_counter(), 0

        def note(figures: list[dict]) -> None:
            nonlocal since, before
            if time.perf_counter() - since > 60 * minutes / SAMPLES:
                parameters = [float(p.detach().abs().max()) for p in run.learner.actor.weights]
                samples.append(resources(run.steps - before, since) | quantities(world) | {"weight": max(parameters)})
                since, before = time.perf_counter(), run.steps
            if time.monotonic() > end:
                trainer.stop()

        trainer.train(10**9, note)
    return samples


def judged(title: str, samples: list[Sample]) -> bool:
    """Print the medians of the first and the last third; whether all is as it should be."""
    third = len(samples) // 3
    print(f"\n{title}: {len(samples)} samples\n{'':24}{'first third':>14}{'last third':>14}{'largest':>14}")
    good = bool(samples)
    for name in samples[0]:
        values = [sample[name] for sample in samples]
        first, last = np.median(values[:third]), np.median(values[-third:])
        wrong = not np.isfinite(values).all() or (name in ("not finite", "outside m") and max(values) > 0)
        wrong = wrong or (name in GROWTH and last > first * (1 + GROWTH[name]))
        wrong = wrong or (name == "steps/s" and last < first * (1 - SLOWING))
        print(f"{name:24}{first:14.6g}{last:14.6g}{max(values):14.6g}{'  !' if wrong else ''}", flush=True)
        good = good and not wrong
    return good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=int, default=604800, help="simulated time of each of the two missions, s")
    parser.add_argument("--minutes", type=float, default=60.0, help="training, 0: none")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    long = list(missions(chosen.seconds, chosen.seconds, chosen.seed))
    good = judged(f"one mission of {chosen.seconds} s", long)
    short = list(missions(chosen.seconds, EPISODE, chosen.seed))
    good = judged(f"missions of {EPISODE} s, {chosen.seconds} s in all", short) and good
    if chosen.minutes:
        good = judged(f"training, {chosen.minutes:g} min", training(chosen.minutes, chosen.seed)) and good
    sys.exit(not good)


if __name__ == "__main__":
    main()
