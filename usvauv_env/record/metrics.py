"""Figures of merit of an episode, computed from a trace alone.

`sdr`, `ec` and `arps` are Table 2's sum data rate, energy consumption and average reward per time step. They ignore
where data come from and how old they are: visiting near nodes often raises all three. It does not improve the figures
of the task data-collection: age of the data, fairness between nodes, energy per Mbit and lost data.

Source of the age of information: S. Kaul, R. Yates, M. Gruteser, "Real-time status: How often should one update?", IEEE
INFOCOM 2012, doi 10.1109/INFCOM.2012.6195689; of the index of fairness: R. Jain, D. Chiu, W. Hawe, DEC Research Report
TR-301, 1984.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Annotated, Any

import numpy as np

from usvauv.env.record.headings import largest_so_far, latest
from usvauv.env.record.trace import Trace
from usvauv.kernels.positioning.usbl import DETECTED, UNUSABLE, WRAPPED
from usvauv.kernels.registry import Registry


@dataclass(frozen=True)
class EpisodeMetrics:
    """One row of the metrics CSV; T mission steps of dt seconds, K AUVs.

    Attributes:
        scenario, policy, usv, seed, episode: the run; rows with equal seed and episode are the same world.
        sdr: sum over services of the data rate, Mbit/s.
        ec: mean over AUVs of energy/(T dt − hovering time), W; see `nodes.hovering_time`; in passing no AUV hovers.
        arps: (1/T) Σ over steps and AUVs of the reward.
        services: number of completed services. delivered_mbit: their data, Mbit.
        energy_wh: energy of all AUVs, Wh.
        boat_energy_wh: energy of all boats, Wh; NaN if it is not counted.
        spent: number of AUVs whose battery is spent at the end. spent_first: when the first one's was, s; NaN if none.
        target_distance: mean true distance of the AUVs to their targets, m.
        overflow: node-steps in which a full buffer lost packets.
        collisions: pair-steps below the collision distance. border: refused moves.
        surfaced, grounded: AUV-steps in which a vehicle with dynamics touched the surface, or the bed.
        position_error_mean, _median, _rms, _p95: of |estimate − truth| over all AUVs and steps, m.
        own_error_mean, _median, _rms, _p95: the same for the AUVs' own position estimates.
        fix_error_mean, _median, _rms, _p95: of |fix − the AUV's position as its signal left| over all usable fixes, m;
            NaN without one, see `usable`.
        fix_availability: share of steps and AUVs with a usable fix. fix_wrapped: share of usable fixes that are wrong
            by whole turns of a phase; NaN without one. fix_dropped: share of detected fixes that the receiver does not
            use, see `usbl.UNUSABLE`; NaN without one.
        outage_longest: longest time of an AUV without a usable fix, s.
        targets: rule by which the AUVs chose their targets; empty if the task has no targets.
        of_task: the task's figures in `task_metrics`, by name.
    """

    scenario: str
    policy: str
    usv: str
    seed: int
    episode: int
    sdr: float
    ec: float
    arps: float
    services: int
    delivered_mbit: float
    energy_wh: float
    boat_energy_wh: float
    spent: int
    spent_first: float
    target_distance: float
    overflow: int
    collisions: int
    border: int
    surfaced: int
    grounded: int
    position_error_mean: float
    position_error_median: float
    position_error_rms: float
    position_error_p95: float
    own_error_mean: float
    own_error_median: float
    own_error_rms: float
    own_error_p95: float
    fix_error_mean: float
    fix_error_median: float
    fix_error_rms: float
    fix_error_p95: float
    fix_availability: float
    fix_wrapped: float
    fix_dropped: float
    outage_longest: float
    targets: str
    of_task: dict[str, float] = field(default_factory=dict)

    def columns(self) -> dict[str, Any]:
        """The row of the CSV, column → value."""
        return {name: getattr(self, name) for name in COLUMNS} | self.of_task


COLUMNS = tuple(column.name for column in fields(EpisodeMetrics) if column.name != "of_task")
FIGURES = COLUMNS[5:-1]


@dataclass(frozen=True)
class Metric:
    """A task's figure of merit.

    Attributes:
        task: name of the task, or of several.
        values: function: trace → one number for each world, (W,).
    """

    task: str | tuple[str, ...]
    values: Annotated[Callable[[Trace], np.ndarray], "trace"]

    def belongs_to(self, task: str) -> bool:
        """Whether it is a figure of this task."""
        return task in ((self.task,) if isinstance(self.task, str) else self.task)


def position_error(trace: Trace) -> np.ndarray:
    """Distance between estimated and true positions, (T, W, K), m."""
    return np.linalg.norm(trace.estimate - trace.auv_position, axis=-1)


def own_error(trace: Trace) -> np.ndarray:
    """Distance between the AUVs' own position estimates and their true positions, (T, W, K), m."""
    return np.linalg.norm(trace.own_position - trace.auv_position, axis=-1)


