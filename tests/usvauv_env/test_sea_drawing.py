"""The sea under the map: relief, streaks of the current, and light in closed form."""

import math

import cv2
import numpy as np
import pytest

from tests.usvauv_env.test_map_drawing import Recorder
from usvauv.env.render import sea_layers, sea_shading, style
from usvauv.env.render.camera import Swing
from usvauv.env.render.frame_layout import MapView, Rectangle
from usvauv.env.render.sea_layers import COLOURS, CurrentStreaks, SeaSurface, elevation_limit
from usvauv.env.render.sea_shading import SeaShading
from usvauv.env.scenario.sea import Area


class TestRelief:
    VIEW = MapView(Area(width=400.0, length=200.0), Rectangle(20, 30, 100, 50))

    def test_the_scale_ends_above_nearly_all_elevations(self):
        wave = 2.9 * np.sin(np.linspace(0, 20 * np.pi, 4000)).reshape(10, 20, 20)
        assert elevation_limit(wave) == 3
        assert elevation_limit(-wave) == 3
        assert elevation_limit(1e-4 * wave) == 0
        wave[4, 5, 6] = -62.0  # one deep trough is not the scale's end but enlarges it
        assert elevation_limit(wave) == elevation_limit(-wave) == 7
        assert elevation_limit(np.zeros((0, 0, 0))) == 0

    def test_a_slope_has_the_colour_of_its_height_and_the_light_of_its_normal(self):
        """A plane, rising to each of eight directions, drawn about 30° steep, of a field as coarse as the picture."""
        rows, columns = np.mgrid[0:50, 0:100]
        north, east = 49 - rows, columns
        light = sea_layers.LIGHT
        assert np.linalg.norm(light) == pytest.approx(1, abs=0.01)
        assert light[0] == -light[1]
        shade = {}
        for turn in np.arange(8) * math.pi / 4:
            height = (math.cos(turn) * east + math.sin(turn) * north) * 0.05
            height -= height.mean()
            surface = SeaSurface(np.flipud(height)[None], self.VIEW)
            picture = surface.relief(np.flipud(height))
            assert picture.shape == (50, 100, 3)
            index = ((height / surface.limit + 1) * 127.5).astype(int)
            ratio = picture.astype(float)[3:-3, 3:-3, 0] / COLOURS[index][3:-3, 3:-3, 0]
            assert ratio.std() < 0.02
            tilt = math.tan(math.radians(29))
            normal = np.array([-tilt * math.cos(turn), -tilt * math.sin(turn), 1]) / math.hypot(1, tilt)
            shade[turn] = ratio.mean(), float(normal @ light / light[2])
        drawn, lambert = np.array(list(shade.values())).T
        slope, constant = np.polyfit(lambert, drawn, 1)
        np.testing.assert_allclose(drawn, slope * lambert + constant, atol=0.03)
        assert slope + constant == pytest.approx(1, abs=0.03)  # level water has its own colour
        assert 0.5 < slope < 0.9

    def test_level_water_is_plain(self):
        field = np.zeros((40, 60), np.float32)
        field[:, 40:] = np.linspace(0, 2, 20)
        picture = SeaSurface(field[None], self.VIEW).relief(field)
        assert (np.abs(picture[:, 5:35].astype(float) - COLOURS[127]) <= 1).all()

    def test_beyond_its_ends_the_scale_goes_on_in_the_last_colours(self):
        field = np.zeros((40, 60), np.float32)
        field[:, :20], field[:, 40:] = -1.0, 1.0
        surface = SeaSurface(field[None], self.VIEW)
        for picture in (surface.relief(field), surface.relief(3 * field)):
            np.testing.assert_array_equal(picture[20, [5, 55]], COLOURS[[0, 255]].astype(np.uint8))

    def test_a_fine_field_is_reduced_a_coarse_one_not_enlarged(self):
        wave = np.sin(np.arange(600) / 40) * np.ones((300, 1))
        for box, pixels, shape in (
            (Rectangle(0, 0, 200, 100), 160, (80, 160)),
            (Rectangle(0, 0, 100, 50), 160, (50, 100)),
            (Rectangle(0, 0, 60, 300), 150, (150, 30)),
            (Rectangle(0, 0, 2000, 1000), 700, (300, 600)),
        ):
            assert SeaSurface(wave[None], MapView(Area(), box), pixels).relief(wave).shape == (*shape, 3)
        flat = SeaSurface(0 * wave[None], MapView(Area(), Rectangle(0, 0, 200, 100)))
        assert (flat.relief(wave) == style.SEA[2]).all()
        picture = np.zeros((200, 300, 3), np.uint8)
        flat._view = self.VIEW
        flat.paint(picture, 0)
        assert (self.VIEW.rectangle.of(picture) == style.SEA[2]).all()
        assert picture.any(-1).sum() == 100 * 50

    def test_a_nearly_level_surface_is_not_exaggerated_without_end(self):
        field = np.full((40, 60), 1.0)
        field += 1e-7 * np.arange(60)  # 1 m of a scale that ends at 1.5 m
        picture = SeaSurface(field[None], self.VIEW).relief(field)
        assert (np.abs(picture.astype(float) - COLOURS[212]) < 4).all()


