"""Profiles of the speed of sound: their mean slowness, and sea water by TEOS-10."""

import importlib.util

import numpy as np
import pytest
from scipy.integrate import quad

from usvauv.env.site.sound_speed import SoundSpeedError, SoundSpeedProfile

THERMOCLINE = SoundSpeedProfile.from_table([(0, 1522.0), (20, 1522.3), (50, 1492.0), (200, 1490.0)])


MELTWATER = SoundSpeedProfile.from_table([(0, 1440.0), (3, 1440.0), (20, 1475.0), (60, 1480.0), (200, 1482.0)])


ISOTHERMAL = SoundSpeedProfile.from_table([(0, 1490.0), (200, 1493.3)])


DUCT = SoundSpeedProfile.from_table([(0, 1500.0), (30, 1510.0), (60, 1480.0), (90, 1495.0), (200, 1492.0)])


PROFILES = {"thermocline": THERMOCLINE, "meltwater": MELTWATER, "isothermal": ISOTHERMAL, "duct": DUCT}


class TestProfile:
    def test_harmonic_mean(self):
        for profile in PROFILES.values():
            breaks = [z for z in profile.depths if z < 100]
            time = quad(lambda z, p=profile: 1 / p.at(z), -5, 100, points=breaks, epsabs=1e-14)[0]
            assert profile.harmonic_mean(-5, 100) == pytest.approx(105 / time, rel=1e-10)
        assert SoundSpeedProfile.constant(1487.5).harmonic_mean(0, 80) == pytest.approx(1487.5, rel=1e-15)

    def test_a_table_that_ends_above_the_source(self):
        THERMOCLINE.check_reaches(200)
        SoundSpeedProfile.constant(1500).check_reaches(5000)
        with pytest.raises(SoundSpeedError, match="last depth 200 m; the profile must reach 201 m"):
            THERMOCLINE.check_reaches(201)


class TestWater:
    @pytest.fixture(autouse=True)
    def _library(self):
        pytest.importorskip("gsw")

    def test_published_value(self):
        """The check value of TEOS-10 for SA = 34.7118 g/kg, t = 28.7856 °C, p = 10 dbar."""
        import gsw

        z = -float(gsw.z_from_p(10.0, 4.0))
        profile = SoundSpeedProfile.from_water(
            [(z, 28.7856, 34.7118), (50, 28.4329, 34.8915)], latitude=4, longitude=188, salinity="absolute"
        )
        assert profile.speeds[0] == pytest.approx(1542.615803587414, abs=1e-8)

    def test_near_another_formula(self):
        """Mackenzie, J. Acoust. Soc. Am. 70 (1981) 807, doi 10.1121/1.386920."""
        for T, S in ((4.0, 35.0), (12.0, 34.0), (22.0, 36.5)):
            profile = SoundSpeedProfile.from_water([(0, T, S), (300, T, S)], latitude=40, longitude=-30)
            for D in (0.0, 300.0):
                c = 1448.96 + 4.591 * T - 5.304e-2 * T**2 + 2.374e-4 * T**3 + 1.340 * (S - 35) + 1.630e-2 * D
                c += 1.675e-7 * D**2 - 1.025e-2 * T * (S - 35) - 7.139e-13 * T * D**3
                assert profile.at(D) == pytest.approx(c, abs=0.15)

    def test_between_rows_temperature_is_linear_and_not_speed(self):
        import gsw

        rows = [(0, 24, 36.0), (40, 10, 35.0), (100, 9, 35.0)]
        profile = SoundSpeedProfile.from_water(rows, latitude=40, longitude=-30)
        z = np.linspace(0, 100, 501)
        depth, t, s = np.array(rows, float).T
        p = gsw.p_from_z(-z, 40)
        salt = gsw.SA_from_SP(np.interp(z, depth, s), p, -30, 40)
        exact = gsw.sound_speed_t_exact(salt, np.interp(z, depth, t), p)
        assert np.abs(np.interp(z, profile.depths, profile.speeds) - exact).max() < 0.006


def test_without_gsw(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "gsw" else find(name, *a))
    with pytest.raises(SoundSpeedError, match="need the library gsw: pip install gsw"):
        SoundSpeedProfile.from_water([(0, 10, 35), (9, 10, 35)], latitude=50)
