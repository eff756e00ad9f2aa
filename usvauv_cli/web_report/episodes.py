"""Data that the page keeps from traces: one episode for the player, and distributions of errors.

The player, `player.js`, reads the episodes as JSON. An array of numbers is {"shape", "low", "step", "bits",
"data"} with value = low + step × unsigned number of so many bits, little-endian, in base64. The rounding error is half
a step.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from usvauv.env.record import metrics
from usvauv.env.record.metrics import usable
from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_metrics import track_error
from usvauv.env.render.style import CATEGORICAL
from usvauv.env.scenario import Scenario
from usvauv.env.storage.result_tables import Combination
from usvauv.kernels.flow.vortex import IMAGES

MOST_SHOWN = 12  # combinations with an episode and a line in the figures
FRONT_EPISODES = 2400  # points of episodes in the figure of the front
FRAME_BYTES = 900_000  # of the frames of all episodes
TRACK_POINTS = 12_000  # of all tracks of all episodes
MOST_TRACK = 400  # points of a track
MOST_AGES = 200  # moments with ages of data
AROUND = 1.2  # of the reach of all ways, the side of the part of the area that is shown
PERIODS = 100  # of the mission, for errors over time
ERRORS = np.logspace(-3, 4, 7 * 40 + 1)  # edges of the classes of errors, m: 6 % wide


@dataclass(frozen=True)
class Episode:
    """World 0 of a combination; K AUVs, B boats, M nodes.

    Attributes:
        steps: of the episode. time: (F,) s, of those that the player has.
        player: JSON of the player, arrays as `encoded` by name. Of F steps: "time", s; true positions "auv" (F, K, 2)
            and "estimate", m; "ellipse", semi-axes of one standard deviation of the estimate (F, K, 2), m, at most the
            longer side of the area, and the angle of the first from east (F, K), rad; "heading" (F, K) anticlockwise
            from east, continuous, rad, (F, 0) of points; "target" (F, K), index of the node headed for; "hovering";
            "boat" (F, B, 2), m; "vortex", centres, m, circulations of the share of the speed that the AUVs meet, m²/s,
            and core radii, m; "fill" (F, M), share of the buffer, (F, 0) where nodes have no data; "data", collected so
            far, Mbit; "energy", spent so far, Wh. Of the real current: "stream_time", s, and "stream" at its arrows,
            m/s. "node" (F, M, 2), or (1, M, 2) where they stay, m. "tracked" (F, M, 2), the team's estimates of
            targets that move, m; (F, 0, 2) without.
        auvs: K. node: (M, 2) at the end, m. with_data: whether nodes have data.
        tracks: of the AUVs, then of the boats, (points, 2) m. targets: of those that move.
        age: (4, F) time, and of the ages of the nodes' data then the 10th, 50th and 90th percentile, s; (4, 0) where
            nodes have none.
    """

    steps: int
    time: np.ndarray
    player: dict[str, Any]
    auvs: int
    node: np.ndarray
    with_data: bool
    tracks: list[np.ndarray]
    targets: list[np.ndarray]
    age: np.ndarray


@dataclass
class Recording:
    """One combination: its recorded episode, and counts (PERIODS, classes of `ERRORS`) over all episodes of the errors
    of the boat's estimates of positions, at each step, of usable fixes, and of the team's estimates of targets.
    """

    episode: Episode
    positions: np.ndarray = field(default_factory=lambda: np.zeros((PERIODS, len(ERRORS) - 1), np.int64))
    fixes: np.ndarray = field(default_factory=lambda: np.zeros((PERIODS, len(ERRORS) - 1), np.int64))
    targets: np.ndarray = field(default_factory=lambda: np.zeros((PERIODS, len(ERRORS) - 1), np.int64))


class Recordings(dict[Combination, Recording]):
    """Recordings of the first `MOST_SHOWN` of some combinations."""

    def __init__(self, combinations: int) -> None:
        super().__init__()
        self.shown = min(combinations, MOST_SHOWN)

    def add(self, trace: Trace, first: int) -> None:
        """Add the shown data of a trace whose first world has number `first`."""
        combination = combination_of(trace)
        if combination not in self:
            if len(self) == self.shown:
                return
            self[combination] = Recording(thinned(trace.episode(0), self.shown))
        off = np.linalg.norm(trace.fix - trace.heard_position, axis=-1)
        _count(self[combination].positions, metrics.position_error(trace), np.ones_like(off, bool))
        _count(self[combination].fixes, off, usable(trace))
        if trace.node_estimate.size:
            apart = track_error(trace)
            _count(self[combination].targets, apart, np.ones_like(apart, bool))


def _count(counts: np.ndarray, error: np.ndarray, known: np.ndarray) -> None:
    """Add the errors (T, W, K), m, that are known to counts (PERIODS, classes)."""
    period = np.nonzero(known)[0] * PERIODS // len(error)
    level = np.searchsorted(ERRORS, error[known], side="right") - 1
    np.add.at(counts, (period, np.clip(level, 0, len(ERRORS) - 2)), 1)


def front_episodes(combinations: int) -> int:
    """Number of episodes of each combination that have a point in the figure of the front."""
    return max(FRONT_EPISODES // min(combinations, MOST_SHOWN), 1)


def collects_data(scenario: Scenario) -> bool:
    """Whether AUVs go to nodes, which have data."""
    return scenario.task_definition.targets == "nodes"


def combination_of(trace: Trace) -> Combination:
    """Policy, boat strategy and target rule of a mission."""
    rule = trace.scenario.nodes.target_rule if collects_data(trace.scenario) else ""
    return Combination(trace.policy, trace.usv, rule)


def thinned(trace: Trace, episodes: int) -> Episode:
    """World 0 of a trace, its steps thinned so that as many episodes stay within `FRAME_BYTES`."""
    area, with_data = trace.scenario.area, collects_data(trace.scenario)
    steps, _, auvs = trace.power.shape
    boats, nodes, vortices = trace.boat_position.shape[2], trace.backlog.shape[2], trace.vortex.shape[2]
    size = (
        2 * (3 + (8 + (trace.auv_attitude.size > 0)) * auvs + 2 * boats + 4 * vortices) + auvs + nodes * with_data
    )  # bytes, as encoded below
    moves, tracks = trace.node_way.size > 0, trace.node_estimate.size > 0
    size += 4 * nodes * (moves + tracks)
    kept = evenly(steps, FRAME_BYTES // (episodes * size))
    points = evenly(steps, min(TRACK_POINTS // (episodes * (auvs + boats + moves * nodes)), MOST_TRACK))
    moving = [*np.moveaxis(trace.auv_position[points, 0], 1, 0), *np.moveaxis(trace.boat_position[points, 0], 1, 0)]
    centre, circulation, core = np.split(trace.vortex[kept, 0], [2, 3], axis=-1)
    ellipse = ellipses(trace.estimate_covariance[kept, 0], max(area.width, area.length))
    heading = trace.attitude[kept, 0, :, 0] if trace.auv_attitude.size else np.zeros((len(kept), 0))
    fill = trace.backlog[kept, 0] / trace.scenario.nodes.buffer if with_data else np.zeros((len(kept), 0))
    data, power = (
        np.cumsum(all_of[:, 0].sum(axis=1, dtype=np.float64))[kept] for all_of in (trace.delivered, trace.power)
    )
    player = {
        "time": encoded(trace.time[kept]),
        "auv": encoded(trace.auv_position[kept, 0]),
        "estimate": encoded(trace.estimate[kept, 0]),
        "ellipse": [encoded(ellipse[..., :2]), encoded(ellipse[..., 2])],
        "heading": encoded(heading),
        "target": encoded(trace.target[kept, 0], whole=True),
        "hovering": encoded(trace.hovering[kept, 0], bits=8, whole=True),
        "boat": encoded(trace.boat_position[kept, 0]),
        "vortex": [
            encoded(centre),
            encoded(trace.scenario.eddies_at_cruise * circulation[..., 0]),
            encoded(core[..., 0]),
        ],
        "stream_time": encoded(trace.stream_time if len(trace.stream_time) else np.zeros(1)),
        "stream": encoded(at_arrows(trace.stream, area.width, area.length)),
        "node": encoded(trace.node_way[kept, 0] if moves else trace.node_position[:1]),
        "tracked": encoded(trace.node_estimate[kept, 0] if tracks else np.zeros((len(kept), 0, 2))),
        "fill": encoded(fill, bits=8),
        "data": encoded(data),
        "energy": encoded(power * trace.scenario.mission.step / 3600),
    }
    age = np.zeros((4, 0))
    if with_data:
        some = evenly(len(trace.time), MOST_AGES)
        age = np.vstack([trace.time[some], np.quantile(metrics.age(trace)[some, 0], (0.1, 0.5, 0.9), axis=1)])
    targets = [*np.moveaxis(trace.node_way[points, 0], 1, 0)] if moves else []
    return Episode(steps, trace.time[kept], player, auvs, trace.node_position[0], with_data, moving, targets, age)


def part_shown(scenario: Scenario, episodes: Sequence[Episode]) -> tuple[float, float, float, float]:
    """West, south, width and length of what maps show, m: the area, or where targets move a square around all ways."""
    area = scenario.area
    ways = [way for episode in episodes for way in (*episode.tracks, *episode.targets)]
    if not any(episode.targets for episode in episodes):
        return 0.0, 0.0, area.width, area.length
    low, high = np.min([way.min(0) for way in ways], axis=0), np.max([way.max(0) for way in ways], axis=0)
    side = min(AROUND * float((high - low).max()), area.width, area.length)
    west, south = np.clip((low + high - side) / 2, 0.0, (area.width - side, area.length - side)).tolist()
    return west, south, side, side


def evenly(count: int, most: int) -> np.ndarray:
    """At most so many of the indices of `count` things, at least two, evenly, with the first and the last."""
    return np.unique(np.linspace(0, count - 1, max(min(count, most), 2)).round().astype(int))


def ellipses(covariance: np.ndarray, largest: float) -> np.ndarray:
    """Semi-axes of one standard deviation, m, the larger first, and the angle of the first, rad in [0, π), (..., 3).

    By covariances (..., 3) xx, xy, yy, m²; axes are cut to the largest, m.
    """
    xx, xy, yy = np.moveaxis(covariance.astype(np.float64), -1, 0)
    middle, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    axes = np.sqrt(np.maximum([middle + spread, middle - spread], 0.0)).clip(max=largest)
    angle = np.arctan2(2 * xy, xx - yy) / 2 % np.pi
    return np.stack([*axes, angle], axis=-1)


def error_quantiles(counts: np.ndarray, shares: tuple[float, ...]) -> np.ndarray:
    """Quantiles of errors from counts (..., classes), (shares, ...), m: the middle of their class; NaN of no errors."""
    total = counts.sum(axis=-1)
    below = np.cumsum(counts, axis=-1)
    middle = np.sqrt(ERRORS[1:] * ERRORS[:-1])
    found = np.array([middle[(below >= share * total[..., None]).argmax(axis=-1)] for share in shares])
    return np.where(total > 0, found, np.nan)


ARROWS = 18  # of the current, along the longer side of the area


def encoded(values: np.ndarray, bits: int = 16, whole: bool = False) -> dict[str, Any]:
    """An array; `whole` numbers keep a step of 1, others have the finest step that reaches from lowest to highest."""
    low = 0.0 if whole or not values.size else float(values.min())
    reach = 0.0 if whole or not values.size else float(values.max()) - low
    step = 1.0 if whole else reach / (2**bits - 1)
    numbers = np.rint((values.astype(np.float64) - low) / (step or 1.0)).astype(f"<u{bits // 8}")
    return {
        "shape": list(values.shape),
        "low": low,
        "step": step,
        "bits": bits,
        "data": base64.b64encode(numbers.tobytes()).decode("ascii"),
    }


def player_data(scenario: Scenario, names: Iterable[str], episodes: Sequence[Episode]) -> dict[str, Any]:
    """Number of colours of AUVs, area and the part of it that is shown, and each episode under its name."""
    return {
        "colours": len(CATEGORICAL),
        "area": [scenario.area.width, scenario.area.length],
        "shown": part_shown(scenario, episodes),
        "period": scenario.current.period,
        "images": IMAGES,
        "episodes": [{"name": name, **each.player} for name, each in zip(names, episodes, strict=True)],
    }


def at_arrows(stream: np.ndarray, width: float, length: float) -> np.ndarray:
    """Velocities (times, rows, columns, 2) at the arrows, which stand in the middle of equal cells of the area, m/s.

    `stream` is the real current from corner to corner of the area, (times, ≥ 2, ≥ 2, 2); empty: 0, at one time.
    """
    columns, rows = (max(2, round(ARROWS * side / max(width, length))) for side in (width, length))
    if not stream.size:
        return np.zeros((1, rows, columns, 2))

    def between(values: np.ndarray, count: int) -> np.ndarray:
        place = (np.arange(count) + 0.5) / count * (values.shape[1] - 1)
        before = np.minimum(place.astype(int), values.shape[1] - 2)
        part = (place - before)[:, None, None]
        return values[:, before] * (1 - part) + values[:, before + 1] * part

    return between(between(stream, rows).swapaxes(1, 2), columns).swapaxes(1, 2)
