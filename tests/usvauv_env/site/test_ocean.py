"""Real water: files as CMEMS, HYCOM and GEBCO write theirs against analytic fields and geodesics."""

import itertools
import math
import runpy
from pathlib import Path

import h5netcdf
import numpy as np
import pytest
from pyproj import Geod

from tests.usvauv_env.site.ocean_files import (
    BED_FRAME,
    BED_LATITUDES,
    BED_LONGITUDES,
    DEPTHS,
    FRAME,
    HOURS,
    LATITUDES,
    LENGTH,
    LEVELS,
    LONGITUDES,
    WIDTH,
    bed_depth,
    bed_of,
    centres,
    cmems,
    eastward,
    flow_of,
    gebco,
    nodes,
    northward,
    sloping,
    write,
)
from usvauv.env.site.ocean import read_bathymetry, read_flow
from usvauv.env.site.place import LocalFrame

GEODESICS = Geod(ellps="WGS84")


class TestLocalFrame:
    @pytest.mark.parametrize("latitude", [-85.0, -0.05, 45.0, 85.0])
    def test_distances_over_20_km_are_those_of_geodesics(self, latitude):
        """Between any two of 25 points of the largest area, to 0.1 m, and to 1 mm over 3 km from the corner."""
        frame = LocalFrame(179.95, latitude)
        x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 20000, 5), np.linspace(0, 20000, 5)))
        lon, lat = frame.to_geographic(x, y)
        for i, j in itertools.combinations(range(25), 2):
            *_, along = GEODESICS.inv(lon[i], lat[i], lon[j], lat[j])
            assert math.hypot(x[i] - x[j], y[i] - y[j]) == pytest.approx(along, abs=0.1)
        lon, lat = frame.to_geographic(1800.0, 2400.0)
        azimuth, _, along = GEODESICS.inv(179.95, latitude, float(lon), float(lat))
        assert along == pytest.approx(3000.0, abs=1e-3)
        assert along * math.sin(math.radians(azimuth)) == pytest.approx(1800.0, abs=1e-3)

    def test_there_and_back(self):
        x, y = np.meshgrid(np.linspace(0, 20000, 7), np.linspace(0, 20000, 7))
        for latitude in (-85.0, -33.0, 0.0, 60.0, 85.0):
            frame = LocalFrame(-179.99, latitude)
            np.testing.assert_allclose(frame.to_local(*frame.to_geographic(x, y)), (x, y), atol=1e-7)
        assert [float(value) for value in frame.to_geographic(0.0, 0.0)] == pytest.approx([-179.99, 85.0], abs=1e-12)

    @pytest.mark.parametrize("latitude", [-70.0, 0.0, 60.0])
    def test_vectors_turn_with_the_meridians(self, latitude):
        """East and north at a far corner are where a small step along the parallel and the meridian leads."""
        frame = LocalFrame(10.0, latitude)
        lon, lat = frame.to_geographic(20000.0, 20000.0)
        for step, vector in (((1e-5, 0.0), (1.0, 0.0)), ((0.0, 1e-5), (0.0, 1.0))):
            ahead, behind = (np.array(frame.to_local(lon + s * step[0], lat + s * step[1])) for s in (1, -1))
            direction = (ahead - behind) / np.linalg.norm(ahead - behind)
            np.testing.assert_allclose(frame.to_plane(lon, lat, *vector), direction, atol=1e-5)


# First longitude and number of longitudes, half a degree apart, of a global file (721 repeat one), and the corner.
SEAMS = [(0.0, 720, -0.05), (-180.0, 721, -180.05), (74.0, 720, 73.95)]


