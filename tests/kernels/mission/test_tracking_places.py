"""Errors of the AUVs' own places in their filters of targets, where fixes are rare."""

import pytest
import torch

from usvauv.env import Scenario, World
from usvauv.kernels.mission.columns import AuvColumn, NodeColumn
from usvauv.kernels.mission.tasks.tracking_columns import TargetColumn
from usvauv.kernels.mission.tasks.tracking_places import EACH, START
from usvauv.policies.loading import load

RARE = "channel.interval=180"  # s


def squared(error: torch.Tensor, covariance: torch.Tensor) -> torch.Tensor:
    """Squared errors (...) over covariances xx, xy, yy (..., 3), halved: 1 on average."""
    (x, y), (xx, xy, yy) = error.double().unbind(-1), covariance.double().unbind(-1)
    return 0.5 * (yy * x * x - 2 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)


def place_covariance(world: World) -> torch.Tensor:
    """Of each AUV by its own filter of the first target, (W, K, 3)."""
    first = [START + EACH * k + 4 for k in range(world.num_auvs)]
    return torch.stack([world.task_pair[:, k, 0, at : at + 3] for k, at in enumerate(first)], 1)


@pytest.mark.parametrize("listens", [0, 1])
def test_places_and_targets_are_as_uncertain_as_said(listens):
    """Fixes every 3 minutes, errors of 8 m, which as mere noise of ranges leave a fifth of targets out of ellipses."""
    world = World(Scenario.load("tracking", [RARE, f"task_parameters.boat_listens={listens}"]), 24, seed=4)
    observation, policy, own, of_targets = world.reset(), load("circle", world), [], []
    for step in range(650):
        observation = world.step(policy.act(observation)).observation
        if step > 250 and step % 10 == 9:
            error = world.own_position - world.auv[..., AuvColumn.span("x", "y")]
            own.append(squared(error, place_covariance(world)))
            error = (
                world.task_node[..., TargetColumn.span("estimate_x", "estimate_y")]
                - world.node[..., NodeColumn.span("x", "y")]
            )
            covariance = world.task_node[..., TargetColumn.span("covariance_xx", "covariance_yy")]
            of_targets.append(squared(error, covariance))
    assert torch.stack(own).mean() == pytest.approx(1, abs=0.25)
    found = torch.stack(of_targets)
    assert (found < 3.0).double().mean() == pytest.approx(0.95, abs=0.05)
    assert found[found < 20].mean() == pytest.approx(1, abs=0.25)


def test_a_lone_auv_knows_a_target_no_better_than_its_own_place():
    """But for the time that it takes to learn of a fix."""
    alone = ["auv.count=1", "nodes.count=1", "task_parameters.boat_listens=0"]
    world = World(Scenario.load("tracking", [RARE, *alone]), 32, seed=4)
    observation, policy, as_uncertain = world.reset(), load("circle", world), []
    for step in range(400):
        observation = world.step(policy.act(observation)).observation
        if step > 250 and step % 10 == 9:
            target = world.task_node[:, 0, TargetColumn.span("covariance_xx", "covariance_yy")]
            place = place_covariance(world)[:, 0]
            heard = place[:, 0] > 0
            assert heard.sum() > 20
            as_uncertain.append((target[heard] > 0.8 * place[heard])[:, [0, 2]].double().mean())
    assert torch.stack(as_uncertain).mean() > 0.95
