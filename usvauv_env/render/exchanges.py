"""What is shown of the exchanges between boats and AUVs: pings that run, and who was heard by whom."""

from __future__ import annotations

import math

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.kernels.positioning import usbl

PING_FRAMES = 12  # in which the ring of a ping runs from the boat to the farthest AUV; one begins after another
HEARD_FRAMES = 6.0  # in which the line to an AUV that was heard fades to 1/e


def latest(happened: np.ndarray) -> np.ndarray:
    """Row (T, ...) in which something last happened, for each row of flags (T, ...); −1 before the first."""
    rows = np.arange(len(happened)).reshape(-1, *[1] * (happened.ndim - 1))
    return np.maximum.accumulate(np.where(happened, rows, -1))


def pings(asked: np.ndarray) -> np.ndarray:
    """Row (T,) in which the ring that is shown began, of flags (T,) of exchanges; −1 before the first."""
    shown = np.zeros(len(asked), bool)
    last = -PING_FRAMES
    for row in np.flatnonzero(asked):
        if row - last >= PING_FRAMES:
            shown[row], last = True, row
    return latest(shown)


class Exchanges:
    """Those of world 0 of a trace."""

    def __init__(self, trace: Trace) -> None:
        flags, self._by = trace.fix_flags[:, 0], trace.fix_boat[:, 0]
        self._heard = latest((flags & usbl.DETECTED) > 0)
        boats = np.arange(trace.boat_position.shape[2])
        asked = (((flags & usbl.SILENT) == 0)[..., None] & (self._by[..., None] == boats)).any(axis=1)
        self._pinged = np.stack([pings(by_boat) for by_boat in asked.T], axis=1)

    def ping(self, t: int) -> list[float | None]:
        """For each boat the share of its way that its ping has run in step t; None without one."""
        shares = ((t - self._pinged[t]) / PING_FRAMES).tolist()
        return [
            share if began >= 0 and share < 1 else None
            for began, share in zip(self._pinged[t].tolist(), shares, strict=True)
        ]

    def heard(self, t: int, auv: int) -> tuple[int, float]:
        """The boat that last heard an AUV, and how fresh that is in step t: 1 in that step, 0 if it never was."""
        last = int(self._heard[t, auv])
        return int(self._by[last, auv]), math.exp((last - t) / HEARD_FRAMES) if last >= 0 else 0.0
