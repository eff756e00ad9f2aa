"""Data in passing: what a fly-by and a circle bring, packets, the bed's depth under nodes, `loiter` and `pass`."""

import math

import numpy as np
import pytest
import torch

from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.env.record.metrics import energy_consumption, episode_metrics, fairness
from usvauv.env.record.recorder import record
from usvauv.env.site.site import BED_WAVES, Site, random_bed
from usvauv.env.world.mission_parameters import DataLink
from usvauv.kernels.guidance.passing import Task
from usvauv.kernels.mission.columns import AuvColumn, BeliefColumn, NodeColumn, TallyColumn
from usvauv.policies.heuristics.passing import Loiter, loiter_radius

STILL = ["auv.speed_lag=0", "auv.speed_noise=0", "auv.depth_noise=0", "nodes.arrival_rates=[0]", "auv.count=1"]
STILL += ["auv.vehicle=none", "auv.battery=1000"]  # the paper's law of power, 1.2 to 2.2 m/s
SOUND = [
    "nodes.service=passing",
    "nodes.service_range=80",
    "nodes.rate_law=shannon",
    "nodes.payload=200",
    "nodes.information=visits",
    "usbl.carriers=[15000]",  # of any number of AUVs
]
BED = ["area.bed_rms=3", "area.bed_seed=4"]  # 3 m
NODE, SPEED, PACKETS = (100.0, 100.0), 2.0, 5000 / 200  # m; m/s; a Mbit


@pytest.fixture(scope="module")
def world():
    return World(Scenario.load("ideal", [*STILL, *SOUND, *BED]), seed=4)


def put(world, place, backlog):
    """Begin an episode with the AUV at a place and its node, 0, at `NODE` with so many packets."""
    world.rewind()
    world.reset()
    world.node[0, 0, NodeColumn.span("x", "y")] = torch.tensor(NODE)
    world.node[0, 0, NodeColumn.backlog] = backlog
    world.auv[0, 0, AuvColumn.span("x", "y")] = torch.tensor(place)
    world.auv[0, 0, AuvColumn.target] = 0
    world.auv[..., AuvColumn.span("current_x", "current_y")] = 0.0


def fly(world, steps):
    """Steps eastwards at `SPEED`; states of the AUV after each, (T, A), by column name."""
    rows = []
    for _ in range(steps):
        world.auv[..., AuvColumn.span("current_x", "current_y")] = 0.0
        world.step([[[SPEED / world.scenario.auv.speed_max, 0.0]]])
        rows.append(world.auv[0, 0].double().cpu().numpy())
        if rows[-1][AuvColumn.hovering] and not rows[-1][AuvColumn.hover]:
            break
    return {name: np.array(rows)[:, n] for n, name in enumerate(AuvColumn.names)}


def rate_at(world, along, aside, height):
    """Mbit/s of `shannon` on a line that passes at `aside` m, `height` m above the node."""
    link, nodes = DataLink.of(world.site), world.scenario.nodes
    slant = np.sqrt(along**2 + aside**2 + height**2)
    decibels = link.level - link.spreading * np.log10(slant) - link.absorption * slant / 1000
    return 1e-6 * nodes.bandwidth * np.log2(1 + 10 ** (decibels / 10))


