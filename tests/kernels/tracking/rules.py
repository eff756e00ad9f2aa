"""Rules of the published environment UTracking (arXiv 2505.08222) in NumPy, batched over runs, and a particle filter.

AUVs circle targets that keep their speed and turn at random, and measure ranges. A filter has the methods `predict()`,
`observe(place, measured, received)` and `finish()` for F = runs × AUVs × targets rows, and then `mean` (F, 4), m and
m/s, and `covariance` (F, 2, 2), m².
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.flow.airy import lanes
from usvauv.kernels.functions import LANES, kernel
from usvauv.kernels.guidance.network import rooms
from usvauv.kernels.tracking import bearings, range_filter, ranges
from usvauv.kernels.tracking.hypotheses import ROOM, FilterColumn, columns_of, filter_of
from usvauv.kernels.types import array1, array2, array4, mask1, vec3

rows1 = ti.types.ndarray(dtype=lanes, ndim=1)

STEP = 30.0  # s
WAY = 29.6  # of an AUV in a step, m
RUDDERS = np.array([-0.24, -0.12, 0.0, 0.12, 0.24])
YAW, BIAS, YAW_NOISE = -6.052, -0.0005, 0.02  # rad for a rudder, rad, rad
RUDDER_LEAST, RUDDER_MOST = 0.10, 0.25  # of a target's turn
NOISE, LOST, REACH = 10.0, 0.1, 450.0  # of ranges: m, probability, m
CIRCLE = 60.0  # m


class Level(NamedTuple):
    """A target's speed over an AUV's, and steps from one turn to the next; limits of uniform numbers."""

    slowest: float
    fastest: float
    least_interval: int
    greatest_interval: int


LEVELS = {
    "easy": Level(0.0, 0.35, 5, 15),
    "medium": Level(0.15, 0.5, 2, 10),
    "hard": Level(0.5, 0.7, 5, 15),
    "expert": Level(0.83, 0.86, 5, 15),
}


def motion(level: Level) -> list[float]:
    """Numbers of `range_filter.Motion`."""
    turn = -YAW * np.array([RUDDER_LEAST, RUDDER_MOST])
    speed = WAY / STEP * np.array([level.slowest, level.fastest])
    return [STEP, *speed, level.least_interval, level.greatest_interval, *turn, 0.5 * YAW_NOISE * speed.mean()]


@kernel
def begin_all(filters: array4):
    for w in range(filters.shape[0]):
        range_filter.begin(filters, w, 0, 0)


@kernel
def predict_all(way: ti.template(), filters: array4, rows: rows1, room: rooms, depths: array1, numbers: array1):
    for w in range(filters.shape[0]):
        f = ti.static(filter_of(filters, rows, room, (w, 0, 0), w, *way, depths))
        model = range_filter.Motion(
            *(numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6], numbers[7])
        )
        range_filter.predict(f, model)


@kernel
def observe_all(
    way: ti.template(),
    filters: array4,
    rows: rows1,
    room: rooms,
    depths: array1,
    place: array2,
    covariance: array2,
    distance: array1,
    variance: array1,
    received: mask1,
):
    for w in range(filters.shape[0]):
        if received[w] != 0:
            f = ti.static(filter_of(filters, rows, room, (w, 0, 0), w, *way, depths))
            uncertainty = vec3(covariance[w, 0], covariance[w, 1], covariance[w, 2])
            observer = vec3(place[w, 0], place[w, 1], place[w, 2])
            ranges.observe_range(f, observer, uncertainty, distance[w], variance[w])


@kernel
def observe_bearings_all(
    way: ti.template(),
    filters: array4,
    rows: rows1,
    room: rooms,
    depths: array1,
    place: array2,
    covariance: array2,
    bearing: array1,
    variance: array1,
    received: mask1,
):
    for w in range(filters.shape[0]):
        if received[w] != 0:
            f = ti.static(filter_of(filters, rows, room, (w, 0, 0), w, *way, depths))
            uncertainty = vec3(covariance[w, 0], covariance[w, 1], covariance[w, 2])
            observer = vec3(place[w, 0], place[w, 1], place[w, 2])
            bearings.observe_bearing(f, observer, uncertainty, bearing[w], variance[w], REACH)


@kernel
def finish_all(way: ti.template(), filters: array4, rows: rows1, room: rooms, depths: array1):
    for w in range(filters.shape[0]):
        range_filter.finish(ti.static(filter_of(filters, rows, room, (w, 0, 0), w, *way, depths)), vec3(0.0))


class Filters:
    """F filters of this program; `numbers` of `range_filter.Motion`; limits of depths below the AUVs, m."""

    def __init__(
        self,
        count: int,
        numbers: Sequence[float],
        device: torch.device,
        variance: float = NOISE**2,
        depths: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.depth_unknown = depths[0] < depths[1]
        self.depths = torch.tensor(depths, dtype=torch.float32, device=device)
        self.rows = torch.zeros(count, 1, 1, columns_of(self.depth_unknown), device=device)
        self.room = torch.zeros(count, ROOM, LANES, device=device)
        self.in_lanes = runtime.start().on_cpu
        self.numbers = torch.tensor(numbers, dtype=torch.float32, device=device)
        self.variance = variance
        begin_all(self.rows)

    def call(self, kernel: Callable[..., None], calls: int, *arguments: torch.Tensor) -> None:
        """Call a kernel that makes some calls of the filter's function."""
        with runtime.settings(runtime.vectors_in_registers()):
            way = (self.in_lanes, self.depth_unknown)
            kernel(way, self.rows, self.rows.view(-1, LANES), self.room, self.depths, *arguments)

    def predict(self) -> None:
        self.call(predict_all, len(self.rows), self.numbers)

    def observe(
        self,
        place: Any,
        measured: Any,
        received: Any,
        covariance: Any = None,
        variance: Any = None,
        kernel: Callable[..., None] = observe_all,
    ) -> None:
        """Ranges, m, or with `observe_bearings_all` bearings, rad, from places (F, 2), or (F, 3) with depths, m."""
        count, place = len(self.rows), np.asarray(place)
        place = np.pad(place, ((0, 0), (0, 3 - place.shape[1])))
        variance = np.full(count, self.variance) if variance is None else variance
        covariance = np.zeros((count, 3)) if covariance is None else covariance
        arrays = [self.tensor(array) for array in (place, covariance, measured, variance)]
        self.call(kernel, int(received.sum()), *arrays, self.tensor(received, np.uint8))

    def finish(self) -> None:
        self.call(finish_all, len(self.rows))
        head = self.rows[:, 0, 0].double().cpu().numpy()
        self.mean = head[:, FilterColumn.span("x", "vy")]
        self.covariance = head[:, [FilterColumn.xx, FilterColumn.xy, FilterColumn.xy, FilterColumn.yy]].reshape(
            -1, 2, 2
        )
        self.known = head[:, FilterColumn.known] > 0

    def tensor(self, array: Any, dtype: Any = np.float32) -> torch.Tensor:
        return torch.tensor(np.ascontiguousarray(array, dtype), device=self.rows.device)


