"""Spectra of a sea: measured by Welch's method, and the one that its storm is drawn from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from usvauv.env.sea.storm import System, cumulative, density, moment, total_height, wave_systems
from usvauv.env.site.site import Site

SHORTEST = 16  # least number of records for a spectrum


class Waves(NamedTuple):
    """Significant height, m, peak period, s, and circular standard deviation of the direction of travel, rad."""

    height: float
    period: float
    spread: float


def segments(records: np.ndarray, step: float, piece: float) -> tuple[np.ndarray, np.ndarray]:
    """Fourier transforms of overlapping segments of records (T, ...), windowed, their means removed.

    Args:
        records: taken every `step` s.
        piece: length of a segment, s; at most the whole record is taken.

    Returns:
        Frequencies (F,) above 0, Hz, and transforms (segments, F, ...), whose squares are one-sided densities.
    """
    count = round(min(len(records), max(SHORTEST, piece / step)))
    window = np.hanning(count + 2)[1:-1].reshape(-1, *[1] * (records.ndim - 1))
    parts = []
    for start in range(0, len(records) - count + 1, max(1, count // 2)):
        part = records[start : start + count].astype(np.float64)
        parts.append(np.fft.rfft((part - part.mean(axis=0)) * window, axis=0))
    scale = np.full(count // 2 + 1, 2 * step / (window**2).sum())
    if count % 2 == 0:
        scale[-1] /= 2  # the Nyquist frequency has no mirror image
    transforms = np.stack(parts) * np.sqrt(scale).reshape(-1, *[1] * (records.ndim - 1))
    return np.fft.rfftfreq(count, step)[1:], transforms[:, 1:]


def spectrum(records: np.ndarray, step: float, piece: float) -> tuple[np.ndarray, np.ndarray]:
    """One-sided spectral density of records (T, P), mean over P and over segments; arguments as of `segments`.

    Returns:
        Frequencies (F,) above 0, Hz, and density (F,), 1/Hz times the records' unit squared.
    """
    frequency, transforms = segments(records, step, piece)
    return frequency, (np.abs(transforms) ** 2).mean(axis=(0, 2))


def measured(records: np.ndarray, step: float, piece: float) -> Waves:
    """Height, period and spread of waves from elevation and its slopes towards east and north, (T, P, 3).

    The spread is that of a buoy that heaves, pitches and rolls (Longuet-Higgins, Cartwright & Smith 1963): from the
    first moments of the direction in each frequency, weighted by its energy.
    """
    frequency, transforms = segments(records, step, piece)
    heave, slopes = transforms[..., 0], transforms[..., 1:]
    density = (np.abs(heave) ** 2).mean(axis=(0, 2))
    steepness = (np.abs(slopes) ** 2).sum(-1).mean(axis=(0, 2))
    moment = -np.imag(slopes * heave[..., None].conj()).mean(axis=(0, 2))  # (F, 2)
    share = np.sqrt(density / np.maximum(steepness, 1e-30))
    length = np.hypot(*(moment * share[:, None]).sum(0)) / density.sum()
    peak = slice(max(int(density.argmax()) - 1, 0), int(density.argmax()) + 2)
    period = density[peak].sum() / (density[peak] * frequency[peak]).sum()
    return Waves(4 * float(records[..., 0].std()), float(period), math.sqrt(2 * max(0.0, 1 - float(length))))


def wanted(systems: Sequence[System]) -> Waves:
    """What short waves are drawn from.

    Of several systems the period is that of the highest, and the spread that of all directions together.
    """
    height = total_height(systems)
    length = abs(sum(system.significant_height**2 * moment(system) for system in systems)) / height**2
    highest = max(systems, key=lambda system: system.significant_height)
    return Waves(height, highest.peak_period, math.sqrt(2 * (1 - length)))


def target_spectrum(site: Site) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (Hz) and spectral density (m²/Hz) of the spectrum that the short waves of a site are drawn from."""
    scenario, spectra = site.scenario, []
    for system in wave_systems(site):
        omega, S = density(system, scenario.storm.shortest_wave, scenario.area.depth, scenario.sea.gravity)
        f = omega / (2 * math.pi)
        spectra.append((f, S * (system.significant_height / 4) ** 2 / cumulative(f, S)[-1]))
    if len(spectra) == 1:
        return spectra[0]
    f = np.unique(np.concatenate([f for f, _ in spectra]))
    return f, np.sum([np.interp(f, *spectrum, left=0, right=0) for spectrum in spectra], axis=0)
