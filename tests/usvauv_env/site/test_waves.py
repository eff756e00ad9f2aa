"""Waves from files: directions, energies and spreads against closed forms, and the seas that are drawn from them."""

import math

import numpy as np
import pytest

from tests.usvauv_env.site.ocean_files import cmems, write
from tests.usvauv_env.site.wave_files import era5, fields, partitions, scenario_of, spectrum_of, waves_of, ww3
from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.scenario.environment import Storm
from usvauv.env.sea.storm import band, cumulative, total_height, wave_systems
from usvauv.env.sea.water import build_short_waves
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.site import Site
from usvauv.env.site.waves import WaveSpectrum
from usvauv.env.world.mission_parameters import wind
from usvauv.kernels.positioning.sonar import wind_of_developed_sea

WIND_SEA = (5.0, 11.0, 90.0, 10)  # Hs, Tp, travels towards the east, s
SWELL = (2.0, 16.0, 210.0, 40)  # towards the south-south-west
ERA5_PARTS = ("shww", "mpww", "mdww", "dwww", "shts", "mpts", "mdts", "dwps")
ERA5_UNITS = ("m", "s", "degrees", "radians") * 2


def spread_of(s: float) -> float:
    """√(2(1 − r₁)) of cos^2s(½Δθ), rad."""
    return math.sqrt(2 / (s + 1))


def only_spectrum(site: Site) -> WaveSpectrum:
    (spectrum,) = wave_systems(site)
    assert isinstance(spectrum, WaveSpectrum)
    return spectrum


def storms(site: Site) -> list[Storm]:
    systems = wave_systems(site)
    return [system for system in systems if isinstance(system, Storm)]


def turn(a: float, b: float) -> float:
    """Angle between two directions, degrees."""
    return abs((math.degrees(a - b) + 180) % 360 - 180)


def travel(heading_from_north: float) -> float:
    """Rad from east towards north of degrees clockwise from north."""
    return math.radians(90 - heading_from_north)


