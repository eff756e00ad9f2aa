"""Plans and recorded missions as GeoJSON, for maps: longitude and latitude on WGS84.

Longitudes are from −180° to 180°. A line or an area across 180° is cut there in two or more parts.
Source: RFC 7946, for the cuts its section 3.1.9.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from usvauv.env.accuracy.boat_place import AuvPosition, BoatPlace, Plan
from usvauv.env.record.metrics import served
from usvauv.env.record.trace import Trace
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.site.place import LocalFrame, wrapped
from usvauv.env.site.site import Site
from usvauv.env.storage.files import atomic_write
from usvauv.kernels.errors import UserError

ENDING = ".geojson"
DIGITS = 8  # of degrees; 1 mm


def frame_of(scenario: Scenario) -> LocalFrame:
    """The plane of a scenario's area.

    Raises:
        UserError: the scenario has no place on Earth.
    """
    frame = Site(scenario).frame
    if frame is None:
        raise UserError(
            f"GeoJSON: scenario {scenario.name!r} has no place on Earth; water.latitude and water.longitude give it"
        )
    return frame


def write(path: Path, features: list[dict[str, Any]]) -> None:
    """Write a collection of features; the file appears only when it is complete.

    Raises:
        OutputError: it cannot be written.
    """
    with atomic_write(path) as partial:
        text = json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False)
        partial.write_text(text + "\n", encoding="utf-8")


def of_plan(plan: Plan, scenario: Scenario) -> list[dict[str, Any]]:
    """The area, the AUVs, and the places of the boat with the errors to expect from there.

    Raises:
        UserError: the scenario has no place on Earth.
    """

    def point(kind: str, place: BoatPlace | AuvPosition, **more: Any) -> dict[str, Any]:
        about = {name: value for name, value in asdict(place).items() if name not in ("latitude", "longitude")}
        return _point(frame, np.array([place.x, place.y]), kind=kind, **more, **about)

    frame = frame_of(scenario)
    return [
        _outline(frame, scenario, objective=plan.objective, measurement=plan.measurement, warnings=plan.warnings),
        *(point("auv", auv, auv=k) for k, auv in enumerate(plan.auvs, 1)),
        point("optimum", plan.optimum),
        point("centroid", plan.centroid),
        *(point("compare", place) for place in plan.compare),
    ]


def of_mission(trace: Trace) -> list[dict[str, Any]]:
    """The area, ways of AUVs, boats and targets that move, nodes or stations, and services of world 0 of a trace.

    A way has `times`, one for each of its points, and a service `time`: ISO 8601 in UTC where the mission has a date,
    else seconds since its start. It has a `depth`, m, where that is a state one for each point. Of a way that is cut,
    both are lists for each part. AUVs, boats and nodes are numbered from 1.

    Raises:
        UserError: the scenario has no place on Earth.
    """
    scenario, frame = trace.scenario, frame_of(trace.scenario)
    step, _, auv, node = served(trace.episode(0))
    brought = trace.delivered[step, 0, auv]
    nodes = scenario.task_definition.targets == "nodes"
    features = [_outline(frame, scenario, policy=trace.policy, usv=trace.usv, seed=trace.seed, start=trace.start)]
    afloat = np.zeros(trace.boat_position.shape[:3])
    moving = [("auv", trace.auv_position, trace.depth), ("boat", trace.boat_position, afloat)]
    if trace.node_way.size:
        moving.append(("target", trace.node_way, np.zeros(trace.node_way.shape[:3])))
    for kind, ways, depths in moving:
        for k in range(ways.shape[2]):
            parts = _cut(np.column_stack([_degrees(frame, ways[:, 0, k]), depths[:, 0, k], trace.time]))
            depth = [part[:, 2].tolist() for part in parts] if trace.auv_depth.size and kind == "auv" else []
            times = [_times(trace, part[:, 3]) for part in parts]
            about = {"depth": _joined(depth) if depth else float(depths[0, 0, k]), "times": _joined(times)}
            features.append(_feature("LineString", parts, kind=kind, **{kind: k + 1}, **about))
    for i, place in enumerate(trace.node_position[0] if not trace.node_way.size else ()):
        about = {"packets_per_second": float(trace.node_rate[0, i]), "services": int(np.sum(node == i))}
        about["delivered_mbit"] = float(brought[node == i].sum())
        named = {"kind": "node", "node": i + 1, **about} if nodes else {"kind": "station", "station": i + 1}
        features.append(_point(frame, place, **named))
    times = _times(trace, trace.time)
    for t, k, i, data in zip(step, auv, node, brought, strict=True):
        named = {"auv": int(k) + 1, "node": int(i) + 1, "time": times[t], "delivered_mbit": float(data)}
        features.append(_point(frame, trace.auv_position[t, 0, k], kind="service", **named))
    return features


def _times(trace: Trace, seconds: np.ndarray) -> list[str] | list[float]:
    if not trace.start:
        return seconds.tolist()
    moments = np.datetime64(trace.start, "ms") + np.rint(1000 * seconds).astype("timedelta64[ms]")
    return [f"{moment}Z" for moment in moments]


def _degrees(frame: LocalFrame, places: np.ndarray) -> np.ndarray:
    """Longitude and latitude of places (…, 2), m; longitudes go on beyond ±180°."""
    return np.stack(frame.to_geographic(*np.moveaxis(places.astype(np.float64), -1, 0)), axis=-1).round(DIGITS)


def _cut(line: np.ndarray) -> list[np.ndarray]:
    """Parts of a line on either side of 180°; rows are longitude, latitude and other numbers linear between points."""
    turns = np.floor((line[:, 0] + 180) / 360)
    ends = np.flatnonzero(np.diff(turns)) + 1
    meridian = 360 * np.maximum(turns[ends - 1], turns[ends]) - 180
    before, step = line[ends - 1], line[ends] - line[ends - 1]
    crossings = before + step * ((meridian - before[:, 0]) / step[:, 0])[:, None]
    crossings[:, 0] = meridian
    parts = []
    for i, (part, turn) in enumerate(zip(np.split(line, ends), turns[[0, *ends]], strict=True)):
        parts.append(np.concatenate([crossings[max(i - 1, 0) : i], part, crossings[i : i + 1]]))
        parts[-1][:, 0] -= 360 * turn
    return parts


def _joined(parts: list[Any]) -> Any:
    """The only part, or all."""
    return parts[0] if len(parts) == 1 else parts


def _feature(geometry: str, parts: list[Any], **properties: Any) -> dict[str, Any]:
    """A feature of one or several lines or rings, (points, ≥ 2) each."""
    coordinates = [part[:, :2].round(DIGITS).tolist() for part in parts]
    if geometry == "Polygon":
        coordinates = [[ring] for ring in coordinates]
    shape = {"type": geometry if len(parts) == 1 else f"Multi{geometry}", "coordinates": _joined(coordinates)}
    return {"type": "Feature", "geometry": shape, "properties": properties}


def _point(frame: LocalFrame, place: np.ndarray, **properties: Any) -> dict[str, Any]:
    longitude, latitude = _degrees(frame, place)
    shape = {"type": "Point", "coordinates": [float(wrapped(longitude)), float(latitude)]}
    return {"type": "Feature", "geometry": shape, "properties": properties}


def _outline(frame: LocalFrame, scenario: Scenario, **properties: Any) -> dict[str, Any]:
    width, length = scenario.area.width, scenario.area.length
    corners = np.array([[0, 0], [width, 0], [width, length], [0, length], [0, 0]])
    about = {"kind": "area", "scenario": scenario.name, **properties}
    rings = _cut(_degrees(frame, corners))
    if len(rings) > 1:  # a convex area is crossed once, so that the first and the last part are one side's
        first, other, last = rings
        rings = [np.concatenate([last, first[1:], last[:1]]), np.concatenate([other, other[:1]])]
    return _feature("Polygon", rings, **about)
