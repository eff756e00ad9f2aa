"""A mission, or two side by side, as a video or a picture; the encoder of all videos.

By the ending of its name a file is H.264 in MP4, VP9 in WebM, GIF, WebP, or one picture in PNG.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import av
import av.error
import av.filter
import cv2
import numpy as np
from av.video.reformatter import Colorspace, VideoReformatter

from usvauv.env.record.trace import Trace
from usvauv.env.render.frames import VIEWS, frames_of
from usvauv.env.render.mission import ROUNDING
from usvauv.env.render.style import THEMES
from usvauv.env.storage.files import OutputError, atomic_write
from usvauv.env.storage.memory import require
from usvauv.kernels.errors import UserError, choices

SMALLEST, LARGEST = 240, 7680  # pixels a side
FRAME_BYTES = 40.0  # of memory, a pixel of a frame
WAITING = 2  # pictures drawn but not yet encoded
BT709 = 1  # FFmpeg's number of its primaries, transfer function and matrix
SEA_SPEED = 4.0  # s of mission per second of video, default of the sea in perspective
SEA_LENGTH = 60.0  # s, longest video at this default


@dataclass(frozen=True)
class Format:
    """A kind of video file.

    Attributes:
        name: FFmpeg's name of the container. codec: FFmpeg's name of the encoder. options: of the encoder. container:
            options of the container. pixels: pixel format of the encoder. matrix: from colours to yuv420p.
        size, fps: default width and height in pixels and frames per second, at most.
        fastest: most frames per second. Times are in 1/100 s in a GIF, else in ms, and browsers show a frame of a GIF
            or WebP for 0.1 s if it has 10 ms or less.
    """

    name: str
    codec: str
    options: dict[str, str]
    container: dict[str, str] = field(default_factory=dict)
    pixels: str = "yuv420p"
    matrix: Colorspace = Colorspace.ITU709
    size: tuple[int, int] = (1280, 720)
    fps: int = 30
    fastest: int = 1000


# A fast preset of H.264; the fastest one has no filter against blocks, and files half as large again. crf is the
# constant rate factor. WebP has whole frames: its encoder of animations keeps blocks of the frame before that have
# changed little, which makes files two thirds as large but leaves a pattern of squares on smooth water.
FORMATS = {
    ".mp4": Format(
        "mp4",
        "libx264",
        {"preset": "superfast", "crf": "24", "threads": "1"},
        {"movflags": "faststart"},
    ),
    ".webm": Format(
        "webm",
        "libvpx-vp9",
        {"deadline": "realtime", "cpu-used": "8", "crf": "32", "b": "0", "row-mt": "1", "threads": "2"},
        {"fflags": "bitexact"},  # no random identifiers
    ),
    ".gif": Format("gif", "gif", {}, pixels="pal8", size=(640, 360), fps=12, fastest=50),
    ".webp": Format(
        "webp",
        "libwebp",
        {"quality": "60", "compression_level": "2"},
        {"loop": "0"},
        matrix=Colorspace.ITU601,  # WebP has no other
        fastest=90,
    ),
}


PICTURE = ".png"
ENDINGS = (*FORMATS, PICTURE)
PALETTE_FRAMES, COLOURS = 24, 128  # frames of a GIF with one palette, of so many colours
LARGE_GIF = 8e6  # bytes from which on a GIF takes long to load in a page


def usual(path: Path) -> tuple[tuple[int, int], int]:
    """Default size and frames per second of a file, at most."""
    kind = FORMATS.get(path.suffix.lower(), FORMATS[".mp4"])
    return kind.size, kind.fps


@dataclass(frozen=True)
class Video:
    """The arguments of `write_video`, described there, checked before a mission is simulated.

    Raises:
        UserError: a value that is not allowed.
        OutputError: the size is out of range.
        MemoryNeeded: frames of that size.
    """

    path: Path
    view: str = "map"
    theme: str = "dark"
    size: tuple[int, int] = (1280, 720)
    fps: int = 30
    speedup: float | None = None
    at: float | tuple[float, float] | None = None
    follow: str = ""

    def __post_init__(self) -> None:
        for name, value, allowed in (("view", self.view, VIEWS), ("theme", self.theme, THEMES)):
            if value not in allowed:
                raise UserError(f"{name} {value!r}: {choices(value, allowed)}")
        begin, end = (self.at, None) if isinstance(self.at, float | int | None) else self.at
        bounds = ("speedup", self.speedup, 0.01), ("at", begin, 0.0), ("at", end, begin or 0.0)
        for name, value, least in bounds:
            if value is not None and not least <= value < math.inf:
                raise UserError(f"{name} {value}: must be at least {least}, and finite")
        ending = self.path.suffix.lower()
        if ending not in ENDINGS:
            raise UserError(f"out {self.path}: must end in one of {', '.join(ENDINGS)}")
        fastest = FORMATS[ending].fastest if ending in FORMATS else math.inf
        if not 1 <= self.fps <= fastest:
            raise UserError(f"fps {self.fps}: must be from 1 to {fastest} in {self.path}")
        if begin is not None and (end is None) != (ending == PICTURE):
            kind = (
                "a picture, which shows one moment" if end is not None else "a video, which takes a stretch, BEGIN:END"
            )
            raise UserError(f"at {begin:g}{'' if end is None else f':{end:g}'}: {self.path} is {kind}")
        width, height = even(self.size, self.path)
        require(video_bytes(width, height), f"size {width}x{height}")

    def speed(self, traces: Sequence[Trace]) -> float:
        """Seconds of mission in a second of video."""
        if self.speedup is not None:
            return self.speedup
        return SEA_SPEED if self._sea(traces) else self.fps * traces[0].scenario.mission.step

    def _sea(self, traces: Sequence[Trace]) -> bool:
        return self.view == "sea" and len(traces) == 1

    @property
    def end(self) -> float | None:
        """Time in the mission of the picture, or of the end of the part shown, s; None: not asked for."""
        return self.at[1] if isinstance(self.at, tuple) else self.at

    def moments(self, traces: Sequence[Trace]) -> np.ndarray:
        """Moments that are shown, one a frame, in steps from the first, up to the end of the shorter trace.

        Raises:
            UserError: `at` lies beyond the mission.
            OutputError: the trace has no steps.
        """
        time, step = traces[0].time[: min(len(trace.time) for trace in traces)], traces[0].scenario.mission.step
        if not len(time):
            raise OutputError(f"{self.path}: there is nothing to show: the trace has no steps")
        begin, end = self.at[0] if isinstance(self.at, tuple) else 0.0, self.end
        if end is not None and end > time[-1]:
            raise UserError(f"at {end:g}: the mission is from 0 to {time[-1]:g} s")
        last = len(time) - 1.0
        if self.path.suffix.lower() == PICTURE:
            return np.array([last if end is None else max(0, int(time.searchsorted(end, "right")) - 1)], float)
        speed = self.speed(traces)
        if end is not None:
            last = max((end - time[0]) / step, 0.0)
        elif self.speedup is None and self._sea(traces):
            last = min(last, SEA_LENGTH * speed / step)
        return np.arange(max((begin - time[0]) / step, 0.0), last + ROUNDING, speed / (self.fps * step))

    def write(self, traces: Sequence[Trace], progress: Callable[[int], object] = lambda frames: None) -> VideoSummary:
        """Draw world 0 of a trace, or of two traces side by side; `progress` is called with 1 after each frame."""
        size, shown, speed = even(self.size, self.path), self.moments(traces), self.speed(traces)
        step, whole = traces[0].scenario.mission.step, self.at is not None or self.speedup is not None
        with one_drawing_thread():
            pace = speed / (self.fps * step)
            frames = frames_of(traces, size, self.view, self.theme, speed, pace, self.follow, float(shown[-1]))
            if self.path.suffix.lower() == PICTURE:
                with atomic_write(self.path) as partial:
                    partial.write_bytes(cv2.imencode(PICTURE, frames.frame(shown[0]))[1].tobytes())
                progress(1)
                whole = True
            else:
                with video_file(self.path, *size, self.fps) as append:
                    for t in shown.tolist():
                        append(frames.frame(t))
                        progress(1)
        mission = float(traces[0].time[-1])
        left = 0.0 if whole else mission - (float(traces[0].time[0]) + float(shown[-1]) * step)
        return VideoSummary(self.path, len(shown), size, self.fps, speed, mission if left > pace * step else 0.0)


@dataclass(frozen=True)
class VideoSummary:
    """A written file: its path, its frames, their width and height in pixels, frames per second, play speed.

    Attributes:
        mission: end of the mission, s, if the video by default shows only its beginning, else 0.
    """

    path: Path
    frames: int
    size: tuple[int, int]
    fps: float
    speedup: float
    mission: float = 0.0

    @property
    def part(self) -> str:
        """Which part of the mission a video shows, and how to see more; empty if it shows all."""
        if not self.mission:
            return ""
        shown = self.frames / self.fps * self.speedup
        return (
            f"the first {shown:.0f} of {self.mission:.0f} s at {self.speedup:g} × speed; --at 0:{self.mission:.0f}"
            " shows all, --speedup another speed"
        )

    @property
    def remark(self) -> str:
        """Why a GIF is larger than `LARGE_GIF`, and how to make it smaller; empty for other files."""
        taken = self.path.stat().st_size
        if self.path.suffix.lower() != ".gif" or taken <= LARGE_GIF:
            return ""
        (width, height), fps = usual(self.path)
        advice = ""
        if self.size[0] * self.size[1] > width * height:
            advice += f"--size {width}x{height} "
        if self.fps > fps:
            advice += f"--fps {fps} "
        advice = advice or f"--speedup {math.ceil(self.speedup * taken / LARGE_GIF):g} "
        of = f"{self.frames} frames of {self.size[0]}x{self.size[1]}"
        return f"{self.path.name} has {taken / 1e6:.0f} MB: a GIF compresses {of} badly; smaller: {advice}or .mp4"


def write_video(
    traces: Trace | Sequence[Trace],
    path: str | Path,
    *,
    view: str = "map",
    theme: str = "dark",
    size: tuple[int, int] | None = None,
    fps: int | None = None,
    speedup: float | None = None,
    at: float | tuple[float, float] | None = None,
    follow: str = "",
    progress: Callable[[int], object] = lambda frames: None,
) -> VideoSummary:
    """Draw world 0 of a mission as a video or as a picture, or two missions side by side.

    The sea is shown if it was recorded: `record(…, surface=True)`. The file appears when it is complete.

    Args:
        traces: one, or two to compare, with the same mission step and task.
        path: of a video, .mp4, .webm, .gif or .webp, or of a picture, .png.
        view: "map" (from above, with plots), "sea" (in perspective) or "both".
        theme: "dark" or "light".
        size: width and height, each from 240 to 7680 pixels; odd numbers are reduced by 1. Default (1280, 720), for a
            GIF (640, 360).
        fps: frames per second, from 1 to 1000, for a GIF to 50, for WebP to 90; default 30, for a GIF 12.
        speedup: seconds of mission per second of video; 1 is real time. Frames between mission steps are interpolated.
            None shows each mission step for one frame, or the sea in perspective at `SEA_SPEED` times real time, the
            first `SEA_LENGTH` s of video.
        at: moment of a picture, s of mission, None for its end; for a video the begin and end of the part shown.
        follow: a vehicle that map and perspective follow at closer range: usv, usv:N or auv:N. A boat is seen in
            perspective from beside it, true to scale.
        progress: called with 1 after each frame.

    Raises:
        UserError: a value that is not allowed, or traces that cannot be compared.
        OutputError: the size is out of range, the trace has no steps, or the file cannot be written.
        MemoryNeeded: frames of that size do not fit into memory.
    """
    traces = [traces] if isinstance(traces, Trace) else list(traces)
    pixels, most = usual(Path(path))
    video = Video(Path(path), view, theme, size or pixels, most if fps is None else fps, speedup, at, follow)
    return video.write(traces, progress)


def even(size: tuple[int, int], out: Path) -> tuple[int, int]:
    """The size with odd numbers reduced by 1, as yuv420p requires.

    Raises:
        OutputError: the size is out of range; the message has the file's name.
    """
    width, height = (side - side % 2 for side in size)
    if not all(SMALLEST <= side <= LARGEST for side in (width, height)):
        raise OutputError(f"{out}: size {size[0]}x{size[1]}: each side must be from {SMALLEST} to {LARGEST} pixels")
    return width, height


@contextmanager
def one_drawing_thread() -> Iterator[None]:
    """Let OpenCV draw with one thread: small shapes gain nothing from more, and the encoder has its own threads."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def video_bytes(width: int, height: int) -> float:
    """Estimated peak memory for drawing and encoding a video, bytes."""
    return 2e7 + FRAME_BYTES * width * height