class TestSpectra:
    @pytest.mark.parametrize(("towards", "expected"), [(0.0, (0, 1)), (90.0, (1, 0))])
    @pytest.mark.parametrize("make", [ww3, era5, lambda *systems: ww3(*systems, comes_from=True)])
    def test_waves_travel_where_they_should(self, make, towards, expected, tmp_path):
        spectrum = spectrum_of(make((4.0, 10.0, towards, 20)), tmp_path)
        assert (math.cos(spectrum.direction), math.sin(spectrum.direction)) == pytest.approx(expected, abs=1e-3)

    @pytest.mark.parametrize(("make", "systems"), [(ww3, [WIND_SEA, SWELL]), (era5, [WIND_SEA]), (era5, [SWELL])])
    def test_height_period_direction_and_spread(self, make, systems, tmp_path):
        spectrum = spectrum_of(make(*systems), tmp_path)
        assert spectrum.significant_height == pytest.approx(math.hypot(*(each[0] for each in systems)), rel=0.01)
        assert spectrum.peak_period == pytest.approx(systems[0][1], rel=0.06)
        moment = sum(each[0] ** 2 * each[3] / (each[3] + 1) * np.exp(1j * travel(each[2])) for each in systems) / sum(
            each[0] ** 2 for each in systems
        )
        assert turn(spectrum.direction, float(np.angle(moment))) < 0.5
        spread = math.sqrt(2 * (1 - abs(moment)))
        assert math.sqrt(2 * (1 - abs(spectrum.moment))) == pytest.approx(spread, abs=math.radians(1.0))

    @pytest.mark.parametrize("units", [{}, {"frequency": "Hz", "direction": "degrees"}])
    def test_era5_by_values_in_place_of_numbers(self, units, tmp_path):
        dataset = era5(WIND_SEA, SWELL)
        expected = spectrum_of(dataset, tmp_path)
        values = {"frequency": 0.03453 * 1.1 ** np.arange(30), "direction": 7.5 + 15.0 * np.arange(24)}
        for name, of in values.items():
            dataset = dataset.assign_coords({name: (name, of, {"units": units[name]} if units else {})})
        found = spectrum_of(dataset.rename(time="valid_time").assign_coords(number=0, surface=0.0), tmp_path)
        np.testing.assert_allclose(found.frequencies, expected.frequencies, rtol=1e-12)
        np.testing.assert_allclose(found.directions, expected.directions, atol=1e-12)
        np.testing.assert_allclose(found.density, expected.density)

    @pytest.mark.parametrize(
        "lon", [np.arange(178, 182.1, 0.5), [178.5, 179, 179.5, -180, -179.5], [-180, -179.5, 179, 179.5]]
    )
    @pytest.mark.parametrize("corner", [179.99, -180.0])
    def test_both_sides_of_180_degrees(self, lon, corner, tmp_path):
        dataset = era5(WIND_SEA, lon=tuple(lon))
        assert spectrum_of(dataset, tmp_path, frame=LocalFrame(corner, 60.0)).significant_height == pytest.approx(
            5.0, rel=0.01
        )

    def test_density_per_degree(self, tmp_path):
        dataset = ww3(WIND_SEA)
        dataset["efth"] = dataset["efth"] * math.pi / 180
        dataset["efth"].attrs["units"] = "m2 s degree-1"
        assert spectrum_of(dataset, tmp_path).significant_height == pytest.approx(5.0, rel=0.01)

    def test_linear_in_time(self, tmp_path):
        """Energy doubles in three hours from 2014-08-23."""
        dataset = ww3(WIND_SEA, growth=1.0)
        for start, energy in (("", 1.0), ("2014-08-23T00:45:00", 1.25), ("2014-08-23T03:00:00", 2.0)):
            height = spectrum_of(dataset, tmp_path, start).significant_height
            assert height == pytest.approx(5.0 * math.sqrt(energy), rel=0.01)
            assert waves_of(dataset, tmp_path, start).start == (start or "2014-08-23T00:00:00")

    def test_nearest_station(self, tmp_path):
        dataset = ww3(WIND_SEA, stations=((4.8, 60.0), (5.01, 60.02), (5.3, 60.3)))
        dataset["efth"][:, 0] *= 4.0
        dataset["efth"][:, 2] *= 9.0
        assert spectrum_of(dataset, tmp_path).significant_height == pytest.approx(5.0, rel=0.01)

    def test_linear_on_a_grid_and_land_left_out(self, tmp_path):
        """The area's middle is at 5.018° E, 60.009° N; energies a factor 4 higher at 5.5° E."""
        dataset = era5(WIND_SEA)
        share = (5.0179 - 5.0) / 0.5
        dataset["d2fd"] = dataset["d2fd"].copy()
        dataset["d2fd"][..., 2] += math.log10(4.0)
        high = spectrum_of(dataset, tmp_path).significant_height
        assert (high / 5.0) ** 2 == pytest.approx(1 + 3 * share, rel=0.01)
        dataset["d2fd"][..., :2] = np.nan
        assert spectrum_of(dataset, tmp_path).significant_height == pytest.approx(10.0, rel=0.01)

    def test_longitudes_from_zero_and_across_the_seam(self, tmp_path):
        dataset = era5(WIND_SEA, lon=tuple(np.arange(0, 360, 0.5)), lat=(60.5, 60.0))
        for longitude in (-0.2, 359.9, 5.0):
            spectrum = spectrum_of(dataset, tmp_path, frame=LocalFrame(longitude, 60.0))
            assert spectrum.significant_height == pytest.approx(5.0, rel=0.01)


