"""Noise of sea, rain and boat against published tables and rules, limits and monotony."""

import math

import numpy as np
import pytest

from usvauv.kernels.positioning.sonar import ambient_noise_laws, boat_noise, coates, rain_noise, total_level

KNOT = 1852 / 3600  # m/s

# Wind noise of sea states: Sadowski, Katz and McFadden, "Ambient noise standards for acoustic modeling and analysis",
# NUSC Technical Document 7265 (1984), also in Hodges (below); their winds in knots: Urick, "Ambient Noise in the Sea"
# (1984), table 1-1.
STANDARD_FREQUENCIES = (1e3, 5e3, 1e4, 2.5e4, 5e4)
STANDARD = {
    (4, 6): (52.9, 42.0, 36.5, 29.3, 23.8),  # sea state 1
    (7, 10): (58.8, 48.3, 42.8, 35.6, 30.1),
    (11, 16): (62.4, 52.1, 46.6, 39.4, 33.9),
    (17, 21): (64.7, 54.4, 48.9, 41.7, 36.6),
    (22, 27): (66.7, 56.4, 50.9, 43.7, 38.2),
    (28, 33): (69.4, 59.0, 53.5, 46.3, 40.8),  # sea state 6
}
# Hildebrand et al., "An empirical model for wind-generated ocean noise", J. Acoust. Soc. Am. 149 (2021) 4516, doi
# 10.1121/10.0005430, near the surface, worked out by hand from their coefficients: m/s, Hz, dB.
HILDEBRAND = [
    (2.5, 1e4, 44.3),  # 49.8 + 20 log10 2.5 − 13.5
    (4.5, 1e4, 48.4),  # 48.8 + 20 log10 4.5 − 13.5
    (9.4, 1e4, 53.8),  # 48.3 + 20 log10 9.4 − 14
    (9.4, 2.5e4, 48.2),  # 48.3 + 20 log10 9.4 − 14 log10 25
    (12.3, 5e3, 60.1),  # 48.4 + 20 log10 12.3 − 14.5 log10 5
]

# Hodges, "Underwater Acoustics" (2010), chapter 7: rain of 1, 5, 10 and 100 mm/h, kHz.
HODGES = {
    1.0: (52.9, 62.6, 66.0, 75.4),
    3.0: (50.8, 60.8, 64.2, 73.6),
    8.0: (47.2, 57.2, 60.6, 70.0),
    10.0: (46.3, 56.3, 59.7, 69.1),
    20.0: (43.2, 53.2, 56.6, 66.0),
    50.2: (38.0, 48.4, 51.6, 61.2),
    100.0: (34.1, 44.8, 47.9, 57.6),
}


class TestWind:
    @pytest.mark.parametrize("knots", [5, 10, 20])
    @pytest.mark.parametrize("f", [500.0, 1000.0, 2000.0, 5000.0])
    def test_rule_of_fives(self, f, knots):
        """Wenz (1962), doi 10.1121/1.1909155, in shallow water; in deep water 5 dB less.

        56 dB at 1 kHz and 5 knots, 5 dB less an octave, 5 dB more a doubling of the wind.
        """
        rule = 56 - 5 * math.log2(f / 1000) + 5 * math.log2(knots / 5)
        assert coates(f, 0.0, knots * KNOT) == pytest.approx(rule, abs=4.5)

    def test_standard_sea_states(self):
        """Coates is louder than the standard by 1 to 6 dB, as Wenz's shallow water is louder than his deep water."""
        excess = [
            coates(f, 0.0, sum(knots) / 2 * KNOT) - level
            for knots, levels in STANDARD.items()
            for f, level in zip(STANDARD_FREQUENCIES, levels, strict=True)
        ]
        assert min(excess) > 1
        assert max(excess) < 6
        assert np.mean(excess) == pytest.approx(4, abs=1)

    @pytest.mark.parametrize("wind", [5.0, 10.0, 15.0])
    def test_wind_from_noise(self, wind):
        """Vagle et al. (1990), J. Atmos. Ocean. Technol. 7, 576: U = (10^(L/20) + 104.5)/53.91, L at 8 kHz."""
        assert coates(8000.0, 0.0, wind) == pytest.approx(20 * math.log10(53.91 * wind - 104.5), abs=4)

    @pytest.mark.parametrize(("wind", "f", "level"), HILDEBRAND)
    def test_hildebrand(self, wind, f, level):
        assert coates(f, 0.0, wind) == pytest.approx(level, abs=4)

    @pytest.mark.parametrize("kilohertz", [200.0, 1000.0])
    def test_thermal_limit(self, kilohertz):
        """Mellen (1952), doi 10.1121/1.1906924: −15 + 20 log10 of kHz."""
        assert coates(1000 * kilohertz, 0.0, 0.0) == pytest.approx(-15 + 20 * math.log10(kilohertz), abs=0.3)


