"""A thousand steps of a scenario on another architecture, beside the same steps on the CPU.

    python -m tests.trials.architectures --arch vulkan --steps 1000 --worlds 4 --seed 1
    python -m tests.trials.architectures wide --set nodes.count=60 --arch vulkan --steps 3

The policy `straight` steers, so that services happen. Each world is compared until one of its events (a new target, the
begin or end of hovering) falls on another step than on the CPU: afterwards it is another mission. Rounding differs,
because sin, cos, exp and log of a graphics processor are looser than the CPU's, and grows as AUVs follow their fixes.
A deviation that matters is larger than the tolerance of its quantity; then the exit code is 1. It is also 1 when the
worlds were compared for less than half of their steps together.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

# Tolerance, and what it is small against.
QUANTITIES = {
    "position m": (0.003, "a fix's error of 0.45 m"),
    "estimate m": (0.003, "a fix's error of 0.45 m"),
    "current m/s": (0.001, "an AUV's speed of 1.2 m/s or more"),
    "power W": (0.01, "80 W of a mission"),
    "boat m": (0.01, "100 m to an AUV; the optimum is flat"),
    "wave m": (0.001, "waves of 5 m"),
    "reward": (0.01, "a service's worth, and the mean of about 1"),
    "sea m": (0.001, "long waves of 5 m"),
}


def run(scenario: str, overrides: list[str], arch: str, steps: int, worlds: int, seed: int, out: Path) -> None:
    """One run, in this process: an array (steps, worlds, …) of each quantity and of the events."""
    from usvauv import policies
    from usvauv.env import Scenario, World
    from usvauv.kernels.mission.columns import AuvColumn, BoatColumn

    world = World(Scenario.load(scenario, overrides), worlds, seed, arch=arch)
    policy = policies.load("straight", world)
    rows: dict[str, list[np.ndarray]] = {}
    observation = world.reset()
    for _ in range(steps):
        observation, reward, *_ = world.step(policy.act(observation))
        auv, boat = world.auv.cpu().numpy(), world.boat.cpu().numpy()
        found = {
            "position m": auv[..., AuvColumn.span("x", "y")],
            "estimate m": world.estimate[..., :2].cpu().numpy(),
            "current m/s": auv[..., AuvColumn.span("current_x", "current_y")],
            "power W": auv[..., AuvColumn.power],
            "boat m": boat[..., BoatColumn.span("x", "y")],
            "wave m": boat[..., BoatColumn.elevation],
            "reward": reward.cpu().numpy(),
            "sea m": np.abs(world.sea.elevation()).max(axis=(1, 2))[world._water.sea_index.cpu().numpy()],
            "events": auv[..., [AuvColumn.target, AuvColumn.hovering]],
            "services": auv[..., AuvColumn.service_rate] > 0,
        }
        for name, value in found.items():
            rows.setdefault(name, []).append(value.copy())
    np.savez(out, **{name: np.stack(values) for name, values in rows.items()})


def compare(here: dict[str, np.ndarray], cpu: dict[str, np.ndarray]) -> bool:
    """Print deviations; whether all are within their tolerances."""
    steps, worlds = cpu["events"].shape[:2]
    differ = (here["events"] != cpu["events"]).reshape(steps, worlds, -1).any(axis=2)
    until = np.where(differ.any(axis=0), differ.argmax(axis=0), steps)
    compared = np.arange(steps)[:, None] < until
    print(f"compared until step {', '.join(map(str, until))} of {steps}: {compared.mean():.0%} of all")
    print(f"services in these steps: {int(cpu['services'][compared].sum())}")
    print("| quantity | largest deviation | median of the largest of each step | tolerance | against |")
    print("| --- | --- | --- | --- | --- |")
    good = bool(compared.mean() >= 0.5)
    for name, (tolerance, against) in QUANTITIES.items():
        away = np.abs(here[name].astype(float) - cpu[name]).reshape(steps, worlds, -1).max(axis=2)
        away = np.where(compared, away, 0.0)
        good &= bool(away.max() <= tolerance)
        print(f"| {name} | {away.max():.2g} | {np.median(away.max(axis=1)):.2g} | {tolerance:g} | {against} |")
    return good


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="?", default="extreme")
    parser.add_argument("--set", action="append", default=[], help="change a field of the scenario, nodes.count=60")
    parser.add_argument("--arch", default="vulkan")
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--worlds", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="write the run of --arch here and compare nothing")
    arguments = parser.parse_args()
    settings = arguments.steps, arguments.worlds, arguments.seed
    if arguments.out:
        run(arguments.scenario, arguments.set, arguments.arch, *settings, arguments.out)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        results = []
        for arch in (arguments.arch, "cpu"):  # Taichi starts one architecture a process
            out = Path(folder) / f"{arch}.npz"
            numbers = [f"--{name}={value}" for name, value in zip(("steps", "worlds", "seed"), settings, strict=True)]
            changed = [f"--set={change}" for change in arguments.set]
            command = [sys.executable, "-m", "tests.trials.architectures", arguments.scenario, *changed, *numbers]
            command += ["--arch", arch, "--out", str(out)]
            subprocess.run(command, check=True)
            results.append(dict(np.load(out)))
    return 0 if compare(*results) else 1


if __name__ == "__main__":
    sys.exit(main())
