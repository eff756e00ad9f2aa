"""How long training of several seeds together takes, over that of one.

    python -m benchmarks.seeds --seeds 8
    python -m benchmarks.seeds --seeds 8 --learn batch=64

The scenario is `extreme`, all settings but those of `--learn` are the defaults of `usvauv train`; without evaluations.
Runs of one seed and of all take turns with the same number of updates, so that both meet what else the machine does.
Printed are for each pair the ratio of the times, and that of the processor's times, which depends less on other work.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from benchmarks.machine import command_line, describe
from usvauv.env import Scenario, World
from usvauv.kernels import runtime
from usvauv.policies import Trainer, TrainingConfig, TrainingRun

SCENARIO = "extreme"


def clocks() -> tuple[float, float]:
    """Time and processor time, s."""
    return time.perf_counter(), time.process_time()


def piece(trainer: Trainer, updates: int) -> tuple[float, float]:
    """Train another piece; time and processor time between its first report and its last, s.

    Args:
        updates: steps of all worlds in a piece, a multiple of those between two reports.
    """
    marks: list[tuple[float, float]] = []
    first = trainer.runs[0]
    trainer.train(first.steps + updates * first.config.num_worlds, lambda figures: marks.append(clocks()))
    return marks[-1][0] - marks[0][0], marks[-1][1] - marks[0][1]


def measure(config: TrainingConfig, seeds: int, pairs: int, updates: int) -> list[tuple[float, float]]:
    """For each pair the ratios of times and of processor times."""
    scenario, place = Scenario.load(SCENARIO), runtime.start()
    trainers = []
    for count in (1, seeds):
        own = [replace(config, seed=seed) for seed in range(count)]
        runs = [TrainingRun(World(scenario, each.num_worlds, each.seed), each) for each in own]
        trainers.append(Trainer(*runs, threads=place.threads if place.torch_on_host else 1))
        trainers[-1].train(config.before_learning + config.num_worlds)
    found = []
    for _ in range(pairs):
        (alone, alone_busy), (together, together_busy) = (piece(trainer, updates) for trainer in trainers)
        found.append((together / alone, together_busy / alone_busy))
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    parser = command_line(__doc__)
    parser.add_argument("--seeds", type=int, default=8, help="runs trained together")
    parser.add_argument("--pairs", type=int, default=5, help="how often each is timed")
    parser.add_argument("--updates", type=int, default=300, help="in one piece, at least 200")
    parser.add_argument("--learn", action="append", default=[], metavar="NAME=VALUE", help="as of usvauv train")
    asked = parser.parse_args(arguments)
    config = TrainingConfig(warmup=2000).changed(asked.learn)
    print(describe())
    found = measure(config, asked.seeds, asked.pairs, asked.updates)
    for ratio, busy in found:
        print(f"{asked.seeds} seeds take {ratio:.2f} × the time of one, {busy:.2f} × the processor's time")
    print(f"least: {min(ratio for ratio, _ in found):.2f} ×, {min(busy for _, busy in found):.2f} ×")


if __name__ == "__main__":
    main()
