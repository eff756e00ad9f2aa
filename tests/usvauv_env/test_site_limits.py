"""Places on the Earth without files: each limit itself, parts of axes, and interpolation by other means."""

import math
from contextlib import nullcontext
from datetime import datetime, timedelta

import numpy as np
import pytest
import xarray
from scipy.interpolate import RegularGridInterpolator

from tests.usvauv_env.ocean_files import FRAME, cmems, gebco
from tests.usvauv_env.wave_files import era5
from usvauv.env import Scenario
from usvauv.env.scenario.fields import FARTHEST
from usvauv.env.site import cf, cf_ocean, interpolation, wave_source
from usvauv.env.site.cf import Axis, Field, OceanError
from usvauv.env.site.local_frame import LocalFrame
from usvauv.env.site.positions import angle, auv_position, boat_position, coordinates, far_position, look_geographic
from usvauv.env.site.sound_speed import SoundSpeedError, SoundSpeedProfile
from usvauv.env.site.waves import Partition, Waves, WaveSpectrum
from usvauv.kernels.errors import UserError

EARTH = 6378137.0
EAST, NORTH = {"units": "degrees_east"}, {"units": "degrees_north"}
DOWN, UP = ({"units": "m", "positive": way} for way in ("down", "up"))
DAYS = {"units": "days since 1970-01-01"}
NOON = datetime(2026, 1, 31, 12)


def axis(values) -> Axis:
    values = np.asarray(values)
    return Axis("x", "x", values, np.arange(len(values)))


def source(**axes) -> Field:
    return Field("a.nc", "v", xarray.DataArray(0.0), 1.0, {kind: axis(values) for kind, values in axes.items()})


