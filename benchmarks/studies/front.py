"""Data against energy in `extreme`: learned policies beside heuristics over their whole range.

    python -m benchmarks.studies.front --out docs/front.png

Paired episodes: all policies act in the same worlds. A heuristic's argument (speed, or price of time) traces a curve of
SDR over EC. Each learned policy is compared with the curve of `straight`, linear between its speeds: its SDR over that
of `straight` at equal EC, and its EC over that of `straight` at equal SDR; the same SDR over `pace`; and its services
over those of `zermelo`, which knows the whole current, at equal EC. Intervals are 95 % by the bootstrap over episodes,
all policies resampled together.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import policies
from benchmarks.machine import describe
from usvauv_env import Scenario, World
from usvauv_env.record.metrics import episode_metrics
from usvauv_env.record.recorder import record

SCENARIO = "extreme"
CURVES = {
    "straight": (1.2, 1.25, 1.3, 1.35, 1.4, 1.5, 1.6),
    "crab": (1.2, 1.3, 1.4, 1.5, 1.6),
    "pace": (0.0, 15.0, 30.0, 60.0, 100.0, 150.0),
    "zermelo": (1.2, 1.3, 1.4, 1.5),
}
COLOURS = {"straight": "#8c510a", "crab": "#e0a800", "pace": "#5c8001", "zermelo": "#9ecae1"}
FIGURES = ("arps", "sdr", "ec", "services", "collisions", "border")
RESAMPLES = 4000

Table = dict[str, dict[str, np.ndarray]]


def fitting(names: list[str], scenario: Scenario) -> list[str]:
    """The policies that fit a scenario."""
    kept = []
    for name in names:
        try:
            policies.check(name, scenario)
        except policies.PolicyError as error:
            print(f"left out: {error}", file=sys.stderr)
            continue
        kept.append(name)
    return kept


def measure(names: list[str], scenario: Scenario, episodes: int, seed: int) -> Table:
    """Figures of merit of each policy, (episodes,), in the same worlds."""
    world, table = World(scenario, episodes, seed), {}
    for name in names:
        policy = policies.load(name, world)
        world.rewind()
        rows = episode_metrics(record(world, policy.act, name))
        table[name] = {figure: np.array([getattr(row, figure) for row in rows], float) for figure in FIGURES}
        print(line(name, table[name]), flush=True)
    return table


def line(name: str, figures: dict[str, np.ndarray]) -> str:
    cells = [
        f"{figures[name].mean():.2f} ± {1.96 * figures[name].std() / np.sqrt(len(figures[name])):.2f}"
        for name in FIGURES
    ]
    return f"| `{name}` | " + " | ".join(cells) + " |"


def curve(family: str, table: Table, figure: str, drawn: np.ndarray) -> np.ndarray:
    """Mean of a figure along a heuristic's curve for each resample, (points, R)."""
    return np.stack([table[f"{family}:{value:g}"][figure][drawn].mean(-1) for value in CURVES[family]])


def ratio(name: str, table: Table, family: str, figure: str, at: str) -> list[float]:
    """A policy's figure over that of a heuristic at an equal value of the figure `at`: mean and 95 % interval."""
    count = len(table[name][figure])
    drawn = np.random.default_rng(0).integers(0, count, (RESAMPLES, count))
    drawn = np.concatenate((np.arange(count)[None], drawn))
    there, along = curve(family, table, at, drawn), curve(family, table, figure, drawn)
    own, place = (table[name][key][drawn].mean(-1) for key in (figure, at))
    other = [np.interp(x, xp, fp, left=np.nan, right=np.nan) for x, xp, fp in zip(place, there.T, along.T, strict=True)]
    ratios = own / np.array(other)
    if np.isnan(ratios).any():
        return [float("nan")] * 3  # off the end of the curve
    return [float(ratios[0]), *np.quantile(ratios[1:], (0.025, 0.975)).tolist()]


def compare(name: str, table: Table) -> dict[str, list[float]]:
    return {
        "sdr_over_straight_at_equal_ec": ratio(name, table, "straight", "sdr", "ec"),
        "ec_over_straight_at_equal_sdr": ratio(name, table, "straight", "ec", "sdr"),
        "sdr_over_pace_at_equal_ec": ratio(name, table, "pace", "sdr", "ec"),
        "services_over_zermelo_at_equal_ec": ratio(name, table, "zermelo", "services", "ec"),
    }


def draw(table: Table, learned: list[str], path: Path) -> None:
    figure, panel = plt.subplots(figsize=(7.5, 5), layout="constrained")
    whole = np.arange(len(next(iter(table.values()))["ec"]))[None]
    for family, colour in COLOURS.items():
        x, y = (curve(family, table, key, whole)[:, 0] for key in ("ec", "sdr"))
        panel.plot(
            x,
            y,
            "o-",
            ms=4,
            lw=1.4,
            color=colour,
            label=f"{family} (knows the current everywhere)" if family == "zermelo" else family,
        )
    for name in learned:
        x, y = (table[name][key] for key in ("ec", "sdr"))
        error = [1.96 * values.std() / np.sqrt(len(values)) for values in (y, x)]
        panel.errorbar(x.mean(), y.mean(), *error, fmt="s", ms=6, capsize=3, label=Path(name).name)
    panel.set(xlabel="EC, W", ylabel="SDR, Mbit/s", title=f"{SCENARIO}, {whole.size} paired episodes")
    panel.grid(alpha=0.3)
    panel.legend(frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print the ratios as JSON")
    parser.add_argument("--policy", action="append", help="learned policy; default: all that ship and fit")
    parser.add_argument("--out", type=Path, help="figure to write")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=2026)
    arguments = parser.parse_args()
    scenario = Scenario.load(SCENARIO)
    learned = arguments.policy or fitting(policies.trained(), scenario)
    print(f"{describe()}; {arguments.episodes} episodes of {SCENARIO}, seed {arguments.seed}; mean ± 95 %\n")
    print("| policy | " + " | ".join(FIGURES) + " |\n" + "| --- " * (len(FIGURES) + 1) + "|")
    points = [f"{family}:{value:g}" for family, values in CURVES.items() for value in values]
    table = measure([*learned, *points], scenario, arguments.episodes, arguments.seed)
    results = {name: compare(name, table) for name in learned}
    print()
    for name, rows in results.items():
        for what, (mean, low, high) in rows.items():
            print(f"{name}: {what.replace('_', ' ')} {mean:.3f} ({low:.3f} to {high:.3f})")
    if arguments.out:
        draw(table, learned, arguments.out)
    if arguments.json:
        print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
