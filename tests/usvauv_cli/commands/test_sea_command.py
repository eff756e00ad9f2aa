"""`usvauv sea`: what its files hold, that they are whole, and what it refuses."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
import tomllib

import av
import cv2
import h5py
import numpy as np
import pytest
import torch
import xarray

from tests.usvauv_env.site.ocean_files import cmems, eastward, northward, write
from usvauv.cli import app
from usvauv.cli.sea_view.figure import measured, spectrum, target_spectrum
from usvauv.env import Scenario, World
from usvauv.env.sea.long_waves import build_sea
from usvauv.env.sea.simulation import SeaSimulation
from usvauv.env.sea.storm import cumulative
from usvauv.env.sea.water import build_short_waves
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import first_vortices

STEADY = ["current.mutual=false", "current.viscosity=0"]


def sets(overrides: list[str]) -> list[str]:
    return [part for override in overrides for part in ("--set", override)]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Path of 5 s of `extreme`, seed 3, on 8 m cells, an elongated area, and its scenario."""
    folder, overrides = tmp_path_factory.mktemp("sea"), ["area.length=240", *STEADY]
    overrides += ["current.period=0", "current.decay_depth=0"]
    command = [
        "usvauv",
        "sea",
        "--duration",
        "5",
        "--resolution",
        "8",
        "--out",
        "a.nc",
        "--seed",
        "3",
        *sets(overrides),
    ]
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "argv", [*command, *sets(overrides)])
        assert app.run() == 0
    assert [path.name for path in folder.iterdir()] == ["a.nc"]
    return folder / "a.nc", Scenario.load("extreme", overrides)


class TestData:
    def test_is_the_sea_of_the_solvers(self, data):
        path, scenario = data
        long_waves = build_sea(Site(scenario), [(3, 0)], (25, 30))
        storm = build_short_waves(Site(scenario), [(3, 0)])
        with xarray.open_dataset(path, engine="h5netcdf") as file:
            assert file.elevation.dims == ("time", "y", "x")
            assert file.elevation.shape == (6, 30, 25)
            np.testing.assert_allclose(file.x, 4 + 8 * np.arange(25))
            np.testing.assert_allclose(file.y, 4 + 8 * np.arange(30))
            assert file.elevation.dtype == np.float32
            for n in range(6):
                if n:
                    long_waves.advance()
                storm.set_time(float(n))
                expected = long_waves.elevation()[0] + storm.elevation(0, file.x.values, file.y.values)
                np.testing.assert_allclose(file.elevation[n], expected, atol=1e-6)
                for name, velocity in zip("uv", long_waves.velocity(), strict=True):
                    np.testing.assert_allclose(file[name][n], velocity[0], atol=1e-6)
            assert float(abs(file.elevation).max()) > 2

    def test_current_is_that_of_the_vortices_of_a_mission(self, data):
        path, scenario = data
        with xarray.open_dataset(path, engine="h5netcdf") as file:
            x, y = np.meshgrid(file.x, file.y)
            expected = np.zeros((2, *x.shape))
            for x0, y0, circulation, radius in first_vortices(scenario, 3)[0].cpu().double().numpy():
                r2 = (x - x0) ** 2 + (y - y0) ** 2
                turn = circulation / (2 * np.pi * r2) * -np.expm1(-r2 / radius**2)
                expected += np.stack([-turn * (y - y0), turn * (x - x0)])
            np.testing.assert_allclose(file.current_x, expected[0], atol=1e-5)
            np.testing.assert_allclose(file.current_y, expected[1], atol=1e-5)

    def test_says_what_it_holds(self, data):
        path, scenario = data
        with xarray.open_dataset(path, engine="h5netcdf", decode_times=False) as file:
            assert file.attrs["Conventions"] == "CF-1.11"
            assert file.attrs["seed"] == "3"
            assert Scenario.from_dict(tomllib.loads(file.attrs["scenario"])) == scenario
            assert file.time.attrs["units"] == "s"  # no date
            assert not {"crs", "longitude", "latitude"} & set(file.variables)
            np.testing.assert_allclose(file.time, np.arange(6))
            standard = {
                name: file[name].attrs["standard_name"] for name in ("elevation", "u", "current_y", "x", "depth")
            }
            assert standard == {
                "elevation": "sea_surface_height_above_mean_sea_level",
                "u": "barotropic_sea_water_x_velocity",
                "current_y": "sea_water_y_velocity",
                "x": "projection_x_coordinate",
                "depth": "sea_floor_depth_below_mean_sea_level",
            }
            assert all(file[name].attrs["units"] in ("m", "m s-1") for name in file.data_vars if "bounds" not in name)
            np.testing.assert_allclose(file.y_bounds[1:, 0], file.y_bounds[:-1, 1])
            assert float(file.y_bounds[-1, 1]) == 240
            assert (file.depth == 120).all()
            words = " ".join(str(value) for value in file.attrs.values())
            assert str(path.parent) not in words

    def test_paraview_can_read_it(self, data):
        """Its reader takes no variable-length text, and an `axis` of x and y for longitude and latitude."""
        with h5py.File(data[0]) as file:
            for place in (file, *file.values()):
                for name, value in place.attrs.items():
                    text = h5py.check_string_dtype(value.dtype)
                    assert text is None or text.length is not None, name
            assert "axis" not in file["x"].attrs
            assert "axis" not in file["y"].attrs

    def test_lies_on_its_own_input(self, tmp_path, run_usvauv):
        """Read by xarray alone: the current at the file's longitudes, latitudes and times."""
        currents, frame = write(cmems(), tmp_path / "currents.nc"), LocalFrame(5.01, 60.01)
        place = ["area.width=4000", "area.length=3000", "water.longitude=5.01", "water.latitude=60.01"]
        given = [*place, "sea.cell_size=100", f"water.currents={currents}", "water.start=1950-01-01T03:00:00"]
        out = ("--duration", 4, "--resolution", 500, "--interval", 2, "--out", "a.nc")
        assert run_usvauv("sea", "ideal", *out, *sets(given))[0] == 0
        with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as file:
            assert file.time.values[2] == np.datetime64("1950-01-01T03:00:04")
            seconds = (file.time - np.datetime64("1950-01-01")) / np.timedelta64(1, "s")
            lon, lat = file.longitude, file.latitude
            expected = frame.to_plane(lon, lat, *(f(lon, lat, 0.494, seconds) for f in (eastward, northward)))
            for name, component in zip(("current_x", "current_y"), expected, strict=True):
                assert abs(file[name] - component).max() < 1e-5
                assert file[name].attrs["grid_mapping"] == "crs"
            x, y = frame.to_local(lon, lat)
            assert abs(x - file.x).max() < 1e-6
            assert abs(y - file.y).max() < 1e-6
            fields = [name for name in file.data_vars if name not in ("crs", "x_bounds", "y_bounds")]
            for name in (*fields, *file.coords):
                assert {"standard_name", "long_name"} <= set(file[name].attrs)
            assert all("units" in file[name].attrs for name in fields)


