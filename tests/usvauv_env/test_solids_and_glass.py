"""The perspective's solids, camera, and glass box of water."""

import math
from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.usvauv_env.test_frames import overlap
from tests.usvauv_env.test_perspective_parts import LAYOUT, SIDES
from usvauv.env.render import bodies, glass_box
from usvauv.env.render.bodies import Body
from usvauv.env.render.camera import Swing
from usvauv.env.render.canvas import Canvas
from usvauv.env.render.scene import Scene
from usvauv.env.render.wave_sheet import Columns, look
from usvauv.env.scenario import Scenario


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

    @pytest.mark.parametrize("unit", [1, 4, 8])
    def test_lengths_without_room_are_left_out(self, page, unit):
        frame, canvas, *_ = self.frame(0, unit)
        frame.write_lengths(canvas)
        texts = [words.text for words in page.words]
        assert {"300 m", "100 m", "0 m"} <= set(texts)
        assert ("−50 m" in texts) == ("200" in texts) == (unit < 8)
        for axis in ("0", "100", "200", "300 m"), ("0 m", "−50 m", "−100 m"):
            places = [words.place for words in page.words if words.text in axis]
            assert not any(overlap(a, b) for a, b in pairwise(places))

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
            assert points[1, 1] == points[0, 1]
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
