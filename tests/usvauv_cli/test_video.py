"""The video: what it says and where it draws it, and that the file is whole or absent."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import av
import cv2
import numpy as np
import pytest

from kernels.positioning import usbl
from usvauv_cli.mission_video import VideoSettings, render
from usvauv_env.files import OutputError
from usvauv_env.record.metrics import episode_metrics
from usvauv_env.record.trace import Trace
from usvauv_env.render import style, symbols
from usvauv_env.render.exchanges import PING_FRAMES, pings
from usvauv_env.render.frame_layout import Layout, MapView, Rectangle
from usvauv_env.render.map import error_axes
from usvauv_env.render.painter import Look, Painter, painter_of
from usvauv_env.render.plots import RecordedPlot
from usvauv_env.render.reply_field import ReplyField
from usvauv_env.render.running_metrics import RunningMetrics, figures
from usvauv_env.render.sea_layers import CurrentStreaks, SeaSurface
from usvauv_env.render.text import shorten, text_width, write
from usvauv_env.scenario import Scenario
from usvauv_env.sections.sea import Area


def synthetic_trace(
    steps: int = 60,
    auvs: int = 2,
    nodes: int = 30,
    area: tuple[float, float] = (200.0, 200.0),
    vortices: int = 4,
    sea: bool = True,
    worlds: int = 1,
    seed: int = 0,
) -> Trace:
    """A small plausible mission without the simulator: AUVs run to nodes, hover, go on; the boat stays between them."""
    width, length = area
    random = np.random.default_rng(seed)
    overrides = [f"area.width={width}", f"area.length={length}", f"auv.count={auvs}", f"nodes.count={nodes}"]
    scenario = Scenario.load("extreme", [*overrides, "auv.start_separation=1", f"mission.duration={steps}"])
    node = random.uniform(0.05, 0.95, (worlds, nodes, 2)) * area
    rate = random.choice([3.0, 5.0, 8.0, 12.0], (worlds, nodes))
    shape = (steps, worlds, auvs)
    position, velocity = np.zeros((*shape, 2)), np.zeros((*shape, 2))
    target, hovering = np.zeros(shape, np.int16), np.zeros(shape, np.int8)
    service_rate, delivered = np.zeros(shape), np.zeros(shape)
    backlog, boat = np.zeros((steps, worlds, nodes)), np.zeros((steps, worlds, 2))
    for w in range(worlds):
        now, left = random.uniform(0.1, 0.9, (auvs, 2)) * area, np.zeros(auvs)
        goal = random.permutation(nodes)[np.arange(auvs) % nodes]
        data, usv = random.uniform(0, 4900, nodes), np.array(area) / 2
        for t in range(steps):
            data = np.minimum(data + random.poisson(rate[w]), 5000)
            for k in range(auvs):
                way = node[w, goal[k]] - now[k]
                if left[k] > 0:
                    hovering[t, w, k] = 1
                    left[k] -= 1
                    if left[k] <= 0:
                        service_rate[t, w, k] = random.uniform(0.2, 0.3)
                        delivered[t, w, k] = 2 * data[goal[k]] / 5000
                        data[goal[k]] = 0
                        goal[k] = random.integers(nodes)
                else:
                    velocity[t, w, k] = 1.6 * way / max(np.hypot(*way), 1e-9)
                    now[k] += velocity[t, w, k] + 0.2 * random.standard_normal(2)
                    if np.hypot(*(node[w, goal[k]] - now[k])) < 6:
                        left[k] = 8
            usv += np.clip(now.mean(0) - usv, -2, 2)
            position[t, w], target[t, w], backlog[t, w], boat[t, w] = now, goal, data, usv
    covariance = np.zeros((*shape, 3))
    covariance[..., 0], covariance[..., 1], covariance[..., 2] = 0.09, 0.03, 0.04
    errors = random.multivariate_normal([0, 0], [[0.09, 0.03], [0.03, 0.04]], shape)
    time = np.arange(1, steps + 1, dtype=float)
    y, x = np.mgrid[0:48, 0:64]
    wave = [3 * np.sin(0.09 * x + 0.05 * y - 0.05 * t) + 1.5 * np.sin(0.14 * y - 0.05 * x - 0.08 * t) for t in time]
    surface = np.array(wave, np.float32)
    elevation = surface[:, 24, 32][:, None] * np.ones((1, worlds)) if sea else np.zeros((steps, worlds))
    vortex = np.stack(
        [
            random.uniform(0, width, (worlds, vortices)),
            random.uniform(0, length, (worlds, vortices)),
            random.choice([-1, 1], (worlds, vortices)) * random.uniform(120, 300, (worlds, vortices)),
            random.uniform(25, 45, (worlds, vortices)),
        ],
        axis=-1,
    )
    return Trace(
        scenario=scenario,
        policy="straight:1.6",
        usv="centroid",
        seed=seed,
        reward_names=("service",),
        node_position=node,
        start="",
        node_rate=rate,
        time=time,
        auv_position=position,
        auv_velocity=velocity,
        fix=position + errors,
        heard_position=position,
        fix_covariance=covariance,
        fix_flags=np.ones(shape, np.uint8),
        fix_boat=np.zeros(shape, np.int8),
        served_by=np.zeros(shape, np.int8),
        estimate=position + errors,
        estimate_covariance=covariance,
        own_position=position + errors,
        foreseen_position=position + errors,
        target=target,
        hovering=hovering,
        power=np.where(hovering, 105.0, 160.0 + 10 * random.standard_normal(shape)),
        service_rate=service_rate,
        delivered=delivered,
        border=np.zeros(shape, np.int8),
        reward_terms=service_rate[..., None],
        boat_position=boat[:, :, None],
        boat_goal=boat[:, :, None] + np.array([4.0, 3.0]),
        boat_surface=np.stack([elevation, 0 * elevation, 0 * elevation], -1)[:, :, None],
        backlog=backlog,
        overflowing=(backlog >= 5000).sum(-1).astype(np.int16),
        collisions=np.zeros((steps, worlds), np.int16),
        packets_created=np.zeros((steps, worlds), np.int32),
        packets_lost=np.zeros((steps, worlds), np.int32),
        packets_delivered=np.zeros(shape, np.int32),
        vortex=np.broadcast_to(vortex, (steps, *vortex.shape)),
        stream_time=np.zeros(0),
        stream=np.zeros((0, 0, 0, 2)),
        surface=surface if sea else np.zeros((0, 0, 0), np.float32),
    )


def paint(trace: Trace, t: int, size: tuple[int, int] = (640, 360)) -> tuple[np.ndarray, Painter]:
    """The frame of step t."""
    painter = Painter(trace, size)
    for step in range(t + 1):
        frame = painter.frame(step)
    return frame.copy(), painter


def place(painter: Painter, x: float, y: float, area: tuple[float, float] = (200.0, 200.0)) -> tuple[int, int]:
    """Row and column where a position in metres belongs, by proportion."""
    box = painter.layout.map
    return round(box.bottom - y / area[1] * box.height), round(box.left + x / area[0] * box.width)


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """A trace, its video, what `render` returned, and what it told of its progress."""
    trace = synthetic_trace(steps=12)
    path = tmp_path_factory.mktemp("video") / "mission.mp4"
    told = []
    summary = render([trace], path, VideoSettings((640, 360), 24), told.append)
    return trace, path, summary, told


class TestFile:
    def test_is_what_browsers_play(self, video):
        with av.open(str(video[1])) as file:
            stream = file.streams.video[0]
            codec = stream.codec_context
            assert (codec.name, codec.pix_fmt, codec.width, codec.height) == ("h264", "yuv420p", 640, 360)
            assert stream.average_rate == 24
            assert sum(1 for _ in file.decode(stream)) == 12
        content = video[1].read_bytes()
        assert content.index(b"moov") < content.index(b"mdat")  # starts to play before it is loaded

    def test_summary_and_progress(self, video):
        _, path, summary, told = video
        assert (summary.path, summary.frames, summary.size, summary.fps) == (path, 12, (640, 360), 24)
        assert summary.seconds == pytest.approx(0.5)
        assert summary.bytes == path.stat().st_size
        assert told == [1] * 12
        assert [entry.name for entry in path.parent.iterdir()] == [path.name]

    def test_colours_survive(self, video):
        trace, path, _, _ = video
        with av.open(str(path)) as file:
            frame = next(file.decode(video=0))

        assert frame.colorspace == 1  # the file says that its colours are BT.709's
        blue, green, red = np.moveaxis(paint(trace, 0)[0].astype(float), -1, 0)
        brightness = 16 + 219 / 255 * (0.2126 * red + 0.7152 * green + 0.0722 * blue)  # BT.709
        box = Layout.fit(640, 360, Area()).map
        stored = frame.to_ndarray()[:360]
        assert abs(box.of(stored).mean() - box.of(brightness).mean()) < 1.0

    def test_odd_sizes_become_even(self, tmp_path):
        summary = render([synthetic_trace(steps=2)], tmp_path / "odd.mp4", VideoSettings((483, 361)))
        assert summary.size == (482, 360)
        with av.open(str(tmp_path / "odd.mp4")) as file:
            assert (file.streams.video[0].width, file.streams.video[0].height) == (482, 360)

    @pytest.mark.parametrize("size", [(200, 360), (640, 100), (8000, 4000)])
    def test_impossible_sizes_are_refused(self, tmp_path, size):
        with pytest.raises(OutputError, match=r"mission\.mp4.*size.*320 to 7680"):
            render([synthetic_trace(steps=2)], tmp_path / "mission.mp4", VideoSettings(size))

    @pytest.mark.parametrize("ending", [KeyboardInterrupt, RuntimeError])
    def test_what_is_cut_short_leaves_nothing(self, tmp_path, ending):
        def stop(_: int) -> None:
            raise ending

        with pytest.raises(ending):
            render([synthetic_trace(steps=4)], tmp_path / "mission.mp4", VideoSettings((320, 320)), stop)
        assert list(tmp_path.iterdir()) == []

    def test_an_older_video_outlives_a_failure(self, tmp_path, monkeypatch):
        path = tmp_path / "mission.mp4"
        path.write_bytes(b"older")

        def full_disk(*_: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("usvauv_env.files.os.replace", full_disk)
        with pytest.raises(OutputError, match=r"mission\.mp4: cannot be written: No space left on device"):
            render([synthetic_trace(steps=2)], path, VideoSettings((320, 320)))
        assert path.read_bytes() == b"older"
        assert list(tmp_path.iterdir()) == [path]

    def test_unwritable_places_give_one_line(self, tmp_path):
        (tmp_path / "file").write_text("")
        (tmp_path / "folder.mp4").mkdir()
        before = sorted(tmp_path.rglob("*"))
        for place in ("missing/mission.mp4", "file/mission.mp4", "folder.mp4"):
            with pytest.raises(OutputError) as caught:
                render([synthetic_trace(steps=2)], tmp_path / place, VideoSettings((320, 320)))
            assert str(tmp_path / place) in str(caught.value)
            assert "\n" not in str(caught.value)
        assert sorted(tmp_path.rglob("*")) == before


class TestPings:
    def test_one_ring_after_another(self):
        """Where exchanges follow each other faster than rings run, a ring begins when the last is over."""
        rows = PING_FRAMES
        assert pings(np.ones(2 * rows + 1, bool)).tolist() == [0] * rows + [rows] * rows + [2 * rows]
        rare = np.zeros(40, bool)
        rare[[3, 30]] = True
        assert pings(rare).tolist() == [-1] * 3 + [3] * 27 + [30] * 10

    def test_the_line_is_to_who_was_heard(self):
        """Half way from the boat to an AUV the picture changes by its being heard; to the other it stays."""
        trace = synthetic_trace(steps=4)
        trace.fix_flags[:] = usbl.SILENT
        silent, painter = paint(trace, 3)
        trace.fix_flags[3, 0, 0] = usbl.DETECTED
        heard, _ = paint(trace, 3)
        (boat,), auvs = (painter.map.view.pixel(part[3, 0]) for part in (trace.boat_position, trace.auv_position))
        differs = []
        for auv in auvs[:2]:
            x, y = ((boat + auv) / 2).round().astype(int)
            window = slice(y - 3, y + 4), slice(x - 3, x + 4)
            differs.append((silent[window] != heard[window]).any())
        assert differs == [True, False]


def with_second_boat(trace):
    """The trace with another boat at rest in the south-east, which has made the fixes of AUV 1."""
    place = np.full_like(trace.boat_position, 0.0) + np.array([170.0, 30.0])
    return replace(
        trace,
        boat_position=np.concatenate([trace.boat_position, place], axis=2),
        boat_goal=np.concatenate([trace.boat_goal, place + np.array([0.0, 120.0])], axis=2),
        boat_surface=trace.boat_surface.repeat(2, axis=2),
        fix_boat=trace.fix_boat + np.array([0, 1] + [0] * (trace.fix_boat.shape[-1] - 2), np.int8),
    )


class TestBoats:
    def test_every_boat_and_its_goal_are_drawn(self):
        one = synthetic_trace(steps=4)
        two = with_second_boat(one)
        (alone, painter), (both, _) = paint(one, 3), paint(two, 3)
        for x, y in ((170.0, 30.0), (170.0, 150.0), (170.0, 90.0)):  # boat, goal, the dashes between
            row, column = place(painter, x, y)
            window = slice(row - 9, row + 10), slice(column - 9, column + 10)
            assert (alone[window] != both[window]).any()

    def test_lines_are_from_the_boat_that_heard(self):
        two = with_second_boat(synthetic_trace(steps=4))
        two.fix_flags[:] = usbl.SILENT
        silent, painter = paint(two, 3)
        two.fix_flags[3, 0, 1] = usbl.DETECTED
        heard, _ = paint(two, 3)
        boats, auvs = (painter.map.view.pixel(part[3, 0]) for part in (two.boat_position, two.auv_position))
        differs = []
        for boat in boats:
            x, y = (boat + 0.3 * (auvs[1] - boat)).round().astype(int)
            window = slice(y - 3, y + 4), slice(x - 3, x + 4)
            differs.append((silent[window] != heard[window]).any())
        assert differs == [False, True]


class TestForesight:
    TRACE = synthetic_trace(steps=3, auvs=2, nodes=2, vortices=0, sea=False)

    def far(self, level: float = 139.0, **changes) -> Trace:
        """Of `TRACE`, with two AUVs 420 m apart, foreseen where they are; variances 300 and 100 m²."""
        wide = ["area.width=600", "area.length=600", "channel.data_ratio=18", f"acoustics.source_level={level}"]
        estimate = np.zeros_like(self.TRACE.estimate)
        estimate[:, 0] = (90.0, 300.0), (510.0, 300.0)
        covariance = np.zeros_like(self.TRACE.estimate_covariance)
        covariance[:, 0, 0, [0, 2]], covariance[:, 0, 1, [0, 2]] = 300.0, 100.0
        scenario = Scenario.load("extreme", [*wide, "nodes.count=2"])
        known = {"estimate": estimate, "foreseen_position": estimate, "estimate_covariance": covariance}
        return replace(self.TRACE, scenario=scenario, **{**known, **changes})

    def test_a_place_is_worth_what_is_heard_there(self):
        """Beside an AUV its share of the variance, far from both nothing, and where all is heard everything."""
        share = ReplyField(self.far()).share(2)
        assert share.shape == (41, 41)
        assert share[20, 6] == pytest.approx(0.75, abs=0.01)
        assert share[20, 34] == pytest.approx(0.25, abs=0.01)
        assert share[0, 0] < 0.05
        assert ReplyField(self.far(level=190.0)).share(2).min() > 0.999

    def test_lines_are_round_the_auv_that_is_worth_more(self):
        lines = dict(ReplyField(self.far()).lines(2))
        assert not lines[0.8]
        around = np.concatenate(lines[0.6])
        middle = (around.min(axis=0) + around.max(axis=0)) / 2
        assert np.abs(middle - (90, 300)).max() < 20

    def test_where_an_auv_is_foreseen_is_marked(self):
        shifted = self.far().estimate.copy()
        shifted[:, 0, 0] += (0.0, 200.0)
        with_it, painter = paint(self.far(foreseen_position=shifted), 1, (1280, 720))
        without, _ = paint(self.far(), 1, (1280, 720))
        row, column = place(painter, 90.0, 500.0, (600.0, 600.0))
        marked = (
            with_it[row - 8 : row + 9, column - 8 : column + 9] != without[row - 8 : row + 9, column - 8 : column + 9]
        )
        assert marked.any()
        legend = painter.layout.legend
        assert (with_it[legend.bottom - 40 : legend.bottom] != without[legend.bottom - 40 : legend.bottom]).any()


class TestMap:
    @pytest.mark.parametrize("area", [(200.0, 200.0), (400.0, 150.0), (120.0, 300.0)])
    def test_auv_is_where_it_should_be(self, area):
        trace = synthetic_trace(steps=3, auvs=1, nodes=1, area=area, vortices=0, sea=False)
        for x, y in ((0.3, 0.7), (0.6, 0.2)):
            at = np.array([x * area[0], y * area[1]])
            moved = replace(
                trace,
                auv_position=np.broadcast_to(at, (3, 1, 1, 2)),
                fix=np.broadcast_to(at, (3, 1, 1, 2)),
                node_position=np.array([[[0.95 * area[0], 0.95 * area[1]]]]),
                hovering=np.zeros((3, 1, 1), np.int8),
                delivered=np.zeros((3, 1, 1)),
            )
            frame, painter = paint(moved, 0)
            row, column = place(painter, *at, area)
            reach = 14
            around = frame[row - reach : row + reach + 1, column - reach : column + reach + 1]
            rows, columns = np.nonzero((around == style.auv_colour(0)).all(-1))
            assert len(rows) > 20
            # The body's middle lies a little ahead of the position, which is the middle of the whole outline.
            assert abs(rows.mean() - reach) < 5
            assert abs(columns.mean() - reach) < 5

    def test_headings_point_the_right_way(self):
        picture = np.zeros((80, 80, 3), np.uint8)
        symbols.auv(picture, np.array([40.0, 40.0]), np.pi / 2, 60, (255, 255, 255), 4)
        rows = np.nonzero((picture == 255).all(-1))[0]
        band = np.nonzero(picture[:, 40].max(-1) < 60)[0]
        assert rows.min() < 14  # the nose in the north, at the top
        assert ((band > 15) & (band < 35)).any()  # and the dark band near it

    def test_ellipse_axes_are_those_of_the_covariance(self):
        for covariance in ((0.09, 0.03, 0.04), (4.0, -1.9, 1.0), (1.0, 0.0, 0.25), (0.0, 0.0, 0.0)):
            xx, xy, yy = covariance
            axes = error_axes(np.array(covariance))
            np.testing.assert_allclose(axes.T @ axes / 4, [[xx, xy], [xy, yy]], atol=1e-12)
            values = np.linalg.eigvalsh([[xx, xy], [xy, yy]])
            np.testing.assert_allclose(np.hypot(axes[:, 0], axes[:, 1]), 2 * np.sqrt(np.maximum(values, 0)), atol=1e-7)

    def test_two_sigma_ellipse_holds_86_per_cent(self):
        covariance = np.array([[0.09, 0.03], [0.03, 0.04]])
        axes = error_axes(np.array([0.09, 0.03, 0.04]))
        fixes = np.random.default_rng(0).multivariate_normal([0, 0], covariance, 20000)
        inside = (np.linalg.solve(axes.T, fixes.T) ** 2).sum(0) < 1
        assert inside.mean() == pytest.approx(0.8647, abs=0.01)

    def test_node_colour_tells_the_backlog(self):
        trace = synthetic_trace(steps=2, auvs=1, nodes=3, sea=False, vortices=0)
        trace = replace(
            trace,
            node_position=np.array([[[50.0, 50.0], [100.0, 50.0], [150.0, 50.0]]]),
            backlog=np.broadcast_to([0.0, 2500.0, 5000.0], (2, 1, 3)),
            auv_position=np.full((2, 1, 1, 2), 180.0),
            fix=np.full((2, 1, 1, 2), 180.0),
            target=np.zeros((2, 1, 1), np.int16),
            boat_position=np.full((2, 1, 1, 2), 150.0),
            boat_goal=np.full((2, 1, 1, 2), 150.0),
        )
        frame, painter = paint(trace, 0)
        aside = round(0.35 * painter.map._node_radius)
        for x, share, colour in zip((50.0, 100.0, 150.0), (0.0, 0.5, 1.0), style.GAUGE, strict=True):
            row, column = place(painter, x, 50.0)
            empty = style.mix(style.OUTLINE, colour, 0.35)
            left, right = (frame[row, column + side].astype(int) for side in (-aside, aside))  # clockwise from the top
            assert np.abs(right - (colour if share > 0 else empty)).max() < 12
            assert np.abs(left - (colour if share > 0.5 else empty)).max() < 12
        halo = (frame == style.FULL).all(-1).sum()
        calm, _ = paint(replace(trace, backlog=np.broadcast_to([0.0, 2500.0, 4990.0], (2, 1, 3))), 0)
        assert halo > (calm == style.FULL).all(-1).sum() + 10

    def test_ring_of_a_node_brightens_with_the_age_of_its_data(self):
        steps = 400  # nobody visits node 1; node 0 is served in step 199
        trace = synthetic_trace(steps=steps, auvs=1, nodes=2, sea=False, vortices=0)
        hovering, target = np.zeros((steps, 1, 1), np.int8), np.zeros((steps, 1, 1), np.int16)
        hovering[198:200], target[199:] = 1, 1
        served = np.zeros((steps, 1, 1))
        served[199] = 0.25
        trace = replace(
            trace,
            node_position=np.array([[[50.0, 50.0], [150.0, 50.0]]]),
            auv_position=np.full((steps, 1, 1, 2), 180.0),
            fix=np.full((steps, 1, 1, 2), 180.0),
            hovering=hovering,
            target=target,
            service_rate=served,
            backlog=np.full((steps, 1, 2), 100.0),
            boat_position=np.full((steps, 1, 1, 2), 150.0),
        )
        radius = round(0.92 * Painter(trace, (1280, 720)).map._node_radius)

        def rings(t: int) -> list[float]:
            frame, painter = paint(trace, t, (1280, 720))
            rows = [place(painter, x, 50.0) for x in (50.0, 150.0)]
            return [float(frame[row, column - radius].mean()) for row, column in rows]

        (first, other), (fresh, old) = rings(150), rings(250)
        assert first == pytest.approx(other, abs=3)
        assert fresh < 0.7 * first < 0.7 * old

    def test_rings_of_stations_stay_as_they_are(self):
        trace = replace(
            synthetic_trace(steps=400, auvs=1, nodes=1, sea=False), scenario=Scenario.load("station-keeping")
        )
        assert (Painter(trace, (640, 360)).map._age == 0).all()

    def test_line_leads_to_the_next_nodes_and_no_further(self):
        steps, nodes = (
            12,
            np.array([[[20.0, 20.0], [20.0, 60.0], [60.0, 60.0], [60.0, 20.0], [100.0, 20.0], [100.0, 60.0]]]),
        )
        trace = synthetic_trace(steps=steps, auvs=1, nodes=6, sea=False, vortices=0)
        trace = replace(
            trace,
            node_position=nodes,
            auv_position=np.full((steps, 1, 1, 2), 180.0),
            fix=np.full((steps, 1, 1, 2), 180.0),
            hovering=np.zeros((steps, 1, 1), np.int8),
            target=(np.arange(steps)[:, None, None] // 2).astype(np.int16),
            service_rate=np.zeros((steps, 1, 1)),
            delivered=np.zeros((steps, 1, 1)),
            boat_position=np.full((steps, 1, 1, 2), 180.0),
            boat_goal=np.full((steps, 1, 1, 2), 180.0),
        )
        legs = [(nodes[0, i] + nodes[0, i + 1]) / 2 for i in range(5)]
        staying = replace(trace, target=np.zeros_like(trace.target))

        def drawn(t: int) -> list[bool]:
            frame, painter = paint(trace, t, (1280, 720))
            difference = np.abs(frame.astype(int) - paint(staying, t, (1280, 720))[0]).max(-1)
            places = [place(painter, *leg) for leg in legs]
            return [bool(difference[row - 2 : row + 3, column - 2 : column + 3].max() > 20) for row, column in places]

        assert drawn(0) == [True, True, True, False, False]
        assert drawn(3) == [False, True, True, True, False]  # from node 1 on
        assert drawn(steps - 1) == [False] * 5

    def test_sea_is_brighter_where_it_is_higher_and_north_is_up(self):
        view = MapView(Area(), Rectangle(0, 0, 100, 100))
        rising = np.broadcast_to(np.linspace(-1, 1, 50, dtype=np.float32)[:, None], (50, 50))
        surface = SeaSurface(rising[None], view)
        assert surface.limit == 1
        picture = np.zeros((100, 100, 3), np.uint8)
        surface.paint(picture, 0)
        assert picture[5].mean() > picture[50].mean() > picture[94].mean()

    def test_relief_is_lit_from_the_north_west(self):
        view = MapView(Area(), Rectangle(0, 0, 120, 120))
        y, x = np.mgrid[-1:1:60j, -1:1:60j]
        hill = np.exp(-6 * (x**2 + y**2)).astype(np.float32)
        surface = SeaSurface(hill[None], view)
        picture = np.zeros((120, 120, 3), np.uint8)
        surface.paint(picture, 0)
        north_west, south_east = picture[42, 42].mean(), picture[77, 77].mean()  # equally high
        assert north_west > south_east + 5

    VORTEX = np.array([[80.0, 120.0, 200.0, 30.0], [20.0, 30.0, -150.0, 40.0]])
    STREAM = np.array([[[0.1, 0.2], [0.3, 0.2]], [[0.1, -0.2], [0.3, -0.2]]])  # 0.1 + 0.2 x/200, 0.2 − 0.4 y/200

    def current(self, vortex: np.ndarray, points: np.ndarray) -> np.ndarray:
        expected = np.stack([0.1 + 0.001 * points[:, 0], 0.2 - 0.002 * points[:, 1]], 1)
        for x0, y0, circulation, radius in vortex:
            dx, dy = points[:, 0] - x0, points[:, 1] - y0
            r2 = dx**2 + dy**2
            turn = circulation / (2 * np.pi * r2) * -np.expm1(-r2 / radius**2)
            expected += np.stack([-turn * dy, turn * dx], 1)
        return expected

    def drift(self, streaks: CurrentStreaks) -> tuple[np.ndarray, np.ndarray]:
        """Where particles are (m) and how far they move in half a second (m), those that move visibly."""
        seen = []

        class Recorder:
            def white_lines(self, lines: np.ndarray, *_: object) -> None:
                seen.append(lines)

        streaks.draw(Recorder(), 10.0, 1)
        streaks.draw(Recorder(), 10.5, 1)
        first, second = seen[0][:, 0], seen[2][:, 0]
        moving = (np.hypot(*(second - first).T) > 0) & (np.hypot(*(first - seen[0][:, -1]).T) > 5)
        metres = (second - first)[moving] * (1 / 3, -1 / 3)
        return np.stack([first[moving, 0] + 0.5, 599.5 - first[moving, 1]], 1) / 3, metres

    @pytest.mark.parametrize("moved", [False, True])
    def test_streaks_drift_with_the_current(self, moved):
        view = MapView(Area(), Rectangle(0, 0, 600, 600))
        vortex = self.VORTEX
        streaks = CurrentStreaks(vortex, self.STREAM, 200.0, 200.0, view, 1.0)
        points = np.random.default_rng(0).uniform(0, 200, (4000, 2))
        assert streaks.fastest == pytest.approx(np.hypot(*self.current(vortex, points).T).max(), rel=0.1)
        if moved:
            vortex = vortex + np.array([30.0, -40.0, 0.0, 10.0])
            streaks.update(vortex, self.STREAM)
        places, metres = self.drift(streaks)
        inside = ((places > 0) & (places < 200)).all(axis=1)  # outside, the stream is that of the edge
        close = np.hypot(*(metres - 0.5 * self.current(vortex, places)).T) < 0.05
        assert inside.sum() > 100
        assert close[inside].mean() > 0.97  # the rest ended its life in between

    def test_streaks_follow_the_stream(self):
        view = MapView(Area(), Rectangle(0, 0, 600, 600))
        streaks = CurrentStreaks(self.VORTEX[:0], self.STREAM, 200.0, 200.0, view, 1.0)
        streaks.update(self.VORTEX[:0], -self.STREAM)
        places, metres = self.drift(streaks)
        inside = ((places > 0) & (places < 200)).all(axis=1)
        close = np.hypot(*(metres + 0.5 * self.current(self.VORTEX[:0], places)).T) < 0.05
        assert close[inside].mean() > 0.97

    def test_no_current_no_streaks(self):
        view = MapView(Area(), Rectangle(0, 0, 600, 600))
        streaks = CurrentStreaks(np.zeros((0, 4)), np.zeros((0, 0, 2)), 200.0, 200.0, view, 1.0)
        assert streaks.fastest == 0


class TestPanel:
    def test_figures_equal_the_metrics(self):
        trace = synthetic_trace(steps=90, worlds=2)
        _, painter = paint(trace, 0)
        for t in (0, 40, 89):
            until = slice(0, t + 1)
            travelling = np.maximum((trace.hovering[until, 0] == 0).sum(0), 1)
            ec = float((trace.power[until, 0].sum(0) / travelling).mean())
            said = {name: f"{value:{form}}" for name, value, form in figures(trace, painter.panel._running, t)}
            assert said["SDR, Mbit/s"] == f"{trace.service_rate[until, 0].sum():.2f}"
            assert said["EC, W"] == f"{ec:.1f}"
            assert said["services"] == str((trace.service_rate[until, 0] > 0).sum())
            assert said["delivered, Mbit"] == f"{trace.delivered[until, 0].sum():.1f}"
            assert said["full nodes"] == str(trace.overflowing[t, 0])
        whole = episode_metrics(trace)[0]
        assert whole.services > 0
        assert said["SDR, Mbit/s"] == f"{whole.sdr:.2f}"
        assert said["EC, W"] == f"{whole.ec:.1f}"

    def test_running_series(self):
        trace = synthetic_trace(steps=90)
        running = RunningMetrics.of(trace)
        error = np.linalg.norm(trace.estimate - trace.auv_position, axis=-1)[:, 0]
        np.testing.assert_allclose(running.position_error, error)
        for t in (0, 10, 29, 30, 80):
            np.testing.assert_allclose(running.error_median[t], np.median(error[max(0, t - 29) : t + 1], axis=0))
        done = trace.service_rate[:, 0] > 0
        np.testing.assert_allclose(running.service_share[done], 1.0)
        assert (running.service_share[trace.hovering[:, 0] == 0] == 0).all()
        inside = (trace.hovering[1:, 0] == 1) & (trace.hovering[:-1, 0] == 1) & ~done[:-1]
        assert (np.diff(running.service_share, axis=0)[inside] > 0).all()
        velocity = trace.auv_velocity[:, 0]
        moving = np.hypot(velocity[..., 0], velocity[..., 1]) > 0
        np.testing.assert_allclose(np.cos(running.heading[moving]), velocity[moving][:, 0] / 1.6, atol=1e-9)

    def test_plots_do_not_show_the_future(self):
        trace = synthetic_trace(steps=40)
        blank = Painter(trace, (640, 360))._still
        early, painter = paint(trace, 9)
        late, _ = paint(trace, 39)
        plot = painter.panel._error_plot
        now = round(float(plot.x(trace.time[9]))) + 3
        box = plot.box._replace(left=now, width=plot.box.right - now)
        assert (box.of(early) == box.of(blank)).all()
        assert (box.of(early) != box.of(late)).any()

    def test_plot_passes_through_its_values(self):
        layout = Layout.fit(1280, 720, Area())
        still = np.zeros((720, 1280, 3), np.uint8)
        plot = RecordedPlot(still, Rectangle(800, 300, 400, 100), 0.1, 10.0, 100.0, layout, log=True)
        time = np.linspace(1, 100, 100)
        plot.curve(time, np.full(100, 1.0), (0, 0, 255))
        plot.finish()
        plot.show_until(50.0)
        rows, columns = np.nonzero(still[300:400, 800:1200, 2] > 150)
        assert rows.mean() == pytest.approx(49.5, abs=1)  # 1 is half way between 0.1 and 10
        assert columns.max() == pytest.approx(0.5 * 399, abs=2)

    def test_lens_shows_fixes_where_they_are(self):
        trace = synthetic_trace(steps=5, auvs=1, sea=False, vortices=0)
        east = replace(trace, estimate=trace.auv_position + np.array([0.3, 0.0]))
        _, painter = paint(east, 4, (1280, 720))
        insets = painter.panel._insets
        frame, _ = paint(east, 4, (1280, 720))
        centre = insets._centres[0] + np.array([0.3 * insets._scale, 0.0])
        x, y = np.round(centre).astype(int)
        bright = (frame[y - 8 : y + 9, x - 8 : x + 9] > 200).all(-1)
        rows, columns = np.nonzero(bright)
        assert len(rows) > 8  # the diamond, hollow and in the middle of this window
        assert (abs(rows.mean() - 8), abs(columns.mean() - 8)) < (1.5, 1.5)
        assert insets.magnification == pytest.approx(insets._scale / painter.map.view.per_metre)


class TestAnyShape:
    @pytest.mark.parametrize(
        ("size", "options"),
        [
            ((640, 360), {"auvs": 16, "nodes": 500, "area": (400.0, 400.0)}),
            ((1280, 720), {"auvs": 1, "nodes": 1, "vortices": 0, "sea": False}),
            ((640, 480), {"area": (2000.0, 100.0)}),
            ((320, 320), {"area": (50.0, 2000.0), "auvs": 7}),
            ((360, 640), {}),
            ((1920, 400), {}),
            ((3840, 2160), {"auvs": 4}),
        ],
    )
    def test_is_drawn(self, size, options):
        trace = synthetic_trace(steps=3, **options)
        frame, painter = paint(trace, 2, size)
        assert frame.shape == (size[1], size[0], 3)
        layout = painter.layout
        boxes = [layout.map, layout.panel, *([layout.legend] if layout.legend else [])]
        for box in boxes:
            assert box.left >= 0
            assert box.top >= 0
            assert box.right <= size[0]
            assert box.bottom <= size[1]
        for first, second in combinations(boxes, 2):
            apart = first.right <= second.left or second.right <= first.left
            assert apart or first.bottom <= second.top or second.bottom <= first.top

    @pytest.mark.parametrize(("view", "traces"), [("map", 1), ("sea", 1), ("both", 1), ("map", 2)])
    def test_at_three_times_the_size_it_is_the_same_picture(self, view, traces, monkeypatch):
        """Each pixel is as bright as one of the other picture two pixels around, but for a few beside thin lines."""

        def block(text: str, size: float, _: bool) -> tuple[np.ndarray, int]:
            """Letters are fitted to whole pixels, so that their widths have no scale."""
            return np.full((round(size), round(0.6 * size * len(text)), 1), 255, np.uint16), round(size)

        monkeypatch.setattr("usvauv_env.render.text._mask", block)
        trace, small, frames = synthetic_trace(steps=13), (1280, 720), []
        off = trace.estimate + np.array([6.0, 0.0])
        trace = replace(trace, estimate=off, foreseen_position=off + np.array([0.0, 7.0]))
        for size in (small, (3840, 2160)):
            painter = painter_of([trace] * traces, size, Look(view), 1.0)
            for t in range(13):
                frame = painter.frame(t)
            frames.append(cv2.resize(frame, small, interpolation=cv2.INTER_AREA))
        around = np.ones((5, 5), np.uint8)
        for frame, other in (frames, frames[::-1]):
            above = cv2.subtract(frame, cv2.dilate(other, around))
            below = cv2.subtract(cv2.erode(other, around), frame)
            difference = cv2.max(above, below).max(-1)
            assert (difference > 60).sum() < 120
            assert (difference > 100).sum() < 12

    def test_one_step(self, tmp_path):
        assert render([synthetic_trace(steps=1)], tmp_path / "one.mp4", VideoSettings((320, 320))).frames == 1

    def test_other_worlds_are_not_shown(self):
        trace = synthetic_trace(steps=4, worlds=3)
        both, _ = paint(trace, 3)
        alone, _ = paint(trace.episode(0), 3)
        other, _ = paint(trace.episode(1), 3)
        assert (both == alone).all()
        assert (both != other).any()

    def test_perfect_fixes_are_drawn(self):
        trace = synthetic_trace(steps=3)
        perfect = replace(
            trace,
            fix=trace.auv_position,
            estimate=trace.auv_position,
            estimate_covariance=np.zeros_like(trace.fix_covariance),
        )
        frame, _ = paint(perfect, 2)
        assert frame.any()


class TestText:
    def test_letters_are_there(self):
        for letter in "σηΣ±×→↑…“”·−²µ°":
            picture = np.zeros((40, 40, 3), np.uint8)
            missing = np.zeros((40, 40, 3), np.uint8)
            write(picture, letter, (10, 25), 20, (255, 255, 255))
            write(missing, "?", (10, 25), 20, (255, 255, 255))
            assert picture.any()
            assert (picture != missing).any()

    def test_letters_of_other_scripts_are_replaced(self):
        pictures = np.zeros((2, 40, 120, 3), np.uint8)
        write(pictures[0], "海\n1", (10, 25), 20, (255, 255, 255))
        write(pictures[1], "??1", (10, 25), 20, (255, 255, 255))
        assert (pictures[0] == pictures[1]).all()

    def test_outside_is_cut_off(self):
        picture = np.zeros((20, 60, 3), np.uint8)
        for position in ((-20, 15), (50, 15), (10, 3), (10, 32), (500, 15), (10, -90)):
            write(picture, "Text", position, 14, (255, 255, 255))
        assert picture.any()

    def test_anchors_and_shortening(self):
        width = text_width("clear words", 14)
        for anchor, left in (("left", 100), ("centre", 100 - width // 2), ("right", 100 - width)):
            picture = np.zeros((40, 200, 3), np.uint8)
            write(picture, "clear words", (100, 25), 14, (255, 255, 255), anchor=anchor)
            assert abs(np.nonzero(picture.any((0, 2)))[0][0] - left) <= 2
        assert shorten("clear words", 14, width) == "clear words"
        assert text_width(shorten("clear words", 14, width - 10), 14) <= width - 10
