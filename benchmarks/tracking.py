"""The filter of moving targets by the rules of UTracking: errors, consistency and processor time.

    python -m benchmarks.tracking
    python -m benchmarks.tracking --particles 15000 --runs 100
    python -m benchmarks.tracking --stone-soup 2000 --runs 30

AUVs circle targets at 60 m by what their own filter says (`tests/kernels/tracking/rules.py`). Errors are those after
step 20, of each target that of the AUV with the least range. `--particles` adds a bootstrap particle filter that knows
the rules. `--stone-soup` has filters of that library on the same measurements, while AUVs steer by ours: a particle
filter and an unscented Kalman filter of targets whose velocity walks at random. Processor times are medians over steps,
of one call for one filter.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import torch

from benchmarks.machine import command_line, describe, parse, show
from tests.kernels.tracking.rules import (
    LEVELS,
    Filters,
    Level,
    Outcome,
    Particles,
    finish_all,
    motion,
    observe_all,
    predict_all,
    simulate,
)
from usvauv.kernels import runtime

PAIRS = 1, 3
NAMES = {predict_all: "predict", observe_all: "observe_range", finish_all: "finish"}


class Timed(Filters):
    """Filters that note the processor time of a call of each of their functions, s."""

    def __init__(self, count: int, level: Level) -> None:
        super().__init__(count, motion(level), runtime.start().device)
        self.times: dict[str, list[float]] = {"predict": [], "observe_range": [], "finish": []}

    def call(self, kernel: Callable[..., None], calls: int, *arguments: torch.Tensor) -> None:
        before = time.process_time()
        super().call(kernel, calls, *arguments)
        self.times[NAMES[kernel]].append((time.process_time() - before) / max(calls, 1))


def figures(outcome: Outcome) -> dict[str, float]:
    """Of a simulation."""
    error = outcome.error[np.isfinite(outcome.error)]
    return {
        "median error (m)": round(float(np.median(error)), 1),
        "mean (m)": round(float(error.mean()), 1),
        "p95 (m)": round(float(np.percentile(error, 95)), 1),
        "NEES/2": round(float(np.nanmean(outcome.nees)), 2),
    }


def of_stone_soup(particles: int, level: Level, setting: dict[str, int]) -> dict[str, float]:
    """Figures of filters of Stone Soup, and the processor time of all their calls for a filter and a step."""
    from benchmarks.stone_soup import StoneSoup

    found: dict[str, float] = {}
    for name, number in (("Stone Soup's particles", particles), ("its UKF", 0)):
        before = time.process_time()
        outcome = simulate(
            lambda count, level, number=number: StoneSoup(count, level, number, seed=1),
            level,
            **setting,
            guide=lambda count, level: Filters(count, motion(level), runtime.start().device),
        )
        steps = 128 * setting["runs"] * setting["pairs"] ** 2
        found |= {f"{figure}, {name}": value for figure, value in figures(outcome).items()}
        found[f"{name} (µs)"] = round(1e6 * (time.process_time() - before) / steps, 1)
    return found


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--runs", type=int, default=1000, help="with one pair; a third of it with three")
    parser.add_argument("--particles", type=int, default=0, help="of the particle filter; 0: none")
    parser.add_argument("--stone-soup", type=int, default=0, help="particles of Stone Soup's filter; 0: none")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parse(parser)
    rows = []
    for name, level in LEVELS.items():
        for pairs in PAIRS:
            setting = {"runs": max(arguments.runs // pairs, 1), "pairs": pairs, "seed": arguments.seed}
            made: list[Timed] = []

            def make(count: int, level: Level, made: list[Timed] = made) -> Timed:
                made.append(Timed(count, level))
                return made[-1]

            row = {"level": name, "pairs": pairs} | figures(simulate(make, level, **setting))
            row |= {f"{call} (µs)": round(1e6 * float(np.median(t)), 2) for call, t in made[0].times.items()}
            if arguments.particles:
                best = simulate(lambda n, level: Particles(n, level, arguments.particles, seed=1), level, **setting)
                row |= {f"{figure}, particles": value for figure, value in figures(best).items()}
            if arguments.stone_soup:
                row |= of_stone_soup(arguments.stone_soup, level, setting)
            rows.append(row)
    show({**describe(), "errors": rows}, arguments.json)


if __name__ == "__main__":
    main()
