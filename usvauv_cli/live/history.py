"""States of a world in its last steps and between them, and its sea surface at any of these moments."""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass

import numpy as np
import torch

from usvauv.env.sea.water import AirySea
from usvauv.env.world.world import World

MOST_STATES = 900  # states
POINTS = 104  # at most, on the longer side


@dataclass(frozen=True, eq=False)
class Snapshot:
    """World 0 at the end of a mission step: K AUVs, B boats, M nodes."""

    time: float  # since the episode began, s
    auv: np.ndarray  # rows of the world's arrays: (K, A)
    boat: np.ndarray  # (B, F)
    node: np.ndarray  # (M, N)
    estimate: np.ndarray  # (K, E)
    heading: np.ndarray  # of the boats, (B,), rad, see `usvauv.env.record.headings.turned`; NaN before the first
    depth: np.ndarray  # of the AUVs, (K,), m
    attitude: np.ndarray  # of the AUVs, (K, 3), rad, as in a trace
    fins: np.ndarray  # of the AUVs, (K, 3), rad and 1/s, as in a trace
    own: np.ndarray  # the AUVs' own position estimates, (K, 2), m
    tracked: np.ndarray  # the team's estimates of targets that move, (M, 2), m; (0, 2) without
    flow: np.ndarray  # velocity of the water at cruise level on a grid, (rows, columns, 2), m/s
    long_waves: np.ndarray  # elevation on the points of a `SurfaceGrid`, (Y, X), m
    storm: AirySea  # the short waves, whatever time they were set to last


@dataclass(frozen=True)
class Moment:
    """A time (s) at a share, from 0 to 1, of the way from one snapshot to the next."""

    time: float
    before: Snapshot
    after: Snapshot
    share: float

    def mixed(self, name: str) -> np.ndarray:
        """An array of the snapshots between them; at a snapshot's time exactly its own."""
        before, after = getattr(self.before, name), getattr(self.after, name)
        if self.share in (0.0, 1.0):
            return after if self.share else before
        return before + np.float32(self.share) * (after - before)


class History:
    """The last `MOST_STATES` snapshots, equally spaced in time."""

    def __init__(self) -> None:
        self._kept: deque[Snapshot] = deque(maxlen=MOST_STATES)

    @property
    def latest(self) -> Snapshot:
        return self._kept[-1]

    @property
    def oldest(self) -> Snapshot:
        return self._kept[0]

    def add(self, snapshot: Snapshot) -> None:
        """Append a snapshot; one with the latest's time replaces it, one with an earlier time begins anew."""
        if self._kept and snapshot.time == self.latest.time:
            self._kept.pop()
        elif self._kept and snapshot.time < self.latest.time:
            self._kept.clear()
        self._kept.append(snapshot)

    def at(self, time: float) -> Moment:
        """The moment of a time, s; the oldest or the latest if it is not kept."""
        time = min(max(time, self.oldest.time), self.latest.time)
        if len(self._kept) == 1:
            return Moment(time, self.latest, self.latest, 0.0)
        step = (self.latest.time - self.oldest.time) / (len(self._kept) - 1)
        place = (time - self.oldest.time) / step
        index = min(int(place + 1e-9), len(self._kept) - 2)
        share = min(max(place - index, 0.0), 1.0)
        share = 0.0 if share < 1e-9 else 1.0 if share > 1 - 1e-9 else share
        return Moment(time, self._kept[index], self._kept[index + 1], share)

    def until(self, time: float, count: int) -> list[Snapshot]:
        """The last snapshots up to a time, s, at most `count`, the oldest first."""
        last = next((place for place in reversed(range(len(self._kept))) if self._kept[place].time <= time), 0)
        return list(itertools.islice(self._kept, max(0, last + 1 - count), last + 1))


class SurfaceGrid:
    """Points at which the surface of world 0 is drawn; the outermost lie on the border of the area.

    Attributes:
        x, y: (X,) and (Y,), m.
    """

    def __init__(self, world: World) -> None:
        area, (_, *inner) = world.scenario.area, world.long_waves(POINTS)
        self.x, self.y = (
            np.concatenate([[0.0], places[1:-1], [size]])
            for places, size in zip(inner, (area.width, area.length), strict=True)
        )
        self._storm: AirySea | None = None

    def storm(self, storm: AirySea, time: float) -> np.ndarray:
        """Elevation of the storm of world 0 at a time (s), (Y, X) float32, m.

        As `AirySea.elevation`, in real numbers and by torch: libraries for matrices that wait for a second core would
        take longer than a picture lasts.
        """
        if storm is not self._storm:
            k, direction = storm.k[0], storm.direction[0]
            east, self._north = np.outer(k * np.cos(direction), self.x), np.outer(self.y, k * np.sin(direction))
            self._east = _tensor(np.concatenate([np.cos(east), -np.sin(east)]))
            self._storm = storm
        angle = self._north + (storm.phase[0] - storm.omega[0] * time)
        a = storm.amplitude[0]
        return (_tensor(np.concatenate([a * np.cos(angle), a * np.sin(angle)], axis=1)) @ self._east).numpy()

    def height(self, surface: np.ndarray, place: np.ndarray) -> tuple[float, np.ndarray]:
        """Elevation (m) and slope (2,) of a surface (Y, X) at a place (2,), m, linear between the points."""
        (i, s), (j, t) = (_cell(axis, at) for axis, at in zip((self.x, self.y), place, strict=True))
        corners = surface[j : j + 2, i : i + 2]
        dx, dy = self.x[i + 1] - self.x[i], self.y[j + 1] - self.y[j]
        along_x, along_y = np.array([1 - t, t]) @ corners, corners @ np.array([1 - s, s])
        slope = np.array([(along_x[1] - along_x[0]) / dx, (along_y[1] - along_y[0]) / dy])
        return float(along_x @ np.array([1 - s, s])), slope


def _tensor(numbers: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(numbers.astype(np.float32))


def _cell(axis: np.ndarray, at: float) -> tuple[int, float]:
    """Index of the interval of an axis that holds a number, and the share of the way through it."""
    index = int(np.clip(np.searchsorted(axis, at) - 1, 0, len(axis) - 2))
    return index, float(np.clip((at - axis[index]) / (axis[index + 1] - axis[index]), 0.0, 1.0))
