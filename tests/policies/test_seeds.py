"""Many seeds in one process: each is the run that its seed gives alone, also when stopped, resumed or left behind."""

from __future__ import annotations

import dataclasses
import math
import signal

import pytest
import torch

from tests.policies.toy import LEARNING, ToyWorld, mean_reward, scenario
from usvauv.env import Scenario, World
from usvauv.kernels.errors import DivergenceError
from usvauv.policies import PolicyError, Trainer, TrainingConfig, TrainingRun, resume
from usvauv.policies.algorithms import algorithms
from usvauv.policies.algorithms.deterministic import DDPG
from usvauv.policies.checkpoint import POLICY, TRAINING, read

SEEDS = (3, 4, 9)
SHORT = dataclasses.replace(LEARNING, num_worlds=8, hidden=(16, 16), batch=32, warmup=160, replay=8 * 64)
UPDATES = 100
STEPS = SHORT.before_learning + 8 * UPDATES

# Relative to the largest number of a tensor. Roundings of 6e-8 grow while learning goes on from what was learned.
TOLERANCE = 1e-4


def toy_run(seed, folder=None, evaluate=False, **changes):
    config = dataclasses.replace(SHORT, seed=seed, **changes)
    toy = scenario()
    probe = ToyWorld(toy, 4, seed=99)
    score = (lambda policy: {"arps": mean_reward(probe, policy)}) if evaluate else None
    return TrainingRun(ToyWorld(toy, 8, seed), config, folder, score)


def difference(one, other):
    """Largest difference of two sets of tensors, each relative to the largest number of its tensor."""
    assert one.keys() == other.keys()
    apart = [0.0]
    for name, value in one.items():
        own, others = value.double(), other[name].double()
        assert own.shape == others.shape
        apart.append(float((own - others).abs().max() / own.abs().max().clamp(min=1e-3)))
    return max(apart)


def saved(folder, part=TRAINING):
    return read(folder / "last.safetensors", part)


def float_tensors(tensors):
    return {name: value for name, value in tensors.items() if value.is_floating_point()}


def same_runs(one, other, tolerance=TOLERANCE):
    """Two folders hold the same run; what is drawn is the same to the bit."""
    for part in (POLICY, TRAINING):
        (about, tensors), (about_other, others) = saved(one, part), saved(other, part)
        assert difference(float_tensors(tensors), float_tensors(others)) <= tolerance
        assert about["steps"] == about_other["steps"]
        assert about["updates"] == about_other["updates"]
        if part == TRAINING:
            assert torch.equal(tensors["generator"], others["generator"])
            assert [row["steps"] for row in about["history"]] == [row["steps"] for row in about_other["history"]]