@contextmanager
def video_file(out: Path, width: int, height: int, fps: Fraction | int) -> Iterator[Callable[[np.ndarray], None]]:
    """A video file; yields a function that appends a picture (height, width, 3) BGR, which it copies.

    The file appears at its path when it is complete, and not at all after an error or Ctrl-C. Another thread converts
    and encodes pictures while the next ones are drawn. If the format allows a choice, colours are those of BT.709, and
    the file states this.

    Args:
        out: its ending is one of `FORMATS`.

    Raises:
        OutputError: the file cannot be written.
        MemoryNeeded: its frames do not fit into memory.
    """
    require(video_bytes(width, height), f"{out}: frames of {width}x{height}")
    kind = FORMATS[out.suffix.lower()]
    with atomic_write(out) as partial, ThreadPoolExecutor(1, "encoder") as thread:
        container = av.open(str(partial), "w", format=kind.name, options=kind.container)
        try:
            stream = container.add_stream(kind.codec, rate=fps, options=kind.options)
            assert isinstance(stream, av.VideoStream)
            stream.width, stream.height, stream.pix_fmt = width, height, kind.pixels
            if kind.matrix == Colorspace.ITU709:
                context = stream.codec_context
                context.colorspace = context.color_primaries = context.color_trc = BT709
            convert = _converter(kind, fps)
            # Frames are reused: the C library does not return the memory of frames made anew each time.
            free = [av.VideoFrame(width, height, "bgr24") for _ in range(WAITING)]
            waiting: deque[Future[av.VideoFrame]] = deque()

            def encode(frame: av.VideoFrame) -> av.VideoFrame:
                container.mux(stream.encode(convert(frame)))
                return frame

            def append(picture: np.ndarray) -> None:
                frame = free.pop() if free else waiting.popleft().result()
                _pixels(frame)[:] = picture
                waiting.append(thread.submit(encode, frame))

            yield append
            for encoded in waiting:
                encoded.result()
            container.mux(stream.encode(None))
            container.close()
        except BaseException:
            thread.shutdown(cancel_futures=True)
            with suppress(OSError, av.error.FFmpegError):  # the first error is the one to report
                container.close()
            raise