class TestStreaks:
    BOX = Rectangle(10, 20, 600, 250)
    VIEW = MapView(Area(width=240.0, length=100.0), BOX)

    def streaks(self, speed, unit=1.0):
        stream = np.zeros((2, 2, 2)) + np.array(speed)
        return CurrentStreaks(np.zeros((0, 4)), stream, 240.0, 100.0, self.VIEW, unit)

    def tails(self, streaks, time):
        overlay = Recorder()
        streaks.draw(overlay, time, 1)
        (whole, faint, _), (half, bright, _) = overlay.of("white_lines")
        assert faint < bright
        np.testing.assert_array_equal(half, whole[:, : half.shape[1]])
        assert half.shape[1] == (whole.shape[1] + 1) // 2
        return whole

    def test_seeds_are_one_in_each_part_of_the_area(self):
        seeds = self.streaks((0.3, 0.2))._seeds
        across, up = round(600 / 27), round(250 / 27)
        parts = np.floor(seeds / (240, 100) * (across, up)).astype(int)
        assert sorted(map(tuple, parts.tolist())) == [(x, y) for x in range(across) for y in range(up)]
        assert np.std(seeds / (240, 100) * (across, up) - parts, axis=0).min() > 0.2
        assert len(self.streaks((0.3, 0.2), 2.0)._seeds) == round(300 / 27) * round(125 / 27)

    @pytest.mark.parametrize(
        ("speed", "length", "unit"), [((0.3, -0.4), 30, 1), ((0.03, 0.04), 15, 1), ((-0.6, 0.8), 60, 2)]
    )
    def test_tails_lie_along_the_current_as_long_as_thirty_pixels_of_the_fastest(self, speed, length, unit):
        streaks = self.streaks(speed, unit)
        assert streaks.fastest == pytest.approx(np.hypot(*speed), rel=1e-4)
        assert streaks.tail == pytest.approx(length / (np.hypot(*speed) * 2.5), rel=1e-4)
        tails = self.tails(streaks, 3.0)
        ways = tails[:, 0] - tails[:, -1]
        sizes = np.hypot(*ways.T)
        assert sizes.max() == pytest.approx(length, rel=1e-3)
        assert (sizes > 0.99 * length).mean() > 0.5
        moving = sizes > 1
        directions = ways[moving] / sizes[moving, None]
        np.testing.assert_allclose(
            directions, np.broadcast_to([speed[0], -speed[1]], directions.shape) / np.hypot(*speed), atol=0.01
        )

    def test_particles_drift_with_the_current_and_begin_and_end_without_a_tail(self):
        streaks = self.streaks((0.3, -0.4))
        per_second, step = 0.5 * 2.5, streaks.tail / 16
        times = np.arange(0, 7 * streaks.tail, step)
        series = np.array([self.tails(streaks, time) for time in times])
        moved = np.hypot(*np.moveaxis(np.diff(series[:, :, 0], axis=0), -1, 0))
        jumps = moved > 1.01 * per_second * step
        sizes = np.hypot(*np.moveaxis(series[:, :, 0] - series[:, :, -1], -1, 0))
        assert (jumps.sum(0) >= 1).all()  # of each one within a life of six tails
        assert (jumps.sum(0) <= 2).all()
        assert sizes[:-1][jumps].max() < 3
        assert sizes[1:][jumps].max() < 3
        lives = np.diff(np.argwhere(jumps.T)[:, 1])[np.diff(np.argwhere(jumps.T)[:, 0]) == 0]
        np.testing.assert_allclose(lives * step, 6 * streaks.tail, rtol=0.02)

    def test_a_field_that_changes_is_followed_and_one_that_does_not_is_kept(self, monkeypatch):
        streaks = self.streaks((0.3, -0.4))
        before = streaks._path
        streaks.update(streaks._vortex.copy(), streaks._stream.copy())
        assert streaks._path is before
        streaks.update(np.array([[120.0, 50.0, 90.0, 20.0]]), streaks._stream)
        assert (streaks._path != before).any()
        turned = streaks._path
        streaks.update(streaks._vortex, -streaks._stream)
        assert (streaks._path != turned).any()
        still = CurrentStreaks(np.zeros((0, 4)), np.zeros((0, 0, 2)), 240.0, 100.0, self.VIEW, 1.0)
        still.update(np.array([[120.0, 50.0, 90.0, 20.0]]), np.zeros((0, 0, 2)))
        overlay = Recorder()
        still.draw(overlay, 1.0, 1)
        assert overlay.made == []
        assert still.tail == math.inf


