"""Figures of coded pulses for `docs/positioning.md`; `python -m benchmarks.usbl` prints them.

The pulse has L = 80 chips on a band of 8 kHz about 25 kHz, 10 ms, and a gate of 16 chips; hydrophones 20 mm apart.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from benchmarks.machine import batch, best_time
from usvauv.kernels import runtime
from usvauv.kernels.positioning import acoustic_link, coded_pulse, codes, waveform
from usvauv.kernels.positioning.reflections import SEDIMENTS

CARRIER = 25000.0
BANDWIDTH = 8000.0
CHIPS = 80
GATE = 16
SPACING = 0.02
SOUND_SPEED = 1500.0
OFFSET = (70.0, -45.0, -104.0)
ENERGIES = (300.0, 100.0, 30.0, 15.0, 10.0, 9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0)
DETECTION = 36.0  # energy over N0, four hydrophones together
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

    def __init__(self, count: int, offset: tuple[float, ...] = OFFSET, spread: float = 0.5) -> None:
        device = runtime.start().device
        self.code = codes.codes(1, CHIPS)
        self.pulse = self.tables(False)
        sonar = acoustic_link.Sonar(spacing=SPACING, sound_speed=SOUND_SPEED, path="transponder")
        link = torch.from_numpy(acoustic_link.link_table((CARRIER,), sonar)).to(device)
        stretch = 1 + spread * torch.linspace(-1, 1, count)[:, None] / math.hypot(*offset)
        place = (torch.tensor(offset) * stretch).to(device)
        level = torch.zeros((count, 2), device=device)
        self.geometry = link, torch.zeros(count, dtype=torch.int32, device=device), place, level
        self.count = count

    def tables(self, sampled: bool) -> coded_pulse.Pulses:
        device = runtime.start().device
        return coded_pulse.pulses(self.code, (CARRIER,), BANDWIDTH, GATE, device, sampled=sampled)

    def measure(self, gamma: float, seed: int, water: torch.Tensor | None = None) -> np.ndarray:
        energy = torch.full((self.count,), gamma, device=self.geometry[2].device)
        measured = coded_pulse.measurements(self.pulse, *self.geometry, energy, seed, water=water)
        return measured.double().cpu().numpy()


def measure_rates(seconds: float) -> dict[str, float]:
    """Pulses a second, with drawn outputs and with every sample drawn; complex numbers drawn for each hydrophone."""
    rates: dict[str, float] = {}
    for name, sampled, size in (("coded_pulse", False, 1 << 14), ("coded_pulse_sampled", True, 1 << 11)):
        case = Case(batch(size, size << 5))
        case.pulse = case.tables(sampled)
        energy = torch.full((case.count,), 100.0, device=case.geometry[2].device)
        work = (case.pulse, *case.geometry, energy, 1)
        rates[f"{name}_draws"] = case.pulse.noise.shape[2]
        rates[name] = case.count / best_time(lambda w=work: coded_pulse.measurements(*w), seconds)
    return rates


def measure_energies(count: int) -> list[dict[str, float]]:
    """From strong pulses to lost ones: rate of detection, variances of right peaks over their bounds, wrong peaks."""
    case = Case(count)
    kappa = 2 * math.pi * CARRIER * SPACING / SOUND_SPEED
    direction = np.array(OFFSET[:2]) / math.hypot(*OFFSET)
    level = codes.threshold(1e-4, GATE)
    rows = []
    for gamma in ENERGIES:
        measured = case.measure(gamma, 5)
        energy, wrong = measured[:, waveform.AMPLITUDE] ** 2 / 2, measured[:, waveform.SLIP] != 0
        phase = measured[~wrong, : waveform.PHASE_Y + 1] - kappa * direction
        phase = np.remainder(phase + np.pi, 2 * np.pi) - np.pi
        bound = SOUND_SPEED * math.sqrt(12) / (2 * math.pi * BANDWIDTH) / math.sqrt(8 * gamma)
        rows.append(
            {
                "energy_over_noise_db": 10 * math.log10(gamma),
                "detected": (energy >= DETECTION).mean(),
                "phase_variance_over_bound": (phase**2).mean() * gamma,
                "range_variance_over_bound": (measured[~wrong, waveform.RANGE_ERROR] ** 2).mean() / bound**2,
                "wrong_peak": wrong.mean(),
                "wrong_and_detected": (wrong & (energy >= DETECTION)).mean(),
                "wrong_and_above_false_alarm_threshold": (wrong & (energy >= level)).mean(),
            }
        )
    return rows


def thresholds() -> list[dict[str, float]]:
    """Energy over N0, four hydrophones together, that noise alone reaches with a given probability."""
    return [
        {"gate_chips": gate, **{f"{p:.0e}": codes.threshold(p, gate) for p in (1e-2, 1e-4, 1e-6, 1e-8)}}
        for gate in (4, 16, 64, 256)
    ]


def measure_codes() -> list[dict[str, float]]:
    """Correlations of eight codes over all lags, dB: largest and mean square between codes, largest sidelobe."""
    rows = []
    for chips in (20, 40, 80, 160, 320):
        family, record = codes.codes(8, chips), 2 * chips + 1
        cross = [codes.correlation(a, b, record) ** 2 for i, a in enumerate(family) for b in family[:i]]
        own = max(codes.sidelobe(family, []))
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
        case = Case(count, offset, 0.0)
        boundaries = (array_depth, FAR, roughness) if height == 0 else (0.0, height, 1e3)
        water = torch.tensor([(*boundaries, *SEDIMENTS["sand"])]).repeat(count, 1)
        plane = array_depth if height == 0 else -height
        length = math.hypot(offset[0], offset[1], 2 * plane - offset[2])
        turn = SOUND_SPEED / CARRIER / 2 * length / abs(2 * plane - offset[2])
        water[:, 0 if height == 0 else 1] += turns * turn * torch.linspace(-0.5, 0.5, count)
        water = water.to(case.geometry[2].device)
        columns = [waveform.PHASE_X, waveform.PHASE_Y, waveform.RANGE_ERROR]
        error = (case.measure(1e10, 1, water) - case.measure(1e12, 1))[:, columns]
        variance = coded_pulse.multipath_variances(case.pulse, *case.geometry, water).double().mean(0)
        rows.append(
            {
                "offset": offset,
                "array_depth": array_depth,
                "roughness": roughness,
                "array_height": height,
                "excess_chips": (length - math.hypot(*offset)) * BANDWIDTH / SOUND_SPEED,
                "closed_form": variance.sqrt().tolist(),
                "waveform": error.std(0).tolist(),
                "wrong_peak": (case.measure(100.0, 2, water)[:, waveform.SLIP] != 0).mean(),
            }
        )
    return rows


def measure(seconds: float, count: int) -> dict[str, object]:
    """All figures."""
    return {
        "pulses_per_second": measure_rates(seconds),
        "energies": measure_energies(count),
        "thresholds": thresholds(),
        "codes": measure_codes(),
        "tone_crosstalk_db": tone_crosstalk(),
        "reflections": measure_reflections(10_000),
    }


def show(result: dict) -> None:
    """Print what `measure` returns."""
    for name, rate in result["pulses_per_second"].items():
        print(f"{name}: {rate:,.0f}")
    print(
        "E/N0, detected, phase and range variance over their bounds; wrong peaks: all, detected, above 1e-4 threshold"
    )
    for row in result["energies"]:
        print(
            f"{row['energy_over_noise_db']:6.1f} dB {row['detected']:8.4f} {row['phase_variance_over_bound']:8.3f}"
            f" {row['range_variance_over_bound']:8.3f} {row['wrong_peak']:.1e} {row['wrong_and_detected']:.1e}"
            f" {row['wrong_and_above_false_alarm_threshold']:.1e}"
        )
    print("gate in chips, energy over N0 that noise reaches with a probability of")
    for row in result["thresholds"]:
        print(" ".join(f"{name}: {value:.1f}" for name, value in row.items()))
    print("chips, correlation between codes (peak, mean square), own sidelobe, dB")
    for row in result["codes"]:
        print(f"{row['chips']} {row['cross_peak_db']:.1f} {row['cross_mean_square_db']:.1f} {row['sidelobe_db']:.1f}")
    print(f"two tones of ten periods: {result['tone_crosstalk_db']:.1f} dB")
    print("AUV, array's depth, roughness, height over bottom, excess: closed form, waveform (rad, rad, m); wrong peaks")
    for row in result["reflections"]:
        print(
            f"{row['offset']} {row['array_depth']:g} {row['roughness']:g} {row['array_height']:g}"
            f" {row['excess_chips']:.2f} chips:"
            + "".join(f" {value:.2e}" for value in (*row["closed_form"], *row["waveform"]))
            + f" {row['wrong_peak']:.4f}"
        )
