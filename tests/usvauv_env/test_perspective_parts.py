"""Parts of the perspective view: solids, the box of glass and its light, vehicles, sound and lines of worth in it."""

import math
from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from kernels.positioning import usbl
from tests.usvauv_cli.test_video import synthetic_trace, with_second_boat
from usvauv_env.render import bodies, glass_box, perspective, style, symbols
from usvauv_env.render.bodies import Body
from usvauv_env.render.camera import Camera, Swing
from usvauv_env.render.canvas import Canvas
from usvauv_env.render.exchanges import Exchanges
from usvauv_env.render.frame_layout import Layout, Rectangle
from usvauv_env.render.itinerary import Itinerary
from usvauv_env.render.map import SIGMAS
from usvauv_env.render.perspective import PerspectiveView
from usvauv_env.render.reply_field import EVERY, LEVELS, ReplyField
from usvauv_env.render.running_metrics import RunningMetrics
from usvauv_env.render.scene import Scene, track
from usvauv_env.render.sea_layers import COLOURS
from usvauv_env.render.sound import Sound
from usvauv_env.render.wave_sheet import Columns, look
from usvauv_env.scenario import Scenario

SIDES = (300.0, 160.0)
BOX = Rectangle(30, 20, 640, 460)
LAYOUT = Layout.fit(1280, 720, Scenario.load("extreme").area)


def mission(**changes):
    trace = with_second_boat(synthetic_trace(steps=40, auvs=3, nodes=9, area=SIDES, vortices=0, sea=False, seed=3))
    off = np.array([(6.0, 3.0), (-7.0, 5.0), (5.0, -9.0)])
    trace = replace(
        trace,
        hovering=0 * trace.hovering,
        estimate=trace.auv_position + 2 * off,
        foreseen_position=trace.auv_position - 3 * off,
        estimate_covariance=np.zeros_like(trace.estimate_covariance) + np.array([6.0, 2.0, 4.0]),
        boat_goal=trace.boat_position + np.array([(60.0, 40.0), (-40.0, 90.0)]),
        delivered=0 * trace.delivered,
    )
    trace.fix_flags[:] = usbl.SILENT
    trace.fix_flags[26:28, 0] = usbl.DETECTED
    return replace(trace, **changes)


def view_of(trace):
    return PerspectiveView(trace, RunningMetrics.of(trace), BOX, LAYOUT)


@pytest.fixture
def drawn(monkeypatch):
    """What is drawn on a canvas, by kind: its arguments."""
    made = {}
    for name in ("line", "circle", "trail", "pieces"):
        monkeypatch.setattr(Canvas, name, lambda _, *rest, name=name: made.setdefault(name, []).append(rest))
    for name in ("cross", "fix", "foreseen", "badge", "station"):
        monkeypatch.setattr(symbols, name, lambda _, *rest, name=name: made.setdefault(name, []).append(rest))
    monkeypatch.setattr(Body, "draw", lambda body, _, *rest: made.setdefault("body", []).append((body, *rest)))
    return made


def found(lines, expected):
    """How many of the lines are through the points expected."""
    expected = np.asarray(expected, float)
    return sum(np.shape(line) == expected.shape and np.allclose(line, expected) for line in lines)


