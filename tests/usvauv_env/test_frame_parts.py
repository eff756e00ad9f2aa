"""Parts of a frame: plots, the map's axes, the legend, and two missions beside each other."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tests.usvauv_env.made_traces import synthetic_trace
from tests.usvauv_env.test_frames import LAYOUT, overlap, stations
from usvauv.env.render import style
from usvauv.env.render.comparison import Comparison, differences
from usvauv.env.render.frame_layout import Layout, Rectangle, nice
from usvauv.env.render.legend import ENTRIES, FORESIGHT, ON_MAP, STATION_ENTRIES, draw_legend
from usvauv.env.render.map import MissionMap
from usvauv.env.render.map_axes import draw_map_axes
from usvauv.env.render.plots import LivePlot, Plot, RecordedPlot, SectionPlot
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.env.render.sea_layers import COLOURS, colour_scale
from usvauv.env.render.text import clock
from usvauv.env.scenario.sea import Area


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

    @pytest.mark.parametrize(("height", "values"), [(33, ["0.1", "0.2", "0.5"]), (18, ["0.1", "0.5"]), (6, ["0.1"])])
    def test_numbers_without_room_are_left_out(self, page, height, values):
        Plot(self.still(), self.BOX._replace(height=height), 0.08, 0.6, 100.0, LAYOUT, log=True)
        assert [words.text for words in page.words if words.anchor == "right"] == values
        assert not any(overlap(a.place, b.place) for a, b in combinations(page.words, 2))

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

    @pytest.mark.parametrize("size", [(1280, 720), (640, 360)])
    def test_a_map_beside_another_keeps_to_its_half(self, page, size):
        trace = synthetic_trace(steps=3, area=(600.0, 600.0)).episode(0)
        other = replace(trace, policy="another")
        Comparison(trace, other, size, style.DARK, 1.0)
        lefts = [words.place[0] for words in page.words if words.text.startswith(("sea surface", "current "))]
        half = size[0] / 2
        assert len(lefts) == (4 if size[0] > 1000 else 2)
        assert all(0 < left < half for left in lefts[: len(lefts) // 2])
        assert all(half < left for left in lefts[len(lefts) // 2 :])

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
        monkeypatch.setattr(f"usvauv.env.render.legend.{name}", recorded[: len(recorded) - 2 * foresees])
        monkeypatch.setattr("usvauv.env.render.legend.FORESIGHT", recorded[len(recorded) - 2 * foresees :])
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
