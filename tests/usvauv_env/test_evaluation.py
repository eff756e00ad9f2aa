"""Evaluation of policies in the same seeded worlds."""

from dataclasses import replace
from itertools import chain, product

import pytest
import torch

from kernels.errors import UserError
from usvauv_env import Scenario, evaluate
from usvauv_env.record import evaluation
from usvauv_env.record.metrics import episode_metrics
from usvauv_env.record.recorder import record
from usvauv_env.world.world import World


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return Scenario.load("ideal", ["mission.duration=10"])


def texts(rows):
    """Rows as text, in which a NaN equals itself."""
    return [str(row) for row in rows]


class East:
    """A constant action, as an object."""

    def __init__(self, world):
        self.action = torch.zeros(world.num_worlds, world.num_auvs, 2)
        self.action[..., 0] = 0.8

    def act(self, observation):
        return self.action


def east(world):
    """The same, as a function."""
    return East(world).act


def test_each_policy_has_the_episodes_of_the_seed(scenario):
    rows = evaluate(scenario, {"object": East, "function": east}, episodes=3, seed=5, usv="centroid")
    assert [(row.policy, row.episode) for row in rows] == [*product(("object", "function"), range(3))]
    world = World(scenario, 3, 5, "centroid")
    expected = episode_metrics(record(world, east(world), "expected"))
    for of_one in (rows[:3], rows[3:]):
        assert texts(replace(row, policy="expected") for row in of_one) == texts(expected)


def test_batches_change_nothing_and_are_told_of(scenario, monkeypatch):
    whole = evaluate(scenario, {"east": East}, episodes=5)
    monkeypatch.setattr(evaluation, "WORLDS_PER_BATCH", 2)
    batches, steps, traces = [], [], []
    told = {"on_step": steps.append, "on_batch": batches.append, "on_trace": lambda *given: traces.append(given)}
    rows = evaluate(scenario, {"east": East}, episodes=5, **told)
    assert texts(rows) == texts(whole) == texts(chain(*batches))
    assert [len(batch) for batch in batches] == [2, 2, 1]
    assert texts(rows) == texts(chain(*(episode_metrics(trace, first) for trace, first in traces)))
    assert steps == [2] * 20 + [1] * 10


def test_complete_batches_are_kept_when_a_policy_fails(scenario, monkeypatch):
    monkeypatch.setattr(evaluation, "WORLDS_PER_BATCH", 2)
    kept = []

    def fails_later(world):
        return east(world) if not kept else lambda observation: 1 / 0

    with pytest.raises(ZeroDivisionError):
        evaluate(scenario, {"late": fails_later}, episodes=4, on_batch=kept.extend)
    assert [row.episode for row in kept] == [0, 1]


def test_actions_of_a_network_leave_no_graph_behind(scenario):
    def network(world):
        layer = torch.nn.Linear(world.observation_size, 2)
        worlds.append(world)
        return lambda observation: layer(observation).tanh()

    worlds: list[World] = []
    evaluate(scenario, {"network": network}, episodes=1)
    assert worlds[0]._action.grad_fn is None


def test_no_episodes_are_refused(scenario):
    with pytest.raises(UserError, match=r"^episodes = 0: must be at least 1$"):
        evaluate(scenario, {"east": East}, episodes=0)
