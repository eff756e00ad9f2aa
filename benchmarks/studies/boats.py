"""The boat's strategies in `wide` with a boat of the class `otter`, as a point and as a model that has to turn.

    python -m benchmarks.studies.boats

All episodes are of the same worlds, so differences are taken episode by episode; intervals are 95 %. AUVs are steered
by `clear`. Beside each strategy stands its lead over the next one with the same boat.
"""

from __future__ import annotations

import argparse
from itertools import pairwise

import numpy as np

from benchmarks.machine import describe
from benchmarks.studies.table import figure, head, interval, line
from usvauv import policies
from usvauv.env import Scenario, run_episodes

MODELS = ("point", "otter")
STRATEGIES = ("belief", "visit", "fim", "centroid", "hold:300,300")
FIGURES = {"delivered_mbit": "data, Mbit", "position_error_median": "median error, m"}


def measure(model: str, usv: str, episodes: int, seed: int) -> dict[str, np.ndarray]:
    """Figures of each episode, (episodes,)."""
    scenario = Scenario.load("wide", ["boat.vessel=otter", f"boat.model={model}"])
    rows = run_episodes(scenario, policies.named("clear"), episodes=episodes, seed=seed, usv=usv)
    return {name: figure(rows, name) for name in FIGURES}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=128)
    parser.add_argument("--seed", type=int, default=1000)
    arguments = parser.parse_args()
    print(f"{describe()}; {arguments.episodes} episodes of wide, seed {arguments.seed}; mean ± 95 %\n")
    head(["boat", *(f"{what}, {column}" for what in FIGURES.values() for column in (*MODELS, "otter − point"))])
    found = {}
    for usv in STRATEGIES:
        point, otter = (measure(model, usv, arguments.episodes, arguments.seed) for model in MODELS)
        found[usv] = {"point": point, "otter": otter}
        line(
            [
                f"`{usv}`",
                *(interval(part) for name in FIGURES for part in (point[name], otter[name], otter[name] - point[name])),
            ]
        )
    print()
    head(["lead in data, Mbit", *MODELS])
    for one, other in (*pairwise(STRATEGIES), ("belief", "fim")):
        leads = (found[one][model]["delivered_mbit"] - found[other][model]["delivered_mbit"] for model in MODELS)
        line([f"`{one}` over `{other}`", *map(interval, leads)])


if __name__ == "__main__":
    main()
