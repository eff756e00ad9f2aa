"""Sonar equation: the classical fits, both data-rate laws, and one law for kernels and host."""

import math

import pytest
import taichi as ti
import torch

from usvauv.kernels.positioning import sonar
from usvauv.kernels.positioning.sonar import coates, thorp

LAWS = {
    "thorp": (thorp, (15000.0,)),
    "path_loss": (sonar.path_loss, (250.0, 20.0, 4.3)),
    "transmission_loss": (sonar.transmission_loss, (250.0, 15000.0)),
    "coates": (coates, (15000.0, 0.5, 4.0)),
    "noise_level": (sonar.noise_level, (26.0, 1000.0)),
    "one_way_snr": (sonar.one_way_snr, (135.0, 56.0, 120.0, 18000.0)),
    "echo_snr": (sonar.echo_snr, (135.0, 3.0, 56.0, 120.0, 18000.0)),
    "acoustic_source_level": (sonar.acoustic_source_level, (0.03,)),
    "shannon_rate": (sonar.shannon_rate, (1e4, 60.0, 0)),
    "demonstration_rate": (sonar.shannon_rate, (1e4, 60.0, 1)),
}


@pytest.mark.parametrize(("law", "arguments"), LAWS.values(), ids=LAWS)
def test_kernel_and_host_agree(device, law, arguments):
    out = torch.empty(1, dtype=torch.float32, device=device)

    @ti.kernel
    def evaluate(out: ti.types.ndarray(dtype=ti.f32, ndim=1)):
        for i in range(1):
            out[i] = law(*arguments)

    evaluate(out)
    assert out.item() == pytest.approx(law(*arguments), rel=3e-6)


class TestFits:
    def test_loss_doubles_the_range(self):
        doubled = sonar.transmission_loss(200.0, 1e4) - sonar.transmission_loss(100.0, 1e4)
        assert doubled == pytest.approx(15 * math.log10(2) + 0.1 * thorp(1e4))

    @pytest.mark.parametrize("spreading", [10.0, 15.0, 20.0])
    def test_path_loss(self, spreading):
        """Spreading over three decades, and 4 dB/km over one kilometre."""
        assert sonar.path_loss(1000.0, spreading, 4.0) == pytest.approx(3 * spreading + 4)
        for r in (0.0, 0.4, 1.0):  # no nearer than 1 m
            assert sonar.path_loss(r, spreading, 4.0) == pytest.approx(0.004)
        assert sonar.path_loss(1.2, spreading, 0.0) == pytest.approx(spreading * math.log10(1.2))

    def test_loss_begins_at_one_metre(self):
        assert sonar.transmission_loss(0.0, 1e4) == sonar.transmission_loss(1.0, 1e4)

    @pytest.mark.parametrize(
        ("f", "shipping", "wind", "density"),
        [
            (2.0, 0.0, 0.0, 97.97),  # turbulence alone
            (100.0, 1.0, 0.0, 77.18),  # shipping 77.2, turbulence 47.0
            (15000.0, 0.5, 0.0, 26.11),  # wind term at no wind 26.03, thermal 8.5
            (15000.0, 0.5, 10.0, 49.75),  # 7.5 √10 = 23.7 dB more wind
            (1e6, 0.5, 0.0, 45.00),  # thermal
        ],
    )
    def test_noise_regimes(self, f, shipping, wind, density):
        assert coates(f, shipping, wind) == pytest.approx(density, abs=0.05)

    def test_noise_in_a_band(self):
        density = coates(15000.0, 0.5, 0.0)
        assert sonar.noise_level(density, 1000.0) == pytest.approx(density + 30)

    def test_echo_travels_twice(self):
        one_way = sonar.one_way_snr(135.0, 56.0, 100.0, 15000.0)
        echo = sonar.echo_snr(135.0, 3.0, 56.0, 100.0, 15000.0)
        assert one_way - echo == pytest.approx(sonar.transmission_loss(100.0, 15000.0) - 3)

    def test_positioning_link_of_table_1(self):
        """135 dB, 15 kHz, 1 kHz band, no wind, 100 m: 21.4 dB of echo."""
        noise = sonar.noise_level(coates(15000.0, 0.5, 0.0), 1000.0)
        assert sonar.echo_snr(135.0, 3.0, noise, 100.0, 15000.0) == pytest.approx(21.4, abs=0.05)


class TestRate:
    def test_shannon(self):
        assert sonar.shannon_rate(1000.0, 0.0, 0) == pytest.approx(1000.0)
        assert sonar.shannon_rate(1000.0, 10.0, 0) == pytest.approx(1000 * math.log2(11))
        assert sonar.shannon_rate(1000.0, -30.0, 0) == pytest.approx(1000 * math.log2(1.001))

    def test_demonstration_takes_decibels_for_bels(self):
        assert sonar.shannon_rate(1000.0, 1.0, 1) == pytest.approx(1000 * math.log2(11))
        ratio = sonar.shannon_rate(1e4, 70.0, 1) / sonar.shannon_rate(1e4, 70.0, 0)
        assert ratio == pytest.approx(10, rel=1e-3)

    def test_node_link_at_100_m(self):
        """A 30 mW node at 20 kHz in a 10 kHz band has 61 dB over 100 m and carries 0.2 Mbit/s."""
        noise = sonar.noise_level(coates(20000.0, 0.5, 0.0), 10000.0)
        snr = sonar.one_way_snr(sonar.acoustic_source_level(0.03), noise, 100.0, 20000.0)
        assert snr == pytest.approx(155.54 - 30.41 - (23.88 + 40), abs=0.05)
        assert sonar.shannon_rate(10000.0, snr, 0) == pytest.approx(0.2035e6, rel=1e-3)
