"""Figures of merit of tracking moving targets, from a trace; the beginning (`settling`) is left out.

An error is the horizontal distance from a target to the team's estimate of it. Source of NEES, the normalised
estimation error squared: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation"
(2001), §5.4.
"""

from __future__ import annotations

import string

import numpy as np

from usvauv.env.record.metrics import Metric, task_metrics
from usvauv.env.record.trace import Trace
from usvauv.env.scenario import Scenario
from usvauv.kernels.mission.tasks.tracking import COVERED

CLOSE = 20.0  # m
TASKS = "tracking", "tracking-plain"


def number(trace: Trace, name: str) -> float:
    """A number of the task in this scenario."""
    return trace.scenario.task_numbers[name]


def letter(target: int) -> str:
    """Name of a moving target: A to Z, then A1 and so on."""
    return string.ascii_uppercase[target % 26] + (str(target // 26) if target >= 26 else "")


def middle_depth(scenario: Scenario) -> float:
    """Depth in the middle of where moving targets may be, m; their own depths are not in a trace."""
    return 0.5 * (scenario.task_numbers["depth_least"] + scenario.task_numbers["depth_most"])


def settled(trace: Trace) -> slice:
    """The steps that count; at least the last one."""
    return slice(min(int(np.searchsorted(trace.time, number(trace, "settling"))), len(trace.time) - 1), None)


def track_error(trace: Trace) -> np.ndarray:
    """Horizontal distance between targets and the team's estimates, (T, W, M), m."""
    return np.linalg.norm(trace.node_estimate - trace.node_way, axis=-1)


def nearest_auv(trace: Trace) -> np.ndarray:
    """Horizontal distance from each target to the nearest AUV, (T, W, M), m."""
    apart = trace.node_way[:, :, None] - trace.auv_position[..., None, :]
    return np.linalg.norm(apart, axis=-1).min(axis=2)


def nees(trace: Trace) -> np.ndarray:
    """e′P⁻¹e of the team's estimates, (T, W, M): 2 in the mean where the covariance P is right; NaN without one."""
    x, y = np.moveaxis((trace.node_estimate - trace.node_way).astype(np.float64), -1, 0)
    xx, xy, yy = np.moveaxis(trace.node_covariance.astype(np.float64), -1, 0)
    determinant = xx * yy - xy**2
    square = yy * x**2 - 2 * xy * x * y + xx * y**2
    return np.divide(square, determinant, out=np.full(square.shape, np.nan), where=determinant > 0)


def _settled(trace: Trace, values: np.ndarray) -> np.ndarray:
    """Values (T, W, M) after the beginning, (W, ·)."""
    return np.moveaxis(values[settled(trace)], 1, 0).reshape(values.shape[1], -1).astype(np.float64)


for _name, _values in {
    "track_error_mean": lambda trace: _settled(trace, track_error(trace)).mean(axis=1),
    "track_error_median": lambda trace: np.median(_settled(trace, track_error(trace)), axis=1),
    "track_error_p95": lambda trace: np.quantile(_settled(trace, track_error(trace)), 0.95, axis=1),
    "track_close": lambda trace: (_settled(trace, track_error(trace)) <= CLOSE).mean(axis=1),  # share of time
    "track_nees": lambda trace: np.nanmean(_settled(trace, nees(trace)), axis=1) / 2,  # 1 where filters are consistent
    "covered": lambda trace: (_settled(trace, nearest_auv(trace)) <= COVERED).mean(axis=1),
    "out_of_range": lambda trace: (_settled(trace, nearest_auv(trace)) > number(trace, "range_most")).mean(axis=1),
}.items():
    task_metrics.register(_name, Metric(TASKS, _values))
