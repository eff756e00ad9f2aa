"""A trace in other tools' formats, read back by a library that did not write it where there is one."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rerun.chunk import RrdReader

from tests.usvauv_env.record.made_traces import diving, synthetic_trace
from usvauv.env import Scenario
from usvauv.env.exchange import export_trace
from usvauv.env.exchange.trace_tables import tables
from usvauv.env.record.metrics import served
from usvauv.env.record.trace import VARIABLES
from usvauv.env.render.style import auv_colour
from usvauv.env.site.site import Site

STEPS = 7


@pytest.fixture(scope="module")
def trace():
    """Two worlds of 300 m by 200 m across 180°, a step of 0.3 s, a fix missing; AUVs dive."""
    made = diving(synthetic_trace(steps=STEPS, worlds=2, area=(300.0, 200.0), nodes=4, seed=5))
    random = np.random.default_rng(4)
    slope, fix = made.boat_surface.copy(), made.fix.copy()
    slope[1:, ..., 1:] = random.normal(size=slope[1:, ..., 1:].shape)
    fix[3, :, 0] = np.nan
    covariance = random.uniform(1, 3, made.fix_covariance.shape) * (1, 0.2, 1)
    delivered = np.zeros_like(made.delivered)
    delivered[4, 1, 1] = 0.5
    water = made.scenario.water.model_copy(update={"latitude": 22.51, "longitude": 179.999})
    return replace(
        made,
        scenario=made.scenario.model_copy(update={"water": water}),
        time=0.3 * made.time,
        fix=fix,
        boat_surface=slope,
        fix_covariance=covariance,
        estimate_covariance=2 * covariance,
        service_rate=0.25 * (delivered > 0),
        delivered=delivered,
        power=random.uniform(90, 200, made.power.shape),
        backlog=random.uniform(0, 99, made.backlog.shape),
    )


@pytest.fixture(scope="module")
def bag(trace, tmp_path_factory):
    """Messages of world 1 by topic, each with its time, ns."""
    path = tmp_path_factory.mktemp("mcap") / "mission.mcap"
    export_trace(trace, "mcap", path, world=1)
    return messages(path)


@pytest.fixture(scope="module")
def scene(trace, tmp_path_factory):
    """Columns of world 1 by entity, what does not change under (entity, "constant")."""
    path = tmp_path_factory.mktemp("rrd") / "mission.rrd"
    export_trace(trace, "rrd", path, world=1)
    assert len(RrdReader(path).blueprints()) == 1
    return entities(path)


def messages(path):
    found = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def entities(path):
    found = {}
    for chunk in RrdReader(path).stream().to_chunks():
        key = (chunk.entity_path, "constant") if chunk.is_static else chunk.entity_path
        found.setdefault(key, []).append(chunk.to_record_batch().to_pandas())
    return {key: tables[0] if isinstance(key, str) else pd.concat(tables, axis=1) for key, tables in found.items()}


def rotated(turn, vector):
    """A vector turned by a quaternion x, y, z, w."""
    return vector + 2 * np.cross(turn[:3], np.cross(turn[:3], vector) + turn[3] * np.asarray(vector))


def numbers(message):
    """Numbers of a point, a vector or a quaternion."""
    return np.array([getattr(message, name) for name in "xyzw" if hasattr(message, name)])


class TestTables:
    def test_each_variable_of_a_thing_is_in_its_table(self, trace):
        made = tables(trace)
        dimensions = {name: {*about.dimensions} for name, about in VARIABLES.items() if getattr(trace, name).size}
        things = {name for name, own in dimensions.items() if {"auv", "boat", "node", "vortex"} & own}
        columns = {column for table in made.values() for column in table}
        assert not [name for name in things if not any(column.startswith(name) for column in columns)]
        assert {"overflowing", "collisions", "packets_created", "packets_lost"} < made["worlds"].keys()

    def test_parts_of_vectors_fixes_and_services(self, trace):
        made = {name: pd.DataFrame(table) for name, table in tables(trace).items()}
        node = made["nodes"].set_index(["time", "world", "node"]).loc[(trace.time[6], 1, 4)]
        assert tuple(node[["node_position_x", "node_position_y"]]) == tuple(trace.node_position[1, 3])
        assert node["backlog"] == trace.backlog[6, 1, 3]
        fixes = made["fixes"]
        assert len(fixes) == STEPS * 2 * 2 - 2
        row = fixes[(fixes.time == trace.time[5]) & (fixes.world == 1) & (fixes.auv == 2)].iloc[0]
        assert (row.x, row.y, row.depth) == (*trace.fix[5, 1, 1], trace.auv_depth[5, 1, 1])
        assert (row.covariance_xx, row.covariance_xy, row.covariance_yy) == tuple(trace.fix_covariance[5, 1, 1])
        ((step, world, auv, node),) = zip(*served(trace), strict=True)
        expected = (trace.time[step], world, auv + 1, node + 1, 0.5)
        assert tuple(made["services"][["time", "world", "auv", "node", "delivered"]].iloc[0]) == expected

    @pytest.mark.parametrize("form", ["csv", "parquet"])
    def test_files_hold_the_tables(self, trace, tmp_path, form):
        export_trace(trace, form, tmp_path)
        for name, table in tables(trace).items():
            path = tmp_path / f"{name}.{form}"
            read = pd.read_csv(path) if form == "csv" else pyarrow.parquet.read_table(path).to_pandas()
            assert [*read] == [*table]
            for column, values in table.items():
                np.testing.assert_allclose(read[column], values, rtol=1e-6)


class TestMcap:
    """Written with rosbags, read with the library of MCAP's makers."""

    def test_every_topic_at_every_step(self, trace, bag):
        poses = {f"/{name}/{of}" for name in ("auv_1", "auv_2", "usv_1") for of in ("pose", "navsat")}
        sound = {f"/auv_{k}/{of}" for k in (1, 2) for of in ("velocity", "fins", "fix", "estimate")}
        expected = {"/tf", "/nodes", "/sea", "/usv_1/goal"} | poses | sound
        assert {topic: len(each) for topic, each in bag.items()} == dict.fromkeys(expected, STEPS) | {
            "/auv_1/fix": STEPS - 1
        }
        for topic, each in bag.items():
            when, message = each[2]
            header = message.transforms[0].header if topic == "/tf" else message.header
            assert header.stamp.sec * 10**9 + header.stamp.nanosec == when == round(trace.time[2] * 1e9), topic
            assert header.frame_id == "map"

    def test_everything_is_at_its_place_height_and_turn(self, trace, bag):
        """An AUV has its heading, pitch and roll; boats lie on their slope.

        Their bows point along their headings on level water, and on a slope to what that becomes by the turn of the
        vertical to the normal.
        """
        frame = Site(trace.scenario).frame
        for t in range(STEPS):
            elevation, x, y = trace.boat_surface[t, 1, 0]
            (yaw, pitch, _), (other, nose, roll) = trace.auv_attitude[t, 1]
            ahead = np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)
            aside, forth = np.array([(-np.sin(other), np.cos(other), 0.0), (np.cos(other), np.sin(other), 0.0)])
            risen = np.array([0.0, 0.0, np.cos(nose)]) - np.sin(nose) * forth
            port = np.cos(roll) * aside + np.sin(roll) * risen  # it rises as starboard goes down
            up = np.array([-x, -y, 1.0]) / np.sqrt(1 + x * x + y * y)
            expected = {
                "auv_1": ((*trace.auv_position[t, 1, 0], -trace.auv_depth[t, 1, 0]), (1.0, 0, 0), ahead),
                "auv_2": ((*trace.auv_position[t, 1, 1], -trace.auv_depth[t, 1, 1]), (0, 1.0, 0), port),
                "usv_1": ((*trace.boat_position[t, 1, 0], elevation), (0, 0, 1.0), up),
            }
            transforms = {each.child_frame_id: each.transform for each in bag["/tf"][t][1].transforms}
            assert [*transforms] == [*expected]
            bow, heading = numbers(bag["/usv_1/pose"][t][1].pose.orientation), trace.boat_heading[t, 1, 0]
            level, axis = np.array([np.cos(heading), np.sin(heading), 0.0]), np.cross((0, 0, 1.0), up)
            turn = np.array([*axis, 1 + up[2]])  # of which the angle has this half tangent
            turn /= np.linalg.norm(turn)
            np.testing.assert_allclose(rotated(bow, (1.0, 0, 0)), rotated(turn, level), atol=1e-6)
            for name, (place, axis, turned) in expected.items():
                pose, transform = bag[f"/{name}/pose"][t][1].pose, transforms[name]
                np.testing.assert_allclose(numbers(pose.position), place)
                np.testing.assert_allclose(rotated(numbers(pose.orientation), axis), turned, atol=1e-12)
                np.testing.assert_array_equal(numbers(transform.translation), numbers(pose.position))
                np.testing.assert_array_equal(numbers(transform.rotation), numbers(pose.orientation))
                earth = bag[f"/{name}/navsat"][t][1]
                assert abs(earth.longitude) <= 180
                back = frame.to_local(np.array(earth.longitude), np.array(earth.latitude))
                np.testing.assert_allclose([*back, earth.altitude], place, atol=1e-6)
            goal = numbers(bag["/usv_1/goal"][t][1].point)
            np.testing.assert_allclose(goal, [*trace.boat_goal[t, 1, 0], 0])
            fins, (rudder, stern, turns) = bag["/auv_2/fins"][t][1], trace.auv_fins[t, 1, 1]
            assert fins.name == ["rudder", "stern_plane", "propeller"]
            np.testing.assert_allclose(fins.position, [rudder, stern, np.nan])
            np.testing.assert_allclose(fins.velocity, [np.nan, np.nan, 2 * np.pi * turns])
            velocity = numbers(bag["/auv_1/velocity"][t][1].twist.linear)
            climb = (trace.auv_depth[max(t - 1, 0), 1, 0] - trace.auv_depth[t, 1, 0]) / trace.scenario.mission.step
            np.testing.assert_allclose(velocity, [*trace.auv_velocity[t, 1, 0], climb])

    @pytest.mark.parametrize(
        ("name", "place", "covariance"),
        [("fix", "fix", "fix_covariance"), ("estimate", "estimate", "estimate_covariance")],
    )
    def test_positions_have_their_covariance_and_an_unknown_attitude(self, trace, bag, name, place, covariance):
        pose = bag[f"/auv_2/{name}"][4][1].pose
        expected = (*getattr(trace, place)[4, 1, 1], -trace.auv_depth[4, 1, 1])
        np.testing.assert_allclose(numbers(pose.pose.position), expected)
        matrix, (xx, xy, yy) = np.reshape(pose.covariance, (6, 6)), getattr(trace, covariance)[4, 1, 1]
        np.testing.assert_array_equal(matrix[:2, :2], [[xx, xy], [xy, yy]])
        assert (matrix.diagonal()[3:] > 1e3).all()
        np.testing.assert_array_equal(matrix[:3] != 0, np.pad(np.ones((2, 2), bool), ((0, 1), (0, 4))))

    def test_clouds(self, trace, bag):
        rows, columns = np.indices(trace.surface.shape[1:])
        sea = [(columns + 0.5) * 300 / columns.shape[1], (rows + 0.5) * 200 / rows.shape[0], trace.surface[4]]
        nodes = [*trace.node_position[1].T, -Site(trace.scenario).depth_at(trace.node_position[1]), trace.backlog[4, 1]]
        for topic, expected in (("/sea", sea), ("/nodes", nodes)):
            cloud, step = bag[topic][4][1], 4 * len(expected)
            assert [field.name for field in cloud.fields] == ["x", "y", "z", "backlog"][: len(expected)]
            assert {(field.offset % 4, field.datatype, field.count) for field in cloud.fields} == {(0, 7, 1)}  # FLOAT32
            assert (cloud.height, cloud.point_step, cloud.row_step) == (1, step, step * cloud.width)
            points = np.frombuffer(bytes(cloud.data), "<f4").reshape(cloud.width, len(expected))
            np.testing.assert_allclose(points, np.stack(expected, -1).reshape(points.shape), rtol=1e-6)