class TestSolids:
    @pytest.mark.parametrize(
        ("body", "open_at"),
        [
            (bodies.BOAT, lambda p: p[2] < -0.07 or abs(p[2] - 0.12) < 1e-9),
            (bodies.auv((9, 9, 9)), lambda p: abs(p[0]) > 0.49),
        ],
        ids=["boat", "auv"],
    )
    def test_are_closed_but_for_what_is_never_seen(self, body, open_at):
        """Each edge of a face is that of another one the other way: faces look to one side everywhere."""
        faces = [[tuple(np.round(corner, 9)) for corner in face] for face in body.corners]
        edges = Counter(edge for face in faces for edge in pairwise([*face, face[0]]) if edge[0] != edge[1])
        single = [edge for edge, count in edges.items() if edges[edge[::-1]] != count]
        assert single
        assert all(open_at(end) for edge in single for end in edge)
        assert all(open_at(a) for a, b in single)
        mirrored = Counter(tuple(sorted((x, -y, z) for x, y, z in face)) for face in faces)
        assert mirrored == Counter(tuple(sorted(face)) for face in faces)

    @pytest.mark.parametrize("body", [bodies.BOAT, bodies.auv((9, 9, 9))], ids=["boat", "auv"])
    def test_normals_stand_upright_on_their_faces_and_look_outwards(self, body):
        assert np.linalg.norm(body.normals, axis=1) == pytest.approx(1)
        volume = 0.0
        for face, normal in zip(body.corners, body.normals, strict=True):
            newell = sum(np.cross(a, b) for a, b in pairwise([*face, face[0]]))
            assert newell @ normal == pytest.approx(np.linalg.norm(newell))
            volume += sum(np.dot(face[0], np.cross(face[i], face[i + 1])) for i in (1, 2)) / 6
        assert 0.003 < volume < 0.1
        assert np.ptp(body.corners[..., 0]) == pytest.approx(1, abs=0.07)
        assert np.linalg.norm(bodies.LIGHT) == pytest.approx(1, abs=0.01)

    def test_a_hull_widens_upwards_and_its_cabin_narrows(self):
        levels = {}
        for corner in bodies.BOAT.corners.reshape(-1, 3):
            levels.setdefault(round(float(corner[2]), 3), []).append(corner)
        heights = sorted(levels)
        assert len(heights) == 5
        spans = [np.ptp(np.array(levels[z])[:, axis]) for z in heights for axis in (0, 1)]
        keel, line, rail, low, high = np.reshape(spans, (5, 2))
        assert (keel < line).all()
        assert (line < rail).all()
        assert (rail > low).all()
        assert (low > high).all()
        assert heights[0] < 0 < heights[1] < heights[2]
        for z in heights[:3]:
            bow = max(levels[z], key=lambda corner: corner[0])
            assert abs(bow[1]) < 0.01
            stern = min(corner[0] for corner in levels[z])
            assert -0.52 < stern < -0.44

    def test_a_torpedo_is_round_with_four_fins_at_its_tail(self):
        corners = bodies.auv((9, 9, 9)).corners
        hull, fins = corners[:-8], corners[-8:]
        away = np.hypot(hull[..., 1], hull[..., 2])
        assert sorted({round(float(x), 3) for x in hull[..., 0].ravel()}) == [-0.5, -0.24, 0.34, 0.5]
        for x in (-0.5, -0.24, 0.34, 0.5):
            assert np.ptp(away[np.isclose(hull[..., 0], x)]) < 1e-9
        assert away.max() == pytest.approx(away[np.isclose(hull[..., 0], -0.24)].max())
        assert away[np.isclose(hull[..., 0], 0.5)].max() < 0.3 * away.max()
        assert len(hull) == 18
        assert fins[..., 0].max() < -0.2
        assert fins[..., 0].min() > -0.5
        assert (np.hypot(fins[..., 1], fins[..., 2]).max(1) > 2 * away.max()).all()
        directions = {tuple(np.sign(np.round(fin[2, 1:], 3)).astype(int)) for fin in fins}
        assert directions == {(1, 0), (-1, 0), (0, 1), (0, -1)}

    def test_faces_are_lit_from_above_and_the_near_ones_hide_the_far(self):
        """A cube, one face of which looks to the light and so has its own colour."""
        camera = Swing.around((200.0, 200.0), 5.0, -50.0, (600, 400)).middle
        square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.5
        faces = []
        for axis in range(3):
            for side in (1, -1):
                face = np.insert(square[:: 1 if (side > 0) == (axis != 1) else -1], axis, side * 0.5, axis=1)
                faces.append(face)
        body = Body.of(faces, [(200, 200, 200)] * 6)
        np.testing.assert_allclose(body.normals, [each for axis in np.eye(3) for each in (axis, -axis)], atol=1e-9)
        up = bodies.LIGHT / np.linalg.norm(bodies.LIGHT)
        side = np.cross(up, [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        for axes in (np.eye(3), np.array([side, np.cross(up, side), up])):
            picture = np.zeros((400, 600, 3), np.uint8)
            body.draw(Canvas(picture, camera), np.zeros(3), axes, 60.0)
            for normal in body.normals:
                middle, world = 0.5 * 60 * normal @ axes, normal @ axes
                eye = np.array([*(-camera.distance * camera.forward), camera.height])
                if (eye - middle) @ world > 20:
                    x, y = np.rint(camera.pixel(middle)).astype(int)
                    expected = 200 * (0.7 + 0.3 * world @ bodies.LIGHT)
                    assert picture[y, x].astype(int) == pytest.approx(expected, abs=2)
                    if world @ up > 0.999:
                        assert picture[y, x, 0] == pytest.approx(200, abs=2)
            rows, columns = np.nonzero(picture.any(-1))
            corners = camera.pixel(body.corners * 60 @ axes).reshape(-1, 2)
            np.testing.assert_allclose([columns.min(), rows.min()], corners.min(0), atol=3)
            np.testing.assert_allclose([columns.max(), rows.max()], corners.max(0), atol=3)


class TestCamera:
    @pytest.mark.parametrize(
        ("sides", "ahead"), [((600.0, 150.0), (0, 1)), ((150.0, 600.0), (-1, 0)), ((200.0, 200.0), (0, 1))]
    )
    def test_looks_across_the_longer_side_from_the_south_or_the_east(self, sides, ahead):
        camera = Swing.around(sides, 5.0, -50.0, (640, 480)).middle
        assert 0.8 < camera.forward @ ahead < 0.99
        assert camera.forward @ camera.right == pytest.approx(0)
        assert 2 * math.hypot(*sides) < camera.distance < 3 * math.hypot(*sides)

    def test_swings_evenly_to_both_sides(self):
        swing = Swing.around(SIDES, 5.0, -50.0, (640, 480))
        turns = np.array([swing.at(t).heading - swing.middle.heading for t in range(0, 3600, 100)])
        np.testing.assert_allclose(turns, turns.max() * np.sin(np.arange(36) / 36 * 2 * math.pi), atol=1e-9)
        assert turns.max() > 0
        point = np.array([10.0, 20.0, -30.0])
        np.testing.assert_allclose(
            swing.shifted(7, -9).at(50).pixel(point), swing.at(50).pixel(point) + np.array([7, -9])
        )

    def test_columns_see_the_area_from_border_to_border(self):
        camera = Swing.around(SIDES, 5.0, -50.0, (640, 480)).at(700)
        columns = Columns.of(camera, SIDES, 640)
        eye, half = -camera.distance * camera.forward, 0.5 * np.array(SIDES)
        for distance in (columns.near, columns.far):
            places = np.abs(eye + columns.ray * distance[:, None]) / half
            np.testing.assert_allclose(places.max(axis=1), 1)
        middle = eye + columns.ray * (0.5 * (columns.near + columns.far))[:, None]
        assert (np.abs(middle) < half).all()
        np.testing.assert_allclose(camera.pixel(np.column_stack([middle, 0 * middle[:, 0]]))[:, 0], columns.x)
        corners = camera.pixel(np.array([(x, y, 0.0) for x in (-150, 150) for y in (-80, 80)]))[:, 0]
        assert columns.x[0] - corners.min() == pytest.approx(1, abs=1.01)
        assert corners.max() - columns.x[-1] == pytest.approx(1, abs=1.01)
        assert columns.x[0] == 2 * columns.first + 0.5
        assert [columns.at(x) for x in (-99, columns.x[0], columns.x[7] + 0.9, columns.x[7] + 1.1, 9999)] == [
            0,
            0,
            7,
            8,
            len(columns.x) - 1,
        ]
        third = columns.every(3)
        np.testing.assert_array_equal(third.x, columns.x[::3])
        assert third.first == columns.first


class TestGlass:
    SCENE = Scene.of(Scenario.load("extreme", ["area.width=300", "area.length=160"]), 0.0)

    def frame(self, t, unit=1):
        camera = Swing.around(SIDES, 0.0, self.SCENE.bed, (640, 480)).at(t)
        columns = Columns.of(camera, SIDES, 640)
        sheet = look(camera, columns, SIDES, np.full((16, 30), 2.0, np.float32), 480)
        canvas = Canvas(np.zeros((480, 640, 3), np.uint8), camera)
        return glass_box.Frame(self.SCENE, replace(LAYOUT, unit=unit)), canvas, columns, sheet

    @pytest.mark.parametrize("t", [0, 900, 2700])
    def test_grid_and_edges_are_those_of_the_box(self, drawn, t):
        frame, canvas, columns, sheet = self.frame(t)
        camera, bed = canvas.camera, self.SCENE.bed
        frame.draw_bed(canvas, columns, sheet)
        grid, (edge, *_) = drawn["pieces"][0][0], drawn["pieces"][1]
        expected = [[(x - 150, y, bed) for y in (-80, 80)] for x in (0, 100, 200, 300)]
        expected += [[(x, y - 80, bed) for x in (-150, 150)] for y in (0, 100)]
        np.testing.assert_allclose(grid, camera.pixel(np.array(expected, float)))
        signs = np.sign(camera.forward)
        far = camera.pixel(np.array([150 * signs[0], 80 * signs[1], bed]))
        np.testing.assert_allclose(edge[0][1], far)
        top = camera.pixel(np.array([150 * signs[0], 80 * signs[1], 2.0]))
        np.testing.assert_allclose(edge[0][0], top, atol=1.5)
        drawn.clear()
        frame.draw_edges(canvas, columns, sheet)
        ((foot, *_),) = drawn["line"]
        corners = [
            (-150 * signs[0], 80 * signs[1]),
            (-150 * signs[0], -80 * signs[1]),
            (150 * signs[0], -80 * signs[1]),
        ]
        np.testing.assert_allclose(foot, [(*corner, bed) for corner in corners])
        posts = drawn["pieces"][0][0]
        np.testing.assert_allclose(posts[:, 0], camera.pixel(foot))
        tops = camera.pixel(np.array([(*corner, 2.0) for corner in corners]))
        np.testing.assert_allclose(posts[:, 1], tops, atol=7)
        for (line, ink, _), rows in zip(drawn["pieces"][1:], (sheet.horizon, sheet.shore), strict=True):
            np.testing.assert_allclose(line[0], np.stack([columns.x, rows], 1)[::2])
            assert ink in (glass_box.HORIZON, glass_box.SHORE)

    @pytest.mark.parametrize("t", [0, 900, 2700])
    def test_lengths_stand_beside_their_places(self, page, drawn, t):
        frame, canvas, *_ = self.frame(t)
        camera, bed = canvas.camera, self.SCENE.bed
        frame.write_lengths(canvas)
        assert [words.text for words in page.words[:6]] == ["0", "100", "200", "300 m", "0", "100 m"]
        near = -np.sign(camera.forward) * (150, 80)
        ticks = np.concatenate([pieces for pieces, *_ in drawn["pieces"]])
        places = [(x - 150, near[1], bed) for x in (0, 100, 200, 300)] + [(near[0], y - 80, bed) for y in (0, 100)]
        for words, place, (begin, end) in zip(page.words, places, ticks, strict=False):
            np.testing.assert_allclose(begin, camera.pixel(np.array(place)))
            assert 2 < np.hypot(*(end - begin)) < 16
            assert end[1] > begin[1]  # outwards, which is down
            right = end[0] > begin[0]
            assert words.anchor == ("left" if right else "right")
            assert abs(words.position[0] - end[0]) < 6
            assert (words.position[0] > end[0]) == right
            assert 0 < words.middle - end[1] < 14
        depths = page.words[6:]
        assert [words.text for words in depths] == ["0 m", "−50 m", "−100 m"]
        corners = np.array([(near[0], -near[1]), (-near[0], near[1])])
        left = min(corners, key=lambda corner: camera.pixel(np.array([*corner, 0.0]))[0])
        for words, (points, *_), depth in zip(depths, page.strokes, (0, 50, 100), strict=True):
            x, y = camera.pixel(np.array([*left, -depth * self.SCENE.depths]))
            np.testing.assert_allclose(points[0], (x, y))
            assert points[1, 1] == y
            assert words.place[2] < points[1, 0] < x
            assert words.middle == pytest.approx(y, abs=2)

    @pytest.mark.parametrize("t", [0, 900, 2700])
    def test_the_arrow_points_to_the_north_of_the_scene(self, page, t):
        frame, canvas, *_ = self.frame(t)
        frame.draw_compass(canvas)
        ((circle, *_),) = page.strokes
        (one, *_), (other, *_) = page.fills
        middle = circle[:-1].mean(0)
        np.testing.assert_allclose(circle[0], circle[-1])
        tip, notch = one[0], one[2]
        np.testing.assert_array_equal([other[0], other[1]], [tip, notch])
        ways = canvas.camera.pixel(np.array([(0, 1.0, 0), (1.0, 0, 0)])) - canvas.camera.pixel(np.zeros(3))
        north = ways[0] / np.hypot(*ways[0])
        for point in (tip, notch):
            np.testing.assert_allclose(np.abs(np.cross([*north, 0], [*(point - middle), 0])[2]), 0, atol=0.5)
        assert (tip - middle) @ north > 0 > (notch - middle) @ north
        barbs = one[1] - middle, other[2] - middle
        scale = np.linalg.solve(np.stack([ways[1], ways[0]], 1), np.array(barbs).T).T
        assert scale[0, 0] == pytest.approx(-scale[1, 0], rel=0.02)
        assert scale[0, 1] == pytest.approx(scale[1, 1], rel=0.05)
        assert (barbs[0] @ north) < (notch - middle) @ north
        level = np.linalg.solve(
            np.stack([ways[1], ways[0]], 1), (np.stack([*circle, tip, *barbs + middle]) - middle).T
        ).T
        radii = np.hypot(*level.T)
        assert radii[: len(circle)].std() < 0.02 * radii.mean()
        assert (radii[len(circle) :] < radii[0]).all()
        assert np.hypot(*level[len(circle)]) > 0.8 * radii[0]
        (words,) = page.words
        name = np.array([words.position[0], words.middle])
        assert words.text == "N"
        assert np.linalg.norm(name - middle) > np.linalg.norm(tip - middle)
        assert (name - middle) @ north > 0
        assert circle.min() > 0
        assert circle[:, 0].max() < 70
        assert circle[:, 1].max() < 480

    @pytest.mark.parametrize("t", [0, 2700])
    def test_water_dims_what_is_behind_it_and_the_deep(self, t):
        """Along each sight line from where it enters the water to the bed or the far wall."""
        _, canvas, columns, sheet = self.frame(t)
        camera, bed = canvas.camera, self.SCENE.bed
        glass_box.paint_water(canvas, columns, bed, sheet)
        checked = Counter()
        for i in range(6, len(columns.x) - 6, 9):
            for row in range(int(sheet.horizon[i]) + 8, 470, 12):
                x = columns.x[i]
                fall = (row - camera.centre[1]) / camera.focal
                entry = max(columns.near[i], camera.height / fall)
                floor = (camera.height - bed) / fall
                last = min(columns.far[i], floor)
                if floor < columns.near[i] + 4:
                    below = canvas.picture[min(row + 8, 479), round(x)]
                    assert row < 462 or not below.any()
                    continue
                if abs(floor - columns.far[i]) < 25 or last - entry < 8:
                    continue
                clear = math.exp(-1.5 * (last - entry) * np.hypot(*columns.ray[i]) / camera.distance)
                down, middle = ((fall * at - camera.height) / -bed for at in (last, (last + entry) / 2))
                on_bed = floor < columns.far[i]
                light = clear * (not on_bed) * math.exp(-2.2 * down) + (1 - clear) * math.exp(-2.0 * middle)
                expected = glass_box.DARK + light * (glass_box.LIT - glass_box.DARK)
                expected = expected + clear * on_bed * (glass_box.BED - glass_box.DARK)
                np.testing.assert_allclose(canvas.picture[row, round(x)], expected, atol=4)
                checked[on_bed] += 1
        assert min(checked.values()) > 50
        filled = canvas.picture.any(-1)
        for i in range(10, len(columns.x) - 10, 20):
            rows = np.flatnonzero(filled[:, round(columns.x[i])])
            foot = camera.centre[1] + camera.focal * (camera.height - bed) / columns.near[i]
            assert rows[0] == pytest.approx(sheet.horizon[i], abs=2)
            assert rows[-1] == pytest.approx(foot, abs=2)


class TestScene:
    SCENE = Scene((300.0, 160.0), 2.0, 0.5, -50.0, -40.0, -50.0)

    def test_places_are_relative_to_the_middle_at_their_heights(self):
        flat = np.array([[(0.0, 0.0), (300.0, 160.0)], [(200.0, 20.0), (150.0, 80.0)]])
        up = np.array([[1.0, 2.0], [3.0, 4.0]])
        np.testing.assert_array_equal(
            self.SCENE.place(flat, up), [[(-150, -80, 1), (150, 80, 2)], [(50, -60, 3), (0, 0, 4)]]
        )

    def test_what_floats_is_on_the_surface_between_its_cells(self):
        x, y = (np.arange(60) + 0.5) * 5 - 150, ((np.arange(16) + 0.5) * 10 - 80)[:, None]
        heights = (0.02 * x - 0.05 * y + 1).astype(np.float32)
        flat = np.random.default_rng(0).uniform((-145, -74), (145, 74), (50, 2))
        afloat = self.SCENE.afloat(flat, heights)
        np.testing.assert_allclose(afloat[:, 2], 0.02 * flat[:, 0] - 0.05 * flat[:, 1] + 1, atol=0.01)
        np.testing.assert_array_equal(afloat[:, :2], flat)
        beyond = self.SCENE.afloat(np.array([(-400.0, -300.0), (400.0, 300.0)]), heights)
        np.testing.assert_allclose(beyond[:, 2], [heights[0, 0], heights[-1, -1]])

    def test_scales_make_small_waves_and_flat_areas_visible_and_no_more(self):
        for width, limit in ((300.0, 0.2), (300.0, 5.0), (5000.0, 1.0), (40.0, 0.01), (19000.0, 0.01)):
            scenario = Scenario.load("extreme", [f"area.width={width}", "area.length=40", "auv.start_separation=1"])
            scene = Scene.of(scenario, limit)
            assert scene.heights in (1, 2, 5, 10, 20, 50, 100)
            share = scene.heights * limit / width
            assert share >= 0.012 or scene.heights == 100
            assert scene.heights == 1 or share < 0.03 or limit < 0.02
            assert -scene.bed == scene.depths * 120
            assert -scene.auvs == scene.depths * 100
            assert -scene.bed / width >= 0.3 or scene.depths == 1
            assert -scene.bed / width <= max(0.75, 120 / width if scene.depths == 1 else 0)


class TestBelow:
    def test_all_of_an_auv_is_where_the_camera_sees_it(self, drawn):
        trace, t = mission(), 30
        view = view_of(trace)
        camera, scene, itinerary = view.camera(t), view.scene, Itinerary(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), t)
        auvs, nodes = (
            scene.place(trace.auv_position[:, 0], scene.auvs),
            scene.place(trace.node_position[0], scene.nodes),
        )
        lines = [points for points, *_ in drawn["line"]]
        pieces = [points for points, *_ in drawn["pieces"]]
        for k in range(3):
            place = auvs[t, k]
            trail = next(points for points, ink, *_ in drawn["trail"] if ink == style.auv_colour(k))
            np.testing.assert_allclose(trail, auvs[track(t, 1.0), k])
            foot = np.array([*place[:2], scene.bed])
            assert found(lines, [place, foot]) == 1
            assert found([centre for centre, *_ in drawn["circle"]], foot) == 1
            stops = [itinerary.node(t, k), *itinerary.after(t, k)]
            for a, b in pairwise(stops):
                assert found(lines, nodes[[a, b]]) == 1
            outline = next(
                points
                for points in lines
                if len(points) == 65
                and np.allclose(points[:-1, :2].mean(0), trace.estimate[t, 0, k] - np.array(SIDES) / 2)
            )
            offsets = (outline[:, :2] + np.array(SIDES) / 2 - trace.estimate[t, 0, k]) / SIGMAS
            inverse = np.linalg.inv([[6.0, 2.0], [2.0, 4.0]])
            np.testing.assert_allclose(np.einsum("ni,ij,nj->n", offsets, inverse, offsets), 1)
            assert (outline[:, 2] == place[2]).all()
            np.testing.assert_array_equal(outline[0], outline[-1])
            begin, node = camera.pixel(place), camera.pixel(nodes[stops[0]])
            assert any(
                np.allclose(each[0, 0], begin)
                and np.cross([*(node - begin), 0], [*(each[-1, 1] - begin), 0])[2] == pytest.approx(0, abs=1e-4)
                for each in pieces
                if each.ndim == 3
            )
        for name, places in (("fix", trace.estimate), ("foreseen", trace.foreseen_position)):
            expected = camera.pixel(scene.place(places[t, 0], scene.auvs))
            order = np.argsort(-camera.away(auvs[t]))
            np.testing.assert_allclose([at for at, *_ in drawn[name]], expected[order])
        for text, at, *_ in drawn["badge"]:
            pixel = camera.pixel(auvs[t, int(text) - 1])
            assert 12 < np.hypot(*(at - pixel)) < 26
            assert at[0] > pixel[0]
            assert at[1] < pixel[1]
        assert [text for text, *_ in drawn["badge"]] == ["1", "2", "3"]

    def test_services_are_circles_that_fill(self, drawn):
        trace = mission()
        hovering = trace.hovering.copy()
        hovering[27:31, 0, 1] = 1
        trace = replace(trace, hovering=hovering)
        view = view_of(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), 28)
        node = view.scene.place(trace.node_position[0, trace.target[27, 0, 1]], view.scene.nodes)
        dim, full = [each for each in drawn["circle"] if np.allclose(each[0], node)]
        assert dim[1] == full[1] == max(trace.scenario.auv.hover_radius, 0.04 * 300)
        assert full[2] == style.auv_colour(1)
        assert full[4] == pytest.approx(0.5)
        assert len(dim) == 3

    def test_bodies_are_drawn_far_to_near_with_their_headings(self, drawn):
        trace, t = mission(), 30
        view, running = view_of(trace), RunningMetrics.of(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), t)
        camera = view.camera(t)
        auvs, boats = drawn["body"][:3], drawn["body"][3:]
        for found, places, headings in (
            (auvs, view._below.auvs[t], running.heading[t]),
            (boats, view.boats[t], running.boat_heading[t]),
        ):
            order = np.argsort(-camera.away(places))
            for (_, place, axes, length), k in zip(found, order, strict=True):
                np.testing.assert_allclose(place, places[k])
                np.testing.assert_allclose(axes[0], [math.cos(headings[k]), math.sin(headings[k]), 0], atol=1e-9)
                assert 10 < length < 40
        assert {length for *_, length in auvs} < {length - 1 for *_, length in boats} or auvs[0][3] < boats[0][3]

    def test_nodes_stand_on_stalks_and_near_ones_hide_the_far(self, drawn, monkeypatch):
        trace, made = mission(), []
        monkeypatch.setattr(symbols.NodeGauges, "draw", lambda gauges, _, *rest: made.append((gauges._radius, *rest)))
        view = view_of(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), 30)
        camera = view.camera(30)
        nodes = view.scene.place(trace.node_position[0], view.scene.bed)
        order = np.argsort(-camera.away(nodes))
        stalks = drawn["pieces"][2][0]
        np.testing.assert_allclose(stalks[:, 0], camera.pixel(nodes))
        np.testing.assert_allclose([at for _, at, *_ in made], stalks[order, 1])
        np.testing.assert_allclose(
            [share for _, _, share, *_ in made], trace.backlog[30, 0][order] / trace.scenario.nodes.buffer
        )
        radii = np.array([radius for radius, *_ in made])
        assert (np.diff(radii) >= 0).all()
        assert radii[0] < radii[-1]
        np.testing.assert_allclose(np.hypot(*(stalks[:, 1] - stalks[:, 0]).T)[order], 1.5 * radii)
        assert (stalks[:, 1, 1] < stalks[:, 0, 1]).all()
        assert {pulse for *_, pulse in made} == {0.5 + 0.5 * math.sin(0.35 * 30)}
        assert np.allclose([age for *_, age, _ in made], view._below._age[30][order])

    @pytest.mark.parametrize("task", ["data-collection", "station-keeping"])
    def test_stations_have_no_age(self, task):
        trace = mission()
        scenario = trace.scenario.model_copy(update={"task": task})
        age = view_of(replace(trace, scenario=scenario, target=0 * trace.target))._below._age
        assert age.any() == (task == "data-collection")


