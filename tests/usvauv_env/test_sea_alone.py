"""The sea without vehicles: its grid, its clock, its vortices and currents, and the file that it is written to."""

import math

import h5py
import numpy as np
import pytest
import torch

from usvauv.env import Scenario, ScenarioError
from usvauv.env.scenario.sea import Water
from usvauv.env.sea import netcdf, simulation
from usvauv.env.sea.simulation import SeaSimulation, cells, survey
from usvauv.env.site.site import Site
from usvauv.env.world.water import first_vortices

WIDTH, LENGTH, SHAPE = 210.0, 100.0, (7, 5)  # cells of 30 × 20 m
WAVES = {"forced_edge": "west", "irregular_rms": 0.5}


@pytest.fixture
def vortices(device) -> torch.Tensor:
    return torch.tensor([[[90.0, 40.0, 30.0, 10.0], [110.0, 60.0, 30.0, 15.0]]], device=device)


def scenario(step: float = 1.0, **current: object) -> Scenario:
    return Scenario.from_dict(
        {
            "area": {"width": WIDTH, "length": LENGTH},
            "mission": {"step": step},
            "sea": WAVES,
            "storm": {"spectrum": "pm"},
            "current": current,
        }
    )


class Flow:
    """A current that is linear in x, y and time."""

    start = "2020-01-02T03:00:00"

    def __init__(self, *times: float) -> None:
        self.times = np.array(times)

    def at(self, t: float) -> np.ndarray:
        y, x = np.mgrid[0:3, 0:4] * np.array([LENGTH / 2, WIDTH / 3])[:, None, None]
        surface = np.stack([1 + 2e-3 * x + 3e-3 * y + t, -2 + 4e-3 * x - 5e-3 * y], -1)
        return np.stack([surface, 9 + surface]).astype(np.float32)


class TestGrid:
    def test_cells_fill_the_area(self):
        sea = SeaSimulation(scenario(), 0, SHAPE, 2.0)
        assert sea.spacing == (30.0, 20.0)
        assert sea.x.tolist() == [15.0 + 30 * i for i in range(7)]
        assert sea.y.tolist() == [10.0 + 20 * j for j in range(5)]
        assert sea.depth.shape == sea.wet.shape == sea.surface().elevation.shape == sea.velocity()[0].shape == (5, 7)
        assert sea.current().shape == (5, 7, 2)
        assert sea.long_waves.interval == sea.site.scenario.sea.update_interval == 2.0

    def test_fewest_and_most_cells(self):
        """Three along the shorter side and 8192 along the longer are allowed, one less or more is not."""
        area = scenario()
        assert cells(area, LENGTH / 3) == (6, 3)
        assert cells(area, WIDTH / 8192) == (8192, 3901)
        for spacing in (LENGTH / 2, WIDTH / 8193):
            with pytest.raises(ScenarioError, match=r"must be from 0\.0257 to 39\.8 m"):
                cells(area, spacing)

    def test_memory_is_asked_for_the_whole_view(self, monkeypatch):
        asked = []
        monkeypatch.setattr(simulation, "check_sea", lambda *given: asked.append(given))
        SeaSimulation(scenario(), 0, SHAPE, 3.0)
        ((looked_at, shape, seas, room),) = asked
        assert (looked_at.sea.update_interval, shape, seas) == (3.0, SHAPE, 1)
        assert room == simulation.VIEW_BYTES * 7 * 5

    @pytest.mark.parametrize("sides", [(400.0, 100.0), (100.0, 400.0), (2000.0, 40.0)])
    def test_survey_is_the_sea_on_few_cells(self, monkeypatch, sides):
        """The longer side has `SURVEY_CELLS`, the other as many as fit, at least three; from the start to the end."""
        monkeypatch.setattr(simulation, "SURVEY_MOMENTS", 2)
        area = Scenario.from_dict({"area": {"width": sides[0], "length": sides[1]}, "sea": WAVES})
        shape = tuple(max(3, round(simulation.SURVEY_CELLS * side / max(sides))) for side in sides)
        found = survey(area, 3, 10.0)
        sea = SeaSimulation(area, 3, shape, 5.0)
        for field in found:
            np.testing.assert_array_equal(field, sea.surface().elevation)
            sea.advance()
        assert len(found) == 3
        assert np.abs(found[2] - found[0]).max() > 1e-3


