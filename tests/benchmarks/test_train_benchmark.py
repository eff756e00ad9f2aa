"""The training benchmark's bookkeeping: when it evaluates, what counts as passed, and how others see our frame."""

import importlib

import numpy as np
import pytest
import torch

from benchmarks import train
from usvauv.env import Scenario
from usvauv.policies.frames import TargetFrame


class Clock:
    """A clock that is set by hand."""

    now = 0.0

    def __call__(self):
        return self.now


class Evaluator:
    """Takes 100 s for each evaluation and finds what it was told to find."""

    class world:
        num_auvs = 2

    def __init__(self, clock, scores):
        self.clock, self.scores = clock, iter(scores)

    def __call__(self, act):
        self.clock.now += 100.0
        return next(self.scores)


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(train.time, "perf_counter", clock)
    return clock


def course(clock, scores, limit=1000.0):
    return train.Course("test", Evaluator(clock, scores), {"low": 1.0, "high": 2.0}, limit)


def test_the_clock_stands_still_while_evaluating(clock):
    run = course(clock, [0.0, 0.5, 0.6])
    assert not run.look(None, 0, 0)
    clock.now += 0.9
    assert not run.look(None, 1, 10)
    assert len(run.looks) == 1  # too soon
    clock.now += 1.1
    assert not run.look(None, 2, 20)
    clock.now += 40.0
    assert not run.look(None, 3, 30)
    assert [look["seconds"] for look in run.looks] == pytest.approx([0.0, 2.0, 42.0])
    clock.now += 2.0  # 5 % of 44 s are more
    assert not run.look(None, 4, 40)
    assert len(run.looks) == 3


def test_a_target_is_passed_by_two_in_a_row_after_the_first_update(clock):
    scores = [3.0, 1.5, 0.5, 1.2, 2.5, 1.3, 2.0, 2.1]
    run = course(clock, scores)
    for updates in range(len(scores)):
        over = run.look(None, updates, 10 * updates)
        assert over == (updates == len(scores) - 1)
        clock.now += 2.0
    passed = run.passed()
    assert passed["low"]["updates"] == 3
    assert passed["high"]["updates"] == 6
    assert passed["high"]["agent_steps"] == 120
    assert passed["high"]["seconds"] == pytest.approx(12.0)


def test_the_limit_ends_a_run(clock):
    run = course(clock, [0.0, 0.0], limit=5.0)
    run.look(None, 0, 0)
    clock.now += 5.5
    assert run.look(None, 9, 9)
    assert run.passed() == {"low": None, "high": None}


def test_a_run_that_did_not_arrive_bounds_the_ratio():
    missing, half = (
        {"runs": [{}], "low": {"seconds": train.figures(values)}} for values in ([3.0, float("inf")], [9.0, 8.0])
    )
    assert missing["low"]["seconds"] == {"median": 3.0, "all": [3.0, None]}
    results = {"ours": half, "sb3_a": {"runs": [{}], "low": {"seconds": train.figures([float("inf")])}}}
    assert train.ratios(results, {"low": 1.0}, 80.0) == {"low": {"sb3_a": {"times": 10.0, "lower_bound": True}}}


def test_stable_baselines3_sees_and_steers_through_our_frame():
    pytest.importorskip("stable_baselines3")
    others = importlib.import_module("benchmarks.stable_baselines3_sac")
    scenario = Scenario.load("extreme", ["mission.duration=2.0"])
    frame = TargetFrame(scenario)
    plain = others.AuvVecEnv(scenario, 3, 5)
    framed = others.Framed(others.AuvVecEnv(scenario, 3, 5), frame)
    seen = plain.reset()
    assert np.array_equal(framed.reset(), frame.encode(torch.from_numpy(seen)).numpy())
    steer = np.random.default_rng(0).uniform(-1, 1, (6, 2)).astype(np.float32)
    for last in (False, True):
        own = frame.decode(torch.from_numpy(seen), torch.from_numpy(steer)).numpy()
        seen, reward, done, infos = plain.step(own)
        features, framed_reward, framed_done, framed_infos = framed.step(steer)
        assert np.array_equal(features, frame.encode(torch.from_numpy(seen)).numpy())
        assert np.array_equal(reward, framed_reward)
        assert done.all() == framed_done.all() == last
    end = frame.encode(torch.from_numpy(infos[4]["terminal_observation"])).numpy()
    assert np.array_equal(framed_infos[4]["terminal_observation"], end)