class TestAfloat:
    def test_wake_and_way_lie_on_the_water(self, drawn):
        trace, t = mission(), 30
        surface = np.broadcast_to(np.linspace(-2, 4, 40, dtype=np.float32)[:, None], (40, 40, 60)).copy()
        trace = replace(trace, surface=surface)
        view = view_of(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), t)
        camera, scene, (heights, _) = view.camera(t), view.scene, view.surface(t)
        for boat in range(2):
            places = scene.place(trace.boat_position[track(t, 1.0), 0, boat], 0.0)[:, :2]
            wakes = [points for points, ink, *_ in drawn["trail"] if ink == style.BOAT]
            assert found(wakes, scene.afloat(places, heights)) == 1
            goal = scene.place(trace.boat_goal[t, 0, boat], 0.0)[None, :2]
            end = camera.pixel(scene.afloat(goal, heights))[0]
            assert found([at for at, *_ in drawn["cross"]], end) == 1
            ways = [points for points, ink, *_ in drawn["pieces"] if ink == style.BOAT and points.shape[1] == 2]
            way = next(points for points in ways if np.allclose(points[-1, 1], end))
            begin = camera.pixel(scene.afloat(view.boats[t, boat][None, :2], heights))[0]
            np.testing.assert_allclose(way[0, 0], begin)
            gaps = np.diff(way.reshape(-1, 2) @ (end - begin))
            assert (gaps > 0).all()
        assert len(drawn["cross"]) == 2
        np.testing.assert_allclose(view.boats[..., 2], scene.heights * trace.boat_surface[:, 0, :, 0])

    @pytest.mark.parametrize("unit", [1, 2])
    def test_near_goals_are_not_drawn(self, drawn, unit):
        trace = mission()
        layout, box = (
            Layout.fit(1280 * unit, 720 * unit, trace.scenario.area),
            Rectangle(*(unit * side for side in BOX)),
        )
        view = PerspectiveView(trace, RunningMetrics.of(trace), box, layout)
        camera = view.camera(1)
        aside = np.append(camera.right, 0.0)
        counts = []
        for pixels in (18, 22):
            goal = trace.boat_position.copy()
            for boat in range(2):
                place = view.boats[1, boat]
                metres = pixels * unit / np.hypot(*(camera.pixel(place + aside) - camera.pixel(place)))
                goal[1, 0, boat] += metres * camera.right
            drawn.clear()
            changed = replace(trace, boat_goal=goal)
            picture = np.zeros((unit * 720, unit * 1280, 3), np.uint8)
            PerspectiveView(changed, RunningMetrics.of(changed), box, layout).draw(picture, 1)
            counts.append(len(drawn.get("cross", [])))
        assert counts == [0, 2]

    def test_the_surface_lies_translucent_over_what_is_below(self):
        camera = Swing.around(SIDES, 4.0, -50.0, (600, 400)).middle
        columns = Columns.of(camera, SIDES, 640)
        sheet = look(camera, columns, SIDES, np.zeros((20, 30), np.float32), 460)
        ground, colours = np.full((460, 640, 3), 50, np.uint8), np.full((20, 30, 3), 200, np.uint8)
        perspective._paint_surface(ground, columns, sheet, colours)
        opacity = (ground[round(sheet.shore.mean()) - 4, 320, 0] - 50) / 150
        assert 0.6 < opacity < 0.9
        assert sorted(set(ground.ravel().tolist())) == [50, round(50 + 150 * perspective.OPACITY)]
        for i in range(4, len(columns.x) - 4, 11):
            rows = np.flatnonzero(ground[:, round(columns.x[i]), 0] > 50)
            assert rows[0] == pytest.approx(sheet.horizon[i], abs=2.5)
            assert rows[-1] == pytest.approx(sheet.shore[i], abs=2.5)

    def test_the_room_is_lightest_above_its_middle_and_alike_at_both_sides(self):
        room = perspective._backdrop(301, 161).astype(int)
        assert np.abs(room - room[:, ::-1]).max() <= 2
        light = room.sum(-1)
        assert light[60, 150] > light[0, 150] > light[-1, 150]
        assert light[60, 150] > light[60, 0] > light[-1, 0]
        np.testing.assert_allclose(room[60, 150], style.colour("#1d3346"), atol=2)
        rows = light.mean(1)
        assert rows.argmax() == pytest.approx(0.375 * 160, abs=8)
        assert (room[-1, 0] >= np.array(style.DARK.background) - 1).all()

    def test_the_scale_of_heights_stands_between_its_ends(self, page):
        trace = synthetic_trace(steps=3, area=SIDES)
        view = view_of(trace)
        said = {words.text: words for words in page.words}
        high, low, note = said["+5 m"], said["sea surface  −5"], said["true to scale, vehicles enlarged"]
        highest = np.flatnonzero((view._backdrop[:30] == COLOURS[255].astype(np.uint8)).all(-1).any(0))
        lowest = np.flatnonzero((view._backdrop[:30] == COLOURS[0].astype(np.uint8)).all(-1).any(0))
        assert low.place[2] < lowest.min() < highest.max() < high.place[0]
        assert lowest.min() - low.place[2] == pytest.approx(high.place[0] - highest.max(), abs=2.5)
        assert high.position[0] == note.position[0] < BOX.width
        assert BOX.width - note.position[0] == pytest.approx(BOX.height - note.position[1], abs=2)
        rows = np.flatnonzero((view._backdrop == COLOURS[255].astype(np.uint8)).all(-1).any(1))
        assert high.place[1] <= rows.min() + 2 < rows.max() - 4 < high.position[1]
        for size, shown in (((300, 200), True), ((180, 200), False), ((300, 17), False)):
            page.words.clear()
            PerspectiveView(trace, RunningMetrics.of(trace), Rectangle(0, 0, *size), LAYOUT)
            assert ("+5 m" in {words.text for words in page.words}) == shown

    def test_each_frame_is_drawn_over_the_room(self):
        view = view_of(mission())
        pictures = [np.full((720, 1280, 3), ink, np.uint8) for ink in (0, 77)]
        for picture in pictures:
            view.draw(picture, 3)
        boxes = [BOX.of(picture) for picture in pictures]
        np.testing.assert_array_equal(*boxes)
        np.testing.assert_array_equal(boxes[0][:40, :20], view._backdrop[:40, :20])


