"""Figures of sampled pulses for `docs/positioning.md`; `python -m benchmarks.usbl` prints them.

The code has L = 80 chips on a band of 8 kHz about 25 kHz, 10 ms, and a gate of 16 chips; hydrophones 20 mm apart. The
tone has ten periods at 15 kHz; hydrophones 33 mm apart.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from benchmarks.machine import batch, best_time
from usvauv.kernels import runtime
from usvauv.kernels.positioning import acoustic_link, matched_filter, pulse, reflections
from usvauv.kernels.positioning.reflections import SEDIMENTS

CARRIER, TONE = 25000.0, 15000.0
BANDWIDTH = 8000.0
CHIPS, PERIODS = 80, 10
GATE = 16
SPACING, TONE_SPACING = 0.02, 0.033
SOUND_SPEED = 1500.0
OFFSET = (70.0, -45.0, -104.0)
ENERGIES = {
    "code": (300.0, 100.0, 30.0, 15.0, 10.0, 8.0, 7.0, 5.0, 3.0, 1.0),
    "tone": (45000.0, 1250.0, 200.0, 125.0, 98.0, 50.0, 32.0, 18.0, 4.5, 0.045),
}
DETECTION = {"code": 36.0, "tone": 504.0}  # energy over N0, four hydrophones together
# AUV (m), array's depth (m), standard deviation of the surface (m), array's height over the bottom (m; 0: far), and
# the turns of the reflection's phase by which the boundary is moved.
WATERS = (
    ((70.0, -45.0, -104.0), 3.0, 0.002, 0.0, 60),
    ((70.0, -45.0, -104.0), 3.0, 0.01, 0.0, 60),
    ((70.0, -45.0, -104.0), 0.0, 0.0, 107.0, 60),
    ((390.0, -100.0, -20.0), 3.0, 0.01, 0.0, 4),
    ((390.0, -100.0, -20.0), 3.0, 0.1, 0.0, 4),
    ((390.0, -100.0, -20.0), 0.5, 0.2, 0.0, 1),
)
FAR = 1e5  # m, a bottom that is not heard


class Case:
    """Pulses of one AUV at one place, or spread over `spread` m of range to either side."""

    def __init__(self, signal: str, count: int, offset: tuple[float, ...] = OFFSET, spread: float = 0.5) -> None:
        device = runtime.start().device
        coded = signal == "code"
        self.carrier, spacing = (CARRIER, SPACING) if coded else (TONE, TONE_SPACING)
        self.frequency = BANDWIDTH / math.sqrt(12) if coded else TONE  # rms, of the delay
        self.tables = pulse.tones(1, PERIODS, device)
        if coded:
            self.tables = pulse.pulses(pulse.codes(1, CHIPS), (CARRIER,), BANDWIDTH, GATE, device)
        sonar = acoustic_link.Sonar(spacing=spacing, sound_speed=SOUND_SPEED, path="transponder")
        link = torch.from_numpy(acoustic_link.link_table((self.carrier,), sonar)).to(device)
        stretch = 1 + spread * torch.linspace(-1, 1, count)[:, None] / math.hypot(*offset)
        place = (torch.tensor(offset) * stretch).to(device)
        level = torch.zeros((count, 2), device=device)
        self.geometry = link, torch.zeros(count, dtype=torch.int32, device=device), place, level
        self.count, self.kappa = count, 2 * math.pi * self.carrier * spacing / SOUND_SPEED

    def measure(self, gamma: float, seed: int, water: torch.Tensor | None = None) -> np.ndarray:
        energy = torch.full((self.count,), gamma, device=self.geometry[2].device)
        measured = matched_filter.measurements(self.tables, *self.geometry, energy, seed, water=water)
        return measured.double().cpu().numpy()


def measure_rates(seconds: float) -> dict[str, float]:
    """Pulses a second of both signals."""
    rates: dict[str, float] = {}
    for signal in ("code", "tone"):
        case = Case(signal, batch(1 << 14, 1 << 19))
        energy = torch.full((case.count,), 100.0, device=case.geometry[2].device)
        work = (case.tables, *case.geometry, energy, 1)
        rates[signal] = case.count / best_time(lambda w=work: matched_filter.measurements(*w), seconds)
    return rates


def measure_energies(signal: str, count: int) -> list[dict[str, float]]:
    """From strong pulses to lost ones: rate of detection, variances over their bounds, wrong peaks.

    The variances are of pulses without a wrong peak.
    """
    case = Case(signal, count)
    direction = np.array(OFFSET[:2]) / math.hypot(*OFFSET)
    rows = []
    for gamma in ENERGIES[signal]:
        measured = case.measure(gamma, 5)
        energy, wrong = measured[:, matched_filter.AMPLITUDE] ** 2 / 2, measured[:, matched_filter.SLIP] != 0
        phase = measured[~wrong, : matched_filter.PHASE_Y + 1] - case.kappa * direction
        phase = np.remainder(phase + np.pi, 2 * np.pi) - np.pi
        bound = SOUND_SPEED / (2 * math.pi * case.frequency) / math.sqrt(8 * gamma)
        detected = energy >= DETECTION[signal]
        rows.append(
            {
                "energy_over_noise_db": 10 * math.log10(gamma),
                "detected": detected.mean(),
                "phase_variance_over_bound": (phase**2).mean() * gamma,
                "range_variance_over_bound": (measured[~wrong, matched_filter.RANGE_ERROR] ** 2).mean() / bound**2,
                "wrong_peak": wrong.mean(),
                "wrong_and_detected": (wrong & detected).mean(),
                "wrong_and_above_false_alarm_threshold": (wrong & (energy >= threshold(1e-4, GATE))).mean(),
            }
        )
    return rows


def false_alarm(energy: float, gate: float) -> float:
    """Probability that the noise of four hydrophones reaches an energy within a gate of lags.

    The energy is χ² of 8 degrees of freedom at the gate's begin. Its root crosses a level upwards at the rate of its
    density there times β/√2π, β = 2πB/√12 (Rice, Bell Syst. Tech. J. 24 (1945) 46,
    doi 10.1002/j.1538-7305.1945.tb00453.x); crossings so rare are independent.

    Args:
        energy: sum over the hydrophones of |correlator output|², over N0.
        gate: length of the gate in chips, 1/B.
    """
    at_once = math.exp(-energy) * sum(energy**k / math.factorial(k) for k in range(4))
    crossings = gate * math.sqrt(math.pi / 3) * energy**3.5 * math.exp(-energy) / 6
    return 1 - (1 - at_once) * math.exp(-crossings)


def threshold(probability: float, gate: float) -> float:
    """Energy over N0, summed over four hydrophones, that noise in a gate reaches with a probability of at most 0.1."""
    low, high = 4.0, 400.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if false_alarm(middle, gate) > probability else (low, middle)
    return high


def thresholds() -> list[dict[str, float]]:
    """Energy over N0, four hydrophones together, that noise alone reaches with a given probability."""
    return [
        {"gate_chips": gate, **{f"{p:.0e}": threshold(p, gate) for p in (1e-2, 1e-4, 1e-6, 1e-8)}}
        for gate in (4, 16, 64, 256)
    ]


def measure_codes() -> list[dict[str, float]]:
    """Correlations of eight codes over all lags, dB: largest and mean square between codes, largest sidelobe."""
    rows = []
    for chips in (20, 40, 80, 160, 320):
        family, record = pulse.codes(8, chips), 2 * chips + 1
        cross = [pulse.correlation(a, b, record) ** 2 for i, a in enumerate(family) for b in family[:i]]
        own = max(pulse.sidelobe(family, []))
        rows.append(
            {
                "chips": chips,
                "cross_peak_db": 10 * math.log10(np.max(cross)),
                "cross_mean_square_db": 10 * math.log10(np.mean(cross)),
                "sidelobe_db": 20 * math.log10(own),
            }
        )
    return rows


def tone_crosstalk() -> float:
    """Largest correlation of ten periods at 15 kHz with as long a tone 0.86 kHz beside it, over all lags, dB."""
    t = np.arange(0, 10 / 15000, 1e-6)
    one, other = (np.exp(2j * np.pi * f * t) for f in (0.0, 860.0))
    return 20 * math.log10(np.abs(np.correlate(one, other, "full")).max() / t.size)


def measure_reflections(count: int) -> list[dict[str, object]]:
    """Standard deviations by one reflection, over whole turns of its phase: closed form and waveform without noise.

    `wrong_peak` is the rate at which the receiver takes another peak at γ = 100.
    """
    rows = []
    for offset, array_depth, roughness, height, turns in WATERS:
        case = Case("code", count, offset, 0.0)
        boundaries = (array_depth, FAR, roughness) if height == 0 else (0.0, height, 1e3)
        water = torch.tensor([(*boundaries, *SEDIMENTS["sand"])]).repeat(count, 1)
        plane = array_depth if height == 0 else -height
        length = math.hypot(offset[0], offset[1], 2 * plane - offset[2])
        turn = SOUND_SPEED / CARRIER / 2 * length / abs(2 * plane - offset[2])
        water[:, 0 if height == 0 else 1] += turns * turn * torch.linspace(-0.5, 0.5, count)
        water = water.to(case.geometry[2].device)
        columns = [matched_filter.PHASE_X, matched_filter.PHASE_Y, matched_filter.RANGE_ERROR]
        error = (case.measure(1e10, 1, water) - case.measure(1e12, 1))[:, columns]
        variance = reflections.multipath_variances(case.tables, *case.geometry, water).double().mean(0)
        rows.append(
            {
                "offset": offset,
                "array_depth": array_depth,
                "roughness": roughness,
                "array_height": height,
                "excess_chips": (length - math.hypot(*offset)) * BANDWIDTH / SOUND_SPEED,
                "closed_form": variance.sqrt().tolist(),
                "waveform": error.std(0).tolist(),
                "wrong_peak": (case.measure(100.0, 2, water)[:, matched_filter.SLIP] != 0).mean(),
            }
        )
    return rows


def measure(seconds: float, count: int) -> dict[str, object]:
    """All figures."""
    return {
        "pulses_per_second": measure_rates(seconds),
        "energies": {signal: measure_energies(signal, count) for signal in ENERGIES},
        "thresholds": thresholds(),
        "codes": measure_codes(),
        "tone_crosstalk_db": tone_crosstalk(),
        "reflections": measure_reflections(10_000),
    }
