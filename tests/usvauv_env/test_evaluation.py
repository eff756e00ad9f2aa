"""Evaluation of policies in the same seeded worlds."""

from dataclasses import replace
from itertools import chain, product

import numpy as np
import pytest
import torch

from usvauv.env import Scenario, evaluate
from usvauv.env.record import evaluation
from usvauv.env.record.metrics import episode_metrics
from usvauv.env.record.recorder import EACH, Recorder, record, trace_bytes
from usvauv.env.world.world import World
from usvauv.kernels.errors import UserError
from usvauv.kernels.mission.columns import AuvColumn, EstimateColumn, NodeColumn, TallyColumn


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


def test_a_batch_is_halved_until_its_records_fit(scenario, monkeypatch):
    """What all worlds share fits once, what is of each world ten times."""
    world = World(scenario, 1)
    shared = EACH * world.steps
    each = trace_bytes(world, world.steps) - shared
    assert trace_bytes(World(scenario, 3), 7) == pytest.approx(7 / world.steps * (shared + 3 * each))
    monkeypatch.setattr(evaluation, "World", lambda *given, **how: world)
    monkeypatch.setattr(evaluation.memory, "SHARE", 0.5)
    for fitting, episodes, size in ((10, 37, 10), (9.99, 37, 5), (200, 37, 37), (500, 500, 128), (0.5, 37, 1)):
        monkeypatch.setattr(evaluation.memory, "available", lambda fitting=fitting: 2 * (shared + fitting * each))
        assert evaluation.batch_size(scenario, episodes) == size


def test_a_recorder_keeps_some_states_of_some_worlds(scenario):
    world = World(scenario, 3, 5)
    recorder = Recorder(world)
    world.reset()
    states = []
    for step in range(4):
        world.step(torch.full((3, 2, 2), 0.3 * step - 0.4))
        recorder.add()
        states.append([each.numpy().copy() for each in (world.auv, world.node, world.estimate, world.tally)])
    recorder.drop_last()
    assert len(recorder) == 3
    trace = recorder.trace("p", np.zeros((0, 0, 0)), first=1, start=5.0, worlds=slice(1, 3))
    assert trace.time.tolist() == [5, 6]
    auv, _, known, tally = (np.stack([state[i][1:] for state in states[1:3]]) for i in range(4))
    node = world.node[1:].numpy()
    for name, expected in (
        ("auv_position", auv[..., [AuvColumn.x, AuvColumn.y]]),
        ("target", auv[..., AuvColumn.target]),
        ("node_rate", node[..., NodeColumn.rate]),
        ("node_position", node[..., [NodeColumn.x, NodeColumn.y]]),
        ("estimate", known[..., [EstimateColumn.x, EstimateColumn.y]]),
        ("served_by", known[..., EstimateColumn.served_by]),
        *((name, tally[..., getattr(TallyColumn, name)]) for name in ("collisions", "packets_created", "packets_lost")),
    ):
        np.testing.assert_array_equal(getattr(trace, name), expected, err_msg=name)
    backlog = np.stack([state[1][1:, :, NodeColumn.backlog] for state in states[1:3]])
    np.testing.assert_array_equal(trace.backlog, backlog)
    assert (trace.stream.shape, trace.stream_time.shape) == ((0, 0, 0, 2), (0,))
    recorder.clear()
    assert len(recorder) == 0


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
