"""Thinned sound speed profiles: the same travel times, fixes and shadows by the kernels' rays, and few depths."""

import numpy as np
import pytest
import torch

from usvauv.env.scenario import Scenario
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
