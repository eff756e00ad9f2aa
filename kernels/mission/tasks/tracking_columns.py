"""Columns of tracking's targets, and of the filters that AUVs have of them."""

from typing import Annotated

from usvauv.kernels.mission.columns import (
    Amount,
    AuvOrNone,
    Binary,
    Covariance,
    Duration,
    Position,
    Range,
    StateColumns,
    Turn,
)
from usvauv.kernels.mission.tasks import tracking_places
from usvauv.kernels.tracking.hypotheses import (
    ANYWHERE,
    HEAD_BOUNDS,
    KEPT,
    LEVEL,
    NUMBER,
    SHARE,
    FilterColumn,
    HypothesisColumn,
)


class TargetColumn(StateColumns):
    """A target, and the team's estimate of it, (W, M, ·)."""

    course: Turn  # rad anticlockwise from east
    speed: Annotated[int, Range(0.0, 5.0)]  # through the water, m/s
    depth: Annotated[int, Range(0.0, 1e4)]  # m
    turn_at: Duration  # time of its next turn, s
    known: Binary  # 1 once there is a range of it
    by: AuvOrNone  # the AUV whose estimate is the team's
    estimate_x: Position  # m
    estimate_y: Position
    covariance_xx: Covariance  # m²
    covariance_xy: Covariance
    covariance_yy: Covariance
    error: Amount  # of the team's estimate, horizontal, m
    distance: Amount  # to the nearest AUV, horizontal, m


def _within(names: tuple[str, ...], bounds: tuple[tuple[float, float], ...]) -> dict[str, object]:
    """Annotations of columns with these bounds."""
    return {name: Annotated[int, Range(*both)] for name, both in zip(names, bounds, strict=True)}


def _hypotheses(names: tuple[str, ...]) -> dict[str, object]:
    """Annotations of these columns of all hypotheses."""
    of_all = tuple(f"{name}_{h}" for name in names for h in range(KEPT))
    return _within(of_all, tuple(SHARE if name.startswith("share_") else NUMBER for name in of_all))


class PairColumn(StateColumns):
    """An AUV's filter of a target of known depth, and what it measured in this step, (W, K, M, ·).

    Between the filter's columns: whether it heard the target, the slant range, 0 for none, m, and the bearing, rad.
    """

    __annotations__ = {
        **_within(FilterColumn.names, HEAD_BOUNDS),
        "heard": Binary,
        "measured": Amount,
        "bearing": Turn,
        "unused": Binary,
        **_hypotheses(HypothesisColumn.names[:LEVEL]),
    }


class BoatHearingColumn(StateColumns):
    """What a boat that listens measured of a target in this step, as in `PairColumn`, (W, B, M, ·)."""

    heard: Binary
    measured: Amount
    bearing: Turn


class UncertainPairColumn(PairColumn):
    """Likewise of a target of unknown depth, by AUVs that do not know exactly where they are."""

    __annotations__ = {
        **PairColumn.__annotations__,
        **_hypotheses(HypothesisColumn.names[LEVEL:]),
        **_within(tracking_places.COLUMNS, len(tracking_places.COLUMNS) * (ANYWHERE,)),
    }
