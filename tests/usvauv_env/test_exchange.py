"""A trace in other tools' formats, read back by a library that did not write it where there is one."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rerun.chunk import RrdReader

from tests.usvauv_env.made_traces import synthetic_trace
from usvauv.env.exchange import formats, rerun_recording
from usvauv.env.exchange.poses import Poses, triangles
from usvauv.env.exchange.tables import tables
from usvauv.env.record.metrics import served
from usvauv.env.record.trace import VARIABLES
from usvauv.env.render.style import SEA, auv_colour
from usvauv.env.site.site import Site

STEPS = 60


@pytest.fixture(scope="module")
def trace():
    """Two worlds at a place on Earth, with a fix missing, a slope under the boat and an AUV that hovers."""
    made = synthetic_trace(steps=STEPS, worlds=2)
    water = made.scenario.water.model_copy(update={"latitude": 22.51, "longitude": 114.02})
    fix, surface = made.fix.copy(), made.boat_surface.copy()
    fix[3, :, 0] = np.nan
    surface[..., 1:] = 0.3, -0.2
    return replace(made, scenario=made.scenario.model_copy(update={"water": water}), fix=fix, boat_surface=surface)


@pytest.fixture(scope="module")
def messages(trace, tmp_path_factory):
    path = tmp_path_factory.mktemp("mcap") / "mission.mcap"
    formats.write(trace, "mcap", path, world=1)
    return read(path, "mcap")


@pytest.fixture(scope="module")
def entities(trace, tmp_path_factory):
    path = tmp_path_factory.mktemp("rrd") / "mission.rrd"
    formats.write(trace, "rrd", path, world=1)
    assert len(RrdReader(path).blueprints()) == 1
    return read(path, "rrd")


@pytest.fixture(scope="module")
def wide():
    """World 0 of another: 300 m by 200 m, a step of 0.3 s, AUV 0 at rest at first, boat and data that move."""
    made = synthetic_trace(steps=7, worlds=2, area=(300.0, 200.0), nodes=4, seed=5)
    random = np.random.default_rng(4)
    velocity, slope = made.auv_velocity.copy(), made.boat_surface.copy()
    velocity[:3, :, 0] = 0.0
    velocity[3, :, 0], velocity[4:, :, 0] = (-1.0, 2.0), 0.0
    slope[..., 1:] = random.normal(size=slope[..., 1:].shape)
    covariance = random.uniform(1, 3, made.fix_covariance.shape) * (1, 0.2, 1)
    return replace(
        made,
        time=0.3 * made.time,
        auv_velocity=velocity,
        boat_surface=slope,
        fix_covariance=covariance,
        estimate_covariance=2 * covariance,
        power=random.uniform(90, 200, made.power.shape),
        backlog=random.uniform(0, 99, made.backlog.shape),
    )


def read(path, form):
    if form == "mcap":
        with path.open("rb") as file:
            found = {}
            for _, channel, message, content in make_reader(
                file, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages():
                found.setdefault(channel.topic, []).append((message.log_time, content))
        return found
    found = {}
    for chunk in RrdReader(path).stream().to_chunks():
        key = (chunk.entity_path, "constant") if chunk.is_static else chunk.entity_path
        found.setdefault(key, []).append(chunk.to_record_batch().to_pandas())
    return {key: tables[0] if isinstance(key, str) else pd.concat(tables, axis=1) for key, tables in found.items()}


class TestTables:
    def test_each_variable_of_a_thing_is_in_its_table(self, trace):
        made = tables(trace)
        in_things = {
            name for name, about in VARIABLES.items() if {"auv", "boat", "node", "vortex"} & {*about.dimensions}
        }
        columns = {column for table in made.values() for column in table}
        assert not [name for name in in_things if not any(column.startswith(name) for column in columns)]
        assert {"overflowing", "collisions", "packets_created", "packets_lost"} < made["worlds"].keys()

    def test_rows_are_those_of_xarray(self, trace, tmp_path):
        import xarray

        trace.save(tmp_path / "mission.nc")
        with xarray.open_dataset(tmp_path / "mission.nc") as dataset:
            expected = dataset[["power", "target", "hovering"]].to_dataframe().reset_index()
            made = pd.DataFrame(tables(trace)["auvs"])[["time", "world", "auv", "power", "target", "hovering"]]
        keys = ["time", "world", "auv"]
        merged = made.merge(expected, on=keys, suffixes=("", "_expected"), validate="one_to_one")
        assert len(merged) == len(expected) == STEPS * 2 * 2
        for name in ("power", "target", "hovering"):
            np.testing.assert_array_equal(merged[name], merged[f"{name}_expected"])

    def test_parts_of_a_vector_and_what_does_not_change(self, trace):
        nodes = pd.DataFrame(tables(trace)["nodes"]).set_index(["time", "world", "node"])
        row = nodes.loc[(7.0, 1, 4)]
        assert tuple(row[["node_position_x", "node_position_y"]]) == tuple(trace.node_position[1, 4])
        assert row["backlog"] == trace.backlog[6, 1, 4]

    def test_fixes_are_those_that_were_made(self, trace):
        table = pd.DataFrame(tables(trace)["fixes"])
        assert len(table) == STEPS * 2 * 2 - 2
        row = table[(table.time == 9.0) & (table.world == 1) & (table.auv == 1)].iloc[0]
        assert (row.x, row.y, row.depth) == (*trace.fix[8, 1, 1], trace.scenario.auv.depth)
        assert (row.covariance_xx, row.covariance_xy, row.covariance_yy) == tuple(trace.fix_covariance[8, 1, 1])

    def test_services_name_the_node_that_was_served(self, trace):
        table, (step, world, auv, node) = tables(trace)["services"], served(trace)
        assert len(table["time"]) == len(step) > 0
        for name, expected in (("time", trace.time[step]), ("world", world), ("auv", auv), ("node", node)):
            np.testing.assert_array_equal(table[name], expected)

    @pytest.mark.parametrize("form", ["csv", "parquet"])
    def test_files_hold_the_tables(self, trace, tmp_path, form):
        formats.write(trace, form, tmp_path)
        for name, table in tables(trace).items():
            path = tmp_path / f"{name}.{form}"
            read = pd.read_csv(path) if form == "csv" else pyarrow.parquet.read_table(path).to_pandas()
            assert [*read] == [*table]
            for column, values in table.items():
                np.testing.assert_allclose(read[column], values, rtol=1e-6)


def rotated(turn, vector):
    """A vector turned by a quaternion x, y, z, w."""
    return vector + 2 * np.cross(turn[:3], np.cross(turn[:3], vector) + turn[3] * np.asarray(vector))


class TestPoses:
    def test_everything_is_at_its_place_and_height(self, wide):
        poses, depth = Poses.of(wide), wide.scenario.auv.depth
        for name, places in (("auvs", wide.auv_position), ("fixes", wide.fix), ("estimates", wide.estimate)):
            expected = np.concatenate([places[:, 0], np.full((7, 2, 1), -depth)], -1)
            np.testing.assert_array_equal(getattr(poses, name), expected)
        np.testing.assert_array_equal(poses.boats[..., :2], wide.boat_position[:, 0])
        np.testing.assert_array_equal(poses.boats[..., 2], wide.boat_surface[:, 0, :, 0])
        np.testing.assert_array_equal(poses.nodes[:, :2], wide.node_position[0])
        assert (poses.nodes[:, 2] == -wide.scenario.area.depth).all()
        sea = poses.sea.reshape(7, *wide.surface.shape[1:], 3)
        rows, columns = np.indices(wide.surface.shape[1:])
        for step in (0, 6):
            np.testing.assert_allclose(sea[step, ..., 0], (columns + 0.5) * 300 / 64)
            np.testing.assert_allclose(sea[step, ..., 1], (rows + 0.5) * 200 / 48)
            np.testing.assert_array_equal(sea[step, ..., 2], wide.surface[step])

    def test_turns_are_unit_and_those_of_ways_and_slopes(self, wide):
        poses = Poses.of(wide)
        for turn in (poses.auv_turn, poses.boat_turn):
            np.testing.assert_allclose(np.linalg.norm(turn, axis=-1), 1)
        way = np.array([-1.0, 2.0, 0.0]) / np.sqrt(5)
        for t in range(7):
            ahead = (1.0, 0.0, 0.0) if t < 3 else way  # east before it has moved
            np.testing.assert_allclose(rotated(poses.auv_turn[t, 0], np.array([1.0, 0, 0])), ahead, atol=1e-12)
            x, y = wide.boat_surface[t, 0, 0, 1:]
            normal = np.array([-x, -y, 1.0]) / np.sqrt(1 + x * x + y * y)
            np.testing.assert_allclose(rotated(poses.boat_turn[t, 0], np.array([0, 0, 1.0])), normal, atol=1e-12)
            assert poses.boat_turn[t, 0, 2] == 0  # the least turn

    def test_a_sea_that_was_not_recorded_has_no_points(self):
        calm = synthetic_trace(steps=2, sea=False)
        assert Poses.of(calm).sea.shape[0] == 0
        assert triangles(calm).shape == (0, 3)

    def test_a_boat_lies_on_the_slope_of_the_water(self, trace):
        x, y, z, w = Poses.of(trace).boat_turn[0, 0]
        up = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)  # third column of the turn's matrix
        np.testing.assert_allclose(up, np.array([-0.3, 0.2, 1]) / np.hypot(1, np.hypot(0.3, 0.2)), atol=1e-12)

    def test_an_auv_points_along_its_way_and_keeps_its_heading_while_it_hovers(self, trace):
        hovers = int(trace.hovering[:, 0].any(0).argmax())
        x, y, z, w = Poses.of(trace).auv_turn[:, hovers].T
        velocity = trace.auv_velocity[:, 0, hovers]
        heading = 2 * np.arctan2(z, w)
        moving = (velocity != 0).any(-1)
        assert moving[0]
        assert not moving.all()
        error = heading - np.arctan2(velocity[:, 1], velocity[:, 0])
        np.testing.assert_allclose(np.cos(error[moving]), 1, atol=1e-12)
        first = int(np.argmin(moving))
        assert heading[first] == heading[first - 1]
        assert not x.any()
        assert not y.any()

    def test_triangles_cover_the_surface_once_and_face_up(self, trace):
        points = Poses.of(trace).sea[0]
        a, b, c = np.moveaxis(points[triangles(trace)][..., :2], 1, 0)
        areas = np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] / 2
        assert (areas > 0).all()
        covered = np.prod(np.ptp(points[:, :2], axis=0))
        assert areas.sum() == pytest.approx(covered)


class TestMcap:
    """Written with rosbags, read with the library of MCAP's makers."""

    def test_every_topic_at_every_step(self, messages):
        bodies = ("auv_0", "auv_1", "usv_0")
        counts = {topic: len(each) for topic, each in messages.items()}
        expected = {"/tf", "/nodes", "/sea", "/usv_0/goal"} | {
            f"/{name}/{of}" for name in bodies for of in ("pose", "navsat")
        }
        expected |= {f"/auv_{k}/{of}" for k in (0, 1) for of in ("velocity", "fix", "estimate")}
        assert counts == dict.fromkeys(expected, STEPS) | {"/auv_0/fix": STEPS - 1}

    def test_poses_are_those_of_the_episode(self, trace, messages):
        for t, (when, message) in enumerate(messages["/auv_1/pose"]):
            at = message.pose.position
            assert (at.x, at.y, at.z) == (*trace.auv_position[t, 1, 1], -trace.scenario.auv.depth)
            assert when == trace.time[t] * 1e9 == message.header.stamp.sec * 1e9
        transforms = messages["/tf"][5][1].transforms
        assert [each.child_frame_id for each in transforms] == ["auv_0", "auv_1", "usv_0"]
        assert transforms[2].transform.translation.z == pytest.approx(trace.boat_surface[5, 1, 0, 0])

    def test_fixes_have_their_covariance(self, trace, messages):
        pose = messages["/auv_0/fix"][0][1].pose
        assert (pose.pose.position.x, pose.pose.position.y) == tuple(trace.fix[0, 1, 0])
        matrix = np.reshape(pose.covariance, (6, 6))
        xx, xy, yy = trace.fix_covariance[0, 1, 0]
        assert matrix[:2, :2].tolist() == [[xx, xy], [xy, yy]]

    def test_places_on_earth(self, trace, messages):
        place = messages["/usv_0/navsat"][2][1]
        back = Site(trace.scenario).frame.to_local(np.array(place.longitude), np.array(place.latitude))
        np.testing.assert_allclose(back, trace.boat_position[2, 1, 0], atol=1e-6)

    def test_clouds(self, trace, messages):
        sea, nodes = messages["/sea"][4][1], messages["/nodes"][4][1]
        points = np.frombuffer(bytes(sea.data), "<f4").reshape(-1, len(sea.fields))
        np.testing.assert_array_equal(points[:, 2], trace.surface[4].ravel())
        assert np.ptp(points[:, 0]) < trace.scenario.area.width
        assert [field.name for field in nodes.fields] == ["x", "y", "z", "backlog"]
        assert [(field.offset, field.datatype, field.count) for field in nodes.fields] == [
            (4 * i, 7, 1)
            for i in range(4)  # 7: FLOAT32 of sensor_msgs/PointField
        ]
        columns = np.frombuffer(bytes(nodes.data), "<f4").reshape(nodes.width, nodes.point_step // 4)
        np.testing.assert_array_equal(columns[:, 3], trace.backlog[4, 1].astype(np.float32))

    @pytest.fixture(scope="class")
    @classmethod
    def bag(cls, wide, tmp_path_factory):
        path = tmp_path_factory.mktemp("wide") / "wide.mcap"
        water = wide.scenario.water.model_copy(update={"latitude": 22.51, "longitude": 114.02})
        formats.write(replace(wide, scenario=wide.scenario.model_copy(update={"water": water})), "mcap", path)
        return read(path, "mcap")

    def test_messages_have_all_of_their_fields(self, wide, bag):
        poses, t = Poses.of(wide), 4

        def near(*pairs):
            for message, expected in pairs:
                names = ("x", "y", "z", "w")[: len(expected)]
                np.testing.assert_allclose([getattr(message, name) for name in names], expected, atol=1e-9)

        for topic, each in bag.items():
            when, message = each[t]
            assert when == round(wide.time[t] * 1e9), topic
            header = message.transforms[0].header if topic == "/tf" else message.header
            assert header.stamp.sec * 10**9 + header.stamp.nanosec == when
            assert header.stamp.nanosec == 500_000_000
            assert header.frame_id == "map"
        for k in (0, 1):
            pose, twist = bag[f"/auv_{k}/pose"][t][1].pose, bag[f"/auv_{k}/velocity"][t][1].twist
            near((pose.position, poses.auvs[t, k]), (pose.orientation, poses.auv_turn[t, k]))
            near((twist.linear, [*wide.auv_velocity[t, 0, k], 0]), (twist.angular, [0, 0, 0]))
            for name, places, covariance in (
                ("fix", poses.fixes, wide.fix_covariance),
                ("estimate", poses.estimates, wide.estimate_covariance),
            ):
                pose = bag[f"/auv_{k}/{name}"][t][1].pose
                near((pose.pose.position, places[t, k]), (pose.pose.orientation, (0, 0, 0, 1)))
                matrix, (xx, xy, yy) = np.reshape(pose.covariance, (6, 6)), covariance[t, 0, k]
                np.testing.assert_array_equal(matrix[:2, :2], [[xx, xy], [xy, yy]])
                assert not matrix[2].any()
                assert not matrix[:2, 2:].any()
                turn = matrix[3:, 3:]
                assert (turn == np.diag(turn.diagonal())).all()
                assert (turn.diagonal() > 1e3).all()  # unknown
        pose, goal = bag["/usv_0/pose"][t][1].pose, bag["/usv_0/goal"][t][1].point
        near((pose.position, poses.boats[t, 0]), (pose.orientation, poses.boat_turn[t, 0]))
        near((goal, [*wide.boat_goal[t, 0, 0], 0]))
        bodies = [("auv_0", poses.auvs[t, 0], poses.auv_turn[t, 0]), ("auv_1", poses.auvs[t, 1], poses.auv_turn[t, 1])]
        bodies += [("usv_0", poses.boats[t, 0], poses.boat_turn[t, 0])]
        for (name, place, turn), each in zip(bodies, bag["/tf"][t][1].transforms, strict=True):
            assert each.child_frame_id == name
            near((each.transform.translation, place), (each.transform.rotation, turn))
            fix = bag[f"/{name}/navsat"][t][1]
            assert fix.altitude == place[2]
            assert fix.latitude == pytest.approx(22.51, abs=0.01)
            assert fix.longitude == pytest.approx(114.02, abs=0.01)
            assert (fix.status.status, fix.status.service, fix.position_covariance_type) == (0, 0, 0)  # as in UNKNOWN
            assert not any(fix.position_covariance)

    @pytest.mark.parametrize(("topic", "count", "fields"), [("/nodes", 4, 4), ("/sea", 48 * 64, 3)])
    def test_clouds_are_one_row_of_dense_points(self, wide, bag, topic, count, fields):
        cloud, poses = bag[topic][4][1], Poses.of(wide)
        assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (
            1,
            count,
            4 * fields,
            4 * fields * count,
        )
        assert not cloud.is_bigendian
        assert cloud.is_dense
        points = np.frombuffer(bytes(cloud.data), "<f4").reshape(count, fields)
        expected = poses.sea[4] if topic == "/sea" else np.column_stack([poses.nodes, wide.backlog[4, 0]])
        np.testing.assert_allclose(points, expected, rtol=1e-6)


class TestRerun:
    @pytest.fixture(scope="class")
    @classmethod
    def scene(cls, wide, tmp_path_factory):
        path = tmp_path_factory.mktemp("scene") / "wide.rrd"
        formats.write(wide, "rrd", path)
        return read(path, "rrd")

    def test_curves_and_what_does_not_change(self, wide, scene):
        poses = Poses.of(wide)
        assert not any("/earth" in (key if isinstance(key, str) else key[0]) for key in scene)
        for k in (0, 1):
            error = np.hypot(*(poses.estimates - poses.auvs)[:, k, :2].T)
            for name, values in (("error", error), ("power", wide.power[:, 0, k])):
                np.testing.assert_allclose(np.concatenate(scene[f"/{name}/auv_{k}"]["Scalars:scalars"]), values)
                assert scene[f"/{name}/auv_{k}", "constant"]["SeriesLines:names"][0][0] == f"auv_{k}"
            frame, fixes = scene[f"/scene/fixes/auv_{k}"], scene[f"/scene/fixes/auv_{k}", "constant"]
            red = int(fixes["Ellipsoids3D:colors"][0][0]).to_bytes(4)[0]
            assert red == auv_colour(k)[2]
            for t in range(7):
                half, turn = (
                    np.asarray(frame[f"Ellipsoids3D:{name}"][t][0], float) for name in ("half_sizes", "quaternions")
                )
                axes = np.array([rotated(turn, axis) for axis in np.eye(3)[:2]])[:, :2]
                xx, xy, yy = wide.fix_covariance[t, 0, k]
                np.testing.assert_allclose(axes.T @ np.diag(half[:2] ** 2 / 4) @ axes, [[xx, xy], [xy, yy]], rtol=1e-5)
                assert 0 < half[2] < 0.1
                np.testing.assert_allclose(frame["Ellipsoids3D:centers"][t][0], poses.fixes[t, k], rtol=1e-6)
        np.testing.assert_allclose(np.concatenate(scene["/backlog"]["Scalars:scalars"]), wide.backlog[:, 0].sum(1))
        nodes = scene["/scene/nodes", "constant"]
        np.testing.assert_allclose(np.stack(nodes["Points3D:positions"][0]), poses.nodes, rtol=1e-6)
        radii = [scene[f"/scene/{name}", "constant"]["Points3D:radii"][0][0] for name in ("auv_0", "usv_0", "nodes")]
        assert radii[0] == radii[1] == pytest.approx(2 * radii[2])
        assert 0.005 < radii[0] / np.hypot(300, 200) < 0.01
        assert ("/scene", "constant") in scene

    def test_the_sea_is_coloured_from_its_lowest_to_its_highest(self, wide, scene):
        frame, poses = scene["/scene/sea"], Poses.of(wide)
        assert len(frame) == 7
        limit = np.abs(wide.surface).max()
        for t in (0, 5):
            np.testing.assert_allclose(np.stack(frame["Mesh3D:vertex_positions"][t]), poses.sea[t], rtol=1e-6)
            colours = np.array([list(int(each).to_bytes(4))[:3] for each in frame["Mesh3D:vertex_colors"][t]])
            for channel in range(3):
                stops = [colour[2 - channel] for colour in SEA]
                expected = np.interp(wide.surface[t].ravel(), np.linspace(-limit, limit, len(SEA)), stops)
                np.testing.assert_allclose(colours[:, channel], expected, atol=1)
        shown = np.stack(scene["/scene/sea", "constant"]["Mesh3D:triangle_indices"][0])
        np.testing.assert_array_equal(shown, triangles(wide))

    def test_a_run_without_sea_or_fixes_has_neither(self, wide, tmp_path):
        calm = replace(wide, surface=np.zeros((0, 0, 0), np.float32), fix=np.full_like(wide.fix, np.nan))
        for form in ("rrd", "mcap"):
            formats.write(calm, form, tmp_path / f"calm.{form}")
        assert not {"/sea", "/auv_0/fix"} & read(tmp_path / "calm.mcap", "mcap").keys()
        found = {key if isinstance(key, str) else key[0] for key in read(tmp_path / "calm.rrd", "rrd")}
        assert not {"/scene/sea", "/scene/fixes/auv_0"} & found
        assert {"/scene/auv_1", "/scene/usv_0", "/error/auv_0"} < found

    def test_the_layout_has_trails_of_all_that_moves_and_a_map_where_there_is_a_place(self, wide, trace):
        for which, places in ((wide, False), (trace, True)):
            blueprint = rerun_recording._layout(which)
            scene, beside = blueprint.root_container.contents
            assert set(scene.visualizer_overrides) == {"/scene/auv_0", "/scene/auv_1", "/scene/usv_0"}
            assert [view.name for view in beside.contents] == ["Map"] * places + [*rerun_recording.CURVES.values()]
            assert blueprint.collapse_panels
            assert blueprint.root_container.column_shares[0] > blueprint.root_container.column_shares[1]
            ranges = scene.visualizer_overrides["/scene/auv_0"].ranges.as_arrow_array().to_pylist()[0]
            assert ranges["timeline"] == "mission"
            assert ranges["range"]["start"] < 0 == ranges["range"]["end"]


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
            ("m.nc extreme --to csv", "SCENARIO extreme: is for a policy; --to writes a trace"),
            ("m.nc --to csv --set auv.count=1", "--set auv.count=1: is for a policy; --to writes a trace"),
            ("m.nc --to csv --onnx a.onnx", "--onnx a.onnx: is for a policy; --to writes a trace"),
            ("sac-ideal --out a.mcap", "--out a.mcap: is for a trace, which needs --to; a policy is written by --onnx"),
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