def test_a_fly_by_brings_the_integral_of_the_rate_along_the_line_and_leaves_the_rest(world):
    aside = 40.0
    put(world, (5.0, NODE[1] - aside), 5000.0)
    height = float(world.site.depth_at(np.array(NODE))) - world.scenario.auv.depth
    assert abs(height - 20) > 1  # the bed under the node is not at the mean depth
    seen = fly(world, 95)
    slant = np.sqrt((seen["x"] - NODE[0]) ** 2 + aside**2 + height**2)
    inside = np.flatnonzero(slant <= 80)
    first, last = inside[0], inside[-1] + 1
    assert len(slant) == last + 1  # left the range, as the last step
    assert 60 < last - first < 70
    along = np.linspace(seen["x"][first], seen["x"][last], 10_001) - NODE[0]
    whole = np.trapezoid(rate_at(world, along, aside, height), along) / SPEED * PACKETS
    halfway = (seen["x"][first:last] + seen["x"][first + 1 :]) / 2 - NODE[0]
    assert seen["rate"][first + 1 :] == pytest.approx(rate_at(world, halfway, aside, height), rel=1e-4)
    delivered = seen["packets_delivered"]
    assert abs(delivered.sum() - whole) < 1.5
    assert (delivered == np.round(delivered)).all()
    assert seen["delivered"].sum() == pytest.approx(delivered.sum() / PACKETS, rel=1e-5)
    assert (np.flatnonzero(seen["hovering"]) == np.arange(first + 1, last + 1)).all()
    assert not seen["service_rate"].any()
    power = seen["power"]
    assert (power == power[0]).all()  # as travelling, in range and out of it
    assert (seen["cargo"][-1], seen["hover"][-1]) == (0, 0)
    assert world.node[0, 0, NodeColumn.backlog] == 5000 - delivered.sum()
    assert world.belief[0, 0, 0, BeliefColumn.left] == 5000 - delivered.sum()
    assert world.auv[0, 0, AuvColumn.target] != 0


def test_progress_counts_up_to_the_range(world):
    put(world, (5.0, NODE[1]), 5000.0)
    seen = fly(world, 40)
    edge = world.scenario.service_radius
    closed = np.maximum(95.0 - edge, 0)
    assert seen["closed"].sum() == pytest.approx(closed, abs=1e-3)
    assert (seen["closed"][seen["x"] > NODE[0] - edge + SPEED] == 0).all()


def test_a_service_ends_with_its_last_packet(world):
    put(world, (60.0, 60.0), 500.0)
    seen = fly(world, 60)
    assert seen["service_rate"][-1] > 0
    assert seen["packets_delivered"].sum() == 500
    assert world.node[0, 0, NodeColumn.backlog] == 0
    assert world.belief[0, 0, 0, BeliefColumn.left] == 0
    left = 500 - np.cumsum(seen["packets_delivered"])
    expected = left / PACKETS / seen["rate"]
    assert seen["hover"][1:-1] == pytest.approx(expected[1:-1], abs=1 / PACKETS / seen["rate"].min() + 1e-3)


def test_packets_are_conserved_and_figures_are_those_of_travelling():
    scenario = Scenario.load("ideal", [*SOUND, "mission.duration=250", "nodes.start_backlog=5000", "nodes.payload=20"])
    world = World(scenario, 4, seed=3)
    policy = policies.load("pass:100", world)
    observation = world.reset()
    before = world.node[..., NodeColumn.backlog].double().sum(1)
    for _ in range(world.steps):
        observation = world.step(policy.act(observation)).observation
        before += (world.tally[:, TallyColumn.packets_created] - world.tally[:, TallyColumn.packets_lost]).double()
        before -= world.auv[..., AuvColumn.packets_delivered].double().sum(1)
        assert torch.equal(before, world.node[..., NodeColumn.backlog].double().sum(1))
    world.rewind()
    trace = record(world, policies.load("pass:100", world).act, "pass")
    row = episode_metrics(trace)[0]
    assert row.services > 5
    assert row.delivered_mbit > 2
    assert energy_consumption(trace)[-1, 0] == pytest.approx(trace.power[:, 0].mean(), rel=1e-6)
    data = np.zeros(scenario.nodes.count)
    for t, k in zip(*np.nonzero(trace.delivered[:, 0]), strict=True):
        data[trace.target[t - 1, 0, k]] += trace.delivered[t, 0, k]
    assert fairness(trace)[0] == pytest.approx(data.sum() ** 2 / (data**2).sum() / len(data), rel=1e-5)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ("nodes.service_range=15", "nodes.service_range = 15: must reach farther than the AUVs' height over the nodes"),
        ("nodes.hovering_time=exact", "nodes.hovering_time = exact: must be steps with nodes.service = passing"),
    ],
)
def test_what_does_not_go_with_it(change, part):
    with pytest.raises(ValueError, match=part):
        Scenario.load("ideal", ["nodes.service=passing", change])


