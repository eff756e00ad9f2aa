"""The law of a fix's errors beside a receiver in NumPy: pulses in white noise, matched filters, phases and delay."""

import math

import numpy as np
import pytest
import torch
from scipy import stats

from usvauv.kernels.positioning import acoustic_link, usbl

CARRIER, SPACING, C = 25000.0, 0.02, 1500.0  # Hz, m, m/s
OFFSET = np.array([70.0, -45.0, -104.0])  # from the array to the AUV, m
RECORD, FINE = 195, 32  # chips of the record, lags a chip
LAGS = np.arange(-2 * FINE, 2 * FINE + 1) / FINE  # chips
PULSES = 3000


def receive(chips: np.ndarray, band: float, gamma: float) -> tuple[np.ndarray, np.ndarray]:
    """Phase differences (n, 2), rad, and slant range (n,), m, of pulses of the energy γ over the noise density.

    Hydrophones at +x, −x, +y and −y receive a plane wave. A pulse has chips of 1/band, a tone chips of one period that
    are all 1. The delay is that of the peak of the energy of all four, for a tone that of the mean phase.
    """
    random, frequency = np.random.default_rng(3), np.fft.fftfreq(RECORD)
    spectrum = np.fft.fft(chips, RECORD)
    spectrum /= np.linalg.norm(spectrum)
    away = 0.5 * SPACING / C * OFFSET[:2] / np.linalg.norm(OFFSET)
    centre = random.uniform(-0.5, 0.5, PULSES) / band  # arrival at the array's centre after the gate's middle, s
    arrival = centre[:, None] - np.array([away[0], -away[0], away[1], -away[1]])
    noise = random.standard_normal((2, PULSES, 4, RECORD))
    shift = np.exp(-2j * math.pi * (frequency * band * arrival[..., None] + CARRIER * arrival[..., None]))
    heard = math.sqrt(gamma) * spectrum * shift + (noise[0] + 1j * noise[1]) / math.sqrt(2)
    output = heard * spectrum.conj() @ np.exp(2j * math.pi * frequency[:, None] * LAGS)
    energy = (np.abs(output) ** 2).sum(1)
    peak = energy[:, 1:-1].argmax(1) + 1
    at_peak = np.take_along_axis(output, peak[:, None, None], 2)[..., 0]
    difference = np.angle(at_peak[:, ::2] * at_peak[:, 1::2].conj())
    before, there, after = (np.take_along_axis(energy, (peak + step)[:, None], 1)[:, 0] for step in (-1, 0, 1))
    delay = (LAGS[peak] + 0.5 * (before - after) / (before - 2 * there + after) / FINE) / band
    if (chips == chips[0]).all():
        late = (at_peak * np.exp(2j * math.pi * CARRIER * arrival)).sum(1)
        delay = centre - np.angle(late) / (2 * math.pi * CARRIER)
    return difference, np.linalg.norm(OFFSET) + C * (delay - centre)


@pytest.mark.parametrize("gamma", [100.0, 1000.0])
@pytest.mark.parametrize("signal", ["code", "tone"])
def test_phases_and_fixes_scatter_as_the_energy_says(device, signal, gamma):
    """σ² = 1/γ of a phase difference, and the covariance of the fix, within the scatter of so many pulses."""
    chips, band = np.random.default_rng(1).choice([-1.0, 1.0], 80), 8000.0
    if signal == "tone":
        chips, band = np.ones(40), CARRIER
    length, S = len(chips) / band, float(np.linalg.norm(OFFSET))
    sonar = acoustic_link.Sonar(
        signal=signal,
        periods=40.0,
        pulse_length=length,
        bandwidth=band,
        spacing=SPACING,
        path="transponder",
        spreading=20.0,
        absorption=lambda f: 0.0,
        ambient_noise=lambda *_: 40.0,
        source_level=40.0 + 20 * math.log10(S) + 10 * math.log10(gamma / length),
    )
    link = torch.from_numpy(acoustic_link.link_table([CARRIER], sonar)).to(device)
    place = torch.tensor(OFFSET[None], dtype=torch.float32, device=device)
    none = place.new_zeros(1, 5)
    found, covariance, _ = usbl.fixes(link, none[:, 0].int(), place, none[:, :2].contiguous(), none)
    sigma, (xx, xy, yy) = found[0, 3].item(), covariance[0].tolist()
    assert sigma == pytest.approx(1 / math.sqrt(gamma), rel=1e-5)

    difference, slant_range = receive(chips, band, gamma)
    low, high = stats.chi2.interval(1 - 1e-5, PULSES - 1)
    for axis in range(2):
        assert low < (PULSES - 1) * difference[:, axis].var(ddof=1) / sigma**2 < high
    metres = link[0, acoustic_link.RANGE_PER_PHASE].item() / math.sqrt(8)  # four hydrophones, half a difference's noise
    assert low < (PULSES - 1) * slant_range.var(ddof=1) / (metres * sigma) ** 2 < high
    error = slant_range[:, None] * difference / link[0, acoustic_link.KAPPA].item() - OFFSET[:2]
    squares = np.einsum("ni,ij,nj->n", error, np.linalg.inv([[xx, xy], [xy, yy]]), error)
    assert squares.mean() == pytest.approx(2, abs=4.5 * math.sqrt(4 / PULSES))
