"""What a world was like in its last steps, and at moments between them."""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass

import numpy as np

from usvauv.env.sea.storm import AirySea

KEPT = 900  # states


@dataclass(frozen=True, eq=False)
class Snapshot:
    """World 0 at the end of a mission step: K AUVs, B boats, M nodes.

    Attributes:
        time: since the episode began, s.
        auv, boat, node, estimate: rows of the world's arrays, (K, A), (B, F), (M, N) and (K, E).
        own: where the AUVs take themselves to be, (K, 2), m.
        flow: velocity of the water at cruise level on a grid, (rows, columns, 2), m/s.
        long_waves: elevation on the points of a `SurfaceGrid`, (Y, X), m.
        storm: the short waves, whatever time they were set to last.
    """

    time: float
    auv: np.ndarray
    boat: np.ndarray
    node: np.ndarray
    estimate: np.ndarray
    own: np.ndarray
    flow: np.ndarray
    long_waves: np.ndarray
    storm: AirySea


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
    """The last `KEPT` snapshots, equally far apart."""

    def __init__(self) -> None:
        self._kept: deque[Snapshot] = deque(maxlen=KEPT)

    @property
    def latest(self) -> Snapshot:
        return self._kept[-1]

    @property
    def oldest(self) -> Snapshot:
        return self._kept[0]

    def add(self, snapshot: Snapshot) -> None:
        """Append a snapshot; one of the latest's time takes its place, one of an earlier time begins anew."""
        if self._kept and snapshot.time == self.latest.time:
            self._kept.pop()
        elif self._kept and snapshot.time < self.latest.time:
            self._kept.clear()
        self._kept.append(snapshot)

    def at(self, time: float) -> Moment:
        """The moment of a time, s; the oldest or the latest where it is not kept."""
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
