"""A trace as a recording of the Rerun viewer (https://rerun.io), with its layout: scene, places on Earth, curves.

One episode; x east, y north, z up from the still water, m; the time-line "mission" is in seconds from its start.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from usvauv.env.exchange.poses import Poses, ahead, triangles
from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_metrics import letter
from usvauv.env.render.style import SEA, TARGET, WHITE, auv_colour
from usvauv.env.site.place import wrapped
from usvauv.env.site.site import Site
from usvauv.env.storage.files import atomic_write

TIME = "mission"
TRAIL = 60.0  # s
SPEED = 30.0  # s of mission in a second, as in a video by default
SIGMAS = 2.0  # of the ellipses of fixes and of estimated targets
CURVES = {"error": "Error of the estimate, m", "power": "Power, W", "backlog": "Packets waiting", "depth": "Depth, m"}
BOW = 3.0  # length of the arrow ahead of a vehicle over its radius
OF_AREA = 0.008  # radius of a vehicle over the area's diagonal


def write(trace: Trace, path: Path) -> None:
    """Write the only episode of a trace.

    Raises:
        OutputError: the file cannot be written.
    """
    recording = rr.RecordingStream("usvauv")
    memory = recording.memory_recording()
    recording.send_blueprint(_layout(trace))
    _log(_Log(recording, trace.time), trace)
    with atomic_write(path) as partial:
        partial.write_bytes(memory.drain_as_bytes())


def _layout(trace: Trace) -> rrb.Blueprint:
    """The scene with trails, the map where there is a place on Earth, and curves."""
    trail = rrb.VisibleTimeRanges(
        timeline=TIME,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    auvs, boats = range(trace.scenario.auv.count), range(trace.scenario.boat.count)
    moving = [f"/scene/auv_{k + 1}" for k in auvs] + [f"/scene/usv_{b + 1}" for b in boats]
    moving += [f"/scene/target_{letter(m)}" for m in range(trace.node_way.shape[-2])]
    scene = rrb.Spatial3DView(origin="/scene", name="Scene", overrides=dict.fromkeys(moving, trail))
    shown = {entity: name for entity, name in CURVES.items() if entity != "depth" or trace.scenario.auv.dynamic}
    curves = [rrb.TimeSeriesView(origin=f"/{entity}", name=name) for entity, name in shown.items()]
    beside = [rrb.MapView(origin="/earth", name="Map")] if Site(trace.scenario).frame else []
    views = rrb.Horizontal(scene, rrb.Vertical(*beside, *curves), column_shares=[2, 1])
    time = rrb.TimePanel(timeline=TIME, play_state="playing", playback_speed=SPEED)
    return rrb.Blueprint(views, time, collapse_panels=True)


class _Log:
    """Columns on their way into a recording."""

    def __init__(self, recording: rr.RecordingStream, time: np.ndarray) -> None:
        self._recording, self._time = recording, np.asarray(time, np.float64)

    def constant(self, entity: str, *what: Any) -> None:
        self._recording.log(entity, *what, static=True)

    def series(self, entity: str, columns: Iterable[Any], steps: slice | np.ndarray = slice(None)) -> None:
        index = rr.TimeColumn(TIME, duration=self._time[steps])
        self._recording.send_columns(entity, indexes=[index], columns=columns)


def _log(log: _Log, trace: Trace) -> None:
    poses, frame, area = Poses.of(trace), Site(trace.scenario).frame, trace.scenario.area
    radius = OF_AREA * float(np.hypot(area.width, area.length))
    log.constant("/scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    if len(poses.nodes):
        log.constant("/scene/nodes", rr.Points3D(poses.nodes, radii=radius / 2, colors=WHITE))
    for m in range(poses.targets.shape[1]):
        name, colour = f"target_{letter(m)}", TARGET[::-1]
        log.constant(f"/scene/{name}", rr.Points3D.from_fields(radii=radius, colors=colour))
        log.series(f"/scene/{name}", rr.Points3D.columns(positions=poses.targets[:, m]))
        if trace.node_covariance.size:
            _log_ellipses(log, f"/scene/tracked/{name}", poses.tracked[:, m], trace.node_covariance[:, 0, m], colour)
    boats, auvs = range(poses.boats.shape[1]), range(poses.auvs.shape[1])
    bodies = {f"usv_{b + 1}": (poses.boats[:, b], poses.boat_turn[:, b], WHITE) for b in boats}
    bodies |= {f"auv_{k + 1}": (poses.auvs[:, k], poses.auv_turn[:, k], auv_colour(k)[::-1]) for k in auvs}
    for name, (positions, turn, colour) in bodies.items():
        log.constant(f"/scene/{name}", rr.Points3D.from_fields(radii=radius, colors=colour))
        log.series(f"/scene/{name}", rr.Points3D.columns(positions=positions))
        log.constant(f"/scene/{name}/bow", rr.Arrows3D.from_fields(radii=0.3 * radius, colors=colour))
        log.series(f"/scene/{name}/bow", rr.Arrows3D.columns(origins=positions, vectors=BOW * radius * ahead(turn)))
        if frame is not None:
            longitude, latitude = frame.to_geographic(positions[:, 0], positions[:, 1])
            log.constant(f"/earth/{name}", rr.GeoPoints.from_fields(radii=rr.Radius.ui_points(6), colors=colour))
            log.series(
                f"/earth/{name}", rr.GeoPoints.columns(positions=np.column_stack([latitude, wrapped(longitude)]))
            )
    error = np.linalg.norm(poses.estimates - poses.auvs, axis=-1)
    for k in auvs:
        name, colour = f"auv_{k + 1}", auv_colour(k)[::-1]
        _log_ellipses(log, f"/scene/fixes/{name}", poses.fixes[:, k], trace.fix_covariance[:, 0, k], colour)
        for curve, values in (("error", error[:, k]), ("power", trace.power[:, 0, k]), ("depth", trace.depth[:, 0, k])):
            log.constant(f"/{curve}/{name}", rr.SeriesLines(colors=colour, names=name))
            log.series(f"/{curve}/{name}", rr.Scalars.columns(scalars=values))
    log.series("/backlog", rr.Scalars.columns(scalars=trace.backlog[:, 0].sum(-1)))
    if len(poses.sea):
        log.constant("/scene/sea", rr.Mesh3D.from_fields(triangle_indices=triangles(*trace.surface.shape[1:])))
        steps, points = poses.sea.shape[:2]
        columns = rr.Mesh3D.columns(
            vertex_positions=poses.sea.reshape(-1, 3), vertex_colors=_sea_colours(poses.sea[..., 2]).reshape(-1, 3)
        )
        log.series("/scene/sea", columns.partition([points] * steps))


def _log_ellipses(log: _Log, entity: str, places: np.ndarray, covariance: np.ndarray, colour: tuple[int, ...]) -> None:
    """Uncertain places (T, 3) as flat ellipsoids of `SIGMAS` deviations, from covariances xx, xy, yy (T, 3)."""
    made = np.flatnonzero(np.isfinite(places).all(-1))
    if not len(made):
        return
    matrix = covariance[made][:, [0, 1, 1, 2]].reshape(-1, 2, 2).astype(np.float64)
    variances, axes = np.linalg.eigh(matrix)
    half = np.arctan2(axes[:, 1, 0], axes[:, 0, 0]) / 2
    sizes = SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    turns = np.column_stack([np.zeros((len(half), 2)), np.sin(half), np.cos(half)])
    log.constant(entity, rr.Ellipsoids3D.from_fields(colors=colour))
    flat = np.column_stack([sizes, np.full(len(sizes), 0.01)])
    log.series(entity, rr.Ellipsoids3D.columns(centers=places[made], half_sizes=flat, quaternions=turns), made)


def _sea_colours(elevation: np.ndarray) -> np.ndarray:
    """Red, green and blue (…, 3) by elevation, as in videos."""
    limit = max(float(abs(elevation).max()), 1e-6)
    scale = np.linspace(-limit, limit, len(SEA))
    return np.stack([np.interp(elevation, scale, channel) for channel in np.array(SEA).T[::-1]], -1).astype(np.uint8)
