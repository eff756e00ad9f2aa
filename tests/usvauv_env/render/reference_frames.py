"""Stored pictures of missions, with which tests compare frames.

    python -m tests.usvauv_env.render.reference_frames [--renew]

compares them, or writes them anew. A picture is kept as WebP without loss, its colours rounded to sixteen levels a
channel; differences are those beyond the 8 of 255 that rounding makes. A pixel differs if that of a channel is above
`FAR`. The share of pixels that differ and the mean over all channels have limits; both are 0 where libraries draw as
they did when the pictures were written. Another version of FreeType moves letters by a pixel: with it the limits are
wider, and a symbol in another place is not found.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from matplotlib.ft2font import __freetype_version__

from tests.usvauv_env.record.made_traces import diving, following, keeping_station, synthetic_trace, with_second_boat
from usvauv.env.record.trace import Trace
from usvauv.env.render.frames import frames_of

FOLDER = Path(__file__).with_name("pictures")
FREETYPE = "2.14.3"  # with which the pictures were written
FAR = 16
LIMITS = (5e-4, 0.1) if __freetype_version__ == FREETYPE else (0.1, 8.0)  # share of the pixels, mean
LEVEL = 17  # from one of sixteen levels to the next


class Case(NamedTuple):
    """A frame: of one trace or two, at step t, `reduced` times as large as it is stored."""

    traces: tuple[Trace, ...]
    view: str = "map"
    theme: str = "dark"
    size: tuple[int, int] = (640, 360)
    t: int = 43
    reduced: int = 1
    follow: str = ""


def cases() -> dict[str, Case]:
    """Each picture by its name."""
    mission = synthetic_trace(steps=60, seed=4)
    other = replace(synthetic_trace(steps=50), usv="fim")
    station = keeping_station(mission)
    off = mission.estimate + np.array([7.0, -4.0])
    team = replace(with_second_boat(mission), estimate=off, foreseen_position=off + np.array([10.0, 12.0]))
    missed = replace(mission, fix=np.where(np.arange(60)[:, None, None, None] % 3, np.nan, mission.fix))
    calm = synthetic_trace(steps=60, auvs=1, nodes=1, sea=False, vortices=0)
    crowd = synthetic_trace(steps=60, auvs=16, nodes=500, area=(400.0, 400.0))
    dives = diving(synthetic_trace(steps=120, seed=4))
    wide = synthetic_trace(steps=60, auvs=4, area=(2000.0, 500.0))
    return {
        "map": Case((mission,)),
        "map-light": Case((mission,), theme="light", t=35),
        "map-upright": Case((mission,), size=(360, 640)),
        "map-small": Case((mission,), size=(480, 270)),
        "map-square": Case((mission,), theme="light", size=(480, 480)),
        "map-large": Case((team,), size=(1920, 1080), reduced=3),
        "map-boats": Case((team,), t=12),
        "map-station": Case((station,), theme="light"),
        "map-calm": Case((calm,)),
        "map-crowd": Case((crowd,)),
        "map-wide": Case((wide,), theme="light"),
        "map-dives": Case((dives,), size=(1280, 720), t=90, reduced=2),
        "map-targets": Case((following(synthetic_trace(steps=60, auvs=3, nodes=2, seed=4)),)),
        "sea": Case((missed,), "sea", t=35),
        "sea-boats": Case((team,), "sea", "light", t=12),
        "sea-station": Case((station,), "sea"),
        "sea-upright": Case((mission,), "sea", size=(360, 640)),
        "sea-dives": Case((dives,), "sea", "light", t=100, follow="auv:1"),
        "sea-beside": Case((mission,), "sea", follow="usv"),
        "both": Case((missed,), "both", "light"),
        "both-square": Case((mission,), "both", size=(480, 480)),
        "compared": Case((mission, other)),
        "compared-small": Case((mission, mission), size=(480, 270)),
        "compared-upright": Case((mission, other), theme="light", size=(360, 640)),
        "compared-stations": Case((station, keeping_station(other)), theme="light"),
    }


def drawn(case: Case) -> np.ndarray:
    """The picture of a case as it would be stored, but with all of its levels."""
    frame = frames_of(case.traces, case.size, case.view, case.theme, 30.0, follow=case.follow).frame(case.t)
    stored = case.size[0] // case.reduced, case.size[1] // case.reduced
    return cv2.resize(frame, stored, interpolation=cv2.INTER_AREA)


def differences(name: str, frame: np.ndarray) -> tuple[float, float]:
    """Share of a frame's pixels that differ from the stored picture, and the mean of all channels' differences."""
    stored = cv2.imread(str(FOLDER / f"{name}.webp"))
    assert stored is not None, f"{FOLDER / name}.webp is missing or damaged"
    away = cv2.subtract(cv2.absdiff(frame, stored), np.full_like(frame, LEVEL // 2))
    return float((away.max(-1) > FAR).mean()), float(away.mean())


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--renew", action="store_true", help="write the pictures anew")
    renew = parser.parse_args(arguments).renew
    for name, case in cases().items():
        frame = drawn(case)
        if renew:
            rounded = (np.rint(frame / LEVEL) * LEVEL).astype(np.uint8)
            cv2.imwrite(str(FOLDER / f"{name}.webp"), rounded, [cv2.IMWRITE_WEBP_QUALITY, 101])  # above 100: no loss
        share, mean = differences(name, frame)
        print(f"{name}: {share:.4%} of the pixels differ, {mean:.2f} in the mean")


if __name__ == "__main__":
    main()
