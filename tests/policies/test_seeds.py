"""Many seeds in one process: each is the run that its seed gives alone, also when stopped, resumed or left behind."""

from __future__ import annotations

import dataclasses

import pytest
import torch

from policies import Seeds, Trainer, TrainingConfig
from policies.checkpoint import LAST, POLICY, TRAINING, read
from tests.policies.toy import LEARNING, ToyWorld, mean_reward, scenario
from usvauv_env import Scenario, World

SEEDS = (3, 4, 9)
SHORT = dataclasses.replace(LEARNING, num_worlds=8, hidden=(16, 16), batch=32, warmup=160, replay=8 * 64)
UPDATES = 200
STEPS = SHORT.before_learning + 8 * UPDATES

# Relative to the largest number of a tensor. Roundings of 6e-8 grow while learning goes on from what was learned.
TOLERANCE = 1e-4


def toy_run(seed, folder=None, evaluate=False, **changes):
    config = dataclasses.replace(SHORT, seed=seed, **changes)
    toy = scenario()
    probe = ToyWorld(toy, 4, seed=99)
    score = (lambda policy: {"arps": mean_reward(probe, policy)}) if evaluate else None
    return Trainer(ToyWorld(toy, 8, seed), config, folder, score)


def difference(one, other):
    """Largest difference of two sets of tensors, each relative to the largest number of its tensor."""
    assert one.keys() == other.keys()
    apart = [0.0]
    for name, value in one.items():
        own, others = value.double(), other[name].double()
        assert own.shape == others.shape
        apart.append(float((own - others).abs().max() / own.abs().max().clamp(min=1e-3)))
    print("apart", max(apart))
    return max(apart)


def saved(folder, part=TRAINING):
    return read(folder / LAST, part, torch.device("cpu"))


def float_tensors(tensors):
    return {name: value for name, value in tensors.items() if value.is_floating_point()}


def same_runs(one, other, tolerance=TOLERANCE):
    """Two folders hold the same run; what is drawn is the same to the bit."""
    for part in (POLICY, TRAINING):
        (about, tensors), (about_other, others) = saved(one, part), saved(other, part)
        assert difference(float_tensors(tensors), float_tensors(others)) <= tolerance
        assert about.keys() == about_other.keys()
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
            ({"algorithm": "ddpg", "shared": True, "frame": "world"}, 1),
            ({"shared": True, "updates": 2}, 1),
        ],
        ids=str,
    )
    def test_weights_after_some_hundred_updates(self, changes, threads):
        runs = [toy_run(seed, **changes) for seed in SEEDS]
        Seeds(runs, threads).train(STEPS)
        weights = []
        for seed, run in zip(SEEDS, runs, strict=True):
            alone = toy_run(seed, **changes)
            alone.train(STEPS)
            assert run.learner.updates == alone.learner.updates == UPDATES * run.config.updates
            assert difference(alone.learner.tensors(), run.learner.tensors()) < TOLERANCE
            assert difference(alone.replay.tensors(), run.replay.tensors()) < TOLERANCE
            assert run.gain == pytest.approx(alone.gain, rel=1e-5)
            weights.append(run.learner.actor.weights[0])
        assert not torch.allclose(weights[0], weights[1], atol=0.01)  # seeds differ

    def test_figures_are_those_of_each(self):
        runs, seen = [toy_run(seed) for seed in SEEDS], []
        Seeds(runs).train(STEPS, seen.append)
        for index, seed in enumerate(SEEDS):
            alone = []
            toy_run(seed).train(STEPS, alone.append)
            assert len(alone) == len(seen)
            for own, others in zip(alone, seen, strict=True):
                figures = others[index]
                assert figures.keys() == own.keys()
                for name in ("steps", "total", "updates", "services", "evaluated_at"):
                    assert figures[name] == own[name]
                assert figures["arps"] == pytest.approx(own["arps"], rel=1e-4)

    def test_in_the_real_world(self, tmp_path):
        """Of the commands' kind: worlds of the seed, one of which ends while it learns."""
        settings = Scenario.load("extreme", ["mission.duration=12"])
        config = TrainingConfig(num_worlds=4, replay=160, hidden=(16, 16), batch=32, n_step=3, warmup=40)

        def run(seed, folder):
            return Trainer(World(settings, 4, seed), dataclasses.replace(config, seed=seed), folder)

        Seeds([run(seed, tmp_path / f"seed-{seed}") for seed in (5, 6)], threads=2).train(200)
        for seed in (5, 6):
            run(seed, tmp_path / f"alone-{seed}").train(200)
            same_runs(tmp_path / f"alone-{seed}", tmp_path / f"seed-{seed}")
