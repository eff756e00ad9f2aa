"""Packets are conserved, and arrive as Poisson numbers from the table of arrivals."""

import itertools
import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats

from usvauv.env import Scenario, World
from usvauv.env.record.recorder import Recorder
from usvauv.kernels.mission.columns import AuvColumn, NodeColumn, TallyColumn
from usvauv.kernels.mission.tasks.data_collection import arrival_table, draw_arrivals


def backlogs(world: World) -> torch.Tensor:
    """Packets in each world's buffers, (W,), float64; their sum may exceed what float32 counts."""
    return world.node[..., NodeColumn.backlog].double().sum(-1)


def steer(world: World) -> torch.Tensor:
    """Heads for the target at full speed, from the true positions."""
    node = world.node[..., NodeColumn.span("x", "y")]
    target = world.auv[..., AuvColumn.target].long()[..., None].expand(-1, -1, 2)
    offset = node.gather(1, target) - world.auv[..., AuvColumn.span("x", "y")]
    return offset / offset.norm(dim=-1, keepdim=True).clamp_min(1e-9)


CROWDED = ("nodes.count=3", "auv.count=6", "auv.start_separation=4")  # more AUVs than nodes: some share one
TINY = ("nodes.buffer=40", "nodes.start_backlog=40")
SLOW = ("nodes.payload=200",)  # services of minutes, in which the buffer overflows


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("extreme", ("auv.count=5",)),
        ("extreme", (*CROWDED, *TINY)),
        ("ideal", (*CROWDED, *SLOW)),
        ("paper-extreme", ("boat.strategy=hold:100,100", "auv.count=1", "nodes.count=1", *TINY)),
        ("ideal", ("nodes.buffer=10000000", "nodes.start_backlog=10000000")),
        ("ideal", ("nodes.count=500", "mission.step=5", "nodes.arrival_rates=[16]", "nodes.buffer=300",
                   "nodes.start_backlog=1")),
    ],
)  # fmt: skip
def test_packets_are_conserved(name, overrides):
    """Also over resets of all worlds and of some, and what the trace says is the same."""
    world = World(Scenario.load(name, list(overrides)), num_worlds=16, seed=11)
    world.reset()
    held = backlogs(world)
    recorder, services = Recorder(world), 0
    for step in range(300):
        if step == 150:
            some = torch.arange(16, device=world.device) % 3 == 0
            world.reset(some)
            held = torch.where(some, backlogs(world), held)
        if step == 230:
            world.reset()
            held = backlogs(world)
            recorder.clear()
        world.step(steer(world))
        recorder.add()
        created = world.tally[:, TallyColumn.packets_created].double()
        lost = world.tally[:, TallyColumn.packets_lost].double()
        delivered = world.auv[..., AuvColumn.packets_delivered].double().sum(-1)
        now = backlogs(world)
        assert torch.equal(held + created, now + lost + delivered), step
        assert torch.equal(lost > 0, world.tally[:, TallyColumn.overflowing] > 0)
        packets = world.node[..., NodeColumn.backlog]
        assert torch.equal(packets, packets.round())
        assert packets.min() >= 0
        assert packets.max() <= world.scenario.nodes.buffer
        services += int((delivered > 0).sum())
        held = now
    assert services > 0
    trace = recorder.trace("steer", np.zeros((0, 0, 0), np.float32))
    grown = np.diff(trace.backlog.astype(np.int64).sum(-1), axis=0)
    balance = trace.packets_created - trace.packets_lost - trace.packets_delivered.sum(-1)
    np.testing.assert_array_equal(grown, balance[1:])


