"""Data brought in by the boat's strategy and by how far AUVs are heard.

    python -m benchmarks.studies.collaboration

Missions of `wide`: eight AUVs and 120 nodes on 600 m × 600 m. A reply is understood from an E/N0 of 18 dB on; the
transponders' level decides how far that is. All strategies have the same worlds, and so has a mission in which fixes
are perfect.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

import policies
from benchmarks.machine import describe
from usvauv_env import Scenario, World
from usvauv_env.record.metrics import episode_metrics
from usvauv_env.record.recorder import record

PERFECT = (
    "channel.schedule=every-step",
    "navigation.sensor=none",
    "acoustics.source_level=250",
    "acoustics.sound_speed_error=0",
    *(f"usbl.{name}_error=0" for name in ("attitude", "alignment", "heading", "lever_arm", "gnss")),
)
LEVELS = {150: 140.0, 200: 142.0, 300: 145.0}  # horizontal range, m → source level, dB
BOATS = ("hold:300,300", "centroid", "fim", "visit", "belief")
FIGURES = ("delivered_mbit", "own_error_rms", "own_error_p95", "fix_availability", "outage_longest")


def fly(changes: tuple[str, ...], boat: str, policy: str, episodes: int, seed: int) -> dict[str, np.ndarray]:
    """Figures of each episode, (episodes,)."""
    world = World(Scenario.load("wide", list(changes)), episodes, seed, boat)
    rows = episode_metrics(record(world, policies.load(policy, world).act, policy))
    return {name: np.array([getattr(row, name) for row in rows]) for name in FIGURES}


def interval(values: np.ndarray) -> str:
    return f"{values.mean():.1f} ± {1.96 * values.std(ddof=1) / math.sqrt(len(values)):.1f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--policy", default="pace")
    arguments = parser.parse_args()
    common = (arguments.policy, arguments.episodes, arguments.seed)
    perfect = fly(PERFECT, BOATS[0], *common)["delivered_mbit"]
    print(f"{arguments.policy}, {arguments.episodes} episodes, seed {arguments.seed}; {describe()}")
    print(f"perfect fixes: {interval(perfect)} Mbit")
    print("| heard to | boat | Mbit | of perfect | `belief` minus it, 95 % | own rms, p95, m | fixes | outage, s |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for distance, level in LEVELS.items():
        rows = {boat: fly((f"acoustics.source_level={level}",), boat, *common) for boat in BOATS}
        for boat, row in rows.items():
            data = row["delivered_mbit"]
            less = "" if boat == "belief" else interval(rows["belief"]["delivered_mbit"] - data)
            own = f"{row['own_error_rms'].mean():.1f}, {row['own_error_p95'].mean():.1f}"
            rest = f"{row['fix_availability'].mean():.2f} | {row['outage_longest'].mean():.0f}"
            share = f"{data.sum() / perfect.sum():.1%}"
            print(f"| {distance} m | `{boat}` | {data.mean():.1f} | {share} | {less} | {own} | {rest} |", flush=True)


if __name__ == "__main__":
    main()
