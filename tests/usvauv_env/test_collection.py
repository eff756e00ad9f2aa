"""Age, fairness, loss and cost of the data: on paper, and against the state of worlds step by step."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.usvauv_env.test_metrics import small_trace
from usvauv.env import Scenario, Trace, World
from usvauv.env.record import collection
from usvauv.env.record.metrics import episode_metrics, mean_figures
from usvauv.env.record.recorder import record
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.policies import load


def served_once() -> Trace:
    """Six steps of 2 s, two nodes: AUV 0 arrives at node 1 in step 1, [2 s, 4 s], hovers in steps 2 and 3."""
    trace = small_trace()
    longer = {
        name: np.zeros((6, *getattr(trace, name).shape[1:]))
        for name in ("hovering", "service_rate", "delivered", "power", "target", "packets_lost")
    }
    longer["hovering"][2:4, 0, 0] = 1
    longer["service_rate"][3, 0, 0] = 0.5
    longer["delivered"][3, 0, 0] = 1.5
    longer["power"][:] = 50
    longer["target"][:3, 0, 0] = 1
    longer["packets_lost"][4:, 0] = [100, 150]
    return replace(trace, **longer, time=2.0 * np.arange(1, 7), backlog=np.zeros((6, 1, 2)))


def test_on_paper():
    trace = served_once()
    age = collection.age(trace)[:, 0]
    assert age[:, 0].tolist() == [2, 4, 6, 8, 10, 12]
    assert age[:, 1].tolist() == [2, 4, 6, 6, 8, 10]  # born until 2 s, when the AUV's last step of travelling began
    assert collection.mean_age(trace) == pytest.approx([78 / 12])
    assert collection.peak_age(trace) == pytest.approx([8])
    assert collection.largest_age(trace) == pytest.approx([12])
    assert collection.fairness(trace) == pytest.approx([0.5])
    assert collection.lost_data(trace) == pytest.approx([250 / 5000 * 2])
    assert collection.energy_per_data(trace) == pytest.approx([2 * 6 * 50 * 2 / 1.5])


def test_fairness_of_equal_nodes():
    trace = served_once()
    trace.service_rate[5, 0, 1], trace.delivered[5, 0, 1], trace.target[4, 0, 1] = 0.5, 1.5, 0
    assert collection.fairness(trace) == pytest.approx([1])


def test_without_a_service():
    trace = served_once()
    trace.service_rate[:] = trace.delivered[:] = 0
    for figure in (collection.peak_age, collection.fairness, collection.energy_per_data):
        assert np.isnan(figure(trace)).all()


def test_means_are_of_the_episodes_that_have_a_figure():
    empty = small_trace()
    empty.service_rate[:] = empty.delivered[:] = 0
    rows = [*episode_metrics(small_trace()), *episode_metrics(empty)]
    means = mean_figures(rows)
    assert means["joule_per_mbit"] == pytest.approx((285 + 400) * 2 / 3.5)
    assert means["services"] == 1


def test_is_what_happens_in_worlds():
    """The newest births, followed in the state of three worlds, step by step."""
    world, twin = (World(Scenario.load("extreme", ["mission.duration=400"]), 3, seed=5, usv="centroid") for _ in "ab")
    policy = load("pace", world)
    trace = record(twin, load("pace", twin).act, "pace")
    observation = world.reset()
    birth, begun, expected = torch.zeros(3, 30), torch.zeros(3, 2), []
    for step in range(400):
        hovering, target = world.auv[..., AuvColumn.hover] > 0, world.auv[..., AuvColumn.target].long()
        observation = world.step(policy.act(observation))[0]
        begun[~hovering & (world.auv[..., AuvColumn.hover] > 0)] = step  # s, the begin of this step
        for w, k in (world.auv[..., AuvColumn.service_rate] > 0).nonzero().tolist():
            birth[w, target[w, k]] = max(birth[w, target[w, k]], begun[w, k])
        expected.append(birth.clone().numpy())
    assert (trace.service_rate > 0).sum() > 10
    assert np.array_equal(collection.newest_birth(trace), np.stack(expected))
