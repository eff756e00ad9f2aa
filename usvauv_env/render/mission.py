"""What views show of a step of a trace: figures so far, pings and replies, next nodes, worth of boat positions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from contourpy import contour_generator

from usvauv.env.planning.fix_errors import reception
from usvauv.env.record.metrics import energy_consumption, position_error, target_distance
from usvauv.env.record.trace import Trace
from usvauv.env.render.between import Sea, step_of
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table
from usvauv.kernels import runtime
from usvauv.kernels.positioning import usbl

MEDIAN_WINDOW = 30.0  # s
TRAIL = 120.0  # s


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
        service_share: (T, K) completed part of the service under way, 0 when travelling.
        sea: its surface. pace: steps of the mission from one frame to the next.
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
    service_share: np.ndarray
    sea: Sea
    pace: float

    @classmethod
    def of(cls, trace: Trace, pace: float = 1.0) -> RunningMetrics:
        step = trace.scenario.mission.step
        rate = trace.service_rate[:, 0].astype(float)
        hovering = trace.hovering[:, 0].astype(bool)
        error = position_error(trace)[:, 0].astype(float)
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
            service_share=_service_share(hovering, rate > 0),
            sea=Sea(trace),
            pace=pace,
        )


def figures(trace: Trace, running: RunningMetrics, t: float) -> list[tuple[str, float, str]]:
    """Figures of a moment: name with unit, value, and how it is written (a format specification)."""
    t = step_of(t)
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


PING_STEPS = 12  # in which the ring of a ping runs from the boat to the farthest AUV; one begins after another
HEARD_STEPS = 6.0  # in which the line to an AUV that was heard fades to 1/e


def latest(happened: np.ndarray) -> np.ndarray:
    """Row (T, ...) in which something last happened, for each row of flags (T, ...); −1 before the first."""
    rows = np.arange(len(happened)).reshape(-1, *[1] * (happened.ndim - 1))
    return np.maximum.accumulate(np.where(happened, rows, -1))


def pings(asked: np.ndarray, apart: float = PING_STEPS) -> np.ndarray:
    """Row (T,) in which the ring that is shown began, of flags (T,) of exchanges; −1 before the first.

    Rings begin at least `apart` rows after each other.
    """
    shown = np.zeros(len(asked), bool)
    last = -apart
    for row in np.flatnonzero(asked):
        if row - last >= apart:
            shown[row], last = True, row
    return latest(shown)


class Exchanges:
    """Pings that are on their way, and replies that were heard, in world 0 of a trace; `pace` in steps a frame."""

    def __init__(self, trace: Trace, pace: float) -> None:
        flags, self._by = trace.fix_flags[:, 0], trace.fix_boat[:, 0]
        self._heard = latest((flags & usbl.DETECTED) > 0)
        boats = np.arange(trace.boat_position.shape[2])
        asked = (((flags & usbl.SILENT) == 0)[..., None] & (self._by[..., None] == boats)).any(axis=1)
        self._steps = PING_STEPS * math.sqrt(pace)  # in slow motion faster, but calm enough for the eye
        self._pinged = np.stack([pings(by_boat, self._steps) for by_boat in asked.T], axis=1)

    def ping(self, t: float) -> list[float | None]:
        """For each boat the share of its way that its ping has run at a moment; None without one."""
        pinged = self._pinged[step_of(t)]
        shares = ((t - pinged) / self._steps).tolist()
        return [
            share if began >= 0 and share < 1 else None for began, share in zip(pinged.tolist(), shares, strict=True)
        ]

    def heard(self, t: float, auv: int) -> tuple[int, float]:
        """The boat that last heard an AUV, and how fresh that is at a moment: 1 in that step, 0 if it never was."""
        last = int(self._heard[step_of(t), auv])
        return int(self._by[last, auv]), math.exp((last - t) / HEARD_STEPS) if last >= 0 else 0.0


NEXT = 3  # nodes of an AUV that are shown beyond the one it heads for


class Itinerary:
    """Targets of world 0 of a trace."""

    def __init__(self, trace: Trace) -> None:
        self._target, self._hovering = trace.target[:, 0], trace.hovering[:, 0]

    def node(self, t: int, auv: int) -> int:
        """The node an AUV serves or heads for."""
        return int(self._target[self._decided(t, auv), auv])

    def after(self, t: int, auv: int) -> list[int]:
        """The nodes an AUV went to after the one it serves or heads for, at most `NEXT`."""
        target = self._target[self._decided(t, auv) :, auv]
        return target[1:][np.diff(target) != 0][:NEXT].tolist()

    def _decided(self, t: int, auv: int) -> int:
        """A step with the target of step t: in the last step of a service the target is already the next node."""
        return t - 1 if self._hovering[t, auv] and t > 0 else t


LEVELS = (0.2, 0.4, 0.6, 0.8)
PLACES = 41  # along the longer side
DISTANCES = 128
EVERY = 3  # steps at which lines, which change slowly, are made anew


class ReplyField:
    """What a place of the boat is worth in world 0: the share of the AUVs' uncertainty that replies heard there remove.

    At a place p it is Σ_k P_k(p) a_k / Σ_k a_k, with a_k the variance of where the boat takes AUV k to be, and P_k the
    probability that its reply is heard at p from where the boat foresees it, over a calm array.
    """

    def __init__(self, trace: Trace) -> None:
        area, auv = trace.scenario.area, trace.scenario.auv
        spacing = max(area.width, area.length) / (PLACES - 1)
        self._x, self._y = (np.linspace(0.0, side, round(side / spacing) + 1) for side in (area.width, area.length))
        self._places = np.stack(np.meshgrid(self._x, self._y), -1)
        self._foreseen = trace.foreseen_position[:, 0]
        self._step, self._lines = -1, []
        self._variance = 0.5 * trace.estimate_covariance[:, 0][..., [0, 2]].sum(-1)
        self._distance = np.linspace(0.0, 1.5 * area.diagonal, DISTANCES)
        device = runtime.start().device
        offset = torch.zeros((DISTANCES, 3), device=device)
        offset[:, 0], offset[:, 2] = torch.from_numpy(self._distance), -auv.depth
        link = torch.from_numpy(link_table(Site(trace.scenario))).to(device)
        every = torch.arange(auv.count, dtype=torch.int32, device=device)[:, None].expand(-1, DISTANCES)
        self._heard = [reception(link, k.contiguous(), offset, torch.zeros_like(offset[:, :2]))[2] for k in every]

    def share(self, t: int) -> np.ndarray:
        """The field in step t at the places of a grid, (rows, columns), row 0 in the south."""
        field = np.zeros(self._places.shape[:2])
        for place, variance, heard in zip(self._foreseen[t], self._variance[t], self._heard, strict=True):
            away = np.hypot(*(self._places - place).transpose(2, 0, 1))
            field += variance * np.interp(away, self._distance, heard)
        return field / max(float(self._variance[t].sum()), 1e-12)

    def lines(self, t: int) -> list[tuple[float, list[np.ndarray]]]:
        """Each level with its lines (N, 2), m, in the last step up to t that `EVERY` divides.

        None where all or hardly anything is heard.
        """
        step = t - t % EVERY
        if step != self._step:
            share = self.share(step)
            contours = contour_generator(self._x, self._y, share)
            shown = LEVELS if share.min() <= LEVELS[-1] and share.max() >= LEVELS[0] else ()
            self._step = step
            self._lines = [(level, [np.asarray(line) for line in contours.lines(level)]) for level in shown]
        return self._lines


def track(t: float, step: float, most: int) -> np.ndarray:
    """Steps of a trail that ends at the one before a moment, with a mission step in s; at most `most` pieces, however
    short the step.
    """
    t = step_of(t)
    first = max(0, t - round(TRAIL / step))
    return np.unique(np.linspace(first, t, min(t - first, most) + 1).astype(int))
