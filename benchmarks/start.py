"""How long commands take from their start to their first output and to their end, and where a first step's time goes.

    python -m benchmarks.start

Each command runs in a terminal of its own, first with an empty cache of compiled kernels, then with the one that this
left. `processor` is the time of all its threads, which other programs lengthen less than the time by the clock. Stages
are processor time of a new process that imports, makes one world and steps it once, with its garbage collector set as
a command's; imports of other packages, each in a bare process, stand beside them. Python's bytecode is stored, in a
folder of the benchmark's own, as it is wherever packages are installed by pip.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import pty
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

from usvauv.cli.app import COLLECTION

CACHE = "TI_OFFLINE_CACHE_FILE_PATH"
IMPORTS = ("numpy", "taichi", "torch", "usvauv.env.scenario", "usvauv.env.world.world")
COMMANDS = (
    "policies",
    "plan --auv 60,80,100 --auv 140,120,100",
    "sea --duration 60 --out sea.mp4",
    "simulate --trace mission.nc",
    "simulate wide --duration 300 --out wide.mp4",
    "replay mission.nc --out replay.mp4",
    "eval",
    "train --steps 50000 --out run",
)


class Run(NamedTuple):
    """Seconds of a command: to its first output, to its end, and of processor time."""

    first: float
    end: float
    processor: float


def run(command: str, folder: Path, cache: str) -> Run:
    """Run `usvauv COMMAND` in a folder.

    Raises:
        RuntimeError: it fails.
    """
    ours, its = pty.openpty()
    begin, first, said = time.perf_counter(), 0.0, b""
    process = subprocess.Popen(
        [sys.executable, "-m", "usvauv.cli", *command.split()],
        stdin=subprocess.DEVNULL,
        stdout=its,
        stderr=its,
        cwd=folder,
        env=os.environ | {CACHE: cache},
    )
    os.close(its)
    try:
        while part := os.read(ours, 1 << 16):
            first, said = first or time.perf_counter() - begin, part
    except OSError:  # the terminal's other end is closed
        pass
    os.close(ours)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"usvauv {command}: {said.decode(errors='replace')}")
    return Run(first, time.perf_counter() - begin, used.ru_utime + used.ru_stime)


def child(code: str, cache: str = "") -> Any:
    """What a new process of Python's prints last, in JSON."""
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {CACHE: cache}, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def stages(scenario: str) -> dict[str, float]:
    """Processor seconds of this process, which is new, until a world has made its first step."""
    gc.set_threshold(*COLLECTION)
    from usvauv.env import Scenario, World  # isort: split
    import torch
    from taichi.lang import impl, kernel_impl

    from usvauv.kernels import runtime

    begin = time.process_time()
    runtime.start()
    spent: dict[str, float] = dict.fromkeys(("sources read", "compiled", "machine code made, and run"), 0.0)

    def timed(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            start = time.process_time()
            try:
                return work(*arguments, **options)
            finally:
                spent[name] += time.process_time() - start

        return call

    program: Any = type(impl.pytaichi.prog)
    steps = ((kernel_impl.Kernel, "materialize"), (program, "compile_kernel"), (program, "launch_kernel"))
    for name, (owner, method) in zip(spent, steps, strict=True):
        mock.patch.object(owner, method, timed(name, getattr(owner, method))).start()
    world = World(Scenario.load(scenario))
    world.reset()
    world.step(torch.zeros((1, world.num_auvs, 2), device=world.device))
    whole = time.process_time()
    runtime.stop()
    return {"imports": begin, **spent, "rest": whole - begin - sum(spent.values()), "all": whole}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="of which the least counts")
    rounds = parser.parse_args().rounds
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryDirectory() as bytecode:
        os.environ["PYTHONPYCACHEPREFIX"] = bytecode
        print(child("import json; from benchmarks.machine import describe; print(json.dumps(describe()))"), flush=True)
        imports(rounds)
        stages_of_a_step(rounds)
        commands(rounds)


def imports(rounds: int) -> None:
    """Print what imports take."""
    print("| processor s of | " + " | ".join(f"`import {names}`" for names in IMPORTS) + " |")
    code = "import {}, json, time; print(json.dumps(time.process_time()))"
    least = [
        min(child(code.format(names)) for _ in range(rounds + 1)) for names in IMPORTS
    ]  # the first stores bytecode
    print("| | " + " | ".join(f"{seconds:.2f}" for seconds in least) + " |", flush=True)


def stages_of_a_step(rounds: int) -> None:
    """Print what the stages until a first step take."""
    print(
        "| stage, s | " + " | ".join(f"{name}, {state}" for name in ("extreme", "wide") for state in ("cold", "warm"))
    )
    found: list[dict[str, float]] = []
    for name in ("extreme", "wide"):
        code = f"from benchmarks.start import stages; import json; print(json.dumps(stages({name!r})))"
        tries = []
        for _ in range(rounds):
            with tempfile.TemporaryDirectory() as cache:
                tries += [child(code, cache) for _ in range(2)]
        found += (min(tries[first::2], key=lambda spent: spent["all"]) for first in (0, 1))
    for stage in found[0]:
        print(f"| {stage} | " + " | ".join(f"{spent[stage]:.2f}" for spent in found) + " |", flush=True)


def commands(rounds: int) -> None:
    """Print what commands take."""
    print("| command | cold: first output, end, processor, s | warm | compiling, processor s |")
    with tempfile.TemporaryDirectory() as place:
        for position, command in enumerate(COMMANDS):
            least = []
            for state in ("cold", "warm"):
                tries = []
                for number in range(rounds):
                    cache = Path(place, f"cache-{position}-{number if state == 'cold' else 0}")
                    cache.mkdir(exist_ok=True)
                    shutil.rmtree(Path(place, "run"), ignore_errors=True)  # of the training before
                    tries.append(run(command, Path(place), str(cache)))
                least.append(Run(*map(min, zip(*tries, strict=True))))
            cold, warm = (", ".join(f"{value:.1f}" for value in result) for result in least)
            print(f"| `{command}` | {cold} | {warm} | {least[0].processor - least[1].processor:.1f} |", flush=True)


if __name__ == "__main__":
    main()
