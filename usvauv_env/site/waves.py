"""Waves of a place as files have them: a two-dimensional spectrum, or wind sea and swells by their parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class WaveSpectrum:
    """Spectral density of the elevation, constant in direction within a step and linear in frequency between values.

    Attributes:
        frequencies: (F,) rising, Hz.
        directions: (D,) rising, of travel, from east towards north, in even steps round the circle, rad.
        density: (F, D) m²/(Hz rad).
    """

    frequencies: np.ndarray
    directions: np.ndarray
    density: np.ndarray

    @property
    def step(self) -> float:
        """Between directions, rad."""
        return 2 * math.pi / len(self.directions)

    @property
    def by_frequency(self) -> np.ndarray:
        """Density in all directions together, (F,), m²/Hz."""
        return self.density.sum(axis=1) * self.step

    @property
    def significant_height(self) -> float:
        """Hs = 4 √m0, m."""
        return 4 * math.sqrt(float(_integral(self.frequencies, self.by_frequency)))

    @property
    def peak_period(self) -> float:
        """Period of the densest frequency of the file, s."""
        return 1 / float(self.frequencies[self.by_frequency.argmax()])

    @property
    def moment(self) -> complex:
        """First moment of the directions r₁ exp(iθ), weighted by energy; the spread is √(2(1 − r₁))."""
        first = self.density @ np.exp(1j * self.directions) * self.step
        whole = _integral(self.frequencies, first) / _integral(self.frequencies, self.by_frequency)
        return complex(whole) * float(np.sinc(self.step / (2 * math.pi)))

    @property
    def direction(self) -> float:
        """Mean direction of travel, from east towards north, rad."""
        return float(np.angle(self.moment))


class Partition(NamedTuple):
    """A wave system: Hs (m), period (s), direction of travel (rad from east towards north), spread √(2(1 − r₁)) (rad).

    The period is that of the peak, or the mean T₋₁,₀; a spread that the file does not have is None.
    """

    height: float
    period: float
    direction: float
    spread: float | None
    mean_period: bool
    wind_sea: bool


@dataclass(frozen=True)
class Waves:
    """What a file has for a place and a time.

    Attributes:
        path: of the file.
        start: time at which the mission starts, ISO 8601, UTC; "" where the file has no time.
        spectrum: None in a file of partitions.
        partitions: none in a file of spectra.
        wind: 10 m above the sea, m/s; None where the file has none.
    """

    path: str
    start: str
    spectrum: WaveSpectrum | None
    partitions: tuple[Partition, ...]
    wind: float | None

    @property
    def wind_sea_height(self) -> float:
        """Hs of the wind sea, 0 without one, m; of all waves, where the file does not tell them apart."""
        if self.spectrum is not None:
            return self.spectrum.significant_height
        return math.hypot(*(part.height for part in self.partitions if part.wind_sea))


def _integral(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Of y over x by trapezoids, which for frequencies in a constant ratio are the widths of WAVEWATCH III's bins."""
    return (np.diff(x) * (y[1:] + y[:-1]) / 2).sum()