def test_its_vortices_are_those_of_a_mission():
    """From the beginning, as they spread and carry one another."""
    scenario = Scenario.load("extreme", ["boat.strategy=hold:100,100", "current.viscosity=0.1"])
    world = World(scenario, 1, 3)
    world.reset()
    sea = SeaSimulation(scenario, 3, (20, 20), scenario.mission.step, first_vortices(scenario, 3))
    begun = sea.vortices.copy()
    for _ in range(5):
        np.testing.assert_allclose(sea.vortices, world.vortex[0].cpu(), rtol=1e-6)
        sea.advance()
        world.step(torch.zeros(1, world.num_auvs, 2))
    assert (sea.vortices != begun)[:, [0, 1, 3]].all()


def test_land_has_neither_storm_nor_current(monkeypatch):
    def still_depth(_, shape):
        return np.where(np.arange(shape[0]) < shape[0] // 2, -3.0, 50.0) * np.ones((shape[1], 1))

    monkeypatch.setattr(Site, "still_depth", still_depth)
    scenario = Scenario.load("extreme", ["area.depth=50", "auv.depth=40"])
    sea = SeaSimulation(scenario, 0, (20, 20), 1.0, first_vortices(scenario, 0))
    for field in (sea.surface().storm, sea.current()):
        assert not field[:, :10].any()
        assert field[:, 10:].all()


def test_a_video_is_what_was_asked(tmp_path, run_usvauv):
    options = ["--size", "481x320", "--fps", 10, "--duration", 1.4, "--resolution", 8, "--out", "a.mp4"]
    assert run_usvauv("sea", *options)[0] == 0
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]
    with av.open(str(tmp_path / "a.mp4")) as file:
        stream = file.streams.video[0]
        codec = stream.codec_context
        assert (codec.name, codec.pix_fmt, codec.width, codec.height) == ("h264", "yuv420p", 480, 320)
        assert stream.average_rate == 10
        assert sum(1 for _ in file.decode(stream)) == 8  # each 0.2 s from 0 to 1.4 s: twice as fast as it happens
        assert file.duration / 1e6 == pytest.approx(0.8)