class TestPartitions:
    def test_wavewatch(self, tmp_path):
        """Directions that waves come from: a wind sea from the west travels east."""
        dataset = partitions((4.0, 9.0, 270.0, 30.0), (2.0, 15.0, 0.0, 12.0), (np.nan, np.nan, np.nan, np.nan))
        systems = storms(Site(scenario_of(dataset, tmp_path, "storm.gamma=3.3")))
        assert [(each.significant_height, each.peak_period) for each in systems] == [(4.0, 9.0), (2.0, 15.0)]
        assert turn(systems[0].direction, 0.0) < 1e-9
        assert turn(systems[1].direction, -math.pi / 2) < 1e-9
        for system, spread in zip(systems, (30.0, 12.0), strict=True):
            assert spread_of(system.spreading) == pytest.approx(math.radians(spread))
            assert (system.spectrum, system.gamma) == ("jonswap", 3.3)

    def test_era5(self, tmp_path):
        """Mean periods T₋₁,₀ become those of peaks: JONSWAP with γ = 3.3 has Tp = 1.1 T₋₁,₀."""
        dataset = fields(ERA5_PARTS, ERA5_UNITS, (3.0, 8.0, 225.0, 0.5, 2.0, 12.0, 315.0, 0.3))
        sea, swell = storms(Site(scenario_of(dataset, tmp_path, "storm.gamma=3.3")))
        assert (sea.significant_height, swell.significant_height) == (3.0, 2.0)
        assert sea.peak_period / 8.0 == pytest.approx(1.107, abs=0.005)
        omega, S = band("jonswap", sea.peak_period, 3.3, 0.1, 5000.0, 9.81)
        assert 2 * math.pi * cumulative(omega, S / omega)[-1] / cumulative(omega, S)[-1] == pytest.approx(8.0, rel=0.01)
        assert turn(sea.direction, math.pi / 4) < 1e-9  # from the south-west
        assert turn(swell.direction, -math.pi / 4) < 1e-9
        assert spread_of(sea.spreading) == pytest.approx(0.5)

    @pytest.mark.parametrize("name", ["swh1", "p140121"])
    def test_parts_of_era5s_swell_in_place_of_all_of_it(self, name, tmp_path):
        more = (name, "mwp1" if name == "swh1" else "p140123", "mwd1" if name == "swh1" else "p140122")
        second = tuple(part.replace("1", "2") if name == "swh1" else f"p{int(part[1:]) + 3}" for part in more)
        names = (*ERA5_PARTS, *more, *second)
        values = (3.0, 8.0, 225.0, 0.5, 2.5, 12.0, 315.0, 0.3, 2.0, 13.0, 0.0, 1.5, 11.0, 90.0)
        dataset = fields(names, (*ERA5_UNITS, "m", "s", "degrees", "m", "s", "degrees"), values)
        systems = storms(Site(scenario_of(dataset, tmp_path)))
        assert [each.significant_height for each in systems] == [3.0, 2.0, 1.5]
        assert turn(systems[2].direction, math.pi) < 1e-9
        assert systems[1].spreading == 10.0  # the scenario's, as the file has none

    def test_short_waves_left_out_and_their_energy_kept(self, tmp_path):
        small = (0.9, 3.0, 270.0, 30.0)
        systems = wave_systems(Site(scenario_of(partitions(small, (4.0, 12.0, 270.0, 20.0)), tmp_path)))
        assert len(systems) == 1
        assert total_height(systems) == pytest.approx(math.hypot(0.9, 4.0))
        with pytest.raises(ScenarioError, match=r"boat.length = 7.7: leaves out 17% of the energy of .*waves.nc"):
            wave_systems(Site(scenario_of(partitions((1.8, 3.0, 270.0, 30.0), (4.0, 12.0, 0.0, 20.0)), tmp_path)))

    def test_nearest_point_that_is_not_land(self, tmp_path):
        dataset = partitions((4.0, 9.0, 270.0, 30.0))
        dataset["phs0"][:, 1, 1] = np.nan  # 60.0° N, 5.0° E
        dataset["phs0"][:, 1, 2] = 3.0  # 60.0° N, 5.5° E
        assert waves_of(dataset, tmp_path).partitions[0].height == 3.0

    @pytest.mark.parametrize(
        ("names", "units", "values", "period", "moment"),
        [
            (("hs", "fp", "dir", "spr"), ("m", "s-1", "degree", "degree"), (3.0, 0.1, 180.0, 25.0), 10.0, 0),
            (("hs", "t0m1", "dir"), ("m", "s", "degree"), (3.0, 9.0, 180.0), 9.0, -1),
            (("VHM0", "VTPK", "VMDR", "VHM0_WW"), ("m", "s", "degree", "m"), (3.0, 10.0, 180.0, 2.0), 10.0, 0),
            (("swh", "mwp", "mwd", "shww"), ("m", "s", "Degree true", "m"), (3.0, 9.0, 180.0, 1.0), 9.0, -1),
            (
                ("wave_height", "dominant_wpd", "mean_wave_dir"),
                ("meters", "seconds", "degrees_true"),
                (3.0, 10.0, 180.0),
                10.0,
                0,
            ),
        ],
    )
    def test_names_of_all_waves(self, names, units, values, period, moment, tmp_path):
        (only,) = waves_of(fields(names, units, values), tmp_path).partitions
        assert (only.height, only.period, only.moment, only.wind_sea) == (3.0, pytest.approx(period), moment, True)
        assert turn(only.direction, math.pi / 2) < 1e-9

    @pytest.mark.parametrize(
        ("about", "heading"),
        [
            ({"standard_name": "sea_surface_wave_to_direction"}, 180),
            ({"long_name": "Mean wave direction (going to)"}, 180),
            ({"long_name": "sea surface wave from direction"}, 0),
            ({"long_name": "Mean wave direction"}, 0),
        ],
    )
    def test_which_way_a_direction_of_all_waves_is(self, about, heading, tmp_path):
        dataset = fields(("hs", "tp", "dir"), ("m", "s", "degree"), (3.0, 9.0, 180.0))
        dataset["dir"].attrs |= about
        (only,) = waves_of(dataset, tmp_path).partitions
        assert turn(only.direction, math.pi / 2 - math.radians(heading)) < 1e-9

    def test_of_cmems(self, tmp_path):
        """Wind sea and two swells by their means m0/m1; a JONSWAP sea with γ = 3.3 has Tp = 1.198 T₀₁."""
        parts = [(2.0, 6.0, 270.0), (1.5, 10.0, 0.0), (1.0, 12.0, 90.0)]
        names = [f"{name}_{part}" for part in ("WW", "SW1", "SW2") for name in ("VHM0", "VTM01", "VMDR")]
        dataset = fields((*names, "VHM0"), ("m", "s", "degree") * 3 + ("m",), (*np.ravel(parts), 2.7))
        systems = storms(Site(scenario_of(dataset, tmp_path, "storm.gamma=3.3", "storm.shortest_wave=5")))
        assert [each.significant_height for each in systems] == [2.0, 1.5, 1.0]
        assert [each.peak_period / part[1] for each, part in zip(systems, parts, strict=True)] == pytest.approx(
            [1.198] * 3, abs=0.005
        )
        for system, heading in zip(systems, (0.0, -math.pi / 2, math.pi), strict=True):
            assert turn(system.direction, heading) < 1e-9

    def test_the_first_and_the_final_results_of_era5(self, tmp_path):
        """Along `expver`, of which each time has one."""
        dataset = fields(("swh", "pp1d", "mwd"), ("m", "s", "degrees"), (3.0, 10.0, 180.0), hours=(1e6, 1e6 + 1))
        twice = dataset.expand_dims(expver=[1, 5]).transpose("time", "expver", ...).copy(deep=True)
        for name in dataset:
            twice[name][0, 1], twice[name][1, 0] = np.nan, np.nan
            twice[name].attrs = dataset[name].attrs
        for start in ("2014-01-29T16:00:00", "2014-01-29T17:00:00"):
            (only,) = waves_of(twice, tmp_path, start).partitions
            assert (only.height, only.period) == (3.0, 10.0)


