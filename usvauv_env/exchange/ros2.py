"""A trace as MCAP with messages of ROS 2: Foxglove, PlotJuggler, RViz by `ros2 bag play`, and Rerun open it.

One episode, in the frame "map": x east, y north, z up from the still water, m; stamps are seconds from the mission's
start. Messages are in CDR and stored with their definitions, so that they can be read without ROS 2.

    /tf                  tf2_msgs/TFMessage                       "map" → "auv_1" …, "usv_1" …
    /auv_1/pose          geometry_msgs/PoseStamped                the truth; of a point, heading through the water
    /auv_1/fins          sensor_msgs/JointState                   rudder, stern plane, propeller, if it has them
    /auv_1/velocity      geometry_msgs/TwistStamped               through the water; z is −d(depth)/dt; in "map"
    /auv_1/fix           geometry_msgs/PoseWithCovarianceStamped  when a reply is detected
    /auv_1/estimate      geometry_msgs/PoseWithCovarianceStamped  the boat's estimate of the AUV's position
    /usv_1/pose          geometry_msgs/PoseStamped                its heading, tilted with the waves' surface
    /usv_1/goal          geometry_msgs/PointStamped
    /target_A/position   geometry_msgs/PointStamped               of a target that moves, at the middle of their depths
    /target_A/estimate   geometry_msgs/PoseWithCovarianceStamped  the AUVs' estimate of it, once they have one
    /nodes               sensor_msgs/PointCloud2                  x, y, z and the packets waiting, "backlog"
    /sea                 sensor_msgs/PointCloud2                  the surface, if the trace has it
    …/navsat             sensor_msgs/NavSatFix                    with each pose, if the scenario has a place on Earth
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from usvauv.env.exchange.poses import Poses
from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_metrics import letter
from usvauv.env.site.place import wrapped
from usvauv.env.site.site import Site
from usvauv.env.storage.files import atomic_write

FRAME = "map"
FLOAT32 = 7  # sensor_msgs/PointField
NO_FIX, UNKNOWN = 0, 0  # sensor_msgs/NavSatStatus, NavSatFix: without satellites, of unknown covariance
UNKNOWN_VARIANCE = 1e6  # m², of what a fix does not measure: RViz cannot draw infinity


def write(trace: Trace, path: Path) -> None:
    """Write the only episode of a trace.

    Raises:
        OutputError: the file cannot be written.
    """
    poses, frame = Poses.of(trace), Site(trace.scenario).frame
    climb = np.diff(-trace.depth[:, 0], axis=0, prepend=-trace.depth[:1, 0]) / trace.scenario.mission.step
    auvs, boats = poses.auvs.shape[1], poses.boats.shape[1]
    bodies = [(f"auv_{k + 1}", poses.auvs[:, k], poses.auv_turn[:, k]) for k in range(auvs)]
    bodies += [(f"usv_{b + 1}", poses.boats[:, b], poses.boat_turn[:, b]) for b in range(boats)]
    places = {}
    if frame is not None:
        for name, at, _ in bodies:
            longitude, latitude = frame.to_geographic(*at.T[:2])
            places[name] = np.stack([wrapped(longitude), latitude, at[:, 2]], axis=-1)
    with atomic_write(path) as partial, partial.open("wb") as file:
        bag = _Bag(file)
        for t, seconds in enumerate(trace.time):
            bag.stamp(float(seconds))
            bag.add("/tf", "tf2_msgs/msg/TFMessage", [bag.transform(name, at[t], turn[t]) for name, at, turn in bodies])
            for name, at, turn in bodies:
                bag.add(f"/{name}/pose", "geometry_msgs/msg/PoseStamped", bag.header(), bag.pose(at[t], turn[t]))
                if name in places:
                    bag.place(f"/{name}/navsat", places[name][t])
            for k in range(auvs):
                name = f"/auv_{k + 1}"
                bag.velocity(f"{name}/velocity", (*trace.auv_velocity[t, 0, k], climb[t, k]))
                if trace.auv_fins.size:
                    bag.fins(f"{name}/fins", trace.auv_fins[t, 0, k])
                if np.isfinite(poses.fixes[t, k]).all():
                    bag.uncertain(f"{name}/fix", poses.fixes[t, k], trace.fix_covariance[t, 0, k])
                bag.uncertain(f"{name}/estimate", poses.estimates[t, k], trace.estimate_covariance[t, 0, k])
            for b in range(boats):
                bag.point(f"/usv_{b + 1}/goal", np.append(trace.boat_goal[t, 0, b], 0.0))
            for m, (target, tracked) in enumerate(zip(poses.targets[t], poses.tracked[t], strict=True)):
                name = f"/target_{letter(m)}"
                bag.point(f"{name}/position", target)
                if np.isfinite(tracked).all():
                    bag.uncertain(f"{name}/estimate", tracked, trace.node_covariance[t, 0, m])
            if len(poses.nodes):
                bag.cloud("/nodes", np.column_stack([poses.nodes, trace.backlog[t, 0]]), ("x", "y", "z", "backlog"))
            if len(poses.sea):
                bag.cloud("/sea", poses.sea[t], ("x", "y", "z"))
        bag.finish()


class _Bag:
    """Messages of ROS 2 on their way into a file, each at the time that was stamped last."""

    def __init__(self, file: Any) -> None:
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._writer = Writer(file)
        self._writer.start(profile="ros2", library="usvauv")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def stamp(self, seconds: float) -> None:
        self._time = round(seconds * 1e9)

    def finish(self) -> None:
        self._writer.finish()

    def add(self, topic: str, kind: str, *content: Any) -> None:
        """Append a message."""
        if kind not in self._schemas:
            definition, _ = self._store.generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition.encode())
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        data = self._store.serialize_cdr(self.message(kind, *content), kind)
        self._writer.add_message(self._channels[topic], self._time, bytes(data), self._time)

    def message(self, kind: str, *content: Any) -> Any:
        return self._store.types[kind](*content)

    def header(self) -> Any:
        time = self.message("builtin_interfaces/msg/Time", *divmod(self._time, 10**9))
        return self.message("std_msgs/msg/Header", time, FRAME)

    def vector(self, values: Iterable[float], kind: str = "Vector3") -> Any:
        return self.message(f"geometry_msgs/msg/{kind}", *map(float, values))

    def pose(self, position: np.ndarray, turn: np.ndarray) -> Any:
        return self.message("geometry_msgs/msg/Pose", self.vector(position, "Point"), self.vector(turn, "Quaternion"))

    def transform(self, child: str, position: np.ndarray, turn: np.ndarray) -> Any:
        where = self.message("geometry_msgs/msg/Transform", self.vector(position), self.vector(turn, "Quaternion"))
        return self.message("geometry_msgs/msg/TransformStamped", self.header(), child, where)

    def velocity(self, topic: str, velocity: tuple[float, ...]) -> None:
        twist = self.message("geometry_msgs/msg/Twist", self.vector(velocity), self.vector(np.zeros(3)))
        self.add(topic, "geometry_msgs/msg/TwistStamped", self.header(), twist)

    def fins(self, topic: str, fins: np.ndarray) -> None:
        """Angles of rudder and stern plane, rad, and the propeller's velocity, rad/s; the others are NaN."""
        position, velocity = np.append(fins[:2], np.nan), np.append((np.nan, np.nan), 2 * np.pi * fins[2])
        joints = ["rudder", "stern_plane", "propeller"], position.astype(float), velocity.astype(float), np.zeros(0)
        self.add(topic, "sensor_msgs/msg/JointState", self.header(), *joints)

    def point(self, topic: str, place: np.ndarray) -> None:
        self.add(topic, "geometry_msgs/msg/PointStamped", self.header(), self.vector(place, "Point"))

    def uncertain(self, topic: str, position: np.ndarray, covariance: np.ndarray) -> None:
        """A position with its covariance xx, xy, yy, m²; the depth is known, the attitude is not."""
        matrix = np.diag([0.0, 0.0, 0.0, *[UNKNOWN_VARIANCE] * 3])
        matrix[[0, 0, 1, 1], [0, 1, 0, 1]] = covariance[[0, 1, 1, 2]]
        pose = self.pose(position, np.array((0.0, 0.0, 0.0, 1.0)))
        content = self.message("geometry_msgs/msg/PoseWithCovariance", pose, matrix.ravel())
        self.add(topic, "geometry_msgs/msg/PoseWithCovarianceStamped", self.header(), content)

    def place(self, topic: str, place: np.ndarray) -> None:
        """A place on Earth: longitude, latitude, degrees, and height above the still water, m."""
        longitude, latitude, height = map(float, place)
        status = self.message("sensor_msgs/msg/NavSatStatus", NO_FIX, 0)
        kind = "sensor_msgs/msg/NavSatFix"
        self.add(topic, kind, self.header(), status, latitude, longitude, height, np.zeros(9), UNKNOWN)

    def cloud(self, topic: str, points: np.ndarray, names: tuple[str, ...]) -> None:
        """Points (N, F) with the fields named."""
        step = 4 * len(names)
        fields = [self.message("sensor_msgs/msg/PointField", name, 4 * i, FLOAT32, 1) for i, name in enumerate(names)]
        data = np.frombuffer(np.asarray(points, "<f4").tobytes(), np.uint8)
        size = 1, len(points), fields, False, step, step * len(points), data, True
        self.add(topic, "sensor_msgs/msg/PointCloud2", self.header(), *size)
