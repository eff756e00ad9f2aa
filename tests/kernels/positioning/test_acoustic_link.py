"""The link table and what follows from it, beside the sonar equation in decibels and the bounds of its docstring."""

import itertools
import math

import pytest
import taichi as ti
import torch

from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.positioning.acoustic_link import Accuracy, Sonar, link_table
from usvauv.kernels.positioning.sonar import vertical_bubble_loss
from usvauv.kernels.types import array2, vec3

CARRIERS = (15000.0, 18000.0)
COMMON = {
    "sound_speed": 1480.0,
    "source_level": 180.0,
    "target_strength": 5.0,
    "spreading": 17.0,
    "absorption": lambda f: 2e-4 * f,
    "ambient_noise": lambda f, shipping, wind: 1e-3 * f + 20.0 * shipping + wind,
    "shipping": 0.4,
    "wind": 9.0,
    "periods": 12.0,
    "pulse_length": 0.02,
    "bandwidth": 3000.0,
    "sampling_rate": 5e5,
    "spacing": 0.03,
    "own_noise": lambda f: 40.0 + 2e-3 * f,
    "array_depth": 0.5,
    "reference_range": 120.0,
    "accuracy": Accuracy(0.001, 0.002, 0.003, 0.004, 0.005),
}
CHOICES = {
    "path": ("echo", "transponder"),
    "noise_law": ("density", "demonstration"),
    "signal": ("tone", "code"),
    "planner_noise": ("range", "constant"),
}
PLACES = [(0.3, -0.2, -0.5), (60.0, -45.0, -110.0), (60.0, 45.0, 20.0), (400.0, 300.0, -0.5), (30.0, 40.0, 0.0)]
EFFORTS = (0.0, 0.6, 1.0)


@ti.kernel
def measure(link: array2, place: array2, found: array2):
    """Deviations of phase and range, threshold of the second AUV at places and efforts (n, 4)."""
    for n in range(place.shape[0]):
        offset = vec3(place[n, 0], place[n, 1], place[n, 2])
        noise = acoustic_link.noise_ratio(link[1, acoustic_link.OWN_NOISE], place[n, 3])
        found[n, 0] = acoustic_link.phase_deviation(link, 1, offset.norm(), offset[2], noise)
        found[n, 1] = acoustic_link.range_deviation(link, 1, found[n, 0])
        found[n, 2] = acoustic_link.detection_threshold(link, 1)


@pytest.mark.parametrize("chosen", list(itertools.product(*CHOICES.values())), ids="-".join)
def test_a_link_beside_the_sonar_equation(device, chosen):
    bubbles, data_ratio = "range" in chosen, 6.0 if "density" in chosen else 11.0
    s = Sonar(
        **COMMON, **dict(zip(CHOICES, chosen, strict=True)), bubbles=bubbles, data_ratio=data_ratio, unlocated=58.0
    )
    table = link_table(CARRIERS, s)
    assert table.shape == (2, acoustic_link.COLUMNS)
    assert (table != 0).all() or not bubbles  # no column is of nothing
    f, c = CARRIERS[1], s.sound_speed
    echo, code, density = s.path == "echo", s.signal == "code", s.noise_law == "density"
    length = s.pulse_length if code else s.periods / f
    sea, alpha = s.ambient_noise(f, s.shipping, s.wind), s.absorption(f)

    def variance(S, further):
        """Of a phase difference at a slant range (m)."""
        loss = s.spreading * math.log10(max(S, 1.0)) + alpha * max(S, 1.0) / 1000
        level = s.source_level - loss * (2 if echo else 1) - sea + (s.target_strength if echo else 0) - further
        if density:
            return 10 ** (-(level + 10 * math.log10(length)) / 10)
        return 4 / (length * s.sampling_rate) * 10 ** (-2 * (level - 10 * math.log10(s.bandwidth)) / 10)

    cases = [(*place, effort) for place in PLACES for effort in EFFORTS]
    found = torch.zeros((len(cases), 3), device=device)
    measure(torch.from_numpy(table).to(device), torch.tensor(cases, device=device), found)
    band = s.bandwidth / math.sqrt(12) if code else f
    least = max(8.0, 10 ** (s.data_ratio / 10)) if code else 0.5 * 25.0 * s.periods
    boat = 10 ** ((s.own_noise(f) - sea) / 10)
    up = vertical_bubble_loss(f, s.wind) * math.exp(-s.array_depth / (0.07 * s.wind)) if s.bubbles else 0.0
    for (x, y, z, effort), row in zip(cases, found.double().cpu().numpy(), strict=True):
        S = math.hypot(x, y, z)
        weakened = min(up * S / abs(z) if z else math.inf, 7.5) if up else 0.0
        further = weakened * (2 if echo else 1) + 10 * math.log10(1 + boat * effort**6)
        sigma = math.sqrt(variance(S, further))
        metres = c / (2 * math.pi * band) / math.sqrt(8) * sigma / (2 if echo else 1)
        assert row == pytest.approx([sigma, metres, math.sqrt(8 + 8 * least)], rel=2e-5, abs=2e-7)

    # The planner's information: κ²/(σ² S²), of a σ at this range or at the one of reference.
    kappa = 2 * math.pi * f * s.spacing / c
    for S in (20.0, 120.0, 700.0):
        supposed = variance(S if s.planner_noise == "range" else s.reference_range, 0.0)
        _, level, power, decay, reference = table[1, [0, *range(acoustic_link.LEVEL, acoustic_link.REFERENCE + 1)]]
        information = level - power * math.log(S**2 / reference**2) - decay * (S - reference)
        assert information == pytest.approx(math.log(kappa**2 / supposed / S**2), abs=1e-5)
    errors = table[1, [acoustic_link.ATTITUDE, acoustic_link.ALIGNMENT, acoustic_link.HEADING]]
    assert errors == pytest.approx([0.001**2, 0.002**2, 0.003**2])
    assert table[1, [acoustic_link.SOUND_SPEED, acoustic_link.POSITION]] == pytest.approx([0.004**2, 0.005**2])
    assert table[1, acoustic_link.KAPPA] == pytest.approx(kappa)


@pytest.mark.parametrize("efficiency", [way[0] for way in acoustic_link.WAYS])
def test_energy_of_a_bit_by_the_modems_law(efficiency):
    """A bit has it where the modem's law first allows the rate, in a band of 1 Hz."""
    snr = acoustic_link.bit_energy(efficiency) + 10 * math.log10(efficiency)
    assert acoustic_link.modem(1.0, math.inf, snr + 1e-3) >= efficiency > acoustic_link.modem(1.0, math.inf, snr - 1e-3)


def test_deviations_of_what_is_not_heard_are_numbers(device):
    """A kilometre's square times theirs is within single precision."""
    found = torch.zeros((1, 3), device=device)
    table = torch.from_numpy(link_table(CARRIERS, Sonar(noise_law="demonstration"))).to(device)
    measure(table, torch.tensor([[0.0, 0.0, -1e5, 0.0]], device=device), found)
    assert 1.0 < found[0, 0].item() < 1e6