class TestDrawn:
    """Tolerances of `docs/real-water.md`: of one sea with 64 components, beside the sums over the file."""

    @pytest.mark.parametrize(
        ("make", "systems"), [(ww3, [WIND_SEA, SWELL]), (era5, [(1.0, 8.0, 0.0, 4), (2.5, 14.0, 120.0, 60)])]
    )
    def test_seas_have_the_files_statistics(self, make, systems, tmp_path):
        site = Site(scenario_of(make(*systems), tmp_path, "storm.shortest_wave=5"))
        spectrum = only_spectrum(site)
        f, S = spectrum.frequencies, spectrum.by_frequency
        drawn = build_short_waves(site, [(3, sea) for sea in range(16)])
        assert drawn.amplitude.shape == (16, 64)
        periods = {power: cumulative(f, S)[-1] / cumulative(f, S * f**power)[-1] for power in (-1, 1)}
        for amplitude, omega, direction in zip(drawn.amplitude, drawn.omega, drawn.direction, strict=True):
            energy = amplitude**2 / 2
            m0 = energy.sum()
            assert 4 * math.sqrt(m0) == pytest.approx(spectrum.significant_height, rel=1e-6)
            for power, period in periods.items():
                assert m0 / (energy * (omega / 2 / math.pi) ** power).sum() == pytest.approx(period, rel=0.03)
            moment = (energy * np.exp(1j * direction)).sum() / m0
            assert turn(float(np.angle(moment)), spectrum.direction) < 4.0
            spread, goal = (math.degrees(math.sqrt(2 * (1 - abs(each)))) for each in (moment, spectrum.moment))
            assert spread == pytest.approx(goal, abs=4.0)

    @pytest.mark.parametrize("make", [ww3, era5])
    def test_the_mean_over_seas_is_the_file(self, make, tmp_path):
        """Energy and first moment of the directions in each band, m0 to 1 %."""
        site = Site(scenario_of(make(WIND_SEA, SWELL), tmp_path, "storm.shortest_wave=5"))
        spectrum = only_spectrum(site)
        drawn = build_short_waves(site, [(1, sea) for sea in range(256)])
        energy, f = drawn.amplitude**2 / 2, drawn.omega / (2 * math.pi)
        fine = np.linspace(spectrum.frequencies[0], spectrum.frequencies[-1], 20001)
        S = np.interp(fine, spectrum.frequencies, spectrum.by_frequency)
        for low, high in ((0.04, 0.07), (0.07, 0.1), (0.1, 0.15), (0.15, 0.25)):
            inside, there = (f >= low) & (f < high), (fine >= low) & (fine < high)
            expected = cumulative(fine[there], S[there])[-1]
            assert (energy * inside).sum() / 256 == pytest.approx(expected, rel=0.01)
            first = np.interp(
                fine, spectrum.frequencies, spectrum.density @ np.sin(spectrum.directions) * spectrum.step
            )
            sines = (energy * inside * np.sin(drawn.direction)).sum() / 256 / expected
            assert sines == pytest.approx(cumulative(fine[there], first[there])[-1] / expected, abs=0.02)
        assert energy.sum() / 256 == pytest.approx((spectrum.significant_height / 4) ** 2, rel=1e-6)

    def test_waves_that_break_or_reach_the_auvs(self, tmp_path):
        shallow = ["area.depth=6", "auv.depth=5", "sea.irregular_rms=0", "storm.shortest_wave=5"]
        with pytest.raises(ScenarioError, match=r"waves.nc: significant height = 5.0\d*: must not be above 3.6 m"):
            wave_systems(Site(scenario_of(ww3(WIND_SEA), tmp_path, *shallow)))
        with pytest.raises(ScenarioError, match=r"auv.depth = 3: must be below the troughs"):
            wave_systems(Site(scenario_of(ww3((3.4, 9.0, 0.0, 10)), tmp_path, *shallow, "auv.depth=3")))