class TestAxes:
    @pytest.mark.parametrize(
        ("kind", "attributes", "allowed", "refused", "said"),
        [
            ("latitude", NORTH, [-90, 90], [-90.1, 90], "-90.1 degrees; allowed: -90 to 90"),
            ("longitude", EAST, [-540, 540], [-540, 540.1], "540.1 degrees; allowed: -540 to 540"),
            (
                "longitude",
                EAST,
                [0, 1e-7, 1],
                [0, 0.9e-7, 1],
                "has points 9e-08 degrees apart; allowed: at least 1e-07",
            ),
            ("longitude", EAST, [5], [5, 5], "is not in order: 5.0 is repeated"),
            ("latitude", NORTH, [3, 2, 1], [3, 1, 2], "is not in order: 2.0 follows 1.0"),
            ("latitude", NORTH, [1, 2, 3], [1, 2, 2, 3], "is not in order: 2.0 is repeated"),
            ("latitude", NORTH, [3, 2, 1], [3, 2, 2, 1], "is not in order: 2.0 is repeated"),
            ("depth", DOWN, [0, 12000], [0, 12001], "12001 m; allowed: up to 12000 m"),
            ("depth", UP, [0, -12000], [1, -12000], "1 with positive 'up' is above the surface"),
            ("time", DAYS, [-106650, 0], [-106651, 0], "1677-12-31.*; allowed: the years 1678 to 2261"),
            ("time", DAYS, [106650], [106651], "2262-01-01.*; allowed: the years 1678 to 2261"),
        ],
    )
    def test_the_last_values_are_allowed(self, kind, attributes, allowed, refused, said):
        def read(values):
            variable = xarray.DataArray(np.array(values, float), dims="x", name="x", attrs=attributes)
            return cf.read_axis(variable, "a.nc", kind, "x")

        found = read(allowed)
        assert (np.diff(found.values).astype(float) > 0).all()
        assert found.order.tolist() == np.argsort(-np.array(allowed) if attributes is UP else allowed).tolist()
        with pytest.raises(OceanError, match=f"^a.nc: x: {said}"):
            read(refused)

    def test_how_many_values(self, monkeypatch):
        monkeypatch.setitem(cf.MOST_VALUES, "latitude", 3)
        for count, wrong in ((1, False), (3, False), (4, True), (0, True)):
            variable = xarray.DataArray(np.arange(count), dims="x", name="x", attrs=NORTH)
            refused = (
                pytest.raises(OceanError, match=f"has {count} values; allowed: 1 to 3") if wrong else nullcontext()
            )
            with refused:
                cf.read_axis(variable, "a.nc", "latitude", "x")

    def test_longitudes_about_a_centre(self):
        """0° and 360° are one point."""
        found = axis([0.0, 90, 180, 270, 360]).unwrapped(10)
        assert found.values.tolist() == [-90, 0, 90, 180]
        assert [found.order[i] for i in (0, 2, 3)] == [3, 1, 2]

    @pytest.mark.parametrize(
        ("span", "part"),
        [
            ((1, 2), (1, 2)),
            ((1.2, 1.4), (1, 2)),
            ((0.9, 2), (0, 2)),
            ((1, 2.1), (1, 3)),
            ((1, 1), (1, 2)),
            ((-9e-6, 3 + 9e-6), (0, 3)),
            ((-1.1e-5, 3), None),
            ((0, 3 + 1.1e-5), None),
        ],
    )
    def test_points_just_enclose_the_area(self, span, part):
        """To a metre, by which coordinates may be rounded."""
        whole = source(longitude=np.arange(4.0), latitude=np.arange(50.0, 54.0))
        spans = (span, (50.5, 51.5)), ((0.5, 1.5), tuple(50 + each for each in span))
        for kind, (west_east, south_north) in zip(("longitude", "latitude"), spans, strict=True):
            if part is None:
                with pytest.raises(OceanError, match="its points must enclose the area"):
                    cf_ocean._window(whole, west_east, south_north)
            else:
                found = cf_ocean._window(whole, west_east, south_north)[kind]
                assert (found.order[0], found.order[-1]) == part

    @pytest.mark.parametrize(("last", "enough"), [(345, True), (344, False)])
    def test_a_seam_may_be_half_as_wide_again_as_the_steps(self, last, enough):
        lon = np.append(np.arange(0.0, 341, 10), last)
        refused = pytest.raises(OceanError, match=rf"spans 351.00000 to 353.00000 degrees and the file 0.0+ to {last}")
        with nullcontext() if enough else refused:
            found = cf_ocean._window(source(longitude=lon, latitude=[0.0, 1]), (-9.0, -7.0), (0.2, 0.4))
            assert found["longitude"].order.tolist() == [35, 0]

    @pytest.mark.parametrize(
        ("depths", "levels", "needed", "beyond", "said"),
        [
            ([15, 20, 30], (0, 35), [15, 30], 35.1, "needed at 35.1 m .* 15 to 30 m; they serve from 0 to 35 m"),
            ([15.1, 20], (15.1, 22), [15.1, 20], 15, "needed at 15 m .* they serve from 15.1 to 22.45 m"),
            ([10], (0, 10), [10], 10.1, "needed at 10.1 m .* 10 to 10 m; they serve from 0 to 10 m"),
            ([10, 20, 30, 40], (22,), [20, 30], 45.1, "they serve from 0 to 45 m"),
            ([10, 20, 30, 40], (20,), [20], -0.1, "needed at -0.1 m"),
        ],
    )
    def test_depths_that_are_needed(self, depths, levels, needed, beyond, said):
        whole = source(depth=np.array(depths, float))
        assert cf_ocean._layers(whole, "a.nc", levels)["depth"].values.tolist() == needed
        with pytest.raises(OceanError, match=said):
            cf_ocean._layers(whole, "a.nc", (*levels, beyond))

    @pytest.mark.parametrize(
        ("start", "duration", "picked"),
        [
            (None, 0, [0, 1]),
            (None, 3600, [0, 1]),
            (None, 3600.0005, [0, 1]),
            (None, 3601, [0, 1, 2]),
            (-0.0005, 3600, [0, 1]),
            (-0.002, 3600, None),
            (3600, 7200, [1, 2, 3]),
            (3600.0005, 1, [1, 2]),
            (3599, 1, [0, 1]),
            (10800, 0, [3]),
            (10800, 0.0005, [3]),
            (10800, 0.01, None),
        ],
    )
    def test_times_that_just_enclose_the_mission(self, start, duration, picked):
        """Hourly from noon; to a millisecond, by which times may be rounded."""
        whole = source(time=np.array([NOON + timedelta(hours=n) for n in range(4)], "datetime64[ns]"))
        begin = NOON + timedelta(seconds=start or 0)
        asked = "" if start is None else begin.isoformat()
        if picked is None:
            with pytest.raises(OceanError, match=r"the mission lasts from .* it must enclose the mission"):
                cf_ocean.mission_times(whole, "a.nc", asked, duration)
        else:
            found, seconds, said = cf_ocean.mission_times(whole, "a.nc", asked, duration)
            assert found.tolist() == picked
            np.testing.assert_allclose(seconds, [3600 * n - (start or 0) for n in picked], atol=1e-6)
            assert datetime.fromisoformat(said) == begin

    def test_one_time_is_that_of_the_start_to_a_millisecond(self):
        whole = source(time=np.array([NOON], "datetime64[ns]"))
        for late in (0.0, 0.0009, -0.0009):
            asked = (NOON + timedelta(seconds=late)).isoformat()
            found, seconds, said = cf_ocean.mission_times(whole, "a.nc", asked, 1e6)
            assert (found.tolist(), seconds.tolist(), said) == ([0], [0.0], asked)
        for late in (0.002, -0.002):
            with pytest.raises(OceanError, match="has one time, 2026-01-31T12:00:00; start"):
                cf_ocean.mission_times(whole, "a.nc", (NOON + timedelta(seconds=late)).isoformat(), 0)

    def test_a_flow_between_its_times(self):
        flow = cf_ocean.Flow(1.0, 1.0, (0.0,), np.array([0.0, 10.0]), np.array([1.0, 3.0], np.float32), "")
        assert [float(flow.at(t)) for t in (-0.0009, 0, 2.5, 10, 10.0009)] == pytest.approx([1, 1, 1.5, 3, 3])
        for t in (-0.0011, 10.0011):
            with pytest.raises(ValueError, match="allowed: 0 to 10 s"):
                flow.at(t)

    def test_nodes_are_half_a_step_apart(self):
        """Of the finer file in each direction; at least the corners, at most 129."""
        degree = math.radians(1) * EARTH
        grids = [
            {"longitude": axis([0.0, 0.01, 0.03]), "latitude": axis([-0.01, 0.01])},
            {"longitude": axis([0.0, 0.02, 0.04]), "latitude": axis([0.0, 0.01])},
        ]
        for width, length, shape in ((2.1, 5.1, (12, 6)), (0.1, 9.9, (21, 2)), (100, 1, (3, 129))):
            x, y = cf_ocean._nodes(grids, 0.01 * degree * width, 0.01 * degree * length)
            assert x.shape == y.shape == shape
            assert (x.min(), x.max(), y.min()) == (0, 0.01 * degree * width, 0)
            assert (x[0] == x[-1]).all()


