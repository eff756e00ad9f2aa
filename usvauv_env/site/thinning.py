"""Sound speed profiles of fewer depths, for which sound between given depths takes the same time to within 1 cm.

Travel times are computed in double precision for a dense set of rays, independently of `usvauv.kernels.positioning`. A
layer of gradient g crossed between the speeds c₁ and c₂ takes ln[c₂ (1 + w₁)/(c₁ (1 + w₂))]/g with the cosines
w = √(1 − c²/c_t²), and half a turning arc artanh(w)/|g|. Between two rays τ(R) is interpolated by Hermite's cubic,
since dτ/dR = 1/c_t.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

TOLERANCE = (
    0.008  # m, of travel times times the speed of sound, and of horizontal places: 1 cm between the ranges tried
)
STEEP = 0.2  # least cosine along a ray for which the place of a fix is held to it
RANGES = 100  # at which times are compared; the edge of a shadow may move from one to the next
FLAT = 0.005  # least cosine by which a speed's weight grows
FIRST_STEP = 4.0  # times the range of the speeds, where the search for the fewest depths begins
STEP, LEAST_STEP = 1.25, 1e-3  # between weighted tolerances that are tried, and the last of them, m/s
DIRECT_RAYS = 400
RAYS_PER_SPEED = 8.0  # turning rays per m/s
FEWEST_RAYS = 6  # in a layer
FIT_POINTS = 4  # per depth at which a thinned profile is fitted
LEVEL = 1e-4  # m/s between depths, below which a layer is taken for one of constant speed


class Branch(NamedTuple):
    """Rays next to each other: horizontal range (m), travel time (s), slowness (s/m), least cosine of each (n,)."""

    range: np.ndarray
    time: np.ndarray
    slowness: np.ndarray
    cosine: np.ndarray


def _crossed(z: np.ndarray, c: np.ndarray, fastest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Range (m) and time (s) in the layers between depths (N,) of the rays that turn at the speeds `fastest` (n, 1)."""
    A = np.sqrt(np.maximum((fastest - c) * (fastest + c), 1e-18))
    h, c1, c2, A1, A2 = np.diff(z), c[:-1], c[1:], A[:, :-1], A[:, 1:]
    level = np.abs(c2 - c1) < LEVEL
    slope = np.where(level, 1.0, (c2 - c1) / h)
    curved = np.log(c2 * (fastest + A1) / (c1 * (fastest + A2))) / slope
    straight = 4 * h * fastest / ((c1 + c2) * (A1 + A2))
    return h * (c1 + c2) / (A1 + A2), np.where(level, straight, curved)


def _with_ends(depths: np.ndarray, speeds: np.ndarray, *ends: float) -> tuple[np.ndarray, np.ndarray]:
    z = np.union1d(depths, ends)
    return z, np.interp(z, depths, speeds)


def direct(depths: np.ndarray, speeds: np.ndarray, array: float, source: float, fastest: np.ndarray) -> Branch:
    """Rays between two depths (m) that would turn at the speeds `fastest` (n,), beyond all speeds between the two."""
    z, c = _with_ends(depths, speeds, array, source)
    inside = (z >= array) & (z <= source)
    R, time = _crossed(z[inside], c[inside], fastest[:, None])
    cosine = np.sqrt(np.maximum(1 - (c[inside].max() / fastest) ** 2, 0))
    return Branch(R.sum(axis=1), time.sum(axis=1), 1 / fastest, cosine)


def steepening(depths: np.ndarray, speeds: np.ndarray, array: float, source: float) -> np.ndarray:
    """Speeds (DIRECT_RAYS,) at which direct rays would turn, from the nearly horizontal to the nearly vertical one."""
    z, c = _with_ends(depths, speeds, array, source)
    record = c[(z >= array) & (z <= source)].max()
    return record / np.sqrt(1 - np.linspace(1e-5, np.sqrt(1 - 1e-6), DIRECT_RAYS) ** 2)


def turning(depths: np.ndarray, speeds: np.ndarray, array: float, source: float) -> Iterator[Branch]:
    """Rays from a source (m) that turn once below it and meet an array above (m), a branch for each layer."""
    z, c = _with_ends(depths, speeds, array, source)
    begin, end = np.searchsorted(z, [array, source])
    record = c[begin : end + 1].max()
    for i in range(end, len(z) - 1):
        if c[i + 1] > record:
            count = max(FEWEST_RAYS, int(RAYS_PER_SPEED * (c[i + 1] - record)))
            fastest = record + (c[i + 1] - record) * np.linspace(1e-6, 1, count) ** 2
            down = _crossed(z[begin : i + 1], c[begin : i + 1], fastest[:, None])
            A = np.sqrt((fastest - c[i]) * (fastest + c[i]))
            g = (c[i + 1] - c[i]) / (z[i + 1] - z[i])
            arcs = (2 * A / g, 2 * np.arctanh(A / fastest) / g)
            twice = 1 + (np.arange(begin, i) >= end)
            R, time = (part @ twice + arc for part, arc in zip(down, arcs, strict=True))
            yield Branch(R, time, 1 / fastest, np.zeros(count))
            record = c[i + 1]


