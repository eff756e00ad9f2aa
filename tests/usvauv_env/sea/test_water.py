"""Missions on real beds and currents from files, and on vortices that change."""

import math

import numpy as np
import pytest
import torch
import xarray

from tests.links import EVERY_STEP
from tests.usvauv_env.site.ocean_files import bed_depth, cmems, eastward, northward, sloping, write
from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.record.recorder import record
from usvauv.env.sea.long_waves import build_sea
from usvauv.env.sea.simulation import SeaSimulation
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import DataLink
from usvauv.kernels.flow import vortex, vortex_motion
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, NodeColumn
from usvauv.kernels.positioning import sonar
from usvauv.kernels.positioning.acoustic_link import shannon

PLACE = ["area.width=4000", "area.length=3000", "sea.cell_size=100", "water.longitude=5.01", "water.latitude=60.01"]
FRAME = LocalFrame(5.01, 60.01)


def head_for_targets(world: World, steps: int) -> None:
    observation = world.reset()
    for _ in range(steps):
        offset = observation[..., 2 * world.num_auvs - 2 : 2 * world.num_auvs]
        observation = world.step(offset / offset.norm(dim=-1, keepdim=True))[0]


@pytest.fixture
def currents(tmp_path):
    return write(cmems(), tmp_path / "currents.nc")


@pytest.fixture
def slope(tmp_path):
    return write(sloping(), tmp_path / "bed.nc")


class TestRealCurrent:
    def test_carries_auvs_and_boat(self, currents):
        """Linear in place, depth and time as the file's fields are, at the time since its first."""
        scenario = Scenario.load("ideal", [*PLACE, f"water.currents={currents}", "boat.top_speed=0.001"])
        world = World(scenario, 64, seed=1)
        head_for_targets(world, 30)
        boat = world.boat[:, 0, BoatColumn.span("x", "y")].double().numpy()
        water = world.boat[:, 0, BoatColumn.span("current_x", "current_y")].numpy()
        auv = world.auv[..., AuvColumn.span("x", "y")].double().numpy()
        for place, depth, found in ((boat, 0.0, water), (auv, 100.0, world.current().numpy())):
            lon, lat = FRAME.to_geographic(place[..., 0], place[..., 1])
            depth = max(depth, cmems().depth.values[0])
            east, north = (speed(lon, lat, depth, 30.0) for speed in (eastward, northward))
            expected = np.stack(FRAME.to_plane(lon, lat, east, north), axis=-1)
            np.testing.assert_allclose(found, expected, atol=2e-5)
        assert np.ptp(world.current().numpy()[..., 0]) > 1e-3

    def test_runs_on_at_the_end_of_the_file(self, currents):
        """Masked resets let the sea outlive the mission that the file was checked for."""
        short = ["mission.duration=10", f"water.currents={currents}"]
        world = World(Scenario.load("ideal", [*PLACE, *short]), 2, seed=1)
        world.reset()
        for _ in range(20):
            world.step(torch.zeros(2, 2, 2))
            world.reset(torch.tensor([True, False]))
        assert world.current().isfinite().all()

    def test_trace_lies_on_its_own_input(self, currents, tmp_path):
        """Read by xarray alone: the current at the file's longitudes, latitudes and times."""
        changes = [f"water.currents={currents}", "water.start=1950-01-01T03:00:00"]
        world = World(Scenario.load("ideal", [*PLACE, *changes]), 2, seed=1)
        trace = record(world, lambda observation: torch.zeros(2, 2, 2), "none", steps=3, surface=True)
        trace.save(tmp_path / "trace.nc")
        assert trace.start == "1950-01-01T03:00:00"
        with xarray.open_dataset(tmp_path / "trace.nc", engine="h5netcdf") as file:
            seconds = (file.stream_time - np.datetime64("1950-01-01")) / np.timedelta64(1, "s")
            lon, lat = file.stream_longitude, file.stream_latitude
            expected = [f(lon, lat, 100.0, seconds) for f in (eastward, northward)]
            expected = FRAME.to_plane(lon, lat, *expected)
            for axis in range(2):
                assert abs(file.stream[..., axis] - expected[axis]).max() < 1e-6
            assert file.time.values[-1] == np.datetime64("1950-01-01T03:00:03")
            x, y = FRAME.to_local(file.auv_longitude, file.auv_latitude)
            assert abs(x - file.auv_position[..., 0]).max() < 1e-3
            assert abs(y - file.auv_position[..., 1]).max() < 1e-3
            assert file.power.coords["auv_longitude"].attrs["units"] == "degrees_east"
            x, y = FRAME.to_local(file.longitude, file.latitude)
            assert abs(x - file.x).max() < 1e-6
            assert file.surface.attrs["grid_mapping"] == "crs"
            assert all({"long_name", "units"} & set(file[name].attrs) for name in file.variables)


