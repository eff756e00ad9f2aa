"""The perspective view: its camera, what hides what, and how a vehicle stands on the waves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usvauv.env import Scenario
from usvauv.env.render.scene import SWING_FRAMES, PinholeCamera, Scene, Swing, turned
from usvauv.env.render.sea import Columns, look

SIDES = (200.0, 160.0)
WIDTH, HEIGHT = 640, 480
CAMERA = Swing.around(SIDES, 8.0, -100.0, (WIDTH, HEIGHT)).middle
COLUMNS = Columns.of(CAMERA, SIDES, WIDTH)


class TestCamera:
    def test_is_a_pinhole(self):
        """By bearing and range from the camera; its picture is upright, d behind the hole."""
        camera = PinholeCamera(heading=2.1, distance=500.0, height=260.0, focal=900.0, centre=(310.0, -40.0))
        points = np.random.default_rng(0).uniform(-100, 100, (50, 3))
        eye = np.array([-500 * math.cos(2.1), -500 * math.sin(2.1), 260.0])
        for (x, y), (east, north, up) in zip(camera.pixel(points), points - eye, strict=True):
            turn = math.atan2(north, east) - 2.1
            assert x == pytest.approx(310 - 900 * math.tan(turn))
            assert y == pytest.approx(-40 - 900 * up / (math.hypot(east, north) * math.cos(turn)))

    @pytest.mark.parametrize("sides", [(200.0, 200.0), (600.0, 150.0), (150.0, 600.0)])
    def test_the_box_fills_the_room_and_stays_in_it_as_the_camera_swings(self, sides):
        swing = Swing.around(sides, 8.0, -100.0, (640, 480))
        half = 0.5 * np.array(sides)
        corners = np.array([(x, y, z) for x in (-half[0], half[0]) for y in (-half[1], half[1]) for z in (-100, 8)])
        pixels = np.concatenate([swing.at(t).pixel(corners) for t in range(0, SWING_FRAMES, 60)])
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        assert (low > -2).all()
        assert (high < (642, 482)).all()
        assert max((high - low) / (640, 480)) > 0.99
        headings = np.array([swing.at(t).heading for t in range(SWING_FRAMES + 1)])
        assert 0 < np.abs(np.diff(headings)).max() < math.radians(0.02)
        assert headings[-1] == pytest.approx(headings[0])

    def test_columns_see_the_area_from_border_to_border(self):
        eye, half = -CAMERA.distance * CAMERA.forward, 0.5 * np.array(SIDES)
        for distance in (COLUMNS.near, COLUMNS.far):
            places = np.abs(eye + COLUMNS.ray * distance[:, None]) / half
            np.testing.assert_allclose(places.max(axis=1), 1)
        middle = eye + COLUMNS.ray * (0.5 * (COLUMNS.near + COLUMNS.far))[:, None]
        np.testing.assert_allclose(CAMERA.pixel(np.column_stack([middle, 0 * middle[:, 0]]))[:, 0], COLUMNS.x)


def seen(field: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (N, 2) that show a surface, and the places (N, 2) m and heights (N,) they show."""
    sheet = look(CAMERA, COLUMNS, SIDES, field, HEIGHT)
    row, column = np.nonzero(sheet.covered)
    pixels = np.stack([COLUMNS.x[column], sheet.top + 0.5 + 2.0 * row], 1)
    texels = np.stack([sheet.texel_x[row, column], sheet.texel_y[row, column]], 1)
    place = ((texels + 0.5) / field.shape[::-1] - 0.5) * SIDES
    i, j = np.clip(np.rint(texels).astype(int), 0, np.array(field.shape[::-1]) - 1).T
    return pixels, place, field[j, i]


class TestSurface:
    def test_pixels_show_the_places_that_project_to_them(self):
        y, x = np.mgrid[0:320, 0:400] / 2
        pixels, place, height = seen((3 * np.sin(0.11 * x) * np.cos(0.07 * y)).astype(np.float32))
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

    def test_the_horizon_is_that_of_the_waves_and_what_is_beyond_the_picture_is_cut_off(self):
        for height in (0.0, 6.0):
            sheet = look(CAMERA, COLUMNS, SIDES, np.full((40, 50), height, np.float32), HEIGHT)
            pixels = CAMERA.pixel(np.array([(x, y, height) for x in (-100, 100) for y in (-80, 80)]))
            assert sheet.horizon.min() == pytest.approx(pixels[:, 1].min(), abs=1)
            assert sheet.shore.max() == pytest.approx(pixels[:, 1].max(), abs=1)
        sheet = look(CAMERA, COLUMNS, SIDES, np.full((40, 50), 100.0, np.float32), HEIGHT)
        assert sheet.top == 0
        assert 2 * sheet.covered.shape[0] <= HEIGHT


class TestScene:
    @pytest.mark.parametrize(
        ("overrides", "limit", "note"),
        [
            ([], 8.0, "true to scale"),
            ([], 0.3, "heights × 10"),
            (["area.width=600", "area.length=600"], 20.0, "depths × 2"),
            (["area.depth=2000"], 8.0, "depths × 0.05"),
            (["area.width=20000"], 0.5, "heights × 100, depths × 50"),
        ],
    )
    def test_exaggerates_only_what_would_not_be_seen(self, overrides, limit, note):
        assert Scene.of(Scenario.load("extreme", overrides), limit).note == note

    def test_lines_end_at_the_borders_and_at_the_bed(self):
        scene = Scene.of(Scenario.load("extreme"), 0.0)
        assert scene.place(np.array([0.0, 200.0]), -5.0).tolist() == [-100.0, 100.0, -5.0]
        line = np.array([(-150, 0, 0), (-50, 0, 0), (50, 0, 0), (150, 0, 0), (150, 90, 0), (90, 90, 0), (80, 90, 0)])
        assert [piece[:, 0].tolist() for piece in scene.inside(line)] == [[-50, 50], [90, 80]]
        down = np.column_stack([0 * np.arange(5), 0 * np.arange(5), -40.0 * np.arange(5)])
        assert [piece[-1, 2] for piece in scene.inside(down)] == [-120.0]

    def test_a_body_stands_upright_on_its_slope(self):
        axes = turned(0.7, np.array([0.3, -0.2]))
        assert axes @ axes.T == pytest.approx(np.eye(3))
        assert np.linalg.det(axes) == pytest.approx(1)
        assert axes[2] == pytest.approx(np.array([-0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0]))
        assert math.atan2(axes[0, 1], axes[0, 0]) == pytest.approx(0.7)
