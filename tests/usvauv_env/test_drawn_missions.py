"""Frames of a mission: sound, several boats, what the boat foresees, the panel, any size and any number."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest

from tests.usvauv_env.made_traces import paint, place, synthetic_trace, with_second_boat
from usvauv.env.record.metrics import episode_metrics
from usvauv.env.record.trace import Trace
from usvauv.env.render.frames import Look, Painter, painter_of
from usvauv.env.render.layout import Layout, Rectangle
from usvauv.env.render.mission import PING_FRAMES, ReplyField, RunningMetrics, figures, pings
from usvauv.env.render.plots import RecordedPlot
from usvauv.env.scenario import Scenario
from usvauv.env.scenario.sea import Area
from usvauv.kernels.positioning import usbl


class TestPings:
    def test_one_ring_after_another(self):
        """Where exchanges follow each other faster than rings run, a ring begins when the last is over."""
        rows = PING_FRAMES
        assert pings(np.ones(2 * rows + 1, bool)).tolist() == [0] * rows + [rows] * rows + [2 * rows]
        rare = np.zeros(40, bool)
        rare[[3, 30]] = True
        assert pings(rare).tolist() == [-1] * 3 + [3] * 27 + [30] * 10

    def test_the_line_is_to_who_was_heard(self):
        """Half way from the boat to an AUV the picture changes by its being heard; to the other it stays."""
        trace = synthetic_trace(steps=4)
        trace.fix_flags[:] = usbl.SILENT
        silent, painter = paint(trace, 3)
        trace.fix_flags[3, 0, 0] = usbl.DETECTED
        heard, _ = paint(trace, 3)
        (boat,), auvs = (painter.map.view.pixel(part[3, 0]) for part in (trace.boat_position, trace.auv_position))
        differs = []
        for auv in auvs[:2]:
            x, y = ((boat + auv) / 2).round().astype(int)
            window = slice(y - 3, y + 4), slice(x - 3, x + 4)
            differs.append((silent[window] != heard[window]).any())
        assert differs == [True, False]


class TestBoats:
    def test_every_boat_and_its_goal_are_drawn(self):
        one = synthetic_trace(steps=4)
        two = with_second_boat(one)
        (alone, painter), (both, _) = paint(one, 3), paint(two, 3)
        for x, y in ((170.0, 30.0), (170.0, 150.0), (170.0, 90.0)):  # boat, goal, the dashes between
            row, column = place(painter, x, y)
            window = slice(row - 9, row + 10), slice(column - 9, column + 10)
            assert (alone[window] != both[window]).any()

    def test_lines_are_from_the_boat_that_heard(self):
        two = with_second_boat(synthetic_trace(steps=4))
        two.fix_flags[:] = usbl.SILENT
        silent, painter = paint(two, 3)
        two.fix_flags[3, 0, 1] = usbl.DETECTED
        heard, _ = paint(two, 3)
        boats, auvs = (painter.map.view.pixel(part[3, 0]) for part in (two.boat_position, two.auv_position))
        differs = []
        for boat in boats:
            x, y = (boat + 0.3 * (auvs[1] - boat)).round().astype(int)
            window = slice(y - 3, y + 4), slice(x - 3, x + 4)
            differs.append((silent[window] != heard[window]).any())
        assert differs == [False, True]


class TestForesight:
    TRACE = synthetic_trace(steps=3, auvs=2, nodes=2, vortices=0, sea=False)

    def far(self, level: float = 139.0, **changes) -> Trace:
        """Of `TRACE`, with two AUVs 420 m apart, foreseen where they are; variances 300 and 100 m²."""
        wide = ["area.width=600", "area.length=600", "channel.data_ratio=18", f"acoustics.source_level={level}"]
        estimate = np.zeros_like(self.TRACE.estimate)
        estimate[:, 0] = (90.0, 300.0), (510.0, 300.0)
        covariance = np.zeros_like(self.TRACE.estimate_covariance)
        covariance[:, 0, 0, [0, 2]], covariance[:, 0, 1, [0, 2]] = 300.0, 100.0
        scenario = Scenario.load("extreme", [*wide, "nodes.count=2"])
        known = {"estimate": estimate, "foreseen_position": estimate, "estimate_covariance": covariance}
        return replace(self.TRACE, scenario=scenario, **{**known, **changes})

    def test_a_place_is_worth_what_is_heard_there(self):
        """Beside an AUV its share of the variance, far from both nothing, and where all is heard everything."""
        share = ReplyField(self.far()).share(2)
        assert share.shape == (41, 41)
        assert share[20, 6] == pytest.approx(0.75, abs=0.01)
        assert share[20, 34] == pytest.approx(0.25, abs=0.01)
        assert share[0, 0] < 0.05
        assert ReplyField(self.far(level=190.0)).share(2).min() > 0.999

    def test_lines_are_round_the_auv_that_is_worth_more(self):
        lines = dict(ReplyField(self.far()).lines(2))
        assert not lines[0.8]
        around = np.concatenate(lines[0.6])
        middle = (around.min(axis=0) + around.max(axis=0)) / 2
        assert np.abs(middle - (90, 300)).max() < 20

    def test_where_an_auv_is_foreseen_is_marked(self):
        shifted = self.far().estimate.copy()
        shifted[:, 0, 0] += (0.0, 200.0)
        with_it, painter = paint(self.far(foreseen_position=shifted), 1, (1280, 720))
        without, _ = paint(self.far(), 1, (1280, 720))
        row, column = place(painter, 90.0, 500.0, (600.0, 600.0))
        marked = (
            with_it[row - 8 : row + 9, column - 8 : column + 9] != without[row - 8 : row + 9, column - 8 : column + 9]
        )
        assert marked.any()
        legend = painter.layout.legend
        assert (with_it[legend.bottom - 40 : legend.bottom] != without[legend.bottom - 40 : legend.bottom]).any()


class TestPanel:
    def test_figures_equal_the_metrics(self):
        trace = synthetic_trace(steps=90, worlds=2)
        _, painter = paint(trace, 0)
        for t in (0, 40, 89):
            until = slice(0, t + 1)
            travelling = np.maximum((trace.hovering[until, 0] == 0).sum(0), 1)
            ec = float((trace.power[until, 0].sum(0) / travelling).mean())
            said = {name: f"{value:{form}}" for name, value, form in figures(trace, painter.panel._running, t)}
            assert said["SDR, Mbit/s"] == f"{trace.service_rate[until, 0].sum():.2f}"
            assert said["EC, W"] == f"{ec:.1f}"
            assert said["services"] == str((trace.service_rate[until, 0] > 0).sum())
            assert said["delivered, Mbit"] == f"{trace.delivered[until, 0].sum():.1f}"
            assert said["full nodes"] == str(trace.overflowing[t, 0])
        whole = episode_metrics(trace)[0]
        assert whole.services > 0
        assert said["SDR, Mbit/s"] == f"{whole.sdr:.2f}"
        assert said["EC, W"] == f"{whole.ec:.1f}"

    def test_running_series(self):
        trace = synthetic_trace(steps=90)
        running = RunningMetrics.of(trace)
        error = np.linalg.norm(trace.estimate - trace.auv_position, axis=-1)[:, 0]
        np.testing.assert_allclose(running.position_error, error)
        for t in (0, 10, 29, 30, 80):
            np.testing.assert_allclose(running.error_median[t], np.median(error[max(0, t - 29) : t + 1], axis=0))
        done = trace.service_rate[:, 0] > 0
        np.testing.assert_allclose(running.service_share[done], 1.0)
        assert (running.service_share[trace.hovering[:, 0] == 0] == 0).all()
        inside = (trace.hovering[1:, 0] == 1) & (trace.hovering[:-1, 0] == 1) & ~done[:-1]
        assert (np.diff(running.service_share, axis=0)[inside] > 0).all()
        velocity = trace.auv_velocity[:, 0]
        moving = np.hypot(velocity[..., 0], velocity[..., 1]) > 0
        np.testing.assert_allclose(np.cos(running.heading[moving]), velocity[moving][:, 0] / 1.6, atol=1e-9)

    def test_plots_do_not_show_the_future(self):
        trace = synthetic_trace(steps=40)
        blank = Painter(trace, (640, 360))._still
        early, painter = paint(trace, 9)
        late, _ = paint(trace, 39)
        plot = painter.panel._error_plot
        now = round(float(plot.x(trace.time[9]))) + 3
        box = plot.box._replace(left=now, width=plot.box.right - now)
        assert (box.of(early) == box.of(blank)).all()
        assert (box.of(early) != box.of(late)).any()

    def test_plot_passes_through_its_values(self):
        layout = Layout.fit(1280, 720, Area())
        still = np.zeros((720, 1280, 3), np.uint8)
        plot = RecordedPlot(still, Rectangle(800, 300, 400, 100), 0.1, 10.0, 100.0, layout, log=True)
        time = np.linspace(1, 100, 100)
        plot.curve(time, np.full(100, 1.0), (0, 0, 255))
        plot.finish()
        plot.show_until(50.0)
        rows, columns = np.nonzero(still[300:400, 800:1200, 2] > 150)
        assert rows.mean() == pytest.approx(49.5, abs=1)  # 1 is half way between 0.1 and 10
        assert columns.max() == pytest.approx(0.5 * 399, abs=2)

    def test_lens_shows_fixes_where_they_are(self):
        trace = synthetic_trace(steps=5, auvs=1, sea=False, vortices=0)
        east = replace(trace, estimate=trace.auv_position + np.array([0.3, 0.0]))
        _, painter = paint(east, 4, (1280, 720))
        insets = painter.panel._insets
        frame, _ = paint(east, 4, (1280, 720))
        centre = insets._centres[0] + np.array([0.3 * insets._scale, 0.0])
        x, y = np.round(centre).astype(int)
        bright = (frame[y - 8 : y + 9, x - 8 : x + 9] > 200).all(-1)
        rows, columns = np.nonzero(bright)
        assert len(rows) > 8  # the diamond, hollow and in the middle of this window
        assert (abs(rows.mean() - 8), abs(columns.mean() - 8)) < (1.5, 1.5)
        assert insets.magnification == pytest.approx(insets._scale / painter.map.view.per_metre)


class TestAnyShape:
    @pytest.mark.parametrize(
        ("size", "options"),
        [
            ((640, 360), {"auvs": 16, "nodes": 500, "area": (400.0, 400.0)}),
            ((1280, 720), {"auvs": 1, "nodes": 1, "vortices": 0, "sea": False}),
            ((640, 480), {"area": (2000.0, 100.0)}),
            ((320, 320), {"area": (50.0, 2000.0), "auvs": 7}),
            ((360, 640), {}),
            ((1920, 400), {}),
            ((3840, 2160), {"auvs": 4}),
        ],
    )
    def test_is_drawn(self, size, options):
        trace = synthetic_trace(steps=3, **options)
        frame, painter = paint(trace, 2, size)
        assert frame.shape == (size[1], size[0], 3)
        layout = painter.layout
        boxes = [layout.map, layout.panel, *([layout.legend] if layout.legend else [])]
        for box in boxes:
            assert box.left >= 0
            assert box.top >= 0
            assert box.right <= size[0]
            assert box.bottom <= size[1]
        for first, second in combinations(boxes, 2):
            apart = first.right <= second.left or second.right <= first.left
            assert apart or first.bottom <= second.top or second.bottom <= first.top

    @pytest.mark.parametrize(("view", "traces"), [("map", 1), ("sea", 1), ("both", 1), ("map", 2)])
    def test_at_three_times_the_size_it_is_the_same_picture(self, view, traces, monkeypatch):
        """Each pixel is as bright as one of the other picture two pixels around, but for a few beside thin lines."""

        def block(text: str, size: float, _: bool) -> tuple[np.ndarray, int]:
            """Letters are fitted to whole pixels, so that their widths have no scale."""
            return np.full((round(size), round(0.6 * size * len(text)), 1), 255, np.uint16), round(size)

        monkeypatch.setattr("usvauv.env.render.style._mask", block)
        trace, small, frames = synthetic_trace(steps=13), (1280, 720), []
        off = trace.estimate + np.array([6.0, 0.0])
        trace = replace(trace, estimate=off, foreseen_position=off + np.array([0.0, 7.0]))
        for size in (small, (3840, 2160)):
            painter = painter_of([trace] * traces, size, Look(view), 1.0)
            for t in range(13):
                frame = painter.frame(t)
            frames.append(cv2.resize(frame, small, interpolation=cv2.INTER_AREA))
        around = np.ones((5, 5), np.uint8)
        for frame, other in (frames, frames[::-1]):
            above = cv2.subtract(frame, cv2.dilate(other, around))
            below = cv2.subtract(cv2.erode(other, around), frame)
            difference = cv2.max(above, below).max(-1)
            assert (difference > 60).sum() < 120
            assert (difference > 100).sum() < 12

    def test_other_worlds_are_not_shown(self):
        trace = synthetic_trace(steps=4, worlds=3)
        both, _ = paint(trace, 3)
        alone, _ = paint(trace.episode(0), 3)
        other, _ = paint(trace.episode(1), 3)
        assert (both == alone).all()
        assert (both != other).any()

    def test_perfect_fixes_are_drawn(self):
        trace = synthetic_trace(steps=3)
        perfect = replace(
            trace,
            fix=trace.auv_position,
            estimate=trace.auv_position,
            estimate_covariance=np.zeros_like(trace.fix_covariance),
        )
        frame, _ = paint(perfect, 2)
        assert frame.any()
