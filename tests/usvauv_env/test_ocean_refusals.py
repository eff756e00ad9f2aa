"""Files of real water that must be refused, and in what words."""

import h5netcdf
import numpy as np
import pytest

from tests.usvauv_env.ocean_files import BED_FRAME, HOURS, LATITUDES, LONGITUDES, bed_of, cmems, flow_of, sloping, write
from usvauv.env.netcdf import remote
from usvauv.env.site.cf import OceanError
from usvauv.env.site.ocean import read_bathymetry


def attributes(name, **new):
    """A change to a dataset: other attributes of one variable; None takes one away."""

    def change(dataset):
        kept = {key: value for key, value in (dataset[name].attrs | new).items() if value is not None}
        dataset[name].attrs = kept
        return dataset

    return change


def values(name, number):
    """A change to a dataset: other values of one variable, whose attributes stay."""

    def change(dataset):
        variable = dataset[name]
        new = (variable.dims, number(variable.values.copy()), variable.attrs)
        return dataset.assign_coords({name: new}) if name in dataset.coords else dataset.assign({name: new})

    return change


def put(index, number):
    def change(array):
        array[index] = number
        return array

    return change


def without(*names):
    return lambda dataset: dataset.drop_vars(names)


def second(name, source):
    return lambda dataset: dataset.assign({name: dataset[source]})


def curvilinear(dataset):
    lon, lat = np.meshgrid(dataset["longitude"], dataset["latitude"])
    dataset = dataset.rename(longitude="x", latitude="y").drop_vars(["x", "y"])
    return dataset.assign_coords(
        nav_lon=(("y", "x"), lon, {"units": "degrees_east"}), nav_lat=(("y", "x"), lat, {"units": "degrees_north"})
    )


def station(dataset):
    """Points along a line: longitude and latitude on one dimension."""
    dataset = dataset.isel(longitude=0, drop=True).rename(latitude="point")
    return dataset.assign_coords(point=np.arange(10)).assign_coords(
        lon=("point", LONGITUDES, {"units": "degrees_east"}), lat=("point", LATITUDES, {"units": "degrees_north"})
    )