class TestSound:
    @pytest.mark.parametrize("t", [26, 29, 34, 39])
    def test_pings_are_spheres_and_who_is_heard_has_a_line(self, drawn, t):
        trace = mission()
        scene = Scene.of(trace.scenario, 0.0)._replace(depths=0.5, bed=-60.0, auvs=-50.0)
        boats, auvs = scene.place(trace.boat_position[:, 0], 1.0), scene.place(trace.auv_position[:, 0], scene.auvs)
        sound, exchanges = Sound(trace, scene, boats, auvs), Exchanges(trace)
        camera = Camera(1.9, 800.0, 300.0, 900.0, (320.0, 200.0))
        canvas = Canvas(np.zeros((480, 640, 3), np.uint8), camera)
        sound.draw_below(canvas, t, 2)
        lines = drawn.pop("line", [])
        direct = [points for points, *_ in lines if len(points) == 2]
        for k in range(3):
            boat, fresh = exchanges.heard(t, k)
            assert found(direct, [boats[t, boat], auvs[t, k]]) == (0.85 * fresh > 0.1)
        running = [(b, share) for b, share in enumerate(exchanges.ping(t)) if share]
        arcs = [points for points, *_ in lines if len(points) > 2]
        assert bool(arcs) == bool(running)
        heights = np.full((20, 30), 1.5, np.float32)
        sound.draw_afloat(canvas, t, heights, 2)
        circles = [points for points, *_ in drawn.pop("line", [])]
        radii = {}
        for boat, share in running:
            way = np.linalg.norm((auvs[t] - boats[t, boat]) / (1, 1, 0.5), axis=1).max()
            radii[boat] = share * way
        seen = set()
        for points in arcs:
            away = [np.linalg.norm((points - boats[t, boat]) / (1, 1, 0.5), axis=1) for boat in radii]
            boat = next(boat for boat, each in zip(radii, away, strict=True) if np.allclose(each, radii[boat]))
            flat = points[:, :2] - boats[t, boat, :2]
            plane = next(
                name
                for name in ("right", "forward")
                if np.allclose(
                    np.cross(np.pad(flat, ((0, 0), (0, 1))), [*getattr(camera, name), 0])[:, 2], 0, atol=1e-6
                )
            )
            seen.add((boat, plane))
            assert (points[:, 2] <= boats[t, boat, 2] + 1e-9).all()
            assert (points[:, 2] >= scene.bed - 1e-6).all()
            assert (np.abs(points[:, :2]) <= np.array(SIDES) / 2 + 1e-6).all()
        assert len(seen) == 2 * len(radii) or not radii
        for points in circles:
            away = [np.hypot(*(points[:, :2] - boats[t, boat, :2]).T) for boat in radii]
            assert any(np.allclose(each, radii[boat]) for boat, each in zip(radii, away, strict=True))
            assert (points[:, 2] == 1.5).all()
        assert bool(circles) or not radii

    def test_lines_and_spheres_fade(self, drawn):
        trace = mission()
        scene = Scene.of(trace.scenario, 0.0)
        boats, auvs = scene.place(trace.boat_position[:, 0], 1.0), scene.place(trace.auv_position[:, 0], scene.auvs)
        sound, heard, rings = Sound(trace, scene, boats, auvs), [], []
        canvas = Canvas(np.zeros((480, 640, 3), np.uint8), Camera(1.9, 800.0, 300.0, 900.0, (320.0, 200.0)))
        for t in (27, 29, 33):
            drawn.clear()
            sound.draw_below(canvas, t, 2)
            for kind, length in ((heard, True), (rings, False)):
                inks = [ink for points, ink, _ in drawn["line"] if (len(points) == 2) == length]
                kind.append(np.abs(np.subtract(inks[0], (0x56, 0x3B, 0x12))).sum())  # from the colour of deep water
        assert heard[0] > heard[1] > heard[2]
        assert rings[0] > rings[1] > rings[2]


