"""Fixes a second: the statistical model, tones (two ways to draw their noise), and an lstsq per hydrophone in NumPy.

    python -m benchmarks.usbl --json

All compute the same, a fix with its flags from boat to AUV by an echo, 15 kHz, ten periods at 2.016 MHz. The rates of
`statistical_with_noise_drawn` and of both waveforms include their random numbers. `numpy_lstsq` is the demonstration's
method, one fix after the other: the tone and its noise on each hydrophone, `numpy.linalg.lstsq` for the phase, the fix.
Its tone begins where the receiver expects it, so there is no search for the delay. It runs on one thread, where it is
fastest. `threshold` and `agreement` are tables of `docs/positioning.md`, `coded_pulse` is of `benchmarks.coded_pulse`.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import torch

from benchmarks import coded_pulse
from benchmarks.machine import batch, best_time, describe, parse
from usvauv.kernels import runtime
from usvauv.kernels.positioning import acoustic_link, usbl, waveform
from usvauv.kernels.positioning.fix_probability import good_probability

CARRIER = 15000.0
SAMPLING_RATE = 2.016e6
SPACING = 0.033
SOUND_SPEED = 1500.0
OFFSET = (70.0, -45.0, -104.0)
THRESHOLD = math.sqrt(10 * acoustic_link.PERIOD_ENERGY)  # a at the threshold of detection
# Offset (m), E/N0 (dB), hydrophone spacing (m): usual, far to the side, at the threshold, near the horizon, wrapping.
AGREEMENT = (
    ((0.0, 0.0, -100.0), 46.6, 0.033),
    ((70.0, -45.0, -104.0), 43.3, 0.033),
    ((-130.0, 90.0, -98.0), 37.3, 0.033),
    ((70.0, -45.0, -104.0), 21.0, 0.033),
    ((80.0, 60.0, -9.0), 31.3, 0.033),
    ((83.2, 5.0, -55.2), 35.3, 0.06),
)
STRENGTHS = (300.0, 50.0, 20.0, THRESHOLD, 14.0, 12.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.3)


def places(count: int) -> tuple[torch.Tensor, ...]:
    """Arguments of a batch of fixes: link, row, offset (spread over a wavelength of range), slope."""
    device = runtime.start().device
    offset = torch.tensor(OFFSET) * (1 + torch.linspace(-0.05, 0.05, count)[:, None] / math.hypot(*OFFSET))
    link = torch.from_numpy(acoustic_link.link_table((CARRIER,), acoustic_link.Sonar(spacing=SPACING)))
    slope = 0.05 * torch.randn((count, 2), generator=torch.Generator().manual_seed(1))
    row = torch.zeros(count, dtype=torch.int32)
    return tuple(part.to(device) for part in (link, row, offset, slope))


def demonstration_fix(angle: np.ndarray, basis: np.ndarray, random: np.random.Generator, sigma_n: float) -> np.ndarray:
    """One fix by the demonstration's method in NumPy: carrier phase (N,) of the samples, its cos and sin (N, 2)."""
    S = math.hypot(*OFFSET)
    phase = []
    for axis in (0, 1):
        for side in (1, -1):
            lead = side * np.pi * CARRIER * SPACING / SOUND_SPEED * OFFSET[axis] / S
            y = np.sin(angle + lead) + sigma_n * random.standard_normal(angle.size)
            cosine, sine = np.linalg.lstsq(basis, y, rcond=None)[0]
            phase.append(math.atan2(cosine, sine))
    kappa = 2 * np.pi * CARRIER * SPACING / SOUND_SPEED
    x, y = S * (phase[0] - phase[1]) / kappa, S * (phase[2] - phase[3]) / kappa
    return np.array([x, y, -math.sqrt(S * S - x * x - y * y)])


def demonstration_rate(seconds: float) -> float:
    """Fixes a second of `demonstration_fix`."""
    runtime.start()  # for the clock
    random = np.random.default_rng(4)
    angle = 2 * np.pi * CARRIER / SAMPLING_RATE * np.arange(round(10 * SAMPLING_RATE / CARRIER))
    basis = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return 1 / best_time(lambda: demonstration_fix(angle, basis, random, 0.1), seconds)


