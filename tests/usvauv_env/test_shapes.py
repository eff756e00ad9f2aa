"""Shapes, symbols and texts: areas, places below a pixel, symmetry, and what lies beyond the picture's edge."""

import math
from itertools import pairwise

import numpy as np
import pytest

from usvauv.env.render import shapes, style, symbols
from usvauv.env.render.camera import Camera
from usvauv.env.render.canvas import Canvas
from usvauv.env.render.shapes import Overlay
from usvauv.env.render.text import clock, shorten, text_width, write

WHITE, BLACK, INK = (255, 255, 255), (0, 0, 0), (40, 200, 120)
AT = np.array([70.3, 48.6])


def blank(height=100, width=140, ink=BLACK):
    return np.full((height, width, 3), ink, np.uint8)


def moments(picture):
    """Area of what is white on black, and its centroid (x, y)."""
    cover = picture[..., 0] / 255
    rows, columns = np.indices(cover.shape)
    return cover.sum(), np.array([(columns * cover).sum(), (rows * cover).sum()]) / cover.sum()


def extent(picture, ground=BLACK):
    """First and last column and row of what differs from the ground."""
    rows, columns = np.nonzero((picture != ground).any(-1))
    return columns.min(), columns.max(), rows.min(), rows.max()


def smoothly(shape, factor, reach=30.0):
    """A shape drawn magnified: `shape(image, centre, zoom)`."""
    return lambda image, centre: shapes.smooth(image, centre, reach, factor, shape)


class TestAreas:
    @pytest.mark.parametrize(
        ("draw", "area", "offset"),
        [
            (lambda image, at: shapes.disc(image, at, 20.0, WHITE), math.pi * 400, (0, 0)),
            (lambda image, at: shapes.ring(image, at, 20.0, WHITE, 3), 2 * math.pi * 20 * 3, (0, 0)),
            # A sector of half angle a has its centroid at (2 r sin a) / (3 a), an arc at r sin a / a.
            (lambda image, at: shapes.sector(image, at, 20.0, 0.5, WHITE), math.pi * 200, (8.49, 0)),
            (lambda image, at: shapes.sector(image, at, 20.0, 0.25, WHITE), math.pi * 100, (8.49, -8.49)),
            (lambda image, at: shapes.arc(image, at, 20.0, 0.5, WHITE, 3), math.pi * 60, (12.73, 0)),
            (lambda image, at: shapes.arc(image, at, 20.0, 0.75, WHITE, 3), math.pi * 90, (4.24, 4.24)),
            (lambda image, at: shapes.arc(image, at, 20.0, 1.3, WHITE, 3), math.pi * 120, (0, 0)),
            (smoothly(lambda fine, at, zoom: shapes.disc(fine, at, 20.0 * zoom, WHITE), 4), math.pi * 400, (0, 0)),
            (smoothly(lambda fine, at, zoom: shapes.disc(fine, at, 20.0 * zoom, WHITE), 3), math.pi * 400, (0, 0)),
            (
                lambda image, at: shapes.fill(image, at + np.array([(-9, -4), (9, -4), (9, 4), (-9, 4)]), WHITE),
                144,
                (0, 0),
            ),
        ],
    )
    def test_are_those_of_geometry_and_where_they_should_be(self, draw, area, offset):
        """OpenCV's shapes are up to a pixel larger all around, its lines up to 3 pixels wider."""
        picture = blank()
        draw(picture, AT)
        size, middle = moments(picture)
        assert 0.98 * area < size < (2 if area < 400 else 1.3) * area
        np.testing.assert_allclose(middle, AT + offset, atol=0.5)

    def test_a_magnified_shape_is_where_it_is_to_a_tenth_of_a_pixel(self):
        for factor in (2, 3, 4):
            for at in (AT, AT + 0.4, np.rint(AT)):
                picture = blank()
                shapes.smooth(
                    picture, at, 12.0, factor, lambda fine, middle, zoom: shapes.disc(fine, middle, 8.0 * zoom, WHITE)
                )
                np.testing.assert_allclose(moments(picture)[1], at, atol=0.06)

    def test_points_of_an_ellipse(self):
        axes = np.array([(6.0, 2.0), (-1.0, 3.0)])
        points = shapes.ellipse_points(AT, axes, 20)
        assert len(points) == 20
        np.testing.assert_allclose(points.mean(axis=0), AT)
        np.testing.assert_allclose(np.linalg.norm(np.linalg.solve(axes.T, (points - AT).T), axis=0), 1)
        np.testing.assert_allclose(points[[0, 5]], AT + axes)

    def test_dashes_are_as_long_as_their_gaps(self):
        start, end = np.array([3.0, 4.0]), np.array([3.0 + 17 * 0.6, 4.0 + 17 * 0.8])
        ends = (np.array(shapes.dashes(start, end, 5.0)) - start) @ (0.6, 0.8)
        np.testing.assert_allclose(ends, [(0, 5), (10, 15)])
        ends = (np.array(shapes.dashes(start, end, 8.0)) - start) @ (0.6, 0.8)
        np.testing.assert_allclose(ends, [(0, 8), (16, 17)])
        assert shapes.dashes(start, start, 5.0) == []


