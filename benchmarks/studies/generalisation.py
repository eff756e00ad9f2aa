"""Generalisation of learned policies to other conditions, and the effect of each part of the framework.

    python -m benchmarks.studies.generalisation --out runs/generalisation

Trains SAC with shared parameters and default settings under each of `TRAINED`, and tests what each run ends with under
`TESTED`, in the same worlds as `clear`. Runs that are in the folder go on where they were saved last. Cells are the
mean of arps less that of `clear`, with the 95 % interval of the paired difference, and the data collected as a share of
that of `clear`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.machine import describe
from benchmarks.studies.table import figure, head, interval, line
from usvauv import policies
from usvauv.cli.sweep.engine import Local
from usvauv.cli.sweep.perform import perform_all
from usvauv.cli.sweep.run_folder import Piece
from usvauv.cli.sweep.study import Evaluation, StudyRun, define
from usvauv.env import EpisodeMetrics, Scenario, run_episodes
from usvauv.env.storage.files import locked
from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError

PROFILE = "observation.current=profile"
TRAINED = {
    "ideal": ("ideal", (PROFILE,)),
    "extreme": ("extreme", ()),
    "random currents": ("extreme", ("current.circulation_min=0", "current.circulation_max=390")),
    "no current observed": ("extreme", ("observation.current=none",)),
    "no reward for nearness": ("extreme", ("reward.collaboration=0",)),
}
HEURISTICS = ("pace", "straight")
FIGURES = ("arps", "delivered_mbit", "energy_wh", "joule_per_mbit", "position_error_median")
MATRIX = ("ideal", "extreme", "random currents")
STRONG = ("current.circulation_min=260", "current.circulation_max=390")
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
    "complete": ("extreme", "extreme", (), "fim"),
    "no current observed (Eq. 4)": ("no current observed", "extreme", ("observation.current=none",), "fim"),
    "no reward for nearness (Eq. 5)": ("no reward for nearness", "extreme", (), "fim"),
    "boat held at (100, 100)": ("extreme", "extreme", (), "hold:100,100"),
    "boat held at (0, 0)": ("extreme", "extreme", (), "hold:0,0"),
    "no dead reckoning": ("extreme", "extreme", ("navigation.sensor=none",), "fim"),
}


def train(steps: int, folder: Path, jobs: int) -> dict[str, Path]:
    """Train what is not finished already, `jobs` at a time; returns the last checkpoint of each."""
    learned = partial(StudyRun, algorithm="sac", worlds=128, shared=True, learn=("batch=512",), seed=1)
    runs = {
        name: learned(name=name, scenario=base, set=changes, steps=steps) for name, (base, changes) in TRAINED.items()
    }
    pieces = {
        name: Piece(definition=define(run, Evaluation(episodes=1), name), method=name, task=run.scenario)
        for name, run in runs.items()
    }
    folder.mkdir(parents=True, exist_ok=True)
    threads = max(1, runtime.available_cores() // jobs)
    with locked(folder):
        if failure := perform_all(list(pieces.values()), folder, lambda: Local(jobs, threads), threads, "auto"):
            raise UserError(failure)
    return {name: piece.place(folder) / "last.safetensors" for name, piece in pieces.items()}


def test(name: str | Path, test_in: tuple[str, Sequence[str], str], episodes: int, seed: int) -> list[EpisodeMetrics]:
    """Episodes of a policy under a base scenario, its changes and a strategy of the boat."""
    base, changes, usv = test_in
    return run_episodes(Scenario.load(base, changes), policies.named(str(name)), episodes=episodes, seed=seed, usv=usv)


def cell(rows: list[EpisodeMetrics], against: list[EpisodeMetrics]) -> str:
    share = figure(rows, "delivered_mbit").sum() / figure(against, "delivered_mbit").sum()
    return f"{interval(figure(rows, 'arps') - figure(against, 'arps'), 2)}, {100 * share:.0f} %"


def matrix(places: dict[str, Path], episodes: int, seed: int) -> None:
    head(["", *(f"trained in {name}" for name in MATRIX), *(f"`{name}`" for name in HEURISTICS)])
    for condition, where in TESTED.items():
        against = test("clear", where, episodes, seed)
        names = [*(places[name] for name in MATRIX), *HEURISTICS]
        line([condition, *(cell(test(name, where, episodes, seed), against) for name in names)])


def ablations(places: dict[str, Path], episodes: int, seed: int) -> None:
    head(["", *FIGURES])
    for name, (trained, *where) in ABLATIONS.items():
        rows = test(places[trained], tuple(where), episodes, seed)
        line([name, *(interval(figure(rows, each), 2) for each in FIGURES)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the training runs")
    parser.add_argument("--steps", type=int, default=400_000, help="world-steps of a training run")
    parser.add_argument("--jobs", type=int, default=runtime.available_cores(), help="runs trained at a time")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    arguments = parser.parse_args()
    places = train(arguments.steps, arguments.out, arguments.jobs)
    print(f"{describe()}; {arguments.episodes} episodes a cell, seed {arguments.seed}\n")
    matrix(places, arguments.episodes, arguments.seed)
    print()
    ablations(places, arguments.episodes, arguments.seed)


if __name__ == "__main__":
    main()
