"""A trace of random numbers: its file by another library, damaged files, and missions of worlds in it."""

import shutil
from dataclasses import fields, replace

import h5py
import numpy as np
import pytest
import xarray

from tests.usvauv_env.record.made_traces import synthetic_trace
from usvauv import policies
from usvauv.env import Scenario, Trace, TraceError, World
from usvauv.env.record.headings import SLOWEST, TURN_RATE, headings, turned
from usvauv.env.record.metrics import episode_metrics
from usvauv.env.record.recorder import record
from usvauv.env.record.trace import INTEGERS, LARGEST, VARIABLES
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.site import Site
from usvauv.env.storage import memory
from usvauv.kernels.mission.columns import BoatColumn
from usvauv.kernels.positioning import usbl

STEP, STEPS, WORLDS, AUVS, BOATS, NODES = 2.0, 11, 3, 4, 2, 5
SIZES = {
    "time": STEPS, "world": WORLDS, "auv": AUVS, "boat": BOATS, "node": NODES, "axis": 2, "component": 3,
    "reward_term": 2, "surface_component": 3, "vortex": 6, "vortex_parameter": 4, "stream_time": 3, "stream_y": 4,
    "stream_x": 5, "y": 7, "x": 9, "wave": 6, "wave_parameter": 5,
    "angle": 3, "actuator": 3,
}  # fmt: skip
FLAGS = 0, usbl.DETECTED, usbl.DETECTED | usbl.WRAPPED, usbl.DETECTED | usbl.NO_DEPTH, usbl.LOST
PLACE = LocalFrame(114.02, 22.51)


def random_trace() -> Trace:
    random = np.random.default_rng(8)
    overrides = (
        "mission.step=2", "auv.count=4", "boat.count=2", "nodes.count=5", "current.count=6", "area.width=300",
        "area.length=240", "nodes.payload=3", "nodes.buffer=4000", "water.longitude=114.02", "water.latitude=22.51",
    )  # fmt: skip
    shapes = {name: [SIZES[dimension] for dimension in about.dimensions] for name, about in VARIABLES.items()}
    arrays = {name: random.uniform(0, 200, shape).astype(np.float32) for name, shape in shapes.items()}
    for name in INTEGERS:
        arrays[name] = random.integers(0, 2, shapes[name], np.int32)
    arrays["target"] = random.integers(0, NODES, shapes["target"], np.int16)
    arrays["fix_flags"] = random.choice(FLAGS, shapes["fix_flags"]).astype(np.uint8)
    arrays["fix"][arrays["fix_flags"] == 0] = np.nan
    arrays["service_rate"][random.random(shapes["service_rate"]) < 0.7] = 0
    for w in range(WORLDS):
        arrays["auv_charge"][5 + w :, w, : w + 1] = 0
    arrays["time"] = STEP * np.arange(1.0, STEPS + 1)
    arrays["stream_time"] = np.array([0.0, 3.0, 30.0])
    return Trace(
        scenario=Scenario.load("ideal", overrides),
        policy="random", usv="fim", seed=3, reward_names=("a", "b"), start="2026-11-01T04:00:00", **arrays,
    )  # fmt: skip


@pytest.fixture(scope="module")
def trace() -> Trace:
    return random_trace()


@pytest.fixture(scope="module")
def saved(trace, tmp_path_factory):
    path = tmp_path_factory.mktemp("trace") / "t.nc"
    trace.save(path)
    return path


def same(one: Trace, other: Trace) -> None:
    for field in fields(Trace):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype, field.name
            np.testing.assert_array_equal(a, b, err_msg=field.name)
        else:
            assert a == b, field.name


def test_the_same_after_its_file(trace, saved, tmp_path):
    same(Trace.load(saved), trace)
    nothing = {"stream_time": trace.stream_time[:0], "stream": np.zeros((0, 0, 0, 2)), "surface": np.zeros((0, 0, 0))}
    nowhere = trace.scenario.model_copy(update={"water": Scenario().water})
    replace(trace, **nothing, scenario=nowhere, start="").save(tmp_path / "less.nc")
    less = Trace.load(tmp_path / "less.nc")
    assert (less.start, less.stream.shape, less.surface.shape) == ("", (0, 0, 0, 2), (0, 0, 0))
    assert less.stream_at(5.0).shape == (0, 0, 2)
    with xarray.open_dataset(tmp_path / "less.nc", decode_times=False) as file:
        assert not {*file.variables} - {*VARIABLES}
        assert file["time"].attrs["units"] == "s"


