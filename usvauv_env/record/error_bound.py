"""What no path of the boat can beat: the error of fixes made from the best place at every moment.

A fix's error is taken as normal with the covariance of the whole fix (phases and delay) by a level array at the place
that is D-optimal for the true positions: J⁻¹, and what the errors add that fixes have in common. Where there are none
it is the bound of a single fix: a tracker, which remembers, can be better, and a moving AUV whose sound takes time is
worse.
"""

from __future__ import annotations

import numpy as np
import torch

from usvauv.env.record.trace import Trace
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table
from usvauv.kernels import runtime
from usvauv.kernels.planning import objectives, search
from usvauv.kernels.positioning import acoustic_link, usbl

COMMON = ("ALIGNMENT", "POSITION", "HEADING", "SOUND_SPEED")  # columns of the link table, see `acoustic_link`


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
    level, none = away.new_zeros(len(away), 2), away.new_zeros(len(away), 5)
    covariance = usbl.fixes(link, index, away, level, none)[1].double().cpu().numpy()
    k = index.cpu().numpy()
    constants = {name: link[:, getattr(acoustic_link, name)].double().cpu().numpy()[k] for name in COMMON}
    across, down = away[:, :2].square().sum(1).cpu().numpy(), away[:, 2].square().cpu().numpy()
    common = constants["ALIGNMENT"] * down + constants["POSITION"]
    common += (0.5 * constants["HEADING"] + 2.0 * constants["SOUND_SPEED"]) * across
    return ((covariance[:, 0] + covariance[:, 2]) / 2 + common).reshape(steps, worlds, auvs)


def median_of_normals(variance: np.ndarray) -> float:
    """Median length of plane normal vectors of the variances per axis (n,): ½ = mean(1 − exp(−m²/2v))."""
    low, high = 0.0, 10 * float(np.sqrt(variance.max()))
    for _ in range(60):
        m = (low + high) / 2
        low, high = (m, high) if np.mean(-np.expm1(-0.5 * m * m / variance)) < 0.5 else (low, m)
    return m
