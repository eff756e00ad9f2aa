"""A trace, or two side by side, as a video or as one picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import cv2

from usvauv.cli import encoder
from usvauv.cli.encoder import FORMATS, even, one_drawing_thread, video_file
from usvauv.env.record.trace import Trace
from usvauv.env.render.frames import Frames, Look, painter_of
from usvauv.env.storage.files import OutputError, atomic_write
from usvauv.env.storage.memory import require
from usvauv.kernels.errors import UserError

PICTURE = ".png"
ENDINGS = (*FORMATS, PICTURE)


@dataclass(frozen=True)
class VideoSettings:
    """How a mission is shown.

    Attributes:
        size: width and height, pixels; odd numbers are reduced by 1.
        fps: largest number of frames a second.
        speedup: seconds of mission in a second of video; None shows each mission step for one frame.
        look: view and theme.
        at: moment that a picture shows, s of mission; None for its end.
    """

    size: tuple[int, int] = (1280, 720)
    fps: int = 30
    speedup: float | None = None
    look: Look = field(default_factory=Look)
    at: float | None = None

    def check(self, out: Path) -> None:
        """Refuse what cannot be written, before a mission is simulated.

        Raises:
            UserError: the ending of `out`, or `at` with a video.
            OutputError: the size.
            MemoryNeeded: frames of that size.
        """
        ending = out.suffix.lower()
        if ending not in ENDINGS:
            raise UserError(f"--out {out}: must end in one of {', '.join(ENDINGS)}")
        if self.at is not None and ending != PICTURE:
            raise UserError(f"--at {self.at:g}: is of a picture; --out {out} does not end in {PICTURE}")
        size = even(self.size, out)
        require(encoder.video_bytes(*size), f"--size {size[0]}x{size[1]}")

    def pace(self, step: float) -> tuple[int, Fraction]:
        """Mission steps of `step` seconds from one frame to the next, and frames a second."""
        speedup = self.speedup or self.fps * step
        stride = max(1, math.ceil(speedup / (self.fps * step) - 1e-9))
        return stride, Fraction(speedup / (step * stride)).limit_denominator(1000)


@dataclass(frozen=True)
class VideoSummary:
    """What was written.

    Attributes:
        path: of the file. frames: in it. size: width and height, pixels. fps: frames a second.
        seconds: playing time. bytes: size of the file.
    """

    path: Path
    frames: int
    size: tuple[int, int]
    fps: float
    seconds: float
    bytes: int


def render(
    traces: Sequence[Trace],
    out: str | Path,
    settings: VideoSettings = VideoSettings(),
    progress: Callable[[int], object] = lambda frames: None,
) -> VideoSummary:
    """Draw world 0 of a trace, or of two traces side by side.

    Args:
        traces: one, or two that are compared.
        out: a video of one of `FORMATS`, or a picture; it appears only when it is complete.
        progress: called with 1 after each frame.

    Raises:
        OutputError: the file cannot be written, or the size is out of range.
        UserError: an ending, or a moment, that there is not.
    """
    out = Path(out)
    settings.check(out)
    size, steps, step = even(settings.size, out), _steps(traces), traces[0].scenario.mission.step
    if steps == 0:
        raise OutputError(f"{out}: there is nothing to show: the trace has no steps")
    stride, rate = settings.pace(step)
    with one_drawing_thread():
        painter = painter_of(traces, size, settings.look, float(rate) * stride * step)
        if out.suffix.lower() == PICTURE:
            _picture(painter, out, _moment(traces[0], settings.at, steps))
            progress(1)
        else:
            with video_file(out, *size, rate) as append:
                for t in range(0, steps, stride):
                    append(painter.frame(t))
                    progress(1)
    count = frames(traces, out, settings)
    return VideoSummary(out, count, size, float(rate), count / float(rate), out.stat().st_size)


def frames(traces: Sequence[Trace], out: Path, settings: VideoSettings) -> int:
    """Number of frames of what `render` writes."""
    stride, _ = settings.pace(traces[0].scenario.mission.step)
    return 1 if out.suffix.lower() == PICTURE else -(-_steps(traces) // stride)


def _steps(traces: Sequence[Trace]) -> int:
    """Steps that all traces have."""
    return min(len(trace.time) for trace in traces)


def _moment(trace: Trace, at: float | None, steps: int) -> int:
    """Index of the step that shows a moment."""
    if at is None:
        return steps - 1
    last = float(trace.time[steps - 1])
    if not 0 <= at <= last:
        raise UserError(f"--at {at:g}: the mission is from 0 to {last:g} s")
    return max(0, int(trace.time[:steps].searchsorted(at, "right")) - 1)


def _picture(painter: Frames, out: Path, t: int) -> None:
    with atomic_write(out) as partial:
        partial.write_bytes(cv2.imencode(PICTURE, painter.frame(t))[1].tobytes())