class TestOverlay:
    def test_blends_where_it_is_drawn_in_its_region_alone(self):
        ground = np.random.default_rng(0).integers(0, 256, (100, 140, 3)).astype(np.uint8)
        overlay = Overlay(50, 20, 60, 40)
        overlay.disc(np.array([80.0, 40.0]), 12.0, INK, 0.4)
        picture = ground.copy()
        overlay.blend(picture)
        np.testing.assert_allclose(picture[40, 75:86], 0.4 * np.array(INK) + 0.6 * ground[40, 75:86], atol=1.5)
        changed = extent(picture, ground)
        np.testing.assert_allclose(changed, (68, 92, 28, 52), atol=1)
        overlay.clear()
        before = picture.copy()
        overlay.blend(picture)
        np.testing.assert_array_equal(picture, before)

    @pytest.mark.parametrize("width", [1, 2, 5])
    def test_edges_of_a_shape_have_its_own_colour(self, width):
        """Black on black stays black: the white of the cleared layer is nowhere seen."""
        overlay, picture = Overlay(10, 10, 120, 80), blank()
        overlay.disc(AT, 15.3, BLACK, 0.7)
        overlay.ring(AT, 30.2, BLACK, 0.8, width)
        overlay.strokes([np.array([(15.2, 18.1), (120.4, 80.7)]), np.array([(20, 80.5), (99, 13)])], BLACK, 1.0, width)
        overlay.blend(picture)
        assert (picture > 25).sum() < 60
        overlay.blend(bright := blank(ink=WHITE))
        assert bright[79, 70].max() < 120

    @pytest.mark.parametrize("kind", ["white_lines", "strokes", "ring", "disc"])
    def test_covers_as_much_as_the_same_shape_drawn_at_once(self, kind):
        overlay, picture, plain = Overlay(20, 10, 100, 80), blank(), blank()
        line = np.array([(30.3, 40.0), (110.0, 47.6)])
        if kind == "white_lines":
            overlay.white_lines(line[None], 0.5, 5)
        elif kind == "strokes":
            overlay.strokes([line], WHITE, 0.5, 5)
        else:
            getattr(overlay, kind)(AT, 20.0, WHITE, 0.5, *[5] * (kind == "ring"))
        if kind in ("white_lines", "strokes"):
            shapes.stroke(plain, line, WHITE, 5)
        else:
            getattr(shapes, kind)(plain, AT, 20.0, WHITE, *[5] * (kind == "ring"))
        overlay.blend(picture)
        np.testing.assert_allclose(picture, 0.5 * plain, atol=4)


ANYWHERE = [(x, y) for x in (-7.3, -1.2, 4.6, 30.0, 55.7, 62.1) for y in (-6.8, 0.4, 3.3, 20.0, 37.6, 43.9)]
DRAWN = {
    "text": lambda image, at: write(image, "Tg1", tuple(at), 14, INK, anchor="centre"),
    "opacity": lambda image, at: write(image, "Tg1", tuple(at), 14, INK, anchor="right", opacity=0.4),
    "dots": lambda image, at: shapes.dots(image, at[None], 4.2, np.array([INK])),
    "gauge": lambda image, at: symbols.NodeGauges(7.0).draw(image, at, 0.6, 0.5),
    "halo": lambda image, at: symbols.NodeGauges(7.0).draw(image, at, 1.0, 0.5, 1.0),
    "auv": lambda image, at: symbols.auv(image, at, 0.7, 18.0, INK, 3),
    "station": lambda image, at: symbols.station(image, at, 6.0, INK, 4),
}