class TestBed:
    def test_a_random_bed_has_the_rms_and_the_covariance_it_is_given(self):
        area = Scenario.load("ideal", ["area.width=4000", "area.length=3000", "area.bed_rms=5"]).area
        depth = np.stack([random_bed(area.model_copy(update={"bed_seed": s}), (400, 300)) - 120 for s in range(8)])
        assert depth.shape == (8, 300, 400)
        assert depth.std() == pytest.approx(5, rel=0.05)
        for lag in (2, 5, 10):  # of 10 m
            for a, b in ((depth[:, lag:], depth[:, :-lag]), (depth[..., lag:], depth[..., :-lag])):
                assert (a * b).mean() / 25 == pytest.approx(math.exp(-((10 * lag / 50) ** 2) / 2), abs=0.06)
        assert not np.allclose(depth[0], depth[1])
        assert BED_WAVES >= 100

    def test_the_bed_between_its_corners_is_the_random_one(self):
        site = Site(Scenario.load("ideal", BED))
        cells = (40, 40)
        at = (np.stack(np.meshgrid(np.arange(40), np.arange(40)), -1) + 0.5) * 5
        assert site.depth_at(at) == pytest.approx(random_bed(site.scenario.area, cells), abs=0.02)

    def test_a_bed_that_rises_to_the_auvs_is_refused(self):
        with pytest.raises(ValueError, match=r"area.bed_rms = 20"):
            World(Scenario.load("ideal", ["area.bed_rms=20"]))


class TestLoiter:
    def test_the_radius_is_the_largest_of_those_with_the_highest_rate(self):
        site = Site(Scenario.load("ideal", ["auv.vehicle=none", "nodes.service=passing", "nodes.margin=30"]))
        within = 0.85 * math.sqrt(40**2 - 20**2)
        assert loiter_radius(site) == pytest.approx(0.5 * (within + 30 - 3), rel=1e-6)
        fading = Site(site.scenario.model_copy(update={"nodes": Scenario.load("ideal", SOUND).nodes}))
        assert loiter_radius(fading) == pytest.approx(3 * 1.2, rel=1e-6)

    def test_it_circles_and_brings_the_rate_of_its_radius_times_the_time(self, world):
        put(world, (20.0, 100.0), 5000.0)
        policy = Loiter("loiter", world, 100.0)
        policy.task = *policy.task[: Task.radius], 25.0, *policy.task[Task.radius + 1 :]
        rows, observation = [], world.observation
        for _ in range(140):
            observation = world.step(policy.act(observation)).observation
            rows.append(world.auv[0, 0].double().cpu().numpy())
        seen = {name: np.array(rows)[-60:, n] for n, name in enumerate(AuvColumn.names)}
        distance = np.hypot(seen["x"] - NODE[0], seen["y"] - NODE[1])
        assert distance == pytest.approx(25.0, abs=1.5)
        around = np.unwrap(np.arctan2(seen["y"] - NODE[1], seen["x"] - NODE[0]))
        assert abs(around[-1] - around[0]) == pytest.approx(59 * 1.2 / distance.mean(), rel=0.03)  # one way, slowly
        height = float(world.site.depth_at(np.array(NODE))) - world.scenario.auv.depth
        expected = 60 * rate_at(world, 0.0, distance.mean(), height) * PACKETS
        assert seen["packets_delivered"].sum() == pytest.approx(expected, rel=5e-3)


class TestPass:
    def test_it_goes_by_on_its_way_to_the_next_node_and_the_data_are_out_as_it_leaves(self, world):
        for name, nearest in (("pass:200", 20.0), ("clear:200", 1.0)):
            policy = policies.load(name, world)
            put(world, (10.0, 80.0), 1400.0)
            world.node[0, 0, NodeColumn.successor] = 1
            world.node[0, 1, NodeColumn.span("x", "y")] = torch.tensor([190.0, 80.0])
            world.step([[[1.0, 0.0]]])
            observation, distance = world.observation, []
            while world.auv[0, 0, AuvColumn.target] == 0:
                distance.append(math.dist(world.auv[0, 0, AuvColumn.span("x", "y")].tolist(), NODE))
                observation = world.step(policy.act(observation)).observation
            assert min(distance) == pytest.approx(nearest, abs=3)
            assert world.node[0, 0, NodeColumn.backlog] == 0
            assert (distance[-1] > 25) == (name == "pass:200")