class TestLight:
    """The sea in perspective."""

    SIDES = (200.0, 120.0)
    CAMERA = Swing.around(SIDES, 5.0, -60.0, (640, 480)).middle

    def shading(self, surface, limit=1e6, scale=1.0, sides=SIDES, camera=CAMERA):
        return SeaShading(np.asarray(surface, np.float32), limit, sides, camera, scale)

    def plane(self, east, north, shape=(60, 100), sides=SIDES):
        x, y = (np.arange(shape[1]) + 0.5) / shape[1] * sides[0], (np.arange(shape[0]) + 0.5) / shape[0] * sides[1]
        return (east * x + north * y[:, None] - 0.5 * (east * sides[0] + north * sides[1]))[None]

    @pytest.mark.parametrize("scale", [1.0, 3.0])
    def test_a_plane_is_lit_by_sun_sky_and_haze(self, scale):
        """Lambert's cosine of the sun, mirrored sky at grazing angles, glint along the half vector."""
        for east, north in ((0.0, 0.0), (0.1, -0.05), (-0.06, 0.12), (0.05, 0.2), (-0.15, -0.1)):
            shading = self.shading(self.plane(east / scale, north / scale, (96, 160)), scale=scale)
            heights, colours = shading.at(0)
            assert heights.shape == colours.shape[:2] == (96, 160)
            assert np.ptp(heights) == pytest.approx(abs(east) * 200 + abs(north) * 120, rel=0.03)
            x, y = (np.arange(160) + 0.5) / 160 * 200 - 100, ((np.arange(96) + 0.5) / 96 * 120 - 60)[:, None]
            place = np.stack(np.broadcast_arrays(x, y, 0.0), -1)
            camera = self.CAMERA
            view = np.array([*(-camera.distance * camera.forward), camera.height]) - place
            view /= np.linalg.norm(view, axis=-1, keepdims=True)
            left = np.array([-camera.forward[1], camera.forward[0]])
            sun = np.array([*(0.80 * camera.forward + 0.36 * left), 0.48])
            sun /= np.linalg.norm(sun)
            half = view + sun
            half /= np.linalg.norm(half, axis=-1, keepdims=True)
            normal = np.array([-1.5 * east, -1.5 * north, 1.0])
            normal /= np.linalg.norm(normal)
            facing, glint = np.clip(view @ normal, 0, 1), np.clip(half @ normal, 0, 1) ** 64
            mirrored = 0.02 + 0.55 * (1 - facing) ** 4
            away = (place[..., :2] + camera.distance * camera.forward) @ camera.forward
            clear = (1 - 0.24 * (away - away.min()) / np.ptp(away))[..., None]
            body = COLOURS[127] * (0.34 + 1.05 * max(0.0, float(normal @ sun)))
            water = (
                body * (1 - mirrored[..., None])
                + mirrored[..., None] * sea_shading.SKY
                + glint[..., None] * sea_shading.SUN
            )
            expected = np.clip(clear * water + (1 - clear) * sea_shading.DEEP, 0, 255)
            np.testing.assert_allclose(colours[2:-2, 2:-2], expected[2:-2, 2:-2], atol=1.5)

    def test_water_has_the_colour_of_its_elevation(self):
        for level in (-2.0, -0.5, 0.9, 2.0):
            _, colours = self.shading(np.full((1, 60, 100), level), limit=1.0).at(0)
            light = self.shading(np.zeros((1, 60, 100)), limit=1.0).at(0)[1].astype(float)
            assert np.abs(colours - light).max() > 5
            index = int(np.clip(127.5 * level + 127.5, 0, 255))
            exchanged = self.shading(np.zeros((1, 60, 100)), limit=0.0)
            assert (exchanged.at(0)[1] == light).all()
            change = (colours - light).mean((0, 1))
            expected = COLOURS[index] - COLOURS[127]
            assert np.corrcoef(change, expected)[0, 1] > 0.99

    def test_crests_are_as_steep_as_the_wave(self):
        """(a k)² at the crests of a plane wave, 0 in its troughs."""
        x = (np.arange(400) + 0.5) / 2
        wave = (1.3 * np.cos(2 * np.pi * x / 25) * np.ones((240, 1))).astype(np.float32)
        crests = self.shading(wave[None])._crests(wave)
        assert crests[:, 10:-10].max() == pytest.approx((1.3 * 2 * math.pi / 25) ** 2, rel=0.01)
        assert (crests[:, 10:-10][wave[:, 10:-10] < 0] == 0).all()

    @pytest.mark.parametrize(("steepness", "foam"), [(0.25, False), (0.6, True)])
    def test_there_is_foam_on_steep_crests_alone(self, steepness, foam):
        k = 2 * math.pi / 25
        x = (np.arange(400) + 0.5) / 2
        wave = (steepness / k * np.cos(k * x) * np.ones((240, 1))).astype(np.float32)
        shading = self.shading(wave[None], limit=50.0)
        field = cv2.resize(wave, shading._shape)
        with_it, without = (
            shading._shade(field, cv2.resize(shading._crests(wave), shading._shape)),
            shading._shade(field, 0 * field),
        )
        white = (with_it.astype(int) - without).min(-1) > 60
        crest = field > 0.8 * field.max()
        assert white[crest].mean() > 0.2 if foam else white.mean() < 0.02
        assert not white[field < 0].any()

    def test_a_square_kilometre_is_lit_as_a_hundredth_of_it(self):
        small = self.shading(self.plane(0.1, 0.05))
        sides = (2000.0, 1200.0)
        large = self.shading(
            self.plane(0.1, 0.05, sides=sides), sides=sides, camera=Swing.around(sides, 50.0, -600.0, (640, 480)).middle
        )
        assert np.abs(small.at(0)[1].astype(int) - large.at(0)[1]).max() <= 2

    def test_a_tall_area_has_rows_for_its_length(self):
        sides = (50.0, 200.0)
        tall = SeaShading(
            np.zeros((0, 0, 0), np.float32), 0.0, sides, Swing.around(sides, 5.0, -60.0, (640, 480)).middle, 1.0
        )
        heights, colours = tall.at(0)
        assert heights.shape == colours.shape[:2] == (160, 40)
        assert not heights.any()
