"""Frames as pages: words apart and within their cards, titles, tiles and layouts."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tests.usvauv_env.made_traces import synthetic_trace
from usvauv.env.render import glass_box, panel_elements, style
from usvauv.env.render import text as texts
from usvauv.env.render.canvas import Canvas
from usvauv.env.render.frame_layout import Layout, MapView, Rectangle, design_unit, nice, nice_above
from usvauv.env.render.legend import ENTRIES, STATION_ENTRIES
from usvauv.env.render.painter import Look, painter_of
from usvauv.env.render.running_metrics import RunningMetrics, figures
from usvauv.env.scenario import Scenario
from usvauv.env.scenario.sea import Area

LAYOUT = Layout.fit(1280, 720, Area())


def overlap(first, second):
    return min(first[2], second[2]) - max(first[0], second[0]) > 0 and min(first[3], second[3]) > max(
        first[1], second[1]
    )


def stations(trace):
    scenario = Scenario.load("station-keeping", [f"auv.count={trace.auv_position.shape[2]}"])
    return replace(trace, scenario=scenario, target=np.zeros_like(trace.target))


class TestWords:
    @pytest.mark.parametrize(
        ("size", "view", "traces", "change"),
        [
            ((1280, 720), "map", 1, lambda trace: trace),
            ((720, 1280), "map", 1, stations),
            ((1280, 720), "both", 1, lambda trace: trace),
            ((720, 1280), "sea", 1, stations),
            ((1920, 1080), "map", 2, lambda trace: trace),
        ],
        ids=["map", "stations", "both", "sea", "compared"],
    )
    def test_stand_apart_within_the_picture_and_within_a_card_or_beside_all(self, page, size, view, traces, change):
        trace = change(synthetic_trace(steps=3, auvs=3, area=(300.0, 200.0), nodes=9))
        painter_of([trace] * traces, size, Look(view), 10.0).frame(1)
        for words in page.words:
            height, width = words.shape
            assert (words.place > (-0.5, -1.5, -0.5, -1.5)).all(), words
            assert (words.place < (width + 0.5, height + 0.5, width + 0.5, height + 0.5)).all(), words
            if words.shape == size[::-1]:
                beside = [not overlap(words.place, (c.left, c.top, c.right, c.bottom)) for c in page.cards]
                holds = [
                    c.left < words.place[0]
                    and words.place[2] < c.right
                    and c.top < words.place[1]
                    and words.place[3] < c.bottom
                    for c in page.cards
                ]
                assert any(holds) or all(beside), words
        for first, second in combinations(page.words, 2):
            assert first.shape != second.shape or not overlap(first.place, second.place), (first, second)
        for first, second in combinations(page.cards, 2):
            sides = [(c.left, c.top, c.right, c.bottom) for c in (first, second)]
            assert not overlap(*sides) or (first.width < 50) != (second.width < 50)  # the legend's stripes

    @pytest.mark.parametrize(("view", "traces"), [("map", 1), ("both", 1), ("sea", 1), ("map", 2)])
    @pytest.mark.parametrize("size", [(1280, 720), (720, 1280)])
    def test_at_three_times_the_size_words_and_lines_are_at_three_times_the_place(
        self, page, monkeypatch, view, traces, size
    ):
        """Letters, which are fitted to whole pixels, are blocks here."""

        def block(text, size, _):
            return np.full((round(size), round(0.6 * size * len(text)), 1), 255, np.uint16), round(size)

        monkeypatch.setattr(texts, "_mask", block)
        trace, made = synthetic_trace(steps=3, auvs=2, area=(300.0, 200.0)), []
        for factor in (1, 3):
            painter_of([trace] * traces, (factor * size[0], factor * size[1]), Look(view), 1.0).frame(1)
            words = [(each.text, np.array([*each.position, each.size]) / factor) for each in page.words]
            pages = {each.shape for each in page.words}  # others are drawn magnified
            strokes = zip(page.strokes, page.grounds, strict=True)
            made.append((words, [points / factor for (points, *_), ground in strokes if ground in pages]))
            for each in (page.words, page.strokes, page.grounds):
                each.clear()
        (words, lines), (larger, longer) = made
        assert [text for text, _ in words] == [text for text, _ in larger]
        for (text, place), (_, other) in zip(words, larger, strict=True):
            np.testing.assert_allclose(place, other, atol=2.5, err_msg=text)
        assert len(lines) == len(longer)
        for line, other in zip(lines, longer, strict=True):
            np.testing.assert_allclose(line, other, atol=2.5)

    @pytest.mark.parametrize("task", ["data-collection", "station-keeping"])
    def test_all_that_there_is_to_say_about_a_mission_is_said(self, page, task):
        trace = synthetic_trace(steps=70, auvs=3, area=(300.0, 200.0))
        trace = trace if task == "data-collection" else stations(trace)
        frames = painter_of([trace], (1280, 720), Look(), 7.5)
        picture = frames.frame(63)
        said = [words.text for words in page.words]
        plot = frames.panel._error_plot
        column = picture[plot.box.top : plot.box.bottom, round(float(plot.x(64.0)))]
        assert (column == style.DARK.muted).all()
        values = [f"{value:{form}}" for _, value, form in figures(trace, RunningMetrics.of(trace), 63)]
        assert any(said[i : i + len(values)] == values for i in range(len(said)))
        depth = trace.scenario.auv.depth
        expected = [
            f"Scenario “{trace.scenario.name}”",
            f"policy {trace.policy} · boat {trace.usv} · seed {trace.seed}",
            "of 1:10 · 7.5 × speed",
            "1:04",
            "metres east →",
            f"seen from above, AUVs {depth:g} m below the boat",
            "sea surface  −5",
            "+5 m",
            "reward a step,",
            "last 30 s",
            "Section from the south: boat, AUVs, nodes",
            *{"data-collection": ["SDR, Mbit/s", "full nodes"], "station-keeping": ["off station, m", "EC, W"]}[task],
            *(words for _, words in (ENTRIES if task == "data-collection" else STATION_ENTRIES)),
        ]
        for text in expected:
            assert said.count(text) == 1, text
        for begin in ("AUV 1: ", "AUV 2: ", "AUV 3: ", "heave ", "inner ring "):
            assert sum(text.startswith(begin) for text in said) == 1, begin
        assert sum("EC: an AUV's energy per second of travel" in text for text in said) == 1
        assert sum("SDR: data rates" in text for text in said) == (task == "data-collection")
        assert sum(text.startswith("Fixes around the true position, ") for text in said) == 1
        assert sum(text.startswith("Position error of the ") for text in said) == 1

    @pytest.mark.parametrize("view", ["sea", "both"])
    def test_the_perspective_has_lengths_a_compass_and_edges(self, page, monkeypatch, view):
        inks = []
        monkeypatch.setattr(Canvas, "line", lambda _, points, ink, width=1: inks.append(ink))
        monkeypatch.setattr(Canvas, "pieces", lambda _, points, ink, width=1: inks.append(ink))
        trace = synthetic_trace(steps=40, area=(300.0, 200.0))
        painter_of([trace], (1280, 720), Look(view), 7.5).frame(30)
        said = [words.text for words in page.words]
        values = [f"{value:{form}}" for _, value, form in figures(trace, RunningMetrics.of(trace), 30)]
        names = [name for name, *_ in figures(trace, RunningMetrics.of(trace), 0)]
        title = [
            f"Scenario “{trace.scenario.name}”",
            "policy straight:1.6 · boat centroid · seed 0",
            "of 0:40 · 7.5 × speed",
        ]
        for text in (
            *title,
            *names,
            "0:31",
            "N",
            "0",
            "100",
            "300 m",
            "200 m",
            "0 m",
            "−50 m",
            "true to scale, vehicles enlarged",
        ):
            assert text in said, text
        assert any(said[i : i + len(values)] == values for i in range(len(said)))
        assert {glass_box.GRID, glass_box.GLASS, glass_box.HORIZON, glass_box.SHORE} <= {*inks}

    @pytest.mark.parametrize("size", [(1280, 720), (720, 1280)])
    def test_title_sea_and_tiles_share_the_frame_of_a_sea(self, page, size):
        frames = painter_of([synthetic_trace(steps=2)], size, Look("sea"), 1.0)
        title, room, tiles = frames._title, frames._layout.map, frames._tiles
        assert {(box.left, size[0] - box.right) for box in (title, room, tiles)} == {(title.left, title.left)}
        assert size[1] - tiles.bottom == title.left > 0
        assert 0 < title.top == room.top - title.bottom == tiles.top - room.bottom <= title.left
        assert room.height > 0.7 * size[1]
        assert page.cards == [tiles]
        progress = frames.frame(0)[title.bottom - 2 : title.bottom + 1, title.left : title.right]
        assert (progress == style.DARK.muted).all(-1).mean() == pytest.approx(0.5, abs=0.01)

    def test_titles_and_tiles_have_equal_margins_at_both_sides(self, page):
        box = Rectangle(40, 30, 500, 56)
        picture = np.zeros((720, 1280, 3), np.uint8)
        panel_elements.write_title(picture, box, LAYOUT, "A name", "a run", 754.0, 3.0)
        panel_elements.draw_clock(picture, box, LAYOUT, 100.0, 0.3)
        name, run, pace, now = page.words
        assert (name.text, run.text, pace.text, now.text) == ("A name", "a run", "of 12:34 · 3 × speed", "1:40")
        assert name.position[0] - box.left == run.position[0] - box.left == box.right - pace.position[0]
        assert box.right - now.position[0] == box.right - pace.position[0]
        assert name.position[1] == now.position[1] < run.position[1] == pace.position[1]
        shown = picture[box.bottom - 2 : box.bottom + 1, box.left : box.right]
        assert (shown[:, : round(0.3 * 500)] == style.DARK.muted).all()
        assert (shown[:, round(0.3 * 500) :] == style.DARK.line).all()
        assert not picture[: box.bottom - 2].any()
        page.words.clear()
        panel_elements.write_heading(picture, LAYOUT, box, "A heading", "a note")
        heading, note = page.words
        assert heading.position[0] - box.left == box.right - note.position[0] > 0
        assert heading.position[1] == note.position[1]
        page.words.clear()
        panel_elements.write_heading(picture, LAYOUT, box._replace(width=100), "A heading", "a note")
        assert [words.text for words in page.words] == ["A heading"]

    @pytest.mark.parametrize("unit", [1, 3])
    def test_long_names_leave_room_for_the_clock_and_the_pace(self, page, unit):
        layout = Layout.fit(1280 * unit, 720 * unit, Area())
        box = Rectangle(40 * unit, 30 * unit, 500 * unit, 56 * unit)
        picture = np.zeros((720 * unit, 1280 * unit, 3), np.uint8)
        panel_elements.write_title(picture, box, layout, "name " * 30, "run " * 60, 4000.0, 3.0)
        panel_elements.draw_clock(picture, box, layout, 3900.0, 0.3)
        name, run, pace, now = page.words
        for left, right in ((name, now), (run, pace)):
            assert 4 * unit < right.place[0] - left.place[2] < 40 * unit
            assert left.text.endswith("…")
        panel_elements.write_heading(picture, layout, box, "heading " * 30, "a note")
        assert page.words[-1].text.endswith("…")
        assert box.left < page.words[-1].place[0] < page.words[-1].place[2] < box.right
        page.words.clear()
        size = texts.text_width("a heading", 12 * unit, bold=True) + texts.text_width("a note", 11 * unit)
        for spare, count in ((20, 1), (60, 2)):
            page.words.clear()
            panel_elements.write_heading(
                picture, layout, box._replace(width=size + spare * unit), "a heading", "a note"
            )
            assert len(page.words) == count

    @pytest.mark.parametrize("width", [900, 300])
    @pytest.mark.parametrize("unit", [1, 3])
    def test_tiles_have_names_of_one_size_above_values_that_fit(self, page, width, unit):
        box, names, values = Rectangle(40, 30, width * unit, 54 * unit), ["one", "a longer name"], ["1", "a long value"]
        layout = Layout.fit(1280 * unit, 720 * unit, Area())
        picture = np.zeros((720 * unit, 1280 * unit, 3), np.uint8)
        panel_elements.name_tiles(picture, box, layout, names)
        panel_elements.fill_tiles(picture, box, layout, values)
        named, filled = page.words[:2], page.words[2:]
        assert [words.text for words in page.words] == names + values
        assert named[0].size == named[1].size
        for place, (name, value) in enumerate(zip(named, filled, strict=True)):
            left = box.left + place * unit * width / 2
            assert name.position[0] - left == value.position[0] - left == named[0].position[0] - box.left > 0
            assert value.position[1] > name.position[1]
            assert all(words.place[2] < left + unit * width / 2 for words in (name, value))
        assert (filled[0].size > filled[1].size) == (width == 300)
        assert filled[0].size > named[0].size

    def test_text_that_is_too_wide_is_reduced_to_the_room(self):
        for room in (30.0, 60.0, 200.0):
            size = panel_elements._fitting("some words", 20.0, room)
            assert texts.text_width("some words", size) <= max(room, 1) * 1.15
            full = texts.text_width("some words", 20.0)
            assert size == pytest.approx(20 * min(1, room / full))
        assert panel_elements._fitting("some words", 20.0, texts.text_width("some words", 20.0)) == 20.0

    def test_margins_are_taken_off(self):
        box = Rectangle(10, 20, 100, 60)
        assert panel_elements.within_margins(box, 2.0, top=5, sides=3, bottom=4) == (16, 30, 88, 42)
        assert panel_elements.within_margins(box, 1.0, top=5, sides=3, bottom=4, left=9) == (19, 25, 88, 51)
        assert panel_elements.within_margins(box, 20.0, top=5, sides=3, bottom=4)[2:] == (8, 8)

    def test_a_card_fills_its_box_but_for_round_corners(self):
        picture = np.zeros((100, 140, 3), np.uint8)
        box = Rectangle(20, 10, 90, 60)
        panel_elements.draw_card(picture, box, LAYOUT)
        lit = (picture == style.DARK.card).all(-1)
        rows, columns = np.nonzero(lit)
        assert (columns.min(), columns.max(), rows.min(), rows.max()) == (20, 109, 10, 69)
        inside = box.of(lit)
        assert (inside != inside[::-1]).sum() < 8
        assert (inside != inside[:, ::-1]).sum() < 8
        radius = 5  # of four quarter circles
        assert 0.5 * (4 - math.pi) * radius**2 < (~inside).sum() < 3 * (4 - math.pi) * radius**2
        assert inside[:, radius:-radius].all()


class TestLayout:
    @pytest.mark.parametrize(
        ("size", "unit"),
        [
            ((1280, 720), 1),
            ((2560, 1440), 2),
            ((3840, 720), 1),
            ((1280, 1280), 1),
            ((1920, 1440), 1.5),
            ((2000, 900), 1.25),
        ],
    )
    def test_a_frame_is_scaled_by_the_side_that_is_short_of_the_design(self, size, unit):
        assert design_unit(*size) == design_unit(*size[::-1]) == pytest.approx(unit)

    def test_text_of_small_frames_is_larger_than_by_proportion_and_shrinks_below_640_pixels(self):
        units = [design_unit(side, round(side * 9 / 16)) for side in (320, 480, 640, 720)]
        assert units[0] == pytest.approx(units[2] / 2)
        assert units[1] == pytest.approx(units[2] * 3 / 4)
        assert units[2] == units[3] > 720 / 1280

    @pytest.mark.parametrize("size", [(1280, 720), (720, 1280), (1600, 800), (640, 480)])
    @pytest.mark.parametrize("legend", [False, True])
    def test_the_map_is_true_to_scale_as_large_as_fits_and_in_the_middle(self, size, legend):
        def fit(width, length):
            return Layout.fit(*size, Area(width=width, length=length), with_legend=legend)

        wide, high = fit(20000.0, 100.0).map, fit(100.0, 20000.0).map
        for area in ((200.0, 200.0), (300.0, 200.0), (200.0, 900.0), (520.0, 180.0)):
            layout = fit(*area)
            box = layout.map
            scale = min(wide.width / area[0], high.height / area[1])
            assert (box.width, box.height) == pytest.approx((scale * area[0], scale * area[1]), abs=1)
            assert box.left + box.width / 2 == pytest.approx(wide.left + wide.width / 2, abs=1)
            if not layout.legend or layout.legend.top > layout.panel.bottom:
                assert box.top + box.height / 2 == pytest.approx(high.top + high.height / 2, abs=1)
        unit, upright = design_unit(*size), size[1] > size[0]
        end = size[0] if upright else layout.panel.left
        assert 30 * unit < wide.left < 60 * unit  # room for numbers
        assert 0 < end - wide.right < 30 * unit
        assert wide.right - wide.left + wide.left + (end - wide.right) == end

    @pytest.mark.parametrize("size", [(1280, 720), (720, 1280), (2560, 1440)])
    def test_panel_and_legend_have_the_same_margin_all_around(self, size):
        layout = Layout.fit(*size, Area(), with_legend=False)
        margin, panel = size[0] - layout.panel.right, layout.panel
        assert margin == size[1] - panel.bottom == round(10 * layout.unit)
        assert panel.left == margin if size[1] > size[0] else panel.top == margin
        with_it = Layout.fit(*size, Area())
        legend, above = with_it.legend, with_it.panel
        assert legend is not None
        assert (legend.left, legend.width) == (above.left, above.width) == (panel.left, panel.width)
        assert legend.bottom == panel.bottom
        assert 0 < legend.top - above.bottom < margin
        flat = Layout.fit(*size, Area(width=2000.0, length=100.0))
        assert flat.panel == panel  # the legend is below the map
        assert flat.legend.top > flat.map.bottom
        above, below = flat.map.top, (panel.top if size[1] > size[0] else size[1]) - flat.legend.bottom
        assert above - below == pytest.approx(46 * layout.unit, rel=0.25)  # room for the scales above a map

    def test_lines_are_never_thinner_than_a_pixel(self):
        layout = Layout.fit(2560, 1440, Area())
        assert [layout.px(size) for size in (0.1, 0.5, 1.2, 3)] == [1, 1, 2, 6]
        assert LAYOUT.zoom > layout.zoom > 1

    def test_metres_to_pixels_in_an_area_that_is_not_square(self):
        view = MapView(Area(width=400.0, length=100.0), Rectangle(30, 50, 200, 75))
        np.testing.assert_allclose(
            view.pixel([(0, 0), (400, 100), (100, 40)]), [(29.5, 124.5), (229.5, 49.5), (79.5, 94.5)]
        )
        np.testing.assert_allclose(view.vector([(40, 20)]), [(20, -15)])
        assert view.per_metre == 0.5

    def test_round_numbers_are_the_nearest_on_their_side(self):
        steps = sorted(step * 10.0**power for power in range(-6, 7) for step in (1, 2, 5))
        for value in [*steps[3:-3], *np.geomspace(2e-5, 3e5, 400)]:
            assert nice(value) == pytest.approx(max(step for step in steps if step <= value * 1.0000001))
            assert nice_above(value) == pytest.approx(min(step for step in steps if step >= value * 0.9999999))
        finer = sorted(step * 10.0**power for power in range(-6, 7) for step in (1, 1.5, 4))
        assert nice_above(1.2, (1, 1.5, 4, 10)) == 1.5
        assert nice_above(41.0, (1, 1.5, 4, 10)) == min(step for step in finer if step >= 41)
