"""Where over an uneven bed the storm, which has the waves of the mean depth, is wrong."""

from __future__ import annotations

import math

import numpy as np

from usvauv.env.sea.storm import total_height, wave_systems
from usvauv.env.site.site import Site
from usvauv.kernels.flow import airy

CELLS = 128  # along the longer side, at which the bed is looked at
DEPTHS = 400  # that are tried
WRONG = 0.1  # share by which shoaling may change the height
BREAKING = 0.6  # height over depth, as `Scenario` has it


def group_speed(period: float, depth: float, gravity: float) -> float:
    """c_g = ω/k (½ + kh/sinh 2kh), m/s."""
    omega = 2 * math.pi / period
    k = float(airy.wavenumber(np.array(omega), depth, gravity))
    return omega / k * (0.5 + k * depth / math.sinh(2 * k * depth) if k * depth < 300 else 0.5)


def shallowest_right(site: Site) -> float:
    """Depth from which down to the shallow the storm is wrong, m; 0 where it is right in all depths below the mean.

    A wave system keeps its energy flux c_g H²: a height off by more than `WRONG` from that at the mean depth is wrong,
    and so is a sea higher than `BREAKING` times the depth.
    """
    scenario, mean = site.scenario, site.mean_depth
    systems, g = wave_systems(site), scenario.sea.gravity
    deepest = total_height(systems) / BREAKING
    for system in systems:
        there = group_speed(system.peak_period, mean, g)
        for depth in np.linspace(mean, 0.0, DEPTHS, endpoint=False)[1:]:
            if abs(math.sqrt(there / group_speed(system.peak_period, float(depth), g)) - 1) > WRONG:
                deepest = max(deepest, float(depth))
                break
    return deepest


def warning(site: Site) -> str:
    """A line that says where the storm is wrong; empty where it is not, or where bed or sea are flat."""
    scenario = site.scenario
    if not (scenario.water.bathymetry and wave_systems(site)):
        return ""
    size = max(scenario.area.width, scenario.area.length) / CELLS
    cells = max(3, round(scenario.area.width / size)), max(3, round(scenario.area.length / size))
    depth, limit = site.still_depth(cells), shallowest_right(site)
    wet = depth > 0
    share = np.count_nonzero(wet & (depth < limit)) / np.count_nonzero(wet)
    if not share:
        return ""
    return (
        f"storm: its waves are those of the mean depth, {site.mean_depth:.0f} m, everywhere; in water shallower than"
        f" {limit:.0f} m, {max(share, 0.01):.0%} of this one, they would shoal by more than {WRONG:.0%} or break,"
        " which is not simulated"
    )
