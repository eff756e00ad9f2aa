"""The film of the README, 12 s: the boat in the storm, and two boat strategies side by side in the same world.

    python -m benchmarks.film [--out film.mp4] [--size 1280x720] [--fps 30]

First the boat of `extreme` from beside it, in real time, over its steepest waves. Then `wide` with the boat strategies
`fim` and `belief`, in which an AUV is lit when its boat has heard it, and darkens within `FADE`. Last the data that
AUVs collect with both, of what they collect with perfect fixes: of 100 missions, from docs/data/collaboration.csv,
which `usvauv reproduce collaboration` writes. The ending of the file decides its format, as in `usvauv simulate --out`.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from usvauv import policies
from usvauv.env import Scenario, Trace, World
from usvauv.env.record.recorder import record
from usvauv.env.render import style
from usvauv.env.render.layout import Layout, Rectangle
from usvauv.env.render.mission import HEARD_STEPS, Playback
from usvauv.env.render.style import write
from usvauv.env.render.video import one_drawing_thread, video_file
from usvauv.env.render.views.boat_view import BoatView
from usvauv.env.render.views.map import MissionMap
from usvauv.env.render.views.sea_surface import elevation_limit

WIDTH, HEIGHT = 1280, 720  # pixels that are drawn, before they are reduced
STORM, RACE, END = 4.0, 6.0, 2.0  # s of film
SEARCH = 200  # steps of `extreme`, in which the steepest waves are looked for
DURATION = 720.0  # s of `wide` that are shown
FADE, LOST = 60.0, 300.0  # s in which the light of an AUV fades to 1/e; after which it counts as not heard
SIDES = {"fim": "fim loses them", "belief": "belief finds them"}
MAP = 590  # pixels of a side
RANGE = "slant range of replies, m", "210"  # of `wide`, in the table of results
TABLE = Path(__file__).parents[1] / "docs" / "data" / "collaboration.csv"


def mission(name: str, *overrides: str) -> Trace:
    """A mission with its sea, of seed 0."""
    world = World(Scenario.load(name, list(overrides)), 1, 0, fine_sea=True)
    return record(world, policies.acting("clear", world), "clear", surface=True)


def shares() -> dict[str, float]:
    """Data collected with each boat strategy over that with perfect fixes."""
    with TABLE.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if (row["axis"], row["value"]) == RANGE]
    return {row["boat"]: float(row["share"]) for row in rows}


def storm(fps: float) -> Iterator[np.ndarray]:
    """Pictures of the boat in the middle of its steepest waves."""
    trace = mission("extreme", f"mission.duration={SEARCH}")
    steep = np.hypot(*trace.boat_surface[:, 0, 0, 1:].T)
    step = trace.scenario.mission.step
    edge = math.ceil(0.5 * STORM / step)
    middle = int(steep[edge:-edge].argmax()) + edge
    view = BoatView(Playback(trace), Rectangle(0, 0, WIDTH, HEIGHT), Layout(WIDTH, HEIGHT, 1.6, {}), 0)
    for frame in range(round(STORM * fps)):
        picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        view.draw(picture, middle + (frame / fps - 0.5 * STORM) / step)
        caption(picture, "A boat in a storm hears robots under water", 76, 46)
        yield picture


def caption(picture: np.ndarray, text: str, row: float, size: float, ink: style.Colour = style.WHITE) -> None:
    """Words across the picture, with a shadow."""
    for off, shade in ((3, style.OUTLINE), (0, ink)):
        write(picture, text, (picture.shape[1] / 2 + off, row + off), size, shade, bold=True, anchor="centre")


class Side:
    """The map of a mission in which AUVs are lit."""

    def __init__(self, trace: Trace, left: int, limit: float, words: str, speed_up: float, pace: float) -> None:
        # Neither numbers at AUVs nor streaks of the current, which are small and hard to compress.
        trace = replace(trace, delivered=np.zeros_like(trace.delivered), vortex=np.zeros_like(trace.vortex))
        self._play, self._words, self._step = Playback(trace, pace, speed_up), words, trace.scenario.mission.step
        self._box = Rectangle(left, HEIGHT - MAP - 12, MAP, MAP)
        layout = Layout(WIDTH, HEIGHT, 1.5, {"map": self._box})
        self._map = MissionMap(self._play, layout, limit)

    def draw(self, picture: np.ndarray, t: float) -> None:
        self._map.draw(picture, t)
        region = self._box.of(picture)
        region[:] = (region * np.float32(0.62)).astype(np.uint8)
        since = [self._since(t, auv) for auv in range(self._play.hovering.shape[1])]
        places = self._map.view.pixel(self._play.auvs.at(t)) - self._box[:2]
        light = np.zeros((MAP, MAP, 3), np.float32)
        for auv, ((x, y), seconds) in enumerate(zip(places, since, strict=True)):
            away = (np.arange(MAP) - x) ** 2 + ((np.arange(MAP) - y) ** 2)[:, None]
            fresh = math.exp(-seconds / FADE)
            light += (fresh * np.exp(-away / (2 * 34.0**2)))[..., None] * np.array(style.auv_colour(auv), np.float32)
        region[:] = np.clip(region + light, 0, 255).astype(np.uint8)
        lost = sum(seconds > LOST for seconds in since)
        middle = self._box.left + MAP / 2
        write(picture, self._words, (middle, 50), 44, style.WHITE, bold=True, anchor="centre")
        words = f"not heard for {LOST / 60:g} min: {lost} of {len(since)}"
        write(picture, words, (middle, 100), 34, style.DARK.muted, bold=True, anchor="centre")

    def _since(self, t: float, auv: int) -> float:
        """Time since an AUV was heard, or since the start, s."""
        fresh = self._play.heard(t, auv)[1]
        return self._step * (-HEARD_STEPS * math.log(fresh) if fresh > 0.0 else t)


def race(fps: float) -> Iterator[np.ndarray]:
    """Pictures of both missions, and at the end their data."""
    frames = round(RACE * fps)
    traces = {name: mission("wide", f"boat.strategy={name}", f"mission.duration={DURATION:g}") for name in SIDES}
    limit = max(elevation_limit(trace.surface) for trace in traces.values())
    last = min(len(trace.time) for trace in traces.values()) - 1
    sides = [
        Side(trace, 20 + place * (WIDTH - MAP - 40), limit, words, DURATION / RACE, last / frames)
        for place, (trace, words) in enumerate(zip(traces.values(), SIDES.values(), strict=True))
    ]
    picture = np.full((HEIGHT, WIDTH, 3), style.DARK.background, np.uint8)
    for frame in range(frames):
        picture[:] = style.DARK.background
        for side in sides:
            side.draw(picture, frame * last / frames)
        yield picture
    share, card = shares(), (picture * 0.25).astype(np.uint8)
    caption(card, f"{share['belief']:.0%} of the data", 360, 110, style.colour("#f5ff1a"))
    caption(card, f"with belief, {share['fim']:.0%} with fim", 450, 56)
    caption(card, "mean of 100 missions; perfect fixes: 100%", 525, 40)
    for _ in range(round(END * fps)):
        yield card


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("film.mp4"))
    parser.add_argument("--size", default=f"{WIDTH}x{HEIGHT}")
    parser.add_argument("--fps", type=int, default=30)
    given = parser.parse_args(arguments)
    width, height = map(int, given.size.split("x"))
    with one_drawing_thread(), video_file(given.out, width, height, given.fps) as append:
        for part in (storm, race):
            for picture in part(given.fps):
                append(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA))
    print(f"{given.out}: {STORM + RACE + END:g} s, {given.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