class TestRain:
    @pytest.mark.parametrize(("kilohertz", "levels"), HODGES.items())
    def test_table(self, kilohertz, levels):
        fit = [rain_noise(1000 * kilohertz, rate) for rate in (1.0, 5.0, 10.0, 100.0)]
        assert fit == pytest.approx(levels, abs=1.0)
        assert fit[0] == pytest.approx(levels[0], abs=0.3)

    @pytest.mark.parametrize("rate", [2.0, 10.0, 50.0, 100.0, 200.0])
    def test_rain_gauge(self, rate):
        """Ma and Nystuen (2005), doi 10.1175/JTECH1773.1: log10 of the rate = (L − 42.4)/15.4 at 5 kHz."""
        assert rain_noise(5000.0, rate) == pytest.approx(42.4 + 15.4 * math.log10(rate), abs=6.5)

    def test_louder_in_more_rain_and_quieter_at_higher_frequency(self):
        rates, frequencies = np.geomspace(1e-3, 500.0, 100), np.geomspace(1e3, 1e5, 100)
        assert np.all(np.diff([rain_noise(2e4, rate) for rate in rates]) > 0)
        assert np.all(np.diff([rain_noise(f, 10.0) for f in frequencies]) < 0)

    def test_no_rain(self):
        assert rain_noise(2e4, 0.0) == -math.inf
        assert rain_noise(2e4, 1e-9) < -200


class TestBoat:
    def test_reference(self):
        assert boat_noise(25e3, 5.0, 68.0, 25e3, 5.0) == 68.0

    def test_slopes(self):
        assert boat_noise(25e3, 10.0, 68.0, 25e3, 5.0) == pytest.approx(68 + 60 * math.log10(2))
        assert boat_noise(50e3, 5.0, 68.0, 25e3, 5.0) == pytest.approx(68 - 20 * math.log10(2))
        assert boat_noise(50e3, 10.0, 68.0, 25e3, 5.0, 50.0, -10.0) == pytest.approx(68 + 40 * math.log10(2))

    @pytest.mark.parametrize("knots", [1.0, 6.0, 15.0])
    @pytest.mark.parametrize("f", [2e3, 1e4, 2e4, 5e4])
    def test_reference_spectrum_of_ships(self, f, knots):
        """MacGillivray and de Jong (2021) for a recreational vessel of 5 m: class speed 10.6 knots, peak at 45 Hz."""

        def source_level(f, knots):
            peak = 480 / 10.6
            baseline = 191 - 20 * math.log10(peak) - 10 * math.log10((1 - f / peak) ** 2 + 3**2)
            return baseline + 60 * math.log10(knots / 10.6) + 20 * math.log10(5 / 91.44)

        level = boat_noise(f, knots * KNOT, source_level(25e3, 10.6), 25e3, 10.6 * KNOT)
        assert level == pytest.approx(source_level(f, knots), abs=0.2)

    def test_at_rest(self):
        assert boat_noise(25e3, 0.0, 68.0, 25e3, 5.0) == -math.inf


def test_names():
    assert dict(ambient_noise_laws) == {"coates": coates}


class TestSum:
    def test_powers_add(self):
        assert total_level(50.0, 50.0) == pytest.approx(50 + 10 * math.log10(2))
        assert total_level(30.0, 40.0, 20.0) == pytest.approx(10 * math.log10(1e3 + 1e4 + 1e2))

    def test_nothing_adds_nothing(self):
        assert total_level(47.0, -math.inf) == pytest.approx(47.0)
        assert total_level(-math.inf) == total_level() == -math.inf