@pytest.mark.parametrize("name", DRAWN)
def test_what_is_beyond_the_edge_is_cut_off(name):
    """A picture of 40 × 60 shows what one with a margin of 50 pixels shows there."""
    for place in ANYWHERE:
        small, large = blank(40, 60, (90, 60, 30)), blank(140, 160, (90, 60, 30))
        DRAWN[name](small, np.array(place))
        DRAWN[name](large, np.array(place) + 50.0)
        difference = np.abs(small.astype(int) - large[50:90, 50:110])
        assert difference.max() <= 1 if name in ("text", "opacity", "dots") else (difference > 8).mean() < 0.004, place


class TestSymbols:
    @staticmethod
    def drawn(symbol, *arguments, at=(100.0, 100.0)):
        picture = blank(201, 201, (90, 60, 30))
        symbol(picture, np.array(at), *arguments)
        return picture

    @staticmethod
    def same(first, second):
        return (np.abs(first.astype(int) - second).max(-1) > 90).mean() < 0.0015

    @pytest.mark.parametrize(
        ("symbol", "arguments"), [(symbols.auv, (120.0, INK, 4)), (symbols.boat, (120.0, 4))], ids=["auv", "boat"]
    )
    def test_vehicles_turn_with_their_heading_and_have_two_equal_sides(self, symbol, arguments):
        north, east, tilted = (self.drawn(symbol, turn, *arguments) for turn in (math.pi / 2, 0.0, 0.6))
        assert self.same(np.rot90(east), north)
        assert self.same(east, east[::-1])
        assert self.same(np.rot90(tilted), self.drawn(symbol, 0.6 + math.pi / 2, *arguments))
        assert self.same(tilted[::-1], self.drawn(symbol, -0.6, *arguments))
        assert not self.same(east, east[:, ::-1])
        left, right, top, bottom = extent(east, (90, 60, 30))
        assert 100 - left == pytest.approx(right - 100, abs=2)
        assert 120 < right - left < 140  # the length and its dark edge
        assert bottom - top < 90
        ground = (east == (90, 60, 30)).all(-1)
        dark = (np.abs(east.astype(int) - style.OUTLINE) < 6).all(-1)
        around = ~ground & (np.roll(ground, 1, 0) | np.roll(ground, -1, 0) | np.roll(ground, 1, 1))
        assert east[around].mean() < 60
        assert dark.any()

    @pytest.mark.parametrize(
        ("symbol", "arguments", "reach"),
        [
            (symbols.fix, (40.0, INK, 4.0, 4), 40),
            (symbols.foreseen, (40.0, INK, 4.0, 4), 40),
            (symbols.plus, (40.0, INK, 4), 40),
            (symbols.cross, (40.0, INK, 4), 40),
            (symbols.station, (40.0, INK, 4), 40),
            (symbols.progress_ring, (40.0, 1.0, INK, 6.0, 4), 40),
            (symbols.progress_ring, (40.0, 0.0, INK, 6.0, 4), 40),
        ],
    )
    def test_marks_are_as_large_as_asked_and_look_alike_from_four_sides(self, symbol, arguments, reach):
        picture = self.drawn(symbol, *arguments)
        assert self.same(picture, np.rot90(picture))
        assert self.same(picture, picture[::-1])
        size = np.array(extent(picture, (90, 60, 30))) - 100
        assert (np.abs(np.abs(size) - reach) < 0.2 * reach).all()
        assert (size * (-1, 1, -1, 1) > 0).all()

    @pytest.mark.parametrize("symbol", [symbols.fix, symbols.foreseen])
    def test_diamond_and_square_are_hollow_with_a_dark_edge_on_both_sides(self, symbol):
        picture = self.drawn(symbol, 40.0, INK, 4.0, 4)
        line = picture[100, 130:160].astype(int)
        lit = np.flatnonzero(np.abs(line - INK).max(-1) < 30)
        dark = np.flatnonzero(np.abs(line - style.OUTLINE).max(-1) < 30)
        assert tuple(picture[100, 100]) == (90, 60, 30)
        assert dark.min() < lit.min()
        assert dark.max() > lit.max()
        assert lit.mean() == pytest.approx(10, abs=1.5)

    def test_a_cross_is_diagonal_and_a_plus_upright(self):
        for symbol, on, off in ((symbols.cross, (125, 125), (100, 125)), (symbols.plus, (100, 125), (125, 125))):
            picture = self.drawn(symbol, 40.0, INK, 5)
            assert tuple(picture[on]) == INK
            assert tuple(picture[off]) == (90, 60, 30)
        picture = self.drawn(symbols.cross, 40.0, INK, 5)
        assert (picture[100, :].astype(int).sum(-1) < 60).any()  # its dark edge

    def test_a_station_is_a_disc_in_a_ring_on_dark_ground(self):
        picture = self.drawn(symbols.station, 40.0, INK, 4)
        ray = [style.OUTLINE if np.abs(p.astype(int) - style.OUTLINE).max() < 20 else tuple(p) for p in picture[100]]
        found = [colour for i, colour in enumerate(ray) if colour in (INK, style.OUTLINE) and colour != ray[i - 1]]
        assert found == [style.OUTLINE, INK, style.OUTLINE, INK, style.OUTLINE, INK, style.OUTLINE]
        inside = (picture != (90, 60, 30)).any(-1)
        left, right, *_ = extent(picture, (90, 60, 30))
        assert inside.sum() == pytest.approx(math.pi / 4 * (right - left + 1) ** 2, rel=0.03)

    @pytest.mark.parametrize("share", [0.0, 0.25, 0.6, 1.0])
    def test_a_ring_shows_progress_clockwise_from_the_top(self, share):
        picture = self.drawn(symbols.progress_ring, 60.0, share, INK, 8.0, 4)
        for turn in np.linspace(0.02, 0.98, 25):
            x, y = np.rint(100 + 60 * np.array([math.sin(2 * np.pi * turn), -math.cos(2 * np.pi * turn)])).astype(int)
            lit = np.abs(picture[y, x].astype(int) - INK).max() < 40
            assert lit == (turn < share) or abs(turn - share) < 0.03
            assert tuple(picture[y, x]) != (90, 60, 30)
        thick = (np.abs(self.drawn(symbols.progress_ring, 60.0, 1.0, INK, 8.0, 4)[:, 100].astype(int) - INK) < 40).all(
            -1
        )
        assert thick.sum() == pytest.approx(16, abs=3)
        thin = (self.drawn(symbols.progress_ring, 60.0, 0.0, INK, 8.0, 4)[:, 100] != (90, 60, 30)).any(-1)
        assert 0 < thin.sum() < 12

    @pytest.mark.parametrize("text", ["1", "16"])
    def test_a_badge_holds_its_number_in_the_middle(self, text):
        picture = self.drawn(lambda image, at: symbols.badge(image, text, at, 40.0, WHITE))
        lit = extent(np.where(picture > 150, picture, 0), BLACK)
        pill = extent(picture, (90, 60, 30))
        margins = [abs(a - b) for a, b in zip(lit, pill, strict=True)]
        assert min(margins) >= 3
        assert margins[0] == pytest.approx(margins[1], abs=5)  # a 1 is not symmetric
        assert margins[2] == pytest.approx(margins[3], abs=8)
        assert (pill[0] + pill[1]) / 2 == pytest.approx(100, abs=1)
        assert (pill[2] + pill[3]) / 2 == pytest.approx(100, abs=1)
        assert pill[1] - pill[0] >= pill[3] - pill[2] - 1  # never narrower than high

    def gauge(self, share, age=0.0, pulse=0.0, radius=24.0):
        gauges = symbols.NodeGauges(radius)
        return self.drawn(lambda image, at: gauges.draw(image, at, share, age, pulse))

    @pytest.mark.parametrize("share", [0.0, 0.125, 0.375, 0.5, 0.75, 0.97])
    def test_a_pie_fills_clockwise_from_the_top_in_the_colour_of_its_share(self, share):
        picture, tint = self.gauge(share), np.array(style.gauge_colour(round(48 * share) / 48))
        for turn in np.linspace(0.04, 0.96, 24):
            x, y = np.rint(100 + 11 * np.array([math.sin(2 * np.pi * turn), -math.cos(2 * np.pi * turn)])).astype(int)
            lit = np.abs(picture[y, x] - 0.96 * tint).max() < 20
            assert lit == (turn < share) or abs(turn - share) < 0.05

    def test_a_gauge_is_a_pie_a_gap_a_ring_and_a_dark_rim_none_of_them_cut(self):
        """Along a ray to the right, of a node that is filled but for a little."""
        picture = self.gauge(0.97, age=1.0).astype(int)
        ray, tint = picture[101, 100:140], np.array(style.gauge_colour(0.97))
        kinds = {"tint": 0.96 * tint, "ring": 0.96 * 255 * np.ones(3), "dark": np.array(style.OUTLINE)}
        named = [
            min(kinds, key=lambda kind: np.abs(kinds[kind] - each).max())
            for each in ray
            if (each != (90, 60, 30)).any()
        ]
        order = [name for i, name in enumerate(named) if i == 0 or named[i - 1] != name]
        assert order[:4] == ["tint", "dark", "ring", "dark"]
        for full in (False, True):
            shown = (self.gauge(1.0 if full else 0.5, pulse=1.0) != (90, 60, 30)).any(-1)
            away = np.hypot(*(np.argwhere(shown) - 100).T)
            reach = [np.flatnonzero(shown.any(axis))[[0, -1]] for axis in (0, 1)]
            assert away.max() < np.abs(np.array(reach) - 100).min() + 1  # round, not cut

    def test_a_halo_is_of_full_nodes_and_swells(self):
        sizes = [
            np.ptp(extent(self.gauge(share, pulse=pulse), (90, 60, 30))[:2])
            for share, pulse in ((0.98, 1.0), (1.0, 0.0), (1.0, 0.5), (1.0, 1.0))
        ]
        assert (np.diff(sizes) > 1).all()
        full = self.gauge(1.0, pulse=1.0)
        red = np.abs(full[100, 100:].astype(int) - style.FULL).max(-1) < 10
        assert red[:15].all()
        assert red[26:].any()

    def test_a_ring_brightens_with_age_and_stays_within_its_range(self):
        light = [self.gauge(0.1, age)[100, 122].astype(int).sum() for age in (-1.0, 0.0, 0.3, 0.6, 1.0, 2.0)]
        assert light[0] == light[1] < light[2] < light[3] < light[4] == light[5]

    def test_a_small_gauge_is_a_disc_of_its_colour(self):
        assert np.abs(self.gauge(0.5, radius=4.0)[99:102, 99:102] - 0.96 * np.array(style.GAUGE[1])).max() < 12
        assert (self.gauge(1.5, radius=4.0)[100, 100] == self.gauge(1.0, radius=4.0)[100, 100]).all()


