"""Statistics of the current at a scenario's AUVs: its mean square, and its model as a process for the tracker.

The current at a moving AUV is not an Ornstein–Uhlenbeck process but a sum of eddies that it passes through, orbital
motion and long waves, each smooth. For a filter with memory m only the mean square increment D(m) matters. So the model
is the random walk with that increment, q = D(m)/m, at the filter's own memory m = (R t_fix/q)^¼: that of the stationary
filter, whose characteristic polynomial is s⁴ + q/(R t_fix). σ² is the variance of all parts and τ = 2σ²/q; σ² bounds
the variance of the current while fixes are lost. See `ornstein_uhlenbeck`.

Source: Uhlenbeck and Ornstein (1930), doi 10.1103/PhysRev.36.823.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from usvauv.env.scenario.scenario import Scenario
from usvauv.env.sea.long_waves import long_wave_rms
from usvauv.env.sea.storm import density, wave_systems
from usvauv.env.site.site import Site
from usvauv.kernels.flow import airy
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.types import Level

LATTICE = 0.7716  # limit of Σ' e^{−α n²}/n² + π ln α at small α, over the points n of the square lattice but 0
QUANTILES = 500  # of a Rayleigh distribution, and of directions
FOREVER = 1e9  # s, correlation time of a current that does not change


def current_parts(site: Site) -> list[tuple[float, float]]:
    """Variance per axis (m²/s²) and root mean square frequency (rad/s) of each part of the current at the AUVs."""
    scenario = site.scenario
    speed = scenario.reference.straight_speed
    variance, change = _eddy_part(scenario)
    parts = [(variance * scenario.eddies_at_cruise**2, change)] if variance > 0 else []
    for waves in wave_systems(site):
        water = scenario.area.depth, scenario.sea.gravity
        spectrum = density(waves, scenario.shortest_wave, *water)
        parts.append(orbital_motion(*spectrum, waves.significant_height, -scenario.auv.depth, *water))
    for square, period in _forced_waves(site):
        parts.append((square * _forced_share(scenario, period), 2 * math.pi / period))
    flow = site.current
    if flow is not None:
        parts.append(_real_part(scenario, flow.at(0.0)[Level.cruise], speed))
    return parts


def drift_speeds(site: Site, level: int, probabilities: Sequence[float]) -> np.ndarray:
    """Quantiles of the speed of eddies, real currents and long waves at a `Level`, m/s; without orbital motion.

    The velocity is normal, with the mean of the real current over the area and the sum of all variances, half of it in
    each direction: a Rice distribution (Rice 1945, doi 10.1002/j.1538-7305.1945.tb00453.x).
    """
    scenario = site.scenario
    variance, _ = _eddy_part(scenario)
    mean, square = 0.0, 2 * variance * (scenario.eddies_at_cruise**2 if level == Level.cruise else 1.0)
    for mean_square, period in _forced_waves(site):
        square += 2 * mean_square * _forced_share(scenario, period)
    if site.current is not None:
        stream = site.current.at(0.0)[level].astype(float)
        mean = float(np.linalg.norm(stream.mean(axis=(0, 1))))
        square += float(stream.var(axis=(0, 1)).sum())
    middles = (np.arange(QUANTILES) + 0.5) / QUANTILES
    radius = np.sqrt(-square * np.log(middles))
    return np.quantile(np.abs(mean + np.outer(radius, np.exp(2j * np.pi * middles))), probabilities)


def _eddy_part(scenario: Scenario) -> tuple[float, float]:
    """Variance per axis (m²/s²) and frequency (rad/s) of a scenario's vortices at the surface; 0 without vortices."""
    current, area = scenario.current, scenario.area
    if not current.vortices or current.circulation_max == 0:
        return 0.0, 0.0
    limits = (current.circulation_min, current.circulation_max), (current.core_radius_min, current.core_radius_max)
    square = current.period**2 or area.width * area.length
    return eddies(current.vortices, *limits, square, scenario.reference.straight_speed, current.period > 0)


def _forced_waves(site: Site) -> list[tuple[float, float]]:
    """Mean square elevation (m²) and a period (s) of regular and irregular long waves at the forced edge, if any."""
    sea = site.scenario.sea
    waves = [
        (sea.regular_amplitude**2 / 2, sea.regular_period),
        (long_wave_rms(site) ** 2, math.sqrt(sea.irregular_period_min * sea.irregular_period_max)),
    ]
    return [wave for wave in waves if wave[0] > 0]


def _forced_share(scenario: Scenario, period: float) -> float:
    """Mean square current per axis over the mean square elevation (1/s²) in long waves forced at an edge.

    u = η √(g/h) in a wave that leaves at the other side; with a wall there, at the distance L, u = η √(g/h)
    sin kx/cos kL, x from the wall, at resonance at most twice the incident wave.
    """
    sea, area = scenario.sea, scenario.area
    progressive = 0.5 * sea.gravity / area.depth
    if sea.forcing == "incident" or sea.radiating_edges:
        return progressive
    across = area.width if sea.forced_edge in ("west", "east") else area.length
    turn = 2 * math.pi * across / (period * math.sqrt(sea.gravity * area.depth))
    standing = (0.5 - math.sin(2 * turn) / (4 * turn)) / math.cos(turn) ** 2
    return progressive * min(standing, 4.0)


