"""Frames as pages: words apart and within their cards, numbers of axes beside their places, plots, layouts."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tests.usvauv_cli.test_video import synthetic_trace
from usvauv_env.render import glass_box, panel_elements, style
from usvauv_env.render import text as texts
from usvauv_env.render.canvas import Canvas
from usvauv_env.render.comparison import Comparison, differences
from usvauv_env.render.frame_layout import Layout, MapView, Rectangle, design_unit, nice, nice_above
from usvauv_env.render.legend import ENTRIES, FORESIGHT, ON_MAP, STATION_ENTRIES, draw_legend
from usvauv_env.render.map import MissionMap
from usvauv_env.render.map_axes import draw_map_axes
from usvauv_env.render.painter import Look, painter_of
from usvauv_env.render.plots import LivePlot, Plot, RecordedPlot, SectionPlot
from usvauv_env.render.running_metrics import RunningMetrics, figures
from usvauv_env.render.sea_layers import COLOURS, colour_scale
from usvauv_env.render.text import clock
from usvauv_env.scenario import Scenario
from usvauv_env.sections import Area

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


class TestPlots:
    BOX = Rectangle(100, 60, 420, 130)

    @staticmethod
    def still():
        return np.zeros((300, 600, 3), np.uint8)

    @pytest.mark.parametrize("log", [False, True])
    @pytest.mark.parametrize(("low", "high", "duration"), [(0.3, 7.0, 100.0), (2.0, 900.0, 1800.0), (0.02, 0.05, 4e5)])
    def test_numbers_stand_beside_their_lines_and_times_below_theirs(self, page, low, high, duration, log):
        box = self.BOX
        plot = Plot(self.still(), box, low, high, duration, LAYOUT, log)
        share = (lambda v: math.log(v / low) / math.log(high / low)) if log else (lambda v: (v - low) / (high - low))
        values = [words for words in page.words if words.anchor == "right"]
        times = [words for words in page.words if words.anchor == "centre"]
        assert len(values) + len(times) == len(page.words) == len(page.strokes)
        assert len(values) >= 3
        gaps = set()
        for words, (line, _, _) in zip(values, page.strokes, strict=False):
            row = box.bottom - 1 - share(float(words.text)) * (box.height - 1)
            np.testing.assert_allclose(line, [(box.left, row), (box.right, row)], atol=1e-6)
            assert words.middle == pytest.approx(row, abs=2)
            gaps.add(box.left - words.position[0])
            assert low <= float(words.text) <= high
        assert len(gaps) == 1
        assert 0 < gaps.pop() < 20
        if not log:
            ticks = [float(words.text) for words in values]
            spacing = ticks[1] - ticks[0]
            np.testing.assert_allclose(np.diff(ticks), spacing)
            assert ticks[0] - spacing < low
            assert ticks[-1] + spacing > high
            assert spacing == pytest.approx(nice(spacing * 1.001))
        begins = [line[0, 0] for line, *_ in page.strokes[len(values) :]]
        seconds = (np.array(begins) - box.left) / (box.width - 1) * duration
        assert [words.text for words in times] == [clock(second + 1e-3) for second in seconds]
        np.testing.assert_allclose(np.diff(seconds), seconds[1])
        assert seconds[0] == 0
        assert duration - seconds[1] * 1.001 < seconds[-1] <= duration * 1.0001
        assert 2 <= len(times) <= 9
        for words, (line, _, _) in zip(times, page.strokes[len(values) :], strict=True):
            assert words.position[0] == line[0, 0] == line[1, 0]
            assert box.bottom == line[0, 1] < line[1, 1] < words.place[1] + 1
        assert not any(overlap(a.place, b.place) for a, b in combinations(page.words, 2))
        np.testing.assert_allclose(plot.y(np.array([low / 10, high * 10])), [box.bottom - 1, box.top])

    def test_a_section_has_distances_below(self, page):
        SectionPlot(self.still(), self.BOX, -1.0, 1.0, 300.0, LAYOUT)
        places = {words.text: words.position[0] for words in page.words if words.anchor == "centre"}
        assert list(places) == ["0", "50", "100", "150", "200", "250", "300"]
        np.testing.assert_allclose(list(places.values()), 100 + np.arange(7) / 6 * 419)

    def test_areas_curves_and_dots_are_where_their_values_are(self):
        still, box, (red, green, blue) = self.still(), self.BOX, np.eye(3, dtype=int)[::-1] * 255
        plot = RecordedPlot(still, box, -2.0, 3.0, 100.0, LAYOUT)
        ground = still.copy()
        time = np.array([0.0, 50.0, 50.0, 100.0])
        plot.area(time, np.array([2.0, 2.0, -1.0, -1.0]), tuple(blue.tolist()))
        plot.curve(time, np.array([-1.5, -1.5, 1.0, 1.0]), tuple(red.tolist()))
        plot.dots(np.array([20.0]), np.array([2.5]), tuple(green.tolist()))
        plot.finish()
        plot.show_until(80.0)

        def at(seconds, value):
            row = box.bottom - 1 - (value + 2) / 5 * (box.height - 1)
            return still[round(row), round(box.left + seconds / 100 * (box.width - 1))].tolist()

        for seconds, value, ink in (
            (25, 1.9, blue),
            (25, 0.1, blue),
            (75, -0.9, blue),
            (75, -0.1, blue),
            (25, -1.5, red),
            (75, 1.0, red),
        ):
            assert at(seconds, value) == ink.tolist()
        for seconds, value in ((25, 2.2), (25, -0.2), (75, 0.2), (75, -1.2), (25, -1.3), (75, 0.8)):
            assert max(at(seconds, value)) < 90
        assert at(20, 2.5)[1] > 150
        assert at(14, 2.5)[1] < 90
        after = box._replace(left=box.left + round(0.8 * 419) + 2, width=60)
        assert (after.of(still) == after.of(ground)).all()
        plot.draw_cursor(still, 60.0)
        assert (still[box.top : box.bottom, round(100 + 0.6 * 419)] == style.DARK.muted).all()

    def test_a_curve_that_grows_is_the_curve_drawn_at_once(self):
        time = np.linspace(0, 100, 60)
        inks = (255, 80, 40), (40, 80, 255)
        values = [np.sin(time / 9), np.cos(time / 5)]
        pictures = [self.still() for _ in range(2)]
        live = LivePlot(pictures[0], self.BOX, -1.2, 1.2, 100.0, LAYOUT)
        whole = RecordedPlot(pictures[1], self.BOX, -1.2, 1.2, 100.0, LAYOUT)
        for t, second in enumerate(time):
            for series, ink in zip(values, inks, strict=True):
                live.extend(second, series[t], ink)
        for series, ink in zip(values, inks, strict=True):
            whole.curve(time, series, ink)
        whole.finish()
        whole.show_until(100.0)
        difference = np.abs(pictures[0].astype(int) - pictures[1]).max(-1)
        assert (difference > 40).sum() < 60  # where the curves cross, the later one is above
        assert (pictures[0] != 0).any(-1).sum() > 2000

    def test_a_section_is_water_up_to_its_level_with_lines_at_its_bounds(self):
        plot = SectionPlot(self.still(), self.BOX, -2.0, 2.0, 100.0, LAYOUT)
        picture, distance = self.still(), np.linspace(0, 100, 50)
        plot.draw(picture, distance, distance / 50 - 1, np.array([0 * distance - 1.5, 0 * distance + 1.5]))
        water = picture[189, 300].tolist()
        for x, value in ((20, -0.9), (80, 0.3), (50, -0.3)):
            row, column = round(189 - (value + 2) / 4 * 129), round(100 + x / 100 * 419)
            assert picture[row, column].tolist() == water
        for x, value in ((20, 0.5), (80, 1.25), (50, 0.5)):
            row, column = round(189 - (value + 2) / 4 * 129), round(100 + x / 100 * 419)
            assert picture[row, column].max() < 10
        for bound in (-1.5, 1.5):
            row = round(189 - (bound + 2) / 4 * 129)
            rows = picture[row - 3 : row + 4, 150].astype(int)
            assert np.abs(rows - rows[0]).max() > 20
        level = picture[round(189 - (0 + 2) / 4 * 129), round(100 + 0.5 * 419)].astype(int)
        assert np.abs(level - style.DARK.water).max() < 60


class TestMapAxes:
    AREA = Area(width=300.0, length=200.0)

    def axes(self, note="a note", sea=True, vortices=4, size=(1280, 720)):
        layout = Layout.fit(*size, self.AREA)
        trace = synthetic_trace(steps=3, area=(300.0, 200.0), sea=sea, vortices=vortices).episode(0)
        scene = MissionMap(trace, RunningMetrics.of(trace), layout)
        picture = np.zeros((size[1], size[0], 3), np.uint8)
        draw_map_axes(picture, scene, layout, self.AREA, note)
        return layout, scene, picture

    def test_numbers_stand_at_their_metres(self, page):
        layout, scene, _ = self.axes()
        box = layout.map
        x = [words for words in page.words if words.anchor == "centre"]
        y = [words for words in page.words if words.anchor == "right" and words.position[0] < box.left]
        assert [words.text for words in x] == ["0", "100", "200", "300"]
        assert [words.text for words in y] == ["0", "100", "200"]
        lines = [line for line, *_ in page.strokes]
        for words in x:
            at = scene.view.pixel(np.array([float(words.text), 0.0]))[0]
            assert words.position[0] == pytest.approx(at)
            tick = next(line for line in lines if line.shape == (2, 2) and (line[:, 0] == words.position[0]).all())
            assert box.bottom < tick[:, 1].min() < tick[:, 1].max() < words.place[1] + 1
        for words in y:
            at = scene.view.pixel(np.array([0.0, float(words.text)]))[1]
            assert words.middle == pytest.approx(at, abs=2)
            tick = next(line for line in lines if line.shape == (2, 2) and (line[:, 1] == at).all())
            assert words.position[0] < tick[:, 0].min() < tick[:, 0].max() < box.left
        assert len({words.position[1] for words in x}) == len({words.position[0] for words in y}) == 1
        frame = next(line for line in lines if len(line) == 4 and np.ptp(line[:, 0]) > 0.9 * box.width)
        assert frame[:, 0].min() == pytest.approx(box.left - 0.5 - 1)
        assert frame[:, 0].max() == pytest.approx(box.right - 0.5 + 1)
        assert frame[:, 1].min() == pytest.approx(box.top - 0.5 - 1)
        assert frame[:, 1].max() == pytest.approx(box.bottom - 0.5 + 1)
        assert np.allclose(np.sort(np.abs(np.diff(frame, axis=0)).min(1)), 0)  # a rectangle

    def test_a_bar_is_as_long_as_it_says(self, page):
        layout, scene, _ = self.axes()
        bar = next(line for line, *_ in page.strokes if len(line) == 4 and np.ptp(line[:, 0]) < 0.5 * layout.map.width)
        words = next(words for words in page.words if words.text.endswith(" m") and words.text[0] != "+")
        assert np.ptp(bar[:, 0]) == pytest.approx(float(words.text[:-2]) * scene.view.per_metre)
        assert bar[:, 0].min() == layout.map.left
        assert bar[:, 0].max() < words.place[0]
        assert np.ptp(bar[:, 1]) < 10
        assert (bar[0, 0], bar[-1, 0]) == (bar[1, 0], bar[2, 0])
        assert bar[1, 1] == bar[2, 1] > bar[0, 1] == bar[3, 1]
        assert 0.1 * layout.map.width < np.ptp(bar[:, 0]) <= 0.25 * layout.map.width

    def test_a_streak_is_as_long_as_its_speed_drifts(self, page):
        layout, scene, picture = self.axes()
        words = next(words for words in page.words if words.text.startswith("current "))
        speed = float(words.text.split()[1])
        long, bright = (line for line, *_ in page.strokes[-2:])
        assert np.ptp(long[:, 0]) == pytest.approx(speed * scene.streaks.tail * scene.view.per_metre)
        assert np.ptp(bright[:, 0]) == pytest.approx(np.ptp(long[:, 0]) / 2)
        assert long[:, 0].max() == bright[:, 0].max() < words.place[0]
        assert speed == nice(scene.streaks.fastest)
        scale = np.flatnonzero((picture[: layout.map.top] == COLOURS[255].astype(np.uint8)).all(-1).any(0))
        high = next(words for words in page.words if words.text == f"+{scene.surface.limit:g} m")
        low = next(words for words in page.words if words.text == f"sea surface  −{scene.surface.limit:g}")
        assert low.place[2] < scale.min() - 80 < scale.max() < high.place[0]
        assert high.place[2] == layout.map.right

    def test_what_is_not_there_is_said(self, page):
        self.axes(sea=False, vortices=0)
        said = [words.text for words in page.words]
        assert "flat sea" in said
        assert "no current" in said
        assert not any("sea surface" in text or "m/s" in text for text in said)

    def test_what_there_is_no_room_for_is_left_out(self, page):
        self.axes(note="a note " * 30)
        assert not any("a note" in words.text for words in page.words)
        assert any(words.text == "metres east →" for words in page.words)
        assert any(words.text == "metres north ↑" for words in page.words)

    def test_the_colour_scale_goes_from_the_lowest_to_the_highest(self):
        picture = colour_scale(256, 7)
        assert picture.shape == (7, 256, 3)
        np.testing.assert_array_equal(picture[3, [0, -1]], [style.SEA[0], style.SEA[-1]])
        stops = np.linspace(0, 255, len(style.SEA))
        expected = [np.interp(np.arange(256), stops, channel) for channel in np.array(style.SEA).T]
        np.testing.assert_allclose(picture[3], np.transpose(expected), atol=1)


class TestLegend:
    @pytest.mark.parametrize(
        ("symbol", "words"),
        [*ENTRIES, *STATION_ENTRIES, *FORESIGHT],
        ids=lambda x: x if isinstance(x, str) else x.__name__,
    )
    def test_each_symbol_is_in_the_middle_of_its_place(self, symbol, words):
        """40 × 20 pixels of the design, at its middle, at any size."""
        for unit in (1, 3):
            layout = replace(Layout.fit(1280 * unit, 720 * unit, Area()), theme=ON_MAP)
            ground = np.full((40 * unit, 60 * unit, 3), ON_MAP.card, np.uint8)
            picture = ground.copy()
            symbol(picture, np.array([30.0, 20.0]) * unit, layout)
            rows, columns = np.nonzero(np.abs(picture.astype(int) - ground).max(-1) > 12)
            middle = np.array([columns.min() + columns.max(), rows.min() + rows.max()]) / 2
            np.testing.assert_allclose(middle, np.array([30, 20]) * unit, atol=2.2 * unit)
            assert 8 * unit < np.ptp(columns) < 40 * unit
            assert 7 * unit < np.ptp(rows) < 27 * unit

    @pytest.mark.parametrize(("task", "foresees"), [("data-collection", True), ("station-keeping", False)])
    def test_words_stand_in_two_columns_beside_their_symbols(self, page, monkeypatch, task, foresees):
        placed = []
        entries = (ENTRIES if task == "data-collection" else STATION_ENTRIES) + FORESIGHT * foresees
        recorded = tuple(
            ((lambda _, at, layout, words=words: placed.append((words, at))), words) for _, words in entries
        )
        name = "ENTRIES" if task == "data-collection" else "STATION_ENTRIES"
        monkeypatch.setattr(f"usvauv_env.render.legend.{name}", recorded[: len(recorded) - 2 * foresees])
        monkeypatch.setattr("usvauv_env.render.legend.FORESIGHT", recorded[len(recorded) - 2 * foresees :])
        box = Rectangle(100, 200, 520, 146)
        draw_legend(np.zeros((720, 1280, 3), np.uint8), box, LAYOUT, task, foresees)
        assert [words for words, _ in placed] == [words for _, words in entries]
        said = {words.text: words for words in page.words}
        rows = sorted({float(at[1]) for _, at in placed})
        assert len(rows) == len(entries) // 2
        assert np.ptp(np.diff(rows)) < 1e-6
        ground, *stripes = page.cards
        assert ground == box
        assert [stripe.left + stripe.width / 2 for stripe in stripes] == [at[0] for _, at in placed[:2]]
        assert stripes[1].left - stripes[0].left == box.width / 2
        bottom = said[next(text for text in said if "EC:" in text)]
        assert bottom.position[0] - box.left == pytest.approx(box.right - box.width + 8 - box.left)
        for place, (words, at) in enumerate(placed):
            stripe = stripes[place % 2]
            assert stripe.top < at[1] - 5 < at[1] + 5 < stripe.bottom
            assert at[1] == pytest.approx(stripe.top + (place // 2 + 0.5) * stripe.height / len(rows))
            assert stripe.right < said[words].position[0] < stripe.right + 12
            end = box.left + (place % 2 + 1) * box.width / 2
            assert said[words].place[2] <= end
            assert said[words].position[1] - 0.36 * said[words].size == pytest.approx(at[1])
            assert said[words].place[3] < bottom.place[1] + 1


class TestComparison:
    def test_both_halves_are_laid_out_alike(self, page):
        trace = synthetic_trace(steps=9)
        frames = Comparison(trace, trace, (1600, 900), style.DARK, 3.0)
        for boxes in (frames._titles, frames._tiles, [layout.map for layout in frames._layouts]):
            assert boxes[1] == boxes[0]._replace(left=boxes[0].left + 800)
        first, second = (plot.box for plot in frames._plots)
        assert second == first._replace(left=first.left + 800)
        title, tiles, box = frames._titles[0], frames._tiles[0], frames._layouts[0].map
        assert title.bottom < box.top < box.bottom < tiles.top < tiles.bottom < first.top < first.bottom < 900
        margins = [title.left, 800 - title.right, tiles.left, 800 - tiles.right]
        margins += [each for card in page.cards for each in (card.left % 800, 800 - (card.right - 1) % 800 - 1)]
        assert set(margins) == {margins[0]}
        assert max(card.bottom for card in page.cards) == 900 - margins[0]
        assert {words.text for words in page.words} >= {"Data delivered, Mbit", "Position error, m"}

    @pytest.mark.parametrize("area", [(200.0, 200.0), (800.0, 200.0), (100.0, 300.0)])
    def test_maps_are_as_large_as_fits_and_in_the_middle(self, area):
        def boxes(area):
            trace = synthetic_trace(steps=2, nodes=2, area=area, sea=False, vortices=0)
            return Comparison(trace, trace, (1600, 900), style.DARK, 3.0)._layouts[0].map

        wide, high, box = boxes((8000.0, 100.0)), boxes((100.0, 8000.0)), boxes(area)
        scale = min(wide.width / area[0], high.height / area[1])
        assert (box.width, box.height) == pytest.approx((scale * area[0], scale * area[1]), abs=1)
        assert box.left + box.width / 2 == pytest.approx(wide.left + wide.width / 2, abs=1)
        assert box.top + box.height / 2 == pytest.approx(high.top + high.height / 2, abs=1)

    def test_tiles_say_both_figures_and_how_far_the_second_is_from_the_first(self, page):
        traces = synthetic_trace(steps=60), synthetic_trace(steps=80, seed=4)
        frames = Comparison(*traces, (1600, 900), style.DARK, 3.0)
        assert sum("of 1:00 · 3 × speed" in words.text for words in page.words) == 2  # the shorter one
        page.words.clear()
        picture = frames.frame(49)
        said = [words.text for words in page.words]
        assert said.count("0:50") == 2
        rates = [trace.service_rate[:50, 0].sum() for trace in traces]
        expected = [f"{rates[0]:.2f}", f"{rates[1]:.2f} ({rates[1] - rates[0]:+.2f})".replace("-", "−")]
        assert [text for text in said if text in expected] == expected
        for title, tiles, colour in zip(frames._titles, frames._tiles, frames._colours, strict=True):
            bar = picture[round(title.bottom - 2 * LAYOUT.unit) + 1, title.left : title.right]
            assert (bar == style.DARK.muted).all(-1).sum() == pytest.approx(50 / 60 * title.width, abs=2)
            stripe = (tiles.of(picture) == colour).all(-1)
            assert stripe[:, :4].all()
            assert not stripe[:, 8:].all(0).any()

    @pytest.mark.parametrize("task", ["data-collection", "station-keeping"])
    def test_plots_reach_to_the_largest_and_last_value(self, page, task):
        traces = synthetic_trace(steps=60), synthetic_trace(steps=50, seed=4)
        if task == "station-keeping":
            traces = tuple(stations(trace) for trace in traces)
        frames = Comparison(*traces, (1600, 900), style.DARK, 3.0)
        running = [RunningMetrics.of(trace) for trace in traces]
        series = [each.delivered if task == "data-collection" else each.off_target for each in running]
        first, errors = frames._plots
        assert first._values == (0.0, max(values.max() for values in series))
        error = [np.sqrt((each.error_median**2).mean(1)) for each in running]
        assert errors._values[1] == pytest.approx(max(values.max() for values in error))
        assert errors._values[0] == pytest.approx(min(np.quantile(values, 0.02) for values in error))
        assert errors._log
        assert not first._log
        for plot in frames._plots:
            assert plot.x(50.0) == plot.box.right - 1
        picture = frames.frame(49)
        for plot, both in ((first, series), (errors, error)):
            for values, colour in zip(both, frames._colours, strict=True):
                row, column = round(float(plot.y(values[30]))), round(float(plot.x(31.0)))
                near = picture[row - 2 : row + 3, column - 1 : column + 2].reshape(-1, 3).astype(int)
                assert np.abs(near - colour).max(1).min() < 60
        title = {
            "data-collection": "Data delivered, Mbit",
            "station-keeping": "Distance of the AUVs to their stations, m",
        }
        assert title[task] in {words.text for words in page.words}

    def test_what_differs_is_named(self):
        trace = synthetic_trace(steps=2)
        assert differences(trace, trace) == ("policy straight:1.6", "policy straight:1.6")
        nodes = trace.scenario.nodes.model_copy(update={"target_rule": "other"})
        other = replace(
            trace, policy="b", seed=3, scenario=trace.scenario.model_copy(update={"nodes": nodes, "name": "y"})
        )
        rule = trace.scenario.nodes.target_rule
        assert differences(trace, other) == (
            f"policy straight:1.6 · targets {rule} · seed 0 · scenario extreme",
            "policy b · targets other · seed 3 · scenario y",
        )
