"""Fixes a second: the statistical model, sampled pulses, and an lstsq per hydrophone in NumPy.

    python -m benchmarks.usbl --json

All fixes are of a tone of ten periods at 15 kHz. The rate of `statistical_with_noise_drawn` and those of `pulse`
include their random numbers. `numpy_lstsq` is the demonstration's method, one fix after the other: the tone and its
noise on each hydrophone at 2.016 MHz, `numpy.linalg.lstsq` for the phase, the fix. Its tone begins where the receiver
expects it, so there is no search for the delay. It runs on one thread, where it is fastest. `agreement` is a table of
`docs/positioning.md`, `pulse` is of `benchmarks.pulse`.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import torch

from benchmarks import pulse as pulses
from benchmarks.machine import batch, best_time, command_line, describe, parse, show
from usvauv.env.accuracy.fix_errors import reception
from usvauv.kernels import runtime
from usvauv.kernels.positioning import acoustic_link, matched_filter, pulse, usbl

CARRIER = 15000.0
SAMPLING_RATE = 2.016e6
SPACING = 0.033
SOUND_SPEED = 1500.0
OFFSET = (70.0, -45.0, -104.0)
# Offset (m), E/N0 (dB), hydrophone spacing (m): usual, far to the side, at the threshold, near the horizon, wrapping.
AGREEMENT = (
    ((0.0, 0.0, -100.0), 46.6, 0.033),
    ((70.0, -45.0, -104.0), 43.3, 0.033),
    ((-130.0, 90.0, -98.0), 37.3, 0.033),
    ((70.0, -45.0, -104.0), 21.0, 0.033),
    ((80.0, 60.0, -9.0), 31.3, 0.033),
    ((83.2, 5.0, -55.2), 35.3, 0.06),
)


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
    rates["statistical"] = count / best_time(lambda: usbl.fixes(*case, noise), seconds)

    def draw_and_fix() -> None:
        usbl.fixes(*case, torch.randn((count, 6), generator=generator, device=device))

    rates["statistical_with_noise_drawn"] = count / best_time(draw_and_fix, seconds)

    rates["numpy_lstsq"] = demonstration_rate_on_one_thread(seconds)
    return rates


def pulse_fixes(
    link: torch.Tensor, row: torch.Tensor, offset: torch.Tensor, level: torch.Tensor, energy: torch.Tensor, seed: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Estimated offsets (n, 3) of sampled tones received by a level array, and whether they are good.

    Arguments as for `matched_filter.measurements`.
    """
    tables = pulse.tones(1, 10, offset.device)
    measured = matched_filter.measurements(tables, link, row, offset, level, energy, seed).double()
    kappa, S = link[0, acoustic_link.KAPPA].double(), offset.double().norm(dim=1)
    phase = measured[:, : matched_filter.PHASE_Y + 1]
    wrapped = ((phase - kappa * offset[:, :2] / S[:, None]).abs() > math.pi).any(1)
    up = 1 - (phase / kappa).square().sum(1)
    direction = torch.cat([phase / kappa, -up.clamp(min=0).sqrt()[:, None]], 1)
    detected = measured[:, matched_filter.AMPLITUDE].square() >= link[0, acoustic_link.THRESHOLD]
    ambiguous = measured[:, matched_filter.RESIDUAL].abs() > math.pi / 2
    good = detected & (up > 0) & ~wrapped & ~ambiguous
    return (S + measured[:, matched_filter.RANGE_ERROR])[:, None] * direction, good


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
        drawn, _, flags = usbl.fixes(link, row, offset, level, noise)
        sampled, good_samples = pulse_fixes(link, row, offset, level, drawn[:, 3] ** -2, 7)
        detected, usable = reception(link, row[:1], offset[:1], level[:1])[2:]
        result: dict[str, object] = {"offset": place, "energy_over_noise_density_db": energy, "spacing": spacing}
        result["good_predicted"] = (detected * usable).item()
        models = ("waveform", sampled, good_samples), ("statistical", drawn, flags == usbl.DETECTED)
        for name, estimate, good in models:
            error = (estimate[:, :3] - offset)[good].double()
            result[f"good_{name}"] = good.double().mean().item()
            result[f"rms_{name}"] = error.square().mean(0).sqrt().tolist()
        rows.append(result)
    return rows


def measure(seconds: float, count: int) -> dict[str, object]:
    """All figures."""
    return {
        "machine": describe(),
        "fixes_per_second": measure_rates(seconds),
        "agreement": measure_agreement(10_000),
        "pulse": pulses.measure(seconds, count),
    }


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--seconds", type=float, default=2.0, help="time spent on each rate, s")
    parser.add_argument("--count", type=int, default=100_000, help="pulses at each energy")
    arguments = parse(parser)
    show(measure(arguments.seconds, arguments.count), arguments.json)


if __name__ == "__main__":
    main()
