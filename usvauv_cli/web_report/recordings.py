"""What the page shows of traces: of one episode a thinned record, of all episodes the distribution of fix errors."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from usvauv.env.record import collection
from usvauv.env.record.growing_table import Combination
from usvauv.env.record.metrics import usable
from usvauv.env.record.trace import Trace
from usvauv.env.scenario import Scenario

MOST_SHOWN = 12  # combinations with an episode and a line in the figures
FRONT_EPISODES = 2400  # points of episodes in the figure of the front
FRAME_BYTES = 900_000  # of the frames of all episodes
TRACK_POINTS = 12_000  # of all tracks of all episodes
MOST_TRACK = 400  # points of a track
PERIODS = 100  # of the mission, for errors over time
ERRORS = np.logspace(-3, 4, 7 * 40 + 1)  # edges of the classes of errors, m: 6 % wide


@dataclass(frozen=True)
class Episode:
    """World 0 of a combination; F steps are kept, K AUVs, B boats, M nodes, V vortices.

    Attributes:
        steps: of the episode. time: (F,) s.
        auv, estimate: (F, K, 2) true and estimated positions, m. ellipse: (F, K, 3) semi-axes of one standard deviation
            of the estimate, m, at most the longer side of the area, and the angle of the first from east, rad.
        target: (F, K) index of the node headed for. hovering: (F, K).
        boat: (F, B, 2) m. vortex: (F, V, 4). stream_time, stream: see `Trace`.
        node: (M, 2) m. fill: (F, M) share of the buffer, (F, 0) where nodes have no data.
        data: (F,) collected so far, Mbit. energy: (F,) spent so far, Wh.
        tracks: of the AUVs, then of the boats, (points, 2) m.
        age: (M,) mean age of data over the episode, s; empty where nodes have none.
    """

    steps: int
    time: np.ndarray
    auv: np.ndarray
    estimate: np.ndarray
    ellipse: np.ndarray
    target: np.ndarray
    hovering: np.ndarray
    boat: np.ndarray
    vortex: np.ndarray
    stream_time: np.ndarray
    stream: np.ndarray
    node: np.ndarray
    fill: np.ndarray
    data: np.ndarray
    energy: np.ndarray
    tracks: list[np.ndarray]
    age: np.ndarray


@dataclass
class Recording:
    """One combination: its recorded episode, and counts (PERIODS, classes of `ERRORS`) of fixes of all episodes."""

    episode: Episode
    fixes: np.ndarray = field(default_factory=lambda: np.zeros((PERIODS, len(ERRORS) - 1), np.int64))


class Recordings(dict[Combination, Recording]):
    """Recordings of the first `MOST_SHOWN` of some combinations."""

    def __init__(self, combinations: int) -> None:
        super().__init__()
        self.shown = min(combinations, MOST_SHOWN)

    def add(self, trace: Trace, first: int) -> None:
        """Take what is shown of the trace of worlds from number `first` on."""
        rule = trace.scenario.nodes.target_rule if collects_data(trace.scenario) else ""
        combination = Combination(trace.policy, trace.usv, rule)
        if combination not in self:
            if len(self) == self.shown:
                return
            self[combination] = Recording(thinned(trace.episode(0), self.shown))
        step, world, auv = np.nonzero(usable(trace))
        off = trace.fix[step, world, auv] - trace.heard_position[step, world, auv]
        level = np.searchsorted(ERRORS, np.hypot(off[:, 0], off[:, 1]), side="right") - 1
        np.add.at(
            self[combination].fixes,
            (step * PERIODS // len(trace.time), np.clip(level, 0, len(ERRORS) - 2)),
            1,
        )


def front_episodes(combinations: int) -> int:
    """Number of episodes of each combination that have a point in the figure of the front."""
    return max(FRONT_EPISODES // min(combinations, MOST_SHOWN), 1)


def collects_data(scenario: Scenario) -> bool:
    """Whether AUVs go to nodes, which have data."""
    return scenario.task_definition.targets == "nodes"


def thinned(trace: Trace, episodes: int) -> Episode:
    """World 0 of a trace, its steps thinned so that as many episodes stay within `FRAME_BYTES`."""
    area, with_data = trace.scenario.area, collects_data(trace.scenario)
    steps, _, auvs = trace.power.shape
    boats, nodes, vortices = trace.boat_position.shape[2], trace.backlog.shape[2], trace.vortex.shape[2]
    size = 2 * (3 + 8 * auvs + 2 * boats + 4 * vortices) + auvs + nodes * with_data  # as `player` encodes them
    kept = evenly(steps, FRAME_BYTES // (episodes * size))
    points = evenly(steps, min(TRACK_POINTS // (episodes * (auvs + boats)), MOST_TRACK))
    moving = [*np.moveaxis(trace.auv_position[points, 0], 1, 0), *np.moveaxis(trace.boat_position[points, 0], 1, 0)]
    seconds = trace.scenario.mission.step
    return Episode(
        steps=steps,
        time=trace.time[kept],
        auv=trace.auv_position[kept, 0],
        estimate=trace.estimate[kept, 0],
        ellipse=ellipses(trace.estimate_covariance[kept, 0], max(area.width, area.length)),
        target=trace.target[kept, 0],
        hovering=trace.hovering[kept, 0],
        boat=trace.boat_position[kept, 0],
        vortex=trace.vortex[kept, 0],
        stream_time=trace.stream_time,
        stream=trace.stream,
        node=trace.node_position[0],
        fill=trace.backlog[kept, 0] / trace.scenario.nodes.buffer if with_data else np.zeros((len(kept), 0)),
        data=np.cumsum(trace.delivered[:, 0].sum(axis=1, dtype=np.float64))[kept],
        energy=np.cumsum(trace.power[:, 0].sum(axis=1, dtype=np.float64))[kept] * seconds / 3600,
        tracks=moving,
        age=collection.age(trace)[:, 0].mean(axis=0) if with_data else np.zeros(0),
    )


def evenly(count: int, most: int) -> np.ndarray:
    """At most so many of the indices of `count` things, at least two, evenly, with the first and the last."""
    return np.unique(np.linspace(0, count - 1, max(min(count, most), 2)).round().astype(int))


def ellipses(covariance: np.ndarray, largest: float) -> np.ndarray:
    """Semi-axes of one standard deviation, m, the larger first, and the angle of the first, rad in [0, π), (..., 3).

    Args:
        covariance: (..., 3) xx, xy, yy, m².
        largest: to which axes are cut, m.
    """
    xx, xy, yy = np.moveaxis(covariance.astype(np.float64), -1, 0)
    middle, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    axes = np.sqrt(np.maximum([middle + spread, middle - spread], 0.0)).clip(max=largest)
    angle = np.arctan2(2 * xy, xx - yy) / 2 % np.pi
    return np.stack([*axes, angle], axis=-1)


def fix_quantiles(counts: np.ndarray, shares: tuple[float, ...]) -> np.ndarray:
    """Quantiles of errors from counts (..., classes), (shares, ...), m: the middle of their class; NaN of no fixes."""
    total = counts.sum(axis=-1)
    below = np.cumsum(counts, axis=-1)
    middle = np.sqrt(ERRORS[1:] * ERRORS[:-1])
    found = np.array([middle[(below >= share * total[..., None]).argmax(axis=-1)] for share in shares])
    return np.where(total > 0, found, np.nan)
