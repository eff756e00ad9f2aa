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
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from tests.usvauv_env.ocean_files import cmems, eastward, northward, write
from usvauv.cli import app
from usvauv.cli.commands import sea as sea_command
from usvauv.cli.commands.sea import sink
from usvauv.cli.sea_view import figure
from usvauv.cli.sea_view.figure import measured, spectrum, target_spectrum, wanted
from usvauv.cli.sea_view.surface import LevelSurface, Section
from usvauv.cli.sea_view.video import Block, SeaPainter, SeaVideo
from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.render import style
from usvauv.env.render.figure_theme import log_ticks
from usvauv.env.render.layout import Layout, MapView, Rectangle
from usvauv.env.sea.build import build_sea, build_short_waves
from usvauv.env.sea.netcdf import SeaFile
from usvauv.env.sea.simulation import SeaSimulation, cells, survey
from usvauv.env.sea.storm import cumulative
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.site import Site
from usvauv.env.world.water import first_vortices

STEADY = ["current.mutual=false", "current.viscosity=0"]
STILL = ["storm.spectrum=none", "sea.irregular_rms=0", "sea.start_rms=0", "current.count=0"]


def run(monkeypatch, folder, *arguments: object) -> int:
    """Run `usvauv sea` in this process; returns its exit code."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["usvauv", "sea", *map(str, arguments)])
    return app.run()


def sets(overrides: list[str]) -> list[str]:
    return [part for override in overrides for part in ("--set", override)]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Path of 5 s of `extreme`, seed 3, on 8 m cells, an elongated area, and its scenario."""
    folder, overrides = tmp_path_factory.mktemp("sea"), ["area.length=240", *STEADY]
    with pytest.MonkeyPatch.context() as monkeypatch:
        code = run(
            monkeypatch, folder, "--duration", 5, "--resolution", 8, "--out", "a.nc", "--seed", 3, *sets(overrides)
        )
    assert code == 0
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

    def test_current_is_that_of_the_world(self, data):
        path, scenario = data
        world = World(scenario, 1, 3)
        world.reset()
        with xarray.open_dataset(path, engine="h5netcdf") as file:
            x, y = np.meshgrid(file.x, file.y)
            expected = np.zeros((2, *x.shape))
            for x0, y0, circulation, radius in world.vortex[0].cpu().double().numpy():
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
            assert file["elevation"].compression == "gzip"
            assert file["elevation"].chunks == (1, 30, 25)

    def test_lies_on_its_own_input(self, tmp_path, monkeypatch):
        """Read by xarray alone: the current at the file's longitudes, latitudes and times."""
        currents, frame = write(cmems(), tmp_path / "currents.nc"), LocalFrame(5.01, 60.01)
        place = ["area.width=4000", "area.length=3000", "water.longitude=5.01", "water.latitude=60.01"]
        given = [*place, "sea.cell_size=100", f"water.currents={currents}", "water.start=1950-01-01T03:00:00"]
        out = ("--duration", 4, "--resolution", 500, "--interval", 2, "--out", "a.nc")
        assert run(monkeypatch, tmp_path, "ideal", *out, *sets(given)) == 0
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

    def test_a_seed_is_a_sea(self, tmp_path, monkeypatch):
        for name, seed in (("a", 1), ("b", 1), ("c", 2)):
            out = tmp_path / f"{name}.nc"
            assert run(monkeypatch, tmp_path, "--duration", 2, "--resolution", 20, "--seed", seed, "--out", out) == 0
        a, b, c = (xarray.load_dataset(tmp_path / f"{name}.nc", engine="h5netcdf") for name in "abc")
        assert a.equals(b)
        assert not np.allclose(a.elevation, c.elevation, atol=0.1)
        assert not np.allclose(a.current_x, c.current_x, atol=0.01)

    def test_appears_only_when_it_is_whole(self, tmp_path):
        path, sea = tmp_path / "a.nc", SeaSimulation(Scenario.load("extreme"), 0, (10, 10), 1.0)
        path.write_bytes(b"older")

        def write(fail: bool) -> None:
            with SeaFile(path, sea) as file:
                file.add(sea)
                assert path.read_bytes() == b"older"
                if fail:
                    raise RuntimeError

        with pytest.raises(RuntimeError):
            write(fail=True)
        assert path.read_bytes() == b"older"
        assert [entry.name for entry in tmp_path.iterdir()] == ["a.nc"]
        write(fail=False)
        assert xarray.load_dataset(path, engine="h5netcdf").sizes["time"] == 1

    def test_size_is_foretold(self, tmp_path):
        sea = SeaSimulation(Scenario.load("extreme"), 0, (64, 64), 1.0)
        with SeaFile(tmp_path / "a.nc", sea) as file:
            for record in range(40):
                if record:
                    sea.advance()
                file.add(sea)
                if record == 4:
                    expected = file.expected_bytes(40)
        assert (tmp_path / "a.nc").stat().st_size == pytest.approx(expected, rel=0.2)


