"""Boats that listen to targets: what they measure, what AUVs know of it, and that else nothing changes."""

import math

import numpy as np
import pytest
import torch

from tests.kernels.tracking.rules import Filters
from usvauv.env import Scenario, World
from usvauv.env.exchange.trace_tables import tables
from usvauv.env.record.recorder import record
from usvauv.env.record.tracking_bound import range_information, rms, tracking_bound
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, NodeColumn
from usvauv.kernels.mission.tasks.tracking_columns import BoatHearingColumn, PairColumn, TargetColumn
from usvauv.policies.loading import load

XY = NodeColumn.span("x", "y")
LISTENING = "boat_listens=1"


def made(*numbers: str, auvs: int = 2, targets: int = 1, worlds: int = 32) -> World:
    """Worlds of two boats at the beginning of an episode, `tracking-plain` with AUVs that turn freely."""
    team = ["task=tracking", "boat.count=2", f"auv.count={auvs}", f"nodes.count={targets}"]
    world = World(Scenario.load("tracking-plain", [*team, *(f"task_parameters.{each}" for each in numbers)]), worlds, 3)
    world.reset()
    return world


def places(world: World) -> torch.Tensor:
    """Of AUVs and after them boats, with their depths, (W, K + B, 3), m."""
    auv = torch.nn.functional.pad(world.auv[..., AuvColumn.span("x", "y")], (0, 1), value=1.0)
    boat = torch.nn.functional.pad(world.boat[..., BoatColumn.span("x", "y")], (0, 1))
    return torch.cat([auv, boat], 1).double()


def ranges(world: World) -> torch.Tensor:
    """Measured by AUVs and after them boats, (W, K + B, M), m; 0: none."""
    return torch.cat([world.task_pair[..., PairColumn.measured], world.task_boat[..., BoatHearingColumn.measured]], 1)


def test_boats_hear_with_the_noise_the_losses_and_the_limit_that_are_set():
    """Each observer with a noise of its own."""
    world = made(LISTENING, "range_most=150", targets=3, worlds=400)
    policy, errors, lost, out = load("circle", world), [], [], []
    for _ in range(20):
        world.step(policy.act(world.observation))
        target = torch.cat([world.node[..., XY], world.task_node[..., TargetColumn.depth, None]], -1).double()
        slant = (target[:, None] - places(world)[:, :, None]).norm(dim=-1)
        measured, boats = ranges(world).double(), slice(2, None)
        near, heard = slant <= 149.9, measured > 0
        errors.append((measured - slant).where(heard, math.nan).transpose(1, 2).flatten(0, 1))
        lost.append((~heard)[:, boats][near[:, boats]].double())
        out.append(measured[:, boats][slant[:, boats] > 150.1])
    error = torch.cat(errors)
    of_boats = error[:, 2:][error[:, 2:].isfinite()]
    assert len(of_boats) > 3000
    assert of_boats.mean().abs() < 4 * 10 / math.sqrt(len(of_boats))
    assert of_boats.std() == pytest.approx(10, rel=0.05)
    by_all = error[error.isfinite().all(1)]
    assert (by_all.T.corrcoef() - torch.eye(4)).abs().max() < 4 / math.sqrt(len(by_all))
    assert torch.cat(lost).mean() == pytest.approx(0.1, abs=0.015)
    assert len(torch.cat(out)) > 1000
    assert not torch.cat(out).any()


def test_a_filter_takes_a_boat_for_one_more_auv_at_its_place():
    """By filters that are given the ranges of two AUVs and two boats as those of four AUVs."""
    world = made(LISTENING, "message_loss=0")
    policy = load("circle", world)
    given, step = world.scenario.task_numbers, world.scenario.mission.step
    walk = math.sqrt(0.5 * step) * given["target_speed_most"] * given["course_walk"]
    speeds, turns = (0.493, 0.69), (given["turn_least"], given["turn_most"])
    filters = Filters(world.num_worlds, [step, *speeds, 5, 14, *turns, walk], world.device, depths=(5.0, 20.0))
    for _ in range(30):
        world.step(policy.act(world.observation))
        filters.predict()
        for place, measured in zip(places(world).unbind(1), ranges(world)[..., 0].unbind(1), strict=True):
            filters.observe(place, measured, (measured > 0).numpy())
        filters.finish()
    pair = world.task_pair[:, 0, 0].double()
    np.testing.assert_allclose(pair[:, PairColumn.span("x", "vy")], filters.mean, atol=1e-2)
    np.testing.assert_allclose(
        pair[:, PairColumn.span("xx", "yy")], filters.covariance.reshape(-1, 4)[:, [0, 1, 3]], 1e-2
    )


def test_errors_are_near_the_bound_with_the_ranges_of_boats():
    """One AUV and two boats in the middle; targets that do not turn, of known depth, after 20 steps."""
    still = "turn_after_most=0", "course_walk=0", "depths_known=1", "message_loss=0"
    world = made(LISTENING, *still, auvs=2, worlds=300)
    policy, informations, errors = load("circle", world), [], []
    for _ in range(60):
        world.step(policy.act(world.observation))
        target, here = world.node[:, None, 0, XY].double().numpy(), places(world).numpy()
        depth = world.task_node[..., TargetColumn.depth].double().numpy() - here[..., 2]
        near = np.sqrt(((target - here[..., :2]) ** 2).sum(-1) + depth**2) <= 450
        information = range_information(here[..., :2], target, 10.0, depth) * (0.9 * near)[..., None, None]
        informations.append(information.sum(1))
        errors.append(world.task_node[:, 0, TargetColumn.error].double().numpy())
    speed = (0.493**2 + 0.493 * 0.69 + 0.69**2) / 6
    bound = tracking_bound(np.stack(informations, 1), np.diag([180**2 / 2] * 2 + [speed] * 2), 30.0, 0.0)
    least, error = (np.sqrt(np.square(each).mean()) for each in (rms(bound)[:, 20:], np.stack(errors, 1)[:, 20:]))
    assert 0.97 < error / least < 1.1


@pytest.mark.parametrize("unheard", ["message_loss=1", "message_range=0", "range_most=1"])
def test_a_boat_that_hears_nothing_or_that_nobody_hears_changes_nothing(unheard):
    pairs = []
    for boats in (LISTENING, "boat_listens=0"):
        world = made(boats, unheard)
        policy = load("circle", world)
        for _ in range(10):
            world.step(policy.act(world.observation))
        pairs.append(world.task_pair.clone())
    assert torch.equal(*pairs)


def test_a_trace_has_the_ranges_of_boats():
    world = made(LISTENING, worlds=2)
    trace = record(world, load("circle", world).act, "circle")
    assert trace.boat_range.shape == (128, 2, 2, 1)
    assert np.array_equal(trace.boat_range[-1], world.task_boat[..., BoatHearingColumn.measured])
    rows = tables(trace)["boat_ranges"]
    assert len(rows["node"]) == np.count_nonzero(trace.boat_range) > 100
    assert {*rows["boat"].tolist()} == {1, 2}
