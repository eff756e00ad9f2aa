"""Files of waves that must be refused, and in what words: one line with file, variable and value."""

import numpy as np
import pytest

from tests.usvauv_env.ocean_files import cmems
from tests.usvauv_env.test_ocean_refusals import attributes, curvilinear, put, values, without
from tests.usvauv_env.wave_files import era5, fields, partitions, waves_of, ww3
from usvauv.env.netcdf import remote
from usvauv.env.site.cf import OceanError
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.waves import read_waves

STORM = (5.0, 11.0, 90.0, 10)
PARTS = (4.0, 9.0, 270.0, 30.0)


def everywhere(number):
    return lambda array: np.full_like(array, number)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (attributes("efth", units=None), "efth: has no units; allowed: m2 s rad-1"),
        (attributes("efth", units="m2 s"), "efth: units 'm2 s'; allowed: m2 s rad-1"),
        (attributes("frequency", units="rad s-1"), "frequency: units 'rad s-1'; allowed: s-1, hz"),
        (attributes("direction", units="radian"), "direction: units 'radian'; allowed: degree"),
        (attributes("direction", standard_name=None), "direction: its standard_name must say which way"),
        (values("efth", everywhere(np.nan)), "efth: has no values at the area: land"),
        (
            values("efth", put((0, 0, 3, 5), np.nan)),
            r"efth: a value is missing at 0.0466 Hz, direction 5; all must be given",
        ),
        (values("efth", put((0, 0, 3, 5), -0.5)), r"efth: -0.5; allowed: 0 to 100000: see its units"),
        (values("efth", put((0, 0, 3, 5), np.inf)), r"efth: inf; allowed: 0 to 100000: see its units"),
        (values("efth", everywhere(0.0)), "efth: significant height 0 m; allowed: above 0, up to 30 m"),
        (values("efth", lambda efth: 1000 * efth), r"efth: significant height 158.\d* m; allowed: above 0, up to 30"),
        (
            values("frequency", lambda f: f[::-1]),
            r"frequency: 0.6107, 0.5552, 0.5047, ..., 0.035; allowed: three or more, rising",
        ),
        (
            values("frequency", put(0, np.nan)),
            r"frequency: nan, 0.0385, 0.04235, ..., 0.6107; allowed: three or more, rising, 0 to 10 Hz",
        ),
        (values("direction", put(0, 93.0)), r"direction: 93, 80, 70, ..., 100; allowed: four or more in even steps"),
        (values("direction", lambda way: way / 2), "direction: .*; allowed: four or more in even steps round"),
        (values("longitude", everywhere(np.nan)), "longitude, latitude: no station has a position"),
        (
            values("latitude", everywhere(58.0)),
            r"station 0 at 5.020, 58.000 degrees is 224 km from the area, at 5.018, 60.009; allowed: up to 50 km",
        ),
        (without("longitude"), "efth: has no longitude; stations, or a grid|has no longitude"),
        (values("time", everywhere(9000.0)), "time: is not in order"),
        (attributes("time", calendar="360_day"), "time: calendar '360_day'; allowed: standard"),
        (values("wnd", everywhere(900.0)), "wnd: 900 m/s; allowed: 0 to 60 m/s"),
        (without("efth"), "no waves: neither a spectrum .* nor a height of waves .*phs0"),
    ],
)
def test_spectra_of_wavewatch(change, said, tmp_path):
    with pytest.raises(OceanError, match=f"waves.nc: {said}") as refused:
        waves_of(change(ww3(STORM)), tmp_path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            values("d2fd", lambda log: np.minimum(10**log, 9.0) / 3),
            "d2fd: at least .* everywhere; allowed: decadic logarithms of the density",
        ),
        (values("d2fd", put((0, 3, 5, 1, 1), 7.0)), "d2fd: 7; allowed: decadic logarithms up to 5"),
        (values("d2fd", everywhere(np.nan)), "d2fd: has no values at the area: land"),
        (
            values("direction", lambda n: 15 * n),
            r"direction: 15, 30, 45, ..., 360; allowed: ERA5's numbers 1, 2, ..., 24",
        ),
        (lambda dataset: dataset.isel(direction=slice(12)), "direction: .*; allowed: ERA5's numbers 1, 2, ..., 24"),
        (
            values("frequency", lambda n: n + 1),
            r"frequency: 2, 3, 4, ..., 31; allowed: ERA5's numbers 1, 2, ..., up to 30",
        ),
        (without("frequency"), "frequency: has no values; a coordinate must give them"),
        (curvilinear, r"d2fd: lies on a curvilinear grid \(nav_lon has dimensions y, x\)"),
        (
            lambda dataset: dataset.isel(longitude=slice(2)),
            "longitude: the middle of the area is at 5.01793 degrees and the file spans 4.50000 to 5.00000",
        ),
        (
            lambda dataset: dataset.isel(longitude=[0], latitude=[0]),
            "its point at 4.500, 60.500 degrees is 62 km from the area",
        ),
    ],
)
def test_spectra_of_era5(change, said, tmp_path):
    with pytest.raises(OceanError, match=f"waves.nc: {said}") as refused:
        waves_of(change(era5(STORM)), tmp_path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (attributes("phs0", units="cm"), "phs0: units 'cm'; allowed: m, meter"),
        (attributes("ptp0", units="Hz"), "ptp0: units 'Hz'; allowed: s, sec"),
        (attributes("pspr0", units="percent"), "pspr0: units 'percent'; allowed: degree"),
        (without("ptp0"), "has phs0 but no ptp0"),
        (without("pdir0"), "has phs0 but no pdir0"),
        (values("phs0", everywhere(-3.0)), "phs0: -3; allowed: 0 to 30: see its units and fill"),
        (values("ptp0", everywhere(90.0)), "ptp0: 90; allowed: 0.5 to 30"),
        (values("ptp0", everywhere(np.nan)), "ptp0: is missing where phs0 is 4 m"),
        (values("pspr0", everywhere(120.0)), "pspr0: 2.09.*; allowed: 0 to 1.41"),
        (values("phs0", everywhere(np.nan)), "phs0: has no values at the area: land, calm"),
        (values("phs0", everywhere(np.inf)), "phs0: inf; allowed: 0 to 30"),
        (curvilinear, r"phs0: lies on a curvilinear grid \(nav_lon has dimensions y, x\)"),
    ],
)
def test_partitions(change, said, tmp_path):
    with pytest.raises(OceanError, match=f"waves.nc: {said}") as refused:
        waves_of(change(partitions(PARTS)), tmp_path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("make", "name", "most", "more"),
    [
        (lambda: ww3(STORM), "wnd", 60.0, 60.1),
        (lambda: partitions(PARTS), "phs0", 30.0, 30.1),
        (lambda: partitions(PARTS), "ptp0", 30.0, 30.1),
        (lambda: partitions(PARTS), "ptp0", 0.5, 0.4),
        (lambda: partitions(PARTS), "pdir0", 720.0, 721.0),
        (lambda: partitions(PARTS), "pdir0", -360.0, -361.0),
    ],
)
def test_up_to_the_bound_and_no_further(make, name, most, more, tmp_path):
    waves_of(values(name, everywhere(most))(make()), tmp_path)
    with pytest.raises(OceanError, match=f"waves.nc: {name}: .*; allowed: "):
        waves_of(values(name, everywhere(more))(make()), tmp_path)