class TestFigure:
    @pytest.mark.parametrize("name", ["a.png", "b.PDF"])
    def test_is_drawn(self, tmp_path, run_usvauv, name):
        assert run_usvauv("sea", "--duration", 12, "--resolution", 10, "--out", name)[0] == 0
        assert [path.name for path in tmp_path.iterdir()] == [name]
        start = (tmp_path / name).read_bytes()[:100]
        assert {"a.png": b"PNG", "b.PDF": b"%PDF"}[name] in start
        if name == "a.png":
            picture = cv2.imread(str(tmp_path / name))
            assert picture.shape == (1350, 2040, 3)
            assert picture.std() > 20

    def test_spectrum_of_the_storm_is_its_target(self):
        scenario = Scenario.load("extreme", ["sea.irregular_rms=0", "sea.fine_cells=16"])
        sea = SeaSimulation(scenario, 1, (12, 12), 0.5)
        records = []
        for _ in range(1200):
            records.append(sea.surface().elevation.ravel())
            sea.advance()
        frequency, density = spectrum(np.array(records), 0.5, 130.0)
        f, target = target_spectrum(sea.site)
        assert 4 * math.sqrt(cumulative(f, target)[-1]) == pytest.approx(6.5)
        for low, high in ((0.07, 0.1), (0.1, 0.13), (0.13, 0.28)):
            band = (frequency >= low) & (frequency < high)
            energy = np.interp(np.linspace(low, high, 200), f, target).mean() * (high - low)
            assert density[band].sum() * frequency[0] == pytest.approx(energy, rel=0.35)


def test_two_crossing_waves_have_the_spread_of_their_angle():
    """The first moment of two directions ±1 is cos 1; periods differ a little, so that phases do not matter."""
    place = np.random.default_rng(0).uniform(0, 200, (50, 2))
    time, records = 0.5 * np.arange(1200), np.zeros((1200, 50, 3))
    for period, direction in ((10.0, 1.7), (10.2, -0.3)):
        k = 0.03 * np.array([math.cos(direction), math.sin(direction)])
        phase = (place @ k)[None] - 2 * math.pi / period * time[:, None]
        records += np.stack([np.cos(phase), -k[0] * np.sin(phase), -k[1] * np.sin(phase)], -1)
    found = measured(records, 0.5, 120.0)
    assert found.spread == pytest.approx(math.sqrt(2 * (1 - math.cos(1.0))), rel=0.05)
    assert found.period == pytest.approx(10.1, rel=0.01)


@pytest.mark.parametrize("name", ["a.mp4", "a.nc", "a.png"])
def test_still_sea(tmp_path, run_usvauv, name):
    code, said, _ = run_usvauv("sea", "ideal", "--duration", 1, "--resolution", 20, "--interval", 0.5, "--out", name)
    assert code == 0
    assert (tmp_path / name).stat().st_size > 5000
    for part in ("10 × 10 cells of 20 m", "1 s in 2 steps of 0.5 s", name):
        assert part in said


def test_ctrl_c_keeps_what_there_is(tmp_path):
    command = [sys.executable, "-c", "from usvauv.cli.app import main; main()", "sea", "--out", "a.nc"]
    options = ["--duration", "100000", "--resolution", "4"]
    with subprocess.Popen(
        [*command, *options], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline and sum(file.stat().st_size for file in tmp_path.iterdir()) < 500_000:
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        stdout, stderr = running.communicate(timeout=60)
    assert running.returncode == 130, stderr
    assert "the file holds that much" in stdout
    assert "Traceback" not in stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.nc"]
    with xarray.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as file:
        assert 5 < file.sizes["time"] < 100000
        assert np.isfinite(file.elevation).all()
        assert float(abs(file.elevation[-1]).max()) > 0.5


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--out", "a.gif"], ["--out a.gif", ".mp4, .nc, .png"]),
        (["--resolution", "90"], ["resolution 90 m", "79.6 m"]),
        (["--duration", "nan"], ["--duration nan", "from 0.1 to"]),
        (["--duration", "1e12"], ["--duration 1000000000000.0", "from 0.1 to 10000000"]),
        (["--duration", "1", "--interval", "2"], ["--duration 1", "--interval, 2 s"]),
        (["--fps", "10", "--out", "a.nc"], ["--fps 10", "a.nc"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, refused, arguments, parts):
    said = refused("sea", *arguments)
    assert [part for part in parts if part not in said] == []
    assert not list(tmp_path.iterdir())