class TestOneSeedIsAsAlone:
    @pytest.mark.parametrize(
        ("changes", "threads"),
        [
            ({}, 2),
            ({"algorithm": "td3", "renewal": False}, 1),
            ({"algorithm": "ppo", "rollout": 16, "shared": True, "correlation": 0.0}, 1),
            pytest.param({"algorithm": "ddpg", "shared": True, "updates": 2}, 1, marks=pytest.mark.slow),
        ],
        ids=str,
    )
    def test_weights_after_a_hundred_updates(self, changes, threads):
        runs = [toy_run(seed, **changes) for seed in SEEDS]
        Trainer(*runs, threads=threads).train(STEPS)
        weights = []
        for seed, run in zip(SEEDS, runs, strict=True):
            alone = toy_run(seed, **changes)
            Trainer(alone).train(STEPS)
            if not run.config.on_policy:
                assert run.learner.updates == UPDATES * run.config.updates
            assert run.learner.updates == alone.learner.updates > 0
            assert difference(alone.learner.tensors(), run.learner.tensors()) < TOLERANCE
            assert difference(alone.replay.tensors(), run.replay.tensors()) < TOLERANCE
            assert float(run.gain) == pytest.approx(float(alone.gain), rel=1e-5)
            weights.append(run.learner.actor.weights[0])
        assert not torch.allclose(weights[0], weights[1], atol=0.01)  # seeds differ

    def test_in_the_real_world(self, tmp_path):
        """Of the commands' kind: worlds of the seed, one of which ends while it learns."""
        settings = Scenario.load("extreme", ["mission.duration=12"])
        config = TrainingConfig(num_worlds=4, replay=160, hidden=(16, 16), batch=32, n_step=3, warmup=40)

        def run(seed, folder):
            return TrainingRun(World(settings, 4, seed), dataclasses.replace(config, seed=seed), folder)

        Trainer(*(run(seed, tmp_path / f"seed-{seed}") for seed in (5, 6)), threads=2).train(200)
        for seed in (5, 6):
            Trainer(run(seed, tmp_path / f"alone-{seed}")).train(200)
            same_runs(tmp_path / f"alone-{seed}", tmp_path / f"seed-{seed}")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Folder of runs that were never stopped."""
    folder = tmp_path_factory.mktemp("whole")
    Trainer(*kept_runs(folder)).train(STEPS)
    return folder


def kept_runs(folder, seeds=SEEDS):
    return [toy_run(seed, folder / f"seed-{seed}", evaluate=True) for seed in seeds]


def stop_at(folder, steps):
    """Train, with Ctrl-C during the step after which `steps` world-steps are done."""
    runs = kept_runs(folder)
    trainer, world, step = Trainer(*runs), runs[-1].world, runs[-1].world.step

    def step_and_stop(action):
        if runs[-1].steps + 8 == steps:
            signal.raise_signal(signal.SIGINT)
        return step(action)

    world.step = step_and_stop
    trainer.train(STEPS)
    assert trainer.stopped
    assert [run.steps for run in runs] == [steps] * len(runs)


def resumed(folder, seeds=SEEDS):
    runs = kept_runs(folder, seeds)
    for run in runs:
        resume(run)
    return runs


class TestStopped:
    def test_ctrl_c_saves_all_and_all_go_on(self, whole, tmp_path):
        stop_at(tmp_path, SHORT.before_learning + 8 * 37)
        Trainer(*resumed(tmp_path)).train(STEPS)
        for seed in SEEDS:
            same_runs(whole / f"seed-{seed}", tmp_path / f"seed-{seed}", tolerance=0.0)

    def test_those_left_behind_come_up_first(self, whole, tmp_path):
        """As after a kill between the first run's checkpoint and the others'."""
        stop_at(tmp_path, SHORT.before_learning + 8 * 20)
        ahead, *behind = resumed(tmp_path)
        steps, seen = SHORT.before_learning + 8 * 60, []
        trainer = Trainer(ahead)
        trainer.train(STEPS, lambda figures: trainer.stop() if ahead.steps >= steps else None)
        ahead = resumed(tmp_path, SEEDS[:1])[0]
        assert ahead.steps > behind[0].steps
        Trainer(ahead, *behind).train(STEPS, lambda figures: seen.append([own["steps"] for own in figures]))
        assert len(seen[0]) == 2
        assert len(seen[-1]) == 3
        assert seen[-1] == [STEPS] * 3
        for seed in SEEDS:
            same_runs(whole / f"seed-{seed}", tmp_path / f"seed-{seed}")


class TestRefused:
    def test_runs_that_differ_in_more_than_the_seed(self):
        with pytest.raises(PolicyError, match=r"^training: seeds 0 and 1: settings or scenario differ[^\n]+$"):
            Trainer(toy_run(0), toy_run(1, learning_rate=1e-4))

    @pytest.mark.usefixtures("own_registries")
    def test_an_algorithm_with_a_tensor_without_the_axis_of_networks(self):
        class Odd(DDPG):
            def __init__(self, sizes, config, generator):
                super().__init__(sizes, config, generator)
                self.register_buffer("mean", torch.zeros(7))

        algorithms.register("odd", Odd)
        with pytest.raises(PolicyError, match=r"'odd' cannot train several seeds together: mean has shape \(7,\)"):
            Trainer(*(toy_run(seed, algorithm="odd") for seed in SEEDS)).train(STEPS)

    def test_a_run_that_diverges_is_named(self, tmp_path):
        runs = [toy_run(seed, tmp_path / str(seed)) for seed in SEEDS]
        trainer = Trainer(*runs)
        trainer.train(SHORT.before_learning + 8)
        before = [saved(run.directory)[0]["steps"] for run in runs]
        next(runs[1].learner.actor.parameters()).data.fill_(math.nan)
        with pytest.raises(DivergenceError, match=rf"^seed {SEEDS[1]}: training: \S+ is not finite after"):
            trainer.train(STEPS)
        assert [saved(run.directory)[0]["steps"] for run in runs] == before
