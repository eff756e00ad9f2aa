"""Target rules compared: which node next, in several settings and with less and less known.

    python -m benchmarks.studies.decisions
    python -m benchmarks.studies.decisions --part survey --episodes 200

AUVs steer by `pace`, the boat stays at the mean of their positions, so that rules differ in nothing else. The number of
each rule is the best of `TUNED` on other seeds, by data delivered. Intervals are 95 %; differences are paired by world.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import cache

from benchmarks.machine import describe
from benchmarks.studies.table import figure, head, interval, line
from usvauv import policies
from usvauv.env import EpisodeMetrics, Scenario, run_episodes

WIDE = ("nodes.count=60", "auv.count=4", "area.width=400", "area.length=400", "current.count=25", "current.period=500")
WIDER = (
    "nodes.count=120",
    "auv.count=8",
    "area.width=600",
    "area.length=600",
    "current.count=49",
    "current.period=700",
)
UNEQUAL = "nodes.arrival_rates=[1,1,2,30]"
SETTINGS = {
    "`extreme`": (),
    "4 AUVs, 60 nodes, 400 m": WIDE,
    "8 AUVs, 120 nodes, 600 m": WIDER,
    "`extreme`, four times the arrivals": ("nodes.arrival_rates=[12,20,32,48]",),
    "`extreme`, λ from {1, 1, 2, 30}": (UNEQUAL,),
}
KNOWING = ("extreme", "survey")
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
DATA = "delivered_mbit"
FIGURES = {  # name → heading, digits
    "lost_mbit": ("lost Mbit", 1),
    "aoi_mean": ("mean age s", 1),
    "aoi_peak": ("peak age s", 1),
    "jain": ("jain", 2),
    "joule_per_mbit": ("J/Mbit", 0),
    "services": ("services", 1),
    "collisions": ("collisions", 1),
}


@cache
def run(
    rule: str, changes: Sequence[str], episodes: int, seed: int, scenario_name: str = "extreme"
) -> list[EpisodeMetrics]:
    scenario = Scenario.load(scenario_name, changes)
    return run_episodes(scenario, policies.named("pace"), episodes=episodes, seed=seed, usv="centroid", targets=rule)


def tuned(rule: str, changes: Sequence[str], episodes: int, seed: int, scenario: str = "extreme") -> str:
    """The rule with its best number."""
    names = [f"{rule}:{number:g}" for number in TUNED[rule]] or [rule]
    return max(names, key=lambda name: figure(run(name, changes, episodes, seed, scenario), DATA).mean())


def table(
    names: Sequence[str], less: str, changes: Sequence[str], episodes: int, seed: int, scenario: str = "extreme"
) -> None:
    """All figures of rules, and their data less those of one of them."""
    head(["rule", "Mbit", f"less `{less}`", *(heading for heading, _ in FIGURES.values())])
    against = figure(run(less, changes, episodes, seed, scenario), DATA)
    for name in names:
        rows = run(name, changes, episodes, seed, scenario)
        data = figure(rows, DATA)
        others = [interval(figure(rows, each), digits) for each, (_, digits) in FIGURES.items()]
        line([f"`{name}`", interval(data), interval(data - against), *others])


def settings(episodes: int, seed: int, tuning: tuple[int, int]) -> None:
    """All rules in each setting."""
    for title, changes in SETTINGS.items():
        print(f"\n### {title}\n")
        names = [SHIPPED, *(tuned(rule, changes, *tuning) for rule in TUNED)]
        table(names, BASELINE, changes, episodes, seed)


def knowledge(episodes: int, seed: int, tuning: tuple[int, int]) -> None:
    """Mbit of the best rules when less is known, and less that with everything known, for which they are tuned."""
    for scenario in KNOWING:
        print(f"\n### `{scenario}`: Mbit by what is known\n")
        head(["rule", *(f"`{known}`" for known in INFORMATION)])
        for rule in ("rate", "rollout", "tour", "sectors"):
            name = tuned(rule, ("nodes.information=full",), *tuning, scenario)
            full, *others = (
                figure(run(name, (f"nodes.information={known}",), episodes, seed, scenario), DATA)
                for known in INFORMATION
            )
            line([f"`{name}`", interval(full), *(f"{interval(data)} ({interval(data - full)})" for data in others)])


def survey(episodes: int, seed: int, tuning: tuple[int, int]) -> None:
    """All figures in `survey`."""
    for known in ("visits", "own-visits"):
        changes = (f"nodes.information={known}",)
        print(f"\n### `survey`, `{known}`\n")
        best = tuned("rollout", changes, *tuning, "survey")
        names = [tuned("rate", changes, *tuning, "survey"), best, "tour", "sectors"]
        table(names, best, changes, episodes, seed, "survey")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--tuning-episodes", type=int, default=30)
    parser.add_argument("--tuning-seed", type=int, default=77)
    parser.add_argument("--part", choices=("settings", "knowledge", "survey"), action="append")
    arguments = parser.parse_args()
    tuning = (arguments.tuning_episodes, arguments.tuning_seed)
    print(
        f"{describe()}; {arguments.episodes} paired episodes, seed {arguments.seed}; numbers tuned on seed {tuning[1]}"
    )
    parts = arguments.part or ("settings", "knowledge", "survey")
    if "settings" in parts:
        settings(arguments.episodes, arguments.seed, tuning)
    if "knowledge" in parts:
        knowledge(arguments.episodes, arguments.seed, tuning)
    if "survey" in parts:
        survey(arguments.episodes, arguments.seed, tuning)


if __name__ == "__main__":
    main()
