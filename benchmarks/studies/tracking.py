"""Errors of tracked targets by rule and setting, beside published ones, and what not knowing one's place costs.

    python -m benchmarks.studies.tracking
    python -m benchmarks.studies.tracking --part deeper
    python -m benchmarks.studies.tracking --part measurements
    python -m benchmarks.studies.tracking --part depths
    python -m benchmarks.studies.tracking --part few
    python -m benchmarks.studies.tracking --part rare
    python -m benchmarks.studies.tracking --runs runs/hard --runs runs/expert --out docs/learned-tracking.png

First `tracking-plain`, by team and setting of the published environment: the error of the estimates of the AUV with the
smallest range, after the first 20 steps, its median and its mean over worlds, targets and steps, the latter with the
95 % interval over worlds, its root mean square beside the posterior Cramér–Rao bound of that for the same ways
(`usvauv.env.record.tracking_metrics.least_error`), and NEES/2, which is 1 where filters are consistent. `published` has
median and mean of that environment's particle filter with its AUVs on a circle of 60 m, measured in it.

Then `tree` with more steps, three on three; differences from `tree:3` are paired.

Then what is measured, three on three at hard: ranges of 10 m, bearings of 3°, both; ranges of signals that fade.

Then depths, known or not, with AUVs that turn freely: targets as at hard, and ones that go straight.

Then fewer AUVs than targets: with AUVs that keep to a target, and that go to those of which they know least; the
difference is paired.

Then `tracking`: the same by the boat's strategy, by a look ahead of the AUVs, with a boat that does not listen to
targets, without one, and with places known exactly; differences from `belief` are paired.
Then with rare fixes, and with the share of targets within the ellipse of 95 % of their estimate.

With `--runs`, folders of training runs instead, those of a folder with one team at one setting and with different
seeds: their curves, and the errors of their last policies at that setting, an AUV's alone or teams', beside those of
rules in the same worlds, with the 95 % interval over seeds and worlds together.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.machine import command_line, describe, parse, show
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.env.record.metrics import own_error
from usvauv.env.record.recorder import record
from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_metrics import least_error, nees, settled, track_error
from usvauv.env.render.figures import write_pair
from usvauv.env.render.style import Ground
from usvauv.kernels.mission.tasks.tracking_columns import TargetColumn
from usvauv.policies.checkpoint import ENDING, LAST, path_of, read_history, read_run

SETTINGS = {  # share of the AUVs' speed, and time between turns, s: 5 to 14 steps, or 2 to 9
    "easy": ((0.0, 0.35), (120.0, 420.0)),
    "medium": ((0.15, 0.5), (30.0, 270.0)),
    "hard": ((0.5, 0.7), (120.0, 420.0)),
    "expert": ((0.83, 0.86), (120.0, 420.0)),
}
TEAMS = (1, 3, 5)
RULES = ("straight", "circle", "tree:1", "tree:3")
DEEPER = ("tree:1", "tree:4", "tree:5")
RIVALS = ("circle", "tree:1", "tree:3")  # of learned policies
SPEED = 0.986  # m/s, of the AUVs
PUBLISHED = {
    (1, "easy"): "10.8 (13.4)",
    (1, "medium"): "13.0 (16.3)",
    (1, "hard"): "20.9 (29.4)",
    (1, "expert"): "51.9",
    (3, "easy"): "9.4 (10.9)",
    (3, "medium"): "11.1 (12.6)",
    (3, "hard"): "22.0 (32.0)",
    (3, "expert"): "58.1",
}
PLACES = {  # boat, rule of the AUVs, changes
    "belief": ("belief", "circle", ()),
    "belief, AUVs by tree:3": ("belief", "tree:3", ()),
    "belief, does not listen": ("belief", "circle", ("task_parameters.boat_listens=0",)),
    "fim": ("fim", "circle", ()),
    "hold": ("hold:1200,1200", "circle", ()),  # the middle
    "none": ("hold:1200,1200", "circle", ("task_parameters.boat_listens=0", "channel.interval=3600")),
    "places known": ("belief", "circle", ("task_parameters.places_known=1",)),
}
FEW = ((1, 2), (2, 4), (2, 8))  # AUVs and targets
MEASUREMENTS = {
    "ranges": (),
    "ranges, signals of 60 dB excess at 1 m fade": ("signal_excess=60",),
    "bearings": ("ranges=0", "bearing_noise=0.052"),
    "ranges and bearings": ("bearing_noise=0.052",),
}
DEPTHS = {
    "5 to 20 m, known": ("depths_known=1",),
    "5 to 20 m, not known": ("depths_known=0",),
    "5 to 80 m, known": ("depths_known=1", "depth_most=80"),
    "5 to 80 m, not known": ("depths_known=0", "depth_most=80"),
}
COURSES = {"turn": (), "go straight": ("turn_after_most=0",)}
PARTS = ("rules", "deeper", "measurements", "depths", "few", "places", "rare", "rates")
INTERVALS = (0, 60, 180, 600)  # s, from one fix to the next, at least
NORMAL, ELLIPSE = 1.96, 5.991  # of 95 %: of a normal number; of a χ² with two degrees of freedom


def setting(name: str, team: int, *more: str, targets: int = 0, task: str = "tracking-plain") -> Scenario:
    """`tracking-plain` with a team of AUVs, as many targets or `targets` of a setting, and more task parameters."""
    (slowest, fastest), (soonest, latest) = SETTINGS[name]
    numbers = {
        "target_speed_least": slowest * SPEED,
        "target_speed_most": fastest * SPEED,
        "turn_after_least": soonest,
        "turn_after_most": latest,
    }
    given = [*(f"{key}={value:.4g}" for key, value in numbers.items()), *more]
    changes = [f"task_parameters.{each}" for each in given]
    count = [f"auv.count={team}", f"nodes.count={targets or team}", f"task={task}"]
    return Scenario.load("tracking-plain", [*count, *changes])


def run(scenario: Scenario, rule: str, worlds: int, seed: int, usv: str | None = None) -> Trace:
    """A trace of worlds."""
    world = World(scenario, worlds, seed, usv)
    return record(world, policies.load(rule, world).act, rule)


def by_world(values: np.ndarray) -> np.ndarray:
    """Means (W,) of values (T, W, M) that may be missing."""
    return np.nanmean(np.moveaxis(values, 1, 0).reshape(values.shape[1], -1), axis=1)


def errors(trace: Trace) -> np.ndarray:
    """Errors of a trace, (T, W, M), m, from when it has settled."""
    return track_error(trace)[settled(trace)]


def bounds(trace: Trace, depth: np.ndarray | None = None) -> np.ndarray:
    """Their bounds, likewise, for targets of depths (W, M), m, else of a middle one."""
    return least_error(trace, depth)[settled(trace)]


def mean_errors(trace: Trace) -> np.ndarray:
    """Means of its errors in each world, (W,), m."""
    return by_world(errors(trace))


def interval(values: np.ndarray, digits: int = 1) -> str:
    """Mean of values (W,) and half of its 95 % interval."""
    return f"{values.mean():.{digits}f} ± {NORMAL * values.std(ddof=1) / np.sqrt(len(values)):.{digits}f}"


def root_mean(values: np.ndarray) -> float:
    """Root mean square of values."""
    return float(f"{np.sqrt(np.square(values).mean()):.1f}")


def figures(trace: Trace, depth: np.ndarray | None = None) -> dict[str, object]:
    """Errors of a trace, and their bound, see `bounds`."""
    error, squared = errors(trace), nees(trace)[settled(trace)]
    return {
        "median, m": float(f"{np.median(error):.1f}"),
        "mean, m": interval(by_world(error)),
        "95 %, m": float(f"{np.quantile(error, 0.95):.1f}"),
        "rms, m": root_mean(error),
        "bound, m": root_mean(bounds(trace, depth)),
        "NEES/2": interval(by_world(squared) / 2, 2),
        "in ellipses of 95 %": float(f"{np.mean(squared[np.isfinite(squared)] < ELLIPSE):.2f}"),
    }


def plain(worlds: int, seed: int) -> list[dict[str, object]]:
    """Rows of all teams, settings and rules."""
    return [
        {"team": f"{team} on {team}", "setting": name, "rule": rule}
        | figures(run(setting(name, team), rule, worlds, seed))
        | {"published": PUBLISHED.get((team, name), "") if rule == "circle" else ""}
        for team in TEAMS
        for name in SETTINGS
        for rule in RULES
    ]


def deeper(worlds: int, seed: int) -> list[dict[str, object]]:
    """Rows of how much more steps of a look ahead are worth."""
    rows = []
    for name in [*SETTINGS][:3]:
        scenario = setting(name, 3)
        first = mean_errors(run(scenario, "tree:3", worlds, seed))
        for rule in DEEPER:
            gain = mean_errors(run(scenario, rule, worlds, seed)) - first
            rows.append({"setting": name, "rule": rule, "from tree:3, m": interval(gain, 2)})
    return rows


def measurements(worlds: int, seed: int) -> list[dict[str, object]]:
    """Rows of what is measured."""
    return [
        {"measured": row} | figures(run(setting("hard", 3, *changes), "circle", worlds, seed))
        for row, changes in MEASUREMENTS.items()
    ]


def depths(worlds: int, seed: int) -> list[dict[str, object]]:
    """Rows of what is known of depths."""
    rows = []
    for courses, straight in COURSES.items():
        for row, changes in DEPTHS.items():
            scenario = setting("hard", 3, *straight, *changes, task="tracking")
            world = World(scenario, worlds, seed)
            trace = record(world, policies.load("circle", world).act, "circle")
            deep = world.task_node[..., TargetColumn.depth].cpu().numpy()
            rows.append({"targets": courses, "depths": row} | figures(trace, deep))
    return rows


def few(worlds: int, seed: int) -> list[dict[str, object]]:
    """Rows of teams of fewer AUVs than targets."""
    rows = []
    for team, targets in FEW:
        for name in [*SETTINGS][:3]:
            kept, chosen = (
                run(setting(name, team, *more, targets=targets), "circle", worlds, seed)
                for more in (("uncertainty_weight=0",), ())
            )
            own, other = figures(chosen), figures(kept)
            rows.append(
                {
                    "team": f"{team} on {targets}",
                    "setting": name,
                    **{f"{figure} kept": other[figure] for figure in ("median, m", "mean, m", "rms, m", "bound, m")},
                    **own,
                    "from kept, m": interval(mean_errors(chosen) - mean_errors(kept)),
                }
            )
    return rows


def places(worlds: int, seed: int) -> list[dict[str, object]]:
    """Rows of what the AUVs know of their places."""
    traces = {
        row: run(Scenario.load("tracking", changes), rule, worlds, seed, usv)
        for row, (usv, rule, changes) in PLACES.items()
    }
    first = mean_errors(traces["belief"])
    return [
        {"boat": row}
        | figures(trace)
        | {
            "from belief, m": interval(mean_errors(trace) - first),
            "own error, m rms": root_mean(own_error(trace)),
        }
        for row, trace in traces.items()
    ]


def rare(worlds: int, seed: int) -> list[dict[str, object]]:
    """Rows of how rare fixes of the AUVs are."""
    rows = []
    for least in INTERVALS:
        trace = run(Scenario.load("tracking", [f"channel.interval={least}"]), "circle", worlds, seed, "belief")
        rows.append({"interval, s": least or "", "own error, m rms": root_mean(own_error(trace)), **figures(trace)})
    return rows


def rates(teams: Sequence[int], worlds: int) -> list[dict[str, object]]:
    """Steps of all worlds in a processor second, by team."""
    rows = []
    for team in teams:
        world = World(setting("hard", team), worlds, 0)
        policy, observation = policies.load("circle", world), world.reset()
        for _ in range(10):
            observation = world.step(policy.act(observation)).observation
        action, start = policy.act(observation), time.process_time()
        for _ in range(10):
            world.step(action)
        rows.append({"team": f"{team} on {team}", "steps/s": round(10 * worlds / (time.process_time() - start))})
    return rows


def trained_at(path: Path) -> tuple[str, int]:
    """The setting at which a policy was trained, by the speed of the fastest targets, and the number of AUVs."""
    scenario, *_ = read_run(path)
    fastest = scenario.task_numbers["target_speed_most"]
    return min(SETTINGS, key=lambda name: abs(SETTINGS[name][0][1] * SPEED - fastest)), scenario.auv.count


def learned(runs: Sequence[Path], worlds: int, seed: int) -> list[dict[str, object]]:
    """Rows of the last policies of training runs at their setting, beside the rules that follow targets."""
    rows, (name, count) = [], trained_at(runs[0])
    for team in [team for team in TEAMS if (team == 1) == (count == 1)]:
        scenario = setting(name, team)
        by_rule = {rule: errors(run(scenario, rule, worlds, seed)) for rule in RIVALS}
        best = min(by_rule, key=lambda rule: float(by_rule[rule].mean()))
        traces = [run(scenario, str(path_of(path, LAST)), worlds, seed) for path in runs]
        own = [errors(trace) for trace in traces]
        rows.append(
            {
                "team": f"{team} on {team}",
                "setting": name,
                "best rule": best,
                "its median, m": float(f"{np.median(by_rule[best]):.1f}"),
                "median, m": float(f"{np.median(own):.1f}"),
                "its mean, m": interval(by_world(by_rule[best])),
                "mean, m": float(f"{np.mean(own):.1f}"),
                "rms, m": root_mean(np.array(own)),
                "bound, m": root_mean(np.array([bounds(trace) for trace in traces])),
                "from the best rule, m": difference(own, by_rule[best]),
                "from circle, m": difference(own, by_rule["circle"]),
            }
        )
    return rows


def difference(learned: Sequence[np.ndarray], rule: np.ndarray) -> str:
    """Mean difference of errors, (T, W, M), of policies from those by a rule, with the seeds' extremes."""
    gain = np.array([by_world(each) - by_world(rule) for each in learned])  # (seeds, W)
    seeds = gain.mean(axis=1)
    variance = gain.mean(axis=0).var(ddof=1) / gain.shape[1]
    if len(seeds) > 1:
        variance += seeds.var(ddof=1) / len(seeds)
    return f"{gain.mean():.2f} ± {NORMAL * np.sqrt(variance):.2f} ({seeds.min():.2f} to {seeds.max():.2f})"