class TestInAScenario:
    def test_partitions_are_the_same_sea_as_swells_of_the_scenario(self, tmp_path):
        dataset = partitions((4.0, 9.0, 270.0, 30.0), (2.0, 15.0, 0.0, 12.0))
        site = Site(scenario_of(dataset, tmp_path))
        s = [2 / math.radians(spread) ** 2 - 1 for spread in (30.0, 12.0)]
        same = [
            *("storm.significant_height=4", "storm.peak_period=9", "storm.direction=0", f"storm.spreading={s[0]}"),
            f"storm.swells=[[2.0, 15.0, 2.2, {-math.pi / 2}, {s[1]}]]",
        ]
        seas = [build_short_waves(each, [(5, 0), (5, 1)]) for each in (site, Site(Scenario.load("extreme", same)))]
        for name in ("amplitude", "omega", "direction", "phase"):
            np.testing.assert_allclose(getattr(seas[0], name), getattr(seas[1], name), atol=1e-9)

    def test_wind(self, tmp_path):
        """The file's own, or that of a developed sea: of the wind sea where partitions tell, else of all waves."""
        assert wind(Site(scenario_of(ww3(WIND_SEA), tmp_path))) == pytest.approx(12.0)
        assert wind(Site(scenario_of(ww3(WIND_SEA), tmp_path, "acoustics.wind=7"))) == 7.0
        spectrum = Site(scenario_of(era5(WIND_SEA, SWELL), tmp_path))
        assert wind(spectrum) == pytest.approx(wind_of_developed_sea(math.hypot(5.0, 2.0)), rel=0.01)
        parts = Site(scenario_of(partitions((4.0, 9.0, 270.0, 30.0), (2.0, 15.0, 0.0, 12.0)), tmp_path))
        assert wind(parts) == pytest.approx(wind_of_developed_sea(4.0))
        swell = partitions((np.nan, np.nan, np.nan, np.nan), (2.0, 15.0, 0.0, 12.0))
        assert wind(Site(scenario_of(swell, tmp_path))) == 0.0

    def test_begins_with_the_currents(self, tmp_path):
        """Without water.start the mission begins with the file of currents, here on 1950-01-01."""
        currents = write(cmems(), tmp_path / "currents.nc")
        days = (-14610.0, -14609.0)
        scenario = scenario_of(
            ww3(WIND_SEA, days=days, growth=1.0), tmp_path, f"water.currents={currents}", "water.longitude=5.02"
        )
        assert Site(scenario).start == "1950-01-01T00:00:00"
        assert total_height(wave_systems(Site(scenario))) == pytest.approx(5.0, rel=0.01)

    def test_a_world_sails_on_it(self, tmp_path):
        scenario = scenario_of(ww3(WIND_SEA), tmp_path, "sea.irregular_rms=0", "sea.realisations=1")
        world = World(scenario, num_worlds=1, seed=1)
        place = np.linspace(0, 200, 60)
        squares = []
        for time in range(0, 6000, 60):
            world.storm.set_time(float(time))
            squares.append(np.mean(world.storm.elevation(0, place, place).astype(float) ** 2))
        assert 4 * math.sqrt(np.mean(squares)) == pytest.approx(5.0, rel=0.05)
