"""Places on the Earth without files: the plane against PROJ, positions, axes, interpolation, speeds of sound."""

import math

import numpy as np
import pytest
import xarray
from pyproj import CRS, Transformer

from usvauv.env import Scenario
from usvauv.env.site import cf, place
from usvauv.env.site.cf import Axis
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.positions import auv_position, boat_position
from usvauv.env.site.sound_speed import SoundSpeedError, SoundSpeedProfile
from usvauv.env.site.waves import Partition, Waves, WaveSpectrum
from usvauv.env.storage.netcdf import OceanError
from usvauv.kernels.errors import UserError

EARTH = 6378137.0
EAST, NORTH = {"units": "degrees_east"}, {"units": "degrees_north"}
DOWN, UP = ({"units": "m", "positive": way} for way in ("down", "up"))
DAYS = {"units": "days since 1970-01-01"}


def axis(values) -> Axis:
    values = np.asarray(values)
    return Axis("x", "x", values, np.arange(len(values)))


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
            ("latitude", NORTH, [3, 2, 1], [3, 1, 2], "is not in order: 2.0 follows 1.0"),
            ("latitude", NORTH, [1, 2, 3], [1, 2, 2, 3], "is not in order: 2.0 is repeated"),
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

    def test_longitudes_about_a_centre(self):
        """0° and 360° are one point."""
        found = axis([0.0, 90, 180, 270, 360]).unwrapped(10)
        assert found.values.tolist() == [-90, 0, 90, 180]
        assert [found.order[i] for i in (0, 2, 3)] == [3, 1, 2]


class TestWaves:
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

    @pytest.mark.parametrize("corner", [-180, 180])
    @pytest.mark.parametrize("side", "EW")
    def test_180_degrees_are_one_place(self, corner, side):
        scenario = Scenario.load("ideal", [f"water.longitude={corner}", "water.latitude=-16.5"])
        assert boat_position(f"16.5S,180{side}", scenario) == (0, 0)


class TestSoundSpeed:
    @pytest.mark.parametrize(
        ("allowed", "refused", "said"),
        [
            ([(0, 1300), (9, 1700)], [(0, 1299.9)], "speed 1299.9 m/s at 0 m; allowed: 1300 to 1700"),
            ([(0, 1700)], [(0, 1500), (9, 1700.1)], "speed 1700.1 m/s at 9 m"),
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
            ({"temperature": -3}, {"temperature": -3.1}, "temperature -3.1 °C at 0 m; allowed: -3 to 45"),
            ({"salt": 0}, {"salt": -0.1}, "salinity -0.1 g/kg at 0 m; allowed: 0 to 50 g/kg"),
            ({"salt": 0.02}, {"salt": 0.021}, "salinity 0.021 at 0 m looks like kg/kg"),
        ],
    )
    def test_the_last_numbers_of_water(self, changes, further, said):
        def read(temperature=10, salt=35, latitude=40, longitude=0):
            rows = [(0, temperature, salt), (9, temperature, salt)]
            SoundSpeedProfile.from_water(rows, latitude=latitude, longitude=longitude, salinity="absolute")

        read(**changes)
        with pytest.raises(SoundSpeedError, match=said):
            read(**further)


@pytest.mark.parametrize("latitude", [-85.0, -33.0, 0.0, 22.51, 80.0])
@pytest.mark.parametrize("form", ["cf", "wkt"])
def test_proj_has_the_same_plane(latitude, form):
    """Places by PROJ from what a file says agree to 0.1 mm with those by the frame."""
    frame = LocalFrame(114.02, latitude)
    attributes = place.grid_mapping(frame)
    wkt = attributes.pop("crs_wkt")
    there = Transformer.from_crs(CRS.from_wkt(wkt) if form == "wkt" else CRS.from_cf(attributes), 4326, always_xy=True)
    x, y = np.meshgrid(np.linspace(0, 20000, 5), np.linspace(0, 20000, 5))
    np.testing.assert_allclose(there.transform(x, y), frame.to_geographic(x, y), rtol=0, atol=1e-9)