class Particles:
    """F bootstrap particle filters that know the rules, M particles each, with systematic resampling."""

    def __init__(self, count: int, level: Level, particles: int, seed: int, jitter: float = 0.005) -> None:
        self.random, self.level, self.jitter = np.random.default_rng(seed), level, jitter * WAY
        self.state = np.zeros((5, count, particles))  # x, y, heading, way in a step, steps to the next turn
        self.log = np.zeros((count, particles))
        self.known = np.zeros(count, bool)

    def predict(self) -> None:
        x, y, heading, way, left = self.state
        left -= 1
        turns = left <= 0
        number = int(turns.sum())
        rudder = self.random.uniform(RUDDER_LEAST, RUDDER_MOST, number) * self.random.choice([-1, 1], number)
        heading[turns] += YAW * rudder
        left[turns] = self.random.integers(self.level.least_interval, self.level.greatest_interval + 1, number)
        heading += BIAS + YAW_NOISE * self.random.standard_normal(x.shape)
        way += self.jitter * self.random.standard_normal(x.shape)
        np.clip(way, self.level.slowest * WAY, self.level.fastest * WAY, out=way)
        x += way * np.cos(heading)
        y += way * np.sin(heading)

    def observe(self, place: Any, distance: Any, received: Any) -> None:
        new = received & ~self.known
        shape = (int(new.sum()), self.log.shape[1])
        if shape[0]:
            angle, heading = self.random.uniform(0, 2 * np.pi, (2, *shape))
            radius = distance[new, None] + NOISE * self.random.standard_normal(shape)
            way = self.random.uniform(self.level.slowest, self.level.fastest, shape) * WAY
            left = self.random.integers(1, self.level.greatest_interval + 1, shape)
            x, y = place[new, :1] + radius * np.cos(angle), place[new, 1:] + radius * np.sin(angle)
            self.state[:, new] = np.stack([x, y, heading, way, left])
            self.log[new] = 0
        expected = np.hypot(self.state[0] - place[:, :1], self.state[1] - place[:, 1:])
        squared = ((distance[:, None] - expected) / NOISE) ** 2
        self.log -= np.where((received & self.known)[:, None], 0.5 * squared, 0)
        self.known |= received

    def finish(self) -> None:
        weight = np.exp(self.log - self.log.max(1, keepdims=True))
        weight /= weight.sum(1, keepdims=True)
        x, y, heading, way, _ = self.state
        states = np.stack([x, y, way * np.cos(heading) / STEP, way * np.sin(heading) / STEP], -1)
        self.mean = np.einsum("fm,fma->fa", weight, states)
        error = states[..., :2] - self.mean[:, None, :2]
        self.covariance = np.einsum("fm,fma,fmb->fab", weight, error, error) + 1e-3 * np.eye(2)
        few = np.flatnonzero(1 / (weight**2).sum(1) < weight.shape[1] / 2)
        count = weight.shape[1]
        marks = (np.arange(count) + self.random.random((len(few), 1))) / count
        for row, mark in zip(few, marks, strict=True):
            chosen = np.searchsorted(np.cumsum(weight[row]), mark).clip(0, count - 1)
            self.state[:, row] = self.state[:, row, chosen]
            self.log[row] = 0