class TestCurrents:
    def check(self, flow, frame=FRAME, begin=0.0, shift=0.0, fields=(eastward, northward), atol=2e-7):
        """Every node, level and several times against the analytic field, turned into the plane, and after its end."""
        lon, lat = nodes(flow, frame)
        for t in (0.0, 1234.5, 7200.0) if len(flow.times) > 1 else (0.0,):
            for level, depth in enumerate(flow.levels):
                east, north = (speed(lon - shift, lat, depth, begin + t) for speed in fields)
                expected = np.stack(frame.to_plane(lon, lat, east, north), axis=-1)
                np.testing.assert_allclose(flow.at(t)[level], expected, rtol=0, atol=atol)
        np.testing.assert_array_equal(flow.at(1e6), flow.velocity[-1])

    def test_cmems(self, tmp_path):
        flow = flow_of(cmems(), tmp_path)
        assert flow.velocity.dtype == np.float32
        assert flow.velocity.shape == (2, 2, 3, 5, 2)  # at most half of 4.6 km by 9.3 km apart
        assert (flow.width, flow.length, flow.levels, flow.start) == (WIDTH, LENGTH, LEVELS, "1950-01-01T00:00:00")
        np.testing.assert_array_equal(flow.times, [0.0, 21600.0])
        self.check(flow)

    def test_starts_between_two_times(self, tmp_path):
        flow = flow_of(cmems(), tmp_path, start="1950-01-01T07:30:00+02:00", duration=3600.0)
        np.testing.assert_allclose(flow.times, [-19800.0, 1800.0, 23400.0])
        assert flow.start == "1950-01-01T05:30:00"
        flow = flow_of(cmems(), tmp_path, start="1950-01-01T05:30:00Z", duration=9000.0)
        self.check(flow, begin=19800.0)

    @pytest.mark.parametrize("names", [("uo", "vo"), ("water_u", "water_v"), ("vozocrtx", "vomecrty"), ("u", "v")])
    def test_known_names(self, tmp_path, names):
        """Where no variable has a standard_name."""
        dataset = cmems().rename(uo=names[0], vo=names[1])
        for name in names:
            del dataset[name].attrs["standard_name"]
        self.check(flow_of(dataset, tmp_path))

    def test_as_hycom(self, tmp_path):
        """Packed in 16 bits, 0 to 360°, with a land point, and with `tau`, whose units cannot be decoded."""
        west = cmems(lon=LONGITUDES - 10)  # 350.25 to 350.75 once within 0 to 360°
        dataset = west.assign_coords(longitude=("longitude", (LONGITUDES - 10) % 360, {"units": "degrees_east"}))
        dataset = dataset.rename(longitude="lon", latitude="lat", uo="water_u", vo="water_v")
        dataset["depth"].attrs = {"units": "m", "positive": "down"}
        dataset["time"].attrs |= {"units": "hours since 1950-01-01 00:00:00.000 UTC", "calendar": "gregorian"}
        dataset["lat"].attrs = {"units": "degrees_north"}
        dataset["tau"] = ("time", HOURS, {"units": "hours since analysis"})
        dataset["water_u"][:, :, 0, 0] = np.nan  # outside the window
        for name in ("water_u", "water_v"):
            dataset[name].attrs["units"] = "m/s"
        packing = {"dtype": "int16", "scale_factor": 0.001, "_FillValue": -30000}
        path = write(dataset, tmp_path / "hycom.nc", water_u=packing, water_v=packing)
        frame = LocalFrame(FRAME.longitude - 10, FRAME.latitude)
        flow = read_flow(path, frame, WIDTH, LENGTH, LEVELS, duration=7200.0)
        self.check(flow, frame, atol=6e-4)
        again = read_flow(path, LocalFrame(frame.longitude + 360, frame.latitude), WIDTH, LENGTH, LEVELS, duration=7200)
        np.testing.assert_allclose(again.velocity, flow.velocity, atol=1e-6)

    @pytest.mark.parametrize(("first", "count", "corner"), SEAMS)
    def test_across_the_seam_of_a_global_file(self, tmp_path, first, count, corner):
        lon = first + np.arange(count) * 0.5
        centre = corner + 0.07

        def speed(x, y, z, t):
            """Linear over the seam."""
            return 0.01 * (x - 360 * np.round((x - centre) / 360) - centre) + 0.02 * (y - 60)

        dataset = cmems(lon=lon, depth=DEPTHS[:2], hours=HOURS[:2], fields=(speed, speed))
        path = write(dataset, tmp_path / "global.nc")
        frame = LocalFrame(corner, 60.03)
        flow = read_flow(path, frame, WIDTH, LENGTH, (1.0,), duration=7200.0)
        self.check(flow, frame, fields=(speed, speed))

    @pytest.mark.parametrize("corner", [179.95, -180.05])
    def test_a_file_cut_about_180_degrees(self, tmp_path, corner):
        """Longitudes in the order in which they lie on the Earth: 179.5, 180, -179.5; so of a bed."""
        lon = 180 + np.arange(-3, 4) * 0.25
        lon[lon > 180] -= 360

        def speed(x, y, z, t):
            return 0.1 * ((x % 360) - 180) + 0.02 * (y - 60)

        dataset = cmems(lon=lon, depth=DEPTHS[:2], hours=HOURS[:1], fields=(speed, speed))
        frame = LocalFrame(corner, 60.03)
        flow = read_flow(write(dataset, tmp_path / "a.nc"), frame, WIDTH, LENGTH, (1.0,))
        self.check(flow, frame, fields=(speed, speed))
        height = np.broadcast_to(-1000 - 100 * (lon % 360 - 180), (len(LATITUDES), len(lon)))
        h = read_bathymetry(write(gebco(lon, LATITUDES, height), tmp_path / "b.nc"), frame, WIDTH, LENGTH, (8, 6))
        at, _ = centres(frame, WIDTH, LENGTH, (8, 6))
        np.testing.assert_allclose(h, 1000 + 100 * (at % 360 - 180), atol=1e-6)

    def test_order_of_coordinates_and_dimensions_does_not_matter(self, tmp_path):
        dataset = cmems()
        reference = flow_of(dataset, tmp_path)
        turned = dataset.isel(latitude=slice(None, None, -1), depth=slice(None, None, -1), time=slice(None, None, -1))
        turned = turned.transpose("longitude", "time", "latitude", "depth")
        np.testing.assert_array_equal(flow_of(turned, tmp_path).velocity, reference.velocity)

    def test_a_depth_without_a_sign(self, tmp_path):
        dataset = cmems()
        reference = flow_of(dataset, tmp_path)
        dataset["depth"].attrs = {"units": "m", "long_name": "depth"}
        np.testing.assert_array_equal(flow_of(dataset, tmp_path).velocity, reference.velocity)

    def test_heights_and_kilometres(self, tmp_path):
        """A vertical axis that points up, in km, known by `positive` alone."""
        dataset = cmems()
        upwards = dataset.assign_coords(depth=("depth", -DEPTHS / 1000, {"units": "km", "positive": "up"}))
        np.testing.assert_allclose(flow_of(upwards, tmp_path).velocity, flow_of(dataset, tmp_path).velocity, atol=1e-7)

    @pytest.mark.parametrize(("units", "factor"), [("CM  S-1", 100.0), ("knots", 3600 / 1852)])
    def test_units_of_speed(self, tmp_path, units, factor):
        dataset = cmems()
        for name in ("uo", "vo"):
            dataset[name] = dataset[name] * factor
            dataset[name].attrs = cmems()[name].attrs | {"units": units}
        self.check(flow_of(dataset, tmp_path), atol=3e-7)

    def test_coordinates_beside_the_dimensions(self, tmp_path):
        """Dimensions without coordinates of their own but with others on them, and one of length 1 with none at all."""
        dataset = cmems().rename(longitude="x", latitude="y")
        lon, lat = (("x", LONGITUDES, {"units": "degreesE"}), ("y", LATITUDES, {"units": "degrees", "axis": "Y"}))
        dataset = dataset.drop_vars(["x", "y"]).assign_coords(nav_lon=lon, nav_lat=lat).expand_dims(member=1)
        self.check(flow_of(dataset, tmp_path))

    def test_components_on_grids_of_their_own(self, tmp_path):
        """An Arakawa C grid of longitude and latitude lines, staggered in depth too."""
        dataset = cmems()[["uo"]]
        other = cmems(lon=LONGITUDES + 0.04, lat=LATITUDES + 0.03, depth=DEPTHS + 0.2)[["vo"]]
        dataset["vo"] = other["vo"].rename(longitude="lon_v", latitude="lat_v", depth="depth_v").drop_vars("time")
        flow = flow_of(dataset, tmp_path, levels=(1.0, 100.0))
        self.check(flow)

    def test_steady(self, tmp_path):
        """One time is a steady flow however long the mission; so is no time, or time and depth as single numbers."""
        one = cmems(hours=HOURS[:1])
        flow = flow_of(one, tmp_path, duration=1e6)
        np.testing.assert_array_equal(flow.times, [0.0])
        self.check(flow)
        np.testing.assert_array_equal(flow.at(1e6), flow.velocity[0])
        flow = flow_of(one, tmp_path, start="1950-01-01")
        assert flow.start == "1950-01-01T00:00:00"
        for single in (one.isel(time=0), one.isel(time=0).drop_vars("time"), one.drop_vars("time")):
            again = flow_of(single, tmp_path, duration=1e6)
            np.testing.assert_array_equal(again.velocity, flow.velocity)
            assert again.start == ("1950-01-01T00:00:00" if "time" in single else "")
        flow = flow_of(one.isel(time=0, depth=2), tmp_path, levels=(92.326,))
        self.check(flow)

    def test_levels_beyond_the_file_s(self, tmp_path):
        """Above the shallowest and within half a layer below the deepest level, theirs."""
        flow = flow_of(cmems(), tmp_path, levels=(0.0, DEPTHS[0], DEPTHS[-1], 140.0))
        np.testing.assert_array_equal(flow.velocity[:, 0], flow.velocity[:, 1])
        np.testing.assert_array_equal(flow.velocity[:, 3], flow.velocity[:, 2])

    def test_water_is_at_rest_where_there_is_land(self, tmp_path):
        """Missing points are 0 and nothing is carried across them: half the speed half way, and below the bed too."""
        lat = np.array([59.5, 60.5])
        dataset = cmems(lat=lat, fields=(lambda *p: 0 * p[0] + 1.0, lambda *p: 0 * p[0]))
        dataset["uo"][:, :, 0] = np.nan
        dataset["vo"][:, :, 0] = np.nan
        flow = flow_of(dataset, tmp_path)
        _, latitude = nodes(flow)
        np.testing.assert_allclose(np.hypot(*np.moveaxis(flow.velocity, -1, 0))[0, 0], latitude - 59.5, atol=1e-6)
        dataset = cmems(fields=(lambda *p: 0 * p[0] + 1.0, lambda *p: 0 * p[0]))
        dataset["uo"][:, 3:] = np.nan
        share = (DEPTHS[3] - 100) / (DEPTHS[3] - DEPTHS[2])
        flow = flow_of(dataset, tmp_path)
        np.testing.assert_allclose(flow.velocity[:, 1, 0, 0], [[share, 0.0]] * 2, atol=1e-6)

    def test_missing_value_beside_fill_value(self, tmp_path):
        path = tmp_path / "two.nc"
        write(cmems(), path)
        with h5netcdf.File(path, "a") as file:
            file["uo"].attrs["missing_value"] = np.array([-9999.0, -8888.0])
            file["uo"][:, :, 3:5, 3:5] = -8888.0
        flow = read_flow(path, FRAME, WIDTH, LENGTH, LEVELS, duration=7200.0)
        assert abs(flow.velocity).max() < 1

    def test_second_order(self, tmp_path):
        """A smooth field sampled twice as finely is read with a quarter of the error."""

        def smooth(x, y, z, t):
            return np.sin(25 * (x - 5)) * np.cos(40 * (y - 60)) * np.exp(-z / 200)

        errors = []
        for count in (9, 17, 33):
            lon, lat = np.linspace(4.9, 5.3, count), np.linspace(59.95, 60.2, count)
            depth = np.linspace(0, 150, count)
            dataset = cmems(lon, lat, depth, HOURS[:1], (smooth, smooth))
            flow = flow_of(dataset, tmp_path, levels=(103.0,))
            along = np.stack(FRAME.to_plane(*nodes(flow), *2 * [smooth(*nodes(flow), 103.0, 0)]), axis=-1)
            errors.append(np.sqrt(((flow.velocity[0, 0] - along) ** 2).mean()))
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert (orders > 1.8).all(), orders
        assert (orders < 2.4).all(), orders

    def test_reads_only_the_part_it_needs(self, tmp_path):
        """A file that would take 100 GB in memory: only written where the area is, on both sides of its seam."""
        path = tmp_path / "large.nc"
        lon, lat = np.arange(0, 360, 0.03), np.arange(-80, 80, 0.03)
        axes = {
            "time": (np.arange(10.0), "hours since 2026-01-01"),
            "depth": (np.arange(20.0), "m"),
            "lat": (lat, "degrees_north"),
            "lon": (lon, "degrees_east"),
        }
        with h5netcdf.File(path, "w") as file:
            for name, (values, units) in axes.items():
                file.dimensions[name] = len(values)
                file.create_variable(name, (name,), data=values).attrs["units"] = units
            file["depth"].attrs["positive"] = "down"
            for side in ("eastward", "northward"):
                options = {"chunks": (1, 1, 64, 64), "fillvalue": np.float32(np.nan)}
                variable = file.create_variable(side, tuple(axes), "f4", **options)
                variable.attrs.update(standard_name=f"{side}_sea_water_velocity", units="m s-1")
                row = np.searchsorted(lat, 40.0)
                variable[:2, :2, row - 10 : row + 20, :20] = 0.5
                variable[:2, :2, row - 10 : row + 20, -20:] = 0.5
        flow = read_flow(path, LocalFrame(-0.1, 40.0), 20000.0, 10000.0, (0.0, 1.0), duration=1800.0)
        np.testing.assert_allclose(np.hypot(*np.moveaxis(flow.velocity, -1, 0)), math.sqrt(0.5), rtol=1e-5)