class TestClock:
    def test_long_waves_and_storm_keep_time(self):
        sea = SeaSimulation(scenario(), 4, SHAPE, 1.5)
        for number in range(3):
            assert sea.time == sea.storm.time == 1.5 * number
            assert sea.long_waves.time == pytest.approx(1.5 * number)
            found = sea.surface()
            np.testing.assert_allclose(found.storm, sea.storm.elevation(0, sea.x, sea.y), atol=1e-6)
            np.testing.assert_allclose(found.elevation - found.storm, sea.long_waves.elevation()[0], atol=1e-5)
            for own, solvers in zip(sea.velocity(), sea.long_waves.velocity(), strict=True):
                np.testing.assert_array_equal(own, solvers[0])
            sea.advance()

    @pytest.mark.parametrize("interval", [0.2, 0.5, 2.0, 2.6])
    def test_vortices_move_in_as_few_steps_as_are_no_longer_than_the_missions(self, monkeypatch, vortices, interval):
        steps = []
        monkeypatch.setattr(
            simulation.vortex, "evolution", lambda vortex, room, step, *eddies: lambda: steps.append((step, *eddies))
        )
        sea = SeaSimulation(scenario(0.5, viscosity=0.3, mutual=True), 0, SHAPE, interval, vortices)
        assert not steps
        sea.advance()
        assert sum(step for step, *_ in steps) == pytest.approx(interval)
        assert len(steps) - 1 < interval / 0.5 <= len(steps)
        assert set(steps) == {(steps[0][0], 0.3, True)}


class TestVortices:
    def test_cores_spread(self, vortices):
        """dδ²/dt = 4ν; what was given stays as it is."""
        sea = SeaSimulation(scenario(viscosity=0.7), 0, SHAPE, 1.6, vortices)
        given = vortices.cpu().numpy().copy()
        for _ in range(3):
            sea.advance()
        np.testing.assert_allclose(sea.vortices[:, 3] ** 2, np.array([100, 225]) + 4 * 0.7 * 4.8, rtol=1e-5)
        np.testing.assert_array_equal(sea.vortices[:, :3], given[0, :, :3])
        np.testing.assert_array_equal(vortices.cpu(), given)
        assert not sea.steady

    def test_a_pair_turns_about_its_middle(self, vortices):
        """At the rate Γ/(π d²)(1 − e^(−d²/(δ₁² + δ₂²))), d apart, of equal circulations."""
        sea = SeaSimulation(scenario(mutual=True), 0, SHAPE, 2.5, vortices)
        for _ in range(4):
            sea.advance()
        d2 = 20**2 + 20**2
        turned = math.pi / 4 + 10 * 30 / (math.pi * d2) * -math.expm1(-d2 / (100 + 225))
        expected = np.array([100.0, 50.0]) + math.sqrt(d2) / 2 * np.array([math.cos(turned), math.sin(turned)])
        np.testing.assert_allclose(sea.vortices[1, :2], expected, atol=1e-3)
        assert not sea.steady

    def test_that_neither_spread_nor_move_are_steady(self, vortices):
        sea = SeaSimulation(scenario(), 0, SHAPE, 1.0, vortices)
        sea.advance()
        np.testing.assert_array_equal(sea.vortices, vortices[0].cpu())
        assert sea.steady
        assert SeaSimulation(scenario(viscosity=1, mutual=True), 0, SHAPE, 1.0).steady  # has none

    def test_first_ones_are_drawn_from_the_seed(self):
        """As many as the scenario has, within the area; none without."""
        drawn = first_vortices(scenario(count=3, circulation_min=1, circulation_max=2), 5)
        assert drawn.shape == (1, 3, 4)
        assert (drawn[..., :2] >= 0).all()
        assert (drawn[..., 2].abs() >= 1).all()
        assert (drawn[..., 2].abs() <= 2).all()
        assert first_vortices(scenario(), 5).shape == (1, 0, 4)


