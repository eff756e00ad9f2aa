"""Data against energy in `extreme`: learned policies beside heuristics over their whole range.

    python -m benchmarks.studies.front --out docs/front.png

Paired episodes: all policies act in the same worlds. A heuristic's argument (speed, or price of time) traces a curve of
data over energy. Each learned policy is compared with these curves, linear between their points: its data over theirs
at equal energy. Intervals are 95 %, those of ratios by the bootstrap over episodes, all policies resampled together.
"""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.machine import describe
from benchmarks.studies.table import figure, head, interval, line
from usvauv import policies
from usvauv.cli.evaluation import comparison
from usvauv.env import run_episodes
from usvauv.env.render.figures import write_pair
from usvauv.env.render.style import MARKERS, Ground, looks

SCENARIO = "extreme"
CURVES = {
    "straight": (1.2, 1.3, 1.4, 1.6, 1.8, 2.0),
    "crab": (1.2, 1.3, 1.4, 1.6, 1.8, 2.0),
    "clear": (0.0, 20.0, 40.0, 80.0, 120.0, 200.0),
}
LEARNED_MARKS = MARKERS[len(CURVES) :]
FIGURES = ("arps", "delivered_mbit", "lost_mbit", "energy_wh", "joule_per_mbit", "services", "collisions")
DATA, ENERGY = "delivered_mbit", "energy_wh"
RESAMPLES = 4000

Table = dict[str, dict[str, np.ndarray]]


def measure(name: str, episodes: int, seed: int) -> dict[str, np.ndarray]:
    """Figures of a policy, (episodes,); prints them."""
    rows = run_episodes(SCENARIO, policies.named(name), episodes=episodes, seed=seed)
    figures = {each: figure(rows, each) for each in FIGURES}
    line([f"`{Path(name).name}`", *(interval(values, 2 if each == "arps" else 1) for each, values in figures.items())])
    return figures


def curve(family: str, table: Table, name: str, drawn: np.ndarray) -> np.ndarray:
    """Mean of a figure along a heuristic's curve for each resample, (points, R)."""
    return np.stack([table[f"{family}:{value:g}"][name][drawn].mean(-1) for value in CURVES[family]])


def ratio(name: str, table: Table, family: str) -> list[float]:
    """A policy's data over that of a heuristic at equal energy: mean and 95 % interval.

    NaN beyond the ends of the curve, and where the heuristic delivers nothing.
    """
    count = len(table[name][DATA])
    drawn = np.random.default_rng(0).integers(0, count, (RESAMPLES, count))
    drawn = np.concatenate((np.arange(count)[None], drawn))
    energies, along = curve(family, table, ENERGY, drawn), curve(family, table, DATA, drawn)
    own, energy = (table[name][key][drawn].mean(-1) for key in (DATA, ENERGY))
    rising = zip(energy, energies.T, along.T, strict=True)
    theirs = np.array([np.interp(x, xp, fp, left=np.nan, right=np.nan) for x, xp, fp in rising])
    ratios = np.divide(own, theirs, out=np.full_like(theirs, np.nan), where=theirs > 0.0)
    return [float(ratios[0]), *np.quantile(ratios[1:], (0.025, 0.975)).tolist()]


def draw(table: Table, learned: list[str], ground: Ground) -> Figure:
    picture = Figure(figsize=(7.5, 5), layout="constrained")
    panel = picture.subplots()
    whole = np.arange(len(next(iter(table.values()))[DATA]))[None]
    for family, (colour, mark) in looks(CURVES, ground.colours).items():
        x, y = (curve(family, table, key, whole)[:, 0] for key in (ENERGY, DATA))
        panel.plot(x, y, f"{mark}-", ms=5, lw=1.4, color=colour, label=family)
    for name, mark in zip(learned, LEARNED_MARKS * len(learned), strict=False):
        x, y = (table[name][key] for key in (ENERGY, DATA))
        up, along = (comparison.interval(values).half for values in (y, x))
        label = Path(name).name
        look = {"fmt": mark, "ms": 7, "capsize": 3, "color": ground.text, "label": label}
        panel.errorbar(x.mean(), y.mean(), up, along, **look)
    panel.set(xlabel="energy of all AUVs, Wh", ylabel="data, Mbit", title=f"{SCENARIO}, {whole.size} paired episodes")
    panel.legend()
    return picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print the ratios as JSON")
    parser.add_argument("--policy", action="append", help="learned policy; default: sac-extreme")
    parser.add_argument("--out", type=Path, help="X.png: figures X-light.png and X-dark.png to write")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=2026)
    arguments = parser.parse_args()
    learned = arguments.policy or ["sac-extreme"]
    print(f"{describe()}; {arguments.episodes} episodes of {SCENARIO}, seed {arguments.seed}; mean ± 95 %\n")
    head(["policy", *FIGURES])
    points = [f"{family}:{value:g}" for family, values in CURVES.items() for value in values]
    table = {name: measure(name, arguments.episodes, arguments.seed) for name in [*learned, *points]}
    results = {name: {family: ratio(name, table, family) for family in CURVES} for name in learned}
    print()
    head(["data at equal energy, over that of", *(f"`{family}`" for family in CURVES)])
    for name, families in results.items():
        line(
            [
                f"`{Path(name).name}`",
                *(f"{mean:.3f} ({low:.3f} to {high:.3f})" for mean, low, high in families.values()),
            ]
        )
    if arguments.out:
        write_pair(arguments.out, partial(draw, table, learned))
    if arguments.json:
        print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
