"""The elevation along open boundaries against its sum in double precision."""

import numpy as np
import pytest
import torch

from usvauv.kernels.functions import Launch
from usvauv.kernels.shallow_water.cellwise import prescribe
from usvauv.kernels.shallow_water.discretisation import LANES, Packing
from usvauv.kernels.shallow_water.forcing import Forcing

TIME_STEP, SUBSTEPS = 0.37, 3


@pytest.mark.parametrize("num_seas", [1, 18])
@pytest.mark.parametrize("time", [0.0, 12.5, 3e6])
def test_table_is_the_sum_of_its_waves(device, num_seas, time):
    rng = np.random.default_rng(1)
    a, T, phi = rng.uniform((0.1, 9.0, 0.0), (1.0, 500.0, 6.3), (num_seas, 5, 3)).transpose(2, 0, 1)
    packing = Packing(num_seas, 40, 3)
    table = torch.zeros((packing.blocks * SUBSTEPS, LANES), device=device)
    forcing = Forcing(a, T, phi, packing, SUBSTEPS * TIME_STEP, table.device)
    forcing.go_to(time, 29)
    Launch(prescribe, *forcing.waves, TIME_STEP, packing.blocks, table)()
    t = time + TIME_STEP * (29 * SUBSTEPS + np.arange(SUBSTEPS))[:, None, None]
    exact = (a * np.cos(2 * np.pi * t / T + phi)).sum(axis=2)  # (substeps, seas)
    found = table.cpu().view(-1, SUBSTEPS, LANES).permute(1, 0, 2).reshape(SUBSTEPS, -1).numpy()
    if packing.strips:
        assert np.ptp(found, axis=1).max() == 0.0
        found = found[:, :1]
    else:
        assert (found[:, num_seas:] == 0.0).all()
    assert (np.abs(found[:, :num_seas] - exact) < 1e-6 * a.sum(axis=1)).all()
