"""A trace in other tools' formats, read back by a library that did not write it where there is one."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rerun.chunk import RrdReader

from tests.usvauv_cli.test_video import synthetic_trace
from usvauv_env.exchange import formats
from usvauv_env.exchange.poses import Poses, triangles
from usvauv_env.exchange.tables import tables
from usvauv_env.record.collection import served
from usvauv_env.record.trace import VARIABLES
from usvauv_env.render.style import auv_colour
from usvauv_env.site.site import Site

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
    with path.open("rb") as file:
        found = {}
        for _, channel, message, content in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


@pytest.fixture(scope="module")
def entities(trace, tmp_path_factory):
    path = tmp_path_factory.mktemp("rrd") / "mission.rrd"
    formats.write(trace, "rrd", path, world=1)
    reader = RrdReader(path)
    assert len(reader.blueprints()) == 1
    found = {}
    for chunk in reader.stream().to_chunks():
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


class TestPoses:
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


class TestRerun:
    def test_positions_over_time(self, trace, entities):
        for name, places in (("auv_1", trace.auv_position[:, 1, 1]), ("usv_0", trace.boat_position[:, 1, 0])):
            frame = entities[f"/scene/{name}"]
            read = np.stack([row[0] for row in frame["Points3D:positions"]])
            np.testing.assert_allclose(read[:, :2], places, rtol=1e-6)
            seconds = pd.to_timedelta(frame["mission"]).dt.total_seconds()
            np.testing.assert_array_equal(seconds, trace.time)

    def test_places_on_earth(self, trace, entities):
        for name, places in (("auv_0", trace.auv_position[:, 1, 0]), ("usv_0", trace.boat_position[:, 1, 0])):
            latitude, longitude = np.stack([row[0] for row in entities[f"/earth/{name}"]["GeoPoints:positions"]]).T
            back = np.column_stack(Site(trace.scenario).frame.to_local(longitude, latitude))
            np.testing.assert_allclose(back, places, atol=1e-6)

    def test_colours_are_those_of_the_video(self, entities):
        for k in range(2):
            blue, green, red = auv_colour(k)
            for place, kind in ((f"/scene/auv_{k}", "Points3D"), (f"/error/auv_{k}", "SeriesLines")):
                colour = int(entities[place, "constant"][f"{kind}:colors"][0][0])
                assert colour.to_bytes(4) == bytes((red, green, blue, 255))

    def test_ellipses_are_two_standard_deviations(self, trace, entities):
        frame = entities["/scene/fixes/auv_0"]
        assert len(frame) == STEPS - 1
        half, turn = (frame[f"Ellipsoids3D:{name}"][0][0] for name in ("half_sizes", "quaternions"))
        angle = 2 * np.arctan2(turn[2], turn[3])
        axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        matrix = axes @ np.diag(half[:2] ** 2 / 4) @ axes.T
        xx, xy, yy = trace.fix_covariance[0, 1, 0]
        np.testing.assert_allclose(matrix, [[xx, xy], [xy, yy]], rtol=1e-5)

    def test_sea_and_curves(self, trace, entities):
        assert len(entities["/scene/sea"]) == STEPS
        assert {"/earth/auv_0", "/error/auv_0", "/power/auv_1", "/backlog"} < entities.keys()
        read = np.concatenate(entities["/backlog"]["Scalars:scalars"])
        np.testing.assert_allclose(read, trace.backlog[:, 1].sum(-1))


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
