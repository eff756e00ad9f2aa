"""The storm: a directional sea of wind waves, drawn from a spectrum and a seed, that does not repeat.

    η(x, t) = Σ a cos(k·x − ω t + φ),   E(ω, θ) = S(ω) D(θ),   D ∝ cos^{2s}((θ − θ0)/2).

The spectrum is cut into as many strata as there are components. Half of them follow the energy and half the slope: each
has the same part of (∫ S dω/m0 + ∫ k² S dω/m_slope)/2, since the slope lies mostly in a tail with little energy. A
component has its stratum's energy and a frequency drawn from S within it, so a sum over components of any function of
frequency has the spectrum's integral as its mean, and Hs = 4 √m0 is exact in each realisation. One direction is drawn
from each of equally likely sectors, and components get them in random order; one direction a frequency keeps the sea
ergodic. Phases are uniform. Time averages over N such components have the kurtosis 3 − 1.5 Σa⁴/(Σa²)².

Each swell is drawn likewise, from random numbers of its own: the wind sea is the same with and without it.

Sources: Hasselmann et al. (1973), "Measurements of wind-wave growth and swell decay during JONSWAP"; Bouws et al.
(1985), doi 10.1029/JC090iC01p00975 (TMA); Mitsuyasu et al. (1975), doi
10.1175/1520-0485(1975)005<0750:OOTDSO>2.0.CO;2 (spreading); Miles and Funke (1989), "A comparison of methods for
synthesis of directional seas", J. Offshore Mech. Arct. Eng. 111 (one direction a frequency).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch

from kernels import runtime
from kernels.flow import airy
from usvauv_env.sections import Storm

STREAM = 2  # spawn key of the storm among the random numbers of a sea
SHAPES = ("none", "jonswap", "pm", "tma")
FINE = 8192  # points at which spectrum and spreading are tabulated


class AirySea:
    """Seas of given components at any time.

    Args:
        amplitude, omega, direction, phase: a (m), ω > 0 (rad/s), direction of travel θ (rad from east towards north), φ
            (rad), each (seas, N); N may be 0.
        depth: h, m.
        gravity: g, m/s².
        levels: heights z of the water velocities, −h ≤ z ≤ 0, m.

    Attributes:
        k: wave number (seas, N), rad/m.
        wave: table of the components for kernels, torch (seas, groups, columns, LANES); see `kernels.flow.airy`.
        time: s.
    """

    def __init__(
        self,
        amplitude: np.ndarray,
        omega: np.ndarray,
        direction: np.ndarray,
        phase: np.ndarray,
        *,
        depth: float,
        gravity: float,
        levels: Sequence[float],
    ) -> None:
        device = runtime.start().device
        self.amplitude, self.omega, self.direction, self.phase = amplitude, omega, direction, phase
        self.k = airy.wavenumber(omega, depth, gravity)
        packed = airy.pack(amplitude, self.k, direction, omega, depth=depth, levels=levels)
        self.wave = torch.tensor(packed, device=device)
        self._start = torch.tensor(airy.group(phase / airy.TWO_PI), device=device)
        self._frequency = torch.tensor(airy.group(omega / airy.TWO_PI), device=device)
        self.set_time(0.0)

    def set_time(self, time: float) -> None:
        """Set the time, s. Phases are reduced in double precision, so that late times lose no digits."""
        self.time = time
        self.wave[:, :, airy.PHASE] = torch.remainder(self._start - self._frequency * time, 1.0)

    def elevation(self, sea: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Elevation of one sea on the grid of the points x (X,) and y (Y,), (Y, X) float32, m.

        cos(α + β) = cos α cos β − sin α sin β: one product of real matrices, which libraries do far faster than one of
        complex matrices.
        """
        k, direction = self.k[sea], self.direction[sea]
        along_x = np.outer(k * np.cos(direction), x)
        along_y = np.outer(y, k * np.sin(direction)) - self.omega[sea] * self.time + self.phase[sea]
        left = np.concatenate([np.cos(along_y), -np.sin(along_y)], 1) * np.tile(self.amplitude[sea], 2)
        right = np.concatenate([np.cos(along_x), np.sin(along_x)])
        return left.astype(np.float32) @ right.astype(np.float32)


def build_storm(
    storm: Storm,
    *,
    depth: float,
    gravity: float,
    levels: Sequence[float],
    seed: int,
    num_seas: int,
    first: int = 0,
) -> AirySea:
    """Seas `first` to `first` + `num_seas` − 1 of a seed at t = 0; each depends on (seed, its index) alone.

    Args:
        storm: spectrum and its parameters. Hs = 4 √m0 is that of the waves above `shortest_wave`, where the spectrum is
            cut off: the variance of the slope grows as the logarithm of 1/`shortest_wave`. Tp is for "tma" that of the
            JONSWAP spectrum it is made from; "pm" takes γ = 1.
        depth, gravity, levels: as for `AirySea`.
        seed: any non-negative integer below 2¹²⁸.
        num_seas: number of seas.
        first: index of the first sea.

    Raises:
        ValueError: an unknown spectrum, or a cut-off that leaves less than twice the peak's frequency.
    """
    count, systems = storm.components, storm.systems
    drawn = np.zeros((4, num_seas, count * len(systems)))
    for number, storm in enumerate(systems):
        own_columns = slice(number * count, (number + 1) * count)
        omega, S = band(storm.spectrum, storm.peak_period, storm.gamma, storm.shortest_wave, depth, gravity)
        k = airy.wavenumber(omega, depth, gravity)
        energy, slope = cumulative(omega, S), cumulative(omega, k**2 * S)
        weight = (energy / energy[-1] + slope / slope[-1]) / 2
        strata = np.interp(np.linspace(0, 1, count + 1), weight, energy / energy[-1])
        sectors, probability = spread(storm.spreading)
        for index in range(num_seas):
            own = np.random.SeedSequence(seed, spawn_key=(first + index, STREAM, number)[: 3 if number else 2])
            random = np.random.Generator(np.random.Philox(own))
            quantile = strata[:-1] + np.diff(strata) * random.random(count)
            sector = (random.permutation(count) + random.random(count)) / count
            drawn[:, index, own_columns] = (
                storm.significant_height / 4 * np.sqrt(2 * np.diff(strata)),
                np.interp(quantile, energy / energy[-1], omega),
                storm.direction + np.interp(sector, probability, sectors),
                2 * math.pi * random.random(count),
            )
    return AirySea(*drawn, depth=depth, gravity=gravity, levels=levels)


def band(
    spectrum: str, peak_period: float, gamma: float, shortest_wave: float, depth: float, gravity: float
) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies ω from half the peak's to the cut-off's, and S(ω) up to a factor, each (FINE,).

    S = ω⁻⁵ exp(−1.25 (ωp/ω)⁴) γ^exp(−(ω/ωp − 1)²/2σ²), σ = 0.07 below the peak and 0.09 above; "tma" times
    Φ = tanh²(kh)/(1 + 2kh/sinh 2kh). Arguments and errors as for `build_storm`.
    """
    if spectrum not in SHAPES[1:]:
        raise ValueError(f"spectrum: {spectrum!r} is not one of {', '.join(SHAPES)}")
    peak, shortest = 2 * math.pi / peak_period, 2 * math.pi / shortest_wave
    highest = math.sqrt(gravity * shortest * math.tanh(shortest * depth))
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