def times_at(branch: Branch, R: np.ndarray) -> np.ndarray:
    """Least travel time (s) of a branch at ranges R (m,), infinite where it does not reach."""
    r1, r2 = branch.range[:-1, None], branch.range[1:, None]
    dr = np.where(r1 == r2, 1.0, r2 - r1)
    u = (R - r1) / dr
    value = (
        (1 + 2 * u) * (1 - u) ** 2 * branch.time[:-1, None]
        + u**2 * (3 - 2 * u) * branch.time[1:, None]
        + dr * u * (1 - u) * ((1 - u) * branch.slowness[:-1, None] - u * branch.slowness[1:, None])
    )
    return np.where((R - r1) * (R - r2) <= 0, value, np.inf).min(axis=0)


def first_arrivals(depths: np.ndarray, speeds: np.ndarray, array: float, source: float, R: np.ndarray) -> np.ndarray:
    """Travel time (s) at ranges R (m,) of the direct ray or, where there is none, of the first that turns below."""
    straight = times_at(direct(depths, speeds, array, source, steepening(depths, speeds, array, source)), R)
    turned = [times_at(branch, R) for branch in turning(depths, speeds, array, source)]
    return np.where(np.isfinite(straight), straight, np.min([np.full_like(R, np.inf), *turned], axis=0))


class Comparison:
    """A profile, depths of arrays above a source (m), and ranges: what a thinned profile is held to."""

    def __init__(
        self, depths: np.ndarray, speeds: np.ndarray, arrays: tuple[float, ...], source: float, longest: float
    ):
        self.arrays, self.source = arrays, source
        self.R = np.linspace(longest / RANGES, longest, RANGES)
        self.mean = float(speeds.mean())
        self.times = [first_arrivals(depths, speeds, array, source, self.R) for array in arrays]
        self.rays = []
        for array in arrays:
            branch = direct(depths, speeds, array, source, steepening(depths, speeds, array, source))
            kept = (branch.cosine >= STEEP) & (branch.range <= longest)
            self.rays.append(Branch(*(column[kept] for column in branch)))

    def holds(self, depths: np.ndarray, speeds: np.ndarray) -> bool:
        """Whether times and places by another profile are within TOLERANCE, and shadows within one of the ranges."""
        for array, times, rays in zip(self.arrays, self.times, self.rays, strict=True):
            other = first_arrivals(depths, speeds, array, self.source, self.R)
            heard = np.isfinite(times)
            both = heard & np.isfinite(other)
            if heard.sum() + np.isfinite(other).sum() - 2 * both.sum() > 1:
                return False
            if self.mean * np.abs(other[both] - times[both]).max(initial=0) > TOLERANCE:
                return False
            traced = direct(depths, speeds, array, self.source, 1 / rays.slowness)
            c = np.interp(self.source, depths, speeds)
            beyond = c * c * rays.slowness * (rays.time - traced.time)  # what is left of the time, along the ray
            if np.abs(traced.range + beyond - rays.range).max(initial=0) > TOLERANCE:
                return False
        return True


def simplified(
    depths: np.ndarray, speeds: np.ndarray, weights: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Depths between which the weighted speed is linear within a tolerance, m/s, and speeds there by least squares.

    Source: Douglas and Peucker, "Algorithms for the reduction of the number of points required to represent a digitized
    line", Cartographica 10 (1973), doi 10.3138/FM57-6770-U75U-7727.
    """
    kept = {0, len(depths) - 1}
    open_ends = [(0, len(depths) - 1)]
    while open_ends:
        first, last = open_ends.pop()
        between = slice(first + 1, last)
        linear = np.interp(depths[between], depths[[first, last]], speeds[[first, last]])
        misses = weights[between] * np.abs(speeds[between] - linear)
        if misses.size and misses.max() > tolerance:
            worst = first + 1 + int(misses.argmax())
            kept.add(worst)
            open_ends += [(first, worst), (worst, last)]
    index = sorted(kept)
    few, at = depths[index], speeds[index]
    z = np.linspace(few[0], few[-1], FIT_POINTS * len(depths))
    missed = np.interp(z, depths, speeds) - np.interp(z, few, at)
    hats = np.stack([np.interp(z, few, unit) for unit in np.eye(len(few))], axis=1)
    weight = np.interp(z, depths, weights)
    return few, at + np.linalg.lstsq(hats * weight[:, None], missed * weight, rcond=None)[0]


def thinned(
    depths: np.ndarray, speeds: np.ndarray, arrays: tuple[float, ...], source: float, longest: float
) -> tuple[np.ndarray, np.ndarray]:
    """As few depths, and speeds there, as are found to serve; see `SoundSpeedProfile.thinned`.

    Two ways are tried: all speeds weigh the same, or each as the time that the flattest direct ray within the longest
    range takes at it, by 1/cos θ.
    """
    asked = Comparison(depths, speeds, arrays, source, longest)
    rays = direct(depths, speeds, min(arrays), source, steepening(depths, speeds, min(arrays), source))
    flattest = rays.slowness[rays.range <= longest].max(initial=0)
    by_time = 1 / np.sqrt(np.maximum(np.abs(1 - (speeds * flattest) ** 2), FLAT**2))
    best = depths, speeds
    for weights in (np.ones_like(speeds), by_time):
        tolerance = FIRST_STEP * float(np.ptp(speeds))
        few = simplified(depths, speeds, weights, tolerance)
        while tolerance > LEAST_STEP and len(few[0]) < len(best[0]):
            if asked.holds(*few):
                best = few
            tolerance /= STEP
            few = simplified(depths, speeds, weights, tolerance)
    return best
