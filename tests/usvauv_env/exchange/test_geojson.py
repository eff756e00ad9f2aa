"""Plans and missions as GeoJSON: places by PROJ, times, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from pyproj import CRS, Transformer

from tests.usvauv_env.record.made_traces import synthetic_trace
from usvauv.env import Scenario
from usvauv.env.exchange import geojson
from usvauv.env.record.metrics import served
from usvauv.env.site import place
from usvauv.env.site.place import LocalFrame

CORNER = LocalFrame(114.02, 22.51)
PLACED = {"water": {"longitude": 114.02, "latitude": 22.51}}
PLANE = Transformer.from_crs(4326, CRS.from_wkt(place.grid_mapping(CORNER)["crs_wkt"]), always_xy=True)


@pytest.fixture
def trace():
    made = synthetic_trace(steps=300, worlds=2)
    scenario = Scenario.from_dict(made.scenario.to_dict() | PLACED)
    return replace(made, scenario=scenario, start="2026-11-01T23:59:30")


def kinds(path) -> dict[str, list]:
    collection = json.loads(path.read_text())
    assert collection["type"] == "FeatureCollection"
    found: dict[str, list] = {}
    for feature in collection["features"]:
        assert set(feature) == {"type", "geometry", "properties"}
        found.setdefault(feature["properties"]["kind"], []).append(feature)
    return found


def metres(feature) -> np.ndarray:
    """Places by PROJ, (…, 2) m."""
    return np.stack(PLANE.transform(*np.moveaxis(np.array(feature["geometry"]["coordinates"]), -1, 0)), axis=-1)


def test_a_mission(trace, tmp_path, run_usvauv):
    trace.save(tmp_path / "m.nc")
    assert run_usvauv("replay", "m.nc", "--episode", 1, "--out", "m.geojson")[0] == 0
    found, only = kinds(tmp_path / "m.geojson"), trace.episode(1)
    auvs = trace.power.shape[2]
    assert [len(found[kind]) for kind in ("area", "auv", "boat", "node")] == [1, auvs, 1, trace.backlog.shape[2]]
    np.testing.assert_allclose(metres(found["area"][0])[0, [0, 2]], [[0, 0], [200, 200]], atol=2e-3)
    for k, auv in enumerate(found["auv"]):
        assert auv["geometry"]["type"] == "LineString"
        assert auv["properties"]["auv"] == k + 1
        assert auv["properties"]["depth"] == trace.scenario.auv.depth
        np.testing.assert_allclose(metres(auv), only.auv_position[:, 0, k], atol=2e-3)
        assert len(auv["properties"]["times"]) == 300
        assert auv["properties"]["times"][29] == "2026-11-02T00:00:00.000Z"
    np.testing.assert_allclose(metres(found["boat"][0]), only.boat_position[:, 0, 0], atol=2e-3)
    for i, node in enumerate(found["node"]):
        np.testing.assert_allclose(metres(node), only.node_position[0, i], atol=2e-3)
    step, _, auv, node = served(only)
    assert len(step) > 2
    for service, t, k, i in zip(found["service"], step, auv, node, strict=True):
        about = service["properties"]
        assert (about["auv"], about["node"]) == (k + 1, i + 1)
        assert about["delivered_mbit"] == pytest.approx(only.delivered[t, 0, k])
        assert about["time"] == found["auv"][0]["properties"]["times"][t]
    brought = sum(each["properties"]["delivered_mbit"] for each in found["node"])
    assert brought == pytest.approx(only.delivered.sum())
    assert sum(each["properties"]["services"] for each in found["node"]) == len(step)


@pytest.mark.parametrize(("corner", "first"), [(359.5, -0.5), (-200.0, 160.0), (180.0, -180.0)])
def test_longitudes_are_from_180_west_to_180_east(trace, corner, first):
    water = {"water": {"longitude": corner % 360 if corner < -180 else corner, "latitude": 22.51}}
    scenario = Scenario.from_dict(trace.scenario.to_dict() | water)
    ring = geojson.of_mission(replace(trace, scenario=scenario))[0]["geometry"]["coordinates"][0]
    assert ring[0] == pytest.approx([first, 22.51])
    assert ring[1][0] > ring[0][0]


def test_what_lies_across_180_degrees_is_cut_there(trace):
    """Its parts together are the mission as it is at 179.9°; AUVs and boat go back and forth."""
    depth = np.add.outer(trace.time, np.zeros(trace.power.shape[1:]))
    trace = replace(trace, auv_depth=depth, start="")

    def features(longitude):
        water = {"water": {"longitude": longitude, "latitude": -17.0}}
        return geojson.of_mission(replace(trace, scenario=Scenario.from_dict(trace.scenario.to_dict() | water)))

    cut = []
    for feature, elsewhere in zip(features(179.9991), features(179.9), strict=True):
        geometry, kind = feature["geometry"], feature["properties"]["kind"]
        many = geometry["type"].startswith("Multi")
        parts = [np.array(part).reshape(-1, 2) for part in geometry["coordinates"]] if many else [coordinates(geometry)]
        assert all((abs(part[:, 0]) <= 180).all() and np.ptp(part[:, 0]) < 1 for part in parts)
        points, expected = np.concatenate(parts), coordinates(elsewhere["geometry"])
        inner = abs(points[:, 0]) < 180
        points[:, 0] = points[:, 0] % 360 - 0.0991
        cut += [kind] * many
        if kind == "area":
            assert {*map(tuple, points[inner].round(6))} == {*map(tuple, expected.round(6))}
            assert all((part[0] == part[-1]).all() for part in parts)
            continue
        np.testing.assert_allclose(points[inner], expected, atol=3e-8)
        if many:
            times = np.concatenate(feature["properties"]["times"])
            np.testing.assert_array_equal(times[inner], trace.time)
            assert (np.diff(times) >= 0).all()
            assert kind == "boat" or (np.concatenate(feature["properties"]["depth"]) == times).all()
    assert cut[:2] == ["area", "auv"]


def coordinates(geometry) -> np.ndarray:
    """Coordinates, (points, 2)."""
    return np.array(geometry["coordinates"]).reshape(-1, 2)


def test_a_plan(tmp_path, run_usvauv):
    place = ("--set", "water.longitude=114.02", "--set", "water.latitude=22.51")
    auvs = ("--auv", "60,80,100", "--auv", "150,120,90", "--compare", "10,20")
    assert run_usvauv("plan", *place, *auvs, "--out", "p.geojson", "--json", "p.json")[0] == 0
    found, plan = kinds(tmp_path / "p.geojson"), json.loads((tmp_path / "p.json").read_text())
    np.testing.assert_allclose([metres(auv) for auv in found["auv"]], [[60, 80], [150, 120]], atol=2e-3)
    assert [auv["properties"]["depth"] for auv in found["auv"]] == [100, 90]
    for kind, given in (("optimum", plan["optimum"]), ("centroid", plan["centroid"]), ("compare", plan["compare"][0])):
        (feature,) = found[kind]
        np.testing.assert_allclose(metres(feature), [given["x"], given["y"]], atol=2e-3)
        assert feature["properties"]["rms"] == given["rms"]
    assert not (tmp_path / "plan.png").exists()


def test_refusals(trace, tmp_path, run_usvauv):
    replace(trace, scenario=synthetic_trace(2).scenario).save(tmp_path / "m.nc")
    for arguments, said in (
        (("replay", "m.nc", "--out", "a.geojson"), "has no place on Earth; water.latitude"),
        (("replay", "m.nc", "m.nc", "--out", "a.geojson"), "2 traces: --out a.geojson takes one"),
        (("plan", "--auv", "60,80,100", "--out", "a.geojson"), "has no place on Earth; water.latitude"),
    ):
        code, _, error = run_usvauv(*arguments)
        assert (code, error.count("\n")) == (2, 1)
        assert said in error
    assert not (tmp_path / "a.geojson").exists()
