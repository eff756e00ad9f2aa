"""An independent ray tracer: the ray equations in double precision, integrated for a fan of angles at once.

With the horizontal slowness ξ, which a range-independent medium keeps, and the vertical slowness ζ, by arc length s

    dr/ds = c ξ,  dz/ds = c ζ,  dξ/ds = 0,  dζ/ds = −c'/c²,  dτ/ds = 1/c

(Jensen, Kuperman, Porter, Schmidt, "Computational Ocean Acoustics" (2011), chapter 3). Runge and Kutta's fourth-order
steps end on the interfaces of the medium, where c' jumps. Eigenrays are found by shooting: brackets in the fan of
launch angles are fanned out again. Nothing of `usvauv.kernels.positioning` is used.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

FAN = 400  # rays
REFINED = 13  # rays in a bracket, which is divided by one less each time
REFINEMENTS = 5
LANDING = 1e-10  # of a step, how near to an interface it ends


class Medium(NamedTuple):
    """Speed of sound and its derivative as functions of depth (n,) and layer (n,); depths between the layers."""

    speed: Callable[[np.ndarray, np.ndarray], np.ndarray]
    gradient: Callable[[np.ndarray, np.ndarray], np.ndarray]
    interfaces: np.ndarray


class Eigenray(NamedTuple):
    """A ray from array to source: ξ, cosines with the downward vertical at both, travel time, number of turns."""

    slowness: float
    at_array: float
    at_source: float
    time: float
    turns: int


def layered(depths: np.ndarray, speeds: np.ndarray, extra: float) -> Medium:
    """Linear between depths, constant beyond; with an interface at the depth `extra` (m) too."""
    z = np.union1d(depths, [extra])
    c = np.interp(z, depths, speeds)
    slopes = np.concatenate([[0.0], np.diff(c) / np.diff(z), [0.0]])
    at, base = np.append(z[0], z), np.append(c[0], c)
    return Medium(lambda d, i: base[i] + slopes[i] * (d - at[i]), lambda d, i: slopes[i], z)


def smooth(speed: Callable, gradient: Callable, extra: float) -> Medium:
    """One formula for all depths, with an interface of no effect at the depth `extra` (m)."""
    return Medium(lambda d, i: speed(d), lambda d, i: gradient(d), np.array([extra]))


def step(medium: Medium, state: np.ndarray, xi: np.ndarray, layer: np.ndarray, h: np.ndarray) -> np.ndarray:
    """State (r, z, ζ, τ) after the arc lengths h, by Runge and Kutta."""

    def motion(y):
        c = medium.speed(y[1], layer)
        return np.stack([c * xi, c * y[2], -medium.gradient(y[1], layer) / c**2, 1 / c])

    k1 = motion(state)
    k2 = motion(state + 0.5 * h * k1)
    k3 = motion(state + 0.5 * h * k2)
    k4 = motion(state + h * k3)
    return state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def crossings(medium: Medium, array: float, source: float, angles: np.ndarray, reach: float, h: float) -> np.ndarray:
    """Range, travel time and ζ (turns 0 and 1, 3, n) where rays leave an array at angles and meet the source's depth.

    The range is infinite for a ray that has not met it, and may yet, at the range `reach`, and NaN for one that does
    not.

    Args:
        angles: from the horizontal, down positive, rad. reach: range at which rays end, m. h: arc length of a step, m.
    """
    n = len(angles)
    edges = np.concatenate([[-np.inf], medium.interfaces, [np.inf]])
    layer = np.where(
        angles > 0, np.searchsorted(medium.interfaces, array, "right"), np.searchsorted(medium.interfaces, array)
    )
    c = medium.speed(np.full(n, array), layer)
    xi = np.cos(angles) / c
    state = np.stack([np.zeros(n), np.full(n, array), np.sin(angles) / c, np.zeros(n)])
    turns = np.zeros(n, int)
    found = np.full((2, 3, n), np.nan)
    alive = np.arange(n)
    while alive.size:
        y, x, i = state[:, alive], xi[alive], layer[alive]
        new = step(medium, y, x, i, np.full(alive.size, h))
        low, high = edges[i], edges[i + 1]
        rows = np.flatnonzero((new[1] < low) | (new[1] > high))
        sign = np.where(new[1, rows] < low[rows], -1, 1)
        edge = np.where(sign < 0, low[rows], high[rows])
        a, b = np.zeros(rows.size), np.full(rows.size, h)
        while np.any(b - a > LANDING * h):
            middle = 0.5 * (a + b)
            past = sign * (step(medium, y[:, rows], x[rows], i[rows], middle)[1] - edge) > 0
            a, b = np.where(past, a, middle), np.where(past, middle, b)
        new[:, rows] = step(medium, y[:, rows], x[rows], i[rows], b)
        new[1, rows] = edge
        turns[alive] += new[2] * y[2] < 0
        layer[alive[rows]] += sign
        hits = rows[edge == source]
        for number in (0, 1):
            some = hits[turns[alive[hits]] == number]
            found[number][:, alive[some]] = new[[0, 3, 2]][:, some]
        state[:, alive] = new
        going = (new[0] < reach) & (turns[alive] < 2)
        for number in (0, 1):
            ended = alive[~going & (turns[alive] <= number)]
            found[number, 0, ended[np.isnan(found[number, 0, ended])]] = np.inf
        alive = alive[going]
    return found


def eigenrays(medium: Medium, array: float, source: float, R: float, h: float, steepest: float = 0.4) -> list[Eigenray]:
    """All rays with at most one turning point from the array to the source at range R (m), the first arrival first.

    Args:
        h: step, m. steepest: angle from the horizontal up to which rays are sent, rad.
    """
    at_array = medium.speed(np.array([array]), np.searchsorted(medium.interfaces, [array], "right"))[0]
    share = np.linspace(-1, 1, FAN)
    brackets = [steepest * np.sign(share) * share**2]  # denser towards the horizontal
    for refinement in range(REFINEMENTS + 1):
        angles = np.stack(brackets)
        found = crossings(medium, array, source, angles.ravel(), 1.05 * R, h).reshape(2, 3, *angles.shape)
        off = found[:, 0] - R
        before, after = off[..., :-1], off[..., 1:]
        crossed = ((before > 0) != (after > 0)) & ~np.isnan(before + after)
        edge = np.isnan(before) != np.isnan(after)  # a root may lie between the last ray of a branch and its end
        inside = np.argwhere(crossed)
        if refinement < REFINEMENTS:
            ends = {(angles[j, k], angles[j, k + 1]) for _, j, k in np.argwhere(crossed | edge)}
            brackets = [np.linspace(a, b, REFINED) for a, b in ends]
            if not brackets:
                return []
    rays = []
    for n, j, k in inside:
        first, second = off[n, j, k : k + 2]
        if abs(second - first) < 1.0:  # or it is a jump from one depth of turning to another
            t = first / (first - second)
            _, time, zeta = (1 - t) * found[n, :, j, k] + t * found[n, :, j, k + 1]
            angle = (1 - t) * angles[j, k] + t * angles[j, k + 1]
            xi = np.cos(angle) / at_array
            rays.append(Eigenray(xi, np.sin(angle), zeta / np.hypot(zeta, xi), time, n))
    return sorted(rays, key=lambda ray: ray.time)
