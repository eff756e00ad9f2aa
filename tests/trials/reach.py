"""Which tests reach which lines of `kernels` and `usvauv_env`, and how long each test takes.

    python -m tests.trials.reach --out reach.json

Runs the tests of `kernels` and `usvauv_env` and those of the commands once. Lines of Python are those that coverage
counts; what runs while fixtures are made counts for all tests of the file. Lines of a `ti.func` or `ti.kernel` do not
run as Python: they count for each test that launches a kernel into which they were compiled. Tests that are skipped or
fail are left out.
"""

from __future__ import annotations

import argparse
import collections
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Any

import coverage
import pytest
from taichi.lang import impl
from taichi.lang.kernel_impl import Func, Kernel

from kernels.launch import Launch
from tests.import_graph import ROOT

FOLDER = "USVAUV_REACH"  # environment variable: where the tests' processes write what they noted
PACKAGES = ("kernels", "usvauv_env")
TESTS = ("kernels", "usvauv_env", "usvauv_cli")


@dataclass(frozen=True)
class Reach:
    """What was noted of a run of the tests.

    Attributes:
        seconds: that each test took which passed, by its pytest identifier.
        tests: that reach a line, by file and line.
    """

    seconds: dict[str, float]
    tests: dict[str, dict[int, set[str]]]

    @classmethod
    def load(cls, path: Path) -> Reach:
        """Read what `main` wrote."""
        noted = json.loads(path.read_text(encoding="utf-8"))
        names = list(noted["seconds"])
        lines = noted["lines"].items()
        return cls(
            noted["seconds"],
            {file: {int(line): {names[i] for i in found} for line, found in each.items()} for file, each in lines},
        )

    def save(self, path: Path) -> None:
        """Write it as JSON."""
        number = {name: i for i, name in enumerate(self.seconds)}
        lines = {
            file: {line: sorted(number[name] for name in found if name in number) for line, found in each.items()}
            for file, each in self.tests.items()
        }
        path.write_text(json.dumps({"seconds": self.seconds, "lines": lines}), encoding="utf-8")


class Recorder:
    """Notes, as a plugin of pytest, how long each test takes and which Taichi functions it launches."""

    def __init__(self) -> None:
        self._compiled: dict[Kernel, set[CodeType]] = collections.defaultdict(set)
        self._launched: dict[str, set[Kernel]] = collections.defaultdict(set)  # by test, or by file for fixtures
        self._seconds: dict[str, float] = collections.Counter()
        self._running = ""
        files = [f"{ROOT / package}/*" for package in PACKAGES]
        self._coverage = coverage.Coverage(data_file=None, config_file=False, include=files)  # in memory
        call, launch, bound, run = Func.__call__, Kernel.launch_kernel, Launch.__init__, Launch.__call__

        def noted_call(function: Func, *arguments: Any, **named: Any) -> Any:
            if impl.inside_kernel():
                self._compiled[impl.get_runtime().current_kernel].add(function.func.__code__)
            return call(function, *arguments, **named)

        def noted_launch(kernel: Kernel, *arguments: Any) -> Any:
            self._launched[self._running].add(kernel)
            return launch(kernel, *arguments)

        def noted_bound(self: Any, kernel: Any, *arguments: Any) -> None:
            bound(self, kernel, *arguments)
            self.kernel = kernel._primal

        def noted_run(launch: Any) -> None:
            self._launched[self._running].add(launch.kernel)
            run(launch)

        replaced: Any = ((Func, "__call__", noted_call), (Kernel, "launch_kernel", noted_launch))
        for owner, name, function in (*replaced, (Launch, "__init__", noted_bound), (Launch, "__call__", noted_run)):
            setattr(owner, name, function)

    def _begin(self, name: str) -> None:
        self._running = name
        self._coverage.switch_context(name)

    def pytest_collection_finish(self) -> None:
        self._coverage.start()

    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        self._begin(item.nodeid.partition("::")[0])

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, object, object]:
        self._begin(item.nodeid)
        try:
            return (yield)
        finally:
            self._begin(item.nodeid.partition("::")[0])

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._seconds[report.nodeid] += report.duration if report.passed else math.inf

    def pytest_sessionfinish(self) -> None:
        if not self._running:  # the process that deals out the tests
            return
        self._coverage.stop()
        lines: dict[str, dict[int, list[str]]] = collections.defaultdict(lambda: collections.defaultdict(list))
        counted = self._coverage.get_data()
        for path in counted.measured_files():
            for line, names in counted.contexts_by_lineno(path).items():
                lines[path][line] += filter(None, names)
        for name, kernels in self._launched.items():
            for code in set().union(*({kernel.func.__code__} | self._compiled[kernel] for kernel in kernels)):
                for line in {line for _, _, line in code.co_lines() if line}:
                    lines[code.co_filename][line].append(name)
        seconds = {name: value for name, value in self._seconds.items() if math.isfinite(value)}
        path = Path(os.environ[FOLDER], f"{os.getpid()}.json")
        path.write_text(json.dumps({"seconds": seconds, "lines": lines}), encoding="utf-8")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Recorder())


def merged(folder: Path) -> Reach:
    """What the tests' processes wrote."""
    noted = [json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")]
    seconds = {name: value for each in noted for name, value in each["seconds"].items()}
    of_file = collections.defaultdict(set)
    for name in seconds:
        of_file[name.partition("::")[0]].add(name)
    tests: dict[str, dict[int, set[str]]] = collections.defaultdict(lambda: collections.defaultdict(set))
    for each in noted:
        for path, lines in each["lines"].items():
            file = Path(path).relative_to(ROOT) if Path(path).is_relative_to(ROOT) else Path()
            if file.parts and file.parts[0] in PACKAGES:
                for line, names in lines.items():
                    tests[str(file)][int(line)] |= set().union(*(of_file.get(name, {name}) for name in names))
    return Reach(seconds, tests)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("reach.json"))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("tests", nargs="*", help="files of tests; default: all that count for a mutant")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        plugins = ["-p", "no:pytest_cov", "-p", "tests.trials.reach"]
        command = [sys.executable, "-m", "pytest", "-q", "-n", str(chosen.workers), *plugins]
        tests = chosen.tests or [f"tests/{room}" for room in TESTS]
        done = subprocess.run([*command, *tests], cwd=ROOT, env=os.environ | {FOLDER: folder}, check=False)
        if done.returncode not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
            sys.exit(f"pytest: exit code {done.returncode}")
        merged(Path(folder)).save(chosen.out)


if __name__ == "__main__":
    main()