class TestInterpolation:
    def test_smallest_steps(self):
        steps = interpolation.spacing({"longitude": axis([0, 0.03, 0.04]), "latitude": axis([-60, -59.98])})
        assert steps == pytest.approx((EARTH * 0.5 * math.radians(0.01), EARTH * math.radians(0.02)))

    def test_between_points_and_depths(self):
        random = np.random.default_rng(1)
        lon, lat, depths = (np.sort(random.uniform(0, 10, count)) for count in (7, 5, 4))
        values = random.standard_normal((3, 5, 7))
        x, y = random.uniform(lon[0], lon[-1], (2, 9)), random.uniform(lat[0], lat[-1], (2, 9))
        found = interpolation.bilinear(values, {"longitude": axis(lon), "latitude": axis(lat)}, x, y)
        for each, own in zip(values, found, strict=True):
            np.testing.assert_allclose(own, RegularGridInterpolator((lat, lon), each)((y, x)))
        levels = np.linspace(-1, 11, 25)
        weights = interpolation.depth_weights(depths, levels)
        np.testing.assert_allclose(weights @ values[0, :4, 0], np.interp(levels, depths, values[0, :4, 0]))

    @pytest.mark.parametrize(
        ("lon", "across"),
        [
            (np.arange(-0.005, 0.036, 0.005), 2),  # cells of 1000 m, points 557 m apart
            (np.array([-0.01, 0, 0.0001, 0.04]), 8),  # four for each of the 4 points over 3 cells
            (np.array([-0.1, 0.1]), 1),
        ],
    )
    def test_means_over_cells(self, lon, across, monkeypatch):
        """At evenly spaced places, as many as bring one to each of the file's points; whatever is made at once."""
        frame, lat = LocalFrame(0.0, 0.0), np.arange(-0.004, 0.041, 0.004)  # 445 m apart, cells of 2000 m
        values = np.random.default_rng(2).standard_normal((len(lat), len(lon)))
        axes = {"longitude": axis(lon), "latitude": axis(lat)}
        x, y = (np.arange(3 * across) + 0.5) * 1000 / across, (np.arange(10) + 0.5) * 400
        at = frame.to_geographic(*np.meshgrid(x, y))[::-1]
        fine = RegularGridInterpolator((lat, lon), values)(at)
        expected = [[fine[5 * j : 5 * j + 5, across * i : across * (i + 1)].mean() for i in range(3)] for j in range(2)]
        for block in (1, 2**21):
            monkeypatch.setattr(interpolation, "BLOCK", block)
            found = interpolation.cell_means(values, axes, frame, 3000.0, 4000.0, (3, 2))
            np.testing.assert_allclose(found, expected)


