"""What each column of a mission's state may hold: for states that are loaded, and to see a runaway state at once.

A column that is missing here is an error at import.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from usvauv.kernels.flow.vortex import Vortex
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BeliefColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    NodeColumn,
    Reply,
    TallyColumn,
)
from usvauv.kernels.positioning import tracker, usbl
from usvauv.kernels.types import Columns


class Range(NamedTuple):
    """Allowed values, bounds included; a bound that is a name is one of `resolve`'s numbers. `whole`: no fractions."""

    low: float | str
    high: float | str
    whole: bool = False


X, Y = Range(0.0, "width"), Range(0.0, "length")
LENGTH = Range(-1e12, 1e12)  # a fix that is none can lie anywhere
VARIANCE = Range(-1e25, 1e25)
VELOCITY = Range(-100.0, 100.0)
MOVED = Range(-1e6, 1e6)
AMOUNT = Range(0.0, 1e12)  # of packets, Mbit or Mbit/s
FLAG = Range(0.0, 1.0, whole=True)

NAMED: dict[str, Range] = {
    "x": X,
    "y": Y,
    "water_x": VELOCITY,
    "water_y": VELOCITY,
    "current_x": VELOCITY,
    "current_y": VELOCITY,
    "target": Range(0.0, "last_target", whole=True),
    "hover": Range(0.0, 1e30),
    **dict.fromkeys(("hovers", "sent_hovers"), Range(0.0, 1e30)),
    **dict.fromkeys(("heads_for", "sent_heads_for"), Range(0.0, "last_target", whole=True)),
    "rate": AMOUNT,
    "cargo": AMOUNT,
    "covariance_xx": VARIANCE,
    "covariance_xy": VARIANCE,
    "covariance_yy": VARIANCE,
    "fix_x": LENGTH,
    "fix_y": LENGTH,
    "heard_x": LENGTH,
    "heard_y": LENGTH,
    "fix_flags": Range(0.0, usbl.FLAGS, whole=True),
    "moved_x": MOVED,
    "moved_y": MOVED,
    "closed": MOVED,
    "power": Range(0.0, 1e4),
    "hovering": FLAG,
    "service_rate": AMOUNT,
    "delivered": AMOUNT,
    "packets_delivered": AMOUNT,
    "border": FLAG,
    "position_error": Range(0.0, 1e12),
    "age": Range(0.0, 1e8),
    "separation": Range(-1e3, 2e4),
    "backlog": Range(0.0, 1e8),
    "kind": Range(0.0, "last_kind", whole=True),
    "tour": Range(0.0, "last_target", whole=True),
    "successor": Range(0.0, "last_target", whole=True),
    "owner": Range(0.0, "last_auv", whole=True),
    "count": AMOUNT,
    "exposure": Range(0.0, 1e12),
    "since": Range(0.0, 1e8),
    "left": AMOUNT,
    "goal_x": X,
    "goal_y": Y,
    "elevation": Range(-500.0, 500.0),
    "slope_x": Range(-1e3, 1e3),
    "slope_y": Range(-1e3, 1e3),
    "effort": Range(0.0, 1.001),
    "gnss_x": Range(-1e3, 1e3),
    "gnss_y": Range(-1e3, 1e3),
    "overflowing": Range(0.0, "targets"),
    "collisions": Range(0.0, 1e3),
    "packets_created": AMOUNT,
    "packets_lost": AMOUNT,
    "channel_free": Range(-1e8, 1e8),
    "next_ping": Range(-1e8, 1e8),
    **dict.fromkeys(("served_by", "fix_boat", "asking"), Range(0.0, "last_boat", whole=True)),
    "asked": Range(-1.0, "last_auv", whole=True),
    "visits": Range(-1.0, "last_auv", whole=True),
    "speed": Range(0.0, 100.0),
    "planned": Range(0.0, 1e8),
    "over": FLAG,
    "reply": Range(0.0, float(len(Reply.names) - 1), whole=True),
    "reply_at": Range(-1e8, 1e8),
    **{f"{part}{axis}": LENGTH for part in ("sent_", "step_", "way_", "sent_way_") for axis in "xy"},
    **{f"{part}{axis}": VELOCITY for part in ("bias_", "velocity_", "sent_velocity_") for axis in "xy"},
    **dict.fromkeys(("step_adrift", "adrift", "elapsed", "sent_adrift", "sent_elapsed"), Range(-1.0, 1e8)),
    "Gamma": Range(-1e5, 1e5),
    "delta": Range(0.0, 1e6),
}
# Where a name means something else.
ESTIMATE = {"x": LENGTH, "y": LENGTH}
VORTEX = {"x": LENGTH, "y": LENGTH}

State = dict[str, tuple[tuple[str, Range], ...]]


def _of(columns: type[Columns], other: Mapping[str, Range]) -> tuple[tuple[str, Range], ...]:
    table = {**NAMED, **other}
    if missing := [name for name in columns.names if name not in table]:
        raise AssertionError(f"kernels/mission/state_ranges.py: no range for {columns.__name__} {', '.join(missing)}")
    return tuple((name, table[name]) for name in columns.names)


# Name of the array → name and range of each of its columns, in order.
STATE: State = {
    "auv": _of(AuvColumn, {}),
    "estimate": _of(EstimateColumn, ESTIMATE),
    "node": _of(NodeColumn, {}),
    "belief": _of(BeliefColumn, {}),
    "vortex": _of(Vortex, VORTEX),
    "boat": _of(BoatColumn, {}),
    "tally": _of(TallyColumn, {}),
    "track": tuple((f"track {column}", VARIANCE) for column in range(tracker.COLUMNS)),
    "own": tuple((f"own track {column}", VARIANCE) for column in range(tracker.COLUMNS)),
    "exchange": _of(ExchangeColumn, {}),
    "foresight": _of(ForesightColumn, {}),
}
ANYTHING = 1e12  # bound of what has no table: an observation, a reward
LARGEST = max(float(b) for table in STATE.values() for _, r in table for b in (r.high,) if not isinstance(b, str))


def resolve(numbers: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Bounds of each array's columns, (2, columns) float64: low, high.

    Args:
        numbers: "width", "length" (m), and the counts "targets", "last_target", "last_auv", "last_boat", "last_kind".
    """

    def number(bound: float | str) -> float:
        return numbers[bound] if isinstance(bound, str) else bound

    return {
        name: np.array([[number(allowed.low) for _, allowed in table], [number(allowed.high) for _, allowed in table]])
        for name, table in STATE.items()
    }
