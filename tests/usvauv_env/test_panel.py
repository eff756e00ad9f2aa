"""What stands beside the map: a section of the water, the reward's terms, axes, legends; labels that keep apart."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.usvauv_env.made_traces import synthetic_trace
from usvauv.env.render import shapes, style, symbols
from usvauv.env.render.depth_section import DepthSection
from usvauv.env.render.frame_layout import Layout, Rectangle
from usvauv.env.render.legend import ENTRIES, STATION_ENTRIES, draw_legend
from usvauv.env.render.panel_elements import Bars
from usvauv.env.render.plots import Plot
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.env.scenario.sea import Area

LAYOUT = Layout.fit(1280, 720, Area())
BOX = Rectangle(100, 100, 500, 200)


def white(height=720, width=1280):
    return np.full((height, width, 3), 255, np.uint8)


class TestSection:
    def picture(self, trace, t=0):
        picture = white()
        section = DepthSection(picture, trace, BOX, LAYOUT)
        section.draw(picture, t)
        return picture, section

    def test_the_boat_is_where_its_sea_is(self):
        trace = synthetic_trace(steps=3)
        low, high = (
            replace(trace, boat_surface=np.broadcast_to(np.array([z, 0, 0.0]), trace.boat_surface.shape))
            for z in (-3.0, 3.0)
        )
        rows = []
        for which in (low, high):
            _, section = self.picture(which)
            outline = section._boat_outlines(0)[0]
            assert outline[:, 0].mean() == pytest.approx(section._column(trace.boat_position[0, 0, 0, 0]), abs=1)
            rows.append(outline[:, 1].mean())
        assert rows[0] > rows[1] + 10  # rows run down

    @pytest.mark.parametrize("extreme", [-9.0, 9.0])
    def test_the_whole_sea_has_its_room_above_the_depths(self, extreme):
        trace = synthetic_trace(steps=3)
        surface = trace.surface.copy()
        surface[1, 5, 7] = extreme
        _, section = self.picture(replace(trace, surface=surface))
        assert section._row(-0.0) - section._row(9.0) == pytest.approx(section._row(-9.0) - section._row(0.0))
        assert section._row(extreme) == pytest.approx(section._rows[int(extreme < 0)], abs=1)

    def test_the_hull_lies_along_the_drawn_slope(self):
        trace = synthetic_trace(steps=3)
        for slope in (-0.1, 0.0, 0.1):
            tilted = replace(trace, boat_surface=np.broadcast_to(np.array([0, slope, 0.0]), trace.boat_surface.shape))
            _, section = self.picture(tilted)
            port, starboard = section._boat_outlines(0)[0][:2]
            metre = section._row(0.0) - section._row(1.0), section._column(1.0) - section._column(0.0)
            drawn = (port[1] - starboard[1]) / (starboard[0] - port[0])
            assert drawn == pytest.approx(slope * metre[0] / metre[1], abs=1e-6)

    def test_auvs_are_below_the_boat_at_their_place(self):
        trace = synthetic_trace(steps=3)
        picture, section = self.picture(trace)
        for auv in range(2):
            column = round(float(section._column(trace.auv_position[0, 0, auv, 0])))
            row = round(float(section._row(-trace.scenario.auv.depth)))
            assert (picture[row, column] == style.DARK.auv(auv)).all()

    def test_who_is_heard_has_a_line_to_the_boat(self):
        trace = synthetic_trace(steps=3)
        heard, _ = self.picture(trace)
        silent, _ = self.picture(replace(trace, fix_flags=np.zeros_like(trace.fix_flags)))
        assert (heard != silent).any(-1).sum() > 50


def test_bars_point_where_the_reward_goes():
    picture = white()
    bars = Bars(picture, BOX, LAYOUT, ("reward", "now"), ["gain", "cost"], 2.0)
    bars.draw(picture, [1.0, -2.0])
    for place, colour, share in ((0, style.GAUGE[0], 0.25), (1, style.GAUGE[2], -0.5)):
        columns = np.flatnonzero((BOX.of(picture) == colour).all(-1).any(0)) + BOX.left
        middle = bars._left[place] + bars._room / 2
        assert np.median(columns) == pytest.approx(middle + share / 2 * bars._room, abs=3)


def test_reward_of_the_panel_is_the_mean_of_the_last_half_minute():
    trace = synthetic_trace(steps=50)
    trace = replace(trace, reward_terms=np.random.default_rng(0).normal(size=(50, 1, 2, 1)))
    reward = RunningMetrics.of(trace).reward
    for t in (0, 3, 29, 30, 49):
        expected = trace.reward_terms[max(0, t - 29) : t + 1, 0, :, 0].sum(1).mean()
        assert reward[t, 0] == pytest.approx(expected)


@pytest.mark.parametrize("height", [70, 200])
@pytest.mark.parametrize("low", [0.0101, 0.59])
@pytest.mark.parametrize("ratio", [1.4, 2.5, 20, 100, 1000, 1e6])
def test_a_logarithmic_axis_has_several_ticks_whose_numbers_keep_apart(ratio, low, height):
    plot = Plot(white(), BOX._replace(height=height), low, low * ratio, 10.0, LAYOUT, log=True)
    ticks = plot._value_ticks()
    assert len(ticks) >= (3 if height > 100 else 2)
    assert all(low <= tick <= low * ratio for tick in ticks)
    assert all(above - below > 9 for below, above in pairwise(-plot.y(np.array(ticks))))


def test_dots_are_discs_of_their_radius_and_place():
    centre, radius = np.array([50.3, 40.8]), 3.0
    picture = white(100, 100)
    shapes.dots(picture, centre[None], radius, np.zeros((1, 3)))
    cover = 1 - picture[..., 0] / 255
    assert cover.sum() == pytest.approx(np.pi * radius**2, rel=0.03)
    rows, columns = np.indices(cover.shape)
    middle = np.array([(columns * cover).sum(), (rows * cover).sum()]) / cover.sum()
    np.testing.assert_allclose(middle, centre, atol=0.05)
    before = picture.copy()
    shapes.dots(picture, np.array([[-9.0, 5.0], [500.0, 5.0]]), 2.0, np.zeros((2, 3)))  # outside
    np.testing.assert_array_equal(picture, before)


def test_small_frames_have_a_legend():
    assert Layout.fit(640, 360, Area()).legend is not None


def test_legend_of_stations_has_no_data():
    words = " ".join(words for _, words in STATION_ENTRIES)
    assert "data" not in words
    assert "data" in " ".join(words for _, words in ENTRIES)
    assert all(symbol.__name__ not in ("_node", "_full", "_age") for symbol, _ in STATION_ENTRIES)


def test_labels_of_services_keep_apart(monkeypatch):
    from usvauv.env.render import popups
    from usvauv.env.render.painter import Painter

    trace = synthetic_trace(steps=2, auvs=6)
    shape = trace.delivered.shape
    trace = replace(trace, delivered=np.ones(shape), target=np.zeros(shape, np.int16))  # all at one node
    written = []
    monkeypatch.setattr(popups, "write", lambda *a, **k: written.append((a[1], a[2])))
    Painter(trace, (1280, 720)).map.draw(white(), 1)
    rows = sorted({round(place[1]) for text, place in written if "Mbit" in text})[::2]  # each has a shadow
    assert len(rows) == 6
    assert min(np.diff(rows)) >= 13


@pytest.mark.parametrize("theme", style.THEMES.values(), ids=style.THEMES)
def test_symbols_of_the_legend_have_the_colours_of_the_map(theme):
    layout = Layout.fit(1280, 720, Area(), theme=theme)
    picture = np.zeros((720, 1280, 3), np.uint8)
    draw_legend(picture, layout.legend, layout, "data-collection", foresees=False)
    for colour in (style.auv_colour(0), style.BOAT, style.SEA[1]):
        assert (picture == colour).all(-1).sum() > 20


@pytest.mark.parametrize("heading", [0.0, 0.7, math.pi / 2, -2.0])
def test_an_auv_points_along_its_heading(heading):
    """On its axis: nose, dark band, body and tail; ahead of the nose and behind the tail nothing."""
    picture, colour, length = white(300, 300), (0, 200, 255), 200.0
    symbols.auv(picture, np.array([150.0, 150.0]), heading, length, colour, 1)
    ahead, aside = np.array([math.cos(heading), -math.sin(heading)]), np.array([math.sin(heading), math.cos(heading)])

    def at(along, across=0.0):
        x, y = np.rint(150 + length * (along * ahead + across * aside)).astype(int)
        return tuple(picture[y, x])

    for along in (0.45, 0.4, 0.34, 0.15, 0.0, -0.2, -0.45):
        assert at(along) == colour
        assert along < -0.3 or at(along, 0.06) == at(along, -0.06) == colour
    assert at(0.26) == style.OUTLINE
    assert at(0.62) == at(-0.65) == at(0.3, 0.3) == at(0.3, -0.3) == (255, 255, 255)
