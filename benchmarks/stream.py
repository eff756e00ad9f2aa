"""Peak memory and time of `usvauv eval` by the number of episodes.

    python -m benchmarks.stream --json

Each evaluation is a process of its own. Missions are short, so that what is kept of an episode would be much beside
what a batch takes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.machine import command_line, describe, parse, show

CALL = [sys.executable, "-c", "from usvauv.cli.app import main; main()"]
MISSION = ("ideal", "--policy", "straight", "--policy", "crab", "--set", "mission.duration=2")


def measure(episodes: int, arch: str) -> dict[str, float]:
    """One evaluation of two policies: rows of its CSV, largest resident memory, bytes, and duration, s."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "m.csv")
        command = [*CALL, "eval", *MISSION, "--episodes", str(episodes), "--arch", arch, "--out", str(out)]
        begun = time.perf_counter()
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
            _, status, used = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.perf_counter() - begun
        with out.open(encoding="utf-8") as stream:
            rows = sum(1 for _ in stream) - 1
    return {"episodes": episodes, "rows": rows, "peak_resident_bytes": 1024 * used.ru_maxrss, "seconds": seconds}


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--episodes", type=int, nargs="+", default=[1000, 20_000])
    arguments = parse(parser)
    found = [measure(episodes, arguments.arch) for episodes in arguments.episodes]
    show({"machine": describe(), "evaluations": found}, arguments.json)


if __name__ == "__main__":
    main()
