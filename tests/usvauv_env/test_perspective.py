"""The perspective view: its camera, what hides what, and that everything is drawn where the camera sees it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.usvauv_env.made_traces import synthetic_trace, with_second_boat
from usvauv.env.record.trace import Trace
from usvauv.env.render import bodies, style, symbols
from usvauv.env.render.camera import SWING_FRAMES, Camera, Swing
from usvauv.env.render.frame_layout import Layout, Rectangle
from usvauv.env.render.itinerary import Itinerary
from usvauv.env.render.map import SIGMAS
from usvauv.env.render.perspective import PerspectiveView
from usvauv.env.render.popups import Popups
from usvauv.env.render.reply_field import ReplyField
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.env.render.scene import Scene
from usvauv.env.render.sea_shading import SeaShading
from usvauv.env.render.wave_sheet import Columns, look
from usvauv.env.scenario import Scenario
from usvauv.kernels.positioning import usbl

SIDES = (200.0, 160.0)
WIDTH, HEIGHT = 640, 480
CAMERA = Swing.around(SIDES, 8.0, -100.0, (WIDTH, HEIGHT)).middle
COLUMNS = Columns.of(CAMERA, SIDES, WIDTH)
BOX = Rectangle(30, 20, 600, 450)


def view_of(trace: Trace, box: Rectangle = BOX) -> PerspectiveView:
    trace = trace.episode(0)
    return PerspectiveView(trace, RunningMetrics.of(trace), box, Layout.fit(1280, 720, trace.scenario.area))


def draw(view: PerspectiveView, t: int) -> np.ndarray:
    """Step t in a picture of 720 × 1280."""
    picture = np.full((720, 1280, 3), 77, np.uint8)
    view.draw(picture, t)
    return picture


def shown(trace: Trace, t: int = 3) -> np.ndarray:
    """The box of step t."""
    return BOX.of(draw(view_of(trace), t))


def differs(first: np.ndarray, second: np.ndarray, place: np.ndarray, reach: int = 3) -> bool:
    """Whether two boxes differ around a pixel."""
    x, y = np.rint(place).astype(int)
    window = slice(y - reach, y + reach + 1), slice(x - reach, x + reach + 1)
    return bool((first[window] != second[window]).any())


def calm(**changes: np.ndarray) -> Trace:
    """A trace without waves in which nothing has been heard."""
    trace = synthetic_trace(steps=4, sea=False)
    trace.fix_flags[:] = usbl.SILENT
    return replace(trace, **changes)


class TestCamera:
    def test_is_a_pinhole(self):
        """By bearing and range from the camera; its picture is upright, d behind the hole."""
        camera = Camera(heading=2.1, distance=500.0, height=260.0, focal=900.0, centre=(310.0, -40.0))
        points = np.random.default_rng(0).uniform(-100, 100, (50, 3))
        eye = np.array([-500 * math.cos(2.1), -500 * math.sin(2.1), 260.0])
        for (x, y), (east, north, up) in zip(camera.pixel(points), points - eye, strict=True):
            turn = math.atan2(north, east) - 2.1
            assert x == pytest.approx(310 - 900 * math.tan(turn))
            assert y == pytest.approx(-40 - 900 * up / (math.hypot(east, north) * math.cos(turn)))

    @pytest.mark.parametrize("sides", [(200.0, 200.0), (600.0, 150.0), (150.0, 600.0)])
    def test_the_box_fills_the_room_and_stays_in_it(self, sides):
        swing = Swing.around(sides, 8.0, -100.0, (640, 480))
        half = 0.5 * np.array(sides)
        corners = np.array([(x, y, z) for x in (-half[0], half[0]) for y in (-half[1], half[1]) for z in (-100, 8)])
        pixels = np.concatenate([swing.at(t).pixel(corners) for t in range(0, SWING_FRAMES, 60)])
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        assert (low > -2).all()
        assert (high < (642, 482)).all()
        assert max((high - low) / (640, 480)) > 0.99

    def test_moves_slowly_and_returns(self):
        swing = Swing(CAMERA)
        headings = np.array([swing.at(t).heading for t in range(SWING_FRAMES + 1)])
        assert 0 < np.abs(np.diff(headings)).max() < math.radians(0.02)
        assert headings[-1] == pytest.approx(headings[0])


def seen(field: np.ndarray, camera: Camera = CAMERA) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (N, 2) that show a surface, and the places (N, 2) m and heights (N,) they show."""
    sheet = look(camera, COLUMNS, SIDES, field, HEIGHT)
    row, column = np.nonzero(sheet.covered)
    pixels = np.stack([COLUMNS.x[column], sheet.top + 0.5 + 2.0 * row], 1)
    texels = np.stack([sheet.texel_x[row, column], sheet.texel_y[row, column]], 1)
    place = ((texels + 0.5) / field.shape[::-1] - 0.5) * SIDES
    i, j = np.clip(np.rint(texels).astype(int), 0, np.array(field.shape[::-1]) - 1).T
    return pixels, place, field[j, i]