class TestField:
    def field(self, width=300.0, length=600.0):
        wide = [f"area.width={width}", f"area.length={length}", "channel.data_ratio=18", "acoustics.source_level=139"]
        trace = synthetic_trace(steps=9, auvs=2, nodes=2, vortices=0, sea=False)
        foreseen = np.zeros_like(trace.estimate)
        foreseen[:, 0] = (75.0, 150.0), (225.0, 525.0)
        foreseen[6:, 0, 0] += 90.0
        covariance = np.zeros_like(trace.estimate_covariance)
        covariance[:, 0, 0], covariance[:, 0, 1] = (200.0, 90.0, 400.0), (150.0, 50.0, 50.0)
        scenario = Scenario.load("extreme", [*wide, "nodes.count=2"])
        return ReplyField(replace(trace, scenario=scenario, foreseen_position=foreseen, estimate_covariance=covariance))

    def test_an_area_that_is_not_square_has_its_own_grid(self):
        field = self.field()
        share = field.share(2)
        assert share.shape == (41, 21)
        np.testing.assert_allclose([share[10, 5], share[35, 15]], [0.75, 0.25], atol=0.01)
        assert self.field(600.0, 300.0).share(2).shape == (21, 41)

    def test_lines_lie_where_the_field_has_their_level_and_are_made_every_few_steps(self):
        field = self.field()
        share = field.share(3)
        lines = field.lines(3)
        assert tuple(level for level, _ in lines) == LEVELS
        assert any(found for _, found in lines)
        for level, found in lines:
            for line in found:
                for x, y in line:
                    column, row = min(int(x / 15), 19), min(int(y / 15), 39)
                    p, q = x / 15 - column, y / 15 - row
                    a, b, c, d = share[row : row + 2, column : column + 2].ravel()
                    assert (1 - q) * ((1 - p) * a + p * b) + q * ((1 - p) * c + p * d) == pytest.approx(level, abs=0.02)
        assert EVERY == 3
        assert field.lines(5) is field.lines(4) is lines
        assert field.lines(6) is not lines
        moved = np.concatenate(dict(field.lines(6))[0.4])
        np.testing.assert_allclose(moved.mean(0) - np.concatenate(dict(lines)[0.4]).mean(0), 90.0, atol=60)
        assert np.allclose(np.concatenate(dict(field.lines(5))[0.4]), np.concatenate(dict(lines)[0.4]))

    @pytest.mark.parametrize(
        ("low", "high", "shown"), [(0.8, 1.0, True), (0.81, 1.0, False), (0.0, 0.2, True), (0.0, 0.19, False)]
    )
    def test_there_are_none_where_all_or_hardly_anything_is_heard(self, low, high, shown):
        field = self.field()
        field.share = lambda _: np.linspace(low, high, 41 * 21).reshape(41, 21)
        assert bool(field.lines(3)) == shown
