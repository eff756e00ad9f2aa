"""Video of a trace: frames drawn by OpenCV, encoded as H.264 in MP4, which browsers play."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import av
import av.container
import av.error
import cv2
import numpy as np
from av.video.reformatter import Colorspace, VideoReformatter

from usvauv_env.files import OutputError, atomic_write
from usvauv_env.memory import require
from usvauv_env.record.trace import Trace
from usvauv_env.render.painter import Painter

SMALLEST, LARGEST = 320, 7680  # pixels a side
FRAME_BYTES = 100.0  # of memory, a pixel of a frame
KEYFRAMES = 250  # frames from one key frame to the next, the encoder's default


@dataclass(frozen=True)
class VideoSummary:
    """What was written.

    Attributes:
        path: of the file. frames: in it. size: width and height, pixels. fps: frames a second.
        seconds: playing time. bytes: size of the file.
        drawing_seconds, encoding_seconds: where the time went.
    """

    path: Path
    frames: int
    size: tuple[int, int]
    fps: int
    seconds: float
    bytes: int
    drawing_seconds: float
    encoding_seconds: float


def render(
    trace: Trace,
    out: str | Path,
    size: tuple[int, int] = (1280, 720),
    fps: int = 30,
    progress: Callable[[int], object] = lambda frames: None,
) -> VideoSummary:
    """Draw world 0 of a trace, one frame a mission step: it plays fps × step times as fast as the mission.

    Args:
        out: MP4 file; it appears only when it is complete.
        size: width and height, pixels; odd numbers are reduced by 1, as yuv420p requires.
        progress: called with 1 after each frame.

    Raises:
        OutputError: the file cannot be written, or the size is out of range.
    """
    out = Path(out)
    width, height = even(size, out)
    frames = len(trace.time)
    if frames == 0:
        raise OutputError(f"{out}: there is nothing to show: the trace has no steps")
    drawing = encoding = 0.0
    with one_drawing_thread(), video_file(out, width, height, fps) as append:
        painter = Painter(trace, (width, height), fps)
        for t in range(frames):
            begin = time.perf_counter()
            picture = painter.frame(t)
            drawn = time.perf_counter()
            append(picture)
            drawing += drawn - begin
            encoding += time.perf_counter() - drawn
            progress(1)
    return VideoSummary(out, frames, (width, height), fps, frames / fps, out.stat().st_size, drawing, encoding)


def even(size: tuple[int, int], out: Path) -> tuple[int, int]:
    """The size with odd numbers reduced by 1, as yuv420p requires.

    Raises:
        OutputError: the size is out of range; the message names the file `out`.
    """
    width, height = (side - side % 2 for side in size)
    if not all(SMALLEST <= side <= LARGEST for side in (width, height)):
        raise OutputError(f"{out}: size {size[0]}x{size[1]}: each side must be from {SMALLEST} to {LARGEST} pixels")
    return width, height


@contextmanager
def one_drawing_thread() -> Iterator[None]:
    """Let OpenCV draw with one thread: small shapes gain nothing from more, and the encoder has threads of its own."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def video_bytes(width: int, height: int) -> float:
    """Estimate of the memory that drawing and encoding a video takes at its peak, bytes: the encoder looks ahead."""
    return 2e7 + FRAME_BYTES * width * height


@contextmanager
def video_file(out: Path, width: int, height: int, fps: int) -> Iterator[Callable[[np.ndarray], None]]:
    """An MP4 file; the function it gives appends a picture (height, width, 3) BGR.

    The file appears at its path when it is complete, and not at all after an error or Ctrl-C. H.264 with the colours of
    BT.709, as players assume for video of this size; two threads beside the drawing one.

    Raises:
        OutputError: the file cannot be written.
        MemoryNeeded: its frames do not fit into memory.
    """
    require(video_bytes(width, height), f"{out}: frames of {width}x{height}")
    with atomic_write(out) as partial:
        container = av.open(str(partial), "w", format="mp4", options={"movflags": "faststart"})
        try:
            stream = _add_stream(container, width, height, fps)
            converter = VideoReformatter()  # one for all frames: setting it up takes longer than using it
            yield lambda picture: container.mux(stream.encode(_convert(picture, converter)))
            container.mux(stream.encode(None))
            container.close()
        except BaseException:
            with suppress(OSError, av.error.FFmpegError):  # the first error is the one to report
                container.close()
            raise


def _add_stream(container: av.container.OutputContainer, width: int, height: int, fps: int) -> av.VideoStream:
    options = {
        "preset": "veryfast",
        "crf": "20",
        "threads": "2",
        "x264-params": "colorprim=bt709:transfer=bt709:colormatrix=bt709",
    }
    stream = container.add_stream("libx264", rate=fps, options=options)
    stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
    return stream


def _convert(picture: np.ndarray, converter: VideoReformatter) -> av.VideoFrame:
    frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
    return converter.reformat(frame, format="yuv420p", dst_colorspace=Colorspace.ITU709)


def expected_bytes(pictures: list[np.ndarray], frames: int, fps: int) -> int:
    """Estimated size of a video of so many frames, by its first pictures: one key frame every `KEYFRAMES` frames."""
    whole, together = _encoded_bytes(pictures[:1], fps), _encoded_bytes(pictures, fps)
    change = (together - whole) / max(len(pictures) - 1, 1)
    return round(whole + change * (frames - 1) + (whole - change) * ((frames - 1) // KEYFRAMES))


def _encoded_bytes(pictures: list[np.ndarray], fps: int) -> int:
    height, width = pictures[0].shape[:2]
    memory, converter = io.BytesIO(), VideoReformatter()
    with av.open(memory, "w", format="mp4") as container:
        stream = _add_stream(container, width, height, fps)
        for picture in pictures:
            container.mux(stream.encode(_convert(picture, converter)))
        container.mux(stream.encode(None))
    return memory.getbuffer().nbytes