def test_places_and_times_in_the_file(trace, saved):
    """Cell centres of the surface, corners of the current's grid, and degrees by the plane of the area."""
    with xarray.open_dataset(saved, decode_coords=False) as file:
        np.testing.assert_allclose(file["x"], 300 / 9 * (np.arange(9) + 0.5))
        np.testing.assert_allclose(file["y"], 240 / 7 * (np.arange(7) + 0.5))
        np.testing.assert_allclose(file["stream_x"], [0, 75, 150, 225, 300])
        np.testing.assert_allclose(file["stream_y"], [0, 80, 160, 240])
        grids = {"": np.meshgrid(file["x"], file["y"]), "stream_": np.meshgrid(file["stream_x"], file["stream_y"])}
        things = {
            f"{name}_": np.moveaxis(getattr(trace, f"{name}_position"), -1, 0) for name in ("node", "auv", "boat")
        }
        for prefix, (x, y) in (grids | things).items():
            degrees = [file[f"{prefix}{name}"] for name in ("longitude", "latitude")]
            np.testing.assert_allclose(degrees, PLACE.to_geographic(x, y), rtol=0, atol=1e-12)
            assert degrees[0].attrs["units"] == "degrees_east"
        assert file["time"].values[2] == np.datetime64("2026-11-01T04:00:06")
        about = {name: file[name].attrs.get("coordinates") for name in ("auv_position", "surface", "stream", "power")}
        assert about == {
            "auv_position": "auv_longitude auv_latitude", "surface": "longitude latitude",
            "stream": "stream_longitude stream_latitude", "power": "auv_longitude auv_latitude",
        }  # fmt: skip
        assert [name for name in file if "grid_mapping" in file[name].attrs] == ["surface"]
        assert file["crs"].attrs["longitude_of_projection_origin"] == 114.02
    with h5py.File(saved) as file:
        assert file["surface"].chunks == (1, 7, 9)
        assert {name for name in VARIABLES if file[name].compression} == {n for n in VARIABLES if file[n].ndim > 1}
        assert {name for name in VARIABLES if "_FillValue" in file[name].attrs} == {"fix"}


def test_one_episode_has_what_is_of_its_world(trace):
    one = trace.episode(2)
    for name, about in VARIABLES.items():
        of_all = getattr(trace, name)
        world = about.dimensions.index("world") if "world" in about.dimensions else None
        expected = of_all if world is None else np.moveaxis(np.moveaxis(of_all, world, 0)[[2]], 0, world)
        np.testing.assert_array_equal(getattr(one, name), expected, err_msg=name)


def test_the_current_is_linear_in_time(trace):
    """Between 3 s and 30 s; before and after, that of the nearest time."""
    for t, weight in ((-1.0, (1, 0, 0)), (0.75, (0.75, 0.25, 0)), (12.0, (0, 2 / 3, 1 / 3)), (31.0, (0, 0, 1))):
        np.testing.assert_allclose(trace.stream_at(t), np.tensordot(weight, trace.stream, 1), rtol=1e-6)


def changed(name, place, value):
    """A trace with another number at a place."""

    def change(trace):
        array = getattr(trace, name).copy()
        array[place] = value
        return replace(trace, **{name: array})

    return change


def replaced(name, values):
    def change(file):
        dimensions = [file[name].dims[i][0] for i in range(file[name].ndim)]
        del file[name]
        new = file.create_dataset(name, data=values)
        for axis, scale in zip(new.dims, dimensions, strict=False):
            axis.attach_scale(scale)

    return change


def attribute(name, value):
    def change(file):
        file.attrs[name] = value

    return change


def without(name):
    def change(file):
        del file[name]

    return change


