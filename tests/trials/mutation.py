"""Mutation run: how many small errors in `kernels` and `usvauv_env` the tests notice.

    python -m tests.trials.reach
    python -m tests.trials.mutation --seed 1 --count 100
    python -m tests.trials.mutation --room kernels.mission --count 50

Each mutant of a random sample (`tests.trials.mutants`) is put into a copy of the tree, and the tests that reach its
statement (`tests.trials.reach`) run until one fails: those that import its module first, then those of its room, then
the quickest, five minutes of them at most. The golden trace is left out: it notices any change and says of none that it
is wrong.

Results are appended to `--out`, a file of JSON lines, and mutants that are in it are not run again, so that a run can
be stopped and continued; `--survivors` runs those again that were not killed. A timeout counts as noticed: on a busy
machine these are to be run again. `survivors.toml` has survivors that were looked at, each with its kind and reason:
those whose results are the same, or differ only in speed, do not count in the rate; choices, which a test could only
repeat, do. At the end the tests that killed are run on the unchanged tree: one that fails there has killed nothing.
"""

from __future__ import annotations

import argparse
import ast
import collections
import difflib
import functools
import itertools
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

from tests.import_graph import ROOT, imported, module_graph, sources
from tests.trials.mutants import Mutant, drawn
from tests.trials.reach import PACKAGES, Reach

SURVIVORS = Path(__file__).with_name("survivors.toml")
TEST_LIMIT, MUTANT_LIMIT = 300, 3600  # longest test and longest run of all tests of a mutant, s
TESTS_LIMIT = 300  # tests of a mutant together, s as they took without it


def reaching(reach: Reach, mutant: Mutant) -> list[str]:
    """Tests that reach a mutant, those that import its module first, then those of its room, then the quickest.

    They reach its statement; where none does or it is no function's, a function of its module; where there is none, a
    function of a module that imports it.
    """
    names = {path.relative_to(ROOT).as_posix(): name for name, path in sources().items()}
    functions = functions_of(mutant.file)

    def of(file: str, *spans: tuple[int, int]) -> set[str]:
        lines = reach.tests.get(file, {}).items()
        return set().union(*(tests for line, tests in lines if any(first <= line <= last for first, last in spans)))

    def of_module(file: str) -> set[str]:
        return of(file, *(body(each) for each in functions_of(file)))

    found: set[str] = set()
    around = [each for each in functions if body(each)[0] <= mutant.line <= body(each)[1]]
    if around:
        statements = [each for each in ast.walk(around[-1]) if isinstance(each, ast.stmt) and each is not around[-1]]
        holding = [each for each in statements if each.lineno <= mutant.line <= (each.end_lineno or 0)]
        innermost = max(holding, key=lambda each: each.lineno)
        inner = getattr(innermost, "body", None)
        last = inner[0].lineno - 1 if inner else innermost.end_lineno or 0
        found = of(mutant.file, (innermost.lineno, max(last, innermost.lineno)))
        found = found or of(mutant.file, body(around[-1]))
    found = found or of_module(mutant.file)
    if not found:
        graph = module_graph()
        importers = [file for file in names if names[mutant.file] in graph[names[file]]]
        found = set().union(*map(of_module, importers))
    room = "/".join(Path("tests", mutant.file).parts[:3]) + "/"
    own = {name for name in found if names[mutant.file] in modules_of(name.partition("::")[0])}
    ordered = sorted(found, key=lambda name: (name not in own, not name.startswith(room), reach.seconds[name]))
    until = itertools.accumulate(reach.seconds[name] for name in ordered)
    return [name for name, total in zip(ordered, until, strict=True) if total < TESTS_LIMIT]


@functools.cache
def modules_of(file: str) -> frozenset[str]:
    """Modules that a file imports, and what they stand in."""
    targets = set(imported(ROOT / file))
    return frozenset(targets | {target.rpartition(".")[0] for target in targets})


def functions_of(file: str) -> list[ast.FunctionDef]:
    """Functions of a file, inner ones after outer ones."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return [each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef)]


def body(function: ast.FunctionDef) -> tuple[int, int]:
    """First and last line of a function's body."""
    return function.body[0].lineno, function.end_lineno or 0


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


