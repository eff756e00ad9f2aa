"""Plans and recorded missions as GeoJSON, for maps: longitude and latitude on WGS84.

Source: RFC 7946.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from usvauv.env.planning.plan import AuvPosition, BoatPlace, Plan
from usvauv.env.record.metrics import served
from usvauv.env.record.trace import Trace
from usvauv.env.scenario import Scenario
from usvauv.env.site.place import LocalFrame
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
        return _feature("Point", _degrees(frame, np.array([place.x, place.y])), kind=kind, **more, **about)

    frame = frame_of(scenario)
    return [
        _outline(frame, scenario, objective=plan.objective, measurement=plan.measurement, warnings=plan.warnings),
        *(point("auv", auv, auv=k) for k, auv in enumerate(plan.auvs, 1)),
        point("optimum", plan.optimum),
        point("centroid", plan.centroid),
        *(point("compare", place) for place in plan.compare),
    ]


def of_mission(trace: Trace) -> list[dict[str, Any]]:
    """The area, the ways of AUVs and boats, the nodes or stations and the services of world 0 of a trace.

    A way has `times`, one for each of its points, and a service `time`: ISO 8601 in UTC where the mission has a date,
    else seconds since its start. It has a `depth`, m, where that is a state one for each point. AUVs, boats and nodes
    are numbered from 1.

    Raises:
        UserError: the scenario has no place on Earth.
    """
    scenario, frame, times = trace.scenario, frame_of(trace.scenario), _times(trace)
    step, _, auv, node = served(trace.episode(0))
    brought = trace.delivered[step, 0, auv]
    nodes = scenario.task_definition.targets == "nodes"
    features = [_outline(frame, scenario, policy=trace.policy, usv=trace.usv, seed=trace.seed, start=trace.start)]
    afloat = np.zeros(trace.boat_position.shape[:3])
    for kind, ways, depths in (("auv", trace.auv_position, trace.depth), ("boat", trace.boat_position, afloat)):
        for k in range(ways.shape[2]):
            line, depth = _degrees(frame, ways[:, 0, k]), depths[:, 0, k].tolist()
            depth = depth if trace.auv_depth.size and kind == "auv" else depth[0]
            features.append(_feature("LineString", line, kind=kind, **{kind: k + 1}, depth=depth, times=times))
    for i, place in enumerate(trace.node_position[0]):
        about = {"packets_per_second": float(trace.node_rate[0, i]), "services": int(np.sum(node == i))}
        about["delivered_mbit"] = float(brought[node == i].sum())
        named = {"kind": "node", "node": i + 1, **about} if nodes else {"kind": "station", "station": i + 1}
        features.append(_feature("Point", _degrees(frame, place), **named))
    for t, k, i, data in zip(step, auv, node, brought, strict=True):
        named = {"auv": int(k) + 1, "node": int(i) + 1, "time": times[t], "delivered_mbit": float(data)}
        features.append(_feature("Point", _degrees(frame, trace.auv_position[t, 0, k]), kind="service", **named))
    return features


def _times(trace: Trace) -> list[str] | list[float]:
    if not trace.start:
        return trace.time.tolist()
    moments = np.datetime64(trace.start, "ms") + np.rint(1000 * trace.time).astype("timedelta64[ms]")
    return [f"{moment}Z" for moment in moments]


def _degrees(frame: LocalFrame, places: np.ndarray) -> Any:
    """Longitude and latitude of places (…, 2), m, as nested lists; longitudes go on beyond ±180° within one line."""
    longitude, latitude = frame.to_geographic(*np.moveaxis(places.astype(np.float64), -1, 0))
    turns = np.floor((np.mean(longitude) + 180) / 360)
    return np.stack([longitude - 360 * turns, latitude], axis=-1).round(DIGITS).tolist()


def _feature(geometry: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": geometry, "coordinates": coordinates}, "properties": properties}


def _outline(frame: LocalFrame, scenario: Scenario, **properties: Any) -> dict[str, Any]:
    width, length = scenario.area.width, scenario.area.length
    corners = np.array([[0, 0], [width, 0], [width, length], [0, length], [0, 0]])
    about = {"kind": "area", "scenario": scenario.name, **properties}
    return _feature("Polygon", [_degrees(frame, corners)], **about)