HEIGHTS = [
    ("elevation", "height_above_mean_sea_level"),
    ("any", "height_above_reference_ellipsoid"),
    ("elevation", "any"),
    ("z", "height"),
    ("topo", "any"),
]


class TestBathymetry:
    @pytest.mark.parametrize(("name", "standard_name"), HEIGHTS)
    def test_gebco(self, tmp_path, name, standard_name):
        """Elevation, by its standard_name or else by its well-known name; a linear bed is exact, land negative."""
        h = bed_of(sloping(name=name, standard_name=standard_name), tmp_path)
        expected = bed_depth(*centres(BED_FRAME, 15000.0, 12000.0, (100, 80)))
        assert h.shape == (80, 100)
        assert h.dtype == np.float64
        assert (expected < -10).any()
        np.testing.assert_allclose(h, expected, rtol=0, atol=1e-9)

    def test_integers_and_north_first(self, tmp_path):
        """GEBCO stores whole metres in 16 bits, and with rows from the north."""
        dataset = sloping()
        path = write(
            dataset.isel(lat=slice(None, None, -1)),
            tmp_path / "bed.nc",
            elevation={"dtype": "int16", "_FillValue": -32767},
        )
        h = read_bathymetry(path, BED_FRAME, 15000.0, 12000.0, (100, 80))
        np.testing.assert_allclose(h, bed_of(dataset, tmp_path), rtol=0, atol=0.501)

    def test_depth_of_a_model(self, tmp_path):
        """Positive down, missing on land, in km, with a time of length 1, as `deptho` of CMEMS."""
        name = "sea_floor_depth_below_geoid"
        dataset = sloping(standard_name=name, name="deptho")
        dataset["deptho"] = (-dataset["deptho"] / 1000).where(dataset["deptho"] < 0).expand_dims(time=1)
        dataset["deptho"].attrs = {"standard_name": name, "units": "km"}
        h = bed_of(dataset, tmp_path)
        expected = bed_depth(*centres(BED_FRAME, 15000.0, 12000.0, (100, 80)))
        wet = expected > 8  # away from the shore, where 0 m at the missing points takes part
        np.testing.assert_allclose(h[wet], expected[wet], rtol=0, atol=1e-9)
        assert (h[expected < -8] == 0).all()

    def test_wide_cells_are_means(self, tmp_path):
        """A rough bed on cells six times as wide as the file's: the mean, not a sample."""
        dataset = sloping()
        rough = 40.0 * (-1.0) ** np.add.outer(np.arange(len(BED_LATITUDES)), np.arange(len(BED_LONGITUDES)))
        dataset["elevation"] = (("lat", "lon"), rough - 100, dataset["elevation"].attrs)
        h = bed_of(dataset, tmp_path, cells=(8, 5))
        np.testing.assert_allclose(h, 100, atol=2)

    def test_second_order(self, tmp_path):
        errors = []
        for count in (21, 41, 81):
            lon, lat = np.linspace(4.9, 5.4, count), np.linspace(59.9, 60.3, count)
            x, y = np.meshgrid(lon, lat)
            h = bed_of(gebco(lon, lat, -200 - 100 * np.sin(20 * x) * np.cos(30 * y)), tmp_path, cells=(90, 70))
            x, y = centres(BED_FRAME, 15000.0, 12000.0, (90, 70))
            errors.append(np.sqrt(((h - 200 - 100 * np.sin(20 * x) * np.cos(30 * y)) ** 2).mean()))
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert (abs(orders - 2) < 0.2).all(), orders

    def test_netcdf_3_with_scipy(self, tmp_path):
        """The classic format, in which parts of the GEBCO grid come."""
        path = tmp_path / "classic.nc"
        sloping().to_netcdf(path, engine="scipy")
        h = read_bathymetry(path, BED_FRAME, 15000.0, 12000.0, (100, 80))
        np.testing.assert_array_equal(h, bed_of(sloping(), tmp_path))


def test_example(tmp_path, capsys):
    """The example draws what a mission would read."""
    currents, bed = write(cmems(), tmp_path / "currents.nc"), write(sloping(), tmp_path / "bed.nc")
    main = runpy.run_path(str(Path(__file__).parents[3] / "examples" / "real_water.py"))["main"]
    main([str(bed), str(currents), "5.02", "60.03", "--out", str(tmp_path / "water.png")])
    assert (tmp_path / "water.png").read_bytes()[:4] == b"\x89PNG"
    assert "depth -44.0 to 58.7 m, current up to 0.34 m/s" in capsys.readouterr().out
