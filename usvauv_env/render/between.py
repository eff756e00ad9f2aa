"""What a recorded mission looks like between its steps.

A moment t is a number of steps from the first recorded state: whole numbers are steps, and what is drawn at one is what
was recorded. Between two steps vehicles move on a cubic through the four steps around (Catmull and Rom); estimates,
headings and covariances are linear in time; what is counted or decided keeps the value of the step before.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.scenario import Scenario
from usvauv.env.sea.storm import elevation
from usvauv.kernels.errors import UserError

ROUNDING = 1e-6  # steps


def step_of(t: float) -> int:
    """The step at or before a moment."""
    return int(t + ROUNDING)


def cubic(t: float, count: int) -> list[tuple[int, float]]:
    """Steps around a moment, of `count`, and their weights: ½(1, s, s², s³) times the matrix of Catmull and Rom."""
    step = step_of(t)
    s = t - step
    weights = -s + 2 * s**2 - s**3, 2 - 5 * s**2 + 3 * s**3, s + 4 * s**2 - 3 * s**3, s**3 - s**2
    return [(min(max(step + n, 0), count - 1), 0.5 * w) for n, w in zip(range(-1, 3), weights, strict=True)]


class Series:
    """Numbers (T, …) of the steps, linear between them or `smooth`, as `cubic`."""

    def __init__(self, values: np.ndarray, smooth: bool = False) -> None:
        self.values, self._smooth = values, smooth

    def at(self, t: float) -> np.ndarray:
        """Numbers (…) of a moment."""
        step = step_of(t)
        now, share = self.values[step], t - step
        if share < ROUNDING or step + 1 == len(self.values):
            return now
        if self._smooth:
            return sum((weight * self.values[near] for near, weight in cubic(t, len(self.values))), np.zeros(()))
        return now + share * (self.values[step + 1] - now)

    def until(self, t: float, steps: np.ndarray) -> np.ndarray:
        """Numbers (N, …) of some steps, of which the last is the one before a moment, and of the moment."""
        past = self.values[steps]
        return past if t - steps[-1] < ROUNDING else np.concatenate([past, self.at(t)[None]])


class Vehicle(NamedTuple):
    """A boat, "usv", or an "auv", and its index."""

    kind: str
    index: int

    @classmethod
    def parse(cls, text: str, scenario: Scenario) -> Vehicle:
        """The vehicle named usv, usv:N or auv:N, counted from 1.

        Raises:
            UserError: there is none of that name.
        """
        found = re.fullmatch(r"(usv)(?::([1-9]\d{0,3}))?|(auv):([1-9]\d{0,3})", text)
        kind, number = (found[1] or found[3], int(found[2] or found[4] or 1)) if found else ("", 0)
        boats, auvs = scenario.boat.count, scenario.auv.count
        if not 1 <= number <= (auvs if kind == "auv" else boats):
            allowed = "usv" if boats == 1 else f"usv:1 to usv:{boats}"
            raise UserError(f"follow {text!r}: must be {allowed}, or auv:1 to auv:{auvs}")
        return cls(kind, number - 1)

    def way(self, trace: Trace) -> Series:
        """Its places (2,) in world 0, m."""
        places = trace.auv_position if self.kind == "auv" else trace.boat_position
        return Series(places[:, 0, self.index].astype(float), smooth=True)


class Sea:
    """The recorded surface of a trace.

    At a step it is the recorded one. In between it is the storm, in closed form at that time, and the long waves: the
    recorded surface less the storm, as `cubic`: their periods are many steps long. Without a record of the storm the
    whole surface is interpolated in this way.

    Attributes:
        surface: (T, Y, X) m, row 0 in the south; empty where it was not recorded.
    """

    def __init__(self, trace: Trace) -> None:
        self.surface, self._storm, self._time = trace.surface, trace.storm, trace.time
        area, (_, rows, columns) = trace.scenario.area, trace.surface.shape
        self._x, self._y = ((np.arange(n) + 0.5) * side / n for n, side in ((columns, area.width), (rows, area.length)))
        self._long: dict[int, np.ndarray] = {}  # of the latest steps
        self._shown: tuple[float, np.ndarray] = -1.0, np.zeros((rows, columns), np.float32)

    def at(self, t: float) -> np.ndarray:
        """Elevation (Y, X) float32 at a moment, m; empty where it was not recorded."""
        step = step_of(t)
        if not self.surface.size or t - step < ROUNDING or step + 1 == len(self.surface):
            return self.surface[step] if self.surface.size else self._shown[1]
        if self._shown[0] != t:  # several views show the same moment
            self._shown = t, self._long_waves(t) + elevation(self._storm, self._x, self._y, self._time_of(t))
        return self._shown[1]

    def on(self, t: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Elevation (len(y), len(x)) float32 at a moment on a finer grid of points x and y, m."""
        if not self.surface.size:
            return np.zeros((len(y), len(x)), np.float32)
        columns, rows = (
            ((new - old[0]) / max(old[-1] - old[0], 1e-9) * (len(old) - 1)).astype(np.float32)
            for new, old in ((x, self._x), (y, self._y))
        )
        across, up = np.meshgrid(columns, rows)
        long = cv2.remap(self._long_waves(t), across, up, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return long + elevation(self._storm, x, y, self._time_of(t))

    def _time_of(self, t: float) -> float:
        return float(np.interp(t, np.arange(len(self._time)), self._time))

    def _long_waves(self, t: float) -> np.ndarray:
        """The surface less the storm, (Y, X)."""
        weights = cubic(t, len(self.surface))
        for step, _ in weights:
            if step not in self._long:
                storm = elevation(self._storm, self._x, self._y, float(self._time[step]))
                self._long[step] = self.surface[step] - storm
        self._long = {step: self._long[step] for step, _ in weights}
        return sum((np.float32(weight) * self._long[step] for step, weight in weights), np.zeros((), np.float32))
