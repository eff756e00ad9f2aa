"""Where the time of a mission step goes, by leaving parts out: a scenario with everything on, and without each part.

    python -m benchmarks.step_profile --out docs/step-profile.png
    python -m benchmarks.step_profile wide --out docs/step-profile-wide.png

A part's time is the difference between a step with it and the step without it, so parts that share work are each
counted with it, and what no part claims is the rest: fixes, motion, targets, observation, reward. Dead reckoning cannot
be left out under plans that need it, nor exchanges under dead reckoning: they are timed in steps without these. The
long waves are timed by themselves: all worlds share them. Versions take turns, and of each the best round counts,
because other programs can only make a round longer.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from benchmarks.machine import command_line, describe
from benchmarks.worlds import CYCLE, LEAD, stepper
from usvauv.env import Scenario, World
from usvauv.env.render.style import Ground, write_pair
from usvauv.kernels import runtime

BATCHES = (1, 64, 4096)
UNAIDED = "navigation.sensor=none"
PLAN, RECKONING = "the boat's plan", "dead reckoning and its filters"
BASE = {RECKONING: PLAN, "exchanges": RECKONING}  # of what a version leaves a part out, if not of the whole
ROUNDS = 15


def seconds(work: Callable[[], None], repeats: int) -> float:
    """Mean time of a call in one round."""
    begin = time.perf_counter()
    for _ in range(repeats):
        work()
    runtime.synchronize()
    return (time.perf_counter() - begin) / repeats


def variants(name: str) -> dict[str, tuple[str | None, tuple[str, ...]]]:
    """What is left out → strategy of the boat, None the scenario's, and changes of the scenario."""
    scenario = Scenario.load(name)
    count, centre = scenario.auv.count, f"hold:{scenario.area.width / 2:g},{scenario.area.length / 2:g}"
    return {
        "whole": (None, ()),
        PLAN: (centre, ()),
        RECKONING: (centre, (UNAIDED,)),
        "exchanges": (centre, (UNAIDED, "channel.schedule=every-step")),
        "vortices": (None, ("current.count=0", "current.mutual=false", "current.viscosity=0")),
        "storm waves": (None, ("storm.spectrum=none",)),
        f"{scenario.nodes.count - count} of {scenario.nodes.count} nodes": (None, (f"nodes.count={count}",)),
    }


def measure(scenario: str, worlds: int) -> dict[str, float]:
    """Seconds of a step of all worlds, whole and by part."""
    versions = {
        name: World(Scenario.load(scenario, settings), worlds, usv=usv)
        for name, (usv, settings) in variants(scenario).items()
    }
    works = {name: stepper(world, None) for name, world in versions.items()}
    for work in works.values():
        for _ in range(LEAD):
            work()
    works["long waves"] = versions["whole"].sea.advance
    repeats = max(CYCLE, 3000 // worlds)
    best = dict.fromkeys(works, float("inf"))
    for _ in range(ROUNDS):
        for name, work in works.items():
            best[name] = min(best[name], seconds(work, repeats))
    whole, waves = best["whole"], best.pop("long waves")
    parts = {"long waves": waves} | {
        part: max(best[BASE.get(part, "whole")] - without, 0.0) for part, without in best.items() if part != "whole"
    }
    parts["rest: motion, fixes, targets, observation, reward"] = max(whole - sum(parts.values()), 0.0)
    return {"whole": whole, **parts}


def readable_on(colour: str) -> str:
    """Black or white, for text on a colour."""
    red, green, blue = to_rgb(colour)
    return "black" if 0.299 * red + 0.587 * green + 0.114 * blue > 0.5 else "white"


def draw(result: dict, ground: Ground) -> Figure:
    """One bar a batch size: shares of the step's time."""
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.grid(visible=False)
    for row, parts in enumerate(result["batches"].values()):
        left = 0.0
        whole = sum(value for name, value in parts.items() if name != "whole")
        for colour, (name, value) in zip(ground.colours, list(parts.items())[1:], strict=True):
            share = 100 * value / whole
            axes.barh(row, share, left=left, color=colour, label=name if row == 0 else None)
            if share > 4:
                at, ink = left + share / 2, readable_on(colour)
                axes.text(at, row, f"{share:.0f}", ha="center", va="center", fontsize=9, color=ink)
            left += share
        step = f"{1e6 * parts['whole']:.0f} µs" if parts["whole"] < 1e-3 else f"{1e3 * parts['whole']:.1f} ms"
        axes.text(101, row, f"{step} a step", va="center", fontsize=9)
    axes.set(yticks=range(len(BATCHES)), yticklabels=[f"{w:,} world{'s' * (w > 1)}" for w in BATCHES], xlim=(0, 117))
    axes.set(xlabel="share of a mission step, %")
    figure.legend(loc="outside upper center", ncols=3)
    return figure


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("scenario", nargs="?", default="extreme")
    parser.add_argument("--out", type=Path, help="X.png: figures X-light.png and X-dark.png to write")
    arguments = parser.parse_args()
    result = {
        "machine": describe(),
        "scenario": arguments.scenario,
        "batches": {worlds: measure(arguments.scenario, worlds) for worlds in BATCHES},
    }
    print(json.dumps(result, indent=1))
    if arguments.out:
        write_pair(arguments.out, partial(draw, result))


if __name__ == "__main__":
    main()
