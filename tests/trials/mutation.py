"""Mutation run: how many small errors in `kernels` and `usvauv_env` the tests notice.

    python -m tests.trials.mutation --seed 1 --count 100
    python -m tests.trials.mutation --room kernels.mission --count 50

Each mutant of a random sample (`tests.trials.mutants`) is put into a copy of the tree, and the tests that import its
module run until one fails: those that mirror its room first, then by their distance in the graph of imports. A mutant
of `kernels` has the tests of `kernels` and `usvauv_env` against it, one of `usvauv_env` those of `usvauv_env` and
`usvauv_cli`. The golden trace is left out: it notices any change and says of none that it is wrong.

Results are appended to `--out`, a file of JSON lines, and mutants that are in it are not run again, so that a run can
be stopped and continued; `--survivors` runs those again that were not killed. A timeout counts as noticed: on a busy
machine these are to be run again. Survivors that no test can notice are in `survivors.toml`, each with its reason. At
the end the tests that killed are run on the unchanged tree: one that fails there has killed nothing.
"""

from __future__ import annotations

import argparse
import collections
import difflib
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import SimpleQueue

import pytest

from tests.import_graph import ROOT, imported, sources
from tests.trials.mutants import Mutant, drawn

SURVIVORS = Path(__file__).with_name("survivors.toml")
TEST_LIMIT, MUTANT_LIMIT = 300, 3600  # longest test and longest run of all tests of a mutant, s
AGAINST = {"kernels": ("kernels", "usvauv_env"), "usvauv_env": ("usvauv_env", "usvauv_cli")}
FIRST = {"kernels.mission": "tests/usvauv_env/test_world.py"}  # a room that is mostly tested by another's tests


def test_files(module: str) -> list[str]:
    """Files of tests that reach a module, the likeliest to notice an error in it first."""
    modules = dict(sources())
    for path in (ROOT / "tests").rglob("*.py"):
        modules[".".join(path.relative_to(ROOT).with_suffix("").parts)] = path
    importers = collections.defaultdict(set)
    for name, path in modules.items():
        for target in imported(path):
            importers[target if target in modules else target.rpartition(".")[0]].add(name)
        if name.startswith("tests.usvauv_cli."):  # the command runs in a fixture or a process
            importers["usvauv_cli.app"].add(name)
    distance = {module: 0}
    waiting = collections.deque([module])
    while waiting:
        name = waiting.popleft()
        for importer in importers[name] - distance.keys():
            distance[importer] = distance[name] + 1
            waiting.append(importer)
    package, *_, stem = module.split(".")
    mirrored = f"tests.{module.rpartition('.')[0]}."
    found = [
        name
        for name in distance
        if name.rpartition(".")[2].startswith("test_")
        and name.startswith(tuple(f"tests.{each}." for each in AGAINST[package]))
    ]
    found.sort(key=lambda n: (not n.endswith(f".test_{stem}"), not n.startswith(mirrored), distance[n], n))
    files = [str(modules[name].relative_to(ROOT)) for name in found]
    first = [file for room, file in FIRST.items() if module.startswith(f"{room}.")]
    return list(dict.fromkeys([*files[:1], *first, *files]))


