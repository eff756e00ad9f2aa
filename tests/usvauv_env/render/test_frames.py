"""Frames: drawn alike whatever was drawn before, at any size; as the stored pictures; two side by side; colours."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from tests.usvauv_env.record.made_traces import keeping_station, paint, synthetic_trace
from tests.usvauv_env.render.reference_frames import LIMITS, cases, differences, drawn
from usvauv.env import Scenario
from usvauv.env.record.metrics import episode_metrics
from usvauv.env.render import style
from usvauv.env.render.frames import frames_of
from usvauv.env.render.layout import Arrangement
from usvauv.env.render.mission import Playback, error_axes
from usvauv.env.render.sea_surface import elevation_limit
from usvauv.env.render.style import CATEGORICAL, CATEGORICAL_ON_WHITE, web
from usvauv.env.scenario.environment import Area
from usvauv.kernels.errors import UserError

VIEWS = [("map", 1), ("sea", 1), ("both", 1), ("map", 2)]  # traces beside each other


class TestFrames:
    @pytest.mark.parametrize(("view", "traces"), VIEWS)
    def test_drawing_changes_no_trace_and_depends_on_the_step_alone(self, view, traces):
        trace = synthetic_trace(steps=12)
        arrays = {name: value.copy() for name, value in vars(trace).items() if isinstance(value, np.ndarray)}
        frames = frames_of([trace] * traces, (640, 360), view)
        first = [frames.frame(t).copy() for t in range(12)]
        again = frames_of([trace] * traces, (640, 360), view)
        np.testing.assert_array_equal(again.frame(11), first[11])
        assert (first[11] != first[10]).any()
        for name, value in arrays.items():
            np.testing.assert_array_equal(value, getattr(trace, name), err_msg=name)

    @pytest.mark.parametrize(("view", "traces"), VIEWS)
    @pytest.mark.parametrize("size", [(1280, 720), (1920, 400), (360, 640), (240, 240)])
    @pytest.mark.parametrize("area", [(200.0, 200.0), (2000.0, 200.0), (50.0, 1000.0)])
    def test_any_size_and_area_is_divided_into_boxes_that_keep_apart(self, view, traces, size, area):
        names = ["SDR, Mbit/s", "EC, W", "services", "delivered, Mbit", "full nodes"]
        arrangement = Arrangement(size, Area(width=area[0], length=area[1]), names)
        boxes = arrangement.boxes(view, dives=True) if traces == 1 else arrangement.compared()
        for box in boxes.values():
            assert min(box.left, box.top) >= 0
            assert min(box.width, box.height) >= 5
            assert box.right <= size[0]
            assert box.bottom <= size[1]
        for first, second in combinations(boxes.values(), 2):
            beside = first.right <= second.left or second.right <= first.left
            assert beside or first.bottom <= second.top or second.bottom <= first.top

    def test_other_worlds_are_not_shown(self):
        trace = synthetic_trace(steps=4, worlds=3)
        both, alone, other = (paint(which, 3)[0] for which in (trace, trace.episode(0), trace.episode(1)))
        assert (both == alone).all()
        assert (both != other).any()


class TestComparison:
    def test_missions_that_do_not_run_in_step_are_refused(self):
        trace = synthetic_trace(steps=3)
        scenario = Scenario.load("extreme", ["mission.step=0.5", "auv.count=2", "nodes.count=30"])
        for others, message in (
            ([replace(trace, scenario=scenario)], r"mission steps of 1 s and 0\.5 s cannot be compared"),
            ([keeping_station(trace)], "tasks data-collection and station-keeping cannot be compared"),
            ([trace, trace], "3 traces: at most two"),
        ):
            with pytest.raises(UserError, match=message):
                frames_of([trace, *others], (640, 360))

    def test_ends_with_the_shorter_and_shows_both(self):
        first, second = synthetic_trace(steps=9), synthetic_trace(steps=6, seed=4)
        both, same = (frames_of([first, other], (640, 360)) for other in (second, first))
        left, right = (shown.view.rectangle for shown in both.maps)
        seen, alike = both.frame(5).copy(), same.frame(5)
        np.testing.assert_array_equal(left.of(seen), left.of(alike))
        assert (right.of(seen) != right.of(alike)).any()
        np.testing.assert_array_equal(left.of(alike), right.of(alike))

    def test_both_maps_have_one_scale_of_lengths_and_of_colours(self):
        calm = synthetic_trace(steps=4, sea=False)
        rough = synthetic_trace(steps=4, area=(400.0, 300.0))
        rougher = replace(rough, surface=3 * rough.surface)
        for first, second in ((calm, rough), (rough, rougher)):
            frames = frames_of([first, second], (640, 360))
            one, other = frames.maps
            assert one.surface.limit == other.surface.limit == elevation_limit(second.surface)
            assert one.view.per_metre == pytest.approx(other.view.per_metre, rel=0.01)
            frames.frame(3)


class TestMap:
    def test_an_ellipse_has_the_axes_of_its_covariance_and_holds_86_per_cent(self):
        for xx, xy, yy in ((0.09, 0.03, 0.04), (4.0, -1.9, 1.0), (1.0, 0.0, 0.25), (0.0, 0.0, 0.0)):
            axes = error_axes(np.array([xx, xy, yy]))
            np.testing.assert_allclose(axes.T @ axes / 4, [[xx, xy], [xy, yy]], atol=1e-12)
        errors = np.random.default_rng(0).multivariate_normal([0, 0], [[4.0, -1.9], [-1.9, 1.0]], 20000)
        inside = (np.linalg.solve(error_axes(np.array([4.0, -1.9, 1.0])).T, errors.T) ** 2).sum(0) < 1
        assert inside.mean() == pytest.approx(1 - np.exp(-2), abs=0.01)


class TestPanel:
    def test_figures_equal_the_metrics(self):
        trace = synthetic_trace(steps=90, worlds=2)
        play = Playback(trace)
        for t in (0, 40, 89):
            until = slice(0, t + 1)
            said = {name: f"{value:{form}}" for name, value, form in play.figures(t)}
            assert said["SDR, Mbit/s"] == f"{trace.service_rate[until, 0].sum():.2f}"
            assert said["services"] == str((trace.service_rate[until, 0] > 0).sum())
            assert said["delivered, Mbit"] == f"{trace.delivered[until, 0].sum():.1f}"
            assert said["full nodes"] == str(trace.overflowing[t, 0])
        whole = episode_metrics(trace)[0]
        assert (said["SDR, Mbit/s"], said["EC, W"]) == (f"{whole.sdr:.2f}", f"{whole.ec:.1f}")


GROUNDS = {"#0b131c": CATEGORICAL, "#142130": CATEGORICAL, "#ffffff": CATEGORICAL_ON_WHITE}


def linear(code):
    """Linear RGB of a web colour, 0 to 1 (IEC 61966-2-1)."""
    value = np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def contrast(code, ground):
    """Contrast of WCAG 2.2, 1 to 21."""
    low, high = sorted(float(np.dot([0.2126729, 0.7151522, 0.0721750], linear(each))) + 0.05 for each in (code, ground))
    return high / low


@pytest.mark.parametrize("ground", GROUNDS)
def test_colours_stand_out_from_their_ground(ground):
    assert all(contrast(code, ground) >= 3 for code in GROUNDS[ground])


@pytest.mark.parametrize("theme", style.THEMES.values(), ids=style.THEMES)
def test_text_is_legible(theme):
    for text, ground in ((theme.text, theme.card), (theme.muted, theme.card), (theme.muted, theme.background)):
        assert contrast(web(text), web(ground)) >= 4.5  # WCAG 2.2, AA


CASES = cases()


@pytest.mark.parametrize("name", CASES)
def test_a_frame_is_the_stored_picture(name):
    differ, mean = differences(name, drawn(CASES[name]))
    assert differ <= LIMITS[0]
    assert mean <= LIMITS[1]
