"""All that waits for a graphics card, in one go: the tests of the kernels and of learning on it, and its rates.

    python -m benchmarks.gpu --out gpu.json
    python -m benchmarks.gpu --arch vulkan --small --out vulkan.json

Each part runs in a process of its own with a time limit, and what fails does not stop the next. The file is written
after each part: the card, the versions, how each part ended, and the rates of the benchmarks with their ratio to the
CPU's in the same run. `--small` tries the script where there is no card: one test and the smallest sizes.
Exit code 0 if all parts succeeded, 1 if not, 2 without a device.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from usvauv.env.storage.files import atomic_write

LIMIT = 3600  # s, of a part
TESTS = {
    "kernels": ["tests/kernels"],
    "usvauv_env": ["tests/usvauv_env"],
    "learning": ["tests/policies/test_learners.py", "tests/policies/test_training.py"],
}
SMALL_TESTS = {"kernels": ["tests/kernels/test_launch.py"]}
BENCHMARKS = {  # options, and those of `--small`
    "sea": ([], ["--largest=256"]),
    "worlds": ([], ["--largest=4", "--seconds=0.1"]),
    "plan": ([], ["--trials=120", "--seconds=0.1"]),
    "usbl": ([], ["--count=1000", "--seconds=0.1"]),
    "learning": ([], ["--largest=128", "--updates=50"]),
}
DESCRIBE = """
import json, sys
from benchmarks.machine import describe
from usvauv.kernels import runtime
try:
    runtime.start(sys.argv[1])
    print(json.dumps(describe()))
except runtime.RuntimeUnavailable as error:
    sys.exit(str(error))
"""


def run(name: str, command: list[str]) -> dict[str, object]:
    """How a part ended: its command, exit code (None: out of time), seconds, and what it printed last."""
    print(f"{name}: {' '.join(command)}", flush=True)
    begin = time.monotonic()
    try:
        done = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True, timeout=LIMIT)
        code, out, err = done.returncode, done.stdout, done.stderr
    except subprocess.TimeoutExpired:
        code, out, err = None, "", f"no end within {LIMIT} s"
    last = out.strip().splitlines()[-1:] if code == 0 else (out + err).strip().splitlines()[-20:]
    seconds = time.monotonic() - begin
    print(f"{name}: {'good' if code == 0 else 'FAILED'} after {seconds:.0f} s", flush=True)
    return {"command": command, "exit_code": code, "seconds": round(seconds, 1), "last_lines": last, "out": out}


def rates(result: object, path: str = "") -> Iterator[tuple[str, float]]:
    """Each rate in a benchmark's JSON, by the names that lead to it."""
    parts = result.items() if isinstance(result, dict) else enumerate(result) if isinstance(result, list) else ()
    for name, value in parts:
        here = f"{path}.{name}".lstrip(".")
        if isinstance(value, int | float) and "per_second" in here:
            yield here, value
        yield from rates(value, here)


def compare(found: str, cpu: str) -> dict[str, dict[str, float]]:
    """Rates of two runs of a benchmark side by side; empty if one printed no JSON."""
    try:
        ours, theirs = (dict(rates(json.loads(text))) for text in (found, cpu))
    except json.JSONDecodeError:
        return {}
    return {
        name: {"rate": rate, "cpu": theirs[name], "ratio": rate / theirs[name]}
        for name, rate in ours.items()
        if theirs.get(name)
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arch", default="cuda", help="cuda or vulkan")
    parser.add_argument("--small", action="store_true", help="one test and the smallest sizes")
    parser.add_argument("--out", type=Path, default=Path("gpu.json"))
    arguments = parser.parse_args()
    started = subprocess.run([sys.executable, "-c", DESCRIBE, arguments.arch], capture_output=True, text=True)
    if started.returncode:
        print((started.stderr.strip().splitlines() or ["no device"])[-1], file=sys.stderr)
        return 2
    report: dict[str, dict] = {"machine": json.loads(started.stdout.splitlines()[-1]), "parts": {}, "rates": {}}
    failed = []

    def note(name: str, command: list[str]) -> str:
        part = run(name, command)
        out = part.pop("out")
        report["parts"][name] = part
        if part["exit_code"] != 0:
            failed.append(name)
        with atomic_write(arguments.out) as partial:
            partial.write_text(json.dumps(report, indent=1))
        return str(out)

    arch = ["--arch", arguments.arch]
    for name, tests in (SMALL_TESTS if arguments.small else TESTS).items():
        note(f"tests of {name}", ["pytest", "-q", "-rs", *arch, *tests])
    steps = ["--steps=5"] if arguments.small else []
    note("steps beside the CPU", ["tests.trials.architectures", *arch, *steps])
    for name, options in BENCHMARKS.items():
        command = [f"benchmarks.{name}", "--json", *options[arguments.small]]
        found, cpu = (note(f"{name} on {where}", [*command, "--arch", where]) for where in (arguments.arch, "cpu"))
        report["rates"][name] = compare(found, cpu)
    with atomic_write(arguments.out) as partial:
        partial.write_text(json.dumps(report, indent=1))
    for name, found in report["rates"].items():
        for rate, row in found.items():
            print(f"{name} {rate}: {row['rate']:.3g}, {row['ratio']:.3g} × the CPU's")
    print(f"{arguments.out}: {len(report['parts'])} parts, failed: {', '.join(failed) or 'none'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
