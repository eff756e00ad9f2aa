"""What a timing needs beside it: the machine, the versions, and a clock that takes the best of several runs."""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import torch

from usvauv.kernels import runtime


def parse(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """Command line of a benchmark, with `--json` and `--arch`; kernels run on that architecture from here on."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--arch", default="auto", choices=runtime.ARCHITECTURES, help="where the kernels run")
    arguments = parser.parse_args()
    try:
        runtime.start(arguments.arch)
    except runtime.RuntimeUnavailable as error:
        parser.error(str(error))
    return arguments


def batch(on_cpu: int, on_card: int) -> int:
    """How many tasks fill the machine: fewer on a CPU, and on a Vulkan device, to which arrays are copied."""
    return on_card if runtime.start().arch == "cuda" else on_cpu


def describe() -> dict[str, object]:
    """Processor, cores, device and versions."""
    running = runtime.start()
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        model = names[0] if names else model
    device = torch.cuda.get_device_name() if running.arch == "cuda" else "none"
    return {
        "processor": model,
        "threads": running.threads,
        "accelerator": device,
        "arch": running.arch,
        "taichi": version("taichi"),
        "torch": torch.__version__,
    }


def best_time(work: Callable[[], object], seconds: float = 1.0, rounds: int = 3) -> float:
    """Seconds of one call: warmed up, synchronised, repeated for about `seconds` a round, the best round's mean.

    The best and not the mean of the rounds, because other programs can only make a round longer.
    """
    work()
    _synchronize()
    begin = time.perf_counter()
    work()
    _synchronize()
    once = time.perf_counter() - begin
    repeats = max(1, round(seconds / max(once, 1e-9) / rounds))
    best = once
    for _ in range(rounds):
        begin = time.perf_counter()
        for _ in range(repeats):
            work()
        _synchronize()
        best = min(best, (time.perf_counter() - begin) / repeats)
    return best


def _synchronize() -> None:
    runtime.synchronize()
    if torch.cuda.is_available():
        torch.cuda.synchronize()
