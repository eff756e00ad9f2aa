"""Fixtures that tests of more than one module use."""

import gc
import signal
import sys
from collections.abc import Generator

import pytest
import torch
from xdist.remote import Producer
from xdist.scheduler import LoadFileScheduling

from usvauv.cli import app
from usvauv.env import plugins
from usvauv.kernels import runtime
from usvauv.kernels.registry import Registry

# Files that take longest, first: at the end a worker would wait for another one's. A group, whose worlds are compiled
# alike, has one worker.
LONG = (
    (
        "usvauv_env/world/test_invariants.py",
        "usvauv_env/world/test_world.py",
        "usvauv_env/world/faults/test_faults.py",
        "usvauv_env/world/test_vehicles.py",
        "policies/test_guidance.py",
        "policies/test_policies.py",
        "kernels/mission/test_belief_planner.py",
        "kernels/mission/test_tracking.py",
        "kernels/mission/test_tracking_places.py",
        "kernels/mission/test_listening_boats.py",
        "usvauv_cli/live/test_live.py",
        "test_tour.py",
        "test_docs.py",
    ),
    (
        "usvauv_cli/commands/test_cli.py",
        "usvauv_cli/commands/test_files_of_scenarios.py",
        "usvauv_cli/commands/test_results_that_are_there.py",
        "usvauv_cli/commands/test_sea_command.py",
        "usvauv_cli/web_report/test_web_report.py",
        "usvauv_cli/evaluation/test_evaluation.py",
        "usvauv_cli/sweep/test_sweep.py",
    ),
    (
        "golden/test_golden.py",
        "kernels/mission/test_demonstration.py",
        "kernels/mission/test_packets.py",
        "kernels/mission/test_motion.py",
        "usvauv_env/world/test_mission.py",
        "usvauv_env/world/boats/test_boats.py",
    ),
    (
        "kernels/mission/test_fixes.py",
        "kernels/mission/test_validation.py",
        "usvauv_env/record/test_metrics.py",
    ),
    ("usvauv_env/world/test_fixes_in_missions.py",),
    ("usvauv_cli/sweep/test_engines.py",),
    ("kernels/test_runtime.py",),
    ("kernels/mission/test_target_rules.py",),
    ("policies/test_training.py",),
    ("kernels/planning/test_search.py",),
    ("usvauv_env/interfaces/test_interfaces.py",),
    ("test_examples.py",),
    ("usvauv_env/world/test_beside.py",),
    ("usvauv_cli/reproduction/test_reproduce.py",),
    ("usvauv_env/world/test_channel.py",),
)
GROUP = {f"tests/{file}": group for group, files in enumerate(LONG) for file in files}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--arch", default="auto", help="Where the kernels run: auto, cpu, cuda or vulkan.")


def pytest_configure(config: pytest.Config) -> None:
    # One kernel for any number of worlds, run by the calling thread: pytest's workers keep the other cores busy.
    runtime.FEW_TASKS = sys.maxsize
    # A shell starts what it puts into the background with Ctrl-C ignored, and so would all that tests start.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if config.getoption("--arch") != "auto":
        runtime.start(config.getoption("--arch"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    order = {file: place for place, file in enumerate(GROUP)}
    items.sort(key=lambda item: order.get(item.nodeid.partition("::")[0], len(order)))


class GroupScheduling(LoadFileScheduling):
    """Gives a worker whole files, and those of a group to the same one."""

    def _split_scope(self, nodeid: str) -> str:
        file = super()._split_scope(nodeid)
        return f"group {GROUP[file]}" if file in GROUP else file


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadFileScheduling:
    return GroupScheduling(config, log)


def pytest_collection_finish() -> None:
    """What is there now stays to the end, and need not be searched for cycles again and again."""
    gc.freeze()


def pytest_sessionfinish() -> None:
    """Write compiled kernels to Taichi's cache: a worker that still does so ten seconds after its end is killed."""
    runtime.stop()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what is about CPUs alone where kernels run elsewhere."""
    marker = item.get_closest_marker("cpu")
    if marker and not runtime.start().on_cpu:
        pytest.skip(f"about CPUs alone: {marker.args[0]}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(call: pytest.CallInfo) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Skip what the architecture under test refuses; a CPU refuses nothing."""
    if call.excinfo is not None and call.excinfo.errisinstance(runtime.Unsupported):
        with pytest.raises(pytest.skip.Exception) as skipped:
            pytest.skip(str(call.excinfo.value))
        call.excinfo = skipped
    return (yield)


@pytest.fixture(scope="session")
def device() -> torch.device:
    """Torch device of the kernels. Taichi runs from here on."""
    return runtime.start().device


@pytest.fixture(scope="session")
def rounding() -> float:
    """Factor on tolerances that are a few roundings of sin, exp or log: 1 on a CPU, 4 elsewhere.

    Vulkan's specification allows exp(x) an error of 3 + 2|x| units in the last place, and log one of 3.
    """
    return 1.0 if runtime.start().on_cpu else 4.0


@pytest.fixture
def run_usvauv(tmp_path, monkeypatch, capfd):
    """Function that runs `usvauv` in this process and an empty folder: exit code, standard output, standard error.

    Standard error is without the lines that say what is being done, which end with "…".
    """
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["usvauv", *map(str, arguments)])
        code, (out, err) = app.run(), capfd.readouterr()
        return code, out, "".join(line for line in err.splitlines(keepends=True) if not line.endswith("…\n"))

    return run


@pytest.fixture
def own_registries(monkeypatch):
    """What plugins and the test itself register ends with the test."""
    for name, module in list(sys.modules.items()):
        if name.startswith("usvauv."):
            for registry in [value for value in vars(module).values() if isinstance(value, Registry)]:
                monkeypatch.setattr(registry, "_items", dict(registry))
    monkeypatch.setattr(plugins, "_paths", [])
