"""Files of real water and waves that must be refused, and in what words: one line with file, variable and value."""

from contextlib import nullcontext

import h5netcdf
import numpy as np
import pytest
import xarray

from tests.usvauv_env.site.ocean_files import (
    BED_FRAME,
    FRAME,
    HOURS,
    LENGTH,
    LEVELS,
    WIDTH,
    cmems,
    flow_of,
    sloping,
    write,
)
from tests.usvauv_env.site.wave_files import SIZE, era5, partitions, waves_of, ww3
from usvauv.env.site import ocean, waves
from usvauv.env.site.ocean import read_bathymetry, read_flow
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.waves import read_waves
from usvauv.env.storage.netcdf import OceanError

STORM = (5.0, 11.0, 90.0, 10)
PARTS = (4.0, 9.0, 270.0, 30.0)


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


def curvilinear(dataset):
    lon, lat = np.meshgrid(dataset["longitude"], dataset["latitude"])
    dataset = dataset.rename(longitude="x", latitude="y").drop_vars(["x", "y"])
    return dataset.assign_coords(
        nav_lon=(("y", "x"), lon, {"units": "degrees_east"}), nav_lat=(("y", "x"), lat, {"units": "degrees_north"})
    )


def forecasts(dataset):
    """One time and the steps from it, each with its own."""
    steps = xarray.concat([dataset, dataset], "step")
    return steps.assign_coords(valid_time=("step", [1_100_000.0, 1_100_003.0], dataset["time"].attrs))


def everywhere(number):
    return lambda array: np.full_like(array, number)


CURRENTS = {  # what is wrong: the change that makes it so, and what the message says of it
    "no currents": (
        without("uo", "vo"),
        r"no variables with the standard_name of a current: eastward_sea_water_vel.*, the names uo with vo or water_u",
    ),
    "one component": (without("vo"), r"has uo but no variable with standard_name northward_sea_water_velocity"),
    "no units": (attributes("uo", units=None), r"uo: has no units; allowed: m s-1, m/s, "),
    "too fast": (values("uo", put((0, 0, 4, 4), 32.767)), r"uo: 32.767 m/s; allowed: up to 20 m/s: see its units"),
    "no longitude": (without("longitude"), r"uo: dimension 'longitude' has no coordinate that is a longitude, lat"),
    "no depth": (lambda d: d.isel(depth=0, drop=True), r"uo: has no depth coordinate; it must say how deep"),
    "curvilinear": (curvilinear, r"uo: lies on a curvilinear grid \(nav_l.. has dimensions y, x\); .*`cdo remapbil"),
    "units of time": (attributes("time", units="hours"), r"time: units 'hours'; allowed: such as 'hours since 2000-01"),
    "too far west": (
        lambda d: d.isel(longitude=slice(4, None)),
        r"longitude: the area spans 5.02000 to 5.16\d+ degrees and the file 5.08333 to 5.50000; its points must",
    ),
    "too shallow": (
        lambda d: d.isel(depth=slice(None, 2)),
        r"depth: currents are needed at 100 m and the file's depths are 0.494 to 1.541 m; they serve from 0 to 2.06",
    ),
    "all land": (
        lambda d: d.where(d["longitude"] > 5.3),
        r"uo: has no values in the area at a depth of 0.494 m at 1950-01-01T00:00:00: all of it is land",
    ),
    "gap": (
        lambda d: d.where(d["time"] != HOURS[1]),
        r"uo: has no values in the area at a depth of 0.494 m at 1950-01-01T06:00:00: .* or the data have a gap",
    ),
    "other times": (
        lambda d: d.assign(vo=d["vo"].rename(time="t").assign_coords(t=("t", HOURS + 1, d["time"].attrs))),
        r"uo and vo are given at different times",
    ),
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
    "moving": (
        lambda d: d.expand_dims(time=2).assign_coords(time=("time", [0.0, 1.0], {"units": "days since 2020-01-01"})),
        r"elevation: changes with time; the bed must not",
    ),
    "land": (
        values("elevation", lambda v: v + 3000),
        r"elevation: no water in the area: depths from -[\d.]+ to -[\d.]+ m",
    ),
    "fill": (
        values("elevation", put((50, 50), -32768)),
        r"elevation: 32768 m deep; allowed: up to 12000 m: see its uni",
    ),
}

WAVEWATCH = [
    (values("efth", everywhere(np.nan)), "efth: has no values at the area: land"),
    (
        values("efth", put((0, 0, 3, 5), np.nan)),
        r"efth: a value is missing at 0.0466 Hz, direction 5; all must be given",
    ),
    (values("efth", lambda efth: 1000 * efth), r"efth: significant height 158.\d* m; allowed: above 0, up to 30"),
    (values("direction", put(0, 93.0)), r"direction: 93, 80, 70, ..., 100; allowed: four or more in even steps"),
    (
        values("latitude", everywhere(58.0)),
        r"station 0 at 5.020, 58.000 degrees is 224 km from the area, at 5.018, 60.009; allowed: up to 50 km",
    ),
    (without("efth"), "no waves: neither a spectrum .* nor a height of waves .*phs0"),
]

