"""Profiles of the speed of sound: their mean slowness."""

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
