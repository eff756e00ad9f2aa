"""What the planner would gain by counting all errors of a fix, not its noise and pitch and roll alone.

    python -m benchmarks.studies.total_information

Boats that search the area for the place where the determinants of the covariances of one fix of each AUV have the least
product: of the errors that `fim` counts ("noise"), and of all, those of the mounting, the compass, the speed of sound
and the boat's position added as if each fix drew them anew ("total"). Same worlds for all; AUVs steered by `clear`, in
`wide` by `pace`. Differences are paired with `fim`, with 95 % intervals.
"""

import argparse
import math
from typing import Any

import numpy as np
import taichi as ti

from benchmarks.machine import describe
from benchmarks.studies.table import head, line
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.env.record.metrics import episode_metrics
from usvauv.env.record.recorder import record
from usvauv.env.world.boat_strategies import BoatStrategy
from usvauv.env.world.boat_strategies import boat_strategies as strategies
from usvauv.kernels.mission.columns import EstimateColumn, Parameter
from usvauv.kernels.mission.worlds import Strategy
from usvauv.kernels.positioning import acoustic_link, usbl
from usvauv.kernels.types import mat3, vec2, vec3

SCENARIOS = {"extreme": "clear", "ideal": "clear", "wide": "pace"}
COARSE, FINE = 17, 9  # places a side: of the area, then of the square between the neighbours of the best
LEVEL = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def searching(total: bool) -> BoatStrategy:
    """A boat that goes to the best place by noise alone, or by all errors."""

    @ti.func
    def cost(worlds: ti.template(), w, b, place: vec2) -> ti.f32:
        link = ti.static(worlds.link)
        axes = mat3(LEVEL)
        value = 0.0
        for k in range(worlds.estimate.shape[1]):
            x = worlds.estimate[w, k, EstimateColumn.x] - place[0]
            y = worlds.estimate[w, k, EstimateColumn.y] - place[1]
            offset = vec3(x, y, -worlds.p[Parameter.separation_boat])
            loss = acoustic_link.further_loss(link, k, offset, 0.0)
            sigma = acoustic_link.phase_deviation(link, k, offset.norm(), loss)
            C = usbl.horizontal_covariance(link, k, offset, axes, sigma)
            if ti.static(total):
                C += usbl.systematic_covariance(link, k, offset, axes)
            value += ti.log(C[0] * C[2] - C[1] * C[1])
        return value

    @ti.func
    def goal(worlds: ti.template(), w, b) -> vec2:
        size = vec2(worlds.p[Parameter.width], worlds.p[Parameter.length])
        best = 0.5 * size
        for stage in ti.static(range(2)):
            count = ti.static((COARSE, FINE)[stage])
            step = size / (COARSE - 1) * ti.static((1.0, 2.0 / (FINE - 1))[stage])
            centre = best
            least = cost(worlds, w, b, best)
            for i in range(count):
                for j in range(count):
                    place = centre + (vec2(i, j) - 0.5 * (count - 1)) * step
                    place = ti.max(ti.min(place, size), vec2(0.0))
                    value = cost(worlds, w, b, place)
                    if value < least:
                        least = value
                        best = place
        return best

    return BoatStrategy(Strategy(goal, goal))


strategies.register("noise", searching(False))
strategies.register("total", searching(True))
BOATS = ("fim", "noise", "total", "centroid")


def measure(scenario: str, boat: str, episodes: int, seed: int) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Figures of each episode, and where the boat was (T, W, 2), m."""
    world = World(Scenario.load(scenario), episodes, seed, boat)
    trace = record(world, policies.load(SCENARIOS[scenario], world).act, "")
    rows: Any = episode_metrics(trace)
    figures = {
        "rms": np.array([row.position_error_rms for row in rows]),
        "Mbit": np.array([row.delivered_mbit for row in rows]),
    }
    return figures, trace.boat_position[:, :, 0]


def paired(values: np.ndarray, over: np.ndarray, digits: int) -> str:
    more = values - over
    return f"{more.mean():.{digits}f} ± {1.96 * more.std(ddof=1) / math.sqrt(len(more)):.{digits}f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", action="append", choices=SCENARIOS, help="default: all; may be repeated")
    parser.add_argument("--episodes", type=int, default=64)
    parser.add_argument("--seed", type=int, default=2026)
    arguments = parser.parse_args()
    print(f"{arguments.episodes} episodes, seed {arguments.seed}; {describe()}")
    head(
        (
            "scenario",
            "boat",
            "from the boat of `fim`, m",
            "rms error, m",
            "more than `fim`, m",
            "Mbit",
            "more than `fim`",
        )
    )
    for scenario in arguments.scenario or SCENARIOS:
        found = {boat: measure(scenario, boat, arguments.episodes, arguments.seed) for boat in BOATS}
        by_fim, there = found["fim"]
        for boat, (figures, place) in found.items():
            away = np.linalg.norm(place - there, axis=-1).mean()
            cells = [scenario, f"`{boat}`", f"{away:.1f}"]
            for figure, digits in (("rms", 4), ("Mbit", 2)):
                cells += [f"{figures[figure].mean():.{digits}f}", paired(figures[figure], by_fim[figure], digits)]
            line(cells)


if __name__ == "__main__":
    main()