def usable(trace: Trace) -> np.ndarray:
    """Whether the boat has a usable fix, (T, W, K), as far as a receiver can tell: see `usbl.UNUSABLE`.

    A signal that is lost, not due, or without a direct ray, is not detected.
    """
    return (trace.fix_flags & (DETECTED | UNUSABLE)) == DETECTED


def distribution(error: np.ndarray) -> dict[str, float]:
    """Mean, median, rms and 95th percentile of errors of any shape, by these names; NaN without errors."""
    if not error.size:
        return dict.fromkeys(("mean", "median", "rms", "p95"), math.nan)
    return {
        "mean": float(error.mean(dtype=np.float64)),
        "median": float(np.median(error)),
        "rms": math.sqrt(np.square(error, dtype=np.float64).mean()),
        "p95": float(np.quantile(error, 0.95)),
    }


def target_distance(trace: Trace) -> np.ndarray:
    """Distance between AUVs and their targets, true positions, (T, W, K), m."""
    target = np.take_along_axis(trace.node_places, trace.target[..., None].astype(np.intp), axis=2)
    return np.linalg.norm(target - trace.auv_position, axis=-1)


def hovering_time(trace: Trace) -> np.ndarray:
    """Time that EC excludes at each step, (T, W, K), s, see `nodes.hovering_time`; a step may correct earlier ones."""
    step = trace.scenario.mission.step
    if trace.scenario.nodes.service == "passing":
        return np.zeros(trace.hovering.shape)
    time = trace.hovering * float(step)
    if trace.scenario.nodes.hovering_time == "exact":
        served = trace.service_rate > 0
        length = np.where(served, trace.delivered, 0.0) / np.where(served, trace.service_rate, 1.0)
        time -= np.ceil(length / step - 1e-4) * step - length  # a service ends within its last step
    return time


def _longest_run(flags: np.ndarray) -> np.ndarray:
    """Largest number of successive steps with a flag (T, W, K) of any AUV in each world, (W,)."""
    run = longest = np.zeros(flags.shape[1:], int)
    for row in flags:
        run = (run + 1) * row
        longest = np.maximum(longest, run)
    return longest.max(-1)


def _first_time(trace: Trace, flags: np.ndarray) -> float:
    """Time of the first step with a flag (T,), s; NaN without one."""
    return float(trace.time[np.argmax(flags)]) if flags.any() else math.nan


def energy_consumption(trace: Trace) -> np.ndarray:
    """Table 2's EC so far: mean over AUVs of energy/(time − hovering time), (T, W), W; at least one step is left."""
    step = trace.scenario.mission.step
    time = step * np.arange(1.0, len(trace.time) + 1)[:, None, None]
    travelling = np.maximum(time - np.cumsum(hovering_time(trace), axis=0), step)
    return (np.cumsum(trace.power, axis=0, dtype=np.float64) * step / travelling).mean(-1)