class TestSeaSimulation:
    @pytest.mark.slow
    def test_vortices_that_change_are_those_of_the_world(self, tmp_path):
        scenario = Scenario.load("extreme", ["current.mutual=true", "current.viscosity=2", "sea.realisations=1"])
        world = World(scenario, 1, 5, "hold:0,0")
        world.reset()
        sea = SeaSimulation(scenario, 5, (10, 10), 1.0, first_vortices(scenario, 5))
        with SeaFile(tmp_path / "a.nc", sea) as file:
            for _ in range(4):
                np.testing.assert_allclose(sea.vortices, world.vortex[0].cpu(), rtol=1e-6)
                file.add(sea)
                sea.advance()
                world.step(torch.zeros(1, 2, 2))
        current = xarray.load_dataset(tmp_path / "a.nc", engine="h5netcdf").current_x
        assert current.dims == ("time", "y", "x")
        assert abs(current[0] - current[3]).max() > 1e-3

    def test_land_has_no_storm_and_its_colour(self, monkeypatch):
        def still_depth(_, shape):
            return np.where(np.arange(shape[0]) < shape[0] // 2, -3.0, 50.0) * np.ones((shape[1], 1))

        monkeypatch.setattr(Site, "still_depth", still_depth)
        scenario = Scenario.load("extreme", ["area.depth=50", "auv.depth=40"])
        sea = SeaSimulation(scenario, 0, (20, 20), 1.0)
        assert not sea.surface().storm[:, :10].any()
        assert sea.surface().storm[:, 10:].all()
        painter = SeaPainter(sea, survey(scenario, 0, 2), 2, (640, 360), 30)
        frame = painter.frame(sea)
        box = painter.layout.map
        assert (painter.layout.map.of(frame)[5, box.width // 4] == style.LAND).all()
        assert (painter.layout.map.of(frame)[5, 3 * box.width // 4] != style.LAND).any()

    def test_real_current_is_added(self, monkeypatch):
        class Flow:
            times = np.array([0.0, 10.0])

            def at(self, t: float) -> np.ndarray:
                y, x = np.mgrid[0:3, 0:4]
                return np.stack([np.stack([x + t, 10.0 * y], -1)] * 2).astype(np.float32)

        monkeypatch.setattr(Site, "current", Flow())
        sea = SeaSimulation(Scenario.load("extreme"), 0, (8, 8), 2.0)
        sea.advance()
        np.testing.assert_allclose(sea.current()[..., 0], np.broadcast_to(3 * sea.x / 200 + 2, (8, 8)), rtol=1e-6)
        np.testing.assert_allclose(sea.current()[..., 1].T, np.broadcast_to(20 * sea.y / 200, (8, 8)), rtol=1e-6)
        assert not sea.steady

    def test_resolution(self):
        scenario = Scenario.load("extreme", ["area.width=400"])
        assert cells(scenario, None) == (512, 256)
        assert cells(scenario, 10) == (40, 20)
        for limit in (0.0489, 79.6):
            assert 3 <= min(cells(scenario, limit)) <= max(cells(scenario, limit)) <= 8192
        for beyond in (0.0487, 80.1, -1.0, math.nan, math.inf, 0.0):
            with pytest.raises(ScenarioError, match=r"from 0\.0489 to 79\.6 m"):
                cells(scenario, beyond)


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    folder = tmp_path_factory.mktemp("video")
    options = ["--size", "481x320", "--fps", 10, "--duration", 1.4, "--resolution", 8, "--out", "a.mp4"]
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert run(monkeypatch, folder, *options) == 0
    assert [path.name for path in folder.iterdir()] == ["a.mp4"]
    return folder / "a.mp4"


class TestVideo:
    def test_is_what_was_asked(self, video):
        with av.open(str(video)) as file:
            stream = file.streams.video[0]
            codec = stream.codec_context
            assert (codec.name, codec.pix_fmt, codec.width, codec.height) == ("h264", "yuv420p", 480, 320)
            assert stream.average_rate == 10
            assert sum(1 for _ in file.decode(stream)) == 8  # each 0.2 s from 0 to 1.4 s: twice as fast as it happens
            assert file.duration / 1e6 == pytest.approx(0.8)

    def painter(self, *overrides: str, size=(1280, 720)) -> tuple[SeaPainter, SeaSimulation]:
        scenario = Scenario.load("extreme", overrides)
        sea = SeaSimulation(scenario, 0, (50, 50), 0.5, first_vortices(scenario, 0))
        return SeaPainter(sea, survey(scenario, 0, 5), 11, size, 30), sea

    def test_map_is_bright_where_the_sea_is_high(self):
        painter, sea = self.painter("current.count=0")
        frame = painter.frame(sea)
        box = painter.layout.map
        seen = cv2.resize(box.of(frame), (50, 50), interpolation=cv2.INTER_AREA).mean(axis=-1)[::-1]
        assert np.corrcoef(seen.ravel(), sea.surface().elevation.ravel())[0, 1] > 0.6

    def test_figures(self):
        painter, sea = self.painter(*STEADY)
        painter.frame(sea)
        first = sea.surface()
        sea.advance()
        painter.frame(sea)
        both = [first, sea.surface()]
        said = {name: float(value.replace("−", "-")) for name, value in painter.figures(0.0)}
        assert said["highest, m"] == pytest.approx(max(s.elevation.max() for s in both), abs=0.006)
        assert said["lowest, m"] == pytest.approx(min(s.elevation.min() for s in both), abs=0.006)
        assert said["storm Hs, m"] == pytest.approx(4 * np.sqrt(np.mean([s.storm**2 for s in both])), abs=0.006)
        assert said["current to, m/s"] == pytest.approx(np.hypot(*np.moveaxis(sea.current(), -1, 0)).max(), abs=0.006)

    def test_plots_grow_with_time(self):
        painter, sea = self.painter()
        box = painter._level_plot.box
        shown = []
        for _ in range(3):
            frame = painter.frame(sea)
            drawn = (np.abs(box.of(frame).astype(int) - style.SEA[4]).max(axis=-1) < 30).any(axis=0)
            shown.append(np.flatnonzero(drawn).max(initial=0))
            sea.advance()
        assert shown[0] < shown[1] < shown[2]
        assert shown[2] == pytest.approx(0.2 * box.width, abs=4)  # 1 s of 5 s

    @pytest.mark.parametrize(
        ("size", "overrides"),
        [
            ((320, 320), STILL),
            ((1920, 400), ["area.width=2000", "area.length=100"]),
            ((360, 640), ["storm.spectrum=none"]),
            ((1280, 720), ["sea.irregular_rms=0", "sea.start_rms=0", "storm.direction=1.2"]),
        ],
    )
    def test_any_sea_in_any_shape(self, size, overrides):
        painter, sea = self.painter(*overrides, size=size)
        for _ in range(2):
            frame = painter.frame(sea)
            sea.advance()
        assert frame.shape == (size[1], size[0], 3)
        assert frame.std() > 5

    def test_size_is_foretold(self, tmp_path):
        scenario = Scenario.load("extreme")
        sea = SeaSimulation(scenario, 0, (50, 50), 1 / 15)
        with SeaVideo(tmp_path / "a.mp4", sea, survey(scenario, 0, 4), 60, (640, 360), 30) as film:
            for _ in range(60):
                film.add(sea)
                sea.advance()
            expected = film.expected_bytes(60)
        assert (tmp_path / "a.mp4").stat().st_size == pytest.approx(expected, rel=0.5)


class TestSectionAndBlock:
    def test_section_runs_with_the_waves(self):
        section = Section(Site(Scenario.load("extreme", ["area.width=400", "storm.direction=0.3"])))
        way = section.ends[1] - section.ends[0]
        assert math.atan2(way[1], way[0]) == pytest.approx(0.3)
        assert section.ends.mean(axis=0) == pytest.approx([200, 100])
        assert section.ends[:, 0] == pytest.approx([0, 400])
        x, y = np.meshgrid((np.arange(80) + 0.5) * 5, (np.arange(40) + 0.5) * 5)
        level = section.along((0.01 * x + 0.02 * y).astype(np.float32))
        np.testing.assert_allclose(level[5:-5], (section.points @ (0.01, 0.02))[5:-5], atol=0.03)

    def test_without_a_storm_it_follows_the_waves_from_the_forced_edge(self):
        overrides = ["storm.spectrum=none", "sea.forced_edge=north", "area.width=400"]
        section = Section(Site(Scenario.load("extreme", overrides)))
        np.testing.assert_allclose(section.direction, (0, -1), atol=1e-9)
        np.testing.assert_allclose(section.ends, [(200, 0), (200, 200)], atol=1e-9)

    @pytest.mark.parametrize(
        ("direction", "words"),
        [
            (0.0, "A (west) to B (east)"),
            (math.pi, "A (west) to B (east)"),
            (math.pi / 2, "A (south) to B (north)"),
            (-math.pi / 2, "A (south) to B (north)"),
            (2.3, "A (north-west) to B (south-east)"),
            (-2.3, "A (south-west) to B (north-east)"),
            (-1.5, "A (north) to B (south)"),
        ],
    )
    def test_it_runs_as_the_map_does_whichever_way_the_waves_go(self, direction, words):
        section = Section(Site(Scenario.load("extreme", [f"storm.direction={direction}"])))
        (ax, ay), (bx, by) = section.ends
        assert bx > ax + 1e-6 or (bx == pytest.approx(ax, abs=1e-6) and by > ay)
        assert section.direction == pytest.approx((math.cos(direction), math.sin(direction)))
        assert section.words == words

    def test_block_shows_a_hill_where_it_is_and_above_the_level(self):
        scenario = Scenario.load("extreme")
        layout, room = Layout.fit(1280, 720, scenario.area), Rectangle(0, 0, 600, 300)
        y, x = np.mgrid[0:100, 0:100]
        hill = 12 * np.exp(-((x - 30) ** 2 + (y - 60) ** 2) / 200).astype(np.float32)
        block = Block(scenario.area, room, layout, hill[None], 12.0)
        relief = np.full((100, 100, 3), 60, np.uint8)
        relief[38:41, 29:32] = (0, 0, 255)  # its top; the north is on top
        picture = np.zeros((300, 600, 3), np.uint8)
        block.draw(picture, hill, relief, Section(Site(scenario)))
        red = np.argwhere((picture[..., 2] > 200) & (picture[..., 0] < 60))
        top, foot = block._project(np.array([(61.0 - 100, 121.0 - 100)] * 2), np.array([12.0, 0.0]))
        assert red.mean(axis=0)[::-1] == pytest.approx(top, abs=2)
        assert foot[1] - top[1] > 15


class TestFigure:
    @pytest.mark.parametrize("name", ["a.png", "b.PDF", "c.svg"])
    def test_is_drawn(self, tmp_path, monkeypatch, name):
        options = ["--duration", 12, "--resolution", 10, "--out", name]
        assert run(monkeypatch, tmp_path, *options) == 0
        assert [path.name for path in tmp_path.iterdir()] == [name]
        start = (tmp_path / name).read_bytes()[:100]
        assert {"a.png": b"PNG", "b.PDF": b"%PDF", "c.svg": b"<?xml"}[name] in start
        if name == "a.png":
            picture = cv2.imread(str(tmp_path / name))
            assert picture.shape == (1350, 2040, 3)
            assert picture.std() > 20

    def test_spectrum_keeps_the_variance(self):
        time = np.arange(0, 400, 0.5)
        waves = np.stack([2 * np.cos(2 * np.pi * 0.1 * time + phase) for phase in range(5)], axis=1)
        frequency, density = spectrum(waves, 0.5, 100.0)
        assert frequency[density.argmax()] == pytest.approx(0.1, abs=0.006)
        assert density.sum() * frequency[0] == pytest.approx(2.0, rel=0.02)

    def test_spectrum_of_the_storm_is_its_target(self):
        scenario = Scenario.load("extreme", ["sea.irregular_rms=0", "sea.start_rms=0", "sea.fine_cells=16"])
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


class TestMeasured:
    STEP = 0.5

    def records(self, *waves):
        """Elevation and slopes (T, P, 3) of waves of amplitude (m), period (s) and direction (rad), along x and y."""
        place = np.random.default_rng(0).uniform(0, 200, (50, 2))
        time, records = self.STEP * np.arange(1200), np.zeros((1200, 50, 3))
        for amplitude, period, direction in waves:
            k = 0.03 * np.array([math.cos(direction), math.sin(direction)])
            phase = (place @ k)[None] - 2 * math.pi / period * time[:, None]
            records += np.stack([np.cos(phase), -k[0] * np.sin(phase), -k[1] * np.sin(phase)], -1) * amplitude
        return records

    def test_one_wave_has_no_spread(self):
        found = measured(self.records((1.5, 10.0, 2.0)), self.STEP, 120.0)
        assert found.height == pytest.approx(4 * 1.5 / math.sqrt(2), rel=0.01)
        assert found.period == pytest.approx(10.0, rel=0.01)
        assert found.spread == pytest.approx(0.0, abs=0.02)

    @pytest.mark.parametrize("half", [0.3, 1.0])
    def test_two_crossing_waves_have_the_spread_of_their_angle(self, half):
        """The first moment of two directions ±α is cos α; periods differ a little, so that phases do not matter."""
        crossing = self.records((1.0, 10.0, 0.7 + half), (1.0, 10.2, 0.7 - half))
        found = measured(crossing, self.STEP, 120.0)
        assert found.spread == pytest.approx(math.sqrt(2 * (1 - math.cos(half))), rel=0.05)

    @pytest.mark.parametrize("spreading", [2, 10, 50])
    def test_a_storm_is_as_it_is_wanted(self, spreading):
        scenario = Scenario.load("extreme", [f"storm.spreading={spreading}"])
        waves, place = build_short_waves(Site(scenario), [(1, 0)]), np.linspace(10, 190, 8)
        x, y = (axis.ravel() for axis in np.meshgrid(place, place))
        k = waves.k[0] * np.array([np.cos(waves.direction[0]), np.sin(waves.direction[0])])  # (2, N)
        here = waves.amplitude[0] * np.exp(1j * (np.stack([x, y], 1) @ k + waves.phase[0]))
        turned = np.exp(-1j * np.outer(self.STEP * np.arange(1800), waves.omega[0]))
        found = measured(
            np.stack([(turned @ (part * here).T).real for part in (1, 1j * k[0], 1j * k[1])], -1), self.STEP, 132.0
        )
        goal = wanted(scenario.storm.systems)
        assert (goal.height, goal.period) == (6.5, 11.0)
        for name, tolerance in {"height": 0.1, "period": 0.1, "spread": 0.15}.items():
            assert getattr(found, name) == pytest.approx(getattr(goal, name), rel=tolerance), name


class TestColours:
    VIEW = MapView(Scenario.load("extreme").area, Rectangle(0, 0, 200, 200))

    def surface(self, level, height):
        x, t = np.linspace(0, 20, 60), np.linspace(0, 10, 9)
        sample = (level + height * np.sin(x[None, None] + t[:, None, None])).repeat(60, 1).astype(np.float32)
        return LevelSurface(sample, self.VIEW, sample), sample

    def test_are_about_the_level_of_a_calm_sea_and_not_steeper_than_decimetres(self):
        surface, sample = self.surface(5.0, 0.02)
        assert (surface.level, surface.limit) == (5.0, 0.3)
        middle = np.abs(surface.relief(np.full_like(sample[0], 5.0)).astype(int) - style.SEA[2]).max()
        assert middle <= 2  # mid-blue, as the mean level is

    def test_are_about_zero_where_the_level_is_small_beside_the_waves(self):
        assert self.surface(0.5, 4.0)[0].level == 0.0
        assert self.surface(2.0, 4.0)[0].level == 2.0

    def test_a_level_sea_says_so(self):
        assert self.surface(5.0, 0.0)[0].stillness == "level at η = 5 m"
        assert self.surface(0.0, 0.0)[0].stillness == "still: neither long waves nor a storm"
        assert self.surface(5.0, 0.02)[0].stillness == ""


@pytest.mark.parametrize(("low", "high"), [(0.01, 0.4), (0.08, 0.42), (0.11, 0.19), (1.02, 1.9), (3e-4, 30)])
def test_a_logarithmic_axis_has_several_ticks(low, high):
    axes = Figure().add_subplot()
    axes.set(xscale="log", xlim=(low, high))
    log_ticks(axes.xaxis)
    assert len(axes.get_xticks()) >= 3
    assert low <= min(axes.get_xticks()) < max(axes.get_xticks()) <= high


@pytest.mark.parametrize(
    "changes",
    [
        [],
        ["storm.direction=1.2"],
        ["storm.spectrum=none", "sea.irregular_rms=0.5"],
        [*STILL, "sea.regular_amplitude=5", "sea.forced_edge=east"],
    ],
    ids=["storm", "across", "long waves", "tide"],
)
def test_nothing_stands_over_the_curves_of_a_figure(tmp_path, monkeypatch, changes):
    drawn = []
    monkeypatch.setattr(figure, "save", lambda made, path: drawn.append(made))
    options = ["--duration", 12, "--resolution", 10, "--out", "a.png", *sets(changes)]
    assert run(monkeypatch, tmp_path, *options) == 2  # nothing is saved
    (made,) = drawn
    FigureCanvasAgg(made).draw()
    boxes = [axes.get_window_extent() for axes in made.axes]
    for axes in made.axes:
        words = [axes._left_title] + ([axes.get_legend()] if axes.get_legend() else [])
        words = [each.get_window_extent() for each in words if not isinstance(each, Text) or each.get_text()]
        assert not any(box.shrunk(0.99, 0.98).overlaps(own) for own in words for box in boxes)
        below = [other.xaxis.label.get_window_extent() for other in made.axes if other.get_xlabel()]
        assert not any(own.overlaps(label) for own in words for label in below)
    about = made.texts[2].get_text()
    assert ("Hs" in about) == ("storm.spectrum=none" not in changes)
    assert made.texts[0].get_text().endswith("is level at η = 5 m") == ("sea.regular_amplitude=5" in changes)


@pytest.mark.parametrize("name", ["a.mp4", "a.nc", "a.png"])
def test_still_sea(tmp_path, monkeypatch, capsys, name):
    options = ["ideal", "--duration", 1, "--resolution", 20, "--interval", 0.5, "--out", name]
    assert run(monkeypatch, tmp_path, *options) == 0
    assert (tmp_path / name).stat().st_size > 5000
    said = capsys.readouterr().out
    for part in ("10 × 10 cells of 20 m", "1 s in 2 steps of 0.5 s", "expect about", name):
        assert part in said


@pytest.mark.parametrize("name", ["a.mp4", "a.nc", "a.png"])
def test_ctrl_c_before_the_first_record_leaves_nothing(tmp_path, monkeypatch, capsys, name):
    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        return sink(*arguments)

    monkeypatch.setattr(sea_command, "sink", interrupted)
    options = ["ideal", "--duration", 1, "--resolution", 20, "--interval", 0.5, "--out", name]
    assert run(monkeypatch, tmp_path, *options) == 130
    assert capsys.readouterr().err == "stopped\n"
    assert list(tmp_path.iterdir()) == []


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
        (["--out", "missing/a.nc"], ["missing/a.nc", "does not exist"]),
        (["--out", "folder.nc"], ["folder.nc", "is a folder"]),
        (["--resolution", "90"], ["resolution 90 m", "79.6 m"]),
        (["--resolution", "0.001"], ["resolution 0.001 m", "0.0245"]),
        (["--duration", "-1"], ["--duration -1", "at least"]),
        (["--duration", "nan"], ["--duration nan", "at least"]),
        (["--duration", "1", "--interval", "2"], ["--duration 1", "--interval, 2 s"]),
        (["--interval", "0"], ["--interval 0", "at least"]),
        (["--fps", "0"], ["--fps 0", "at least"]),
        (["--size", "9x9"], ["--size", "9x9"]),
        (["--fps", "10", "--out", "a.nc"], ["--fps 10", "a.nc"]),
        (["--seed", "-1"], ["seed = -1"]),
        (["extrem"], ["extrem", "paper-ideal"]),
        (["--set", "storm.height=2"], ["storm.height", "unknown field"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, monkeypatch, capsys, arguments, parts):
    (tmp_path / "folder.nc").mkdir()
    assert run(monkeypatch, tmp_path, *arguments) == 2
    said = capsys.readouterr()
    assert said.err.startswith("error: ")
    assert said.err.count("\n") == 1
    for part in parts:
        assert part in said.err
    assert not said.out
    assert [path.name for path in tmp_path.iterdir()] == ["folder.nc"]