class TestTexts:
    def test_letters_stand_on_the_baseline(self):
        for letters, lowest in (("HxE", 60), ("gpq", 64)):
            picture = blank()
            write(picture, letters, (40, 60), 20, WHITE)
            assert extent(np.where(picture > 127, picture, 0))[3] == pytest.approx(lowest - 0.5, abs=1.5)

    def test_opacity_is_a_share_of_the_colour(self):
        pictures = []
        for opacity in (1.0, 0.5):
            write(picture := blank(), "HHH", (40, 60), 30, (200, 100, 50), bold=True, opacity=opacity)
            pictures.append(picture.astype(float))
        assert tuple(pictures[0].max((0, 1))) == (200, 100, 50)
        np.testing.assert_allclose(pictures[1], 0.5 * pictures[0], atol=1.6)

    def test_a_colour_covers_any_ground(self):
        write(picture := blank(ink=(90, 60, 30)), "H", (40, 60), 40, INK, bold=True)
        assert (picture == INK).all(-1).sum() > 100
        write(nothing := blank(), "", (40, 60), 40, INK)
        assert not nothing.any()

    def test_as_many_letters_as_fit_are_kept(self):
        text = "several clear words"
        for bold in (False, True):
            for width in range(0, text_width(text, 14, bold), 7):
                short = shorten(text, 14, width, bold)
                assert short[-1] == "…"
                assert text.startswith(short[:-1])
                assert text_width(short, 14, bold) <= width or short == "…"
                assert text_width(text[: len(short)] + "…", 14, bold) > width
        assert shorten("", 14, 0) == ""
        assert text_width("", 14) == 0

    @pytest.mark.parametrize(
        ("seconds", "words"),
        [
            (0, "0:00"),
            (59.9, "0:59"),
            (60, "1:00"),
            (754, "12:34"),
            (3599, "59:59"),
            (3600, "1:00:00"),
            (40265, "11:11:05"),
        ],
    )
    def test_times_are_in_minutes_or_hours(self, seconds, words):
        assert clock(seconds) == words