ERA5 = [
    (
        values("d2fd", lambda log: np.minimum(10**log, 9.0) / 3),
        "d2fd: at least .* everywhere; allowed: decadic logarithms of the density",
    ),
    (values("d2fd", np.nan_to_num), "d2fd: 0 in .*% of its values, a density of 1; where there is none, one is miss"),
    (
        values("direction", lambda n: 15 * n),
        r"direction: 15, 30, 45, ..., 360; allowed: ERA5's numbers 1, 2, ..., 24",
    ),
    (
        lambda dataset: dataset.isel(longitude=slice(2)),
        "longitude: the middle of the area is at 5.01793 degrees and the file spans 4.50000 to 5.00000",
    ),
    (
        lambda dataset: dataset.isel(longitude=[0], latitude=[0]),
        "its point at 4.500, 60.500 degrees is 62 km from the area",
    ),
]

PARTITIONS = [
    (without("ptp0"), "has phs0 but no ptp0"),
    (values("ptp0", everywhere(np.nan)), "ptp0: is missing where phs0 is 4 m"),
    (values("pspr0", everywhere(120.0)), "pspr0: 2.09.*; allowed: 0 to 1.41"),
    (forecasts, "phs0: has a dimension 'step' beside those of its place and time"),
]

CORNER = LocalFrame(5.0, 60.0)
KINDS = {  # a dataset that serves, what reads it, and what is refused
    "currents": (cmems, lambda **asked: read_flow("a.nc", FRAME, WIDTH, LENGTH, LEVELS, **asked), CURRENTS.values()),
    "bed": (sloping, lambda: read_bathymetry("a.nc", BED_FRAME, 15000.0, 12000.0, (100, 80)), BEDS.values()),
    "WAVEWATCH III": (lambda: ww3(STORM), lambda: read_waves("a.nc", CORNER, SIZE, SIZE), WAVEWATCH),
    "ERA5": (lambda: era5(STORM), lambda: read_waves("a.nc", CORNER, SIZE, SIZE), ERA5),
    "partitions": (lambda: partitions(PARTS), lambda: read_waves("a.nc", CORNER, SIZE, SIZE), PARTITIONS),
}


def refused(said, read, *arguments, **asked):
    with pytest.raises(OceanError, match=said) as caught:
        read(*arguments, **asked)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.fixture
def opened(monkeypatch):
    """Function that puts a dataset in the place of every file."""

    def put_in_place(dataset):
        decoded = xarray.decode_cf(dataset, decode_times=False)
        for module in (ocean, waves):
            monkeypatch.setattr(module, "open_decoded", lambda path: nullcontext(decoded))

    return put_in_place


@pytest.mark.parametrize(
    ("kind", "change", "said"), [(kind, *row) for kind, (*_, rows) in KINDS.items() for row in rows]
)
def test_datasets(opened, kind, change, said):
    make, read, _ = KINDS[kind]
    opened(change(make()))
    asked = {"duration": 7200.0} if kind == "currents" else {}
    assert refused(said, read, **asked).startswith("a.nc: ")


def test_a_mission_must_lie_in_the_times_of_the_file(opened):
    opened(cmems())
    said = r"time: the mission lasts from 1949-12-31T23:00:00 to .* it must enclose the mission"
    refused(said, KINDS["currents"][1], duration=7200.0, start="1949-12-31T23:00")
    refused(r"start = 'tomorrow'; allowed: ISO 8601, such as", KINDS["currents"][1], duration=7200.0, start="tomorrow")


def test_start_in_a_steady_file(tmp_path):
    one = cmems(hours=HOURS[:1])
    said = r"has one time, 1950-01-01T00:00:00; start = '1950-01-02' must be that or left empty"
    refused(said, flow_of, one, tmp_path, start="1950-01-02")
    said = r"uo: has no time coordinate; start = '1950-01-02' must be left empty"
    refused(said, flow_of, one.isel(time=0, drop=True), tmp_path, start="1950-01-02")
    refused(r"has one time, .*; start = '2014-08-23' must be that or", waves_of, era5(STORM), tmp_path, "2014-08-23")


class TestFiles:
    def read(self, path, match):
        with pytest.raises(OceanError, match=match) as caught:
            read_bathymetry(path, BED_FRAME, 15000.0, 12000.0, (10, 10))
        assert str(caught.value).startswith(f"{path}: ")

    def test_refusals(self, tmp_path):
        self.read(tmp_path / "none.nc", r"cannot be read: No such file or directory")
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
        self.read(path, r"elevation: cannot be read: ")
