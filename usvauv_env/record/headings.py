"""Headings of boats and AUVs that are simulated as points, from their velocities, and the latest of events."""

from __future__ import annotations

import math

import numpy as np

TURN_RATE = math.radians(20)  # rad/s
SLOWEST = 0.1  # m/s
AT_REST = 1e-3  # m/s; up to this speed a point AUV keeps its direction


def turned(heading: np.ndarray, velocity: np.ndarray, step: float) -> np.ndarray:
    """Headings (…) of boats simulated as points, after a step of some seconds; NaN: none yet.

    A heading is the bow's direction; nothing in a mission depends on it, and an Otter has its own. The boat turns
    towards its velocity through the water v, at most at `TURN_RATE`, and keeps its heading while |v| does not exceed
    `SLOWEST`, so that a boat on station in a current points against it:

        ψ(t + Δt) = ψ(t) + clip(wrap(arg v − ψ(t)), ±TURN_RATE Δt),   wrap(α) in [−π, π).

    ψ is in rad, anticlockwise from east, and not wrapped, so that it can be interpolated.

    Args:
        velocity: v, (…, 2), m/s.
    """
    aim = np.arctan2(velocity[..., 1], velocity[..., 0])
    most = TURN_RATE * step
    off = np.remainder(aim - heading + math.pi, 2 * math.pi) - math.pi
    after = np.where(np.isnan(heading), aim, heading + np.clip(off, -most, most))
    return np.where(np.hypot(velocity[..., 0], velocity[..., 1]) > SLOWEST, after, heading)


def headings(velocity: np.ndarray, step: float) -> np.ndarray:
    """Headings (T, …) float32 of `turned` after steps in which boats move through the water at (T, …, 2), m/s.

    The first is that of the first velocity above `SLOWEST`, also before it, and east without one.
    """
    made = np.full(velocity.shape[:-1], np.nan)
    now = np.full(velocity.shape[1:-1], np.nan)
    for row, moving in zip(made, velocity.astype(float), strict=True):
        row[...] = now = turned(now, moving, step)
    begins = np.take_along_axis(made, np.argmax(~np.isnan(made), axis=0)[None], axis=0)
    return np.nan_to_num(np.where(np.isnan(made), begins, made)).astype(np.float32)


def latest(happened: np.ndarray) -> np.ndarray:
    """Last row (T, …) with a flag set, for each row of flags (T, …); −1 before the first."""
    rows = np.arange(len(happened)).reshape(-1, *[1] * (happened.ndim - 1))
    return largest_so_far(np.where(happened, rows, -1))


def largest_so_far(values: np.ndarray) -> np.ndarray:
    """Largest of each number (T, …) and those of the rows before, in place; in a tenth of the time that
    `np.maximum.accumulate` takes."""
    for row in range(1, len(values)):
        np.maximum(values[row - 1], values[row], out=values[row, ...])
    return values


def directions(velocity: np.ndarray) -> np.ndarray:
    """Directions (T, …) of velocities (T, …, 2), rad, continuous; at rest the last one, before the first the next."""
    angle = np.arctan2(velocity[..., 1], velocity[..., 0])
    moving = np.hypot(velocity[..., 0], velocity[..., 1]) > AT_REST
    last = latest(moving)
    first = np.where(moving.any(axis=0), moving.argmax(axis=0), 0)
    return np.unwrap(np.take_along_axis(angle, np.where(last < 0, first, last), axis=0), axis=0)
