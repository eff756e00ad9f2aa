"""Which nodes AUVs serve, head for and go to next, as a trace has it."""

from __future__ import annotations

import numpy as np

from usvauv.env.record.trace import Trace

NEXT = 3  # nodes of an AUV that are shown beyond the one it heads for


class Itinerary:
    """Targets of world 0 of a trace."""

    def __init__(self, trace: Trace) -> None:
        self._target, self._hovering = trace.target[:, 0], trace.hovering[:, 0]

    def node(self, t: int, auv: int) -> int:
        """The node an AUV serves or heads for."""
        return int(self._target[self._decided(t, auv), auv])

    def after(self, t: int, auv: int) -> list[int]:
        """The nodes an AUV went to after the one it serves or heads for, at most `NEXT`."""
        target = self._target[self._decided(t, auv) :, auv]
        return target[1:][np.diff(target) != 0][:NEXT].tolist()

    def _decided(self, t: int, auv: int) -> int:
        """A step with the target of step t: in the last step of a service the target is already the next node."""
        return t - 1 if self._hovering[t, auv] and t > 0 else t