class TestRerun:
    def test_curves_fixes_and_places(self, trace, scene):
        for k in (0, 1):
            error = np.linalg.norm(trace.estimate - trace.auv_position, axis=-1)[:, 1, k]
            for name, values in (
                ("error", error),
                ("power", trace.power[:, 1, k]),
                ("depth", trace.auv_depth[:, 1, k]),
            ):
                np.testing.assert_allclose(np.concatenate(scene[f"/{name}/auv_{k + 1}"]["Scalars:scalars"]), values)
            fixes, colour = scene[f"/scene/fixes/auv_{k + 1}"], scene[f"/scene/fixes/auv_{k + 1}", "constant"]
            assert int(colour["Ellipsoids3D:colors"][0][0]).to_bytes(4)[0] == auv_colour(k)[2]  # red
            made = np.flatnonzero(np.isfinite(trace.fix[:, 1, k, 0]))
            assert len(fixes) == len(made)
            for row, t in enumerate(made):
                parts = (fixes[f"Ellipsoids3D:{name}"][row][0] for name in ("centers", "half_sizes", "quaternions"))
                centre, half, turn = (np.asarray(part, float) for part in parts)
                axes = np.array([rotated(turn, axis) for axis in np.eye(3)[:2]])[:, :2]
                xx, xy, yy = trace.fix_covariance[t, 1, k]
                np.testing.assert_allclose(axes.T @ np.diag(half[:2] ** 2 / 4) @ axes, [[xx, xy], [xy, yy]], rtol=1e-5)
                np.testing.assert_allclose(centre[:2], trace.fix[t, 1, k], rtol=1e-6)
        np.testing.assert_allclose(np.concatenate(scene["/backlog"]["Scalars:scalars"]), trace.backlog[:, 1].sum(1))
        bow, heading = scene["/scene/usv_1/bow"]["Arrows3D:vectors"][0][0], trace.boat_heading[0, 1, 0]
        np.testing.assert_allclose(bow / np.linalg.norm(bow), [np.cos(heading), np.sin(heading), 0], atol=1e-6)
        latitude, longitude = np.stack(scene["/earth/usv_1"]["GeoPoints:positions"][2])[0]
        assert (abs(longitude) <= 180).all()
        back = Site(trace.scenario).frame.to_local(longitude, latitude)
        np.testing.assert_allclose(back, trace.boat_position[2, 1, 0], atol=1e-6)

    def test_a_run_without_sea_fixes_or_place_has_none(self, trace, tmp_path):
        calm = replace(synthetic_trace(steps=2, sea=False), fix=np.full((2, 1, 2, 2), np.nan))
        for form in ("rrd", "mcap"):
            export_trace(calm, form, tmp_path / f"calm.{form}")
        assert not {"/sea", "/auv_1/fix", "/auv_1/navsat"} & messages(tmp_path / "calm.mcap").keys()
        found = {key if isinstance(key, str) else key[0] for key in entities(tmp_path / "calm.rrd")}
        assert not {"/scene/sea", "/scene/fixes/auv_1", "/earth/auv_1"} & found
        assert {"/scene/auv_2", "/scene/usv_1", "/error/auv_1"} < found


