"""Missions as files: formats by ending, colours, play speed, one moment as a picture; a file is whole or absent."""

from __future__ import annotations

import os

import av
import cv2
import numpy as np
import pytest

from tests.usvauv_env.record.made_traces import paint, synthetic_trace
from usvauv import write_video
from usvauv.env.render.frames import frames_of
from usvauv.env.render.layout import Rectangle
from usvauv.env.render.video import Video, VideoSummary
from usvauv.env.storage.files import OutputError
from usvauv.kernels.errors import UserError

SMALL = (320, 320)
CODECS = {".mp4": "h264", ".webm": "vp9", ".gif": "gif", ".webp": "webp"}


@pytest.fixture(scope="module")
def trace():
    return synthetic_trace(steps=12)


@pytest.fixture(scope="module")
def mission():
    return synthetic_trace(steps=300)


def decoded(path) -> list[np.ndarray]:
    """Pictures of a file, BGR."""
    if path.suffix == ".webp":  # FFmpeg reads no animated WebP
        from PIL import Image

        with Image.open(path) as file:
            pictures = []
            for place in range(file.n_frames):
                file.seek(place)
                pictures.append(np.asarray(file.convert("RGB"))[..., ::-1])
            return pictures
    with av.open(str(path)) as file:
        codec = file.streams.video[0].codec_context.name
        assert codec in (CODECS[path.suffix], f"lib{CODECS[path.suffix]}", "libvpx-vp9")
        return [frame.to_ndarray(format="bgr24") for frame in file.decode(video=0)]


def shown_for(path) -> list[float]:
    """How long each picture of a file is shown, s."""
    if path.suffix in (".gif", ".webp"):
        from PIL import Image, ImageSequence

        with Image.open(path) as file:
            return [each.convert("RGB") and each.info["duration"] / 1000 for each in ImageSequence.Iterator(file)]
    with av.open(str(path)) as file:
        starts = [float(packet.pts * packet.time_base) for packet in file.demux(video=0) if packet.pts is not None]
        return [*np.diff(sorted(starts)), 1.0]  # pictures between two others come after them


class TestContent:
    @pytest.mark.parametrize("ending", CODECS)
    def test_each_ending_has_its_format_and_shows_the_frames_in_their_order(self, tmp_path, trace, ending):
        """To what the kind of file loses; and the same frames make the same file."""
        path, again = tmp_path / f"mission{ending}", tmp_path / f"again{ending}"
        summary = write_video(trace, path, size=(480, 360), fps=10)
        shown = decoded(path)
        assert len(shown) == summary.frames == 12
        frames = frames_of([trace], (480, 360), speed_up=10.0)
        for t, picture in enumerate(shown):
            assert np.abs(picture.astype(float) - frames.frame(t)).mean() < 5.0
        write_video(trace, again, size=(480, 360), fps=10)
        assert again.read_bytes() == path.read_bytes()

    def test_an_mp4_is_what_browsers_play_in_the_colours_that_it_says(self, tmp_path, trace):
        path, told = tmp_path / "mission.mp4", []
        summary = write_video([trace], str(path), size=(640, 360), fps=24, progress=told.append)
        assert (summary.path, summary.frames, summary.size, summary.fps) == (path, 12, (640, 360), 24)
        assert told == [1] * 12
        assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
        content = path.read_bytes()
        assert content.index(b"moov") < content.index(b"mdat")  # starts to play before it is loaded
        with av.open(str(path)) as file:
            stream = file.streams.video[0]
            codec = stream.codec_context
            assert (codec.pix_fmt, codec.width, codec.height, stream.average_rate) == ("yuv420p", 640, 360, 24)
            frame = next(file.decode(video=0))
        assert frame.colorspace == 1  # the file says that its colours are BT.709's
        blue, green, red = np.moveaxis(paint(trace, 0)[0].astype(float), -1, 0)
        brightness = 16 + 219 / 255 * (0.2126 * red + 0.7152 * green + 0.0722 * blue)  # BT.709
        box = Rectangle(40, 50, 240, 240)
        assert abs(box.of(frame.to_ndarray()[:360]).mean() - box.of(brightness).mean()) < 1.0

    def test_a_picture_is_the_frame_of_its_moment(self, tmp_path, trace):
        path = tmp_path / "moment.png"
        for at, t in ((None, 11), (3.9, 2), (0.0, 0), (12.0, 11)):
            assert write_video(trace, path, size=SMALL, at=at).frames == 1
            np.testing.assert_array_equal(
                cv2.imread(str(path)), frames_of([trace], SMALL, speed_up=30.0, end=t).frame(t)
            )

    @pytest.mark.parametrize(
        ("options", "first", "pace", "count"),
        [
            ({}, 0, 1.0, 300),
            ({"view": "both", "fps": 12}, 0, 1.0, 300),
            ({"speedup": 1.0}, 0, 1 / 30, 299 * 30 + 1),
            ({"speedup": 45.0}, 0, 1.5, 200),
            ({"speedup": 20.0, "fps": 10, "at": (11.0, 21.0)}, 10, 2.0, 6),
            ({"view": "sea"}, 0, 4 / 30, 1801),
            ({"view": "sea", "at": (0.0, 300.0)}, 0, 4 / 30, 2243),
            ({"view": "sea", "speedup": 30.0}, 0, 1.0, 300),
        ],
    )
    def test_moments(self, tmp_path, mission, options, first, pace, count):
        """The mission has 300 steps of 1 s; the sea is shown 4 times faster than it is, for a minute."""
        moments = Video(tmp_path / "x.mp4", **options).moments([mission])
        np.testing.assert_allclose(moments, first + pace * np.arange(count), atol=1e-9)

    def test_a_video_of_the_beginning_alone_says_so(self, tmp_path, mission):
        short = Video(tmp_path / "x.mp4", "sea", size=SMALL, fps=1)
        assert short.write([mission]).part == (
            "the first 244 of 300 s at 4 × speed; --at 0:300 shows all, --speedup another speed"
        )
        assert Video(tmp_path / "x.mp4", "sea", size=SMALL, fps=1, at=(0, 20)).write([mission]).part == ""

    def test_odd_sizes_become_even_and_one_step_is_enough(self, tmp_path):
        summary = write_video(synthetic_trace(steps=1), tmp_path / "odd.mp4", size=(483, 361))
        assert (summary.frames, summary.size) == (1, (482, 360))
        assert decoded(tmp_path / "odd.mp4")[0].shape == (360, 482, 3)