def judged(tree: Path, mutant: Mutant, tests: Sequence[str], running: set[int]) -> dict[str, object]:
    """Run some tests against a mutant in a copy of the tree; without any it survives."""
    path = tree / mutant.file
    text = path.read_text(encoding="utf-8")
    changed = mutant.applied(text)
    diff = difflib.unified_diff(text.splitlines(), changed.splitlines(), n=0, lineterm="")
    begun = time.monotonic()
    path.write_text(changed, encoding="utf-8")
    try:
        done = run(tree, ["-x", *tests] if tests else ["--version"], running)
    finally:
        path.write_text(text, encoding="utf-8")
    killer = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", done.stdout, re.MULTILINE) if done else None
    status = "survived"
    if done is None or "Timeout (" in done.stdout:
        status = "timeout"
    elif done.returncode:
        status = "killed"
    return {
        "key": mutant.key,
        "file": mutant.file,
        "line": mutant.line,
        "operator": mutant.operator,
        "status": status,
        "by": killer.group(1) if killer else "",
        "seconds": round(time.monotonic() - begun, 1),
        "diff": [line for line in diff if not line.startswith(("---", "+++", "@@"))],
        "tail": done.stdout[-500:] if done and status != "survived" else "",
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


def survivor_kinds() -> Mapping[str, str]:
    """Kinds of the survivors that were looked at, by the mutant's key."""
    return {each["key"]: each["kind"] for each in tomllib.loads(SURVIVORS.read_text())["survivor"]}


def report(results: list[dict], kinds: Mapping[str, str]) -> None:
    """Print what was tried and what survived."""
    rooms = collections.defaultdict(collections.Counter)
    unexplained = []
    for result in results:
        status = result["status"]
        if status == "survived":
            status = kinds.get(result["key"], status)
        if status == "survived":
            unexplained.append(result)
        rooms[".".join(result["file"].removesuffix(".py").split("/")[:2])][status] += 1
    rooms["all"] = sum(rooms.values(), collections.Counter())
    columns = ("killed", "timeout", "survived", "choice", "equivalent", "speed")
    print(f"{'room':28}{'tried':>7}", *(f"{name:>10}" for name in columns))
    for room, counts in sorted(rooms.items(), key=lambda item: (item[0] == "all", item[0])):
        print(f"{room:28}{counts.total():7}", *(f"{counts[name]:10}" for name in columns))
    counts = rooms["all"]
    noticed, tried = counts["killed"] + counts["timeout"], counts.total() - counts["equivalent"] - counts["speed"]
    low, high = wilson(noticed, tried)
    print(f"noticed {noticed} of {tried} that change results: {noticed / tried:.1%}, 95 % {low:.1%} to {high:.1%}")
    for result in unexplained:
        print(f"\nsurvived: {result['file']}:{result['line']} ({result['operator']}, {result['key']})")
        print("\n".join(result["diff"]))


def results_of(mutants: Sequence[Mutant], reach: Reach, workers: int) -> Iterator[dict[str, object]]:
    """Run the tests against some mutants, as they are done; what still runs at an interruption is ended."""
    running: set[int] = set()
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(workers) as pool:
        trees: SimpleQueue[Path] = SimpleQueue()
        for worker in range(workers):
            trees.put(copied(Path(place) / str(worker)))

        def one(mutant: Mutant) -> dict[str, object]:
            tree = trees.get()
            try:
                return judged(tree, mutant, reaching(reach, mutant), running)
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
    parser.add_argument("--reach", type=Path, default=Path("reach.json"), help="what `tests.trials.reach` wrote")
    parser.add_argument("--out", type=Path, default=Path("mutation.jsonl"))
    parser.add_argument("--survivors", action="store_true", help="run again what was not killed")
    chosen = parser.parse_args()
    sample = drawn(chosen.seed, chosen.count, chosen.room or list(PACKAGES))
    known = {}
    if chosen.out.exists():
        known = {result["key"]: result for result in map(json.loads, chosen.out.read_text().splitlines())}
    waiting = [m for m in sample if m.key not in known or (chosen.survivors and known[m.key]["status"] != "killed")]
    for result in results_of(waiting, Reach.load(chosen.reach), chosen.workers):
        known[result["key"]] = result
        with chosen.out.open("a") as file:
            file.write(json.dumps(result) + "\n")
        print(f"{result['status']} {result['file']}:{result['line']} {result['seconds']} s {result['by']}", flush=True)
    killers = {known[mutant.key]["by"] for mutant in waiting} - {""}
    if killers:
        done = run(ROOT, sorted(killers), set())
        if done is None or done.returncode:
            sys.exit(f"tests that noticed a mutant fail without it:\n{done.stdout[-2000:] if done else 'no end'}")
    report([known[mutant.key] for mutant in sample], survivor_kinds())


if __name__ == "__main__":
    main()