class TestSheet:
    def test_pixels_show_the_places_that_project_to_them(self):
        y, x = np.mgrid[0:320, 0:400] / 2
        field = (3 * np.sin(0.11 * x) * np.cos(0.07 * y)).astype(np.float32)
        pixels, place, height = seen(field)
        back = CAMERA.pixel(np.column_stack([place, height]))
        assert len(pixels) > 14000
        assert np.abs(back - pixels).max() < 1.2  # heights of whole cells, 0.2 m steps of 3 pixels
        assert np.median(np.abs(back - pixels)) < 0.2

    def test_a_nearer_crest_hides_what_is_behind_it(self):
        """Behind a wall 6 m thick all water is seen, and only that, of which the sight line passes above the wall."""
        field = np.zeros((640, 800), np.float32)
        field[320:344] = 20.0
        eye = -CAMERA.distance * CAMERA.forward
        shown = []
        for sea in (field, np.zeros_like(field)):
            _, place, height = seen(sea)
            behind = (height == 0) & (place[:, 1] > 8) & (np.abs(place[:, 0]) < 60)
            passed = (6.0 - eye[1]) / (place[behind, 1] - eye[1])  # share of the way at the wall's far side
            shown.append(CAMERA.height * (1 - passed))  # height of the sight line there
        assert shown[0].min() > 19
        assert (shown[0] > 21).sum() == pytest.approx((shown[1] > 21).sum(), rel=0.02)
        assert (shown[1] < 19).sum() > 500

    def test_the_horizon_is_that_of_the_waves(self):
        for height in (0.0, 6.0):
            sheet = look(CAMERA, COLUMNS, SIDES, np.full((40, 50), height, np.float32), HEIGHT)
            corners = np.array([(x, y, height) for x in (-100, 100) for y in (-80, 80)])
            pixels = CAMERA.pixel(corners)
            assert sheet.horizon.min() == pytest.approx(pixels[:, 1].min(), abs=1)
            assert sheet.shore.max() == pytest.approx(pixels[:, 1].max(), abs=1)

    def test_what_is_beyond_the_picture_is_cut_off(self):
        sheet = look(CAMERA, COLUMNS, SIDES, np.full((40, 50), 100.0, np.float32), HEIGHT)
        assert sheet.top == 0
        assert 2 * sheet.covered.shape[0] <= HEIGHT
        assert sheet.covered[0].any()


class TestShading:
    def test_a_square_sea_has_the_same_light_from_all_four_sides(self):
        """Slopes that rise to the right face the sun, which stands to the left."""
        x, y = np.linspace(-100, 100, 64), np.linspace(-100, 100, 64)[:, None]
        light = []
        for quarter in range(4):
            camera = replace(CAMERA, heading=0.5 * math.pi * quarter)
            rising = 0.05 * (x * camera.right[0] + y * camera.right[1])
            shading = SeaShading(np.stack([rising, -rising]), 5.0, (200.0, 200.0), camera, 1.0)
            light.append([shading.at(t)[1].mean() for t in range(2)])
        assert np.ptp(light, axis=0).max() < 0.3
        assert light[0][0] > light[0][1] + 15.0


class TestScene:
    @pytest.mark.parametrize(
        ("overrides", "limit", "note"),
        [
            ([], 8.0, "true to scale"),
            ([], 0.0, "true to scale"),
            ([], 0.3, "heights × 10"),
            (["area.width=600", "area.length=600"], 20.0, "depths × 2"),
            (["area.depth=2000"], 8.0, "depths × 0.05"),
            (["area.width=20000"], 0.5, "heights × 100, depths × 50"),
        ],
    )
    def test_exaggerates_only_what_would_not_be_seen(self, overrides, limit, note):
        assert Scene.of(Scenario.load("extreme", overrides), limit).note == note

    def test_places_and_pieces_inside(self):
        scene = Scene.of(Scenario.load("extreme"), 0.0)
        assert scene.place(np.array([0.0, 200.0]), -5.0).tolist() == [-100.0, 100.0, -5.0]
        line = np.array([(-150, 0, 0), (-50, 0, 0), (50, 0, 0), (150, 0, 0), (150, 90, 0), (90, 90, 0), (80, 90, 0)])
        assert [piece[:, 0].tolist() for piece in scene.inside(line)] == [[-50, 50], [90, 80]]
        down = np.column_stack([0 * np.arange(5), 0 * np.arange(5), -40.0 * np.arange(5)])
        assert [piece[-1, 2] for piece in scene.inside(down)] == [-120.0]

    def test_stations_are_where_the_auvs_are(self):
        scene = Scene.of(Scenario.load("station-keeping"), 8.0)
        assert (scene.nodes, scene.auvs, scene.bed) == (-100.0, -100.0, -120.0)


