"""The current at the AUVs by the scenario: its largest speed, and what the tracker is told of it."""

from __future__ import annotations

import math

import numpy as np

from usvauv.env.scenario import Scenario
from usvauv.env.sea.build import speed_bound
from usvauv.env.sea.storm import density, wave_systems
from usvauv.env.site.site import Site
from usvauv.kernels.flow import airy
from usvauv.kernels.positioning import acoustic_link, current_process
from usvauv.kernels.types import Level

LEAST_CURRENT_BOUND = 0.1  # m/s; a box without extent is not a valid space


def current_parts(site: Site) -> list[tuple[float, float]]:
    """Variance per axis (m²/s²) and root mean square frequency (rad/s) of each part of the current at the AUVs."""
    scenario = site.scenario
    current, sea, area = scenario.current, scenario.sea, scenario.area
    speed = scenario.reference.straight_speed
    parts = []
    if current.vortices and current.circulation_max > 0:
        limits = (current.circulation_min, current.circulation_max), (current.core_radius_min, current.core_radius_max)
        parts.append(current_process.eddies(current.vortices, *limits, area.width * area.length, speed))
    for waves in wave_systems(site):
        spectrum = density(waves, scenario.storm.shortest_wave, area.depth, sea.gravity)
        depth = -scenario.auv.depth, area.depth, sea.gravity
        parts.append(current_process.orbital_motion(*spectrum, waves.significant_height, *depth))
    if sea.start_rms > 0:
        clock = sea.gravity, sea.drag, scenario.mission.duration
        parts.append(current_process.standing_waves(sea.start_rms, sea.start_modes, area.width, area.depth, *clock))
    for square, period in (
        (sea.regular_amplitude**2 / 2, sea.regular_period),
        (sea.irregular_rms**2, math.sqrt(sea.irregular_period_min * sea.irregular_period_max)),
    ):
        if square > 0:
            parts.append((square * _forced_share(scenario, period), 2 * math.pi / period))
    flow = site.current
    if flow is not None:
        parts.append(_real_part(scenario, flow.at(0.0)[Level.cruise], speed))
    return parts


def _forced_share(scenario: Scenario, period: float) -> float:
    """Mean square current per axis over that of the elevation (1/s²) in long waves forced at an edge.

    u = η √(g/h) in a wave that leaves at the other side; where that is a wall at the distance L, u = η √(g/h)
    sin kx/cos kL, x from the wall, at resonance at most twice the wave that comes in.
    """
    sea, area = scenario.sea, scenario.area
    progressive = 0.5 * sea.gravity / area.depth
    if sea.forcing == "incident" or sea.radiating_edges or sea.sponge_edges:
        return progressive
    across = area.width if sea.forced_edge in ("west", "east") else area.length
    turn = 2 * math.pi * across / (period * math.sqrt(sea.gravity * area.depth))
    standing = (0.5 - math.sin(2 * turn) / (4 * turn)) / math.cos(turn) ** 2
    return progressive * min(standing, 4.0)


def _real_part(scenario: Scenario, stream: np.ndarray, speed: float) -> tuple[float, float]:
    """A current from a file, (rows, columns, 2), m/s, as an AUV meets it that crosses it at a speed."""
    variance = float(np.mean(np.square(stream)))
    steps = scenario.area.length / (stream.shape[0] - 1), scenario.area.width / (stream.shape[1] - 1)
    slopes = [np.mean(np.square(np.diff(stream, axis=axis) / steps[axis])) for axis in (0, 1)]
    change = speed * math.sqrt(float(np.mean(slopes)))
    return variance, change / math.sqrt(variance) if variance > 0 else 0.0


def current_model(site: Site, link: np.ndarray) -> tuple[float, float]:
    """Variance (m²/s²) and correlation time (s) of the current for `usvauv.kernels.positioning.current_process`.

    Args:
        link: `acoustic_link.link_table` of the AUVs; fixes count as from a quarter of the area's smaller side away.
    """
    scenario = site.scenario
    z = scenario.auv.depth
    away = min(scenario.area.width, scenario.area.length) / 4
    q = (z * z + away * away) / link[:, acoustic_link.REFERENCE] ** 2
    noise = np.exp(link[:, acoustic_link.POWER] * np.log(q) - link[:, acoustic_link.LEVEL])
    fix_variance = float(noise.mean()) + (scenario.usbl.attitude_error * z) ** 2
    return current_process.ornstein_uhlenbeck(current_parts(site), fix_variance, scenario.mission.step)


def current_bound(site: Site) -> float:
    """Largest speed of the water at an AUV, m/s.

    The sum of all vortices' peak speeds, which no superposition exceeds, the fastest real current, the bound of the
    long waves, and six times the rms orbital speed of the storm at cruise depth, exceeded less than once in 10⁸ if
    Gaussian.
    """
    scenario = site.scenario
    current = scenario.current
    peak = current.fastest + speed_bound(site)
    if (flow := site.current) is not None:
        peak += float(np.linalg.norm(flow.velocity[:, Level.cruise], axis=-1).max())
    orbital = []
    for waves in wave_systems(site):
        depth, gravity = site.mean_depth, scenario.sea.gravity
        omega, S = density(waves, scenario.storm.shortest_wave, depth, gravity)
        C, _ = airy.decay(airy.wavenumber(omega, depth, gravity), -min(scenario.auv.depth, depth), depth)
        orbital.append(6 * waves.significant_height / 4 * math.sqrt(np.sum((omega * C) ** 2 * S) / np.sum(S)))
    peak += math.hypot(*orbital)
    return max(1.001 * peak, LEAST_CURRENT_BOUND)  # 0.1 % covers single precision