CURRENTS = {  # what is wrong: the change that makes it so, and what the message says of it
    "no currents": (
        without("uo", "vo"),
        r"no variables with the standard_name of a current: eastward_sea_water_vel.*, the names uo with vo or water_u",
    ),
    "wind by a name of currents": (
        lambda d: attributes("uo", standard_name="eastward_wind")(attributes("vo", standard_name="northward_wind")(d)),
        r"no variables with the standard_name of a current",
    ),
    "one component by its name": (
        lambda d: without("vo")(attributes("uo", standard_name=None)(d)),
        r"no variables with the standard_name of a current",
    ),
    "one component": (without("vo"), r"has uo but no variable with standard_name northward_sea_water_velocity"),
    "two of a kind": (second("utotal", "uo"), r"uo and utotal both are eastward_sea_water_velocity; the file must"),
    "no units": (attributes("uo", units=None), r"uo: has no units; allowed: m s-1, m/s, "),
    "units of speed": (attributes("vo", units="furlong"), r"vo: units 'furlong'; allowed: m s-1, m/s, .*knots"),
    "too fast": (values("uo", put((0, 0, 4, 4), 32.767)), r"uo: 32.767 m/s; allowed: up to 20 m/s: see its units"),
    "no longitude": (without("longitude"), r"uo: dimension 'longitude' has no coordinate that is a longitude, lat"),
    "no latitude": (lambda d: d.isel(latitude=4, drop=True), r"uo: has no latitude coordinate; .* 'degrees_north'"),
    "no depth": (lambda d: d.isel(depth=0, drop=True), r"uo: has no depth coordinate; it must say how deep"),
    "one longitude": (lambda d: d.isel(longitude=[3]), r"longitude: has one value, 5; at least two are needed"),
    "grid of a projection": (
        attributes("longitude", standard_name="projection_x_coordinate", units="m"),
        r"uo: dimension 'longitude' has no coordinate that is a longitude, latitude, depth or time by its sta",
    ),
    "curvilinear": (curvilinear, r"uo: lies on a curvilinear grid \(nav_l.. has dimensions y, x\); .*`cdo remapbil"),
    "stations": (station, r"uo: lon and lat are both coordinates of one dimension; one is allowed"),
    "ensemble": (
        lambda d: d.expand_dims(member=3).rename(member="number"),
        r"uo: dimension 'number' has no coordinate that is a longitude",
    ),
    "unordered latitude": (
        values("latitude", put(5, 59.0)),
        r"latitude: is not in order: 59.0 follows 60.08\d+; values must rise or fall throughout",
    ),
    "repeated longitude": (values("longitude", put(1, LONGITUDES[0])), r"longitude: is not in order: 4.75 is repeated"),
    "unordered time": (
        values("time", put(2, 1.0)),
        r"time: is not in order: 1950-01-01T01:00:00.* follows 1950-01-01T06",
    ),
    "unordered depth": (values("depth", put(2, 1.0)), r"depth: is not in order: 1.0 follows 1.541; values must"),
    "missing latitude": (values("latitude", put(2, np.nan)), r"latitude: value 2 is missing; all must be given"),
    "latitude in radians": (
        attributes("latitude", units="radian"),
        r"latitude: units 'radian'; allowed: degrees_north",
    ),
    "longitude without units": (attributes("longitude", units=None), r"longitude: units None; allowed: degrees_east"),
    "latitude of 95": (values("latitude", lambda v: v + 35), r"latitude: 95.5 degrees; allowed: -90 to 90"),
    "depth in dbar": (attributes("depth", units="dbar"), r"depth: units 'dbar'; allowed: m, "),
    "depth above": (attributes("depth", positive="up"), r"depth: 130.666 with positive 'up' is above the surface"),
    "depth sideways": (attributes("depth", positive="left"), r"depth: its attribute positive is 'left'; allowed: 'up'"),
    "sigma levels": (attributes("depth", standard_name="ocean_sigma_coordinate"), r"dimension 'depth' has no coord"),
    "calendar": (
        attributes("time", calendar="360_day"),
        r"time: calendar '360_day'; allowed: standard, gregorian, pro",
    ),
    "units of time": (attributes("time", units="hours"), r"time: units 'hours'; allowed: such as 'hours since 2000-01"),
    "date of time": (
        attributes("time", units="hours since launch"),
        r"time: units 'hours since launch'; allowed: such",
    ),
    "text as time": (
        lambda d: d.assign_coords(time=("time", list("abcd"), {"axis": "T"})),
        r"time: is not numeric but",
    ),
    "too far west": (
        lambda d: d.isel(longitude=slice(4, None)),
        r"longitude: the area spans 5.02000 to 5.16\d+ degrees and the file 5.08333 to 5.50000; its points must",
    ),
    "too far east": (
        values("longitude", lambda v: v + 350),
        r"longitude: the area spans 365.02000 to 365.16\d+ degrees and the file 354.75000 to 355.50000; ",
    ),
    "other side of the Earth": (values("longitude", lambda v: v + 180), r"and the file 184.75000 to 185.50000; "),
    "too far north": (
        lambda d: d.isel(latitude=slice(None, 4)),
        r"latitude: the area spans 60.02\d+ to 60.08\d+ degrees and the file 59.75000 to 60.00000; its points must",
    ),
    "too shallow": (
        lambda d: d.isel(depth=slice(None, 2)),
        r"depth: currents are needed at 100 m and the file's depths are 0.494 to 1.541 m; they serve from 0 to 2.06",
    ),
    "surface only": (lambda d: d.isel(depth=[0]), r"needed at 100 m .* 0.494 to 0.494 m; they serve from 0 to 0.494 m"),
    "too deep": (
        lambda d: d.isel(depth=slice(2, None)),
        r"depth: currents are needed at 0.494 m and the file's depths are 92.326 to 130.666 m; they serve from 92.326",
    ),
    "all land": (
        lambda d: d.where(d["longitude"] > 5.3),
        r"uo: has no values in the area at a depth of 0.494 m at 1950-01-01T00:00:00: all of it is land",
    ),
    "below the bed": (lambda d: d.where(d["depth"] < 50), r"uo: has no values in the area at a depth of 100 m at 1950"),
    "gap": (
        lambda d: d.where(d["time"] != HOURS[1]),
        r"uo: has no values in the area at a depth of 0.494 m at 1950-01-01T06:00:00: .* or the data have a gap",
    ),
    "other times": (
        lambda d: d.assign(vo=d["vo"].rename(time="t").assign_coords(t=("t", HOURS + 1, d["time"].attrs))),
        r"uo and vo are given at different times",
    ),
}

TIMES = {  # what is asked for, and what the message says of it
    "before": (
        {"start": "1949-12-31T23:00"},
        r"time: the mission lasts from 1949-12-31T23:00:00 to 1950-01-01T01:00:00 and the file from "
        r"1950-01-01T00:00:00 to 1950-01-01T18:00:00; it must enclose the mission",
    ),
    "after": (
        {"start": "1950-01-01T17:00"},
        r"time: the mission lasts from 1950-01-01T17:00:00 to 1950-01-01T19:00:00",
    ),
    "too long": ({"duration": 1e5}, r"time: the mission lasts from 1950-01-01T00:00:00 to 1950-01-02T03:46:40 and the"),
    "no date": ({"start": "tomorrow"}, r"start = 'tomorrow'; allowed: ISO 8601, such as 2026-01-31T06:00:00"),
}