class Outcome(NamedTuple):
    """Errors (m) and squared errors over their covariance, halved, of each step after `SKIPPED`, run and target."""

    error: np.ndarray
    nees: np.ndarray


SKIPPED = 20
Make = Callable[[int, Level], Any]


def together(random: np.random.Generator, runs: int, count: int) -> np.ndarray:
    """Places (runs, count, 2) of which any two are 30 to 180 m apart."""
    if count == 2:
        angle, distance = random.uniform(0, 2 * np.pi, runs), random.uniform(30, 180, runs)
        return np.stack([np.zeros((runs, 2)), distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)], 1)
    places = random.uniform(-90, 90, (runs, count, 2))
    pair = np.triu_indices(count, 1)
    while True:
        apart = np.linalg.norm(places[:, pair[0]] - places[:, pair[1]], axis=-1)
        wrong = (apart.min(1) < 30) | (apart.max(1) > 180)
        if not wrong.any():
            return places
        places[wrong] = random.uniform(-90, 90, (int(wrong.sum()), count, 2))


def along(heading: np.ndarray) -> np.ndarray:
    """Unit vectors."""
    return np.stack([np.cos(heading), np.sin(heading)], -1)


def circle(place: np.ndarray, heading: np.ndarray, last: np.ndarray, target: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Rudders (indices) that over two steps keep nearest to the distance `CIRCLE` from a target that goes on."""
    best, chosen = np.full(heading.shape, np.inf), last.copy()
    for first, rudder in enumerate(RUDDERS):
        turned = heading + YAW * rudder + BIAS
        reached = place + WAY * along(turned)
        loss = (np.linalg.norm(reached - target - way, axis=-1) - CIRCLE) ** 2
        for second in range(max(first - 1, 0), min(first + 2, len(RUDDERS))):
            then = reached + WAY * along(turned + YAW * RUDDERS[second] + BIAS)
            both = loss + (np.linalg.norm(then - target - 2 * way, axis=-1) - CIRCLE) ** 2
            both = np.where(abs(first - last) <= 1, both, np.inf)
            chosen = np.where(both < best, first, chosen)
            best = np.minimum(best, both)
    return chosen


def simulate(
    make: Make, level: Level, *, runs: int, pairs: int, seed: int, steps: int = 128, guide: Make | None = None
) -> Outcome:
    """As many AUVs as targets, AUV k circling target k; of each target counts the filter of the least range.

    AUVs steer by the filters' own estimates, or by those of `guide`; both have the same measurements then.
    """
    random, shape = np.random.default_rng(seed), (runs, pairs)
    places = together(random, runs, 2 * pairs)
    auv, target = places[:, :pairs], places[:, pairs:]
    heading, course = random.uniform(0, 2 * np.pi, (2, *shape))
    way = random.uniform(level.slowest, level.fastest, shape) * WAY
    interval = level.least_interval, level.greatest_interval + 1
    left = random.integers(*interval, shape)
    rudder = np.full(shape, 2)
    filters = make(runs * pairs * pairs, level)
    guides = guide(runs * pairs * pairs, level) if guide else filters
    both = (filters, guides) if guide else (filters,)
    each = np.arange(pairs)
    errors, squares = [], []
    for step in range(steps):
        heading = heading + YAW * RUDDERS[rudder] + BIAS + random.normal(0, YAW_NOISE, shape)
        auv = auv + WAY * along(heading)
        left = left - 1
        turn = random.uniform(RUDDER_LEAST, RUDDER_MOST, shape) * random.choice([-1, 1], shape)
        course = course + np.where(left <= 0, YAW * turn, 0) + BIAS + random.normal(0, YAW_NOISE, shape)
        left = np.where(left <= 0, random.integers(*interval, shape), left)
        target = target + way[..., None] * along(course)
        true = np.linalg.norm(auv[:, :, None] - target[:, None], axis=-1)
        distance = true + random.normal(0, NOISE, true.shape)
        received = (random.random(true.shape) >= LOST) & (true <= REACH)
        heard = random.random((runs, pairs, pairs)) >= LOST
        heard[:, each, each] = True
        for each_filter in both:
            each_filter.predict()
        for offset in range(pairs):
            sender = (each + offset) % pairs
            place = np.broadcast_to(auv[:, sender, None], (runs, pairs, pairs, 2)).reshape(-1, 2)
            known = received[:, sender] & heard[:, each, sender, None]
            for each_filter in both:
                each_filter.observe(place, distance[:, sender].reshape(-1), known.reshape(-1))
        for each_filter in both:
            each_filter.finish()
        mean = filters.mean.reshape(runs, pairs, pairs, 4)
        error = mean[..., :2] - target[:, None]
        P = filters.covariance.reshape(runs, pairs, pairs, 2, 2)
        seen = np.where(received, distance, np.inf)
        nearest = seen.argmin(1)[:, None, :]
        if step >= SKIPPED:
            P = np.where(filters.known.reshape(runs, pairs, pairs, 1, 1), P, np.eye(2))
            squared = 0.5 * np.einsum("...a,...ab,...b", error, np.linalg.inv(P), error)
            counted = np.isfinite(seen.min(1))
            errors.append(
                np.where(counted, np.take_along_axis(np.linalg.norm(error, axis=-1), nearest, 1)[:, 0], np.nan)
            )
            squares.append(np.where(counted, np.take_along_axis(squared, nearest, 1)[:, 0], np.nan))
        own = guides.mean.reshape(runs, pairs, pairs, 4)[:, each, each]
        rudder = circle(auv, heading, rudder, own[..., :2], STEP * own[..., 2:])
    return Outcome(np.array(errors), np.array(squares))
