"""What a timing needs beside it: a command line, the machine and versions, a clock that takes the best of several runs,
and how its figures are printed.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from usvauv.kernels import runtime


def command_line(about: str | None) -> argparse.ArgumentParser:
    """Parser of a benchmark's command line; `about` is its docstring."""
    return argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)


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


def show(result: Mapping[str, Any], as_json: bool) -> None:
    """Print a result: as JSON, or a line for each figure and a Markdown table for each list of records."""
    if as_json:
        print(json.dumps(result, indent=1))
        return
    for name, value in _figures(result):
        if not isinstance(value, list) or not value or not isinstance(value[0], Mapping):
            print(f"{name}: {_words(value)}")
            continue
        rows = [dict(_figures(row)) for row in value]
        columns = list(dict.fromkeys(column for row in rows for column in row))
        print(f"\n{name}:\n")
        cells = [[_words(row.get(column, "")) for column in columns] for row in rows]
        for line in (columns, ["---"] * len(columns), *cells):
            print(f"| {' | '.join(line)} |")


def _figures(result: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Figures by name, those of records in records with the names that lead to them."""
    for name, value in result.items():
        if isinstance(value, Mapping):
            yield from _figures(value, f"{before}{name} ")
        else:
            yield f"{before}{name}", value


def _words(value: object) -> str:
    if isinstance(value, Mapping):
        return "…"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(map(_words, value))
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
    return str(value)


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


def best_time(work: Callable[[], object], seconds: float = 1.0, rounds: int = 3, least: int = 1) -> float:
    """Seconds of one call: warmed up, synchronised, repeated for about `seconds` in all, the best round's mean.

    The best and not the mean of the rounds, because other programs can only make a round longer. Where calls differ in
    what they do, `least` says how many make a round that is like any other.
    """
    work()
    _synchronize()
    begin = time.perf_counter()
    work()
    _synchronize()
    once = time.perf_counter() - begin
    repeats = max(least, round(seconds / max(once, 1e-9) / rounds))
    best = math.inf
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
