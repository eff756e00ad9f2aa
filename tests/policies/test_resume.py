"""A training run in the real world that is stopped and goes on ends bit for bit as one that was never stopped."""

from __future__ import annotations

import functools
import signal
from pathlib import Path

import pytest
import torch

from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.policies import Trainer, TrainingConfig, TrainingRun, resume
from usvauv.policies.checkpoint import POLICY, TRAINING, provenance, read

# With filters and their memory. 4 worlds of 12 steps an episode: one ends after 48 world-steps.
SCENARIO = ["mission.duration=12"]
WORLDS, WARMUP, TOTAL = 4, 80, 200
SMALL = {"hidden": (16, 16), "batch": 32, "n_step": 3, "rollout": 20, "warmup": WARMUP, "updates": 2}


def training_run(directory: Path, algorithm: str, seed: int = 5) -> TrainingRun:
    """In worlds of its own; its evaluations depend on every weight of the actor."""
    config = TrainingConfig(algorithm=algorithm, num_worlds=WORLDS, replay=WORLDS * 40, **SMALL)
    world = World(Scenario.load("extreme", SCENARIO), WORLDS, seed)
    probe = torch.rand((8, 2, world.observation_size), generator=torch.Generator().manual_seed(0)).to(world.device)
    return TrainingRun(world, config, directory, lambda policy: {"arps": float(policy.act(probe).sum())})


def same(one: Path, other: Path, *apart: str) -> None:
    """Two runs' last and best checkpoints are equal to the bit; `apart` names fields of their JSON that may differ."""
    assert sorted(path.name for path in one.iterdir()) == sorted(path.name for path in other.iterdir())
    for name, part in (("last", POLICY), ("last", TRAINING), ("best", POLICY)):
        (about, tensors), (about_other, others) = (read(run / f"{name}.safetensors", part) for run in (one, other))
        assert tensors.keys() == others.keys()
        assert [key for key in tensors if not torch.equal(tensors[key], others[key])] == []
        for key in ("seconds", *apart):
            about.pop(key, None)
            about_other.pop(key, None)
        assert about == about_other


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder of the run that was never stopped, by algorithm."""
    place = tmp_path_factory.mktemp("whole")

    @functools.cache
    def folder(algorithm: str) -> Path:
        Trainer(training_run(place / algorithm, algorithm)).train(TOTAL)
        return place / algorithm

    return folder


@pytest.mark.parametrize(
    ("algorithm", "stops"),
    [
        # An evaluation is due; an episode has just ended; the next step measures the features; after it.
        ("sac", [20, 48, WARMUP, WARMUP + 4]),
        ("sac", [44, 92, 148]),  # the replay's ring has gone round
        ("td3", [108]),
        ("ddpg", [108]),
        ("ppo", [20, 88, 92]),  # an action is held; a rollout is over; an update was the last thing
    ],
)
def test_bit_for_bit(whole, tmp_path, algorithm, stops):
    run = training_run(tmp_path / "run", algorithm)
    for stop in stops:
        interrupt(run, stop)
        assert run.steps == stop
        # What the new process builds has been in use: nothing may be left of it.
        run = training_run(tmp_path / "run", algorithm)
        run.world.reset()
        for _ in range(5):
            run.world.step(torch.ones((WORLDS, 2, 2)))
        resume(run)
    Trainer(run).train(TOTAL)
    same(whole(algorithm), tmp_path / "run")


def interrupt(run: TrainingRun, steps: int) -> None:
    """Train, with Ctrl-C during the step after which `steps` world-steps are done."""
    trainer, step = Trainer(run), run.world.step

    def step_and_stop(action):
        if run.steps + WORLDS == steps:
            signal.raise_signal(signal.SIGINT)
        return step(action)

    run.world.step = step_and_stop
    trainer.train(TOTAL)
    assert trainer.stopped


def test_the_runs_compared_have_learned(whole):
    for algorithm in ("sac", "td3", "ddpg"):
        last = whole(algorithm) / "last.safetensors"
        about, tensors = read(last, TRAINING)
        assert about["updates"] == 2 * (TOTAL - WARMUP) // WORLDS
        assert about["size"] == 40  # full: 50 steps and 4 ends of episodes went in
        assert (read(last, POLICY)[1]["whitening.deviation"] != 1).any()
        assert tensors["world.sea_episode"].tolist() == [4, 2]


def test_ctrl_c_then_resume_of_the_command_equals_a_run_never_stopped(tmp_path, monkeypatch, run_usvauv):
    settings = {"hidden": "16,16", "batch": 32, "n_step": 3, "warmup": WARMUP, "updates": 2, "replay": 4000}
    learn = [text for name, value in settings.items() for text in ("--learn", f"{name}={value}")]
    short = ["--set", "mission.duration=12"]
    begin = ["train", "extreme", "--steps", "400", "--worlds", "8", "--algorithm", "td3", *short, *learn, "--out"]
    assert run_usvauv(*begin, "whole")[0] == 0
    step, done = World.step, []

    def step_and_stop(world, action):
        done.extend([8] if world.num_worlds == 8 else [])
        if world.num_worlds == 8 and sum(done) == 168:  # between two evaluations
            signal.raise_signal(signal.SIGINT)
        return step(world, action)

    with monkeypatch.context() as patch:
        patch.setattr(World, "step", step_and_stop)
        code, said, _ = run_usvauv(*begin, "parts")
    assert (code, "stopped at 168 of 400 world-steps" in said) == (130, True)
    for again, word in (([*begin, "parts"], "--resume"), ([*begin, "parts", "--resume"], "--set")):
        code, _, error = run_usvauv(*again)
        assert (code, word in error) == (2, True)
    assert run_usvauv("train", "--out", "parts", "--resume")[0] == 0
    same(tmp_path / "whole", tmp_path / "parts", "command", "resumed")
    about = policies.read_run(tmp_path / "parts")[2]
    assert about["steps"] == 400
    assert about["command"].startswith("usvauv train extreme --steps 400")
    assert [(again["steps"], again["command"].split()[-1]) for again in about["resumed"]] == [(168, "--resume")]
    assert about["training"]["algorithm"] == "td3"
    assert list((tmp_path / "parts" / "tensorboard").glob("events*"))
    assert run_usvauv("eval", "--policy", "parts/last", "--episodes", 1, *short)[0] == 0


def test_where_git_is_not_installed_the_commit_is_unknown(monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert provenance({})["commit"] == "unknown"
