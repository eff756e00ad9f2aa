"""`usvauv train --seeds`: a folder for each seed, which all commands take; all are stopped and go on together."""

import functools
import re
import signal

import numpy as np
import pytest

from tests.policies.test_seeds import same_runs
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.kernels import runtime
from usvauv.policies import TrainingConfig, checkpoint
from usvauv.policies.training.figures import EVALUATION_EPISODES, EVALUATION_SEED_OFFSET
from usvauv.policies.training.trainer import SeedStack

BEGIN = ["train", "ideal", "--worlds", "4", "--set", "mission.duration=12"]
SMALL = {"hidden": (8, 8), "batch": 16, "n_step": 2, "warmup": 24, "replay": 4000}


@pytest.fixture
def quick(monkeypatch):
    """Learning that begins after a few steps."""
    monkeypatch.setattr(TrainingConfig, "of", functools.partial(TrainingConfig.of, **SMALL))


def test_each_folder_is_a_run_of_its_own(tmp_path, run_usvauv, quick):
    code, shown, _ = run_usvauv(*BEGIN, "--steps", 80, "--seed", 3, "--seeds", 2, "--out", "many")
    assert code == 0
    shown = " ".join(shown.split())
    assert "training sac in ideal, seeds 3, 4: an untrained network steers much like clear:80;" in shown
    score, margin = r"ARPS -?[\d.]+ ± [\d.]+ in evaluation", r"margin over clear [+−][\d.]+ ± [\d.]+"
    assert re.search(rf"100%: ARPS \S+ in training; at 80 {score}, {margin} best", shown)
    assert re.search(
        rf"best policy\S*( the untrained one:)? {score}, {margin}, in many/seed-\*/best\.safetensors", shown
    )
    for seed in (3, 4):
        assert sorted(path.name for path in (tmp_path / f"many/seed-{seed}").iterdir()) == [
            "best.safetensors",
            "last.safetensors",
            "tensorboard",
        ]
        assert run_usvauv(*BEGIN, "--steps", 80, "--seed", seed, "--out", f"alone-{seed}")[0] == 0
        same_runs(tmp_path / f"alone-{seed}", tmp_path / f"many/seed-{seed}")
    assert run_usvauv("eval", "ideal", "--policy", "many/seed-4", "--episodes", 1, *BEGIN[-2:])[0] == 0
    assert run_usvauv("train", "--resume", "--out", "many/seed-3", "--steps", 88)[0] == 0
    assert checkpoint.read_run(tmp_path / "many/seed-3")[2]["steps"] == 88
    # All go on: the one that is ahead waits for the other.
    assert run_usvauv("train", "--resume", "--out", "many", "--steps", 96)[0] == 0
    assert [checkpoint.read_run(tmp_path / f"many/seed-{seed}")[2]["steps"] for seed in (3, 4)] == [96, 96]


def test_stopped_or_killed_they_go_on(tmp_path, run_usvauv, quick, monkeypatch):
    """To the bit after Ctrl-C; one that was not saved before a kill begins anew."""
    begin = [*BEGIN, "--steps", 80, "--seeds", 2]
    assert run_usvauv(*begin, "--out", "whole")[0] == 0
    step = SeedStack.step

    def step_and_stop(stack, pool, total):
        first = stack.runs[0]
        if first.steps == 40 and first.config.seed == 0:  # one of two threads: a second Ctrl-C ends without saving
            signal.raise_signal(signal.SIGINT)
        step(stack, pool, total)

    with monkeypatch.context() as patch:
        patch.setattr(SeedStack, "step", step_and_stop)
        code, shown, _ = run_usvauv(*begin, "--out", "parts")
    assert code == 130
    assert "stopped at 44 of 80 world-steps; continue with: --out parts --resume" in shown
    assert run_usvauv("train", "--out", "parts", "--resume")[0] == 0
    for seed in (0, 1):
        same_runs(tmp_path / f"whole/seed-{seed}", tmp_path / f"parts/seed-{seed}", tolerance=0.0)
    (tmp_path / "killed/seed-1").mkdir(parents=True)
    (tmp_path / "whole/seed-0").rename(tmp_path / "killed/seed-0")
    assert run_usvauv("train", "--out", "killed", "--resume")[0] == 0
    same_runs(tmp_path / "whole/seed-1", tmp_path / "killed/seed-1")


def test_stopped_before_the_first_step_it_says_that_nothing_is_there(tmp_path, run_usvauv, monkeypatch):
    """While its worlds are made; the same command may be given again."""
    with monkeypatch.context() as patch:
        patch.setattr(runtime, "start", lambda arch: signal.raise_signal(signal.SIGINT))
        code, shown, stderr = run_usvauv(*BEGIN, "--out", "early")
    assert (code, stderr) == (130, "stopped\n")
    assert shown == "stopped before training; nothing in early to resume: the same command begins anew\n"
    assert not list((tmp_path / "early").iterdir())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--seeds", "0"], "--seeds 0: must be from 1 to 1024"),
        (["--seed", str(2**63 - 1), "--seeds", "2"], f"seed = {2**63}: must be from 0 to 2**63 - 1"),
        (["--seeds", "2", "--resume"], "--seeds: a resumed run keeps the seeds it was begun with"),
        (["--seeds", "2", "--out", "held"], "--out held: holds a run already; continue it with --resume"),
        (["--out", "held"], "--out held: holds a run already; continue it with --resume"),
        (["--out", "empty", "--resume"], "empty/seed-5/last.safetensors: checkpoint is missing"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, refused, options, said):
    (tmp_path / "held/seed-7").mkdir(parents=True)
    (tmp_path / "held/seed-7/last.safetensors").touch()
    (tmp_path / "empty/seed-5").mkdir(parents=True)
    assert said in refused("train", *options)


def test_the_margin_is_that_of_paired_episodes(tmp_path, run_usvauv, quick):
    """With half of its interval by Student's t from the table, found anew from the best policy that was kept."""
    code, shown, _ = run_usvauv(*BEGIN, "--steps", 80, "--out", "one")
    assert code == 0
    found = re.findall(r"margin over clear ([+−][\d.]+) ± ([\d.]+)", shown)[-1]
    mean, half = (float(text.replace("−", "-")) for text in found)
    worlds = World(Scenario.load("ideal", ["mission.duration=12"]), EVALUATION_EPISODES, EVALUATION_SEED_OFFSET)
    scores = [np.array([row.arps for row in policies.evaluated(worlds, name)]) for name in (tmp_path / "one", "clear")]
    margins = scores[0] - scores[1]
    assert len(margins) == 32
    assert mean == pytest.approx(margins.mean(), abs=0.01)
    assert half == pytest.approx(2.0395 * margins.std(ddof=1) / np.sqrt(32), abs=0.01)  # t of 31 degrees of freedom
