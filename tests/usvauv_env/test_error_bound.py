"""The error that no path of the boat can beat: beside the planner's error budget, and medians by root finding."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import brentq

from tests.usvauv_env.test_trace import random_trace
from usvauv.env.error_budget import SUM, error_budget
from usvauv.env.record import error_bound
from usvauv.env.record.trace import VARIABLES
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table
from usvauv.kernels.planning import objectives, search


def test_the_variance_is_that_of_a_fix_from_the_best_place(device):
    """With the depth below the water under the boat that serves the AUV."""
    whole = random_trace()
    first = {name: getattr(whole, name)[:2] for name, about in VARIABLES.items() if about.dimensions[0] == "time"}
    trace = replace(whole, **first)
    found = error_bound.variance(trace)
    assert found.shape == trace.power.shape
    scenario = trace.scenario
    link, code = torch.from_numpy(link_table(Site(scenario))).to(device), objectives.objective_code("fix", "d")
    for t, w in ((0, 0), (1, 2)):
        water = [trace.boat_surface[t, w, boat, 0] for boat in trace.served_by[t, w]]
        auvs = [(*map(float, xy), 100.0 + float(z)) for xy, z in zip(trace.auv_position[t, w], water, strict=True)]
        points = torch.tensor([auvs], device=device)
        best = search.plan_batch(link, points, code=code, width=300.0, length=240.0)[0, :2].tolist()
        budget = error_budget(scenario, link, auvs, tuple(best), "fix", (0.0, 0.0))[SUM]
        np.testing.assert_allclose(found[t, w], np.square(budget) / 2, rtol=0.01)


@pytest.mark.parametrize("variances", [[4.0], [1.0, 1.0, 100.0], [0.01, 9.0, 9.0, 16.0]])
def test_the_median_of_plane_normals(variances):
    v = np.array(variances)
    expected = brentq(lambda m: np.mean(1 - np.exp(-m * m / (2 * v))) - 0.5, 0, 1e3, xtol=1e-13)
    assert error_bound.median_of_normals(v) == pytest.approx(expected, rel=1e-9)
    assert len(v) > 1 or expected == pytest.approx(2 * math.sqrt(2 * math.log(2)))