def served(trace: Trace) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Step, world, AUV and node of every completed service, each (S,), ordered by time."""
    step, world, auv = np.nonzero(trace.service_rate > 0)
    return step, world, auv, _served_node(trace, step, world, auv)


def _served_node(trace: Trace, step: np.ndarray, world: np.ndarray, auv: np.ndarray) -> np.ndarray:
    """The node that an AUV served in a step, (S,); after the service the AUV has a new target."""
    return trace.target[np.maximum(step - 1, 0), world, auv].astype(np.intp)


def newest_birth(trace: Trace) -> np.ndarray:
    """U, (T, W, M), s: birth time of a node's newest data collected so far, at the end of each step.

    A service collects the data that arrived at its node before the AUV did; a node found empty counts as sampled, one
    that the AUV left before it was empty does not. At the start all data born so far count as collected.
    """
    dt = trace.scenario.mission.step
    steps, worlds, nodes = trace.backlog.shape
    birth = np.full((steps, worlds, nodes), trace.time[0] - dt)
    arrived = latest(trace.hovering <= 0)  # the last step of travelling, in which the service began
    t, w, k, i = served(trace)
    np.maximum.at(birth, (t, w, i), trace.time[0] + (arrived[t, w, k] - 1) * dt)
    return largest_so_far(birth)


def age(trace: Trace) -> np.ndarray:
    """Age of information A = t − U, (T, W, M), s, at the end of each step."""
    return trace.time[:, None, None] - newest_birth(trace)


def peak_age(trace: Trace) -> np.ndarray:
    """Mean age just before a service, (W,), s; NaN without a service."""
    t, w, _, i = served(trace)
    before = np.where(t > 0, age(trace)[t - 1, w, i], 0.0)
    peaks = before + trace.scenario.mission.step
    of_worlds = (peaks[w == world] for world in range(trace.backlog.shape[1]))
    return np.array([own.mean() if len(own) else np.nan for own in of_worlds])


def fairness(trace: Trace) -> np.ndarray:
    """Jain's index (Σx)²/(n Σx²) of the data x collected from n nodes, (W,): 1 if all are equal, 1/n if one has all."""
    t, w, k = np.nonzero(trace.delivered > 0)
    _, worlds, nodes = trace.backlog.shape
    data = np.zeros((worlds, nodes))
    np.add.at(data, (w, _served_node(trace, t, w, k)), trace.delivered[t, w, k])
    square = nodes * (data**2).sum(axis=1)
    return np.divide(data.sum(axis=1) ** 2, square, out=np.full(worlds, np.nan), where=square > 0)


def lost_data(trace: Trace) -> np.ndarray:
    """Data lost at full buffers, (W,), Mbit."""
    nodes = trace.scenario.nodes
    return trace.packets_lost.sum(axis=0) * (nodes.payload / nodes.buffer)


def energy_per_data(trace: Trace) -> np.ndarray:
    """Energy of all AUVs divided by the data collected, (W,), J/Mbit; NaN without data."""
    energy = trace.power.sum(axis=(0, 2), dtype=np.float64) * trace.scenario.mission.step
    data = trace.delivered.sum(axis=(0, 2), dtype=np.float64)
    return np.divide(energy, data, out=np.full(len(data), np.nan), where=data > 0)


OF_TARGETS = [
    "track_error_mean",
    "track_error_median",
    "track_error_p95",
    "track_error_rms",
    "track_bound",
    "track_close",
    "track_nees",
    "covered",
    "out_of_range",
]
task_metrics: Registry[Metric] = Registry(
    "metric", form=Metric, shipped=dict.fromkeys(OF_TARGETS, "usvauv.env.record.tracking_metrics")
)
for _name, _values in {
    "lost_mbit": lost_data,
    "aoi_mean": lambda trace: age(trace).mean(axis=(0, 2)),  # s, over nodes and time
    "aoi_peak": peak_age,
    "aoi_largest": lambda trace: age(trace).max(axis=(0, 2)),  # s, of any node at any time
    "jain": fairness,
    "joule_per_mbit": energy_per_data,
}.items():
    task_metrics.register(_name, Metric("data-collection", _values))


