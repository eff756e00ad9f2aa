"""How much of what `belief` misses is due to not knowing where AUVs are.

    python -m benchmarks.studies.clairvoyant

Missions of `wide` with `belief`, and with `belief` that is told in each step where every AUV truly is, which node it
heads for and how long it hovers. The AUVs know as little of themselves as before. Same worlds for both.
"""

import argparse

import numpy as np
import taichi as ti

from benchmarks.machine import describe
from usvauv import policies
from usvauv.cli.evaluation.comparison import interval
from usvauv.env import Scenario, World
from usvauv.env.record.metrics import episode_metrics
from usvauv.env.record.recorder import record
from usvauv.kernels.mission.boats import belief_planner, boat_strategies
from usvauv.kernels.mission.boats.boat_strategies import BoatStrategy
from usvauv.kernels.mission.boats.boat_strategies import boat_strategies as strategies
from usvauv.kernels.mission.columns import AuvColumn, ForesightColumn
from usvauv.kernels.mission.worlds import Strategy

LEVELS = {170: 144, 210: 146, 290: 149}  # slant range, m → source level, dB


@ti.func
def clairvoyant(worlds: ti.template(), w, b):
    """As `belief`, with foresight that is the truth."""
    for k in range(worlds.estimate.shape[1]):
        for axis in ti.static(range(2)):
            worlds.foresight[w, k, ForesightColumn.x + axis] = worlds.auv[w, k, AuvColumn.x + axis]
        worlds.foresight.heads_for[w, k] = worlds.auv.target[w, k]
        worlds.foresight.hovers[w, k] = worlds.auv.hover[w, k]
    return belief_planner.go(worlds, w, b)


strategies.register("clairvoyant", BoatStrategy(Strategy(boat_strategies.begin_foresight, clairvoyant, foresees=True)))


def data(level: int, boat: str, episodes: int, seed: int) -> np.ndarray:
    """Data of each episode, Mbit."""
    world = World(Scenario.load("wide", [f"acoustics.source_level={level}"]), episodes, seed, boat)
    return np.array(
        [row.delivered_mbit for row in episode_metrics(record(world, policies.load("pace", world).act, ""))]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    arguments = parser.parse_args()
    print(f"{arguments.episodes} episodes, seed {arguments.seed}; {describe()}")
    print("| heard to | `belief` Mbit | told where AUVs are | more, 95 % |")
    print("| --- | --- | --- | --- |")
    for distance, level in LEVELS.items():
        plain, told = (data(level, boat, arguments.episodes, arguments.seed) for boat in ("belief", "clairvoyant"))
        more = told - plain
        half = interval(more).half
        print(f"| {distance} m | {plain.mean():.1f} | {told.mean():.1f} | {more.mean():.1f} ± {half:.1f} |", flush=True)


if __name__ == "__main__":
    main()