class TestFields:
    """In memory, as they come out of a file."""

    @pytest.mark.parametrize(
        ("lowest", "highest", "said"),
        [
            (-12000, 9000, None),
            (-12001, 9000, "elevation: 12001 m deep; allowed: up to 12000 m"),
            (-12000, 9001, "elevation: 9001 m high; allowed: up to 9000 m"),
            (0, 5, "no water in the area: depths from -5 to -?0 m"),
        ],
    )
    def test_beds(self, monkeypatch, lowest, highest, said):
        lon, lat = np.linspace(4.9, 5.4, 6), np.linspace(59.9, 60.4, 6)
        elevation = np.full((6, 6), float(highest))
        elevation[2:, 3:] = lowest
        monkeypatch.setattr(cf_ocean, "open_file", lambda path: nullcontext(gebco(lon, lat, elevation)))
        with pytest.raises(OceanError, match=said) if said else nullcontext():
            cf_ocean.read_bathymetry("a.nc", LocalFrame(5.0, 60.0), 15000.0, 12000.0, (6, 4))

    @pytest.mark.parametrize(("speed", "allowed"), [(20.0, True), (-20.0, True), (20.1, False), (-20.1, False)])
    def test_currents(self, monkeypatch, speed, allowed):
        dataset = cmems(fields=(lambda *place: 0 * place[0] + speed, lambda *place: 0 * place[0]))
        monkeypatch.setattr(cf_ocean, "open_file", lambda path: nullcontext(dataset))
        with nullcontext() if allowed else pytest.raises(OceanError, match=r"20.1 m/s; allowed: up to 20 m/s"):
            flow = cf_ocean.read_flow("a.nc", FRAME, 8000.0, 6000.0, (1.0,), duration=60.0)
            np.testing.assert_allclose(np.hypot(*np.moveaxis(flow.velocity, -1, 0)), 20, rtol=1e-6)

    @pytest.mark.parametrize(("start", "shares"), [("", (1.0, 0.0)), ("2025-06-27T09:00:00", (0.75, 0.25))])
    def test_points_about_a_place_and_a_time(self, start, shares):
        """A grid of half degrees, from the north; times four hours apart."""
        hours = (1_100_000.0, 1_100_004.0)
        dataset = era5((3.0, 10.0, 0.0, 5), hours=hours)
        found = wave_source.Source.of(dataset, "a.nc", "d2fd", (5.1, 60.2), start)
        expected = {
            (t, j, i): share * along * across
            for t, share in enumerate(shares)
            for j, along in ((1, 0.6), (0, 0.4))
            for i, across in ((1, 0.8), (2, 0.2))
            if share
        }
        order = [tuple(sample.index[name] for name in ("time", "latitude", "longitude")) for sample in found.samples]
        weights = [sample.weight for sample in found.samples]
        assert dict(zip(order, weights, strict=True)) == pytest.approx(expected)
        assert weights == sorted(weights, reverse=True)

    def test_distances_on_a_sphere(self):
        places = np.random.default_rng(3).uniform((-180, -80), (180, 80), (50, 2))
        east, north = np.radians(places).T
        unit = np.stack([np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)])
        away = wave_source._distance(*places.T, tuple(places[0]))
        np.testing.assert_allclose(away, EARTH * np.arccos(np.clip(unit[:, 0] @ unit, -1, 1)), rtol=1e-9, atol=1)
        degree = math.radians(1) * EARTH
        wave_source._require_near("a.nc", 5.0, 60 + 49_999 / degree, (5.0, 60.0))
        with pytest.raises(OceanError, match=r"is 50 km from the area, at 5.000, 60.000; allowed: up to 50 km"):
            wave_source._require_near("a.nc", 5.0, 60 - 50_001 / degree, (5.0, 60.0))

    def test_a_spectrum_by_sums(self):
        """Trapezoids in frequency, steps in direction, over each of which the mean of exp(iθ) is shorter than 1."""
        f, theta = np.array([0.1, 0.2, 0.4, 0.5]), np.linspace(0.1, 0.1 + 2 * np.pi, 5)[:-1]
        density = np.array([[1, 0, 2, 1], [4, 1, 0, 3], [2, 2, 1, 2], [0, 1, 0, 0]], float)
        spectrum = WaveSpectrum(f, theta, density)
        S = density.sum(1) * math.pi / 2
        m0, first = (0.0, 0.0)
        for i in range(3):
            m0 += (f[i + 1] - f[i]) * (S[i] + S[i + 1]) / 2
            both = [sum(density[n] * np.exp(1j * theta)) * math.pi / 2 for n in (i, i + 1)]
            first += (f[i + 1] - f[i]) * sum(both) / 2
        assert spectrum.significant_height == pytest.approx(4 * math.sqrt(m0))
        assert spectrum.peak_period == 5.0
        assert spectrum.moment == pytest.approx(first / m0 * math.sin(math.pi / 4) / (math.pi / 4))
        assert spectrum.direction == pytest.approx(np.angle(first))
        assert Waves("a.nc", "", spectrum, (), None).wind_sea_height == spectrum.significant_height
        parts = [
            Partition(height, 9.0, 0.0, None, False, sea) for height, sea in ((3.0, True), (5.0, False), (4.0, True))
        ]
        assert Waves("a.nc", "", None, tuple(parts), None).wind_sea_height == 5.0
        assert Waves("a.nc", "", None, (), None).wind_sea_height == 0.0


