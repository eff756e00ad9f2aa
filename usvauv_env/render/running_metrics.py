"""Figures shown at each step of a trace: metrics so far, fix errors, headings, progress of services."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usvauv.env.record.metrics import energy_consumption, position_error, target_distance
from usvauv.env.record.trace import Trace

MEDIAN_WINDOW = 30.0  # s


@dataclass(frozen=True)
class RunningMetrics:
    """Series of world 0, T steps, K AUVs and B boats.

    Attributes:
        sdr: (T,) sum of the data rates of all services so far, Mbit/s.
        ec: (T,) mean over AUVs of energy so far/(time − hovering time), W; see `nodes.hovering_time`.
        services: (T,) completed so far. delivered: (T,) Mbit so far. full_now: (T,) nodes losing packets in this step.
        position_error: (T, K) horizontal distance from the true position to the estimate, m.
        error_median: (T, K) its median over the last 30 s.
        off_target: (T,) mean over AUVs of the distance to the target, m. power: (T,) of the AUVs together, W.
        reward: (T, R) terms of the reward a step, summed over AUVs, mean of the last 30 s.
        heading: (T, K) of the AUVs, boat_heading: (T, B) of the boats, anticlockwise from east, rad.
        service_share: (T, K) completed part of the service under way, 0 when travelling.
    """

    sdr: np.ndarray
    ec: np.ndarray
    services: np.ndarray
    delivered: np.ndarray
    full_now: np.ndarray
    position_error: np.ndarray
    error_median: np.ndarray
    off_target: np.ndarray
    power: np.ndarray
    reward: np.ndarray
    heading: np.ndarray
    boat_heading: np.ndarray
    service_share: np.ndarray

    @classmethod
    def of(cls, trace: Trace) -> RunningMetrics:
        step = trace.scenario.mission.step
        rate = trace.service_rate[:, 0].astype(float)
        hovering = trace.hovering[:, 0].astype(bool)
        error = position_error(trace)[:, 0].astype(float)
        moves = np.diff(trace.boat_position[:, 0].astype(float), axis=0, prepend=trace.boat_position[:1, 0])
        return cls(
            sdr=np.cumsum(rate.sum(axis=1)),
            ec=energy_consumption(trace)[:, 0],
            services=np.cumsum((rate > 0).sum(axis=1)),
            delivered=np.cumsum(trace.delivered[:, 0].astype(float).sum(axis=1)),
            full_now=trace.overflowing[:, 0],
            position_error=error,
            error_median=_running_median(error, max(1, round(MEDIAN_WINDOW / step))),
            off_target=target_distance(trace)[:, 0].mean(axis=1),
            power=trace.power[:, 0].sum(axis=1),
            reward=_smooth(trace.reward_terms[:, 0].sum(axis=1, dtype=float), max(1, round(MEDIAN_WINDOW / step))),
            heading=_heading(trace.auv_velocity[:, 0], 1e-3),
            boat_heading=_heading(_smooth(moves, 5), 0.02 * step),
            service_share=_service_share(hovering, rate > 0),
        )


def figures(trace: Trace, running: RunningMetrics, t: int) -> list[tuple[str, float, str]]:
    """Figures of step t: name with unit, value, and how it is written (a format specification)."""
    if trace.scenario.task == "station-keeping":
        return [
            ("off station, m", running.off_target[t], ".2f"),
            ("in the mean, m", running.off_target[: t + 1].mean(), ".2f"),
            ("power now, W", running.power[t], ".0f"),
            ("EC, W", running.ec[t], ".1f"),
            ("AUVs too close", trace.collisions[: t + 1, 0].sum(), ".0f"),
        ]
    return [
        ("SDR, Mbit/s", running.sdr[t], ".2f"),
        ("EC, W", running.ec[t], ".1f"),
        ("services", running.services[t], ".0f"),
        ("delivered, Mbit", running.delivered[t], ".1f"),
        ("full nodes", running.full_now[t], ".0f"),
    ]


def _running_median(series: np.ndarray, window: int) -> np.ndarray:
    """Median of the last `window` rows, of fewer at the start."""
    window = min(window, len(series))
    start = [np.median(series[: t + 1], axis=0) for t in range(window - 1)]
    rest = np.median(np.lib.stride_tricks.sliding_window_view(series, window, axis=0), axis=-1)
    return np.concatenate([np.reshape(start, (window - 1, series.shape[1])), rest])


def _smooth(series: np.ndarray, window: int) -> np.ndarray:
    """Mean of the last `window` rows, of fewer at the start."""
    total = np.cumsum(series, axis=0)
    late = total.copy()
    late[window:] -= total[:-window]
    count = np.minimum(np.arange(1, len(series) + 1), window)
    return late / count.reshape(-1, *[1] * (series.ndim - 1))


def _heading(velocity: np.ndarray, least: float) -> np.ndarray:
    """Direction (T, K) of vectors (T, K, 2); vectors shorter than `least` keep the previous direction."""
    angle = np.arctan2(velocity[..., 1], velocity[..., 0])
    moving = np.hypot(velocity[..., 0], velocity[..., 1]) > least
    last = np.maximum.accumulate(np.where(moving, np.arange(len(angle))[:, None], -1), axis=0)
    first = np.where(moving.any(axis=0), moving.argmax(axis=0), 0)
    return np.take_along_axis(angle, np.where(last < 0, first, last), axis=0)


def _service_share(hovering: np.ndarray, completed: np.ndarray) -> np.ndarray:
    """Completed part of each service (T, K), from the first hovering step to the last."""
    share = np.zeros(hovering.shape)
    for auv in range(hovering.shape[1]):
        begin = None
        for t in range(len(hovering)):
            if not hovering[t, auv]:
                begin = None
                continue
            begin = t if begin is None else begin
            ends = completed[t, auv] or t + 1 == len(hovering) or not hovering[t + 1, auv]
            if ends:
                share[begin : t + 1, auv] = np.arange(1, t - begin + 2) / (t - begin + 1)
                begin = None
    return share
