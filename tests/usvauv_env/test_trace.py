"""A trace of random numbers: its figures by plain loops, its file by another library, and what is refused."""

import math
import statistics
from contextlib import nullcontext
from dataclasses import fields, replace
from typing import NamedTuple

import h5py
import numpy as np
import pytest
import xarray

from usvauv.env import Scenario, Trace, TraceError
from usvauv.env.netcdf import remote
from usvauv.env.record import trace as trace_module
from usvauv.env.record.metrics import episode_metrics
from usvauv.env.record.trace import INTEGERS, LARGEST, VARIABLES
from usvauv.env.site.place import LocalFrame
from usvauv.kernels.positioning import usbl

STEP, STEPS, WORLDS, AUVS, BOATS, NODES = 2.0, 11, 3, 4, 2, 5
SIZES = {
    "time": STEPS, "world": WORLDS, "auv": AUVS, "boat": BOATS, "node": NODES, "axis": 2, "component": 3,
    "reward_term": 2, "surface_component": 3, "vortex": 6, "vortex_parameter": 4, "stream_time": 3, "stream_y": 4,
    "stream_x": 5, "y": 7, "x": 9,
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
    arrays["time"] = STEP * np.arange(1.0, STEPS + 1)
    arrays["stream_time"] = np.array([0.0, 3.0, 30.0])
    return Trace(
        scenario=Scenario.load("ideal", overrides),
        policy="random", usv="fim", seed=3, reward_names=("a", "b"), start="2026-11-01T04:00:00", **arrays,
    )  # fmt: skip


@pytest.fixture(scope="module")
def trace() -> Trace:
    return random_trace()


def spread(values: list[float]) -> dict[str, float]:
    """Mean, median, rms and 95th percentile, which lies at 0.95 (n − 1) among the sorted values from the first on."""
    ordered = sorted(values)
    place = 0.95 * (len(values) - 1)
    low = int(place)
    return {
        "mean": statistics.fmean(values),
        "median": statistics.median(values),
        "rms": math.sqrt(statistics.fmean(value * value for value in values)),
        "p95": ordered[low] + (place - low) * (ordered[low + 1] - ordered[low]),
    }


def by_loops(trace: Trace, w: int) -> dict[str, float]:
    """The figures of world w, by their definitions."""
    every = [(t, k) for t in range(STEPS) for k in range(AUVS)]
    flags = {at: int(trace.fix_flags[at[0], w, at[1]]) for at in every}
    heard = [at for at in every if flags[at] & usbl.DETECTED]
    used = [at for at in heard if not flags[at] & usbl.NO_DEPTH]

    def distance(one: str, other: str, t: int, k: int) -> float:
        return math.dist(getattr(trace, one)[t, w, k], getattr(trace, other)[t, w, k])

    ec, runs = [], [0]
    for k in range(AUVS):
        energy = sum(float(trace.power[t, w, k]) * STEP for t in range(STEPS))
        ec.append(energy / (STEP * STEPS - STEP * sum(int(trace.hovering[t, w, k]) for t in range(STEPS))))
        run = 0
        for t in range(STEPS):
            run = 0 if (t, k) in used else run + 1
            runs.append(run)
    born, ages, peaks, data = [0.0] * NODES, [], [], [0.0] * NODES
    for t in range(STEPS):
        before = [STEP * t - each if t else 0.0 for each in born]
        for k in range(AUVS):
            if trace.service_rate[t, w, k] > 0:
                node = trace.target[max(t - 1, 0), w, k]
                arrival = next((s for s in range(t, -1, -1) if not trace.hovering[s, w, k]), -1)
                peaks.append(before[node] + STEP)
                born[node] = max(born[node], STEP * arrival)
                data[node] += float(trace.delivered[t, w, k])
        ages += [STEP * (t + 1) - each for each in born]
    served = [(t, k) for t, k in every if trace.service_rate[t, w, k] > 0]
    energy = STEP * sum(float(trace.power[t, w, k]) for t, k in every)
    brought = sum(float(trace.delivered[t, w, k]) for t, k in every)
    errors = {
        "position_error": [distance("estimate", "auv_position", *at) for at in every],
        "own_error": [distance("own_position", "auv_position", *at) for at in every],
        "fix_error": [distance("fix", "heard_position", *at) for at in used],
    }
    return {
        "episode": 10 + w,
        "sdr": sum(float(trace.service_rate[t, w, k]) for t, k in served),
        "ec": statistics.fmean(ec),
        "arps": sum(float(trace.reward_terms[t, w, k, r]) for t, k in every for r in range(2)) / STEPS,
        "services": len(served),
        "delivered_mbit": brought,
        "energy_wh": energy / 3600,
        "target_distance": statistics.fmean(
            math.dist(trace.node_position[w, trace.target[t, w, k]], trace.auv_position[t, w, k]) for t, k in every
        ),
        **{name: sum(int(trace.__dict__[f][t, w]) for t in range(STEPS)) for name, f in
           (("overflow", "overflowing"), ("collisions", "collisions"))},
        "border": sum(int(trace.border[t, w, k]) for t, k in every),
        **{f"{name}_{part}": value for name, values in errors.items() for part, value in spread(values).items()},
        "fix_availability": len(used) / len(every),
        "fix_wrapped": sum(bool(flags[at] & usbl.WRAPPED) for at in used) / len(used),
        "fix_dropped": 1 - len(used) / len(heard),
        "outage_longest": STEP * max(runs),
        "lost_mbit": sum(int(trace.packets_lost[t, w]) for t in range(STEPS)) * 3 / 4000,
        "aoi_mean": statistics.fmean(ages),
        "aoi_peak": statistics.fmean(peaks),
        "aoi_largest": max(ages),
        "jain": sum(data) ** 2 / NODES / sum(each**2 for each in data),
        "joule_per_mbit": energy / brought,
    }  # fmt: skip


def test_figures_by_loops(trace):
    rows = episode_metrics(trace, first_episode=10)
    assert [(row.scenario, row.policy, row.usv, row.seed, row.targets) for row in rows] == [
        ("ideal", "random", "fim", 3, "tour")
    ] * WORLDS
    assert [row.episode for row in episode_metrics(trace)] == [0, 1, 2]
    for w, row in enumerate(rows):
        expected = by_loops(trace, w)
        found = {name: value for name, value in row.columns().items() if not isinstance(value, str) and name != "seed"}
        assert found == pytest.approx(expected, rel=1e-5)


def same(one: Trace, other: Trace) -> None:
    for field in fields(Trace):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype, field.name
            np.testing.assert_array_equal(a, b, err_msg=field.name)
        else:
            assert a == b, field.name


def test_the_same_after_its_file(trace, tmp_path):
    trace.save(tmp_path / "t.nc")
    same(Trace.load(tmp_path / "t.nc"), trace)
    nothing = {"stream_time": trace.stream_time[:0], "stream": np.zeros((0, 0, 0, 2)), "surface": np.zeros((0, 0, 0))}
    nowhere = trace.scenario.model_copy(update={"water": Scenario().water})
    replace(trace, **nothing, scenario=nowhere, start="").save(tmp_path / "less.nc")
    less = Trace.load(tmp_path / "less.nc")
    assert (less.start, less.stream.shape, less.surface.shape) == ("", (0, 0, 0, 2), (0, 0, 0))
    assert less.stream_at(5.0).shape == (0, 0, 2)
    with xarray.open_dataset(tmp_path / "less.nc", decode_times=False) as file:
        assert not {*file.variables} - {*VARIABLES}
        assert file["time"].attrs["units"] == "s"


def test_places_and_times_in_the_file(trace, tmp_path):
    """Cell centres of the surface, corners of the current's grid, and degrees by the plane of the area."""
    trace.save(tmp_path / "t.nc")
    with xarray.open_dataset(tmp_path / "t.nc", decode_coords=False) as file:
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
    with h5py.File(tmp_path / "t.nc") as file:
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


class Held(NamedTuple):
    """A variable of a file, as the process that reads it gives it."""

    dimensions: tuple[str, ...]
    values: np.ndarray
    attributes: dict[str, str]

    @property
    def shape(self):
        return self.values.shape

    @property
    def dtype(self):
        return self.values.dtype

    def read(self, part):
        return self.values[part]


@pytest.fixture
def loaded(monkeypatch):
    """Function that loads a trace as if it came from its file, without one."""

    def load(trace: Trace) -> Trace:
        units = {"units": f"seconds since {trace.start}"}
        held = {name: Held(about.dimensions, getattr(trace, name), units) for name, about in VARIABLES.items()}
        file = held, trace._global_attributes()
        monkeypatch.setattr(remote, "open_remote", lambda path: nullcontext(file))
        return Trace.load("t.nc")

    return load


@pytest.mark.parametrize("together", [1, 3, 11, 64])
def test_a_surface_is_read_by_parts(trace, loaded, monkeypatch, together):
    monkeypatch.setattr(trace_module, "TOGETHER", together)
    same(loaded(trace), trace)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (changed("power", (0, 0, 0), LARGEST), None),
        (changed("power", (0, 0, 0), -LARGEST), None),
        (
            changed("power", (3, 1, 2), 1.01 * LARGEST),
            r"power holds 1\d+\.0; expected finite numbers up to 1e\+12",
        ),
        (changed("fix", (3, 1, 2), np.nan), None),
        (changed("fix", (3, 1, 2), np.inf), "fix holds inf; expected finite"),
        (changed("surface", (8, 2, 3), np.nan), "surface holds nan; expected finite"),
        (changed("time", 4, 8.0), "time does not rise"),
        (changed("stream_time", 1, 0.0), "stream_time does not rise"),
        (lambda trace: replace(trace, stream_time=trace.stream_time[:2]), "stream and stream_time differ in length"),
        (changed("target", (1, 1, 1), -1), "target is from -1 to 4; expected 0 to 4"),
        (changed("fix_boat", (1, 1, 1), 2), "fix_boat is from 0 to 2; expected 0 to 1"),
        (changed("served_by", (1, 1, 1), -1), "served_by is from -1 to 1; expected 0 to 1"),
        (lambda trace: replace(trace, start="soon"), "allowed: ISO 8601"),
        (lambda trace: replace(trace, reward_names=("a",)), "reward_terms has 2 along reward_term; expected 1"),
        (lambda trace: replace(trace, scenario=Scenario.load("ideal", ["auv.count=4", "boat.count=3"])), "expected"),
        (lambda trace: replace(trace, backlog=trace.backlog[:, :0]), "backlog has 0 along world; expected at least 1"),
        (lambda trace: replace(trace, border=trace.border.astype("f4")), "border is of type float32; expected whole"),
    ],
)
def test_what_a_file_may_hold(trace, loaded, change, said):
    wrong = change(trace)
    if said is None:
        same(loaded(wrong), wrong)
    else:
        with pytest.raises(TraceError, match=f"^t.nc: not a usvauv trace: .*{said}"):
            loaded(wrong)
