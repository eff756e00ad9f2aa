"""The scene in the tab: sea, boats, AUVs, nodes, currents, estimated positions.

x east, y north, z up, m; rotations are quaternions (w, x, y, z).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from usvauv.cli.live.history import History, Moment
from usvauv.cli.live.session import Session
from usvauv.env.exchange.poses import afloat, triangles, turn
from usvauv.env.record.tracking_metrics import middle_depth
from usvauv.env.render import style
from usvauv.env.render.mission import error_axes
from usvauv.env.render.views.scene import BOAT_BODY, Body, auv_body, tube
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, NodeColumn

TRAIL = 90  # states
ELLIPSE = 40  # points
OPACITY = 0.8  # of the sea, seen from the side
SYMBOL = 0.045  # length of a boat over the area's longer side
ARROW = 0.075  # length of an arrow over the same side, where the current is the fastest that is shown
FASTEST = 1.2  # m/s
SLOWEST = 0.08  # m/s, below which there is no arrow
FLAT: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}
CIRCLE = np.linspace(0, 2 * math.pi, ELLIPSE + 1)


def sensor_body() -> Body:
    """A node: a short drum on a foot, its foot at z = 0."""
    angles = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    profile = ((0.01, 0.0), (0.5, 0.0), (0.5, 0.1), (0.33, 0.14), (0.33, 0.75), (0.2, 0.95), (0.01, 0.95))
    rings = [np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(16, z)]) for r, z in profile]
    return Body.of(*tube(rings, [style.WHITE] * (len(rings) - 1)))


def mesh(body: Body, some: Any = slice(None)) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float32 and triangles (F, 3) of a body, or of some of its faces."""
    corners = body.corners[some]
    first = 4 * np.arange(len(corners))[:, None]
    triangles = np.concatenate([first + np.array(three) for three in ((0, 1, 2), (0, 2, 3))])
    return corners.reshape(-1, 3).astype(np.float32), triangles.astype(np.uint32)


def rgb(colour: Iterable[float]) -> tuple[int, int, int]:
    """A colour of the videos, which have it blue first."""
    blue, green, red = map(round, colour)
    return red, green, blue


