"""Profiles of the speed of sound: their mean slowness, sea water by TEOS-10, and profiles thinned to few depths."""

import importlib.util

import numpy as np
import pytest
import torch
from scipy.integrate import quad

from usvauv.env.scenario import Scenario
from usvauv.env.site.site import Site
from usvauv.env.site.sound_speed import SoundSpeedError, SoundSpeedProfile
from usvauv.env.world.mission_parameters import sound_profile
from usvauv.kernels.positioning import rays

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


Z = np.arange(0.0, 200.0, 1.0)
CASTS = {  # m/s
    "thermocline": 1506 - 15 * np.tanh((Z - 35) / 12) + 0.016 * Z,
    "noisy": 1506 - 15 * np.tanh((Z - 35) / 12) + np.random.default_rng(3).normal(0, 0.1, len(Z)),
    "winter": 1480 + 0.05 * Z + 5 * np.tanh((Z - 60) / 20),
    "meltwater": 1440 + 38 * (1 - np.exp(-Z / 20)) + 0.01 * Z,
}
ARRAYS, SOURCE, BED = (0.0, 3.0, 6.0), 100.0, 120.0


def tensor(values, device) -> torch.Tensor:
    return torch.tensor(np.asarray(values), dtype=torch.float32, device=device)


def heard(profile, array, R, device):
    """Travel time (s) by the kernels, NaN where there is no ray."""
    ends = np.stack([0 * R + array, 0 * R + SOURCE, R], axis=1)
    found = rays.eigenrays(tensor(profile.layers(), device), tensor(ends, device), array).double().cpu().numpy()
    return np.where(found[:, 4] > 0, found[:, 3], np.nan)


@pytest.mark.parametrize("name", CASTS)
@pytest.mark.parametrize("longest", [283.0, 4000.0])
def test_travel_times_and_shadows(device, name, longest):
    """By the kernels' own eigenrays, at ranges that the thinning has not tried: 1 cm, and 1 mm for single precision."""
    fine = SoundSpeedProfile(Z, CASTS[name])
    cut = SoundSpeedProfile(np.append(Z[Z < BED], BED), np.append(CASTS[name][Z < BED], fine.at(BED)))
    thin = fine.thinned(ARRAYS, SOURCE, longest, BED)
    assert len(thin.depths) < 0.4 * len(cut.depths)
    assert thin.depths[-1] == BED
    R = np.linspace(7.3, longest, 911)
    for array in ARRAYS:
        expected, found = heard(cut, array, R, device), heard(thin, array, R, device)
        assert np.nanmax(1500 * np.abs(found - expected)) < 0.011
        assert (np.isnan(found) != np.isnan(expected)).mean() < 0.03


@pytest.mark.parametrize("name", CASTS)
def test_places_of_fixes(device, name):
    fine = SoundSpeedProfile(Z, CASTS[name])
    thin = fine.thinned(ARRAYS, SOURCE, 400.0, BED)
    R = np.linspace(1, 250, 250)
    offset, depth = np.stack([R, 0 * R, 0 * R - SOURCE], axis=1), tensor(0 * R, device)
    arrivals = rays.arrivals(tensor(fine.layers(), device), depth, tensor(offset, device), 1500.0)
    back = rays.positions(tensor(thin.layers(), device), depth, arrivals, 1500.0).double().cpu().numpy()
    assert np.abs(back - offset)[:, 0].max() < 0.011


def test_few_depths():
    """A metre's cast over the range of `extreme` needs no more depths than the shape of the profile has bends."""
    assert [len(SoundSpeedProfile(Z, c).thinned(ARRAYS, SOURCE, 283.0, BED).depths) <= 8 for c in CASTS.values()] == [
        True
    ] * 4
    straight = SoundSpeedProfile(Z, 1480 + 0.05 * Z).thinned(ARRAYS, SOURCE, 4000.0, BED)
    assert straight.depths.tolist() == [0, BED]
    assert straight.speeds == pytest.approx([1480, 1486], abs=1e-9)


def test_what_cannot_be_thinned_stays():
    bends = SoundSpeedProfile.from_table([(0, 1522.0), (20, 1522.3), (50, 1492.0), (120, 1490.0)])
    for profile in (bends, SoundSpeedProfile.constant(1500.0)):
        same = profile.thinned(ARRAYS, SOURCE, 4000.0, BED)
        assert same.depths.tolist() == profile.depths.tolist()
        assert same.speeds.tolist() == profile.speeds.tolist()


def test_below_the_bed_nothing_turns():
    """A scenario's layers end at its bed, so that no ray comes back from water that is not there."""
    settings = ["acoustics.sound_speed_profile=[[0, 1480], [300, 1540]]"]
    layers = sound_profile(Site(Scenario.load("extreme", settings))).layers()
    assert layers[-2, 0] == Scenario.load("extreme").area.depth == 120.0
