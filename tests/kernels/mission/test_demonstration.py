"""The demonstration's conventions, each against a small case worked out by hand."""

import math

import numpy as np
import pytest
import torch

from tests.kernels.mission.test_packets import steer
from usvauv.env import Scenario, World
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, NodeColumn

BOAT = "hold:100,100"  # as in the golden trace, with which this is compiled


@pytest.fixture(scope="module")
def pair() -> World:
    """Sixteen worlds of `paper-ideal`, two AUVs."""
    return World(Scenario.load("paper-ideal"), 16, 4, BOAT)


def term(world: World, name: str) -> torch.Tensor:
    return world.reward_terms[..., world.reward_names.index(name)].cpu()


def after_service(backlog: list[float]) -> int:
    """Target chosen after the service of node 1, right above it, among nodes with λ = 8 packets/s.

    λ b/C − 0.05 √(d² + 100²) is −5 for node 1, emptied, and 1.6 b/1000 − 6.25, − 5.02 and − 6.25 for nodes 2 to 4;
    with the horizontal d the last number is − 3.75, − 0.5, − 3.75. The other AUV heads for node 0, −5.59.
    """
    world = World(Scenario.load("paper-ideal", ["nodes.count=5", "nodes.arrival_rates=[0]"]), usv=BOAT)
    world.reset()
    world.node[0, :, NodeColumn.x] = torch.tensor([50.0, 100.0, 175.0, 110.0, 25.0])
    world.node[0, :, NodeColumn.y] = 100.0
    world.node[0, :, NodeColumn.rate] = 8.0
    world.node[0, :, NodeColumn.backlog] = torch.tensor([0.0, 5000.0, *backlog])
    world.auv[0, 1, AuvColumn.target] = 0
    auv = world.auv[0, 0]
    auv[AuvColumn.x] = auv[AuvColumn.y] = 100.0
    world.estimate[0, 0, :2] = 100.0  # a fix far from there would be rejected
    auv[AuvColumn.target], auv[AuvColumn.hover], auv[AuvColumn.rate], auv[AuvColumn.cargo] = 1, 0.5, 0.2, 5000
    world.step(torch.zeros(1, 2, 2))
    assert world.auv[0, 0, AuvColumn.service_rate] > 0
    return int(world.auv[0, 0, AuvColumn.target])


def test_of_the_two_best_the_lower_index():
    assert after_service([4000.0, 2000.0, 5000.0]) == 2  # not the better, 4; by the horizontal distance it would be 3


def test_an_emptied_node_is_one_of_the_two_best():
    assert after_service([500.0, 0.0, 1500.0]) == 4  # −3.9, node 1 −5, node 3 −5.02, node 2 −5.5


def test_first_targets(pair):
    """The two nodes with the largest λ b/C, the better to AUV 1, wherever they are."""
    pair.reset()
    node, target = pair.node.double().cpu().numpy(), pair.auv[..., AuvColumn.target].long().cpu().numpy()
    for w in range(16):
        order = np.argsort(node[w, :, NodeColumn.rate] * node[w, :, NodeColumn.backlog], kind="stable")
        assert target[w].tolist() == order[-2:].tolist()


def test_service_is_paid_from_arrival_to_completion():
    world = World(Scenario.load("paper-ideal", ["auv.count=1"]), 8, 2, BOAT)
    world.reset()
    paid, steps, services = torch.zeros(8), torch.zeros(8), torch.zeros(8)
    for _ in range(400):
        hovering = world.auv[:, 0, AuvColumn.hover].cpu() > 0
        world.step(steer(world))
        paid += term(world, "service")[:, 0]
        steps += hovering
        services += (world.auv[:, 0, AuvColumn.hover].cpu() > 0) & ~hovering  # begun
    assert services.min() > 3
    assert torch.equal(paid, 12 * (steps + services))


def test_proximity_once_a_pair(pair):
    pair.reset()
    pair.auv[:, 0, AuvColumn.x] = 100.0
    pair.auv[:, 1, AuvColumn.x] = 104.0
    pair.auv[..., AuvColumn.y] = 100.0
    pair.step(torch.zeros(16, 2, 2))  # both go east at 1.2 m/s
    assert term(pair, "proximity")[:, 0].numpy() == pytest.approx(-6 * (12 - 4), rel=1e-5)
    assert (term(pair, "proximity")[:, 1] == 0).all()


def test_a_refused_move_costs_what_hovering_does(pair):
    pair.reset()
    pair.auv[..., AuvColumn.x] = 199.9
    pair.step(torch.ones(16, 2, 2) * torch.tensor([1.0, 0.0]))
    assert (pair.auv[..., AuvColumn.border] == 1).all()
    assert (pair.auv[..., AuvColumn.power] == 105).all()
    assert term(pair, "power").numpy() == pytest.approx(-0.085 * 105, rel=1e-6)


@pytest.mark.parametrize("depth", [120, 300])
def test_vertical_separation_is_the_cruise_depth(depth):
    """To node and boat; the depth of the water has no part. Rate: 1 kHz log2(1 + 10^SNR), SNR in dB over the slant."""
    world = World(Scenario.load("paper-ideal", [f"area.depth={depth}"]), 8, 2, BOAT)
    world.reset()
    f = 20.0
    alpha = 0.11 * f**2 / (1 + f**2) + 44 * f**2 / (4100 + f**2) + 2.75e-4 * f**2 + 0.003
    densities = (
        17 - 30 * math.log10(f),
        40 + 26 * math.log10(f) - 60 * math.log10(f + 0.03),
        50 + 20 * math.log10(f) - 40 * math.log10(f + 0.4),
        -15 + 20 * math.log10(f),
    )
    noise = 10 * math.log10(sum(10 ** (d / 10) for d in densities)) + 30
    level = 10 * math.log10(0.03) + 170.77 - noise
    begun = 0
    for _ in range(120):
        hovering = world.auv[..., AuvColumn.hover] > 0
        world.step(steer(world))
        for w, k in ((world.auv[..., AuvColumn.hover] > 0) & ~hovering).nonzero().tolist():
            target = int(world.auv[w, k, AuvColumn.target])
            offset = world.node[w, target, : NodeColumn.y + 1] - world.auv[w, k, : AuvColumn.y + 1]
            slant = math.hypot(100, offset.norm().item())
            snr = level - 15 * math.log10(slant) - alpha * slant / 1000
            assert world.auv[w, k, AuvColumn.rate].item() == pytest.approx(1e-3 * snr * math.log2(10), rel=1e-4)
            begun += 1
    assert begun > 5
    assert (world.estimate[..., 2] - 100 == world.boat[..., BoatColumn.elevation]).all()
