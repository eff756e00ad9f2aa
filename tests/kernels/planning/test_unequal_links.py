"""The planner where levels, decays and depths differ from AUV to AUV, against search in double precision."""

import numpy as np
import pytest
import torch

from tests.kernels.planning.reference import CODES, best_by_dense_search, log_objective
from tests.slowly import slowly
from usvauv.kernels.planning import global_search, objectives
from usvauv.kernels.positioning import acoustic_link

LARGEST_GAP = 1e-3  # in ln of the objective


def cases(K, seed, tables, n):
    """Side of the area (m), link table and layouts (n, K, 3), `tables` times: ln T differs by up to 40 among AUVs."""
    random = np.random.default_rng(seed)
    for i in range(tables):
        link = np.zeros((K, acoustic_link.COLUMNS), np.float32)
        link[:, acoustic_link.LEVEL] = random.uniform(0, 20) + random.choice([3.0, 10.0, 20.0]) * random.uniform(
            -1, 1, K
        )
        link[:, acoustic_link.POWER] = random.choice([1.0, 1.75, 2.5, 4.0])
        link[:, acoustic_link.DECAY] = random.choice([1.0, 0.0]) * 10 ** random.uniform(-4, -1.5, K)
        link[:, acoustic_link.REFERENCE] = random.choice([10.0, 100.0, 300.0])
        link[:, acoustic_link.ATTITUDE] = (0.0, 0.002, 0.01, 0.02)[i % 4] ** 2
        side = float(random.choice([200.0, 500.0, 2000.0]))
        place = side * random.random((n, K, 2))
        z = -np.exp(random.uniform(np.log(3), np.log(500), (n, K, 1)))
        yield side, torch.from_numpy(link), torch.from_numpy(np.concatenate([place, z], -1).astype(np.float32))


@pytest.mark.parametrize("K", [3, 6])
@pytest.mark.parametrize("name", slowly([name for name in CODES if name[0] in "ds"], "d phase"))
def test_finds_the_global_maximum(device, name, K):
    for side, link, points in cases(K, 1000 + K, 12, 30):
        out = global_search.plan_batch(link.to(device), points.to(device), code=CODES[name], width=side, length=side)
        out = out.double().cpu()
        reached = log_objective(out[:, :2], points.double(), link.double(), CODES[name])
        assert (best_by_dense_search(points, link, CODES[name], side) - reached).max() < LARGEST_GAP
        assert (out[:, 2] - reached).abs().max() < LARGEST_GAP


@pytest.mark.parametrize("K", [2, 5])
@pytest.mark.parametrize("code", CODES.values(), ids=CODES)
def test_value_is_that_of_double_precision(device, code, K):
    """At random places, and far out where the AUVs lie in a line with the boat: there the sum is nearly singular."""
    for side, link, points in cases(K, 2000 + K, 12, 100):
        boat = side * torch.rand(100, 2, generator=torch.Generator().manual_seed(K))
        points[::2, :, 1] = boat[::2, 1:] + 0.01 * points[::2, :, 2] / side
        value = objectives.log_objective_batch(link.to(device), points.to(device), boat.to(device), code=code)
        exact = log_objective(boat.double(), points.double(), link.double(), code)
        assert (value[:, 0].double().cpu() - exact).abs().max() < 1e-3
