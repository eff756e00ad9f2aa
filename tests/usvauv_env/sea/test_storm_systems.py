"""Wind sea and swells in all that a scenario makes of them, and where over a bed the storm is wrong."""

import math

import numpy as np
import pytest

from tests.usvauv_env.site.ocean_files import sloping, write
from usvauv.cli.sea_view.figure import target_spectrum, wanted
from usvauv.env import Scenario
from usvauv.env.sea.storm import group_speed, shallowest_valid_depth
from usvauv.env.sea.water import current_bound
from usvauv.env.site.site import Site
from usvauv.env.world.current_statistics import current_parts

SWELL = "storm.swells=[[3.0, 16.0, 3.3, 0.5, 40.0]]"
ALONE = ["storm.significant_height=3", "storm.peak_period=16", "storm.gamma=3.3", "storm.spreading=40"]


def load(*changes: str) -> Scenario:
    return Scenario.load("extreme", ["sea.irregular_rms=0", *changes])


def test_energies_add_up():
    both, wind_sea, swell = load(SWELL), load(), load(*ALONE)
    assert both.storm.total_height == pytest.approx(math.hypot(6.5, 3.0))
    f, S = target_spectrum(Site(both))
    assert 4 * math.sqrt(np.trapezoid(S, f)) == pytest.approx(math.hypot(6.5, 3.0), rel=1e-4)
    assert wanted(both.storm.systems).height == both.storm.total_height
    assert wanted(both.storm.systems).spread > wanted(wind_sea.storm.systems).spread
    waves = [
        parts for parts in current_parts(Site(both)) if parts not in current_parts(Site(load("storm.spectrum=none")))
    ]
    apart = [current_parts(Site(each)) for each in (wind_sea, swell)]
    assert all(any(wave in parts for parts in apart) for wave in waves)
    assert len(waves) == 2
    still = current_bound(Site(load("storm.spectrum=none"))) / 1.001
    bounds = [current_bound(Site(each)) / 1.001 - still for each in (both, wind_sea, swell)]
    assert bounds[0] == pytest.approx(math.hypot(*bounds[1:]), rel=1e-5)


@pytest.mark.parametrize("period", [5.0, 11.0, 25.0])
def test_group_speed_is_the_slope_of_the_dispersion(period):
    def frequency(k: float) -> float:
        return math.sqrt(9.81 * k * math.tanh(k * 30.0))

    low, high = 1e-6, 10.0
    for _ in range(200):
        k = (low + high) / 2
        low, high = (k, high) if frequency(k) < 2 * math.pi / period else (low, k)
    slope = (frequency(k * 1.0001) - frequency(k * 0.9999)) / (0.0002 * k)
    assert group_speed(period, 30.0, 9.81) == pytest.approx(slope, rel=1e-6)


def test_long_waves_shoal_by_greens_law():
    """Heights go as h^(−1/4), so 10 % more are at h/1.1⁴."""
    shallow = ["area.depth=10", "auv.depth=8", "sea.irregular_rms=0", "storm.significant_height=0.01"]
    limit = shallowest_valid_depth(Site(load(*shallow, "storm.peak_period=30")))
    assert limit == pytest.approx(10 / 1.1**4, rel=0.05)
    assert shallowest_valid_depth(Site(load(*shallow[:3], "storm.significant_height=5.4"))) == pytest.approx(
        9.0, rel=0.01
    )


def test_a_command_says_it_too(tmp_path, run_usvauv):
    bed = write(sloping(), tmp_path / "bed.nc")
    place = ["water.longitude=5.05", "water.latitude=60", "area.width=2000", "area.length=2000", "sea.cell_size=100"]
    sea = ["auv.depth=20", "storm.significant_height=4", "storm.peak_period=18", SWELL.replace("16.0", "28.0")]
    changes = [part for change in (*place, *sea, f"water.bathymetry={bed}") for part in ("--set", change)]
    code, said, _ = run_usvauv("scenarios", "extreme", "--check", *changes)
    assert (code, " ".join(said.split()).count("warning storm: its waves are those of the mean depth")) == (0, 1)
