"""State of a recorded mission at any moment, also between its steps, for pictures.

A moment t is a number of steps from the first recorded state: whole numbers are steps, at which the recorded state is
drawn. Between two steps vehicles move on a cubic through the four nearest steps (Catmull and Rom); estimates, headings
and covariances are linear in time; counts and decisions keep the value of the step before.
"""

from __future__ import annotations

import math
import re
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.record.headings import latest
from usvauv.env.record.metrics import age, energy_consumption, position_error, target_distance
from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_metrics import middle_depth, settled, track_error
from usvauv.env.render.reply_field import ReplyField
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.sea.storm import elevation
from usvauv.env.site.site import Site
from usvauv.kernels.errors import UserError
from usvauv.kernels.positioning import usbl

ROUNDING = 1e-6  # steps
MEDIAN_WINDOW = 30.0  # s
TRAIL = 120.0  # s
OLD = 300.0  # s, age from which on a node's ring is brightest
SIGMAS = 2.0  # semi-axes of error ellipses; in two dimensions they enclose 86 % of the errors


def step_of(t: float) -> int:
    """The step at or before a moment."""
    return int(t + ROUNDING)


def cubic(t: float, count: int) -> list[tuple[int, float]]:
    """Steps around a moment, of `count`, and their weights: ½(1, s, s², s³) times the matrix of Catmull and Rom."""
    step = step_of(t)
    s = t - step
    weights = -s + 2 * s**2 - s**3, 2 - 5 * s**2 + 3 * s**3, s + 4 * s**2 - 3 * s**3, s**3 - s**2
    return [(min(max(step + n, 0), count - 1), 0.5 * w) for n, w in zip(range(-1, 3), weights, strict=True)]


class Series:
    """Numbers (T, …) of the steps, linear between them or `smooth`, as `cubic`."""

    def __init__(self, values: np.ndarray, smooth: bool = False) -> None:
        self.values, self._smooth = values, smooth

    def at(self, t: float) -> np.ndarray:
        """Numbers (…) of a moment."""
        step = step_of(t)
        now, share = self.values[step], t - step
        if share < ROUNDING or step + 1 == len(self.values):
            return now
        if self._smooth:
            return sum((weight * self.values[near] for near, weight in cubic(t, len(self.values))), np.zeros(()))
        return now + share * (self.values[step + 1] - now)

    def until(self, t: float, steps: np.ndarray) -> np.ndarray:
        """Numbers (N, …) of some steps, of which the last is the one before a moment, and of the moment."""
        past = self.values[steps]
        return past if t - steps[-1] < ROUNDING else np.concatenate([past, self.at(t)[None]])


class Vehicle(NamedTuple):
    """A boat, "usv", or an "auv", and its index."""

    kind: str
    index: int

    @classmethod
    def parse(cls, text: str, scenario: Scenario) -> Vehicle:
        """The vehicle named usv, usv:N or auv:N, counted from 1.

        Raises:
            UserError: there is none of that name.
        """
        found = re.fullmatch(r"(usv)(?::([1-9]\d{0,3}))?|(auv):([1-9]\d{0,3})", text)
        kind, number = (found[1] or found[3], int(found[2] or found[4] or 1)) if found else ("", 0)
        boats, auvs = scenario.boat.count, scenario.auv.count
        if not 1 <= number <= (auvs if kind == "auv" else boats):
            allowed = "usv" if boats == 1 else f"usv:1 to usv:{boats}"
            raise UserError(f"follow {text!r}: must be {allowed}, or auv:1 to auv:{auvs}")
        return cls(kind, number - 1)

    def way(self, trace: Trace) -> Series:
        """Its places (2,) in world 0, m."""
        places = trace.auv_position if self.kind == "auv" else trace.boat_position
        return Series(places[:, 0, self.index].astype(float), smooth=True)


LOOKS = 20  # at steps of a recorded sea, in which water has moved


