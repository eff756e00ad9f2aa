"""Agent-steps a second against the numbers of worlds, AUVs, nodes, vortices and boats, beside the machine's limits.

    python -m benchmarks.curves --out docs/curves.png

Two limits stand beside each rate, neither of which a program on this machine could pass. Memory: all tensors that a
world has of its own are read and written once a step, at the measured bandwidth. Operations: the vortices alone, at one
pass of `PLACES` places for each AUV, at the measured rate of matrix products, in which every operation is half of a
fused one. What a batch holds in caches may pass the first. Processor time, that of all threads, is the same with other
programs beside this one, the rates are not.
"""

from __future__ import annotations

import json
import time
from functools import partial
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any

import torch
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from benchmarks.machine import best_time, command_line, describe, parse
from benchmarks.worlds import CYCLE, LEAD, measure_memory, rates, stepper
from usvauv.env import Scenario, World
from usvauv.env.render.figures import write_pair
from usvauv.env.render.style import Ground
from usvauv.kernels import runtime
from usvauv.kernels.flow import vortex

WORLDS = 1024
CURVES: dict[str, tuple[str, str, tuple[int, ...]]] = {
    "worlds": ("extreme", "", tuple(4**power for power in range(10))),
    "AUVs": ("extreme", "auv.count", (2, 4, 8, 16, 32, 64)),
    "nodes": ("extreme", "nodes.count", (30, 100, 250, 500, 1000)),
    "vortices": ("extreme", "current.count", (1, 4, 9, 16, 36, 64, 144, 256)),
    "boats": ("wide", "boat.count", (1, 2, 4, 8)),
}
CLOSE = "auv.start_separation=10"  # with which 64 AUVs have room
SIZE = 2048  # of the square matrices whose product is timed
TRIAD = 1 << 26  # numbers of each array whose triad is timed, far more than any cache holds
LINES = {"rate": ("measured", "-o"), "memory": ("limit of memory", "--"), "operations": ("limit of operations", ":")}
SUMMED = 6  # operations on what a vortex induces: the way from it, its circulation, and two sums


class Counted:
    """A number that counts the operations of which it is an operand."""

    made = 0

    def count(self, *_: object) -> Counted:
        Counted.made += 1
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = count


def operations(period: float) -> int:
    """Floating-point operations of a vortex at a place, counted as `vortex.current` does them."""
    count = Counted.count
    names: dict[str, Any] = vars(vortex) | {
        "ti": SimpleNamespace(static=lambda value: value, floor=count, min=count, max=count)
    }
    for function in (vortex.core, vortex.images, vortex.induced):
        plain: Any = function
        names[plain.__name__] = FunctionType(plain.__wrapped__.__code__, names)
    Counted.made = 0
    names["induced"](Counted(), Counted(), Counted(), period)
    return Counted.made + SUMMED


def limits_of_machine() -> dict[str, float]:
    """Bytes and floating-point operations a second that this machine reaches."""
    running = runtime.start()
    left, right = torch.ones(2, SIZE, SIZE, device=running.device)
    a, b, c = torch.ones(3, TRIAD, device=running.device)
    torch.set_num_threads(running.threads)
    found = {
        "bytes": 3 * a.element_size() * TRIAD / best_time(lambda: torch.add(b, c, alpha=0.5, out=a)),
        "operations": 2 * SIZE**3 / best_time(lambda: torch.mm(left, right)),
    }
    torch.set_num_threads(1)
    return found


def processor_time(world: World) -> float:
    """Seconds of an agent-step, of all threads together."""
    step = stepper(world, None)
    for _ in range(LEAD):
        step()
    runtime.synchronize()
    begin = time.process_time()
    for _ in range(4 * CYCLE):
        step()
    runtime.synchronize()
    return (time.process_time() - begin) / (4 * CYCLE * world.num_worlds * world.num_auvs)


def measure(name: str, count: int, worlds: int, machine: dict[str, float], seconds: float) -> dict[str, float]:
    """Rate and processor time of one point of a curve, and the rates that the machine's limits allow."""
    scenario_name, field, _ = CURVES[name]
    scenario = Scenario.load(scenario_name, [CLOSE, f"{field}={count}"] if field else [])
    world = World(scenario, worlds if field else count)
    vortices = scenario.current.count * vortex.PLACES * operations(scenario.current.period)
    moved = 2 * measure_memory(world)["bytes_per_world"] / world.num_auvs
    return {
        "count": count,
        "worlds": world.num_worlds,
        "rate": rates(world, None, seconds)["agent_steps_per_second"],
        "processor_time": processor_time(world),
        "memory": machine["bytes"] / moved,
        "operations": machine["operations"] / max(vortices, 1),
    }


def draw(found: dict[str, list[dict[str, float]]], ground: Ground) -> Figure:
    """A panel a curve: the rate and its limits, on logarithmic axes."""
    figure = Figure(figsize=(9.6, 5.4), layout="constrained")
    panels = figure.subplots(2, 3, sharey=True).ravel()
    for axes, (name, rows) in zip(panels, found.items(), strict=False):
        counts = [int(row["count"]) for row in rows]
        for colour, (key, (label, style)) in zip(ground.colours, LINES.items(), strict=False):
            axes.plot(counts, [row[key] for row in rows], style, color=colour, label=label, ms=4)
        axes.set_xscale("log", base=2)
        axes.set_yscale("log")
        axes.set_xticks(counts, [f"{count:,}" if count < 1024 else f"{count // 1024}k" for count in counts])
        axes.minorticks_off()
        axes.set_title(name)
    for axes in panels[::3]:
        axes.set_ylabel("agent-steps a second")
        axes.yaxis.set_major_formatter(EngFormatter(sep=""))
    panels[-1].axis("off")
    panels[-1].legend(*panels[0].get_legend_handles_labels(), loc="center")
    return figure


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--worlds", type=int, default=WORLDS, help="of the curves against other numbers")
    parser.add_argument("--seconds", type=float, default=1.0, help="time spent on each rate, s")
    parser.add_argument("--out", type=Path, help="X.png: figures X-light.png and X-dark.png to write")
    arguments = parse(parser)
    print(json.dumps(describe()))
    machine = limits_of_machine()
    print(f"{machine['bytes'] / 1e9:.1f} GB/s, {machine['operations'] / 1e9:.0f} G operations/s")
    print("| item | number | worlds | M agent-steps/s | processor µs | limit of memory | limit of operations | share |")
    found: dict[str, list[dict[str, float]]] = {}
    for name, (_, field, counts) in CURVES.items():
        for count in counts:
            if not field and count > 16 * arguments.worlds:  # which fill no more of the machine
                continue
            row = measure(name, count, arguments.worlds, machine, arguments.seconds)
            found.setdefault(name, []).append(row)
            rate, memory, operated = (row[key] / 1e6 for key in ("rate", "memory", "operations"))
            share, processor = rate / min(memory, operated), 1e6 * row["processor_time"]
            print(
                f"| {name} | {count} | {row['worlds']} | {rate:.3f} | {processor:.2f} | {memory:.1f} |"
                f" {operated:.1f} | {share:.1%} |",
                flush=True,
            )
    if arguments.json:
        print(json.dumps(found, indent=1))
    if arguments.out:
        write_pair(arguments.out, partial(draw, found))


if __name__ == "__main__":
    main()