def run(tree: Path, arguments: Iterable[str], running: set[int]) -> subprocess.CompletedProcess[str] | None:
    """Run pytest in a tree as a group of processes that `running` has meanwhile; None where it does not end."""
    # A kernel that never ends holds Python's lock: only faulthandler's own thread can end it.
    limits = [f"faulthandler_timeout={TEST_LIMIT}", "faulthandler_exit_on_timeout=true", "timeout=0"]
    options = ["-q", "-p", "no:cacheprovider", *(part for limit in limits for part in ("-o", limit))]
    command = [sys.executable, "-m", "pytest", *options, *arguments]
    environment = os.environ | {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    with subprocess.Popen(
        command, cwd=tree, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        start_new_session=True,
    ) as process:  # fmt: skip
        running.add(process.pid)
        try:
            output, _ = process.communicate(timeout=MUTANT_LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return None
        finally:
            running.discard(process.pid)
    return subprocess.CompletedProcess(command, process.returncode, output, "")


def judged(tree: Path, mutant: Mutant, running: set[int]) -> dict[str, object]:
    """Run the tests against a mutant in a copy of the tree."""
    path = tree / mutant.file
    text = path.read_text(encoding="utf-8")
    changed = mutant.applied(text)
    diff = difflib.unified_diff(text.splitlines(), changed.splitlines(), n=0, lineterm="")
    begun = time.monotonic()
    path.write_text(changed, encoding="utf-8")
    try:
        done = run(tree, ["-x", *test_files(mutant.file.removesuffix(".py").replace("/", "."))], running)
    finally:
        path.write_text(text, encoding="utf-8")
    killer = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE) if done else None
    if done is None or "Timeout (" in done.stdout:
        status = "timeout"
    else:
        status = "survived" if done.returncode in (0, pytest.ExitCode.NO_TESTS_COLLECTED) else "killed"
    return {
        "key": mutant.key,
        "file": mutant.file,
        "line": mutant.line,
        "operator": mutant.operator,
        "status": status,
        "by": killer.group(1) if killer else "",
        "seconds": round(time.monotonic() - begun, 1),
        "diff": [line for line in diff if not line.startswith(("---", "+++", "@@"))],
        "tail": "" if killer or status == "survived" else done.stdout[-300:] if done else "",
    }


def copied(folder: Path) -> Path:
    """A copy of the tree without what tests do not need."""
    left = shutil.ignore_patterns(".git", "__pycache__", "*.egg-info", ".venv", ".*_cache")
    return Path(shutil.copytree(ROOT, folder, ignore=left))


def wilson(successes: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """95 % confidence interval of a proportion (Wilson 1927, doi 10.1080/01621459.1927.10502953)."""
    p, n = successes / trials, trials
    centre, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (centre - half) / (1 + z * z / n), (centre + half) / (1 + z * z / n)


def excused() -> Mapping[str, str]:
    """Reasons of the survivors that no test can notice, by the mutant's key."""
    return {each["key"]: each["reason"] for each in tomllib.loads(SURVIVORS.read_text())["survivor"]}


def report(results: list[dict], reasons: Mapping[str, str]) -> None:
    """Print what was tried and what survived."""
    rooms = collections.defaultdict(collections.Counter)
    unexplained = []
    for result in results:
        status = result["status"]
        if status == "survived" and result["key"] in reasons:
            status = "explained"
        elif status == "survived":
            unexplained.append(result)
        rooms[".".join(result["file"].removesuffix(".py").split("/")[:2])][status] += 1
    rooms["all"] = sum(rooms.values(), collections.Counter())
    columns = ("killed", "timeout", "survived", "explained")
    print(f"{'room':28}{'tried':>7}", *(f"{name:>10}" for name in columns))
    for room, counts in sorted(rooms.items(), key=lambda item: (item[0] == "all", item[0])):
        print(f"{room:28}{counts.total():7}", *(f"{counts[name]:10}" for name in columns))
    noticed, tried = rooms["all"]["killed"] + rooms["all"]["timeout"], rooms["all"].total() - rooms["all"]["explained"]
    low, high = wilson(noticed, tried)
    print(f"noticed {noticed} of {tried} without an explanation: {noticed / tried:.1%}, 95 % {low:.1%} to {high:.1%}")
    for result in unexplained:
        print(f"\nsurvived: {result['file']}:{result['line']} ({result['operator']}, {result['key']})")
        print("\n".join(result["diff"]))


def results_of(mutants: Sequence[Mutant], workers: int) -> Iterator[dict[str, object]]:
    """Run the tests against some mutants, as they are done; what still runs at an interruption is ended."""
    running: set[int] = set()
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(workers) as pool:
        trees: SimpleQueue[Path] = SimpleQueue()
        for worker in range(workers):
            trees.put(copied(Path(place) / str(worker)))

        def one(mutant: Mutant) -> dict[str, object]:
            tree = trees.get()
            try:
                return judged(tree, mutant, running)
            finally:
                trees.put(tree)

        try:
            for future in as_completed([pool.submit(one, mutant) for mutant in mutants]):
                yield future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in list(running):
                os.killpg(process, signal.SIGKILL)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=100, help="mutants in the sample")
    parser.add_argument("--room", action="append", help="dotted name of a package, room or module; all by default")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("mutation.jsonl"))
    parser.add_argument("--survivors", action="store_true", help="run again what was not killed")
    chosen = parser.parse_args()
    sample = drawn(chosen.seed, chosen.count, chosen.room or list(AGAINST))
    known = {}
    if chosen.out.exists():
        known = {result["key"]: result for result in map(json.loads, chosen.out.read_text().splitlines())}
    waiting = [m for m in sample if m.key not in known or (chosen.survivors and known[m.key]["status"] != "killed")]
    for result in results_of(waiting, chosen.workers):
        known[result["key"]] = result
        with chosen.out.open("a") as file:
            file.write(json.dumps(result) + "\n")
        print(f"{result['status']} {result['file']}:{result['line']} {result['seconds']} s {result['by']}", flush=True)
    killers = {known[mutant.key]["by"] for mutant in waiting} - {""}
    if killers:
        done = run(ROOT, sorted(killers), set())
        if done is None or done.returncode:
            sys.exit(f"tests that noticed a mutant fail without it:\n{done.stdout[-2000:] if done else 'no end'}")
    report([known[mutant.key] for mutant in sample], excused())


if __name__ == "__main__":
    main()