class TestBodies:
    def test_stand_upright_on_a_slope(self):
        axes = bodies.turned(0.7, np.array([0.3, -0.2]))
        assert axes @ axes.T == pytest.approx(np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1)
        assert axes[2] == pytest.approx(np.array([-0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0]))
        assert math.atan2(axes[0, 1], axes[0, 0]) == pytest.approx(0.7)

    def test_faces_look_outwards(self):
        for body in (bodies.BOAT, bodies.auv((255, 0, 0))):
            hull = slice(-8) if body is not bodies.BOAT else slice(None)  # an AUV's fins have two sides
            outwards = (body.corners.mean(axis=1) - body.corners[hull].mean(axis=(0, 1))) * body.normals
            assert (outwards.sum(axis=1)[hull] > -0.02).all()


class TestView:
    def test_nothing_outside_the_box_is_touched(self):
        cov = np.zeros((4, 1, 2, 3)) + np.array([5000.0, 0.0, 5000.0])
        for box in (BOX, Rectangle(100, 80, 97, 71), Rectangle(5, 7, 33, 20)):
            trace = replace(synthetic_trace(steps=4, area=(400.0, 150.0)), estimate_covariance=cov)
            picture = draw(view_of(trace, box), 3)
            box.of(picture)[:] = 77
            assert (picture == 77).all()

    def test_a_frame_depends_on_its_step_alone(self):
        trace = synthetic_trace(steps=12)
        view = view_of(trace)
        first = draw(view, 9)
        draw(view, 2)
        assert (draw(view, 9) == first).all()
        assert (draw(view_of(trace), 9) == first).all()
        assert (draw(view, 10) != first).any()

    def test_the_boat_stands_on_the_drawn_surface(self):
        """The pixel that shows the surface at the boat's place is where the boat's waterline is drawn."""
        trace = synthetic_trace(steps=30, area=(200.0, 160.0))
        y, x = np.mgrid[0:160, 0:200] + 0.5
        wave = [5 * np.sin(0.09 * x - 0.3 * t) * np.cos(0.05 * y) for t in range(30)]
        boat = trace.boat_position[:, 0, 0]
        rides = [5 * np.sin(0.09 * bx - 0.3 * t) * np.cos(0.05 * by) for t, (bx, by) in enumerate(boat)]
        surface = np.stack([rides, np.zeros(30), np.zeros(30)], 1)[:, None, None]
        trace = replace(trace, surface=np.array(wave, np.float32), boat_surface=surface)
        view = view_of(trace)
        for t in (0, 9, 17, 29):
            camera, heights = view.camera(t), view.surface(t)[0]
            columns = Columns.of(camera, SIDES, BOX.width)
            sheet = look(camera, columns, SIDES, heights, BOX.height)
            waterline = camera.pixel(view.boats[t, 0])
            texel = boat[t] / SIDES * heights.shape[::-1] - 0.5
            off = np.hypot(sheet.texel_x - texel[0], sheet.texel_y - texel[1])
            row, column = np.unravel_index(np.where(sheet.covered, off, np.inf).argmin(), off.shape)
            pixel = columns.x[column], sheet.top + 0.5 + 2.0 * row
            assert np.hypot(*(waterline - pixel)) < 2, t
            away = replace(trace, boat_position=trace.boat_position + np.array([60.0, 40.0]))
            assert differs(BOX.of(draw(view, t)), BOX.of(draw(view_of(away), t)), waterline, 1)

    def test_a_wave_heaves_and_rolls_the_boat(self):
        trace = synthetic_trace(steps=4)
        still = trace.boat_surface * (1.0, 0.0, 0.0)
        pictures = [
            shown(replace(trace, boat_surface=still + np.array(change)))
            for change in ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 0.3, 0.0))
        ]
        place = view_of(trace).camera(3).pixel(view_of(replace(trace, boat_surface=still)).boats[3, 0])
        assert differs(pictures[0], pictures[1], place, 9)
        assert differs(pictures[0], pictures[2], place, 9)

    def test_higher_waves_are_seen_above_the_far_border(self):
        """Where the picture of waves differs from the empty room, up to the horizon of their heights."""
        trace = synthetic_trace(steps=4)
        tops = []
        for factor in (1.0, 0.2):
            # One high wave sets the scales, so that both pictures have the same camera.
            surface = factor * trace.surface
            surface[0] = trace.surface[0]
            view = view_of(replace(trace, surface=surface))
            camera, heights = view.camera(3), view.surface(3)[0]
            sheet = look(camera, Columns.of(camera, view.scene.sides, BOX.width), view.scene.sides, heights, BOX.height)
            tops.append(sheet.horizon)
        assert np.abs(tops[0] - tops[1]).max() > 3

    def test_an_ellipse_is_as_large_as_its_covariance(self):
        """Half its width in the picture is SIGMAS σ by the camera's scale at the AUV."""
        trace = calm()
        none = shown(replace(trace, estimate_covariance=np.zeros((4, 1, 2, 3))))
        view = view_of(trace)
        for sigma in (4.0, 8.0):
            covariance = np.zeros((4, 1, 2, 3))
            covariance[:, 0, 0] = sigma**2, 0.0, sigma**2
            with_it = shown(replace(trace, estimate_covariance=covariance))
            columns = np.flatnonzero((with_it != none).any(axis=(0, 2)))
            camera = view.camera(3)
            place = view.scene.place(trace.estimate[3, 0, 0], view.scene.auvs)
            half = SIGMAS * sigma * camera.focal / camera.away(place)
            assert np.ptp(columns) / 2 == pytest.approx(half, abs=3)

    def test_shows_where_an_auv_goes_next_what_it_delivered_and_where_it_is_foreseen(self):
        trace, steps = calm(), 4
        target = np.zeros((steps, 1, 2), np.int16)
        view = view_of(replace(trace, target=target))
        nodes = view.scene.place(trace.node_position[0], view.scene.nodes)
        camera = view.camera(1)

        def changed(place: np.ndarray, reach: int, **fields: np.ndarray) -> bool:
            still = {"target": target, "delivered": np.zeros((steps, 1, 2))}
            before, after = (shown(replace(trace, **change), 1) for change in (still, still | fields))
            return differs(before, after, camera.pixel(place), reach)

        later = target.copy()
        later[2:, 0, 0] = 1
        assert changed((nodes[0] + nodes[1]) / 2, 3, target=later)
        delivered = np.zeros((steps, 1, 2))
        delivered[1, 0, 0] = 1.0
        assert changed(nodes[0], 60, delivered=delivered)
        small = Rectangle(30, 20, 400, 240)  # the map beside it has the words
        without, with_it = (
            draw(view_of(replace(trace, delivered=data), small), 1) for data in (0 * delivered, delivered)
        )
        assert (without == with_it).all()
        foreseen = trace.estimate.copy()
        foreseen[1, 0, 0] += 40.0
        place = view.scene.place(foreseen[1, 0, 0], view.scene.auvs)
        assert changed(place, 6, foreseen_position=foreseen)

    @pytest.mark.parametrize("unit", [1, 2])
    def test_places_too_near_to_be_told_apart_are_drawn_once(self, monkeypatch, unit):
        """A fix near its AUV, a foreseen place near the fix: below five pixels of the design, at any size."""
        drawn = []
        for name in ("fix", "foreseen"):
            monkeypatch.setattr(symbols, name, lambda *_, name=name: drawn.append(name))
        trace, box = calm(), Rectangle(*(unit * side for side in BOX))
        layout = Layout.fit(unit * 1280, unit * 720, trace.scenario.area)
        view = PerspectiveView(trace, RunningMetrics.of(trace), box, layout)
        camera, place = view.camera(1), view.scene.place(trace.auv_position[1, 0, 0], view.scene.auvs)
        aside = np.append(camera.right, 0.0)
        pixel = camera.right * unit / np.hypot(*(camera.pixel(place + aside) - camera.pixel(place)))  # m
        for fix, foreseen, expected in ((4, 4, []), (6, 6, ["fix"]), (0, 4, []), (0, 6, ["foreseen"])):
            places = {
                "estimate": trace.auv_position + fix * pixel,
                "foreseen_position": trace.auv_position + foreseen * pixel,
            }
            changed = replace(trace, **places)
            drawn.clear()
            picture = np.zeros((unit * 720, unit * 1280, 3), np.uint8)
            PerspectiveView(changed, RunningMetrics.of(changed), box, layout).draw(picture, 1)
            assert drawn == 2 * expected

    def test_words_keep_off_the_numbers_of_auvs(self):
        trace, place = calm(delivered=np.ones((4, 1, 2))).episode(0), np.array([150.0, 120.0])
        nodes = np.tile(place, (trace.node_position.shape[1], 1))
        left = []
        for badges in (np.zeros((1, 2)), place[None] - (0.0, 14.0)):
            picture = np.zeros((300, 400, 3), np.uint8)
            Popups(trace, Itinerary(trace), 1.0).draw(picture, Rectangle(0, 0, 400, 300), 3, nodes, 6.0, badges)
            left.append(picture[98:112, 142:158])
        assert left[0].any()
        assert not left[1].any()

    def test_lines_on_the_water_are_where_a_place_is_worth_as_much(self):
        def wide(level: float) -> Trace:
            changes = ["area.width=600", "area.length=600", "channel.data_ratio=18", f"acoustics.source_level={level}"]
            return calm(scenario=Scenario.load("extreme", [*changes, "nodes.count=6"]))

        near, everywhere = wide(139.0), wide(190.0)
        assert not ReplyField(everywhere).lines(3)
        lines = dict(ReplyField(near).lines(3))[0.6]
        view, pictures = view_of(near), [shown(trace) for trace in (near, everywhere)]
        for line in lines:
            for point in line[:: len(line) // 5]:
                assert differs(*pictures, view.camera(3).pixel(view.scene.place(point, 0.0)))

    def test_a_flat_sea_is_level(self):
        view = view_of(calm())
        heights, colours = view.surface(0)
        assert not heights.any()
        assert (view.surface(3)[1] == colours).all()
        corner = view.camera(3).pixel(np.array([(x, y, 0.0) for x in (-100, 100) for y in (-100, 100)]))
        x, y = np.rint(corner.mean(axis=0)).astype(int)
        blue, _, red = shown(calm())[y, x + 60].astype(int)
        assert blue > red + 20

    def test_every_boat_is_drawn_and_its_goal(self):
        one = calm()
        two = with_second_boat(one)
        alone, both = shown(one), shown(two)
        view = view_of(two)
        for x, y in ((170.0, 30.0), (170.0, 150.0)):
            assert differs(alone, both, view.camera(3).pixel(view.scene.place(np.array([x, y]), 0.0)))

    def test_a_line_runs_from_the_boat_that_heard(self):
        two = with_second_boat(calm())
        silent = shown(two)
        two.fix_flags[3, 0, 1] = usbl.DETECTED
        heard, view = shown(two), view_of(two)
        auv = view.scene.place(two.auv_position[3, 0, 1], view.scene.auvs)
        ways = [boat + 0.6 * (auv - boat) for boat in view.boats[3]]
        assert [differs(silent, heard, view.camera(3).pixel(way), 1) for way in ways] == [False, True]

    def test_a_ping_runs_from_the_boat_over_the_water(self):
        trace = synthetic_trace(steps=20, sea=False)
        trace.fix_flags[:] = usbl.SILENT
        silent = [shown(trace, t) for t in (5, 8)]
        trace.fix_flags[3, 0, 0] = 0
        asked = [shown(trace, t) for t in (5, 8)]
        reach = [np.ptp(np.flatnonzero((a != s).any(axis=(0, 2)))) for a, s in zip(asked, silent, strict=True)]
        assert 10 < reach[0] < reach[1]

    def test_nodes_show_how_full_they_are(self):
        trace = calm()
        full = trace.backlog.copy()
        full[:, 0, 4] = 5000 - full[:, 0, 4]
        view = view_of(trace)
        place = view.camera(3).pixel(view.scene.place(trace.node_position[0, 4], view.scene.nodes))
        assert differs(shown(trace), shown(replace(trace, backlog=full)), place, 20)

    def test_stations_have_the_colours_of_their_auvs(self):
        trace = synthetic_trace(steps=4, auvs=3, nodes=3, sea=False)
        trace = replace(trace, scenario=Scenario.load("station-keeping"), target=np.zeros_like(trace.target))
        trace = replace(trace, auv_position=0 * trace.auv_position, estimate=0 * trace.estimate)
        view, picture = view_of(trace), shown(trace)
        for auv, place in enumerate(view.scene.place(trace.node_position[0], view.scene.nodes)):
            x, y = np.rint(view.camera(3).pixel(place)).astype(int)
            above = picture[max(y - 22, 0) : y, x - 8 : x + 9].reshape(-1, 3).astype(int)
            assert np.abs(above - style.auv_colour(auv)).sum(axis=1).min() < 90
