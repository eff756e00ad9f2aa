"""Frames: drawn alike whatever was drawn before, at any size; as the stored pictures; two side by side; colours."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest

from tests.usvauv_env.record.made_traces import following, keeping_station, paint, synthetic_trace
from tests.usvauv_env.render.reference_frames import LIMITS, cases, differences, drawn
from usvauv.env import Scenario
from usvauv.env.record.metrics import episode_metrics
from usvauv.env.record.tracking_metrics import middle_depth
from usvauv.env.render import shapes, style
from usvauv.env.render.frames import frames_of
from usvauv.env.render.layout import Arrangement, Rectangle
from usvauv.env.render.mission import RHYTHM, Playback, error_axes
from usvauv.env.render.panel import legend
from usvauv.env.render.panel.insets import measured_share
from usvauv.env.render.panel.legend import ENTRIES, InPicture
from usvauv.env.render.style import CATEGORICAL, CATEGORICAL_ON_WHITE, web
from usvauv.env.render.views.map import Popups
from usvauv.env.render.views.sea_surface import MapView, SeaSurface, elevation_limit
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

    def test_of_targets_that_move_it_shows_where_they_get_and_ranges_to_them(self):
        """Ways within 400 m of an area of 2400 m; a range of 50 m to a target 30 m deeper is 40 m across."""
        made = following(synthetic_trace(steps=30, auvs=3, nodes=3, area=(2400.0, 2400.0)))
        random, ranges = np.random.default_rng(1), np.zeros((30, 1, 3, 3))
        names = "auv_position", "boat_position", "node_way"
        ways = {name: random.uniform(1000, 1400, getattr(made, name).shape) for name in names}
        ranges[7, 0, 2, 1] = 50.0
        moving = replace(made, **ways, node_estimate=ways["node_way"], node_range=ranges)
        moving = replace(moving, auv_depth=np.full((30, 1, 3), middle_depth(moving.scenario) - 30.0))
        (low, high), every = frames_of([moving], (640, 360)).map.view.bounds, np.concatenate([*ways.values()], 2)
        assert (low <= every.min((0, 1, 2))).all()
        assert (high >= every.max((0, 1, 2))).all()
        assert (high - low < 1000).all()
        play = Playback(moving)
        assert play.ranges(6.0) == []
        ((auv, target, place, across, fresh),) = play.ranges(17.0)
        assert (auv, target, across, fresh) == (2, 1, pytest.approx(40.0), pytest.approx(np.exp(-1.0)))
        np.testing.assert_allclose(place, moving.own_position[7, 0, 2])

    def test_waves_that_are_short_on_it_are_no_pattern_below_symbols(self):
        """Of a height; a wave of a twentieth of the side, as in `tracking`, and one of a third, as in `extreme`."""
        box, x = Rectangle(0, 0, 320, 320), np.arange(128) / 128
        contrasts = []
        for length in (0.05, 0.33):
            field = np.tile(np.sin(2 * np.pi * x / length), (128, 1)).astype(np.float32)
            picture = np.zeros((320, 320, 3), np.uint8)
            SeaSurface(field[None], MapView(Area(width=100, length=100), box)).paint(picture, field)
            contrasts.append(picture.mean(-1).std())
        assert contrasts[0] < 0.3 * contrasts[1]

    def test_symbols_end_at_its_border(self):
        """An AUV in the corner, in a service with data, and its estimate beyond: nothing of them is beside the map."""
        made = synthetic_trace(steps=3, auvs=1)
        corner = np.full_like(made.auv_position, 0.0)
        at = replace(made, auv_position=corner, heard_position=corner, delivered=np.ones_like(made.delivered))
        outside = np.ones((360, 640), bool)
        frames = frames_of([at], (640, 360))
        frames.layout.map.of(outside)[:] = False
        others = [frames.layout.boxes[name].of(outside) for name in frames.layout.boxes if name != "map"]
        for other in others:
            other[:] = False
        shown = frames.frame(2).copy()
        away = replace(at, auv_position=corner + 100.0, heard_position=corner + 100.0)
        np.testing.assert_array_equal(frames_of([away], (640, 360)).frame(2)[outside], shown[outside])

    def test_data_of_some_seconds_of_video_are_one_sum(self):
        """An AUV that takes 0.06 Mbit in each step has one text for two seconds, which counts."""
        made = synthetic_trace(steps=130, auvs=1)
        popups = Popups(Playback(replace(made, delivered=np.full_like(made.delivered, 0.06))), 1.0)
        said = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(shapes, "badge", lambda image, text, *others: said.append(text))
            for t in range(130):
                popups.draw(np.zeros((200, 200, 3), np.uint8), t, np.full((1, 2), 100.0), np.zeros((1, 2)))
        sums = [float(text.split()[0]) for text in said]
        last = np.arange(130) % 60 // RHYTHM * RHYTHM  # step of the sum that is written
        np.testing.assert_allclose(sums, 0.06 * (last + 1), atol=0.006)


class TestLegend:
    def test_it_names_what_is_in_the_picture(self):
        made = synthetic_trace(steps=90)
        empty = replace(made, backlog=np.zeros_like(made.backlog))
        full = replace(made, backlog=np.full_like(made.backlog, 1e6))
        for trace, filled in ((empty, False), (full, True)):
            now = InPicture(Playback(trace), 1.0, frames_of([trace], (640, 360)).layout, True, False)
            now.look(80.0)
            words = {entry.words for entry in ENTRIES if entry.shown(now)}
            assert ("full: new data is lost" in words) == filled
            assert "target that moves" not in words
            assert "station of an AUV" not in words
            assert {"AUV, underwater robot", "node: how full of data"} < words

    def test_its_letters_are_legible_on_a_phone(self):
        """A frame of 1280 pixels is reduced there to about 480, in which letters of less than 6 pixels blur."""
        trace, sizes = synthetic_trace(steps=60), []
        frames = frames_of([trace], (1280, 720))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(legend, "write", lambda card, text, at, size, *others: sizes.append((text, size)))
            frames.frame(50)
        assert min(size for text, size in sizes if not text.startswith("SDR")) * 480 / 1280 >= 6


class TestPanel:
    def test_the_rim_of_a_target_is_bright_where_a_range_tells_most(self):
        """Of P with 9 m² to the north-east and 1 m² across, a far range with σ leaves 1/(1/9 + 1/σ²) + 1 of it."""
        trace = following(synthetic_trace(steps=20, auvs=3, nodes=1))
        covariance, sigma = trace.node_covariance[0, 0, 0], trace.scenario.task_numbers["range_noise"]
        north_east, north_west = np.array([(1e4, 1e4), (-1e4, 1e4)])
        shares = measured_share(trace, covariance, np.stack([north_east, north_west]), 0.0)
        left = 1 / (1 / np.array([9.0, 1.0]) + 1 / sigma**2) + [1.0, 9.0]
        np.testing.assert_allclose(shares, 1 - left / 10, rtol=1e-6)
        frames = frames_of([trace], (1280, 720))
        box = frames.layout.boxes["fixes"].of(frames.frame(10)).astype(float)
        pink = box[..., 2] - box[..., 1]  # red above green, on the rim alone
        pink[: round(30 * frames.layout.unit)] = 0
        rows, columns = np.nonzero(pink > 20)
        y, x = -(rows - rows.mean()), columns - columns.mean()
        strength = pink[rows, columns]
        assert (strength * x * y).sum() > 0.1 * (strength * (x**2 + y**2)).sum()

    def test_an_estimate_beyond_its_inset_is_an_arrow_on_that_side(self):
        made = synthetic_trace(steps=30, auvs=1)

        def middle(east: float, north: float) -> np.ndarray:
            """Mean pixel of what is white in the inset, of an estimate so many metres off."""
            off = made.auv_position + np.array([east, north])
            frames = frames_of([replace(made, estimate=off, foreseen_position=off)], (1280, 720))
            white = (frames.layout.boxes["fixes"].of(frames.frame(20)) > 248).all(axis=-1)
            return np.mean(np.nonzero(white)[::-1], axis=1)

        level = middle(0.0, 0.0)
        for east, north in ((30.0, 0.0), (0.0, -30.0), (-30.0, 30.0)):
            moved = middle(east, north) - level
            np.testing.assert_allclose(np.sign(np.round(moved / 5)), np.sign([east, -north]))

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
VISIONS = {  # of linear RGB, by Machado, Oliveira & Fernandes 2009 for complete dichromacy
    "normal": np.eye(3),
    "protanopia": [(0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)],
    "deuteranopia": [(0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881)],
    "tritanopia": [(1.255528, -0.076749, -0.178779), (-0.078411, 0.930809, 0.147602), (0.004733, 0.691367, 0.303900)],
}


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
def test_auvs_are_told_apart_and_their_text_is_legible(theme):
    """By CIE 1976: 2.3 is just noticeable; a yellow and two olives were 29.6 apart with normal vision."""
    codes, least = [web(theme.auv(auv)) for auv in range(8)], {"normal": 32.0}
    colours = np.array([linear(code) for code in codes])
    for vision, matrix in VISIONS.items():
        seen = np.clip(colours @ np.transpose(matrix), 0, 1).astype(np.float32)
        encoded = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055).astype(np.float32)
        lab = cv2.cvtColor(encoded[None], cv2.COLOR_RGB2Lab)[0]
        apart = [float(np.linalg.norm(one - other)) for one, other in combinations(lab, 2)]
        assert min(apart) > least.get(vision, 15.0), vision
    grounds = [web(theme.card)] + [web(style.OUTLINE)] * (theme is style.DARK)  # of captions; of words on the sea
    assert all(contrast(code, ground) >= 4.5 for code in codes for ground in grounds)


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
