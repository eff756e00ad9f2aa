"""Speeds of a boat through the water: the highest, in calm water and against waves, and the lag of its response."""

from __future__ import annotations

import math

from usvauv.env.scenario.scenario import Scenario
from usvauv.env.sea.hull import Hull
from usvauv.env.sea.storm import density, wave_systems
from usvauv.env.site.site import Site
from usvauv.kernels.flow import airy
from usvauv.kernels.mission.boats.boat_motion import CONTROL_TIME
from usvauv.kernels.vehicles import otter_numbers

COARSER = 16  # frequencies of a spectrum of which one is taken for the resistance
BISECTIONS = 24


def calm_top_speed(scenario: Scenario) -> float:
    """Top speed of a boat through calm water, m/s."""
    most = otter_numbers.top_speed(scenario.otter.model_dump()) if scenario.boat.model == "otter" else math.inf
    return min(scenario.boat.top_speed, most)


def top_speed(site: Site) -> float:
    """Top speed of a boat through the water in the short waves of a site, m/s.

    There its thrust is the drag in calm water, which grows with the square of the speed, and the resistance that waves
    add, 2 ∫ R/a² S dω over all systems (`usvauv.env.sea.hull`); by bisection.
    """
    scenario, boat = site.scenario, site.scenario.boat
    calm, depth, gravity = calm_top_speed(scenario), site.mean_depth, scenario.sea.gravity
    if not boat.thrust:
        return calm
    hull, waves = Hull(boat.length, boat.beam, boat.draught), []
    for system in wave_systems(site):
        omega, S = (part[::COARSER] for part in density(system, scenario.shortest_wave, depth, gravity))
        share = 2 * (system.significant_height / 4) ** 2 * S / S.sum()
        waves.append((airy.wavenumber(omega, depth, gravity), omega, share))
    slow, fast = 0.0, calm
    for _ in range(BISECTIONS):
        speed = (slow + fast) / 2
        added = sum(share @ hull.added_resistance(k, omega, speed, gravity) for k, omega, share in waves)
        slow, fast = (speed, fast) if boat.thrust * (speed / calm) ** 2 + added < boat.thrust else (slow, speed)
    return fast


def response_time(scenario: Scenario) -> float:
    """Time constant of a boat's velocity through the water, s."""
    boat = scenario.boat
    return otter_numbers.response_time(scenario.otter.model_dump()) if boat.model == "otter" else boat.response_time


def control_time(scenario: Scenario) -> float:
    """Distance to a goal over a boat's commanded speed, s: the distance decreases as e^{−t/`CONTROL_TIME`}."""
    step = scenario.mission.step
    return step / -math.expm1(-step / CONTROL_TIME) if response_time(scenario) else step