def demonstration_rate_on_one_thread(seconds: float) -> float:
    """The same in a process of its own, because NumPy reads its number of threads once, when it is loaded."""
    os.environ.update({f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")})
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(demonstration_rate, seconds).result()


def measure_rates(seconds: float) -> dict[str, float]:
    """Fixes a second of every way, and ratios to NumPy's."""
    device = runtime.start().device
    rates = {}

    count = batch(1 << 20, 1 << 24)
    case = places(count)
    generator = torch.Generator(device).manual_seed(2)
    noise = torch.randn((count, 6), generator=generator, device=device)
    rates["statistical"] = count / best_time(lambda: usbl.flagged_fixes(*case, noise), seconds)

    def draw_and_fix() -> None:
        usbl.flagged_fixes(*case, torch.randn((count, 6), generator=generator, device=device))

    rates["statistical_with_noise_drawn"] = count / best_time(draw_and_fix, seconds)

    for name, sampled, size in (("waveform", False, 1 << 17), ("waveform_sampled", True, 1 << 13)):
        count = batch(size, size << 5)
        case = places(count)
        rates[name] = count / best_time(lambda c=case, s=sampled: waveform.fixes(*c, 3, sampled=s), seconds)

    rates["numpy_lstsq"] = demonstration_rate_on_one_thread(seconds)
    return rates


def measure_threshold(count: int) -> list[dict[str, float]]:
    """For tones from strong to lost: rate of detection, variances over their bounds, rate of wrong periods."""
    link, row, offset, _ = places(count)
    level = torch.zeros((count, 2), device=offset.device)
    S = math.hypot(*OFFSET)
    loss = link[0, acoustic_link.PATHS].item() * (
        15 * math.log10(S) + link[0, acoustic_link.ABSORPTION].item() * S / 1000
    )
    kappa = 2 * math.pi * CARRIER * SPACING / SOUND_SPEED
    rows = []
    for a in STRENGTHS:
        energy = 10 * math.log10(a * a / 2)
        link[0, acoustic_link.RATIO_AT_1M] = energy + loss
        _, flags, measured = waveform.fixes(link, row, offset, level, 5)
        measured = measured.double()
        error = measured[:, : waveform.PHASE_Y + 1] - kappa / S * torch.tensor(OFFSET[:2], device=offset.device)
        error = torch.remainder(error + math.pi, 2 * math.pi) - math.pi
        range_bound = SOUND_SPEED / (2 * math.pi * CARRIER) / 2 / (2 * a)
        rows.append(
            {
                "energy_over_noise_density_db": energy,
                "detected": (flags & usbl.DETECTED > 0).double().mean().item(),
                "phase_variance_over_bound": error.square().mean().item() * a * a / 2,
                "range_variance_over_bound": measured[:, waveform.RANGE_ERROR].square().mean().item() / range_bound**2,
                "wrong_period": (measured[:, waveform.SLIP] != 0).double().mean().item(),
            }
        )
    return rows


def measure_agreement(count: int) -> list[dict[str, object]]:
    """Sampled tones and the statistical model: rate of good fixes, and their root mean square errors (m)."""
    device = runtime.start().device
    row = torch.zeros(count, dtype=torch.int32, device=device)
    level = torch.zeros((count, 2), device=device)
    noise = torch.randn((count, 6), generator=torch.Generator().manual_seed(6)).to(device)
    rows = []
    for place, energy, spacing in AGREEMENT:
        S = math.hypot(*place)
        offset = torch.tensor(place, device=device) * (1 + torch.linspace(-0.05, 0.05, count)[:, None].to(device) / S)
        link = torch.from_numpy(acoustic_link.link_table((CARRIER,), acoustic_link.Sonar(spacing=spacing))).to(device)
        loss = link[0, acoustic_link.PATHS] * (15 * math.log10(S) + link[0, acoustic_link.ABSORPTION] * S / 1000)
        link[0, acoustic_link.RATIO_AT_1M] = energy + loss
        tones, tone_flags, _ = waveform.fixes(link, row, offset, level, 7, sampled=True)
        drawn, _, drawn_flags = usbl.flagged_fixes(link, row, offset, level, noise)
        detected, usable = good_probability(link, row[:1], offset[:1], level[:1])
        result: dict[str, object] = {"offset": place, "energy_over_noise_density_db": energy, "spacing": spacing}
        result["good_predicted"] = (detected * usable).item()
        for name, estimate, flags in (("waveform", tones, tone_flags), ("statistical", drawn, drawn_flags)):
            good = flags == usbl.DETECTED
            error = (estimate[:, :3] - offset)[good].double()
            result[f"good_{name}"] = good.double().mean().item()
            result[f"rms_{name}"] = error.square().mean(0).sqrt().tolist()
        rows.append(result)
    return rows


def measure(seconds: float, count: int) -> dict[str, object]:
    """All figures."""
    rates = measure_rates(seconds)
    return {
        "machine": describe(),
        "fixes_per_second": rates,
        "over_numpy": {name: rates[name] / rates["numpy_lstsq"] for name in ("waveform", "waveform_sampled")},
        "threshold": measure_threshold(count),
        "agreement": measure_agreement(10_000),
        "coded_pulse": coded_pulse.measure(seconds, count // 4),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=2.0, help="time spent on each rate, s")
    parser.add_argument("--count", type=int, default=400_000, help="fixes at each strength of the tone")
    arguments = parse(parser)
    result = measure(arguments.seconds, arguments.count)
    if arguments.json:
        print(json.dumps(result, indent=1))
        return
    print(result["machine"])
    for name, rate in result["fixes_per_second"].items():
        ratio = f", {result['over_numpy'][name]:,.1f} × NumPy" if name in result["over_numpy"] else ""
        print(f"{name}: {rate:,.0f} fixes/s{ratio}")
    print("E/N0, detected, phase and range variance over their bounds, wrong periods")
    for row in result["threshold"]:
        print(
            f"{row['energy_over_noise_density_db']:6.1f} dB {row['detected']:8.4f}"
            f" {row['phase_variance_over_bound']:8.3f} {row['range_variance_over_bound']:9.2f}"
            f" {row['wrong_period']:.1e}"
        )
    print("offset, E/N0, spacing: good fixes predicted, by tones, statistical; errors in x, y, z by tones, statistical")
    for row in result["agreement"]:
        print(
            f"{row['offset']} {row['energy_over_noise_density_db']:.1f} dB {row['spacing']:g} m:"
            f" {row['good_predicted']:.4f} {row['good_waveform']:.4f} {row['good_statistical']:.4f};"
            + "".join(f" {error:.4f}" for error in (*row["rms_waveform"], *row["rms_statistical"]))
        )
    coded_pulse.show(result["coded_pulse"])


if __name__ == "__main__":
    main()
