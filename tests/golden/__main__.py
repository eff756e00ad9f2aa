"""The golden trace: what a few short missions came to, and the digest of every bit of them.

    python -m tests.golden             # compare with this machine
    python -m tests.golden --add       # write down this machine's digest, where the numbers agree
    python -m tests.golden --renew     # after a change that is meant to change results: numbers and digests anew

`golden.json` has the numbers, the versions that they were made with, and a digest for each processor. Bits depend on
the processor's instructions and model: NumPy and torch choose their routines by them, and so do LLVM, which compiles
Taichi's kernels, and the C library. On a processor that has a digest every bit is compared, on any other the numbers
within `TOLERANCE`.

Another set is emulated by QEMU: `qemu-x86_64-static -cpu Haswell $(which python) -m tests.golden` has AVX2, `-cpu
Nehalem` neither AVX nor fused multiplication and addition.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import re
import sys
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch

from benchmarks.digest import REFRACTION, SEAS, WITHOUT_CHANNEL, mission_arrays
from usvauv.env import Scenario, World
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, NodeColumn, TallyColumn

FILE = Path(__file__).with_name("golden.json")
TOLERANCE = 2e-3  # of a number of the trace: m, m/s, W, packets
MISSIONS = {
    "extreme": ("extreme", [], "fim"),
    "paper-extreme": ("paper-extreme", [], "hold:100,100"),
    "without a channel": ("extreme", WITHOUT_CHANNEL + REFRACTION, "centroid"),
    "nonlinear sea": ("extreme", SEAS[2], "centroid"),
}


def processor() -> str:
    """This machine's set of instructions, as torch names it, which also knows an emulated one, and the model."""
    file = Path("/proc/cpuinfo")
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    model = [*re.findall(r"^(?:cpu family|model)\s*: (\d+)$", text, re.MULTILINE)[:2], "0", "0"][:2]
    return f"{platform.machine()} {torch.backends.cpu.get_cpu_capability()}, family {model[0]}, model {model[1]}"


def versions() -> dict[str, str]:
    """Of the packages that compute."""
    return {name: version(name).partition("+")[0] for name in ("numpy", "taichi", "torch")}


def summary(world: World) -> dict[str, list[float]]:
    """Numbers of the worlds as they are, each of all worlds, AUV by AUV."""
    auv, boat, tally = (array.cpu().numpy() for array in (world.auv, world.boat, world.tally))
    found = {name: auv[..., getattr(AuvColumn, name)] for name in AuvColumn.names}
    found |= {f"boat_{name}": boat[..., getattr(BoatColumn, name)] for name in BoatColumn.names}
    found |= {f"tally_{name}": tally[..., getattr(TallyColumn, name)] for name in TallyColumn.names}
    found["backlog"] = world.node[..., NodeColumn.backlog].cpu().numpy().mean(axis=-1)
    found["reward"] = world.reward.cpu().numpy()
    found["elevation"] = world.surface(8)
    return {name: [round(float(x), 6) for x in values.ravel()] for name, values in found.items()}


def traced(names: Iterable[str] = MISSIONS) -> tuple[str, dict[str, dict[str, list[float]]]]:
    """Digest of all bits of the missions so named, and the numbers at their ends."""
    digest, numbers = hashlib.sha256(), {}
    for name in names:
        scenario, changes, usv = MISSIONS[name]
        world = World(Scenario.load(scenario, changes), num_worlds=3, seed=7, usv=usv)
        for array in mission_arrays(world):
            digest.update(array.tobytes())
        numbers[name] = summary(world)
    return digest.hexdigest()[:16], numbers


def deviations(golden: dict[str, dict], found: dict[str, dict]) -> dict[str, float]:
    """Largest difference of each quantity that differs."""
    return {
        f"{run} {name}": float(np.abs(np.subtract(found[run][name], values)).max())
        for run, quantities in golden.items()
        for name, values in quantities.items()
        if found[run][name] != values
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare the golden trace with this machine, or write it anew.")
    parser.add_argument("--add", action="store_true", help="write down this machine's digest")
    parser.add_argument("--renew", action="store_true", help="write numbers and digests anew")
    chosen = parser.parse_args()
    digest, numbers = traced()
    golden = {"versions": versions(), "digests": {}, "numbers": numbers}
    if not chosen.renew:
        golden = json.loads(FILE.read_text(encoding="utf-8"))
    differ = deviations(golden["numbers"], numbers)
    worst = max(differ, key=differ.get, default="")
    print(processor(), versions(), digest, golden["digests"].get(processor(), "no digest yet"))
    print(f"largest difference: {worst} {differ[worst]:.2g}" if differ else "no number differs")
    if differ and differ[worst] > TOLERANCE:
        sys.exit(f"more than {TOLERANCE}")
    if chosen.add or chosen.renew:
        golden["digests"][processor()] = digest
        one_line_each = re.sub(r"\[[^]]*]", lambda found: " ".join(found[0].split()), json.dumps(golden, indent=1))
        FILE.write_text(one_line_each + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
