"""Target rules compared: which node next, in several settings and with less and less known.

    python -m benchmarks.studies.decisions

AUVs steer by `pace`, the boat stays at the mean of their positions, so that rules differ in nothing else. The number of
each rule is the best of `TUNED` on other seeds, by data delivered. Intervals are 95 %; differences are paired by world.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import cache

import numpy as np

import policies
from benchmarks.machine import describe
from usvauv_env import EpisodeMetrics, Scenario, evaluate

WIDE = ("nodes.count=60", "auv.count=4", "area.width=400", "area.length=400", "current.count=16")
WIDER = ("nodes.count=120", "auv.count=8", "area.width=600", "area.length=600", "current.count=36")
UNEQUAL = "nodes.arrival_rates=[1,1,2,30]"
SETTINGS = {
    "`extreme`": (),
    "4 AUVs, 60 nodes, 400 m": WIDE,
    "8 AUVs, 120 nodes, 600 m": WIDER,
    "`extreme`, four times the arrivals": ("nodes.arrival_rates=[12,20,32,48]",),
    "`extreme`, λ from {1, 1, 2, 30}": (UNEQUAL,),
}
KNOWING = {"`extreme`": (), "4 AUVs, 60 nodes, 400 m, λ from {1, 1, 2, 30}": (*WIDE, UNEQUAL)}
INFORMATION = ("full", "rates", "visits", "own-visits")
TUNED = {
    "greedy": (0.03, 0.06, 0.1, 0.2, 0.4),
    "nearest": (500, 1000, 1500, 2000, 3000),
    "rate": (2, 5, 10, 20, 40),
    "rollout": (40, 90, 160),
    "tour": (),
    "sectors": (),
}
SHIPPED = "greedy:0.015"  # the paper's, and the rule that shipped before
BASELINE = "tour"
FIGURES = ("delivered_mbit", "lost_mbit", "aoi_mean", "aoi_peak", "jain", "joule_per_mbit", "services", "collisions")


@cache
def run(rule: str, changes: Sequence[str], episodes: int, seed: int) -> list[EpisodeMetrics]:
    scenario = Scenario.load("extreme", changes)
    return evaluate(scenario, policies.named("pace"), episodes=episodes, seed=seed, usv="centroid", targets=rule)


def figure(rows: Sequence[EpisodeMetrics], name: str) -> np.ndarray:
    return np.array([row.columns()[name] for row in rows])


def tuned(rule: str, changes: Sequence[str], episodes: int, seed: int) -> str:
    """The rule with its best number."""
    names = [f"{rule}:{number:g}" for number in TUNED[rule]] or [rule]
    return max(names, key=lambda name: figure(run(name, changes, episodes, seed), "delivered_mbit").mean())


def interval(values: np.ndarray, digits: int = 1) -> str:
    values = values[np.isfinite(values)]
    return f"{values.mean():.{digits}f} ± {1.96 * values.std(ddof=1) / np.sqrt(len(values)):.{digits}f}"


def line(cells: Sequence[str]) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def head(cells: Sequence[str]) -> None:
    line(cells)
    line(["---"] * len(cells))


def settings(episodes: int, seed: int, tuning: tuple[int, int]) -> None:
    """All rules in each setting."""
    for title, changes in SETTINGS.items():
        print(f"\n### {title}\n")
        head(["rule", "Mbit", "less `tour`", *(name for name in FIGURES[1:])])
        names = [SHIPPED, *(tuned(rule, changes, *tuning) for rule in TUNED)]
        against = figure(run(BASELINE, changes, episodes, seed), FIGURES[0])
        for name in names:
            rows = run(name, changes, episodes, seed)
            data = figure(rows, FIGURES[0])
            others = [interval(figure(rows, each), 2 if each == "jain" else 1) for each in FIGURES[1:]]
            line([f"`{name}`", interval(data), interval(data - against), *others])


def knowledge(episodes: int, seed: int, tuning: tuple[int, int]) -> None:
    """Mbit of the best rules when less is known."""
    for title, changes in KNOWING.items():
        print(f"\n### {title}: Mbit by what is known\n")
        head(["rule", *(f"`{known}`" for known in INFORMATION)])
        for rule in ("rate", "rollout", "tour", "sectors"):
            cells = []
            for known in INFORMATION:
                condition = (*changes, f"nodes.information={known}")
                cells.append(
                    interval(figure(run(tuned(rule, changes, *tuning), condition, episodes, seed), FIGURES[0]))
                )
            line([f"`{tuned(rule, changes, *tuning)}`", *cells])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--tuning-episodes", type=int, default=30)
    parser.add_argument("--tuning-seed", type=int, default=77)
    arguments = parser.parse_args()
    tuning = (arguments.tuning_episodes, arguments.tuning_seed)
    print(
        f"{describe()}; {arguments.episodes} paired episodes, seed {arguments.seed}; numbers tuned on seed {tuning[1]}"
    )
    settings(arguments.episodes, arguments.seed, tuning)
    knowledge(arguments.episodes, arguments.seed, tuning)


if __name__ == "__main__":
    main()
