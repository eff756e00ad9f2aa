"""The perspective view: its camera, what hides what, and how a vehicle stands on the waves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from usvauv.env.render.scene import PinholeCamera, Swing
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