class RecordedSea:
    """The recorded surface of a trace.

    At a step it is the recorded one. In between it is the storm, in closed form at that time, and the long waves: the
    recorded surface less the storm, as `cubic`: their periods are many steps long. Without a record of the storm the
    whole surface is interpolated in this way.

    In fast motion the storm would be another one in each frame. There its waves go at their true speed: a second of the
    video is one of theirs. All else goes faster, and what the waves move a boat to and fro is averaged.

    Attributes:
        surface: (T, Y, X) m, row 0 in the south; empty where it was not recorded.
        slow: how many times slower than all else the storm's waves go, at least 1.
        period: of the storm's highest wave, s; 0 without a storm.
    """

    def __init__(self, trace: Trace, speed_up: float = 1.0) -> None:
        """`speed_up`: of the video, s of mission in a second."""
        self.surface, self._storm, self._time = trace.surface, trace.storm, trace.time
        self.slow = max(speed_up, 1.0) if len(trace.storm) else 1.0
        self.period = 2 * math.pi / float(trace.storm[trace.storm[:, 0].argmax(), 3]) if len(trace.storm) else 0.0
        some = self.surface[:: max(1, len(self.surface) // LOOKS)]
        _, rows, columns = trace.surface.shape
        moves = (some != some[:1]).any(axis=0) if len(some) > 1 else np.ones((rows, columns))
        self._water = moves.astype(np.float32)  # 0 on land
        self._x, self._y = trace.scenario.area.middles(columns, rows)
        self._long: dict[int, np.ndarray] = {}  # of the latest steps
        self._shown: tuple[float, np.ndarray] = -1.0, np.zeros((rows, columns), np.float32)

    def at(self, t: float) -> np.ndarray:
        """Elevation (Y, X) float32 at a moment, m; empty where it was not recorded."""
        step = step_of(t)
        recorded = t - step < ROUNDING or step + 1 == len(self.surface)
        if not self.surface.size or (recorded and self.slow == 1.0):
            return self.surface[step] if self.surface.size else self._shown[1]
        if self._shown[0] != t:  # several views show the same moment
            storm = elevation(self._storm, self._x, self._y, self._time_of(t) / self.slow)
            self._shown = t, self._long_waves(t) + storm * self._water
        return self._shown[1]

    def on(self, t: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Elevation (len(y), len(x)) float32 at a moment on a finer grid of points x and y, m."""
        if not self.surface.size:
            return np.zeros((len(y), len(x)), np.float32)
        long, water = self.beneath(t, *np.meshgrid(x, y))
        return long + elevation(self._storm, x, y, self._time_of(t) / self.slow) * water

    def beneath(self, t: float, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Long waves (m) at a moment, and 1 for water and 0 for land, at points x and y (m), beyond the area as at its
        border; float32.
        """
        columns, rows = (
            ((new - old[0]) / max(old[-1] - old[0], 1e-9) * (len(old) - 1)).astype(np.float32)
            for new, old in ((x, self._x), (y, self._y))
        )
        long = cv2.remap(self._long_waves(t), columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return long, cv2.remap(self._water, columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)

    def storm(self, t: float) -> np.ndarray:
        """The storm's waves as they are shown at a moment: a (m), kx, ky (rad/m) and phase (rad), (N, 4)."""
        a, kx, ky, omega, phase = self._storm.T
        return np.stack([a, kx, ky, phase - omega * self._time_of(t) / self.slow], axis=1)

    def under(self, place: np.ndarray, floating: np.ndarray, at: np.ndarray) -> np.ndarray:
        """What is shown of elevation (m) and slopes to the east and north under a boat, (T, …, 3).

        Args:
            place: of the boat at each step, (T, …, 2) m. floating: elevation and slopes recorded there, (T, …, 3).
            at: where the boat is drawn, (T, …, 2) m.
        """
        shown = floating.astype(float)
        for there, time, sign in ((at, self._time / self.slow, 1.0), (place, self._time, -1.0)) * (self.slow > 1.0):
            for a, kx, ky, omega, phase in self._storm:
                turned = (omega * time).reshape(-1, *[1] * (place.ndim - 2))
                angle = kx * there[..., 0] + ky * there[..., 1] - turned + phase
                rise = -a * np.sin(angle)
                shown += sign * np.stack([a * np.cos(angle), kx * rise, ky * rise], axis=-1)
        return shown

    def _time_of(self, t: float) -> float:
        return float(np.interp(t, np.arange(len(self._time)), self._time))

    def _long_waves(self, t: float) -> np.ndarray:
        """The surface less the storm, (Y, X)."""
        weights = cubic(t, len(self.surface))
        for step, _ in weights:
            if step not in self._long:
                storm = elevation(self._storm, self._x, self._y, float(self._time[step]))
                self._long[step] = self.surface[step] - storm * self._water
        self._long = {step: self._long[step] for step, _ in weights}
        return sum((np.float32(weight) * self._long[step] for step, weight in weights), np.zeros((), np.float32))


def error_axes(covariance: np.ndarray) -> np.ndarray:
    """Semi-axes (..., 2, 2) of error ellipses, one a row, m, of covariances (..., 3) xx, xy, yy in m²."""
    variances, directions = np.linalg.eigh(np.asarray(covariance, float)[..., [[0, 1], [1, 2]]])
    return SIGMAS * np.sqrt(np.maximum(variances, 0.0))[..., None] * np.swapaxes(directions, -1, -2)


RHYTHM = 10  # frames of the video after which numbers are written anew
PING_STEPS = 12  # in which the ring of a ping runs from the boat to the farthest AUV
PINGS_APART = 3  # times as long from one ring to the next: fewer than there are pings
HEARD_STEPS = 6.0  # in which the line to an AUV fades to 1/e after its reply
RANGE_STEPS = 10.0  # in which a range fades to 1/e
NEXT = 3  # nodes of an AUV that are shown beyond the one it heads for


class Playback:
    """World 0 of a trace of T steps, K AUVs, M nodes and B boats.

    Attributes:
        pace: steps of the mission from one frame to the next. sea: its surface. stations: whether the AUVs keep some.
        nodes: series of places, m; `node_way` has them at each step, or once. moving: whether they move, as targets
            that AUVs track. tracks: whether the AUVs estimate where they are. tracked, track_covariance: their
            estimates, m, m²; empty without any.
            track_error: (T,) their error, mean over targets, m. target_depth: at which they are drawn, m.
        time, duration: s. depths: of the AUVs, m. covariance: m².
        boats, auvs, estimated, foreseen, goals: series of places, m.
        floating: (B, 3) elevation (m) and slopes to the east and north under the boats, as shown.
        boat_headings: (B,) rad. attitude: (K, 3) of the AUVs, rad. hovering: (T, K) whether they do.
        fill, age: (T, M) data of the nodes over their buffers, and how old it is over `OLD`; stations have none.
        services: (T,) completed so far. delivered: (T,) Mbit so far.
        position_error: (T, K) horizontal distance from the true position to the estimate, m.
        error_median: (T, K) its median over the last 30 s.
        off_target: (T,) mean over AUVs of the distance to the target, m.
        reward: (T, R) terms of the reward a step, summed over AUVs, mean of the last 30 s.
        service_share: (T, K) completed part of the service under way, 0 when travelling.
    """

    def __init__(self, trace: Trace, pace: float = 1.0, speed_up: float = 1.0, end: float | None = None) -> None:
        """`speed_up`: of the video, s of mission in a second. `end`: moment of its last frame, by default the last."""
        self._end = len(trace.time) - 1.0 if end is None else end
        self.trace, self.pace, self.sea, scenario = trace, pace, RecordedSea(trace, speed_up), trace.scenario
        window = max(1, round(MEDIAN_WINDOW / scenario.mission.step))
        self.stations = scenario.task == "station-keeping"
        self.moving = trace.node_way.size > 0
        self.node_way = (trace.node_way if self.moving else trace.node_position[None])[:, 0].astype(float)
        self.nodes = self.of_nodes(self.node_way)
        self.tracked, self.track_covariance = (self.of_nodes(np.zeros((1, 0, n))) for n in (2, 3))
        self.track_error, self.target_depth = np.zeros(len(trace.time)), 0.0
        self.tracks, self._settled = trace.node_estimate.size > 0, 0
        if self.tracks:
            self.tracked = Series(trace.node_estimate[:, 0].astype(float))
            self.track_covariance = Series(trace.node_covariance[:, 0].astype(float))
            self.track_error = track_error(trace)[:, 0].mean(axis=1)
            self.target_depth = middle_depth(trace.scenario)
            self._settled = settled(trace).start
        self._ranged = latest(trace.node_range[:, 0] > 0) if trace.node_range.size else np.zeros((1, 0, 0), int)
        self.duration = max(float(trace.time[-1]), scenario.mission.step)
        self.time, self.depths = Series(trace.time), Series(trace.depth[:, 0])
        moving = trace.boat_position, trace.auv_position
        place, auvs = (values[:, 0] for values in moving)
        shown = running_mean(place, round(self.sea.period / scenario.mission.step)) if self.sea.slow > 1.0 else place
        self.boats, self.auvs = Series(shown, smooth=True), Series(auvs, smooth=True)
        self.floating = Series(self.sea.under(place, trace.boat_surface[:, 0], shown), smooth=True)
        linear = trace.boat_heading, trace.boat_goal, trace.estimate, trace.estimate_covariance, trace.foreseen_position
        self.boat_headings, self.goals, self.estimated, self.covariance, self.foreseen = (
            Series(values[:, 0]) for values in linear
        )
        attitude, turning = trace.attitude[:, 0].astype(float), round(TURN_FRAMES * pace)
        if turning > 1:
            speed = np.hypot(*np.moveaxis(trace.auv_velocity[:, 0].astype(float), -1, 0))
            attitude[..., 0] = calm_heading(attitude[..., 0], speed, turning)
            self.goals = Series(running_mean(self.goals.values, turning))
            headings = self.boat_headings.values.astype(float)
            self.boat_headings = Series(calm_heading(headings, np.ones_like(headings), turning))
        self.attitude = Series(attitude)
        self.hovering, self._target = trace.hovering[:, 0].astype(bool), trace.target[:, 0]
        self.fill = trace.backlog[:, 0] / scenario.nodes.buffer
        self.age = age(trace)[:, 0] / OLD * (not self.stations and not self.moving)
        rate = trace.service_rate[:, 0].astype(float)
        self._sdr, self._ec = np.cumsum(rate.sum(axis=1)), energy_consumption(trace)[:, 0]
        self._power, self._full = trace.power[:, 0].sum(axis=1), trace.overflowing[:, 0]
        self.services = np.cumsum((rate > 0).sum(axis=1))
        self.delivered = np.cumsum(trace.delivered[:, 0].astype(float).sum(axis=1))
        self.position_error = position_error(trace)[:, 0].astype(float)
        self.error_median = _running_median(self.position_error, window)
        self.off_target = target_distance(trace)[:, 0].mean(axis=1)
        self.reward = _smooth(trace.reward_terms[:, 0].sum(axis=1, dtype=float), window)
        self.service_share = _service_share(self.hovering, rate > 0)
        flags, self._by = trace.fix_flags[:, 0], trace.fix_boat[:, 0]
        self._heard = latest((flags & usbl.DETECTED) > 0)
        boats = np.arange(trace.boat_position.shape[2])
        asked = (((flags & usbl.SILENT) == 0)[..., None] & (self._by[..., None] == boats)).any(axis=1)
        self._ring_steps = PING_STEPS * math.sqrt(pace)  # in slow motion faster, but calm enough for the eye
        self._pinged = np.stack([_pings(by_boat, PINGS_APART * self._ring_steps) for by_boat in asked.T], axis=1)

    def of_nodes(self, values: np.ndarray) -> Series:
        """Series of values of nodes at each step, or of one that lasts."""
        return Series(np.broadcast_to(values, (len(self.trace.time), *values.shape[1:])))

    @cached_property
    def site(self) -> Site:
        """Site of the mission, with its bed."""
        return Site.recorded(self.trace.scenario)

    @cached_property
    def bed(self) -> np.ndarray:
        """Depth (T, K) of the bed below the AUVs, m."""
        return self.site.depth_at(self.trace.auv_position[:, 0])

    @cached_property
    def field(self) -> ReplyField:
        """Values of places of the boat."""
        return ReplyField(self.trace)

    def figures(self, t: float) -> list[tuple[str, float, str]]:
        """Figures of a moment: name with unit, value, and how it is written (a format specification)."""
        t = step_of(t)
        if self.moving:
            return [
                ("target error, m", self.track_error[t], ".1f"),
                ("mean so far, m", self.track_error[min(self._settled, t) : t + 1].mean(), ".1f"),
                ("power now, W", self._power[t], ".0f"),
                ("EC, W", self._ec[t], ".1f"),
                ("AUVs too close", self.trace.collisions[: t + 1, 0].sum(), ".0f"),
            ]
        if self.stations:
            return [
                ("off station, m", self.off_target[t], ".2f"),
                ("mean so far, m", self.off_target[: t + 1].mean(), ".2f"),
                ("power now, W", self._power[t], ".0f"),
                ("EC, W", self._ec[t], ".1f"),
                ("AUVs too close", self.trace.collisions[: t + 1, 0].sum(), ".0f"),
            ]
        return [
            ("SDR, Mbit/s", self._sdr[t], ".2f"),
            ("EC, W", self._ec[t], ".1f"),
            ("services", self.services[t], ".0f"),
            ("delivered, Mbit", self.delivered[t], ".1f"),
            ("full nodes", self._full[t], ".0f"),
        ]

    def told(self, t: float) -> float:
        """Moment whose numbers are written at a moment: every `RHYTHM` frames another, up to that of the last frame."""
        return max(t - (t - self._end) % (RHYTHM * self.pace), 0.0)

    def track(self, t: float, most: int) -> np.ndarray:
        """Steps of a trail that ends at the one before a moment; at most `most` pieces, however short the step."""
        t = step_of(t)
        first = max(0, t - round(TRAIL / self.trace.scenario.mission.step))
        return np.unique(np.linspace(first, t, min(t - first, most) + 1).astype(int))

    def ping(self, t: float) -> list[float | None]:
        """For each boat the share of its way that its ping has run at a moment; None without one."""
        began = self._pinged[step_of(t)].tolist()
        shares = ((t - step) / self._ring_steps if step >= 0 else 1.0 for step in began)
        return [share if share < 1 else None for share in shares]

    def pinged(self, steps: slice) -> np.ndarray:
        """(T,) whether the ring of a boat's ping is drawn in each of some steps."""
        since = np.arange(len(self._pinged))[steps, None] - self._pinged[steps]
        return np.any((self._pinged[steps] >= 0) & (since < self._ring_steps), axis=1)

    def heard(self, t: float, auv: int) -> tuple[int, float]:
        """The boat with an AUV's last reply, and how recent it is at a moment: 1 in that step, 0 without one."""
        last = int(self._heard[step_of(t), auv])
        return int(self._by[last, auv]), math.exp((last - t) / HEARD_STEPS) if last >= 0 else 0.0

    def ranges(self, t: float) -> list[tuple[int, int, np.ndarray, float, float]]:
        """Ranges that are fresh at a moment: the AUV, the target, the place (2,) where the AUV took itself to be, the
        horizontal range, m, and how recent it is, 1 in its step."""
        found, trace = [], self.trace
        for auv, target in np.ndindex(self._ranged.shape[1:]):
            step = int(self._ranged[step_of(t), auv, target])
            fresh = math.exp((step - t) / RANGE_STEPS) if step >= 0 else 0.0
            if fresh > 0.1:
                height = self.target_depth - float(trace.depth[step, 0, auv])
                across = math.sqrt(max(float(trace.node_range[step, 0, auv, target]) ** 2 - height**2, 0.0))
                found.append((auv, target, trace.own_position[step, 0, auv].astype(float), across, fresh))
        return found

    def stops(self, t: int, auv: int) -> list[int]:
        """The node an AUV serves or heads for in a step, and those it went to after it, at most `NEXT`."""
        # In the last step of a service the target is already the next node.
        target = self._target[t - 1 if self.hovering[t, auv] and t > 0 else t :, auv]
        return [int(target[0]), *target[1:][np.diff(target) != 0][:NEXT].tolist()]


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


def running_mean(series: np.ndarray, window: int) -> np.ndarray:
    """Mean (T, …) over `window` rows around each row, over fewer at both ends."""
    total = np.concatenate([0 * series[:1], np.cumsum(series, axis=0)])
    reach = np.minimum(np.minimum(np.arange(len(series)), np.arange(len(series))[::-1]), window // 2)
    first, last = np.arange(len(series)) - reach, np.arange(len(series)) + reach + 1
    return (total[last] - total[first]) / (last - first).reshape(-1, *[1] * (series.ndim - 1))


TURN_FRAMES = 12.0  # of the video, over which the headings of vehicles are averaged
LEAST_WAY = 0.25  # of the usual speed, below which a mean way has no direction


def calm_heading(heading: np.ndarray, speed: np.ndarray, window: int) -> np.ndarray:
    """Headings (T, N), continuous, rad, of the mean way over `window` rows, of headings and speeds (T, N).

    Where a vehicle gets nowhere, as on a small circle or at a stop, it keeps its heading.
    """
    ways = running_mean(speed * np.exp(1j * heading), window)
    certain = np.abs(ways) > LEAST_WAY * np.quantile(speed, 0.9, axis=0)
    certain[0] = True
    last = np.where(certain, np.arange(len(ways))[:, None], 0)
    kept = np.take_along_axis(ways, np.maximum.accumulate(last, axis=0), axis=0)
    turned = running_mean(np.where(kept == 0, 1, kept) / np.maximum(np.abs(kept), 1e-12), window)
    return np.unwrap(np.angle(turned), axis=0)


def _service_share(hovering: np.ndarray, completed: np.ndarray) -> np.ndarray:
    """Completed part of each service (T, K), from the first hovering step to the last."""
    done = hovering.astype(float)  # steps of the service so far
    for t in range(1, len(done)):
        done[t] *= 1 + done[t - 1] * ~completed[t - 1]
    steps = done.copy()  # of the whole service
    for t in range(len(done) - 1, 0, -1):
        steps[t - 1] = np.where(done[t] > done[t - 1], steps[t], done[t - 1])
    return done / np.maximum(steps, 1)


def _pings(asked: np.ndarray, apart: float) -> np.ndarray:
    """Row (T,) in which the ring that is shown began, of flags (T,) of exchanges; −1 before the first.

    Rings begin at least `apart` rows after each other.
    """
    shown = np.zeros(len(asked), bool)
    last = -apart
    for row in np.flatnonzero(asked):
        if row - last >= apart:
            shown[row], last = True, row
    return latest(shown)
