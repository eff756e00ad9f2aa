"""Wind over a sea: the spectrum's integral, the scales of seamen, and growth with fetch."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from usvauv.kernels.positioning.sonar import (
    drag,
    height_of_developed_sea,
    wind_of_developed_sea,
    wind_of_growing_sea,
)

# WMO, Beaufort scale (Manual on Codes, WMO-No. 306): probable height of the waves in the open sea, m; wind, m/s.
BEAUFORT = {
    3: (0.6, 3.4, 5.4),
    4: (1.0, 5.5, 7.9),
    5: (2.0, 8.0, 10.7),
    6: (3.0, 10.8, 13.8),
    7: (4.0, 13.9, 17.1),
    8: (5.5, 17.2, 20.7),
    9: (7.0, 20.8, 24.4),
    10: (9.0, 24.5, 28.4),
}


class TestDevelopedSea:
    @pytest.mark.parametrize("wind", [5.0, 12.0, 20.0])
    def test_height_is_the_spectrum_s(self, wind):
        """Pierson and Moskowitz's spectrum for the wind at 19.5 m, integrated."""
        wind_at_19_5_m = wind * (1 + math.sqrt(drag(wind)) / 0.4 * math.log(1.95))

        def spectrum(omega):
            return 0.0081 * 9.81**2 / omega**5 * math.exp(-0.74 * (9.81 / (wind_at_19_5_m * omega)) ** 4)

        peak = 0.877 * 9.81 / wind_at_19_5_m
        m0 = quad(spectrum, peak / 4, 60 * peak, limit=200)[0]
        assert wind_of_developed_sea(4 * math.sqrt(m0)) == pytest.approx(wind, rel=3e-3)

    @pytest.mark.parametrize("force", [3, 4, 5, 6])
    def test_beaufort_up_to_a_strong_breeze(self, force):
        height, lowest, highest = BEAUFORT[force]
        assert lowest <= wind_of_developed_sea(height) <= highest

    @pytest.mark.parametrize("force", [7, 8, 9, 10])
    def test_gales_are_stronger_than_their_sea_tells(self, force):
        height, lowest, _ = BEAUFORT[force]
        assert 0.75 * lowest < wind_of_developed_sea(height) < lowest

    def test_sea_state_7(self):
        """WMO code 3700: 6 to 9 m; a wind of 15 to 20 m/s."""
        assert 15 < wind_of_developed_sea(6.0) < wind_of_developed_sea(9.0) < 20

    @pytest.mark.parametrize("wind", [2.0, 8.0, 20.0])
    def test_the_height_of_a_wind_is_the_inverse(self, wind):
        assert wind_of_developed_sea(height_of_developed_sea(wind)) == pytest.approx(wind, rel=3e-3)
        assert height_of_developed_sea(0.0) == 0.0

    def test_height_grows_with_the_square(self):
        assert wind_of_developed_sea(4.0) / wind_of_developed_sea(1.0) == pytest.approx(2, rel=0.03)
        assert wind_of_developed_sea(0.0) == 0.0


class TestGrowingSea:
    @pytest.mark.parametrize("wind", [8.0, 15.0, 25.0])
    @pytest.mark.parametrize("fetch", [20e3, 100e3, 400e3])
    def test_jonswap(self, fetch, wind):
        """Hasselmann et al. (1973): g² m0/U⁴ = 1.6e-7 x̃ and fp U/g = 3.5 x̃^−0.33 at the fetch x̃ = g x/U²."""
        x = 9.81 * fetch / wind**2
        height, period = 4 * math.sqrt(1.6e-7 * x) * wind**2 / 9.81, wind / (9.81 * 3.5 * x**-0.33)
        assert wind_of_growing_sea(height, period) == pytest.approx(wind, rel=0.25)

    @pytest.mark.parametrize("wind", [8.0, 15.0, 20.0])
    def test_its_end_is_the_developed_sea(self, wind):
        """Pierson and Moskowitz's height and peak, ωp = 0.877 g/U."""
        U = wind * (1 + math.sqrt(drag(wind)) / 0.4 * math.log(1.95))
        height, period = 0.2093 * U**2 / 9.81, 2 * math.pi * U / (0.877 * 9.81)
        assert wind_of_growing_sea(height, period) == pytest.approx(wind, rel=0.25)

    def test_peak_enhancement(self):
        """Donelan et al. (1985), doi 10.1098/rsta.1985.0054: γ = 1.7 + 6 log10 of U over the peak's celerity.

        6.5 m and 11 s, with γ = 2.2.
        """
        celerity = 9.81 * 11 / (2 * math.pi)
        assert wind_of_growing_sea(6.5, 11.0) == pytest.approx(celerity * 10 ** ((2.2 - 1.7) / 6), rel=0.1)

    def test_toba(self):
        """The law, written for the friction velocity of the wind that comes out."""
        for height, period in ((0.5, 3.0), (2.0, 6.0), (6.5, 11.0), (12.0, 14.0)):
            u = math.sqrt(drag(wind := wind_of_growing_sea(height, period))) * wind
            assert 9.81 * height / u**2 == pytest.approx(0.062 * (9.81 * period / 1.05 / u) ** 1.5)

    def test_higher_and_shorter_waves_need_more_wind(self):
        assert np.all(np.diff([wind_of_growing_sea(height, 8.0) for height in np.linspace(0.5, 5.0, 20)]) > 0)
        assert np.all(np.diff([wind_of_growing_sea(3.0, period) for period in np.linspace(6.0, 14.0, 20)]) < 0)
