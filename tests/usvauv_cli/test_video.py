"""The file of a video: its format and its colours, and that it is whole or absent."""

from __future__ import annotations

import av
import numpy as np
import pytest

from tests.usvauv_env.made_traces import paint, synthetic_trace
from usvauv.cli.mission_video import VideoSettings, render
from usvauv.env.render.layout import Layout
from usvauv.env.scenario.sea import Area
from usvauv.env.storage.files import OutputError


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """A trace, its video, what `render` returned, and what it told of its progress."""
    trace = synthetic_trace(steps=12)
    path = tmp_path_factory.mktemp("video") / "mission.mp4"
    told = []
    summary = render([trace], path, VideoSettings((640, 360), 24), told.append)
    return trace, path, summary, told


class TestFile:
    def test_is_what_browsers_play(self, video):
        with av.open(str(video[1])) as file:
            stream = file.streams.video[0]
            codec = stream.codec_context
            assert (codec.name, codec.pix_fmt, codec.width, codec.height) == ("h264", "yuv420p", 640, 360)
            assert stream.average_rate == 24
            assert sum(1 for _ in file.decode(stream)) == 12
        content = video[1].read_bytes()
        assert content.index(b"moov") < content.index(b"mdat")  # starts to play before it is loaded

    def test_summary_and_progress(self, video):
        _, path, summary, told = video
        assert (summary.path, summary.frames, summary.size, summary.fps) == (path, 12, (640, 360), 24)
        assert summary.seconds == pytest.approx(0.5)
        assert summary.bytes == path.stat().st_size
        assert told == [1] * 12
        assert [entry.name for entry in path.parent.iterdir()] == [path.name]

    def test_colours_survive(self, video):
        trace, path, _, _ = video
        with av.open(str(path)) as file:
            frame = next(file.decode(video=0))

        assert frame.colorspace == 1  # the file says that its colours are BT.709's
        blue, green, red = np.moveaxis(paint(trace, 0)[0].astype(float), -1, 0)
        brightness = 16 + 219 / 255 * (0.2126 * red + 0.7152 * green + 0.0722 * blue)  # BT.709
        box = Layout.fit(640, 360, Area()).map
        stored = frame.to_ndarray()[:360]
        assert abs(box.of(stored).mean() - box.of(brightness).mean()) < 1.0

    def test_odd_sizes_become_even(self, tmp_path):
        summary = render([synthetic_trace(steps=2)], tmp_path / "odd.mp4", VideoSettings((483, 361)))
        assert summary.size == (482, 360)
        with av.open(str(tmp_path / "odd.mp4")) as file:
            assert (file.streams.video[0].width, file.streams.video[0].height) == (482, 360)

    @pytest.mark.parametrize("size", [(200, 360), (640, 100), (8000, 4000)])
    def test_impossible_sizes_are_refused(self, tmp_path, size):
        with pytest.raises(OutputError, match=r"mission\.mp4.*size.*320 to 7680"):
            render([synthetic_trace(steps=2)], tmp_path / "mission.mp4", VideoSettings(size))

    @pytest.mark.parametrize("ending", [KeyboardInterrupt, RuntimeError])
    def test_what_is_cut_short_leaves_nothing(self, tmp_path, ending):
        def stop(_: int) -> None:
            raise ending

        with pytest.raises(ending):
            render([synthetic_trace(steps=4)], tmp_path / "mission.mp4", VideoSettings((320, 320)), stop)
        assert list(tmp_path.iterdir()) == []

    def test_an_older_video_outlives_a_failure(self, tmp_path, monkeypatch):
        path = tmp_path / "mission.mp4"
        path.write_bytes(b"older")

        def full_disk(*_: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("usvauv.env.storage.files.os.replace", full_disk)
        with pytest.raises(OutputError, match=r"mission\.mp4: cannot be written: No space left on device"):
            render([synthetic_trace(steps=2)], path, VideoSettings((320, 320)))
        assert path.read_bytes() == b"older"
        assert list(tmp_path.iterdir()) == [path]

    def test_unwritable_places_give_one_line(self, tmp_path):
        (tmp_path / "file").write_text("")
        (tmp_path / "folder.mp4").mkdir()
        before = sorted(tmp_path.rglob("*"))
        for place in ("missing/mission.mp4", "file/mission.mp4", "folder.mp4"):
            with pytest.raises(OutputError) as caught:
                render([synthetic_trace(steps=2)], tmp_path / place, VideoSettings((320, 320)))
            assert str(tmp_path / place) in str(caught.value)
            assert "\n" not in str(caught.value)
        assert sorted(tmp_path.rglob("*")) == before

    def test_one_step(self, tmp_path):
        assert render([synthetic_trace(steps=1)], tmp_path / "one.mp4", VideoSettings((320, 320))).frames == 1