def test_numbers_of_boats_and_nodes_begin_at_one(trace):
    auvs = tables(trace)["auvs"]
    np.testing.assert_array_equal(auvs["target"], trace.target.ravel() + 1)
    np.testing.assert_array_equal(auvs["fix_boat"], trace.fix_boat.ravel() + 1)
    assert {*auvs["auv"].tolist()} == {1, 2}
    assert {*auvs["world"].tolist()} == {0, 1}


def test_targets_that_move_have_their_ways_and_estimates(tmp_path):
    """Of three targets of `tracking`, the second is not known at first; no export has them as nodes on the bed."""
    made, random = synthetic_trace(steps=5, auvs=3, nodes=3, area=(2400.0, 2400.0)), np.random.default_rng(2)
    way, covariance = random.uniform(0, 2400, (5, 1, 3, 2)), np.tile([9.0, 3.0, 4.0], (5, 1, 3, 1))
    covariance[:2, :, 1] = 0.0
    tracked = way + 5.0
    trace = replace(
        made, scenario=Scenario.load("tracking"), node_way=way, node_estimate=tracked, node_covariance=covariance
    )
    for form in ("mcap", "rrd"):
        export_trace(trace, form, tmp_path / f"tracking.{form}")
    bag, scene = messages(tmp_path / "tracking.mcap"), entities(tmp_path / "tracking.rrd")
    assert {topic.split("/")[1] for topic in bag} >= {"target_A", "target_B", "target_C"}
    assert "/nodes" not in bag
    assert ("/scene/nodes", "constant") not in scene
    for m, name in enumerate("ABC"):
        places = [numbers(message.point) for _, message in bag[f"/target_{name}/position"]]
        np.testing.assert_allclose(np.array(places)[:, :2], way[:, 0, m])
        estimates = bag[f"/target_{name}/estimate"]
        first = 2 if name == "B" else 0
        assert [time for time, _ in estimates] == [round(t * 1e9) for t in trace.time[first:]]
        for t, (_, message) in enumerate(estimates, first):
            np.testing.assert_allclose(numbers(message.pose.pose.position)[:2], tracked[t, 0, m])
            np.testing.assert_allclose(np.reshape(message.pose.covariance, (6, 6))[:2, :2], [[9, 3], [3, 4]])
        drawn = np.array([row[0] for row in scene[f"/scene/target_{name}"]["Points3D:positions"]])
        np.testing.assert_allclose(drawn[:, :2], way[:, 0, m], rtol=1e-6)
        ellipses = scene[f"/scene/tracked/target_{name}"]["Ellipsoids3D:centers"]
        np.testing.assert_allclose([row[0][:2] for row in ellipses], tracked[first:, 0, m], rtol=1e-6)


