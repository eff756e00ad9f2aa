"""Training over two processes that talk by gloo: it computes what one process would, and ends and goes on as one."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from tests.policies import ranks as program
from tests.policies.ranks import ALGORITHM_NAMES, STOP, TOTAL, WORLDS
from tests.policies.test_resume import same
from usvauv.kernels.errors import UserError
from usvauv.policies.checkpoint import TRAINING, read
from usvauv.policies.training.ranks import Ranks, joined

pytestmark = pytest.mark.cpu("processes that share one machine")
ROOT = Path(__file__).parents[2]
# Sums of 29 rounded numbers in another order; 100 steps of Adam let the difference grow.
GRADIENT, WEIGHT = 1e-6, 2e-4


def begin(count: int, *command: object) -> list[subprocess.Popen]:
    """Processes as torchrun would start them."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    common = {"WORLD_SIZE": count, "LOCAL_WORLD_SIZE": count, "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    common["OMP_NUM_THREADS"] = 1
    path = {"PYTHONPATH": os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))}
    return [
        subprocess.Popen(
            [sys.executable, *map(str, command)],
            env={**os.environ, **path, **{k: str(v) for k, v in (common | {"RANK": r, "LOCAL_RANK": r}).items()}},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for r in range(count)
    ]


def end(processes: list[subprocess.Popen]) -> list[tuple[int, str, str]]:
    """Exit code, standard output and standard error of each."""
    said = [process.communicate(timeout=300) for process in processes]
    return [(process.returncode, *words) for process, words in zip(processes, said, strict=True)]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Folder of the runs, what each of two ranks has found, and what the first said when the other was killed."""
    folder = tmp_path_factory.mktemp("ranks")
    alone = program.trainer(folder / "alone")
    alone.train(STOP)
    shutil.copytree(folder / "alone", folder / "kept")
    (code, _, error), (code_of_killed, _, error_of_killed) = end(begin(2, "-m", "tests.policies.ranks", folder))
    assert (code, code_of_killed) == (1, -signal.SIGKILL), error + error_of_killed
    return folder, [torch.load(folder / f"rank-{rank}.pt") for rank in range(2)], error.splitlines()[-1]


def close(one, other, tolerance: float) -> None:
    """Largest difference over the largest number of each pair."""
    for own, value in zip(one, other, strict=True):
        assert (own - value).abs().max() <= tolerance * max(1.0, float(value.abs().max()))


@pytest.mark.parametrize("algorithm", ALGORITHM_NAMES)
class TestLearning:
    def test_the_gradient_is_that_of_the_joined_batch(self, run, algorithm):
        expected, _ = program.learned(algorithm)
        for found in run[1]:
            close(found[algorithm][0], expected, GRADIENT)

    def test_weights_and_moments_after_updates_are_those_of_one_process(self, run, algorithm):
        _, expected = program.learned(algorithm)
        assert any("exp_avg_sq" in name for name in expected)
        for found in run[1]:
            assert found[algorithm][1].keys() == expected.keys()
            close(found[algorithm][1].values(), expected.values(), WEIGHT)


class TestRun:
    def test_ranks_hold_equal_weights_and_draw_different_numbers(self, run):
        one, other = run[1]
        for part in ("weights", "resumed"):
            assert one[part].keys() == other[part].keys()
            assert all(torch.equal(one[part][name], other[part][name]) for name in one[part])
        assert not torch.equal(one["generator"], other["generator"])

    def test_figures_are_of_all_worlds(self, run):
        folder, (one, other), _ = run
        about, tensors = read(folder / "whole" / "last.safetensors", TRAINING)
        assert one["figures"]["updates"] == about["updates"] == 2 * (TOTAL - 60) // WORLDS
        assert one["figures"]["steps"] == TOTAL
        assert one["figures"]["arps"] == other["figures"]["arps"]
        assert one["figures"]["learner"] == other["figures"]["learner"]
        assert tensors["replay.reward"].shape[1] == tensors["world.auv"].shape[0] == WORLDS
        rewards = tensors["replay.reward"][tensors["replay.end"].logical_not()]
        assert len({tuple(column) for column in rewards[:, :, 0].T.tolist()}) == WORLDS  # no world twice

    def test_ctrl_c_on_one_stops_all_and_the_run_goes_on_bit_for_bit(self, run):
        folder, found, _ = run
        assert [one["stopped"] for one in found] == [(True, STOP, signal.SIGINT)] * 2
        same(folder / "whole", folder / "parts")

    def test_weights_that_differ_are_refused(self, run):
        for found in run[1]:
            assert found["refused"].startswith("training: ranks have different weights after ")

    @pytest.mark.parametrize("ranks", [Ranks(), Ranks(1, 3)])
    def test_worlds_are_divided_anew(self, run, tmp_path, ranks):
        """Two ranks' run is taken up by one process, or by the middle one of three."""
        shutil.copytree(run[0] / "whole", tmp_path / "run")
        _, tensors = read(tmp_path / "run" / "last.safetensors", TRAINING)
        one, mine = program.trainer(tmp_path / "run", ranks), ranks.share(WORLDS)
        one.resume()
        assert torch.equal(one.observation, tensors["observation"][mine])
        assert torch.equal(one.replay.tensors()["reward"], tensors["replay.reward"][:, mine])
        for name, value in one.world.state().items():
            saved = tensors[f"world.{name}"]
            assert torch.equal(value, saved if name in one.world.common_state else saved[mine]), name
        assert torch.equal(one.generator.get_state(), tensors["generator"][0]) == (ranks.count == 1)
        if ranks.count == 1:
            one.train(TOTAL + 10 * WORLDS)
            assert one.steps == TOTAL + 10 * WORLDS

    def test_the_others_of_a_rank_that_is_killed_say_so(self, run):
        folder, _, last_line = run
        assert re.search(
            r"RankLost: rank 0 of 2: another rank has ended or cannot be reached \([^()]+\); --resume", last_line
        )
        assert read(folder / "parts" / "last.safetensors", TRAINING)[0]["steps"] == TOTAL

    def test_no_thread_of_the_group_is_left(self, run):
        """At the interpreter's end one would abort the process now and then."""
        assert "gloo" not in (run[0] / "threads.txt").read_text()

    def test_a_run_of_one_process_goes_on_in_two(self, run):
        folder = run[0]
        before, after = (read(folder / name / "last.safetensors", TRAINING) for name in ("kept", "alone"))
        assert (before[0]["steps"], after[0]["steps"]) == (STOP, TOTAL)
        assert after[0]["updates"] > before[0]["updates"] > 0
        assert after[0]["history"][: len(before[0]["history"])] == before[0]["history"]
        rows = slice(10, 20)  # which the ring has not overwritten
        for name in ("replay.observation", "replay.reward"):
            assert torch.equal(after[1][name][rows], before[1][name][rows])
            assert before[1][name][rows].any()


class TestCommand:
    @pytest.mark.parametrize(
        ("options", "said"),
        [
            (["--worlds", "1"], "worlds = 1: must be at least 2, one for each rank"),
            pytest.param(
                ["--seeds", "2"],
                "--seeds: several seeds are trained in one process, not by torchrun",
                marks=pytest.mark.slow,
            ),
        ],
    )
    def test_torchrun_and_one_line_of_an_error(self, tmp_path, options, said):
        command = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2", "-m", "usvauv.cli", "train"]
        command += [*options, "--out", str(tmp_path / "run")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode != 0
        assert done.stderr.count(f"error: {said}\n") == 1
        assert done.stdout == ""


def test_an_environment_that_is_not_whole_is_refused(monkeypatch):
    monkeypatch.setenv("WORLD_SIZE", "2")
    monkeypatch.setenv("RANK", "x")
    with pytest.raises(UserError, match=r"RANK = x, WORLD_SIZE = 2, .*: must all be whole numbers"), joined("cpu"):
        pass
