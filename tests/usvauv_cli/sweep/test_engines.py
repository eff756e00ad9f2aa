"""The engines: cores kept apart, nothing lost and nothing twice on processes of this machine, Ray and Slurm."""

import gc
import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from tests.usvauv_cli.sweep import slurm_here, work
from usvauv.cli.sweep import perform
from usvauv.cli.sweep.engine import Ended, Engine, Local, Task, conduct, signs_in
from usvauv.cli.sweep.perform import OnRay, OnSlurm
from usvauv.cli.sweep.study import Resources
from usvauv.kernels.errors import UserError
from usvauv.kernels.interruption import SIGNALS

ROOT = Path(__file__).parents[3]
SMALL = Resources(memory=0.5, hours=0.1)


def conducted(engine: Engine, folder: Path, watch=lambda: None, **pieces) -> dict[str, Ended]:
    """Results of pieces on an engine."""
    results = []
    with signs_in(folder) as signs:
        tasks = [Task(name, do, signs, 1, "cpu") for name, do in pieces.items()]
        conduct(engine, tasks, signs, results.append, watch)
    assert sorted(result.name for result in results) == sorted(pieces)
    return {result.name: result for result in results}


def test_a_task_begins_where_it_was_made(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    task = Task("a", work.in_here, tmp_path, 1)
    monkeypatch.chdir(tmp_path)
    assert task() == Ended("a", "done")
    assert Path.cwd() == tmp_path / "here"


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """How pieces on two processes ended, and what they have written by name."""
    folder, lost = tmp_path_factory.mktemp("local"), {"always": 99, "never": 0}
    cores = {name: partial(work.cores_of_process, folder / name) for name in "ab"}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("usvauv.cli.sweep.engine.ATTEMPTS", 2)
        results = conducted(
            Local(2, 1),
            folder,
            **cores,
            **{n: partial(work.killed, folder / n, times) for n, times in lost.items()},
        )
    ends = {name: result.how for name, result in results.items()}
    return ends, {path.name: json.loads(path.read_text()) for path in folder.iterdir()}


class TestLocalEngine:
    @pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system has no such call")
    def test_keeps_cores_apart(self, done):
        cores = sorted(os.sched_getaffinity(0))
        if len(cores) < 2:
            pytest.skip("one core")
        (one, mine, *threads), (other, theirs, *_) = (done[1][name] for name in "ab")
        assert one != other
        assert sorted(mine + theirs) == cores[:2]
        assert threads == ["1", 1, 1]

    def test_does_again_what_a_killed_process_had_and_nothing_else(self, done):
        ends, written = done
        assert ends == {"a": "done", "b": "done", "always": "lost", "never": "done"}
        assert (written["always"], written["never"]) == (2, 1)

    def test_stops_when_it_is_interrupted(self, tmp_path):
        path = tmp_path / "begun"

        def interrupt() -> None:
            if path.exists():
                raise KeyboardInterrupt

        with signs_in(tmp_path) as signs:
            tasks = [Task(name, partial(work.until_stopped, path), signs, 1, "cpu") for name in "ab"]
            with pytest.raises(KeyboardInterrupt):
                conduct(Local(1, 1), tasks, signs, pytest.fail, interrupt)


@pytest.fixture
def slurm(monkeypatch):
    """Commands of the names of Slurm's; a job is soon forgotten."""
    pytest.importorskip("submitit", reason="needs the extra scale")
    monkeypatch.setattr(perform, "ASK", 1.0)
    with slurm_here.stand_in() as variables:
        for name, value in variables.items():
            monkeypatch.setenv(name, value)
        yield


class TestSlurmEngine:
    def engine(self, folder, jobs=2) -> OnSlurm:
        return OnSlurm(folder / "slurm", "batch", jobs, SMALL)

    def test_gives_results_failures_and_what_is_lost(self, slurm, tmp_path):
        pieces = {"fails": work.failing, "once": partial(work.killed, tmp_path / "once", 1)}
        results = conducted(self.engine(tmp_path), tmp_path, **pieces)
        assert results == {"fails": Ended("fails", "failed", "the last line"), "once": Ended("once", "done")}
        assert (tmp_path / "once").read_text() == "2"

    def test_does_again_what_was_cancelled_by_others(self, slurm, tmp_path):
        path, cancelled = tmp_path / "begun", []

        def watch() -> None:
            if path.exists() and not cancelled:
                command = ["squeue", "--me", "--noheader", "--array", "--format=%i"]
                cancelled.extend(subprocess.check_output(command, text=True).split())
                subprocess.check_call(["scancel", *cancelled])

        results = conducted(self.engine(tmp_path), tmp_path, watch, a=partial(work.waits_at_first, path))
        assert results == {"a": Ended("a", "done")}
        assert len(cancelled) == 1
        assert path.read_text() == "2"

    def test_stops_what_a_command_left_that_was_killed(self, slurm, tmp_path):
        """The same command makes other signs, and removes those that its jobs look for."""
        left, path = self.engine(tmp_path), tmp_path / "begun"
        with signs_in(tmp_path) as signs:
            left.submit([Task("a", partial(work.until_stopped, path), signs, 1, "cpu")])
            assert left.wait(0.1) == []
            until = time.monotonic() + 60
            while not path.exists():
                assert time.monotonic() < until
                time.sleep(0.1)
            with signs_in(tmp_path):
                assert left.wait(30) == [Ended("a", "stopped")]

    def test_refuses_a_partition_that_is_not_there(self, slurm, tmp_path):
        engine = OnSlurm(tmp_path / "slurm", "nowhere", 2, SMALL)
        with signs_in(tmp_path) as signs, pytest.raises(UserError) as refused:
            conduct(engine, [Task("a", work.failing, signs, 1, "cpu")], signs, pytest.fail)
        assert str(refused.value).startswith("--slurm nowhere: sbatch: error: invalid partition specified")
        assert "\n" not in str(refused.value)

    def test_says_that_there_is_no_slurm(self, tmp_path, monkeypatch):
        pytest.importorskip("submitit", reason="needs the extra scale")
        monkeypatch.setenv("PATH", "")
        with pytest.raises(UserError, match="--slurm batch: Could not detect"):
            self.engine(tmp_path)


def below(process: int) -> list[int]:
    """Descendants of a process."""
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return [found for child in map(int, children) for found in (child, *below(child))]


def running(process: int) -> bool:
    try:
        return "State:\tZ" not in Path(f"/proc/{process}/status").read_text()
    except OSError:
        return False


# Of Ray's own making: pipes and processes of nodes that are gone, and what later versions of libraries change.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning", "ignore::FutureWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
class TestRayEngine:
    @pytest.fixture(autouse=True)
    def leaves_nothing(self):
        """What Ray leaves is collected here, where its warnings are ignored, not in a later test."""
        yield
        gc.collect()

    @pytest.fixture
    def cluster(self):
        """A Ray cluster of two nodes with a core each, on this machine."""
        pytest.importorskip("ray", reason="needs the extra scale")
        from ray.cluster_utils import Cluster

        before = signal.getsignal(signal.SIGTERM)
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        yield cluster
        cluster.shutdown()
        signal.signal(signal.SIGTERM, before)  # which a node took for itself

    @pytest.mark.slow
    def test_does_again_what_a_removed_node_had_and_nothing_else(self, cluster, tmp_path):
        node = cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes()
        removed = []

        def watch() -> None:
            begun = {path.name.partition("-")[2] for path in tmp_path.glob("?-*")}
            if len(begun) == 2 and not removed:
                assert node.node_id in begun
                cluster.remove_node(node, allow_graceful=False)
                removed.append(node)
                (other,) = begun - {node.node_id}
                (tmp_path / f"go on-{other}").touch()

        engine = OnRay(cluster.address, 1, SMALL)
        results = conducted(engine, tmp_path, watch, **{n: partial(work.on_node, tmp_path, n) for n in "abc"})
        assert {name: result.how for name, result in results.items()} == dict.fromkeys("abc", "done")
        assert removed
        assert sorted((tmp_path / "ended").read_text().split()) == ["a", "b", "c"]
        assert len(list(tmp_path.glob("?-*"))) == 4  # one of them on both nodes

    @pytest.mark.slow
    def test_gives_failures_and_what_is_lost(self, tmp_path):
        pytest.importorskip("ray", reason="needs the extra scale")
        pieces = {"fails": work.failing, "once": partial(work.killed, tmp_path / "once", 1)}
        results = conducted(OnRay("local", 1, SMALL), tmp_path, **pieces)
        assert results == {"fails": Ended("fails", "failed", "the last line"), "once": Ended("once", "done")}
        assert (tmp_path / "once").read_text() == "2"

    @pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc to find processes")
    @pytest.mark.parametrize(
        ("signum", "code"),
        [
            (signal.SIGKILL, -signal.SIGKILL),
            *(pytest.param(signum, 128 + signum, marks=pytest.mark.slow) for signum in SIGNALS),
        ],
    )
    def test_leaves_no_process_however_its_command_ends(self, tmp_path, signum, code):
        pytest.importorskip("ray", reason="needs the extra scale")
        command = subprocess.Popen([sys.executable, "-m", "tests.usvauv_cli.sweep.work", tmp_path], cwd=ROOT)
        while not (tmp_path / "begun").exists():
            assert command.poll() is None
            time.sleep(0.1)
        begun = below(command.pid)
        assert len(begun) > 4  # of Ray
        command.send_signal(signum)
        assert command.wait(60) == code
        until = time.monotonic() + 20  # of themselves two of them stay for a minute
        while left := [process for process in begun if running(process)]:
            assert time.monotonic() < until, left
            time.sleep(0.1)

    def test_says_that_there_is_no_cluster(self):
        pytest.importorskip("ray", reason="needs the extra scale")
        before = signal.getsignal(signal.SIGTERM)
        with pytest.raises(UserError, match="--ray auto: "):
            OnRay("auto", 1, SMALL)
        assert signal.getsignal(signal.SIGTERM) is before
