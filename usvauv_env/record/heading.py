"""The heading of a boat that the mission simulates as a point; an Otter has one of its own.

It is where the boat's bow points, and nothing in a mission depends on it. The boat turns towards its velocity through
the water v, at most at `TURN_RATE`, and keeps its heading where |v| does not exceed `SLOWEST`:

    ψ(t + Δt) = ψ(t) + clip(wrap(arg v − ψ(t)), ±TURN_RATE Δt),   wrap(α) in [−π, π),

so that a boat on station in a current points against it. The first heading is that of the first velocity above
`SLOWEST`, before it the same, and east where there is none. ψ is in rad, anticlockwise from east, and continuous: it is
not reduced to one turn, so that it can be interpolated.

Both constants are conventions of this model, not measurements of a boat: at 4 m/s the turn has a radius of 11 m.
"""

from __future__ import annotations

import math

import numpy as np

TURN_RATE = math.radians(20)  # rad/s
SLOWEST = 0.1  # m/s
AT_REST = 1e-3  # m/s, up to which an AUV that is a point keeps its direction


def turned(heading: np.ndarray, velocity: np.ndarray, step: float) -> np.ndarray:
    """Headings (…) after a step of some seconds at velocities through the water (…, 2), m/s; NaN is none yet."""
    aim = np.arctan2(velocity[..., 1], velocity[..., 0])
    most = TURN_RATE * step
    off = np.remainder(aim - heading + math.pi, 2 * math.pi) - math.pi
    after = np.where(np.isnan(heading), aim, heading + np.clip(off, -most, most))
    return np.where(np.hypot(velocity[..., 0], velocity[..., 1]) > SLOWEST, after, heading)


def headings(velocity: np.ndarray, step: float) -> np.ndarray:
    """Headings (T, …) float32 at the ends of steps in which velocities through the water are (T, …, 2), m/s."""
    made = np.full(velocity.shape[:-1], np.nan)
    now = np.full(velocity.shape[1:-1], np.nan)
    for row, moving in zip(made, velocity.astype(float), strict=True):
        row[...] = now = turned(now, moving, step)
    begins = np.take_along_axis(made, np.argmax(~np.isnan(made), axis=0)[None], axis=0)
    return np.nan_to_num(np.where(np.isnan(made), begins, made)).astype(np.float32)


def directions(velocity: np.ndarray) -> np.ndarray:
    """Directions (T, …) of velocities (T, …, 2), rad, continuous; at rest the last one, at first the next."""
    angle, rows = np.arctan2(velocity[..., 1], velocity[..., 0]), np.arange(len(velocity))
    moving = np.hypot(velocity[..., 0], velocity[..., 1]) > AT_REST
    last = np.maximum.accumulate(np.where(moving, rows.reshape(-1, *[1] * (angle.ndim - 1)), -1), axis=0)
    first = np.where(moving.any(axis=0), moving.argmax(axis=0), 0)
    return np.unwrap(np.take_along_axis(angle, np.where(last < 0, first, last), axis=0), axis=0)
