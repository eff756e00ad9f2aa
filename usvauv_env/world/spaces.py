"""Spaces of one AUV's observation and action."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from gymnasium.spaces import Box

from kernels.flow import airy
from kernels.types import Level
from usvauv_env.scenario import Scenario
from usvauv_env.sea.forcing import speed_bound
from usvauv_env.sea.storm import band
from usvauv_env.site.site import Site
from usvauv_env.world.observation import Quantity, observed

VORTEX_PEAK = 0.6382 / (2 * math.pi)  # largest speed of a Lamb–Oseen vortex over Γ/δ
LEAST_CURRENT_BOUND = 0.1  # m/s; a box without extent is not a valid space


def load_scenario(scenario: Scenario | str | Path) -> Scenario:
    """A scenario as it is, or by shipped name or path."""
    return scenario if isinstance(scenario, Scenario) else Scenario.load(scenario)


def observed_quantities(site: Site) -> list[Quantity]:
    """The observation of one AUV, number by number, with the bounds of the space."""
    return observed(site.scenario, current_bound(site))


def auv_observation_space(site: Site) -> Box:
    """What one AUV can observe, (O,), as `usvauv_env.world.observation` tabulates it.

    Fixes and storm waves have no hard bound of their own: the rare observation farther out (fixes at a low
    signal-to-noise ratio in very large areas, freak waves) is clamped into the space.
    """
    rows = observed_quantities(site)
    low, high = (np.array([row[column] for row in rows], np.float32) for column in (3, 4))
    return Box(low, high, dtype=np.float32)


def auv_action_space() -> Box:
    """What one AUV can do, (2,)."""
    return Box(-1.0, 1.0, (2,), np.float32)


def current_bound(site: Site) -> float:
    """Largest speed of the water at an AUV, m/s.

    The sum of all vortices' peak speeds, which no superposition exceeds, the fastest real current, the bound of the
    long waves, and six times the rms orbital speed of the storm at cruise depth, exceeded less than once in 10⁸ if
    Gaussian.
    """
    scenario = site.scenario
    current, storm = scenario.current, scenario.storm
    peak = current.vortices * VORTEX_PEAK * current.circulation_max / current.core_radius_min
    peak += speed_bound(site)
    if (flow := site.current) is not None:
        peak += float(np.linalg.norm(flow.velocity[:, Level.cruise], axis=-1).max())
    if storm.spectrum != "none":
        depth, gravity = site.mean_depth, scenario.sea.gravity
        omega, S = band(storm.spectrum, storm.peak_period, storm.gamma, storm.shortest_wave, depth, gravity)
        C, _ = airy.decay(airy.wavenumber(omega, depth, gravity), -min(scenario.auv.depth, depth), depth)
        peak += 6 * storm.significant_height / 4 * math.sqrt(np.sum((omega * C) ** 2 * S) / np.sum(S))
    return max(1.001 * peak, LEAST_CURRENT_BOUND)  # 0.1 % covers single precision