def test_what_arrives_during_a_service_stays():
    """A service takes what was there when it began; only that is paid for in time, delivered and gone at its end."""
    world = World(Scenario.load("ideal"), num_worlds=16, seed=2)
    world.reset()
    began, taken, stayed = {}, 0, 0
    for _ in range(400):
        before = world.auv.clone()
        world.step(steer(world))
        for at in itertools.product(range(16), range(2)):
            was, auv = before[at], world.auv[at]
            backlog = world.node[at[0], int(was[AuvColumn.target]), NodeColumn.backlog].item()
            if auv[AuvColumn.hover] > 0 and was[AuvColumn.hover] == 0:
                # What came in the step of the arrival itself is not in the service.
                began[at] = auv[AuvColumn.cargo].item()
                assert began[at] <= backlog
            if auv[AuvColumn.service_rate] > 0:
                assert auv[AuvColumn.packets_delivered].item() == began[at]
                assert auv[AuvColumn.delivered].item() == pytest.approx(2 * began[at] / 5000, rel=1e-6)
                taken += began[at]
                stayed += backlog
    assert 0.005 < stayed / taken < 0.1


def test_two_auvs_at_one_node_take_each_packet_once():
    """The second takes what came after the first began."""
    world = World(Scenario.load("ideal", ["auv.count=2", "nodes.count=1", *SLOW]), num_worlds=64, seed=5)
    world.reset()
    together = 0
    for _ in range(250):
        world.step(steer(world))
        cargo = world.auv[..., AuvColumn.cargo]
        assert (cargo.sum(-1) <= world.node[:, 0, NodeColumn.backlog]).all()
        together += int((cargo > 0).all(-1).sum())
    assert together > 30


RATES = (0.0, 0.3, 3.0, 12.0, 40.0, 80.0)
LAST = 1 - 2.0**-24  # the largest number that `random.unit` gives


@ti.kernel
def _draw(
    kinds: ti.types.ndarray(dtype=ti.f32, ndim=2),
    row: ti.i32,
    u: ti.types.ndarray(dtype=ti.f32, ndim=1),
    out: ti.types.ndarray(dtype=ti.f32, ndim=1),
):
    for i in range(u.shape[0]):
        out[i] = draw_arrivals(kinds, row, u[i])


def draw(device, rates, step: float, row: int, u: np.ndarray) -> np.ndarray:
    u = torch.from_numpy(u.astype(np.float32)).to(device)
    out = torch.full_like(u, -1.0)
    _draw(torch.from_numpy(arrival_table(rates, step)).to(device), row, u, out)
    return out.cpu().numpy()


@pytest.mark.parametrize("row", range(len(RATES)))
def test_it_inverts_the_distribution(device, row):
    """SciPy's quantiles, away from the steps, which single precision cannot tell from their neighbours."""
    u = np.concatenate(((np.arange(200_000) + 0.5) / 200_000, np.arange(1, 64) / 64, [2.0**-24, LAST]))
    u = u.astype(np.float32).astype(np.float64)
    count = draw(device, RATES, 1.0, row, u)
    below, at = (stats.poisson.cdf(count - shift, RATES[row]) for shift in (1, 0))
    assert np.all(u > below - 1e-7)
    assert np.all(u <= at + 1e-7)


def test_a_step_is_part_of_the_mean(device):
    u = np.linspace(0.01, 0.99, 99)
    assert np.array_equal(draw(device, [6.0], 0.5, 0, u), draw(device, [3.0], 1.0, 0, u))


def test_rows_end_where_the_distribution_does(device):
    """The largest number gives a count that is still a plausible one."""
    for row, rate in enumerate(RATES[1:], 1):
        assert stats.poisson.sf(draw(device, RATES, 1.0, row, np.array([LAST]))[0], rate) > 1e-10


def test_nodes_fill_at_their_own_rates():
    """Five standard errors around each rate, over all nodes that have it."""
    world = World(Scenario.load("extreme"), num_worlds=256, seed=1)
    world.reset()
    rate = world.node[..., NodeColumn.rate].clone()
    backlog = world.node[..., NodeColumn.backlog].clone()
    world.step(torch.zeros(256, 2, 2, device=world.device))
    came = world.node[..., NodeColumn.backlog] - backlog
    for value in world.scenario.nodes.arrival_rates:
        those = came[rate == value]
        assert those.mean().item() == pytest.approx(value, abs=5 * math.sqrt(value / those.numel()))
