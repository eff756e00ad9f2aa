"""Missions as files: formats by ending, play speed, one moment as a picture, replays, two missions side by side."""

from dataclasses import replace
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from tests.usvauv_env.made_traces import synthetic_trace
from usvauv.cli.mission_video import ENDINGS, VideoSettings, render
from usvauv.env import Scenario
from usvauv.env.render.frames import VIEWS, Comparison, Look, differences, painter_of
from usvauv.env.render.mission import RunningMetrics
from usvauv.env.render.style import DARK, THEMES
from usvauv.kernels.errors import UserError

SMALL = (320, 320)
CODECS = {".mp4": "h264", ".webm": "vp9", ".gif": "gif", ".webp": "webp"}


@pytest.fixture(scope="module")
def trace():
    return synthetic_trace(steps=12)


@pytest.mark.parametrize("ending", CODECS)
def test_each_ending_has_its_format_and_shows_the_same(tmp_path, trace, ending):
    path = tmp_path / f"mission{ending}"
    summary = render([trace], path, VideoSettings((480, 360), fps=10))
    if ending == ".webp":  # FFmpeg reads no animated WebP
        from PIL import Image

        with Image.open(path) as file:
            count = file.n_frames
            file.seek(count - 1)
            last = np.asarray(file.convert("RGB"))[..., ::-1]
    else:
        with av.open(str(path)) as file:
            assert file.streams.video[0].codec_context.name in (CODECS[ending], f"lib{CODECS[ending]}", "libvpx-vp9")
            shown = [frame.to_ndarray(format="bgr24") for frame in file.decode(video=0)]
        count, last = len(shown), shown[-1]
    assert count == summary.frames == 12
    frame = painter_of([trace], (480, 360), Look(), 10.0).frame(11)
    assert np.abs(last.astype(float) - frame).mean() < 5.0


def test_picture_is_the_frame_of_its_moment(tmp_path, trace):
    path = tmp_path / "moment.png"
    for at, t in ((None, 11), (3.0, 2), (3.9, 2), (0.0, 0), (12.0, 11)):
        assert render([trace], path, VideoSettings(SMALL, at=at)).frames == 1
        expected = painter_of([trace], SMALL, Look(), 30.0).frame(t)
        np.testing.assert_array_equal(cv2.imread(str(path)), expected)


@pytest.mark.parametrize(
    ("step", "fps", "speedup", "stride", "rate"),
    [
        (1.0, 30, None, 1, 30),
        (0.5, 30, None, 1, 30),
        (1.0, 30, 10.0, 1, 10),
        (1.0, 30, 45.0, 2, Fraction(45, 2)),
        (1.0, 30, 60.0, 2, 30),
        (0.1, 25, 1.0, 1, 10),
        (2.0, 24, 100.0, 3, Fraction(50, 3)),
    ],
)
def test_pace(step, fps, speedup, stride, rate):
    assert VideoSettings(fps=fps, speedup=speedup).pace(step) == (stride, rate)
    assert stride * step * rate == (speedup or fps * step)  # s of mission in a second
    assert rate <= fps


def test_a_faster_video_has_fewer_frames_of_the_same_steps(tmp_path, trace):
    path = tmp_path / "fast.mp4"
    summary = render([trace], path, VideoSettings(SMALL, fps=4, speedup=20.0))
    assert (summary.frames, summary.fps) == (3, 4.0)
    with av.open(str(path)) as file:
        shown = [frame.to_ndarray(format="bgr24").astype(float) for frame in file.decode(video=0)]
    painter = painter_of([trace], SMALL, Look(), 20.0)
    for picture, t in zip(shown, (0, 5, 10), strict=True):
        assert np.abs(picture - painter.frame(t)).mean() < 5.0


@pytest.mark.parametrize(
    ("out", "settings", "message"),
    [
        ("x.avi", VideoSettings(), "--out x.avi: must end in one of .mp4, .webm, .gif, .webp, .png"),
        ("x", VideoSettings(), "--out x: must end in one of"),
        ("x.mp4", VideoSettings(at=3.0), "--at 3: is of a picture; --out x.mp4 does not end in .png"),
        ("x.png", VideoSettings(at=13.0), "--at 13: the mission is from 0 to 12 s"),
    ],
)
def test_what_there_is_not_is_refused(tmp_path, monkeypatch, trace, out, settings, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError) as caught:
        render([trace], out, settings)
    assert str(caught.value).startswith(message)
    assert list(tmp_path.iterdir()) == []