def _of_task(name: str, trace: Trace) -> np.ndarray:
    """A figure of the task for each world, (W,).

    Raises:
        UserError: a plugin's metric fails, or does not return this.
    """
    with task_metrics.calling(name):
        values = task_metrics[name].values(trace)
    worlds = trace.node_position.shape[0]
    if not isinstance(values, np.ndarray) or values.shape != (worlds,) or values.dtype.kind not in "biuf":
        raise task_metrics.refuse(name, values, f"an array of {worlds} numbers, one a world")
    if np.isinf(values).any():
        raise task_metrics.refuse(name, values, "finite, or NaN where an episode has no such figure")
    return values


def episode_metrics(trace: Trace, first_episode: int = 0) -> list[EpisodeMetrics]:
    """One row for each world of a trace."""
    step = trace.scenario.mission.step
    error = position_error(trace)
    own = own_error(trace)
    fix_error = np.linalg.norm(trace.fix - trace.heard_position, axis=-1)
    had = usable(trace)
    wrapped = (trace.fix_flags & WRAPPED) > 0
    detected = (trace.fix_flags & DETECTED) > 0
    outage = _longest_run(~had) * step
    distance = target_distance(trace)
    ec = energy_consumption(trace)[-1]
    reward = trace.reward_terms.sum(axis=(2, 3), dtype=np.float64).mean(0)
    touched = trace.auv_touched.astype(np.int8)
    spent, metered = trace.auv_charge == 0, trace.boat_power.size > 0
    of_task = {name: _of_task(name, trace) for name, m in task_metrics.items() if m.belongs_to(trace.scenario.task)}
    return [
        EpisodeMetrics(
            scenario=trace.scenario.name,
            policy=trace.policy,
            usv=trace.usv,
            seed=trace.seed,
            episode=first_episode + w,
            sdr=float(trace.service_rate[:, w].sum(dtype=np.float64)),
            ec=float(ec[w]),
            arps=float(reward[w]),
            services=int((trace.service_rate[:, w] > 0).sum()),
            delivered_mbit=float(trace.delivered[:, w].sum(dtype=np.float64)),
            energy_wh=float(trace.power[:, w].sum(dtype=np.float64) * step / 3600),
            boat_energy_wh=float(trace.boat_power[:, w].sum(dtype=np.float64) * step / 3600) if metered else math.nan,
            spent=int(spent[-1:, w : w + 1].sum()),
            spent_first=_first_time(trace, spent[:, w : w + 1].any(axis=(1, 2))),
            target_distance=float(distance[:, w].mean()),
            overflow=int(trace.overflowing[:, w].sum()),
            collisions=int(trace.collisions[:, w].sum()),
            border=int(trace.border[:, w].sum()),
            surfaced=int((touched[:, w : w + 1] & 1).sum()),
            grounded=int((touched[:, w : w + 1] & 2 > 0).sum()),
            **{f"position_error_{name}": value for name, value in distribution(error[:, w]).items()},
            **{f"own_error_{name}": value for name, value in distribution(own[:, w]).items()},
            **{f"fix_error_{name}": value for name, value in distribution(fix_error[:, w][had[:, w]]).items()},
            fix_availability=float(had[:, w].mean()),
            fix_wrapped=float(wrapped[:, w][had[:, w]].mean()) if had[:, w].any() else math.nan,
            fix_dropped=float((~had)[:, w][detected[:, w]].mean()) if detected[:, w].any() else math.nan,
            outage_longest=float(outage[w]),
            targets=trace.scenario.nodes.target_rule if trace.scenario.task_definition.targets == "nodes" else "",
            of_task={name: float(values[w]) for name, values in of_task.items()},
        )
        for w in range(trace.node_position.shape[0])
    ]


def values_of(rows: Sequence[EpisodeMetrics], name: str) -> list[float]:
    """A figure's values in the episodes that have it, such as the age before a service; without any, one NaN."""
    values = [row.columns()[name] for row in rows]
    return [value for value in values if not math.isnan(value)] or [math.nan]


def mean_figures(rows: Sequence[EpisodeMetrics]) -> dict[str, float]:
    """Mean of every figure over the episodes that have it; figures that no episode has are left out."""
    means = {name: statistics.fmean(values_of(rows, name)) for name in (*FIGURES, *rows[0].of_task)}
    return {name: mean for name, mean in means.items() if not math.isnan(mean)}