def _pixels(frame: av.VideoFrame) -> np.ndarray:
    """Writable view (height, width, 3) of the pixels of a bgr24 frame."""
    plane = frame.planes[0]
    rows = np.frombuffer(memoryview(plane), np.uint8).reshape(frame.height, plane.line_size)
    return rows[:, : 3 * frame.width].reshape(frame.height, frame.width, 3)


def _converter(kind: Format, fps: Fraction | int) -> Callable[[av.VideoFrame], av.VideoFrame]:
    """Function that converts pictures to frames for the encoder."""
    if kind.pixels == "pal8":
        return _palettes(fps)
    # One for all frames: setting it up takes longer than using it.
    return partial(VideoReformatter().reformat, format=kind.pixels, dst_colorspace=kind.matrix)


def _palettes(fps: Fraction | int) -> Callable[[av.VideoFrame], av.VideoFrame]:
    """Function that converts pictures to those of a GIF; `PALETTE_FRAMES` in a row share the first one's palette.

    While the palette stays the same, unchanged pixels cost little.
    """
    tick, numbers = 1 / Fraction(fps), count()
    ends: tuple[Any, Any, Any] = None, None, None

    def with_palette(frame: av.VideoFrame) -> av.VideoFrame:
        nonlocal ends
        frame.pts, frame.time_base = next(numbers), tick
        if frame.pts % PALETTE_FRAMES == 0:
            ends = _paletting(frame, tick)
        ends[0].push(frame)
        shown = ends[1].pull()
        assert isinstance(shown, av.VideoFrame)
        return shown

    return with_palette


def _paletting(frame: av.VideoFrame, tick: Fraction) -> tuple[Any, Any, av.filter.Graph]:
    """Input and output of a graph that gives pictures the palette of a frame, and the graph."""
    making, graph = av.filter.Graph(), av.filter.Graph()
    source = making.add_buffer(width=frame.width, height=frame.height, format=frame.format, time_base=tick)
    making.link_nodes(source, making.add("palettegen", f"max_colors={COLOURS}"), making.add("buffersink")).configure()
    making.push(frame)
    making.push(None)
    palette = making.pull()
    assert isinstance(palette, av.VideoFrame)
    pictures = graph.add_buffer(width=frame.width, height=frame.height, format=frame.format, time_base=tick)
    colours = graph.add_buffer(width=palette.width, height=palette.height, format=palette.format, time_base=tick)
    use, sink = graph.add("paletteuse", "dither=none"), graph.add("buffersink")
    pictures.link_to(use, 0, 0)
    colours.link_to(use, 0, 1)
    use.link_to(sink)
    graph.configure()
    colours.push(palette)
    colours.push(None)
    return pictures, sink, graph