WRONG = [
    (changed("power", (3, 1, 2), 1.01 * LARGEST), r"power holds 1\d+\.0; expected finite numbers up to 1e\+12"),
    (changed("fix", (3, 1, 2), np.inf), "fix holds inf; expected finite"),
    (changed("surface", (8, 2, 3), np.nan), "surface holds nan; expected finite"),
    (changed("time", 4, 8.0), "time does not rise"),
    (changed("target", (1, 1, 1), -1), "target is from -1 to 4; expected 0 to 4"),
    (lambda trace: replace(trace, start="soon"), "allowed: ISO 8601"),
    (lambda trace: replace(trace, scenario=Scenario.load("ideal", ["auv.count=4", "boat.count=3"])), "expected"),
]
DAMAGED = [
    (replaced("power", np.zeros((11, 3, 4), "i4")), "power is of type int32; expected real numbers"),
    (without("backlog"), "has no backlog"),
    (attribute("scenario", 5), "its attribute scenario is not text"),
    (attribute("scenario", "[" * 50_000), "nested too deep"),
    (attribute("scenario", '{"nodes": {"count": 5}, "auv": {"count": 3}}'), "along auv; expected 3"),
    (attribute("seed", "one"), "its attribute seed is not a whole number"),
]


@pytest.mark.parametrize(
    ("change", "damage", "said"),
    [*((change, None, said) for change, said in WRONG), *((None, damage, said) for damage, said in DAMAGED)],
)
def test_what_a_file_may_not_hold(trace, saved, tmp_path, change, damage, said):
    path = tmp_path / "t.nc"
    if change:
        change(trace).save(path)
    else:
        shutil.copy(saved, path)
        with h5py.File(path, "r+") as file:
            damage(file)
    with pytest.raises(TraceError, match=f"t.nc: not a usvauv trace: .*{said}") as caught:
        Trace.load(path)
    assert str(caught.value).isprintable()


def test_arrays_that_do_not_fit_into_memory_together_are_refused(saved, monkeypatch):
    monkeypatch.setattr(memory, "available", lambda device=None: 20_000)
    with pytest.raises(memory.MemoryNeeded, match=r"t.nc: takes about"):
        Trace.load(saved)


def test_a_file_of_an_earlier_version_is_read(trace, saved, tmp_path):
    """Without words about its variables and time, headings, then those of the way over ground, and storm."""
    with xarray.open_dataset(saved, decode_times=False) as file:
        for name in VARIABLES.keys() - {"x", "y"}:
            about, found = VARIABLES[name], file[name].attrs
            assert found["long_name"] == about.long_name
            assert found.get("units") == about.units or "since" in found["units"]
        for variable in file.variables.values():
            variable.attrs.clear()
        older = file.load().drop_vars(["boat_heading", "storm"])
        older.to_netcdf(tmp_path / "older.nc", engine="h5netcdf")
    loaded = Trace.load(tmp_path / "older.nc")
    way = np.diff(trace.boat_position, axis=0, prepend=trace.boat_position[:1]) / STEP
    expected = replace(trace, start="", storm=np.zeros((0, 5), np.float32), boat_heading=headings(way, STEP))
    same(loaded, expected)


class TestHeading:
    STEP = 0.5  # s
    MOST = TURN_RATE * STEP

    def test_a_boat_turns_the_short_way_at_its_rate_and_then_points_where_it_goes(self):
        """From east to 170° anticlockwise, then to 190°, across the cut of the angle."""
        east, there, beyond = (np.array([np.cos(a), np.sin(a)]) for a in np.radians([0, 170, 190]))
        velocity = np.concatenate([np.tile(way, (20, 1)) for way in (east, there, beyond)])[:, None]
        found = headings(velocity, self.STEP)[:, 0]
        first = np.radians(170) / self.MOST
        expected = [0.0] * 20 + [min(k / first, 1.0) * np.radians(170) for k in range(1, 21)]
        expected += [min(np.radians(170) + k * self.MOST, np.radians(190)) for k in range(1, 21)]
        np.testing.assert_allclose(found, expected, atol=1e-6)

    def test_it_keeps_its_heading_while_it_hardly_moves(self):
        """Before it first moves it has the heading that it then takes; a boat that never moves points east."""
        random = np.random.default_rng(0)
        velocity = random.uniform(-0.6, 0.6, (200, 2, 2)) * SLOWEST
        velocity[50:60, 0] = (0.0, -1.0)
        found = headings(velocity, self.STEP)
        np.testing.assert_allclose(found[:, 0], -np.pi / 2, rtol=1e-6)
        np.testing.assert_array_equal(found[:, 1], 0.0)

    def test_no_step_turns_it_by_more_than_the_rate_and_steps_can_be_made_one_by_one(self):
        velocity = np.random.default_rng(1).normal(size=(300, 3, 2)).astype(np.float32)
        whole, now = headings(velocity, self.STEP), np.full(3, np.nan)
        assert np.abs(np.diff(whole, axis=0)).max() <= self.MOST * (1 + 1e-5)  # float32
        for row, expected in zip(velocity, whole, strict=True):
            now = turned(now, row, self.STEP)
            assert np.isnan(now).any() or np.allclose(now, expected, atol=1e-5)


