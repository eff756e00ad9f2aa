"""Errors of fixes by coded pulses without and with reflections, by both models, and what a fix costs.

    python -m benchmarks.studies.multipath

`ideal` with a fix in each step and no error but noise, the boat in the middle of the area, AUVs all over it. For each
water and wind: the surface's and the bottom's excess delay in chips of 1/B for an AUV at the middle distance; the root
mean square error of good fixes by noise alone, by the closed form of `usvauv.kernels.positioning.reflections`, by the
statistical model and by sampled pulses; the share of sampled fixes that are good without and with reflections. Then
the time of a step of all worlds over the number of fixes.
"""

from __future__ import annotations

import argparse
import json
import math

import numpy as np
import torch

from benchmarks.machine import best_time, describe
from usvauv.env import Scenario, World
from usvauv.env.accuracy.fix_errors import error_budget, reflection_errors
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import boundaries, link_table
from usvauv.kernels import runtime
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.positioning import usbl

QUIET = (
    "channel.schedule=every-step",
    "navigation.sensor=none",
    "usbl.propagation=false",
    *(f"usbl.{name}_error=0" for name in ("attitude", "alignment", "heading", "lever_arm", "gnss")),
    "acoustics.sound_speed_error=0",
    "nodes.count=4",
)
WATERS = {  # side of the area, depths of AUVs and of the water, m
    "100 m below, side 200 m": (200, 100, 120),
    "40 m below, side 1000 m": (1000, 40, 60),
    "20 m below, side 400 m": (400, 20, 30),
}
WINDS = (0, 2, 5, 10)
MODELS = {"statistical": (), "waveform": ("usbl.model=waveform",)}
REFLECTING = ("acoustics.multipath=true",)


def scenario(water: str, wind: float, *changes: str) -> Scenario:
    side, auv, depth = WATERS[water]
    size = (f"area.width={side}", f"area.length={side}", f"sea.cell_size={side / 50:g}")
    place = (f"auv.depth={auv}", f"area.depth={depth}", f"acoustics.wind={wind}")
    return Scenario.load("ideal", [*QUIET, *size, *place, *changes])


def fixes(setting: Scenario, worlds: int, seed: int) -> tuple[World, np.ndarray, np.ndarray]:
    """The world after two steps, and its fixes' errors (n,), m, and whether they are good (n,)."""
    middle = f"hold:{setting.area.width / 2:g},{setting.area.length / 2:g}"
    world = World(setting, worlds, seed, middle)
    world.reset()
    for _ in range(2):
        world.step(torch.zeros(worlds, world.num_auvs, 2, device=world.device))
    auv = world.auv.double().cpu().numpy().reshape(-1, len(AuvColumn.names))
    error = np.linalg.norm(auv[:, AuvColumn.span("fix_x", "fix_y")] - auv[:, :2], axis=1)
    return world, error, auv[:, AuvColumn.fix_flags] == usbl.DETECTED


def rms(error: np.ndarray) -> float:
    return math.sqrt(np.mean(error**2))


def closed_form(setting: Scenario, world: World, good: np.ndarray) -> float:
    """Rms error by noise and reflections of the AUVs whose fixes are good."""
    link = torch.from_numpy(link_table(Site(setting))).to(world.device)
    auv = world.auv[..., :2].double().cpu().numpy().reshape(-1, 2)
    places = [(x, y, setting.auv.depth) for x, y in auv]
    boat = setting.area.width / 2, setting.area.length / 2
    noise = error_budget(setting, link.repeat(world.num_worlds, 1), places, boat, "fix", (0.0, 0.0))["noise"]
    reflected = reflection_errors(Site(setting), link, places, boat)
    return math.hypot(rms(np.array(noise)[good]), rms(np.array(reflected)[good]))


def excess(setting: Scenario) -> list[float]:
    """Δ · B of surface and bottom for an AUV at a quarter of the diagonal from the boat."""
    array, water, *_ = boundaries(Site(setting))
    away, below = setting.area.diagonal / 4, setting.auv.depth
    chip = setting.acoustics.sound_speed / setting.acoustics.bandwidth
    lengths = [math.hypot(away, below + 2 * array), math.hypot(away, 2 * (water - array) - below)]
    return [(length - math.hypot(away, below)) / chip for length in lengths]


def measure(water: str, wind: float, worlds: int, seed: int) -> dict[str, object]:
    row: dict[str, object] = {"water": water, "wind": wind, "excess": excess(scenario(water, wind))}
    _, error, good = fixes(scenario(water, wind, *MODELS["waveform"]), worlds, seed)
    row["noise"], row["good_without"] = rms(error[good]), good.mean()
    for name, changes in MODELS.items():
        setting = scenario(water, wind, *changes, *REFLECTING)
        world, error, good = fixes(setting, worlds, seed)
        row[name], row["good"] = rms(error[good]), good.mean()
        row["closed form"] = closed_form(setting, world, good)
    return row


def cost(worlds: int, seed: int) -> dict[str, float]:
    """Time of a step over the number of fixes, µs."""
    found = {}
    for name, changes in MODELS.items():
        for reflections in ((), REFLECTING):
            setting = scenario("100 m below, side 200 m", 5, *changes, *reflections)
            world, _, _ = fixes(setting, worlds, seed)
            still = torch.zeros(worlds, world.num_auvs, 2, device=world.device)
            taken = best_time(lambda w=world, a=still: w.step(a), 2.0)
            found[name + (", reflections" if reflections else "")] = 1e6 * taken / worlds / world.num_auvs
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON after the tables")
    parser.add_argument("--worlds", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=5)
    arguments = parser.parse_args()
    runtime.start()
    print(f"{arguments.worlds} worlds, seed {arguments.seed}; {describe()}")
    print("| AUVs | wind, m/s | Δ · B | noise, m | closed form, m | statistical, m | waveform, m | good |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    rows = []
    for water in WATERS:
        for wind in WINDS:
            row = measure(water, wind, arguments.worlds, arguments.seed)
            chips = ", ".join(f"{value:.1f}" for value in row["excess"])
            errors = " | ".join(f"{row[name]:.2g}" for name in ("noise", "closed form", *MODELS))
            print(
                f"| {water} | {wind} | {chips} | {errors} | {row['good_without']:.1%}, {row['good']:.1%} |", flush=True
            )
            rows.append(row)
    costs = cost(arguments.worlds, arguments.seed)
    print("| model | µs per step and AUV |")
    print("| --- | --- |")
    for name, value in costs.items():
        print(f"| {name} | {value:.2g} |")
    if arguments.json:
        print(json.dumps({"rows": rows, "cost": costs}, indent=1))


if __name__ == "__main__":
    main()