class TestGif:
    def test_eight_seconds_take_less_than_eight_megabytes(self, tmp_path, trace):
        summary = write_video(trace, tmp_path / "mission.gif", speedup=30.0)
        assert summary.size == (640, 360)
        assert summary.fps <= 12
        assert (tmp_path / "mission.gif").stat().st_size / summary.frames * 8 * summary.fps < 8e6
        assert summary.remark == ""

    @pytest.mark.parametrize(
        ("size", "fps", "speedup", "advice"),
        [
            ((1280, 720), 30.0, 30.0, "--size 640x360 --fps 12 or .mp4"),
            ((640, 360), 10.0, 20.0, "--speedup 60 or .mp4"),
        ],
    )
    def test_a_larger_one_says_why_and_what_to_do(self, tmp_path, size, fps, speedup, advice):
        for ending in (".gif", ".mp4"):
            path = tmp_path / f"mission{ending}"
            path.touch()
            os.truncate(path, 24_000_000)
            remark = VideoSummary(path, 240, size, fps, speedup).remark
            assert remark.endswith(advice if ending == ".gif" else "")
            assert remark.startswith("mission.gif has 24 MB: " if ending == ".gif" else "")
            assert "\n" not in remark


class TestFile:
    @pytest.mark.parametrize(
        ("out", "options", "message"),
        [
            ("x.avi", {}, "out x.avi: must end in one of .mp4, .webm, .gif, .webp, .png"),
            ("x.mp4", {"at": 3.0}, "at 3: x.mp4 is a video, which takes a stretch, BEGIN:END"),
            ("x.png", {"at": (3.0, 4.0)}, "at 3:4: x.png is a picture, which shows one moment"),
            ("x.png", {"at": 13.0}, "at 13: the mission is from 0 to 12 s"),
            ("x.mp4", {"theme": "pink"}, "theme 'pink': allowed are dark, light"),
            ("x.gif", {"fps": 51}, "fps 51: must be from 1 to 50 in x.gif"),
            ("x.mp4", {"size": (200, 360)}, "x.mp4: size 200x360: each side must be from 240 to 7680"),
        ],
    )
    def test_what_there_is_not_is_refused_and_leaves_nothing(self, tmp_path, monkeypatch, trace, out, options, message):
        monkeypatch.chdir(tmp_path)
        with pytest.raises(UserError) as caught:
            write_video(trace, out, **options)
        assert str(caught.value).startswith(message)
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize(("ending", "fps"), [(".gif", 50), (".webp", 90), (".mp4", 1000), (".webm", 1000)])
    def test_the_fastest_video_plays_at_its_speed(self, tmp_path, trace, ending, fps):
        """Browsers show a picture of a GIF or WebP for 0.1 s if its own time is 10 ms or less."""
        path = tmp_path / f"x{ending}"
        write_video(trace, path, size=SMALL, fps=fps)
        times = shown_for(path)
        assert len(times) == 12
        assert sum(times[:-1]) == pytest.approx(11 / fps, abs=1e-3)
        assert min(times) > (0.01 if ending in (".gif", ".webp") else 0)

    def test_an_older_video_outlives_a_failure(self, tmp_path, trace, size_limit):
        path = tmp_path / "mission.mp4"
        path.write_bytes(b"older")
        with size_limit(), pytest.raises(OutputError, match=r"mission\.mp4: cannot be written"):
            write_video(trace, path, size=SMALL)
        assert path.read_bytes() == b"older"
        assert list(tmp_path.iterdir()) == [path]
