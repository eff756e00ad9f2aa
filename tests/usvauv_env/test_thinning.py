"""Thinned sound speed profiles: the same travel times, fixes and shadows by the kernels' rays, and few depths."""

import numpy as np
import pytest
import torch
from scipy.integrate import quad

from usvauv.env.scenario import Scenario
from usvauv.env.site import thinning
from usvauv.env.site.site import Site
from usvauv.env.site.sound_speed import SoundSpeedProfile
from usvauv.env.world.tables import sound_profile
from usvauv.kernels.positioning import rays

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
@pytest.mark.parametrize("longest", [283.0, 1500.0, 4000.0])
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


def test_times_by_quadrature():
    """The travel times that thinning compares, of a direct ray and of one that turns, by numerical integration."""
    depths, speeds = np.array([0.0, 40.0, 100.0, 300.0]), np.array([1480.0, 1484.0, 1484.0, 1510.0])
    array, source = 5.0, 100.0

    def integral(power, a, b, turning_speed):
        """∫ cᵖ/cos θ dz by z = b − u², which takes away the singularity of a turning point at b."""

        def integrand(u):
            c = np.interp(b - u * u, depths, speeds)
            return 2 * u * c**power / np.sqrt(1 - (c / turning_speed) ** 2)

        inner = [np.sqrt(b - z) for z in depths if a < z < b]
        return quad(integrand, 0, np.sqrt(b - a), points=inner or None, epsabs=1e-12, limit=200)[0]

    straight = thinning.direct(depths, speeds, array, source, np.array([1520.0]))
    expected = (integral(1, array, source, 1520.0) / 1520, integral(-1, array, source, 1520.0))
    assert (straight.range[0], straight.time[0]) == pytest.approx(expected, rel=1e-9)
    fastest = 1497.0
    turn = 100 + 200 * (fastest - 1484) / 26
    R, time = (
        integral(power, array, source, fastest) + 2 * integral(power, source, turn, fastest) for power in (1, -1)
    )
    turned = next(thinning.turning(depths, speeds, array, source))
    assert thinning.times_at(turned, np.array([R / fastest]))[0] == pytest.approx(time, rel=1e-7)


def test_times_between_rays_are_cubic():
    """Of pieces the least counts, also where two rays end at one place; beyond the ends nothing arrives."""
    R = np.array([1.0, 2.0, 2.0, 4.0])
    cubic, slope = np.poly1d([0.03, -0.2, 0.9, 2.0]), np.poly1d([0.09, -0.4, 0.9])
    branch = thinning.Branch(R, cubic(R), slope(R), np.ones(4))
    asked = np.array([0.999, 1.0, 1.3, 2.0, 2.9, 4.0, 4.001])
    expected = np.where((asked >= 1) & (asked <= 4), cubic(asked), np.inf)
    np.testing.assert_allclose(thinning.times_at(branch, asked), expected)
    folded = thinning.Branch(np.array([1.0, 3.0, 1.0]), np.array([1.0, 3.0, 5.0]), np.array([1.0, 1.0, -1.0]), R[:3])
    assert thinning.times_at(folded, np.array([1.5]))[0] == pytest.approx(1.5)


def test_the_depths_of_bends_are_kept():
    """At a small tolerance the bends themselves; at a large one the line that fits best, by weights."""
    depths = np.arange(0.0, 101.0, 5)
    bends = np.array([0.0, 20, 35, 80, 100])
    speeds = np.interp(depths, bends, [1500.0, 1503, 1490, 1491, 1486])
    weights = np.linspace(1, 3, len(depths))
    few, at = thinning.simplified(depths, speeds, weights, 0.01)
    assert few.tolist() == bends.tolist()
    np.testing.assert_allclose(at, np.interp(bends, depths, speeds))
    few, at = thinning.simplified(depths, speeds, weights, 100.0)
    assert few.tolist() == [0, 100]
    z = np.linspace(0, 100, thinning.FIT_POINTS * len(depths))
    line = np.polyfit(z, np.interp(z, depths, speeds), 1, w=np.interp(z, depths, weights))
    np.testing.assert_allclose(at, np.polyval(line, few))
    missed = np.abs(weights * (speeds - np.interp(depths, [0, 100], [1500, 1486]))).max()
    for share in (1.001, 0.999):
        assert (len(thinning.simplified(depths, speeds, weights, share * missed)[0]) == 2) is (share > 1)


@pytest.mark.parametrize(
    ("change", "holds"),
    [
        (lambda c: c, True),
        (lambda c: c * (1 + 1e-8), True),
        (lambda c: c * (1 - 2 * thinning.TOLERANCE / 280), False),  # times over at most 283 m
        (lambda c: c + 0.01 * np.sin(Z / 3), True),
        (lambda c: c[::-1], False),
    ],
)
def test_what_a_thinned_profile_is_held_to(change, holds):
    speeds = 1500.0 - 0.02 * Z
    asked = thinning.Comparison(Z, speeds, (0.0, 5.0), 100.0, 265.0)
    assert asked.holds(Z, change(speeds)) is holds