BEDS = {
    "none": (
        lambda d: attributes("elevation", standard_name="surface_temperature")(d).rename(elevation="topography"),
        r"no variable with the standard_name of a bathymetry: sea_floor_depth_below_sea_surface, ",
    ),
    "two": (
        lambda d: d.assign(deptho=(d["elevation"].dims, -d["elevation"].values, {"standard_name": "sea_floor_depth"})),
        r"elevation and deptho both are height_above_mean_sea_level or sea_floor_depth; the file must hold one of them",
    ),
    "no units": (attributes("elevation", units=None), r"elevation: has no units; allowed: m, "),
    "units": (attributes("elevation", units="fathom"), r"elevation: units 'fathom'; allowed: m, .*km"),
    "moving": (
        lambda d: d.expand_dims(time=2).assign_coords(time=("time", [0.0, 1.0], {"units": "days since 2020-01-01"})),
        r"elevation: changes with time; the bed must not",
    ),
    "land": (
        values("elevation", lambda v: v + 3000),
        r"elevation: no water in the area: depths from -[\d.]+ to -[\d.]+ m",
    ),
    "missing": (values("elevation", lambda v: v * np.nan), r"elevation: has no values in the area: all of it is land"),
    "fill": (
        values("elevation", put((50, 50), -32768)),
        r"elevation: 32768 m deep; allowed: up to 12000 m: see its uni",
    ),
    "elsewhere": (
        values("lat", lambda v: v - 20),
        r"lat: the area spans 59.99\d+ to 60.1\d+ degrees and the file 39.9",
    ),
}


class TestRefusals:
    def refused(self, match, read, *arguments, **asked):
        with pytest.raises(OceanError, match=match) as caught:
            read(*arguments, **asked)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    @pytest.mark.parametrize("wrong", CURRENTS)
    def test_currents(self, tmp_path, wrong):
        change, match = CURRENTS[wrong]
        message = self.refused(match, flow_of, change(cmems()), tmp_path)
        assert message.startswith(f"{tmp_path / 'currents.nc'}: ")

    @pytest.mark.parametrize("wrong", TIMES)
    def test_times(self, tmp_path, wrong):
        asked, match = TIMES[wrong]
        self.refused(match, flow_of, cmems(), tmp_path, **asked)

    def test_start_in_a_steady_file(self, tmp_path):
        one = cmems(hours=HOURS[:1])
        match = r"has one time, 1950-01-01T00:00:00; start = '1950-01-02' must be that or left empty"
        self.refused(match, flow_of, one, tmp_path, start="1950-01-02")
        match = r"uo: has no time coordinate; start = '1950-01-02' must be left empty"
        self.refused(match, flow_of, one.isel(time=0, drop=True), tmp_path, start="1950-01-02")

    @pytest.mark.parametrize("wrong", BEDS)
    def test_bathymetry(self, tmp_path, wrong):
        change, match = BEDS[wrong]
        message = self.refused(match, bed_of, change(sloping()), tmp_path)
        assert message.startswith(f"{tmp_path / 'bed.nc'}: ")


class TestFiles:
    def read(self, path, match):
        with pytest.raises(OceanError, match=match) as caught:
            read_bathymetry(path, BED_FRAME, 15000.0, 12000.0, (10, 10))
        assert str(caught.value).startswith(f"{path}: ")

    def test_refusals(self, tmp_path):
        self.read(tmp_path / "none.nc", r"cannot be read: No such file or directory")
        self.read(tmp_path, r"cannot be read: Is a directory")
        page = tmp_path / "page.nc"
        page.write_text("<html>Log in first</html>")
        self.read(page, r"not a NetCDF file")
        whole = write(sloping(), tmp_path / "whole.nc").read_bytes()
        (tmp_path / "half.nc").write_bytes(whole[: len(whole) // 2])
        self.read(tmp_path / "half.nc", r"cannot be read: .*truncated")

    def test_damaged_values(self, tmp_path):
        """Compressed values that cannot be expanded are found only when they are read."""
        path = write(sloping(), tmp_path / "bed.nc", elevation={"zlib": True, "chunksizes": (96, 120)})
        with h5netcdf.File(path) as file:
            place = file["elevation"]._h5ds.id.get_chunk_info(0)
        with path.open("r+b") as file:
            file.seek(place.byte_offset)
            file.write(b"\xff" * place.size)
        self.read(path, r"damaged: ")

    def test_netcdf_3_without_scipy(self, tmp_path, monkeypatch):
        path = tmp_path / "classic.nc"
        path.write_bytes(b"CDF\x02" + bytes(100))
        monkeypatch.setattr(remote.importlib.util, "find_spec", lambda name: None)
        self.read(path, r"a NetCDF-3 file, which needs SciPy \(pip install scipy\) or converting with `nccopy -k nc4`")
        path.write_bytes(b"CDF\x05" + bytes(100))
        self.read(path, r"a NetCDF-3 file, which needs converting with `nccopy -k nc4`")
