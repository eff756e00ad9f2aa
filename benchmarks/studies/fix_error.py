"""Errors of fixes and of positions by the boat's strategy, as the paper's Fig. 4(b).

    python -m benchmarks.studies.fix_error --out docs/fix-error.png

Paired episodes: every row sees the same worlds, AUVs steered by `straight`. For each episode the median horizontal
error of the fixes that can be used; of these the median over episodes, and its 95 % interval by the bootstrap, as of
the ratio to `fim` with the episodes paired. Beside it the median over episodes of the rms and the 95th percentile of
the boat's estimates, and of the rms of where AUVs take themselves to be. `best place` is the median of errors that are
normal with the covariance of a fix by a level array from the place that is D-optimal for the true positions, at each
step: a boat that is there at once.
"""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.machine import describe
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.env.accuracy import fix_errors
from usvauv.env.record.metrics import own_error, position_error, usable
from usvauv.env.record.recorder import record
from usvauv.env.record.trace import Trace
from usvauv.env.render.figures import write_pair
from usvauv.env.render.style import Ground, looks

SCENARIOS = ("ideal", "extreme")
TEAMS = (2, 3, 4, 5, 6)
PAPER = ("planner.objective=sum", "planner.measurement=phase", "planner.noise=constant")
ROWS = {
    "hold:0,0": ("hold:0,0", ()),
    "hold:100,100": ("hold:100,100", ()),
    "centroid": ("centroid", ()),
    "fim by the paper's Eq. 2": ("fim", PAPER),
    "fim-greedy": ("fim-greedy", ()),
    "fim": ("fim", ()),
}
RESAMPLES = 4000
BEST = "best place"


def voyage(scenario: str, auvs: int, usv: str, settings: tuple[str, ...], episodes: int, seed: int) -> Trace:
    setting = Scenario.load(scenario, [f"auv.count={auvs}", *settings])
    world = World(setting, episodes, seed, usv)
    return record(world, policies.load("straight", world).act, "straight")


def rms(error: np.ndarray) -> np.ndarray:
    """Root mean square (W,) of errors (T, W, K)."""
    return np.sqrt(np.square(error, dtype=np.float64).mean(axis=(0, 2)))


def from_best_place(trace: Trace) -> np.ndarray:
    """For each episode, the median error of fixes from the best place."""
    variance = fix_errors.best_variance(trace)
    return np.array([fix_errors.median_of_normals(variance[:, w].ravel()) for w in range(variance.shape[1])])


def interval(values: np.ndarray, over: np.ndarray | None = None) -> list[float]:
    """Median of values (n,), or its ratio to that of `over`, and the 95 % bootstrap interval over episodes."""
    drawn = np.random.default_rng(0).integers(0, len(values), (RESAMPLES, len(values)))
    centre, medians = np.median(values), np.median(values[drawn], axis=1)
    if over is not None:
        centre, medians = centre / np.median(over), medians / np.median(over[drawn], axis=1)
    return [float(centre), *np.quantile(medians, (0.025, 0.975)).tolist()]


def measure(episodes: int, seed: int) -> dict[str, object]:
    """Medians, intervals and ratios to `fim` of every row, by scenario and number of AUVs."""
    result: dict[str, object] = {"machine": describe(), "episodes": episodes, "seed": seed}
    for scenario in SCENARIOS:
        teams = result.setdefault(scenario, {})
        for auvs in TEAMS:
            errors, positions = {}, {}
            for row, (usv, settings) in ROWS.items():
                trace = voyage(scenario, auvs, usv, settings, episodes, seed)
                fixes = np.where(usable(trace), np.linalg.norm(trace.fix - trace.heard_position, axis=-1), np.nan)
                errors[row] = np.nanmedian(fixes, axis=(0, 2))
                known, own = position_error(trace), own_error(trace)
                positions[row] = {
                    "rms": rms(known),
                    "p95": np.quantile(known, 0.95, axis=(0, 2)),
                    "own_rms": rms(own),
                }
                if row == "fim":
                    errors[BEST] = from_best_place(trace)
            teams[auvs] = {
                row: {"median": interval(values), "over_fim": interval(values, errors["fim"])}
                for row, values in errors.items()
            }
            for row, values in positions.items():
                teams[auvs][row] |= {name: interval(value) for name, value in values.items()}
            print(table(scenario, auvs, teams[auvs]), flush=True)
    return result


def table(scenario: str, auvs: int, rows: dict) -> str:
    lines = [
        f"{scenario}, {auvs} AUVs: median error of fixes, m (95 %), and over that of fim; estimates: rms, 95 %, m;"
        " the AUVs' own: rms, m"
    ]
    for row, found in rows.items():
        (m, low, high), (ratio, least, most) = found["median"], found["over_fim"]
        line = f"  {row:31s} {m:6.3f} ({low:.3f} to {high:.3f})   {ratio:5.2f} ({least:.2f} to {most:.2f})"
        if row != BEST:
            line += "".join(f"   {found[name][0]:6.3f}" for name in ("rms", "p95", "own_rms"))
        lines.append(line)
    return "\n".join(lines)


def draw(result: dict, ground: Ground) -> Figure:
    """Median error against the number of AUVs, one panel a scenario."""
    figure = Figure(figsize=(9.6, 5), layout="constrained")
    panels = figure.subplots(1, len(SCENARIOS), sharey=True)
    for panel, scenario in zip(panels, SCENARIOS, strict=True):
        for shift, (row, (colour, mark)) in enumerate(looks(ROWS, ground.colours).items()):
            m, low, high = np.array([result[scenario][auvs][row]["median"] for auvs in TEAMS]).T
            x = np.array(TEAMS) + 0.05 * (shift - len(ROWS) / 2)
            panel.errorbar(x, m, (m - low, high - m), fmt=f"{mark}-", ms=4, lw=1.2, color=colour, label=row)
        limit = [result[scenario][auvs][BEST]["median"][0] for auvs in TEAMS]
        label = "as the covariance says, from the best place at once"
        panel.plot(TEAMS, limit, "--", color=ground.text, lw=1.2, label=label)
        panel.set(title=scenario, xlabel="number of AUVs", xticks=TEAMS, ylim=(0, None))
    panels[0].set(ylabel="median horizontal error of fixes, m")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON after the table")
    parser.add_argument("--out", type=Path, help="X.png: figures X-light.png and X-dark.png to write")
    parser.add_argument("--episodes", type=int, default=50)
    parser.add_argument("--seed", type=int, default=2026)
    arguments = parser.parse_args()
    result = measure(arguments.episodes, arguments.seed)
    if arguments.out:
        write_pair(arguments.out, partial(draw, result))
    if arguments.json:
        print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
