"""Figures of merit of tracking moving targets, from a trace; the beginning (`settling`) is left out.

An error is the horizontal distance from a target to the team's estimate of it; beside it stands the least one with
which any estimator could track the targets on their ways, from the AUVs' and boats' ways (`least_error`). Source of
NEES, the normalised estimation error squared: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking
and Navigation" (2001), §5.4.
"""

from __future__ import annotations

import string
from collections.abc import Mapping

import numpy as np

from usvauv.env.record.metrics import Metric, task_metrics
from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_bound import bearing_information, range_information, rms, tracking_bound
from usvauv.env.scenario import Scenario
from usvauv.kernels.mission.tasks.tracking import COVERED

CLOSE = 20.0  # m
TOGETHER = 16  # worlds whose bounds are computed together
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


def least_error(trace: Trace, depth: np.ndarray | None = None) -> np.ndarray:
    """Posterior Cramér–Rao bound of the targets' rms errors, for the ways in a trace, (T, W, M), m.

    It is that of an estimator which has each measurement that is not lost, and is told where AUVs are, how the water
    flows and when and how targets turn. Velocities walk as much as by the targets' courses, but in both axes.

    Args:
        depth: of the targets, (W, M), m; else the middle of where they may be.
    """
    if depth is None:
        depth = np.full(trace.node_position.shape[:2], middle_depth(trace.scenario))
    parts = range(0, depth.shape[0], TOGETHER)
    return np.concatenate([_least(trace, slice(w, w + TOGETHER), depth[w : w + TOGETHER]) for w in parts], axis=1)


def _least(trace: Trace, worlds: slice, depth: np.ndarray) -> np.ndarray:
    """`least_error` in some worlds."""
    given, scenario, step = trace.scenario.task_numbers, trace.scenario, trace.scenario.mission.step
    target = np.concatenate([way := trace.node_way[:, worlds], np.broadcast_to(depth, way.shape[:-1])[..., None]], -1)
    seen = np.concatenate([trace.auv_position[:, worlds], trace.depth[:, worlds, :, None]], -1)
    if given.get("boat_listens"):
        seen = np.concatenate([seen, np.pad(trace.boat_position[:, worlds], ((0, 0),) * 3 + ((0, 1),))], 2)
    known = 2 if given.get("depths_known", 1.0) else 3
    J = np.zeros((*way.shape[:-1], known, known))
    for observer in np.moveaxis(seen, 2, 0)[:, :, :, None].astype(np.float64):
        J += _information(given, observer, target)[..., :known, :known]
    last = np.floor(np.append(trace.time[0] - step, trace.time) / given["interval"] + 1e-4)
    J *= (np.diff(last) > 0)[:, None, None, None, None]
    slowest, fastest = given["target_speed_least"], given["target_speed_most"]
    velocity = (slowest**2 + slowest * fastest + fastest**2) / 6
    sides = np.array([scenario.area.width, scenario.area.length]) - 2 * scenario.nodes.margin
    prior = [*(sides**2 / 12), velocity, velocity, (given["depth_most"] - given["depth_least"]) ** 2 / 12]
    walk = np.sqrt(velocity * step) * given["course_walk"]
    bound = tracking_bound(np.moveaxis(J, 0, -3), np.diag(prior[: known + 2]), step, walk)
    return np.moveaxis(rms(bound), -1, 0)


def _information(given: Mapping[str, float], observer: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Information of what observers at places (..., 3) measure in the mean of targets (likewise), (..., 3, 3), 1/m²."""
    slant = np.linalg.norm(target - observer, axis=-1)
    share = (slant <= given["range_most"]) * (1 - given["range_loss"])
    if given["signal_excess"]:
        excess = given["signal_excess"] - 20 * np.log10(np.maximum(slant, 1)) - given["absorption"] * slant / 1000
        share = share * np.exp(-(10 ** (-excess / 10)))
    J = np.zeros((*slant.shape, 3, 3))
    if given["ranges"]:
        J += range_information(observer, target, given["range_noise"])
    if given["bearing_noise"]:
        J[..., :2, :2] += bearing_information(observer[..., :2], target[..., :2], given["bearing_noise"])
    return share[..., None, None] * J


def _settled(trace: Trace, values: np.ndarray) -> np.ndarray:
    """Values (T, W, M) after the beginning, (W, ·)."""
    return np.moveaxis(values[settled(trace)], 1, 0).reshape(values.shape[1], -1).astype(np.float64)


for _name, _values in {
    "track_error_mean": lambda trace: _settled(trace, track_error(trace)).mean(axis=1),
    "track_error_median": lambda trace: np.median(_settled(trace, track_error(trace)), axis=1),
    "track_error_p95": lambda trace: np.quantile(_settled(trace, track_error(trace)), 0.95, axis=1),
    "track_error_rms": lambda trace: np.sqrt(np.square(_settled(trace, track_error(trace))).mean(axis=1)),
    "track_bound": lambda trace: np.sqrt(np.square(_settled(trace, least_error(trace))).mean(axis=1)),
    "track_close": lambda trace: (_settled(trace, track_error(trace)) <= CLOSE).mean(axis=1),  # share of time
    "track_nees": lambda trace: np.nanmean(_settled(trace, nees(trace)), axis=1) / 2,  # 1 where filters are consistent
    "covered": lambda trace: (_settled(trace, nearest_auv(trace)) <= COVERED).mean(axis=1),
    "out_of_range": lambda trace: (_settled(trace, nearest_auv(trace)) > number(trace, "range_most")).mean(axis=1),
}.items():
    task_metrics.register(_name, Metric(TASKS, _values))