class TestPositions:
    def test_the_last_places_of_a_plane(self):
        for longitude, latitude in ((-360, -85), (360, 85)):
            LocalFrame(longitude, latitude)
        for longitude, latitude in ((-360.1, 0), (360.1, 0), (0, 85.1), (0, -85.1)):
            with pytest.raises(OceanError, match="allowed: -"):
                LocalFrame(longitude, latitude)

    @pytest.mark.parametrize(
        ("part", "sides", "degrees"),
        [
            ("90S", "NS", -90),
            ("180E", "EW", 180),
            ("1°59'59.9\"W", "EW", -(1 + 59 / 60 + 59.9 / 3600)),
            ("0N", "NS", 0),
        ],
    )
    def test_the_largest_angles(self, part, sides, degrees):
        assert angle("--auv", part, part, sides) == pytest.approx(degrees, rel=1e-12)

    def test_the_edges_of_an_area_are_in_it(self):
        scenario = Scenario.load("ideal", ["area.width=300", "area.length=240"])
        assert boat_position("300,240", scenario) == (300, 240)
        assert boat_position("0,0", scenario) == (0, 0)
        assert auv_position("0,240,120", scenario) == (0, 240, 120)
        for text in ("300.1,0", "0,240.1", "-0.1,0", "0,-0.1"):
            with pytest.raises(UserError, match=r"outside the area \[0, 300\] × \[0, 240\] m"):
                boat_position(text, scenario)
        for depth in (0, 120.1):
            with pytest.raises(UserError, match="above 0 and at most the water's 120 m"):
                auv_position(f"1,1,{depth}", scenario)

    @pytest.mark.parametrize("side", "EWNS")
    def test_the_farthest_place(self, side):
        """On the equator x is a sin λ, and y is b sin β of the reduced latitude β, tan β = (b/a) tan φ."""
        scenario = Scenario.load("ideal", ["water.longitude=20", "water.bathymetry=a.nc"])
        squeeze = 1 - 1 / 298.257223563
        for metres, allowed in ((FARTHEST - 1, True), (FARTHEST + 1, False)):
            if side in "EW":
                away = math.degrees(math.asin(metres / EARTH))
                text = f"0N,{20 + (away if side == 'E' else -away):.9f}E"
            else:
                beta = math.asin(metres / (EARTH * squeeze))
                text = f"{math.degrees(math.atan(math.tan(beta) / squeeze)):.9f}{side},20E"
            if allowed:
                place = far_position("centres", text, scenario)
                sign = -1 if side in "WS" else 1
                assert place["NS".count(side)] == pytest.approx(sign * metres, abs=1e-3)
            else:
                with pytest.raises(UserError, match="is 100 km from the area's corner; at most 100 km east and north"):
                    far_position("centres", text, scenario)

    @pytest.mark.parametrize(
        ("texts", "plain", "near"),
        [
            (["90.000,120.000"], True, True),
            (["90.001,120.000"], False, False),
            (["1.000,-180.000"], True, True),
            (["1.000,180.001"], False, False),
            (["22.500,114.000", "23.000,114.500"], True, True),
            (["22.500,114.000", "23.001,114.000"], False, False),
            (["23.0,114.5"], False, True),
            (["113.5,22.0"], False, True),
            (["23.1,114.0"], False, False),
            (["22.50,114.000"], False, True),
        ],
    )
    def test_what_looks_like_degrees(self, texts, plain, near):
        """Near is half a degree from the corner, and of the AUVs from one another."""
        corner = Scenario.load("ideal", ["water.latitude=22.5", "water.longitude=114"])
        assert look_geographic(texts, Scenario.load("ideal")) is plain
        assert bool(look_geographic(texts, corner)) is near

    def test_coordinates_have_a_side(self):
        assert coordinates(0.0, 0.0) == "0.000000N,0.000000E"
        assert coordinates(-1e-6, -179.5) == "0.000001S,179.500000W"