class TestColours:
    def test_a_gauge_goes_from_green_over_amber_to_red(self):
        green, amber, red = (np.array(colour, float) for colour in style.GAUGE)
        for fill, expected in (
            (-1, green),
            (0, green),
            (0.125, 0.75 * green + 0.25 * amber),
            (0.5, amber),
            (0.75, 0.5 * amber + 0.5 * red),
            (1, red),
            (2, red),
        ):
            np.testing.assert_allclose(style.gauge_colour(fill), expected, atol=0.5)

    @pytest.mark.parametrize("theme", style.THEMES.values(), ids=style.THEMES)
    def test_sixteen_vehicles_have_colours_of_their_own(self, theme):
        for colours in ([theme.auv(k) for k in range(17)], [style.auv_colour(k) for k in range(17)]):
            assert len(set(colours)) == 17
        assert [max(theme.auv(k)) for k in range(8, 17)] == [round(255 * theme.brightness)] * 9
        assert [max(style.auv_colour(k)) for k in range(8, 17)] == [255] * 9
        assert theme.auv(7) == theme.vehicles[7]


class TestCanvas:
    CAMERA = Camera(heading=2.1, distance=500.0, height=260.0, focal=900.0, centre=(310.0, -40.0))

    @pytest.fixture
    def strokes(self, monkeypatch):
        made = []
        monkeypatch.setattr(
            shapes, "stroke", lambda image, points, ink, width=1, closed=False: made.append((points, ink, width))
        )
        return made

    def test_a_level_circle_begins_in_the_north_and_goes_clockwise(self, strokes):
        centre = np.array([30.0, -20.0, -50.0])
        Canvas(blank(), self.CAMERA).circle(centre, 40.0, INK, 3, 0.25)
        ((points, ink, width),) = strokes
        turn = np.linspace(0, math.pi / 2, len(points))
        expected = centre + 40 * np.stack([np.sin(turn), np.cos(turn), 0 * turn], 1)
        np.testing.assert_allclose(points, self.CAMERA.pixel(expected))
        assert (ink, width) == (INK, 3)
        assert len(points) > 5

    @pytest.mark.parametrize("count", [2, 3, 11, 60])
    def test_a_trail_goes_through_all_its_points_and_fades_towards_the_oldest(self, strokes, count):
        points = np.random.default_rng(1).uniform(-90, 90, (count, 3))
        Canvas(blank(), self.CAMERA).trail(points, WHITE, BLACK, 2)
        pixels = self.CAMERA.pixel(points)
        np.testing.assert_array_equal(
            [leg for piece, *_ in strokes for leg in pairwise(piece.tolist())], [*pairwise(pixels.tolist())]
        )
        shades = [ink[0] for _, ink, _ in strokes]
        assert shades == sorted(set(shades))
        assert shades[-1] == 255
        assert {width for *_, width in strokes} == {2}
        assert len(strokes) <= 6
        if count > 11:
            np.testing.assert_allclose(np.diff([0, *shades]), 255 / len(shades), atol=1)

    def test_no_pieces_are_no_lines(self):
        picture = blank()
        Canvas(picture, self.CAMERA).pieces(np.zeros((0, 2, 2)), WHITE)
        assert not picture.any()
        Canvas(picture, self.CAMERA).pieces(np.array([[(20, 30), (80, 30)], [(20, 50), (80, 50)]]), WHITE, 3)
        assert [picture[row, 50, 0] for row in (30, 40, 50)] == [255, 0, 255]
        assert not picture[35:45, 20].any()  # the pieces are not joined
