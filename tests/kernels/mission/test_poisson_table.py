"""Poisson numbers from the table of arrivals."""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats

from usvauv.env import Scenario, World
from usvauv.kernels.mission.columns import NodeColumn
from usvauv.kernels.mission.tasks.data_collection import arrival_table, draw_arrivals

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