def test_attitude_is_the_vehicles_own_and_that_of_a_point_where_it_moves():
    """Across the cut of the angle both go on; a point at rest keeps its heading, and begins with its first one."""
    turn = np.linspace(2.0, 5.0, 7)
    velocity = np.stack([np.cos(turn), np.sin(turn)], -1)[:, None, None] * (np.arange(7) % 3 > 0)[:, None, None, None]
    point = replace(synthetic_trace(steps=7, auvs=1), auv_velocity=velocity)
    np.testing.assert_allclose(point.attitude[:, 0, 0], np.outer(turn[[1, 1, 2, 2, 4, 5, 5]], (1, 0, 0)), atol=1e-12)
    np.testing.assert_array_equal(point.depth, point.scenario.auv.depth)
    own = np.stack([np.angle(np.exp(1j * turn)), turn - 3, turn / 9], -1)[:, None, None]
    vehicle = replace(point, auv_attitude=own, auv_depth=10 * turn[:, None, None])
    np.testing.assert_allclose(vehicle.attitude[:, 0, 0], np.stack([turn, turn - 3, turn / 9], -1))
    np.testing.assert_array_equal(vehicle.depth, vehicle.auv_depth)


def test_the_bed_of_a_recorded_run_is_flat_where_its_file_is_gone(tmp_path):
    gone = f"water.bathymetry={tmp_path / 'gone.nc'}"
    scenario = Scenario.load("ideal", ["water.longitude=20", "water.latitude=40", gone])
    np.testing.assert_array_equal(Site.recorded(scenario).depth_at(np.array([[3.0, 4.0]])), scenario.area.depth)


def test_a_world_has_the_headings_of_its_boats_motion_through_the_water():
    scenario = Scenario.load("extreme", ["mission.duration=40", "current.count=0", "storm.spectrum=none"])
    world, seen = World(scenario, seed=1), []
    policy = policies.load("straight", world)

    def act(observation):
        seen.append(world.boat[..., BoatColumn.span("water_x", "water_y")].cpu().numpy().copy())
        return policy.act(observation)

    trace = record(world, act, "straight")
    expected = headings(
        np.stack([*seen[1:], world.boat[..., BoatColumn.span("water_x", "water_y")].cpu().numpy()]), 1.0
    )
    np.testing.assert_array_equal(trace.boat_heading, expected)


def test_a_boats_energy_is_counted_where_its_power_is_given():
    """By the cube of its speed through the water, here over ground, besides the hotel load."""
    at_once = ["boat.response_time=0", "boat.windage=0", "boat.dead_band=0", "boat.drifts=false"]
    numbers = ["mission.duration=40", "current.count=0", "storm.spectrum=none", "boat.top_speed=4"]
    numbers += ["boat.propulsion_power=300", "boat.hotel=40"]
    world = World(Scenario.load("extreme", [*at_once, *numbers]), seed=1)
    trace = record(world, policies.load("straight", world).act, "straight")
    speed = np.linalg.norm(np.diff(trace.boat_position, axis=0), axis=-1)
    assert np.ptp(speed) > 0.5
    np.testing.assert_allclose(trace.boat_power[1:], 40 + 300 * (speed / 4.0) ** 3, rtol=1e-3)
    row = episode_metrics(trace)[0]
    assert row.boat_energy_wh == pytest.approx(float(trace.boat_power.sum()) / 3600)
    assert np.isnan(episode_metrics(replace(trace, boat_power=trace.boat_power[:0, :0, :0]))[0].boat_energy_wh)
