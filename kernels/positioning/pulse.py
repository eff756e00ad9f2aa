"""Sampled pulses: coded ones and tones, their correlation functions, and the noise of a filter matched to them.

A pulse is L chips of ±1, one each 1/B, with chips of the flat spectrum of the band B: at complex baseband

    s(t) = Σ_l c_l D(B t − l),   R(τ) = Σ_k A_k D(B τ − k),   A_k = Σ_l c_l c_{l+k}/L,

R is the pulse's autocorrelation. D is sin πx/(M sin πx/M), the sinc function on a record of M chips, M odd; on such a
record correlations are exact sums over its M frequencies. The rms bandwidth of a flat band is B √((1 − 1/M²)/12).
A tone is a pulse without a code: all its chips are 1, each as long as a period of the carrier, and R falls linearly.

Codes. Gold's codes (IEEE Trans. Inf. Theory 13 (1967) 619, doi 10.1109/TIT.1967.1054048) have low correlations where
they repeat without a pause. A single pulse has aperiodic ones (Sarwate and Pursley, Proc. IEEE 68 (1980) 593,
doi 10.1109/PROC.1980.11697). Those of random codes have the mean square 1/(2L) over the 2L lags where pulses overlap,
and random codes exist at every length. `codes` takes, of CANDIDATES random ones, the one with the lowest peak of its
correlations among those whose mean square bandwidth is that of the flat band to FLATNESS.

Noise. Outputs of the filter are Gaussian with the covariance R(τ − τ'), real and imaginary parts independent: a matrix
N with N Nᵀ = R times independent normal numbers. N is the Karhunen–Loève expansion of the noise in the gate, cut where
an eigenvalue is below EIGENVALUE, which leaves some `gate` + 10 columns.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import taichi as ti
import torch

from usvauv.kernels.functions import func
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.types import vec4

FINE = 32  # lags a chip in tables
EIGENVALUE = 1e-9
CANDIDATES = 1024
FLATNESS = 0.003  # of the mean square bandwidth
FEWEST_CHIPS = 16
FEWEST_PERIODS = 5  # of a tone
PERIODS = 2  # by which the delay of a tone is searched to either side
TONE_GATE = 2 * PERIODS + 2  # of a tone, periods: its arrival and its phase are each within half a period


class Pulses(NamedTuple):
    """Tables of K pulses.

    Attributes:
        envelope: (K, …) float32, the autocorrelation R at the lags j/FINE chips from 0.
        noise: (K, gate · FINE + 1, columns) float32, rows for the lags of the gate.
        rate: (K,) float32, B/f, chips a period of the carrier.
        tone: whether the pulses are tones, whose delay is read from the carrier.
    """

    envelope: torch.Tensor
    noise: torch.Tensor
    rate: torch.Tensor
    tone: bool = False


def mean_square_bandwidth(spectrum: np.ndarray) -> np.ndarray:
    """Mean square frequency of two-sided power spectra (..., M), M odd, over that of a flat band."""
    M = spectrum.shape[-1]
    f = np.fft.fftfreq(M)
    return (f * f * spectrum).sum(-1) / spectrum.sum(-1) / ((1 - 1 / M**2) / 12)


def correlation(one: np.ndarray, other: np.ndarray, record: int) -> np.ndarray:
    """Mean of one(t + τ) other(t) of the pulses of codes (..., L), on a record of M = `record` chips, M odd.

    Returns:
        (..., M · FINE), at the lags τ = j/FINE chips modulo the record.
    """
    spectrum = np.fft.rfft(one, record) * np.fft.rfft(other, record).conj()
    return np.fft.irfft(spectrum, record * FINE) * FINE / one.shape[-1]


def sidelobe(code: np.ndarray, others: list[np.ndarray]) -> np.ndarray:
    """Largest |correlation| of codes (n, L) with themselves, more than a chip off, and with each of the others (L,)."""
    record = 2 * code.shape[-1] + 1
    peak = np.abs(correlation(code, code, record)[:, FINE:-FINE]).max(-1)
    for other in others:
        peak = np.maximum(peak, np.abs(correlation(code, other, record)).max(-1))
    return peak


def codes(count: int, chips: int, seed: int = 0) -> np.ndarray:
    """Codes (count, chips) of ±1, one an AUV; the first ones do not depend on the count.

    Raises:
        ValueError: fewer than FEWEST_CHIPS chips.
    """
    if chips < FEWEST_CHIPS:
        raise ValueError(f"chips: a code has at least {FEWEST_CHIPS}; got {chips}")
    random = np.random.default_rng(seed)
    chosen: list[np.ndarray] = []
    for _ in range(count):
        candidates = random.choice([-1.0, 1.0], (CANDIDATES, chips))
        spectrum = np.abs(np.fft.fft(candidates, 2 * chips + 1)) ** 2
        uneven = np.abs(mean_square_bandwidth(spectrum) - 1)
        even = candidates[uneven <= max(FLATNESS, uneven.min())]
        chosen.append(even[sidelobe(even, chosen).argmin()])
    return np.array(chosen).reshape(count, chips)


def pulses(code: np.ndarray, carriers: Sequence[float], bandwidth: float, gate: int, device: torch.device) -> Pulses:
    """Tables of the pulses of codes (K, L), their carriers (Hz) and common bandwidth B (Hz); `gate` in chips, even."""
    chips = code.shape[1]
    record = 2 * chips + 2 * gate + 1
    R = correlation(code, code, record)
    spectrum = np.fft.rfft(code, record)
    lag = np.arange(gate * FINE + 1)
    noise = []
    for k in range(len(code)):
        # R(τ − τ') = Σ_m |S_m|² e^{2πjm(τ − τ')/M}: the real and imaginary parts of e^{…} factorise it.
        turn = lag[:, None] * np.arange(spectrum.shape[1]) / (record * FINE)
        root = np.abs(spectrum[k]) * np.sqrt(np.where(np.arange(spectrum.shape[1]) > 0, 2, 1) / (record * chips))
        factor = np.concatenate(
            [root * np.cos(2.0 * math.pi * turn), root[1:] * np.sin(2.0 * math.pi * turn[:, 1:])], axis=1
        )
        left, scale, _ = np.linalg.svd(factor, full_matrices=False)
        noise.append((left * scale)[:, scale**2 > EIGENVALUE])
    columns = max(part.shape[1] for part in noise)
    noise = np.stack([np.pad(part, ((0, 0), (0, columns - part.shape[1]))) for part in noise])
    tables = (R[:, : (record // 2) * FINE], noise, bandwidth / np.array(carriers))
    envelope, rows, rate = (torch.from_numpy(np.ascontiguousarray(part, np.float32)).to(device) for part in tables)
    return Pulses(envelope, rows, rate)


def tones(count: int, periods: int, device: torch.device) -> Pulses:
    """Tables of `count` tones that are `periods` periods of their carriers long, at least FEWEST_PERIODS."""
    one = pulses(np.ones((1, periods)), (1.0,), 1.0, TONE_GATE, device)
    return Pulses(*(table.repeat(count, *[1] * (table.ndim - 1)) for table in one[:3]), tone=True)


@func
def envelope(table: ti.template(), k: ti.i32, lag: ti.f32) -> ti.f32:
    """R of pulse k at a lag in chips, from `Pulses.envelope` by the cubic through four of its values; exact to 1e-6."""
    at = ti.abs(lag) * FINE
    j = ti.cast(at, ti.i32)
    x = at - j
    value = 0.0
    if j + 2 < table.shape[1]:
        weight = vec4(
            -x * (x - 1.0) * (x - 2.0) / 6.0,
            (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
            -(x + 1.0) * x * (x - 2.0) / 2.0,
            (x + 1.0) * x * (x - 1.0) / 6.0,
        )
        for i in ti.static(range(4)):
            value += weight[i] * table[k, ti.abs(j - 1 + i)]
    return value


@func
def chip(tables: ti.template(), link: ti.template(), k: ti.i32) -> ti.f32:
    """Slant range that a chip's delay stands for, m."""
    return link[k, acoustic_link.WAVELENGTH] / link[k, acoustic_link.PATHS] / tables.rate[k]