@pytest.mark.parametrize(("name", "least"), [("frequency", 3), ("direction", 4)])
def test_as_few_as_allowed_and_no_fewer(name, least, tmp_path):
    def some(count):
        dataset = ww3((5.0, 11.0, 90.0, 1))
        step = dataset.sizes[name] // count if name == "direction" else 1  # which must go round the circle
        return dataset.isel({name: slice(0, count * step, step)})

    waves_of(some(least), tmp_path)
    with pytest.raises(OceanError, match=f"waves.nc: {name}: .*; allowed: "):
        waves_of(some(least - 1), tmp_path)


def test_frequencies_up_to_ten_hertz(tmp_path):
    def up_to(highest):
        return values("frequency", put(-1, highest))(ww3(STORM))

    waves_of(up_to(10.0), tmp_path)
    with pytest.raises(OceanError, match=r"frequency: .*, ..., 10.01; allowed: three or more, rising, 0 to 10 Hz"):
        waves_of(up_to(10.01), tmp_path)


@pytest.mark.parametrize("make", [lambda: ww3(STORM), lambda: partitions(PARTS, hours=(1_100_000.0, 1_100_006.0))])
@pytest.mark.parametrize("start", ["2014-08-22T23:00:00", "2026-01-01"])
def test_times_that_the_file_does_not_have(make, start, tmp_path):
    with pytest.raises(OceanError, match=r"waves.nc: time: the mission lasts from .* and the file from .*; it must"):
        waves_of(make(), tmp_path, start)


def test_one_time_that_is_not_the_start(tmp_path):
    with pytest.raises(OceanError, match=r"has one time, .*; start = '2014-08-23' must be that or left empty"):
        waves_of(era5(STORM), tmp_path, "2014-08-23")


def test_files_without_waves(tmp_path):
    with pytest.raises(OceanError, match="no waves: neither a spectrum"):
        waves_of(cmems(), tmp_path)
    with pytest.raises(OceanError, match=r"missing.nc: cannot be read: No such file"):
        read_waves(tmp_path / "missing.nc", LocalFrame(5.0, 60.0), 100.0, 100.0)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_damaged_file(share, tmp_path, monkeypatch):
    monkeypatch.setattr(remote, "PATIENCE", 5.0)
    path = tmp_path / "waves.nc"
    ww3(STORM).to_netcdf(path, engine="h5netcdf")
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(OceanError, match=r"waves.nc: .*(cannot be read|damaged)") as refused:
        read_waves(path, LocalFrame(5.0, 60.0), 2000.0, 2000.0)
    assert "\n" not in str(refused.value)


def test_mixed_units_of_era5(tmp_path):
    names, units = ("shww", "mpww", "mdww"), ("m", "hours", "degrees")
    with pytest.raises(OceanError, match="mpww: units 'hours'; allowed: s"):
        waves_of(fields(names, units, (3.0, 8.0, 225.0)), tmp_path)