def test_themes_change_what_is_around_the_map_only(trace):
    frames = {name: painter_of([trace], (1280, 720), Look(theme=name), 30.0) for name in THEMES}
    box = frames["dark"].layout.map
    dark, light = (frames[name].frame(5).astype(int) for name in ("dark", "light"))
    np.testing.assert_array_equal(box.of(dark), box.of(light))
    assert light.mean() > dark.mean() + 60


@pytest.mark.parametrize("theme", THEMES.values(), ids=THEMES)
def test_text_is_legible(theme):
    def luminance(colour):
        share = np.array(colour[::-1]) / 255
        return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]

    for text, ground in ((theme.text, theme.card), (theme.muted, theme.card), (theme.muted, theme.background)):
        low, high = sorted((luminance(text), luminance(ground)))
        assert (high + 0.05) / (low + 0.05) >= 4.5  # WCAG 2.2, AA


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("size", [(640, 360), (720, 1280), (1920, 1080)])
def test_every_view_draws_every_size(trace, view, size):
    frames = painter_of([trace], size, Look(view), 30.0)
    first = frames.frame(0).copy()
    later = frames.frame(11)
    assert later.shape == (size[1], size[0], 3)
    assert (first != later).any(-1).mean() > 0.05


class TestComparison:
    def test_shows_how_far_two_missions_are_apart(self, trace):
        other = replace(synthetic_trace(steps=9, seed=4), usv="fim")
        frames = Comparison(trace, other, (1280, 720), DARK, 30.0)
        assert differences(trace, other) == ("boat centroid · seed 0", "boat fim · seed 4")
        picture = frames.frame(8).copy()
        again = painter_of([trace, other], (1280, 720), Look(), 30.0).frame(8)
        np.testing.assert_array_equal(picture, again)
        same = Comparison(trace, trace, (1280, 720), DARK, 30.0).frame(8)
        maps = [layout.map for layout in frames._layouts]
        np.testing.assert_array_equal(maps[0].of(picture), maps[0].of(same))
        assert (maps[1].of(picture) != maps[1].of(same)).any()

    def test_curves_are_those_of_the_traces(self):
        traces = synthetic_trace(steps=60), synthetic_trace(steps=60, seed=4)
        frames = Comparison(*traces, (1280, 720), DARK, 30.0)
        delivered = [RunningMetrics.of(which).delivered for which in traces]
        t = int(np.abs(delivered[0] - delivered[1])[:-2].argmax())
        picture, plot = frames.frame(59), frames._plots[0]
        for which, series, colour in zip(traces, delivered, frames._colours, strict=True):
            column = round(float(plot.x(which.time[t])))
            row = round(float(plot.y(float(series[t]))))
            near = picture[row - 2 : row + 3, column - 2 : column + 3].reshape(-1, 3).astype(int)
            assert np.abs(near - colour).sum(1).min() < 60

    def test_every_step_has_its_figures(self):
        frames = Comparison(synthetic_trace(steps=9), synthetic_trace(steps=9, seed=4), (1280, 720), DARK, 30.0)
        first, last = (frames.frame(t).copy() for t in (0, 8))
        for tiles in frames._tiles:
            assert (tiles.of(first) != tiles.of(last)).any()

    def test_missions_that_do_not_run_in_step_are_refused(self, trace):
        scenario = Scenario.load("extreme", ["mission.step=0.5", *("auv.count=2", "nodes.count=30")])
        with pytest.raises(UserError, match=r"mission steps of 1 s and 0\.5 s cannot be compared"):
            Comparison(trace, replace(trace, scenario=scenario), SMALL, DARK, 30.0)
        with pytest.raises(UserError, match=r"tasks data-collection and station-keeping cannot be compared"):
            Comparison(trace, replace(trace, scenario=Scenario.load("station-keeping")), SMALL, DARK, 30.0)


def test_no_command_draws_less_than_it_says():
    assert (*CODECS, ".png") == ENDINGS
