"""Generalisation of learned policies to other conditions, and the effect of each part of the framework.

    python -m benchmarks.studies.generalisation --out runs/generalisation

Trains SAC with shared parameters and default settings under each of `TRAINED`, keeps the best of each run as `usvauv
train` does, and tests each under `TESTED`, in the same worlds as `straight`. Runs that are finished in the folder are
not trained again. Cells are the mean of arps less that of `straight`, with the 95 % interval of the paired difference,
and services as a share of those of `straight`.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

import numpy as np

import policies
from benchmarks.machine import describe
from policies.evaluation import EVALUATION_EPISODES, EVALUATION_SEED_OFFSET
from usvauv_env import Scenario, World
from usvauv_env.record.metrics import EpisodeMetrics, episode_metrics
from usvauv_env.record.recorder import record

PROFILE = "observation.current=profile"
TRAINED = {
    "ideal": ("ideal", (PROFILE,)),
    "extreme": ("extreme", ()),
    "random currents": ("extreme", ("current.circulation_min=0", "current.circulation_max=400")),
    "no current observed": ("extreme", ("observation.current=none",)),
    "no reward for nearness": ("extreme", ("reward.collaboration=0",)),
}
MATRIX = ("ideal", "extreme", "random currents")
STRONG = ("current.circulation_min=260", "current.circulation_max=400")
TESTED = {
    "ideal": ("ideal", (PROFILE,), "fim"),
    "extreme": ("extreme", (), "fim"),
    "random currents": (*TRAINED["random currents"], "fim"),
    "currents stronger than seen": ("extreme", STRONG, "fim"),
    "1 AUV": ("extreme", ("auv.count=1",), "fim"),
    "3 AUVs": ("extreme", ("auv.count=3",), "fim"),
    "4 AUVs": ("extreme", ("auv.count=4",), "fim"),
    "8 AUVs": ("extreme", ("auv.count=8",), "fim"),
    "10 nodes": ("extreme", ("nodes.count=10",), "fim"),
    "100 nodes": ("extreme", ("nodes.count=100",), "fim"),
    "a third of the fixes lost": ("extreme", ("usbl.packet_loss=0.33",), "fim"),
}
ABLATIONS = {
    "as it is": ("extreme", "extreme", (), "fim"),
    "no current observed (Eq. 4)": ("no current observed", "extreme", ("observation.current=none",), "fim"),
    "no reward for nearness (Eq. 5)": ("no reward for nearness", "extreme", (), "fim"),
    "boat held at (100, 100)": ("extreme", "extreme", (), "hold:100,100"),
    "boat held at (0, 0)": ("extreme", "extreme", (), "hold:0,0"),
    "with the tracker": ("extreme", "extreme", ("tracker.enabled=true",), "fim"),
}


def train(name: str, steps: int, folder: Path) -> Path:
    """Train, unless the run is finished already; returns the folder of its best policy."""
    place = folder / name.replace(" ", "-")
    if not (place / "last").exists() or policies.read_run(place)[2]["steps"] < steps:
        base, changes = TRAINED[name]
        scenario = Scenario.load(base, changes)
        config = policies.TrainingConfig(shared=True, seed=1)
        world = World(scenario, config.num_worlds, config.seed)
        evaluation_worlds = World(scenario, EVALUATION_EPISODES, config.seed + EVALUATION_SEED_OFFSET)
        trainer = policies.Trainer(world, config, place, partial(policies.evaluate, evaluation_worlds))
        print(f"training: {name}", file=sys.stderr, flush=True)
        trainer.train(steps)
    return place / "best"


def test(name: str | Path, world: World) -> list[EpisodeMetrics]:
    """Figures of a policy in the first episode of every world."""
    policy = policies.load(name, world)
    world.rewind()
    return episode_metrics(record(world, policy.act, policy.name))


def cell(rows: list[EpisodeMetrics], against: list[EpisodeMetrics]) -> str:
    difference = np.array([row.arps - other.arps for row, other in zip(rows, against, strict=True)])
    services = sum(row.services for row in rows) / max(sum(row.services for row in against), 1)
    margin = 1.96 * difference.std(ddof=1) / np.sqrt(len(difference))
    return f"{difference.mean():+.2f} ± {margin:.2f}, {100 * services:.0f} %"


def row(name: str, cells: list[str]) -> None:
    print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def head(cells: list[str]) -> None:
    row("", cells)
    print("| --- " * (len(cells) + 1) + "|", flush=True)


def matrix(places: dict[str, Path], episodes: int, seed: int) -> None:
    head([f"trained in {name}" for name in MATRIX] + ["`pace`"])
    for condition, (base, changes, usv) in TESTED.items():
        scenario = Scenario.load(base, changes)
        world = World(scenario, episodes, seed, usv)
        against = test("straight", world)
        names = [*(places[name] for name in MATRIX), "pace"]
        row(condition, [cell(test(name, world), against) for name in names])


def ablations(places: dict[str, Path], episodes: int, seed: int) -> None:
    head(["arps", "SDR, Mbit/s", "EC, W", "median position error, m"])
    for name, (trained, base, changes, usv) in ABLATIONS.items():
        scenario = Scenario.load(base, changes)
        rows = test(places[trained], World(scenario, episodes, seed, usv))
        cells = []
        for figure in ("arps", "sdr", "ec", "position_error_median"):
            values = np.array([getattr(each, figure) for each in rows])
            cells.append(f"{values.mean():.2f} ± {1.96 * values.std(ddof=1) / np.sqrt(len(values)):.2f}")
        row(name, cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the training runs")
    parser.add_argument("--steps", type=int, default=400_000, help="world-steps of a training run")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    arguments = parser.parse_args()
    places = {name: train(name, arguments.steps, arguments.out) for name in TRAINED}
    print(f"{describe()}; {arguments.episodes} episodes a cell, seed {arguments.seed}\n")
    matrix(places, arguments.episodes, arguments.seed)
    print()
    ablations(places, arguments.episodes, arguments.seed)


if __name__ == "__main__":
    main()