def curves(runs: Sequence[Path]) -> list[dict[str, object]]:
    """Margins of the team's ARPS over that of `circle` in the evaluations of training runs."""
    histories, (name, count) = [read_history(path) for path in runs], trained_at(runs[0])
    rows = [(int(each[0]["steps"]), [own["margin"] for own in each]) for each in zip(*histories, strict=True)]
    return [
        {"trained": f"{count} on {count}, {name}", "steps": steps, "mean": float(np.mean(margins))}
        | {path.name: margin for path, margin in zip(runs, margins, strict=True)}
        for steps, margins in rows
    ]


def draw(rows: Sequence[dict[str, Any]], ground: Ground) -> Figure:
    """The curves of each run and their mean, a panel for each team and setting, two in a row."""
    names = list(dict.fromkeys(row["trained"] for row in rows))
    lines = (len(names) + 1) // 2
    figure = Figure(figsize=(7.2, 2.2 * lines), layout="constrained")
    panels = [*figure.subplots(lines, 2, squeeze=False).flat]
    for unused in panels[len(names) :]:
        unused.remove()
    for axes, name in zip(panels, names, strict=False):
        steps, mean, *each = np.array([[*row.values()][1:] for row in rows if row["trained"] == name]).T
        for margins in each:
            axes.plot(steps / 1000, margins, color=ground.muted, lw=0.8)
        axes.plot(steps / 1000, mean, "o-", color=ground.colours[0], ms=4, label="mean of the seeds")
        axes.axhline(0.0, ls="--", lw=1.2, color=ground.text, label="circle")
        axes.set_title(name)
        axes.set_ylim(bottom=-0.25 * mean.max())  # which networks that begin untrained are far below
    panels[0].legend(loc="center right")
    figure.supxlabel("thousands of world-steps")
    figure.supylabel("ARPS of the team, over circle's")
    return figure


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--episodes", type=int, default=200, help="worlds of each row")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--part", choices=PARTS, help="one table; default all")
    parser.add_argument(
        "--runs", type=Path, action="append", help="folder of training runs, one for each seed; repeatable"
    )
    parser.add_argument("--out", type=Path, help="X.png: figures X-light.png and X-dark.png of their curves to write")
    arguments = parse(parser)
    worlds, seed = arguments.episodes, arguments.seed
    result: dict[str, Any] = {"machine": describe(), "episodes": worlds, "seed": seed}
    if arguments.runs:
        teams = [sorted(path.parent for path in folder.glob(f"*/{LAST}{ENDING}")) for folder in arguments.runs]
        if not all(teams):
            parser.error(f"--runs {arguments.runs[teams.index([])]}: has no training runs")
        result["curves"] = [row for runs in teams for row in curves(runs)]
        result["learned"] = [row for runs in teams for row in learned(runs, worlds, seed)]
        if arguments.out:
            write_pair(arguments.out, partial(draw, result["curves"]))
        show(result, arguments.json)
        return
    parts = {
        "rules": ("tracking-plain", lambda: plain(worlds, seed)),
        "deeper": ("tracking-plain, three on three, by steps of the look ahead", lambda: deeper(worlds, seed)),
        "measurements": (
            "tracking-plain, three on three, hard, by what is measured",
            lambda: measurements(worlds, seed),
        ),
        "depths": (
            "tracking-plain with AUVs that turn freely, three on three, hard, by what is known of depths",
            lambda: depths(worlds, seed),
        ),
        "few": ("tracking-plain, fewer AUVs than targets", lambda: few(max(2, worlds // 2), seed)),
        "places": ("tracking", lambda: places(max(2, worlds // 4), seed)),
        "rare": ("tracking, by the time between fixes", lambda: rare(max(2, worlds // 4), seed)),
        "rates": ("steps of all worlds in a second of a processor, hard", lambda: rates(TEAMS, max(64, 4 * worlds))),
    }
    chosen = [arguments.part] if arguments.part else parts
    show(result | {title: make() for title, make in (parts[name] for name in chosen)}, arguments.json)


if __name__ == "__main__":
    main()
