"""Poses of everything in one episode, with z upwards from the still water."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_metrics import middle_depth
from usvauv.env.site.site import Site


class Poses(NamedTuple):
    """T times, K AUVs, B boats, M nodes, N points of the surface; positions x east, y north, z up, m.

    Attributes:
        auvs, fixes, estimates: (T, K, 3); a fix is NaN where none was made, all are at the AUVs' depth.
        boats: (T, B, 3), on the waves.
        nodes: (M, 3), on the bed; M = 0 where they are targets that move.
        targets, tracked: (T, M, 3), those and the AUVs' estimates of them, NaN while they know nothing, in the middle
            of the depths where targets may be; M = 0 without any.
        sea: (T, N, 3), the surface row by row from the south; T = 0 where it was not recorded.
        auv_turn, boat_turn: quaternions x, y, z, w: (T, K, 4) of an AUV's attitude, (T, B, 4) of a boat's heading and
            of the slope of the surface under it.
    """

    auvs: np.ndarray
    fixes: np.ndarray
    estimates: np.ndarray
    boats: np.ndarray
    nodes: np.ndarray
    targets: np.ndarray
    tracked: np.ndarray
    sea: np.ndarray
    auv_turn: np.ndarray
    boat_turn: np.ndarray

    @classmethod
    def of(cls, trace: Trace) -> Poses:
        """The poses in world 0 of a trace."""
        depth, fixed, moving = trace.depth[:, 0], trace.node_position[0], np.zeros((2, len(trace.time), 0, 2))
        middle = 0.0
        if trace.node_way.size:
            fixed, moving = fixed[:0], np.array([trace.node_way[:, 0]] * 2, float)
            moving[1] = np.nan
        if trace.node_estimate.size:
            known = trace.node_covariance[:, 0, :, :1] > 0
            moving[1] = np.where(known, trace.node_estimate[:, 0], np.nan)
            middle = middle_depth(trace.scenario)
        return cls(
            auvs=_raised(trace.auv_position[:, 0], -depth),
            fixes=_raised(trace.fix[:, 0], -depth),
            estimates=_raised(trace.estimate[:, 0], -depth),
            boats=_raised(trace.boat_position[:, 0], trace.boat_surface[:, 0, :, 0]),
            nodes=_raised(fixed, -Site.recorded(trace.scenario).depth_at(fixed)),
            targets=_raised(moving[0], -middle),
            tracked=_raised(moving[1], -middle),
            sea=_sea(trace),
            auv_turn=turn(trace.attitude[:, 0]),
            boat_turn=afloat(trace.boat_heading[:, 0], trace.boat_surface[:, 0, :, 1:]),
        )


def triangles(rows: int, columns: int) -> np.ndarray:
    """Triangles (2(Y−1)(X−1), 3) of Y × X points, row by row from the south, seen from above anticlockwise."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1, 1)
    lower, upper = (0, 1, columns + 1), (0, columns + 1, columns)
    return np.concatenate([corner + lower, corner + upper])


def _raised(places: np.ndarray, z: float | np.ndarray) -> np.ndarray:
    """Positions (…, 2) at heights z, (…, 3)."""
    return np.concatenate([places, np.broadcast_to(z, places.shape[:-1])[..., None]], axis=-1)


def _sea(trace: Trace) -> np.ndarray:
    steps, rows, columns = trace.surface.shape
    plane = np.stack(np.meshgrid(*trace.scenario.area.middles(columns, rows)), axis=-1)
    return _raised(np.broadcast_to(plane, (steps, *plane.shape)), trace.surface).reshape(steps, rows * columns, 3)


def turn(attitude: np.ndarray) -> np.ndarray:
    """Quaternions x, y, z, w (…, 4) of headings, pitches (nose up) and rolls (starboard down), (…, 3)."""
    (c, p, r), (s, q, t) = (np.moveaxis(of(attitude / 2), -1, 0) for of in (np.cos, np.sin))
    parts = c * p * t + s * q * r, s * p * t - c * q * r, s * p * r + c * q * t, c * p * r - s * q * t
    return np.stack(parts, axis=-1)


def afloat(heading: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Quaternions x, y, z, w (…, 4) of the turn to headings (…), then of the least turn from the vertical to the normal
    of a surface of slopes (…, 2).
    """
    x, y = np.moveaxis(slope, -1, 0)
    upright = 1 + np.sqrt(1 + x**2 + y**2)  # vertical × normal is (y, −x, 0), 1 + their product this, over the length
    c, s = np.cos(heading / 2), np.sin(heading / 2)
    turn = np.stack([y * c - x * s, -x * c - y * s, upright * s, upright * c], axis=-1)
    return turn / np.linalg.norm(turn, axis=-1, keepdims=True)


def ahead(turn: np.ndarray) -> np.ndarray:
    """Unit vectors (…, 3) forward from bodies turned by quaternions x, y, z, w (…, 4)."""
    x, y, z, w = np.moveaxis(turn, -1, 0)
    return np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)], axis=-1)