class TestUniformCurrent:
    def test_carries_auvs_and_boat(self):
        """By its speed at the surface, at 100 m over a bed at 120 m by (20/120)^n of it; a trace and a sea show it."""
        flows = ["current.speed=0.5", "current.direction=2", "current.shear=0.2"]
        at_once = ["auv.speed_lag=0", "auv.speed_noise=0", "boat.top_speed=0.0001"]
        scenario = Scenario.load("ideal", [*flows, *at_once])
        world = World(scenario, 2, seed=1)
        world.reset()
        surface = 0.5 * np.array([math.cos(2), math.sin(2)])
        deep = surface * (20 / 120) ** 0.2
        place = AuvColumn.span("x", "y")
        auv, boat = world.auv[..., place].clone(), world.boat[..., BoatColumn.span("x", "y")].clone()
        world.step(torch.zeros(2, 2, 2))
        way = (world.auv[..., place] - auv - world.water_velocity()).numpy()
        np.testing.assert_allclose(way, np.broadcast_to(deep, way.shape), atol=2e-5)
        way = (world.boat[..., BoatColumn.span("x", "y")] - boat).numpy()
        np.testing.assert_allclose(way, np.broadcast_to(surface, way.shape), atol=2e-4)
        trace = record(world, lambda observation: torch.zeros(2, 2, 2), "none", steps=1)
        np.testing.assert_allclose(trace.stream_at(1.0), np.broadcast_to(deep, (2, 2, 2)), atol=1e-6)
        flow = SeaSimulation(scenario, 1, (4, 4), 1.0).current()
        np.testing.assert_allclose(flow, np.broadcast_to(surface, (4, 4, 2)), atol=1e-6)

    def test_carries_vortices_that_move(self):
        """With the mean of its profile, U/(1 + n) where they are alike at all depths; a pattern stays one."""
        calm, flowing = (
            World(Scenario.load("extreme", ["current.decay_depth=0", *more]), 5, seed=1)
            for more in ([], ["current.speed=0.6", "current.direction=2", "current.shear=0.2"])
        )
        for world in (calm, flowing):
            world.reset()
            for _ in range(20):
                world.step(torch.zeros(5, 2, 2))
        carried = 20 * 0.5 * torch.tensor([math.cos(2), math.sin(2)])
        away = flowing.vortex[..., :2] - calm.vortex[..., :2] - carried
        assert (away - 300 * (away / 300).round()).abs().max() < 0.02

    def test_a_file_has_a_profile_of_its_own(self, currents):
        with pytest.raises(ScenarioError, match=r"current.shear = 0.2: must be 0 with water.currents"):
            Scenario.load("ideal", [f"water.currents={currents}", "current.shear=0.2"])