class Scene:
    """Draws moments of a session on a viser server.

    Attributes:
        sea: handle of its surface. boats: of the boats' hulls. nodes: of the nodes, one instance each.
    """

    def __init__(self, server: Any, session: Session) -> None:
        self._server, self._session = server, session
        scenario = session.scenario
        self._size = size = max(scenario.area.width, scenario.area.length)
        self._unit = SYMBOL * size
        self._depth = scenario.auv.depth
        self._moving = scenario.task_definition.targets == "moving"
        self._colours = [np.array(rgb(style.auv_colour(k)), np.uint8) for k in range(scenario.auv.count)]
        self._shown: Any = None  # the snapshot whose nodes, flow and trails are drawn
        scene = server.scene
        share = np.linspace(0, 1, 256)[:, None, None] ** 1.5  # from dark above to light at the horizon
        sky = (1 - share) * [14, 24, 38] + share * [60, 88, 112]
        scene.set_background_image(np.broadcast_to(sky, (256, 16, 3)).astype(np.uint8))
        scene.configure_environment_map(None)
        scene.configure_default_lights(False)
        scene.add_light_hemisphere("/sky", sky_color=(200, 225, 255), ground_color=(70, 84, 96), intensity=0.9)
        scene.add_light_directional("/sun", intensity=2.6, position=(-size, 0.4 * size, 0.55 * size))
        x, y = np.meshgrid(session.grid.x, session.grid.y)
        self._points = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)
        self.sea = scene.add_mesh_simple(
            "/sea",
            self._points.reshape(-1, 3),
            triangles(*x.shape),
            color=(38, 132, 178),
            opacity=OPACITY,
            side="double",
            **FLAT,
        )
        self._add_bed()
        self._add_vehicles()

    def _add_bed(self) -> None:
        scene, session = self._server.scene, self._session
        area = session.scenario.area
        depth = session.world.site.bed[0, :, :, 0]
        rows, columns = depth.shape
        x, y = np.meshgrid(np.linspace(0, area.width, columns), np.linspace(0, area.length, rows))
        bed = np.stack([x, y, -depth], axis=-1).reshape(-1, 3)
        colour = (46, 62, 76)
        scene.add_mesh_simple("/bed", bed, triangles(rows, columns), color=colour, side="double", cast_shadow=False)
        corners = np.array([(0, 0), (area.width, 0), (area.width, area.length), (0, area.length)])
        floor = np.column_stack([corners, -depth[[0, 0, -1, -1], [0, -1, -1, 0]]])
        top = np.column_stack([corners, np.zeros(4)])
        edges = np.stack([top, floor], axis=1), np.stack([floor, np.roll(floor, -1, axis=0)], axis=1)
        scene.add_line_segments(
            "/edges", np.concatenate(edges), rgb(style.DARK.muted), thickness=1.2, thickness_units="screen"
        )
        nodes = session.history.latest.node
        vertices, faces = mesh(sensor_body())
        self.nodes = scene.add_batched_meshes_simple(
            "/nodes",
            0.55 * self._unit * vertices,
            faces,
            np.tile((1.0, 0.0, 0.0, 0.0), (len(nodes), 1)),
            self._node_places(nodes),
            batched_colors=self._node_colours(nodes),
            lod="off",
            **FLAT,
        )

    def _add_vehicles(self) -> None:
        scene, unit = self._server.scene, self._unit
        ball = {"subdivisions": 2, **FLAT}
        self._auvs, self._labels, self._known = [], [], []
        for k, colour in enumerate(self._colours):
            name = f"/auv {k + 1}"
            self._auvs.append(self._add_body(name, auv_body(style.auv_colour(k))))
            self._labels.append(scene.add_label(f"{name} name", f"AUV {k + 1}", font_screen_scale=0.8))
            self._known.append(scene.add_icosphere(f"{name} estimate", 0.2 * unit, tuple(colour), opacity=0.55, **ball))
        self._tracked = [
            scene.add_icosphere(f"/target {m + 1} estimate", 0.2 * unit, rgb(style.TARGET), opacity=0.55, **ball)
            for m in range(len(self._session.history.latest.tracked))
        ]
        self.boats, self._goals = [], []
        for b in range(self._session.scenario.boat.count):
            name = f"/boat {b + 1}"
            self.boats.append(self._add_body(name, BOAT_BODY))
            self._goals.append(scene.add_icosphere(f"{name} goal", 0.175 * unit, (255, 210, 80), **ball))
        nothing = np.zeros((1, 2, 3), np.float32)
        black = np.zeros((1, 2, 3), np.uint8)
        self._lines = {
            name: scene.add_line_segments(f"/{name}", nothing, black, thickness=width, thickness_units="screen")
            for name, width in {"ellipses": 2.0, "errors": 1.5, "courses": 1.0, "goals": 1.5, "trails": 1.5}.items()
        }
        self._arrows = scene.add_arrows(
            "/current",
            nothing,
            rgb(style.DARK.muted),
            shaft_radius=0.06 * unit,
            head_radius=0.16 * unit,
            head_length=0.4 * unit,
        )

    def _add_body(self, name: str, body: Body) -> Any:
        """Meshes of a body, one for each colour; those of fewer faces move with the first, whose handle is returned."""
        inks, counts = np.unique(body.colours, axis=0, return_counts=True)
        handles = []
        for place, ink in enumerate(inks[np.argsort(-counts)]):
            vertices, faces = mesh(body, (body.colours == ink).all(axis=1))
            handles.append(
                self._server.scene.add_mesh_simple(
                    f"{name}/{place}" if place else name,
                    1.3 * self._unit * vertices,
                    faces,
                    color=rgb(ink),
                    flat_shading=True,
                    **FLAT,
                )
            )
        return handles[0]

    def show(self, moment: Moment, surface: np.ndarray, history: History) -> None:
        """Draw a moment with its surface, (Y, X), m."""
        with self._server.atomic():
            points = self._points.copy()  # viser sends it from another thread
            points[:, :, 2] = surface
            self.sea.vertices = points.reshape(-1, 3)
            self._show_auvs(moment)
            self._show_boats(moment, surface)
            if moment.after is not self._shown:
                self._shown = moment.after
                self.nodes.batched_positions = self._node_places(moment.after.node)
                self.nodes.batched_colors = self._node_colours(moment.after.node)
                self._show_flow(moment.after.flow)
                self._show_trails(history, moment)
            if self._moving:
                self._show_targets(moment)

    def _show_auvs(self, moment: Moment) -> None:
        auv, estimate, own = (moment.mixed(name) for name in ("auv", "estimate", "own"))
        depth, attitude = moment.mixed("depth"), turn(moment.mixed("attitude"))
        place = self._at_depth(auv[:, AuvColumn.span("x", "y")], depth)
        known = self._at_depth(estimate[:, EstimateColumn.span("x", "y")], depth)
        for k, (body, label, ball) in enumerate(zip(self._auvs, self._labels, self._known, strict=True)):
            body.position, body.wxyz = place[k], np.roll(attitude[k], 1)
            label.position = place[k] + [0, 0, 0.7 * self._unit]
            ball.position = known[k]
        covariance = estimate[:, EstimateColumn.span("covariance_xx", "covariance_yy")]
        axes = error_axes(covariance)
        rings = []
        for centre, (across, along), below in zip(known, axes, depth, strict=True):
            ring = centre[:2] + np.cos(CIRCLE)[:, None] * across + np.sin(CIRCLE)[:, None] * along
            rings.append(_path(self._at_depth(ring, below)))
        self._set("ellipses", np.concatenate(rings), np.repeat(self._colours, ELLIPSE, axis=0))
        believed = self._at_depth(own, depth)
        errors = np.concatenate([np.stack([place, known], axis=1), np.stack([place, believed], axis=1)])
        self._set("errors", errors, np.concatenate([self._colours, np.full((len(place), 3), 255, np.uint8)]))
        node = self._node_places(moment.mixed("node"))[moment.after.auv[:, AuvColumn.target].astype(int)]
        self._set("courses", np.stack([place, node], axis=1), self._colours)

    def _show_targets(self, moment: Moment) -> None:
        """Targets that move, and where the team takes them to be."""
        places, tracked = self._node_places(moment.mixed("node")), moment.mixed("tracked")
        self.nodes.batched_positions = places
        for ball, estimate, place in zip(self._tracked, tracked, places, strict=False):
            ball.position = np.array([*estimate, place[2]])

    def _show_boats(self, moment: Moment, surface: np.ndarray) -> None:
        boat, grid = moment.mixed("boat"), self._session.grid
        goal = moment.after.boat[:, BoatColumn.span("goal_x", "goal_y")]
        heading = np.nan_to_num(moment.mixed("heading"))
        lines = []
        for b, (body, mark) in enumerate(zip(self.boats, self._goals, strict=True)):
            place = boat[b, BoatColumn.span("x", "y")]
            height, slope = grid.height(surface, place)
            body.position = np.array([*place, height])
            body.wxyz = np.roll(afloat(heading[b], slope), 1)
            mark.position = np.array([*goal[b], grid.height(surface, goal[b])[0]])
            way = place + np.linspace(0, 1, 13)[:, None] * (goal[b] - place)
            lines.append(_path(np.array([[*at, grid.height(surface, at)[0] + 0.05 * self._unit] for at in way])))
        points = np.concatenate(lines)
        self._set("goals", points, np.full((len(points), 3), (255, 210, 80), np.uint8))

    def _show_flow(self, flow: np.ndarray) -> None:
        start = self._at_depth(self._session.flow_places().reshape(-1, 2), self._depth)
        velocity = flow.reshape(-1, 2)
        speed = np.linalg.norm(velocity, axis=-1)
        seen = speed > SLOWEST
        if not seen.any():
            seen[0] = True
        start, velocity, speed = start[seen], velocity[seen], speed[seen, None]
        reach = ARROW * self._size / FASTEST * velocity * np.minimum(1.0, 1.5 * FASTEST / np.maximum(speed, SLOWEST))
        end = start + np.column_stack([reach, np.zeros(len(reach))])
        share = np.clip(speed / FASTEST, 0, 1)
        colours = (1 - share) * [96, 168, 200] + share * [255, 128, 72]
        self._arrows.points = np.stack([start, end], axis=1).astype(np.float32)
        self._arrows.colors = colours.astype(np.uint8)

    def _show_trails(self, history: History, moment: Moment) -> None:
        past = history.until(moment.before.time, TRAIL)
        if len(past) < 2:
            self._set("trails", np.zeros((1, 2, 3)), np.zeros((1, 3), np.uint8))
            return
        auvs = np.stack([snapshot.auv[:, AuvColumn.span("x", "y")] for snapshot in past], axis=1)
        boats = np.stack([snapshot.boat[:, BoatColumn.span("x", "y")] for snapshot in past], axis=1)
        depths = np.stack([snapshot.depth for snapshot in past], axis=1)
        paths = [_path(self._at_depth(way, depth)) for way, depth in zip(auvs, depths, strict=True)]
        paths += [_path(np.column_stack([way, np.full(len(way), 0.2)])) for way in boats]
        white = np.array([255, 255, 255], np.uint8)
        colours = np.repeat([*self._colours, *[white] * len(boats)], len(past) - 1, axis=0)
        self._set("trails", np.concatenate(paths), colours)

    def _set(self, name: str, points: np.ndarray, colours: Any) -> None:
        """Draw lines anew: points (N, 2, 3), colours (N, 3)."""
        lines = self._lines[name]
        lines.points = np.asarray(points, np.float32)
        lines.colors = np.repeat(np.asarray(colours, np.uint8)[:, None], 2, axis=1)

    @staticmethod
    def _at_depth(places: np.ndarray, depth: float | np.ndarray) -> np.ndarray:
        """Places (N, 2) at depths, m, (N, 3)."""
        return np.column_stack([places, np.broadcast_to(-depth, len(places))])

    def _node_places(self, nodes: np.ndarray) -> np.ndarray:
        places = nodes[:, NodeColumn.span("x", "y")]
        scenario, site = self._session.scenario, self._session.world.site
        tracks = len(self._session.history.latest.tracked) > 0
        depth = middle_depth(scenario) if tracks else site.depth_at(places)
        return self._at_depth(places, depth).astype(np.float32)

    def _node_colours(self, nodes: np.ndarray) -> np.ndarray:
        """By what they hold; stations have the colours of their AUVs, targets that move their own."""
        if self._moving:
            return np.tile(np.array(rgb(style.TARGET), np.uint8), (len(nodes), 1))
        if self._session.scenario.task_definition.targets == "auvs":
            return np.stack(self._colours)
        fill = nodes[:, NodeColumn.backlog] / self._session.scenario.nodes.buffer
        return np.array([rgb(style.gauge_colour(float(share))) for share in fill], np.uint8)


def _path(points: np.ndarray) -> np.ndarray:
    """Segments (N − 1, 2, 3) from each point (N, 3) to the next."""
    return np.stack([points[:-1], points[1:]], axis=1)
