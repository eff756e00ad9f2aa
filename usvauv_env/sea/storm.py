"""The storm: a directional sea of wind waves, drawn from a spectrum and a seed, that does not repeat.

    η(x, t) = Σ a cos(k·x − ω t + φ),   E(ω, θ) = S(ω) D(θ),   D ∝ cos^{2s}((θ − θ0)/2).

The spectrum is divided into as many strata as there are components, half by energy and half by slope: each has the same
part of (∫ S dω/m0 + ∫ k² S dω/m_slope)/2, since the slope lies mostly in a tail with little energy. A component has its
stratum's energy and a frequency drawn from S within it, so a sum over components of any function of frequency has the
spectrum's integral as its mean, and Hs = 4 √m0 is exact in each realisation. One direction is drawn from each of
equally likely sectors, and components get them in random order; one direction per frequency keeps the sea ergodic.
Phases are uniform. Time averages over N such components have the kurtosis 3 − 1.5 Σa⁴/(Σa²)².

Each swell is drawn likewise, from separate random numbers: the wind sea is the same with and without it.

A spectrum E(ω, θ) of a file is one system. Component k has a direction drawn at its own frequency, at the quantile
u + k φ mod 1, φ the golden ratio. These lie evenly in any range of frequencies, so that swell and wind sea each keep
their mean direction and spread.

Sources: Hasselmann et al. (1973), "Measurements of wind-wave growth and swell decay during JONSWAP"; Bouws et al.
(1985), doi 10.1029/JC090iC01p00975 (TMA); Mitsuyasu et al. (1975), doi
10.1175/1520-0485(1975)005<0750:OOTDSO>2.0.CO;2 (spreading); Miles and Funke (1989), "A comparison of methods for
synthesis of directional seas", J. Offshore Mech. Arct. Eng. 111 (one direction a frequency).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from usvauv.env.scenario.environment import Storm
from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.site.site import Site
from usvauv.env.site.waves import Partition, WaveSpectrum
from usvauv.kernels.flow import airy

System = Storm | WaveSpectrum  # each with significant_height (m), peak_period (s) and direction of travel (rad)

STREAM = 2  # spawn key of the storm among the random numbers of a sea
SHAPES = ("none", "jonswap", "pm", "tma")
FINE = 8192  # points at which spectrum and spreading are tabulated
GOLDEN = (math.sqrt(5) - 1) / 2
LEFT_OUT = 0.1  # most of a file's energy that may lie in waves that are too short
SMALLEST = 0.01  # share of the height below which a partition of a file is left out
NARROWEST = 1000.0  # spreading, as the field of a scenario has it
BED_CELLS = 128  # along the longer side, at which an uneven bed is compared with the storm
BED_DEPTHS = 400  # that are compared
SHOALING = 0.1  # share of the height by which a wave may shoal before the storm is wrong
BREAKING = 0.6  # height over depth, as `Scenario` has it


def elevation(waves: np.ndarray, x: np.ndarray, y: np.ndarray, time: float) -> np.ndarray:
    """Elevation Σ a cos(kx x + ky y − ω t + φ) on the grid of the points x (X,) and y (Y,), (Y, X) float32, m.

    cos(α + β) = cos α cos β − sin α sin β: one product of real matrices, which libraries do far faster than one of
    complex matrices. Phases are reduced to one turn in double precision; all else is in single precision.

    Args:
        waves: a, kx, ky, ω and φ of N waves, (N, 5). time: t, s.
    """
    a, kx, ky, omega, phase = waves.T
    along_x = _reduced(np.outer(kx, x))
    along_y = _reduced(np.outer(y, ky) + (phase - omega * time))
    amplitude = a.astype(np.float32)
    left = np.concatenate([amplitude * np.cos(along_y), -amplitude * np.sin(along_y)], 1)
    return left @ np.concatenate([np.cos(along_x), np.sin(along_x)])


def _reduced(phase: np.ndarray) -> np.ndarray:
    """Phases less whole turns, float32, rad."""
    return (phase - 2 * math.pi * np.rint(phase / (2 * math.pi))).astype(np.float32)


def wave_systems(site: Site) -> tuple[System, ...]:
    """The short waves of a site: wind sea and swells of the scenario or of its file, or the spectrum of its file.

    Waves of a file that are shorter than `Scenario.shortest_wave` are left out, and the others have their energy.

    Raises:
        OceanError: the file does not serve.
        ScenarioError: too much of its energy lies in waves that are too short, its waves break, or the AUVs are in
            their troughs.
    """
    scenario, waves = site.scenario, site.waves
    if waves is None:
        return scenario.storm.systems
    storm, gravity = scenario.storm, scenario.sea.gravity
    highest = cut_off(scenario.shortest_wave, min(scenario.area.depth, site.mean_depth), gravity)
    if waves.spectrum is not None:
        f, S = waves.spectrum.frequencies, waves.spectrum.by_frequency
        kept = np.linspace(f[0], max(min(f[-1], highest / (2 * math.pi)), f[0]), FINE)
        share = float(cumulative(kept, np.interp(kept, f, S))[-1] / cumulative(f, S)[-1])
        systems: tuple[System, ...] = (waves.spectrum,)
    else:
        every = [_as_storm(part, storm) for part in waves.partitions]
        least = SMALLEST * total_height(every)
        large = [each for each in every if each.significant_height >= least]
        long = [each for each in large if highest >= 4 * math.pi / each.peak_period]
        share = (total_height(long) / total_height(large)) ** 2
        scale = 1 / math.sqrt(share) if share else 1.0
        systems = tuple(
            each.model_copy(update={"significant_height": scale * each.significant_height}) for each in long
        )
    if share < 1 - LEFT_OUT:
        raise ScenarioError(
            f"{scenario.shortest_wave_field} = {scenario.shortest_wave:g}: leaves out {1 - share:.0%} of the energy of"
            f" {waves.path}; at most {LEFT_OUT:.0%}"
        )
    try:
        for system in systems:
            period = system.peak_period if isinstance(system, Storm) else math.inf
            scenario.check_breaking(f"{waves.path}: significant height", system.significant_height, period)
        scenario.check_troughs(total_height(systems))
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    return systems


def total_height(systems: Sequence[System]) -> float:
    """Significant height of all systems together, 4 √Σm0, m."""
    return math.hypot(*(system.significant_height for system in systems))


def moment(system: System) -> complex:
    """First moment of the directions of travel, r₁ exp(iθ); s/(s + 1) is that of cos^2s(½Δθ)."""
    if isinstance(system, WaveSpectrum):
        return system.moment
    length = system.spreading / (system.spreading + 1)
    return complex(length * math.cos(system.direction), length * math.sin(system.direction))


def _as_storm(part: Partition, storm: Storm) -> Storm:
    """A partition as a wave system with the shape of a scenario's, JONSWAP where it has none.

    The spread √(2(1 − r₁)) gives the spreading s by r₁ = s/(s + 1), and a mean period the peak's by the shape without a
    cut-off.
    """
    shape = "jonswap" if storm.spectrum == "none" else storm.spectrum
    period = part.period
    if part.moment:
        k = part.moment
        omega, S = band("pm" if shape == "pm" else "jonswap", 2 * math.pi, storm.gamma, 1e-3, 1e4, 1.0)
        moments = (S, S / omega) if k == -1 else (S * omega**k, S)
        period *= float(cumulative(omega, moments[0])[-1] / cumulative(omega, moments[1])[-1]) ** (1 / abs(k))
    spreading = storm.spreading
    if part.spread is not None:
        spreading = min(2 / max(part.spread, 1e-3) ** 2 - 1, NARROWEST)
    own = {"significant_height": part.height, "direction": part.direction, "peak_period": period}
    return storm.model_copy(update=own | {"spectrum": shape, "spreading": spreading, "swells": ()})


def draw_storm(
    storm: Storm, systems: Sequence[System], seas: Sequence[tuple[int, int]], *, depth: float, gravity: float
) -> np.ndarray:
    """Component waves of seas, each by its seed and index alone: a (m), ω (rad/s), θ and φ (rad), (4, seas, N).

    Args:
        storm: number of components, and `shortest_wave`, where spectra are cut off: the variance of the slope grows as
            the logarithm of 1/`shortest_wave`.
        systems: spectra and their parameters. Hs = 4 √m0 is that of the waves above `shortest_wave`. Tp is for "tma"
            that of the JONSWAP spectrum it is made from; "pm" takes γ = 1.
        seas: seed, any non-negative integer below 2¹²⁸, and index of each sea.
        depth, gravity: h (m) and g (m/s²).

    Raises:
        ValueError: an unknown spectrum, or a cut-off that leaves less than twice the peak's frequency.
    """
    count = storm.components
    drawn = np.zeros((4, len(seas), count * len(systems)))
    for number, system in enumerate(systems):
        omega, S = density(system, storm.shortest_wave, depth, gravity)
        k = airy.wavenumber(omega, depth, gravity)
        energy, slope = cumulative(omega, S), cumulative(omega, k**2 * S)
        weight = (energy / energy[-1] + slope / slope[-1]) / 2
        strata = np.interp(np.linspace(0, 1, count + 1), weight, energy / energy[-1])
        within, sector, phase = np.empty((3, len(seas), count))
        for row, (seed, index) in enumerate(seas):
            own = np.random.SeedSequence(seed, spawn_key=(index, STREAM, number)[: 3 if number else 2])
            random = np.random.Generator(np.random.Philox(own))
            within[row] = random.random(count)
            sector[row] = _sectors(system, random, count)
            phase[row] = random.random(count)
        frequency = np.interp(strata[:-1] + np.diff(strata) * within, energy / energy[-1], omega)
        drawn[:, :, number * count : (number + 1) * count] = (
            np.broadcast_to(system.significant_height / 4 * np.sqrt(2 * np.diff(strata)), frequency.shape),
            frequency,
            _directions(system, frequency, sector),
            2 * math.pi * phase,
        )
    return drawn


def _sectors(system: System, random: np.random.Generator, count: int) -> np.ndarray:
    """Quantiles of the directions of travel of component waves of rising frequencies, (count,)."""
    if isinstance(system, Storm):
        return (random.permutation(count) + random.random(count)) / count
    return (random.random() + GOLDEN * np.arange(count)) % 1.0


def _directions(system: System, omega: np.ndarray, quantile: np.ndarray) -> np.ndarray:
    """Directions of travel at their quantiles of component waves of frequencies ω (rad/s), each (seas, N), rad."""
    if isinstance(system, Storm):
        sectors, probability = spread(system.spreading)
        return system.direction + np.interp(quantile, probability, sectors)
    edges = system.directions[0] + system.step * (np.arange(len(system.directions) + 1) - 0.5)
    rows = [np.interp(omega.ravel() / (2 * math.pi), system.frequencies, column) for column in system.density.T]
    sums = np.pad(np.stack(rows, axis=1).cumsum(axis=1), ((0, 0), (1, 0)))
    found = [np.interp(u * row[-1], row, edges) for u, row in zip(quantile.ravel(), sums, strict=True)]
    return np.reshape(found, omega.shape)


def cut_off(shortest_wave: float, depth: float, gravity: float) -> float:
    """Frequency ω of the shortest wave, rad/s."""
    shortest = 2 * math.pi / shortest_wave
    return math.sqrt(gravity * shortest * math.tanh(shortest * depth))


def density(system: System, shortest_wave: float, depth: float, gravity: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies ω (rad/s) up to the cut-off's and S(ω) up to a factor, each (FINE,); errors as for `draw_storm`."""
    if isinstance(system, Storm):
        return band(system.spectrum, system.peak_period, system.gamma, shortest_wave, depth, gravity)
    f = system.frequencies
    omega = 2 * math.pi * np.linspace(f[0], min(f[-1], cut_off(shortest_wave, depth, gravity) / (2 * math.pi)), FINE)
    return omega, np.interp(omega / (2 * math.pi), f, system.by_frequency)