class TestRealCurrent:
    def test_is_linear_between_its_points_and_stays_after_its_end(self, monkeypatch, vortices):
        """On a grid of 3 by 4 points, beside a vortex, on water and not on land."""
        monkeypatch.setattr(Site, "current", Flow(0.0, 3.0))
        depth = np.full((5, 7), 50.0)
        depth[0, 2] = depth[4, 6] = 0.0
        monkeypatch.setattr(Site, "still_depth", lambda _, cells: depth)
        sea = SeaSimulation(scenario(), 0, SHAPE, 2.0, vortices[:, :1])
        assert not sea.steady
        x, y = np.meshgrid(sea.x, sea.y)
        r2 = (x - 90) ** 2 + (y - 40) ** 2
        turn = 30 / (2 * math.pi * r2) * -np.expm1(-r2 / 100)
        for t in (0.0, 2.0, 3.0):
            u, v = 1 + 2e-3 * x + 3e-3 * y + t - turn * (y - 40), -2 + 4e-3 * x - 5e-3 * y + turn * (x - 90)
            np.testing.assert_allclose(sea.current(), np.stack([u, v], -1) * (depth > 0)[..., None], atol=1e-5)
            np.testing.assert_array_equal(sea.stream(), Flow().at(t)[0])
            sea.advance()

    def test_of_one_time_is_steady(self, monkeypatch):
        monkeypatch.setattr(Site, "current", Flow(0.0))
        sea = SeaSimulation(scenario(), 0, SHAPE, 2.0)
        assert sea.steady
        np.testing.assert_array_equal(sea.stream(), Flow().at(0.0)[0])

    def test_without_any_there_is_none(self):
        sea = SeaSimulation(scenario(), 0, SHAPE, 2.0)
        assert sea.stream().shape == (0, 0, 2)
        assert not sea.current().any()


class TestFile:
    def test_lies_on_its_grid_in_records(self, tmp_path, monkeypatch):
        monkeypatch.setattr(netcdf, "CHUNK", 6)
        monkeypatch.setattr(Site, "current", Flow(0.0, 100.0))
        sea, seen = SeaSimulation(scenario(), 2, SHAPE, 1.5), []
        with netcdf.SeaFile(tmp_path / "a.nc", sea) as file:
            head = file.expected_bytes(7)
            assert head == file.bytes
            for _ in range(3):
                file.add(sea)
                seen.append((sea.time, sea.surface().elevation, *sea.velocity(), *np.moveaxis(sea.current(), -1, 0)))
                sea.advance()
            size = file.expected_bytes(3)
            assert size == file.bytes > head
            assert file.expected_bytes(6) == head + 2 * (size - head)
        with h5py.File(tmp_path / "a.nc") as read:
            for name, expected in zip(
                ("time", "elevation", "u", "v", "current_x", "current_y"), zip(*seen, strict=True), strict=True
            ):
                np.testing.assert_array_equal(read[name], np.stack(expected))
                assert name == "time" or read[name].chunks == (1, 5, 6)
            assert read["depth"].shape == (5, 7)
            for name, side, count in (("x", WIDTH, 7), ("y", LENGTH, 5)):
                edges = np.linspace(0, side, count + 1)
                np.testing.assert_allclose(read[f"{name}_bounds"], np.stack([edges[:-1], edges[1:]], 1))
                np.testing.assert_allclose(read[name], (edges[:-1] + edges[1:]) / 2)
            assert "eastward" in read["u"].attrs["long_name"].decode()
            assert "northward" in read["current_y"].attrs["long_name"].decode()

    def test_has_its_place_on_the_earth(self, tmp_path):
        """And its date, where the scenario has one."""
        water = {"longitude": 5.2, "latitude": 60.1, "start": "2021-03-04T05:06:07"}
        sea = SeaSimulation(scenario().model_copy(update={"water": Water(**water)}), 2, SHAPE, 1.5)
        with netcdf.SeaFile(tmp_path / "a.nc", sea) as file:
            file.add(sea)
        with h5py.File(tmp_path / "a.nc") as read:
            x, y = np.meshgrid(sea.x, sea.y)
            for name, expected in zip(("longitude", "latitude"), sea.site.frame.to_geographic(x, y), strict=True):
                np.testing.assert_array_equal(read[name], expected)
            assert read["time"].attrs["units"] == b"seconds since 2021-03-04 05:06:07"
            assert read["crs"].attrs["latitude_of_projection_origin"] == 60.1
            for name in ("elevation", "depth", "current_x"):
                assert read[name].attrs["grid_mapping"] == b"crs"
                assert read[name].attrs["coordinates"] == b"longitude latitude"
            assert read["current_x"].shape == (5, 7)  # it is steady
            assert "cell_methods" not in read["current_x"].attrs