class TestRealBed:
    def scenario(self, slope, *changes) -> Scenario:
        place = [
            "area.width=1500",
            "area.length=1000",
            "sea.cell_size=50",
            "water.longitude=4.95",
            "water.latitude=59.95",
        ]
        return Scenario.load("ideal", [*place, f"water.bathymetry={slope}", *changes])

    def test_bed_of_the_mission_and_of_the_sea(self, slope):
        site, frame = Site(self.scenario(slope)), LocalFrame(4.95, 59.95)
        field = site.bed[0, :, :, 0]
        x, y = np.meshgrid(np.linspace(0, 1500, field.shape[1]), np.linspace(0, 1000, field.shape[0]))
        np.testing.assert_allclose(field, bed_depth(*frame.to_geographic(x, y)), atol=0.01)
        sea = build_sea(site, [(0, 0)])
        x, y = np.meshgrid((np.arange(30) + 0.5) * 50, (np.arange(20) + 0.5) * 50)
        np.testing.assert_allclose(sea.depth, bed_depth(*frame.to_geographic(x, y)), atol=0.01)
        assert site.mean_depth == pytest.approx(sea.depth.mean(), abs=0.1)

    def test_nodes_lie_on_it(self, slope):
        """A service has the data rate of the slant range to a node on the bed."""
        frame = LocalFrame(4.95, 59.95)
        scenario = self.scenario(
            slope,
            *EVERY_STEP,
            "nodes.rate_law=shannon",
            "nodes.frequency=20000",
            "nodes.bandwidth=10000",
            "nodes.count=60",
            "auv.hover_radius=30",
            "nodes.margin=0",
        )
        world = World(scenario, 64, seed=3, targets="greedy")
        head_for_targets(world, 60)
        serving = world.auv[..., AuvColumn.hover] > 0
        assert serving.sum() > 5
        auv = world.auv[serving].double().numpy()
        world_index = serving.nonzero()[:, 0]
        node = world.node[world_index, auv[:, AuvColumn.target].astype(int)].double().numpy()
        away = np.hypot(*(node[:, [NodeColumn.x, NodeColumn.y]] - auv[:, [AuvColumn.x, AuvColumn.y]]).T)
        depth = bed_depth(*frame.to_geographic(node[:, NodeColumn.x], node[:, NodeColumn.y]))
        link, nodes = DataLink.of(Site(scenario)), scenario.nodes
        for distance, below, rate in zip(away, depth - 100, auv[:, AuvColumn.rate], strict=True):
            snr = link.level - sonar.path_loss(math.hypot(distance, below), link.spreading, link.absorption)
            assert rate == pytest.approx(1e-6 * shannon(nodes.bandwidth, 0.0, snr), rel=1e-3)
        assert np.ptp(depth) > 10

    def test_auvs_must_clear_it(self, slope):
        with pytest.raises(
            ScenarioError, match=r"auv.depth = 160: must be above the bed .*bed.nc has 1\d\d.\d m at x = 1500"
        ):
            World(self.scenario(slope, "auv.depth=160", "area.depth=200"), 1)

    def test_dry_land_in_the_nonlinear_sea(self, slope):
        """Over the file's shore: water at rest stays at rest and land stays dry."""
        place = ["water.longitude=5.05", "water.latitude=60.05", "area.width=5000", "area.length=5000"]
        sea = build_sea(Site(self.scenario(slope, *place, "sea.equations=nonlinear", "sea.cell_size=100")), [(0, 0)])
        before = sea.elevation()
        sea.advance()
        np.testing.assert_array_equal(sea.elevation(), before)
        assert (before > 1).any()
        assert (before == 0).any()


class TestVortices:
    def test_evolve_in_the_mission(self):
        scenario = Scenario.load("extreme", ["current.viscosity=0.1"])
        world = World(scenario, 5, seed=1)
        world.reset()
        expected = world.vortex.clone()
        assert (expected[..., :2] < 0).any()
        assert (expected[..., :2] > 200).any()
        eddies = vortex.Eddies(300.0, (100.0, 100.0), column=(1 + math.exp(-120 / 280)) / 2)
        evolve = vortex_motion.evolution(expected, 1.0, 0.1, True, eddies)
        for _ in range(20):
            evolve()
            world.step(torch.zeros(5, 2, 2))
        assert torch.equal(world.vortex, expected)

    def test_are_weaker_at_depth(self):
        """The AUVs' level has e^{−100/280} of the surface's speed, of the pattern with all its images."""
        world = World(Scenario.load("extreme", ["sea.irregular_rms=0"]), 2, seed=1)
        world.reset()
        flow = torch.zeros(2, 11, 11, 2)
        world.current_field(flow)
        at = torch.linspace(0, 200, 11)
        points = torch.stack(torch.meshgrid(at, at, indexing="xy"), -1).view(1, -1, 2).expand(2, -1, -1)
        surface = vortex.sample_current(world.vortex, points.contiguous(), 300.0).view(flow.shape)
        torch.testing.assert_close(flow, math.exp(-100 / 280) * surface, atol=1e-5, rtol=1e-4)

    def test_a_pattern_too_small_for_its_cores_is_refused(self):
        with pytest.raises(ScenarioError, match=r"current.period = 300: must be 0, or at least 375 m, 7.5 times"):
            Scenario.load("extreme", ["current.core_radius_max=50"])
