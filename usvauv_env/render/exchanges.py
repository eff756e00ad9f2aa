"""What is shown of the sound between boats and AUVs: when a ping began, when an AUV was heard last."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kernels.positioning import usbl
from usvauv_env.record.trace import Trace
from usvauv_env.render.map import latest, pings


class Exchanges(NamedTuple):
    """Of world 0.

    Attributes:
        heard: (T, K) step in which an AUV was heard last, −1 before the first.
        pinged: (T, B) step in which the ring that is shown of a boat began, −1 before the first.
    """

    heard: np.ndarray
    pinged: np.ndarray

    @classmethod
    def of(cls, trace: Trace) -> Exchanges:
        flags = trace.fix_flags[:, 0]
        by = trace.fix_boat[:, 0, :, None] == np.arange(trace.boat_position.shape[2])
        asked = (((flags & usbl.SILENT) == 0)[..., None] & by).any(axis=1)
        return cls(latest((flags & usbl.DETECTED) > 0), np.stack([pings(boat) for boat in asked.T], axis=1))