def band(
    spectrum: str, peak_period: float, gamma: float, shortest_wave: float, depth: float, gravity: float
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies ω from half the peak's to the cut-off's, and S(ω) up to a factor, each (FINE,).

    S = ω⁻⁵ exp(−1.25 (ωp/ω)⁴) γ^exp(−(ω/ωp − 1)²/2σ²), σ = 0.07 below the peak and 0.09 above; "tma" times
    Φ = tanh²(kh)/(1 + 2kh/sinh 2kh). Arguments and errors as for `draw_storm`.
    """
    if spectrum not in SHAPES[1:]:
        raise ValueError(f"spectrum: {spectrum!r} is not one of {', '.join(SHAPES)}")
    peak, highest = 2 * math.pi / peak_period, cut_off(shortest_wave, depth, gravity)
    if highest < 2 * peak:
        raise ValueError(f"shortest_wave: {shortest_wave:g} m leaves less than twice the frequency of the peak")
    omega = np.linspace(peak / 2, highest, FINE)
    ratio = omega / peak
    width = np.where(ratio <= 1, 0.07, 0.09)
    S = ratio**-5.0 * np.exp(-1.25 * ratio**-4.0)
    if spectrum != "pm":
        S *= gamma ** np.exp(-(((ratio - 1) / width) ** 2) / 2)
    if spectrum == "tma":
        kh = airy.wavenumber(omega, depth, gravity) * depth
        S *= np.tanh(kh) ** 2 / (1 + 4 * kh * np.exp(-2 * kh) / -np.expm1(-4 * kh))
    return omega, S


def spread(s: float) -> tuple[np.ndarray, np.ndarray]:
    """Directions θ − θ0 from −π to π and the probability of a smaller one under cos^{2s}((θ − θ0)/2), each (FINE,)."""
    theta = np.linspace(-math.pi, math.pi, FINE)
    probability = cumulative(theta, np.abs(np.cos(theta / 2)) ** (2 * s))
    return theta, probability / probability[-1]


def cumulative(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Integral of y over x from the first point to each, by trapezoids."""
    return np.concatenate([[0.0], np.cumsum(np.diff(x) * (y[1:] + y[:-1]) / 2)])


def group_speed(period: float, depth: float, gravity: float) -> float:
    """c_g = ω/k (½ + kh/sinh 2kh), m/s."""
    omega = 2 * math.pi / period
    k = float(airy.wavenumber(np.array(omega), depth, gravity))
    return omega / k * (0.5 + k * depth / math.sinh(2 * k * depth) if k * depth < 300 else 0.5)


def shallowest_valid_depth(site: Site) -> float:
    """Depth below which the storm, with its waves of the mean depth, is wrong, m; 0 where it holds in all depths.

    A wave system keeps its energy flux c_g H²: a height off by more than `SHOALING` from that at the mean depth is
    wrong, and so is a sea higher than `BREAKING` times the depth.
    """
    scenario, mean = site.scenario, site.mean_depth
    systems, g = wave_systems(site), scenario.sea.gravity
    deepest = total_height(systems) / BREAKING
    for system in systems:
        there = group_speed(system.peak_period, mean, g)
        for depth in np.linspace(mean, 0.0, BED_DEPTHS, endpoint=False)[1:]:
            if abs(math.sqrt(there / group_speed(system.peak_period, float(depth), g)) - 1) > SHOALING:
                deepest = max(deepest, float(depth))
                break
    return deepest


def uneven_bed_warning(site: Site) -> str:
    """A line on where over an uneven bed the storm is wrong; empty where it is not, or where bed or sea are flat."""
    scenario = site.scenario
    if site.flat or not wave_systems(site):
        return ""
    depth, limit = site.still_depth(scenario.area.cells(BED_CELLS)), shallowest_valid_depth(site)
    wet = depth > 0
    share = np.count_nonzero(wet & (depth < limit)) / np.count_nonzero(wet)
    if not share:
        return ""
    return (
        f"those of the mean depth, {site.mean_depth:.0f} m, everywhere; in water shallower than"
        f" {limit:.0f} m, {max(share, 0.01):.0%} of the area, they would shoal by more than {SHOALING:.0%} or break,"
        " which is not simulated"
    )