def _real_part(scenario: Scenario, stream: np.ndarray, speed: float) -> tuple[float, float]:
    """Variance and frequency of a current from a file, (rows, columns, 2), m/s, for an AUV crossing it at a speed."""
    variance = float(np.mean(np.square(stream)))
    steps = scenario.area.length / (stream.shape[0] - 1), scenario.area.width / (stream.shape[1] - 1)
    slopes = [np.mean(np.square(np.diff(stream, axis=axis) / steps[axis])) for axis in (0, 1)]
    change = speed * math.sqrt(float(np.mean(slopes)))
    return variance, change / math.sqrt(variance) if variance > 0 else 0.0


def current_model(site: Site, link: np.ndarray) -> tuple[float, float]:
    """Variance (m²/s²) and correlation time (s) of the current for the tracker.

    Args:
        link: `acoustic_link.link_table` of the AUVs; fixes are taken at a quarter of the area's smaller side.
    """
    scenario = site.scenario
    z = scenario.auv.depth
    away = min(scenario.area.width, scenario.area.length) / 4
    q = (z * z + away * away) / link[:, acoustic_link.REFERENCE] ** 2
    noise = np.exp(link[:, acoustic_link.POWER] * np.log(q) - link[:, acoustic_link.LEVEL])
    fix_variance = float(noise.mean()) + (scenario.usbl.attitude_error * z) ** 2
    return ornstein_uhlenbeck(current_parts(site), fix_variance, scenario.mission.step)


def eddies(
    count: int,
    circulation: tuple[float, float],
    core_radius: tuple[float, float],
    area: float,
    speed: float,
    periodic: bool = False,
) -> tuple[float, float]:
    """Variance per axis (m²/s²) and frequency (rad/s) of the current along a path through random Lamb–Oseen vortices.

    With N vortices, |Γ| and δ uniform between limits and centres spread over an area a, the vorticity has the mean
    square N E[Γ²] E[1/δ²]/(2π a); a quarter of that is the mean square per axis of the change of velocity per metre.
    The variance is that within a disc of the same area round each, N E[Γ²] (ln(a/(πδ²)) + 0.5772 − ln 2)/(8π a). In a
    pattern of period L = √a it is the sum over wave numbers k = 2πn/L, N E[Γ²]/(8π² a) Σ' e^{−k²δ²/2}/n², which
    is N E[Γ²] (ln(a/(πδ²)) + C/π − ln 2π)/(8π a) where cores are small; C = Σ' of −π ln α + C at small α, 0.7716.

    Args:
        count: N. circulation, core_radius: limits of |Γ| (m²/s) and δ (m). area: m².
        speed: of the AUV over ground, m/s. periodic: the vortices are a periodic pattern in a square of that area.
    """
    low, high = circulation
    strength = count * (low * low + low * high + high * high) / 3.0 / area
    delta2 = core_radius[0] * core_radius[1]  # 1/E[1/δ²]
    outer = LATTICE / math.pi - math.log(2.0 * math.pi) if periodic else 0.5772 - math.log(2.0)
    variance = strength * max(math.log(area / (math.pi * delta2)) + outer, 0.1) / (8.0 * math.pi)
    change = speed * speed * strength / (8.0 * math.pi * delta2)
    return variance, math.sqrt(change / variance) if variance > 0.0 else 0.0


def orbital_motion(
    omega: np.ndarray, S: np.ndarray, significant_height: float, z: float, depth: float, gravity: float
) -> tuple[float, float]:
    """Variance per axis (m²/s²) and root mean square frequency (rad/s) of the orbital velocity of short waves at z.

    Args:
        omega, S: frequencies (rad/s), evenly spaced, and spectral density up to a factor, (n,).
        significant_height: Hs = 4 √m0, m. z: level, −h ≤ z ≤ 0, m. depth: h, m. gravity: g, m/s².
    """
    orbital = (omega * airy.decay(airy.wavenumber(omega, depth, gravity), z, depth)[0]) ** 2 * S
    variance = 0.5 * (significant_height / 4.0) ** 2 * orbital.sum() / S.sum()
    return float(variance), float(math.sqrt((omega**2 * orbital).sum() / orbital.sum()))


def ornstein_uhlenbeck(
    parts: Sequence[tuple[float, float]], fix_variance: float, interval: float
) -> tuple[float, float]:
    """The current's variance σ² (m²/s²) and correlation time τ (s) for the tracker.

    D(m) = Σ 2 s² (1 − e^{−(ωm)²/2}) over the parts; q = D(m)/m with the memory m = (R t_fix/q)^¼, by bisection.

    Args:
        parts: variance s² per axis (m²/s²) and root mean square frequency ω (rad/s) of each part of the current.
        fix_variance: R per axis, m². interval: t_fix, s, between fixes.
    """
    variance = float(sum(s2 for s2, _ in parts))

    def walk(m: float) -> float:
        return sum(-2.0 * s2 * math.expm1(-0.5 * (omega * m) ** 2) for s2, omega in parts) / m

    low, high = 1e-3, 1e6
    for _ in range(80):
        m = math.sqrt(low * high)
        # m⁴ q(m) = m³ D(m) grows with m.
        low, high = (m, high) if m**4 * walk(m) < fix_variance * interval else (low, m)
    q = walk(low)
    return variance, 2.0 * variance / q if q > 0.0 else FOREVER
