"""What no path of the boat can beat: the error of fixes made from the best place at every moment.

A fix's error is taken as normal with the covariance J⁻¹ of the whole fix (phases and delay, all errors) by a level
array at the place that is D-optimal for the true positions. Where fixes have no errors in common it is the bound of a
single fix: a tracker, which remembers, can be better, and a moving AUV whose sound takes time is worse.
"""

from __future__ import annotations

import numpy as np
import torch

from usvauv.env.record.trace import Trace
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table
from usvauv.kernels import runtime
from usvauv.kernels.planning import objectives, search
from usvauv.kernels.planning.information import FIX, tilted_batch


def variance(trace: Trace) -> np.ndarray:
    """Variance per horizontal axis of fixes from the best place, (T, W, K), m²: the mean of the two axes'."""
    scenario = trace.scenario
    link = torch.from_numpy(link_table(Site(scenario))).to(runtime.start().device)
    steps, worlds, auvs = trace.power.shape
    surface = np.take_along_axis(trace.boat_surface[..., 0], trace.served_by.astype(np.intp), axis=-1)
    separation = scenario.auv.depth + surface
    layout = np.concatenate([trace.auv_position, separation[..., None]], -1).reshape(-1, auvs, 3).astype(np.float32)
    points = torch.from_numpy(layout).to(link.device)
    width, length = scenario.area.width, scenario.area.length
    code = objectives.objective_code("fix", "d")
    best = search.plan_batch(link, points, code=code, width=width, length=length)[:, None, :2]
    away = torch.cat([points[..., :2] - best, -points[..., 2:]], -1).reshape(-1, 3).contiguous()
    index = torch.arange(auvs, dtype=torch.int32, device=link.device).repeat(steps * worlds)
    covariance, _, _ = tilted_batch(link, index, away, torch.zeros_like(away[:, :2]), measurement=FIX)
    return covariance[:, [0, 2]].double().mean(1).cpu().numpy().reshape(steps, worlds, auvs)


def median_of_normals(variance: np.ndarray) -> float:
    """Median length of plane normal vectors of the variances per axis (n,): ½ = mean(1 − exp(−m²/2v))."""
    low, high = 0.0, 10 * float(np.sqrt(variance.max()))
    for _ in range(60):
        m = (low + high) / 2
        low, high = (m, high) if np.mean(-np.expm1(-0.5 * m * m / variance)) < 0.5 else (low, m)
    return m
