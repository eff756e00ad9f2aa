"""Where the time of a mission step goes: each stage of the step in a launch of its own.

    python -m benchmarks.step_profile --out docs/step-profile.png
    python -m benchmarks.step_profile wide --out docs/step-profile-wide.png

The stages of a step come one after another as in a step of the world, each timed, with the sea, which all worlds share,
and the vehicles before them. A launch without work is measured too, and subtracted. A round has as many steps as it
takes for all that does not come in each; of each stage the best round counts, because other programs can only make one
longer. "rest" is the whole step, timed in the same rounds, less the parts: actions copied, calls, random numbers and
checks of all numbers.
"""

import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import taichi as ti
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from benchmarks.machine import command_line, describe
from benchmarks.worlds import CYCLE, LEAD, stepper
from usvauv.env import Scenario, World
from usvauv.env.render.figures import write_pair
from usvauv.env.render.style import Ground
from usvauv.kernels import runtime
from usvauv.kernels.functions import func
from usvauv.kernels.mission.run import STEP

BATCHES = (1024, 4096)
ROUNDS = 15
PARTS = {
    "vehicles": ("_sail", "move_auvs"),
    "currents": ("_renew_vortices", "move_vortices", "add_storm_currents", "add_currents"),
    "long waves": ("sea",),
    "boats and their plans": ("prepare", "plan", "move_boats", "ride"),
    "exchanges and fixes": ("hear", "fix", "estimate", "add_common_errors"),
    "targets, data, reward": ("begin_step", "end_step"),
    "observation": ("prepare_next_step", "observe"),
}


@func
def nothing(worlds: ti.template(), w):
    """A stage without work."""


def seconds(work: Callable[[], None], repeats: int) -> float:
    """Mean time of a call in one round."""
    begin = time.perf_counter()
    for _ in range(repeats):
        work()
    runtime.synchronize()
    return (time.perf_counter() - begin) / repeats


def measure(scenario: str, worlds: int) -> dict[str, float]:
    """Seconds of a step of all worlds, whole, by part, and the rest."""
    world, other = (World(Scenario.load(scenario), worlds) for _ in range(2))
    step, whole = stepper(world, None), stepper(other, None)
    for _ in range(LEAD):
        step()
        whole()
    kernels = world._kernels
    before = {part.__name__ if part == kernels._renew_vortices else "_sail": part for part in kernels.before_stages}
    stages = {stage.__name__: kernels.launch_of(stage) for stage in (nothing, *STEP)}
    calls = {"sea": world.sea.advance, **before, **stages, "step": whole}
    for call in calls.values():
        call()
    best = dict.fromkeys(calls, float("inf"))
    for _ in range(ROUNDS):
        spent = dict.fromkeys(calls, 0.0)
        for _ in range(CYCLE):
            for name, call in calls.items():
                spent[name] += seconds(call, 1) / CYCLE
        best = {name: min(least, spent[name]) for name, least in best.items()}
    empty = best["nothing"]
    parts = {
        part: sum(best[name] if name == "sea" else max(best[name] - empty, 0.0) for name in names if name in best)
        for part, names in PARTS.items()
    }
    return {"whole": best["step"], **parts, "rest": max(best["step"] - sum(parts.values()), 0.0)}


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
    figure.legend(loc="outside upper center", ncols=4)
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