class TestSoundSpeed:
    @pytest.mark.parametrize(
        ("allowed", "refused", "said"),
        [
            ([(0, 1300), (9, 1700)], [(0, 1299.9)], "speed 1299.9 m/s at 0 m; allowed: 1300 to 1700"),
            ([(0, 1700)], [(0, 1500), (9, 1700.1)], "speed 1700.1 m/s at 9 m"),
            ([(0, 1500), (11000, 1500)], [(0, 1500), (11000.5, 1500)], "depth 11000.5 m; allowed: 0 to 11000 m"),
            ([(15, 1500)], [(15.1, 1500)], "first depth 15.1 m; a profile must begin above 15 m"),
            ([(0, 1500), (1, 1500)], [(0, 1500), (2, 1500), (1, 1500)], "depths must rise: 1 m follows 2 m"),
        ],
    )
    def test_the_last_numbers_of_a_table(self, allowed, refused, said):
        SoundSpeedProfile.from_table(allowed)
        with pytest.raises(SoundSpeedError, match=said):
            SoundSpeedProfile.from_table(refused)

    @pytest.mark.parametrize(
        ("changes", "further", "said"),
        [
            ({"latitude": 90}, {"latitude": 90.1}, "latitude 90.1, longitude 0: allowed are"),
            ({"longitude": -360}, {"longitude": -360.1}, "latitude 40, longitude -360.1: allowed are"),
            ({"temperature": -3}, {"temperature": -3.1}, "temperature -3.1 °C at 0 m; allowed: -3 to 45"),
            ({"temperature": 45}, {"temperature": 45.1}, "temperature 45.1 °C at 0 m"),
            ({"salt": 0}, {"salt": -0.1}, "salinity -0.1 g/kg at 0 m; allowed: 0 to 50 g/kg"),
            ({"salt": 50}, {"salt": 50.1}, "salinity 50.1 g/kg at 0 m"),
            ({"salt": 0.02}, {"salt": 0.021}, "salinity 0.021 at 0 m looks like kg/kg"),
            ({"salt": 0.05}, {"salt": 0.049}, "salinity 0.049 at 0 m looks like kg/kg"),
        ],
    )
    def test_the_last_numbers_of_water(self, changes, further, said):
        def read(temperature=10, salt=35, latitude=40, longitude=0):
            rows = [(0, temperature, salt), (9, temperature, salt)]
            SoundSpeedProfile.from_water(rows, latitude=latitude, longitude=longitude, salinity="absolute")

        read(**changes)
        with pytest.raises(SoundSpeedError, match=said):
            read(**further)

    def test_rows_are_added_where_the_temperature_changes(self):
        """Half a degree a layer at most."""
        rows = [(0, 20.0, 35), (10, 18.9, 35), (30, 19.9, 35), (40, 19.9, 36)]
        found = SoundSpeedProfile.from_water(rows, latitude=40, longitude=-30).depths
        np.testing.assert_allclose(found, [0, 10 / 3, 20 / 3, 10, 20, 30, 40])

    def test_a_mirror(self):
        profile = SoundSpeedProfile.from_table([(0, 1500), (40, 1490), (60, 1485), (100, 1480)])
        mirrored = profile.mirrored(60)
        assert mirrored.depths.tolist() == [0, 40, 60, 80, 120]
        for depth in (0, 20, 40, 55, 60):
            assert mirrored.at(depth) == mirrored.at(120 - depth) == profile.at(depth)