class TestCommand:
    @pytest.fixture
    def saved(self, trace, tmp_path):
        trace.save(tmp_path / "m.nc")

    @pytest.mark.parametrize("form", ["mcap", "csv"])
    def test_writes_beside_the_caller(self, run_usvauv, saved, tmp_path, form):
        expected = {"mcap": tmp_path / "m.mcap", "csv": tmp_path / "m"}[form]
        assert run_usvauv("export", "m.nc", "--to", form) == (0, f"{form}: {expected}\n", "")
        assert expected.is_file() if form == "mcap" else (expected / "fixes.csv").is_file()

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ("m.nc --to pdf", "--to 'pdf': allowed are csv, parquet, mcap, rrd"),
            ("m.nc --to mcap --out a.rrd", "--out a.rrd: the ending must be .mcap"),
            ("m.nc --to mcap --episode 2", "--episode 2: m.nc has episodes 0 to 1"),
            ("m.nc --to csv --set auv.count=1", "--set auv.count=1: is for a policy; --to writes a trace"),
            (
                "sac-extreme --out a.mcap",
                "--out a.mcap: is for a trace, which needs --to; a policy is written by --onnx",
            ),
        ],
    )
    def test_refusals(self, run_usvauv, saved, tmp_path, arguments, message):
        before = {*tmp_path.iterdir()}
        assert run_usvauv("export", *arguments.split()) == (2, "", f"error: {message}\n")
        assert {*tmp_path.iterdir()} == before

    def test_a_missing_library_is_named_with_its_extra(self, run_usvauv, saved, monkeypatch):
        monkeypatch.setitem(__import__("sys").modules, "mcap", None)
        message = '--to mcap: needs the extra export (mcap is missing): pip install "usvauv[export]"'
        assert run_usvauv("export", "m.nc", "--to", "mcap") == (2, "", f"error: {message}\n")
