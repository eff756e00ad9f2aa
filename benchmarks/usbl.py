"""Fixes a second: the statistical model, and an lstsq per hydrophone in NumPy.

    python -m benchmarks.usbl --json

All fixes are of a tone of ten periods at 15 kHz. The rate of `statistical_with_noise_drawn` includes its random
numbers. `numpy_lstsq` is the demonstration's method, one fix after the other: the tone and its
noise on each hydrophone at 2.016 MHz, `numpy.linalg.lstsq` for the phase, the fix. Its tone begins where the receiver
expects it, so there is no search for the delay. It runs on one thread, where it is fastest.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import torch

from benchmarks.machine import batch, best_time, command_line, describe, parse, show
from usvauv.kernels import runtime
from usvauv.kernels.positioning import acoustic_link, usbl

CARRIER = 15000.0
SAMPLING_RATE = 2.016e6
SPACING = 0.033
SOUND_SPEED = 1500.0
OFFSET = (70.0, -45.0, -104.0)


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


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--seconds", type=float, default=2.0, help="time spent on each rate, s")
    arguments = parse(parser)
    show({"machine": describe(), "fixes_per_second": measure_rates(arguments.seconds)}, arguments.json)


if __name__ == "__main__":
    main()
