"""The scene in the tab: sea, boats, AUVs, nodes, currents, estimated positions; meshes and rotations.

x east, y north, z up, m. Meshes are of about unit size, bow towards +x, up +z; rotations are quaternions (w, x, y, z).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from usvauv.cli.live.history import History, Moment
from usvauv.cli.live.session import Session
from usvauv.env.exchange.poses import afloat, turn
from usvauv.env.render import style
from usvauv.env.render.map import error_axes
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, NodeColumn

TRAIL = 90  # states
ELLIPSE = 40  # points
OPACITY = 0.8  # of the sea, seen from the side
SYMBOL = 0.045  # length of a boat over the area's longer side
ARROW = 0.075  # length of an arrow over the same side, where the current is the fastest that is shown
FASTEST = 1.2  # m/s
SLOWEST = 0.08  # m/s, below which there is no arrow
CIRCLE = np.linspace(0, 2 * math.pi, ELLIPSE + 1)


class Mesh(NamedTuple):
    """Triangles: vertices (V, 3) float32 and their indices (F, 3)."""

    vertices: np.ndarray
    faces: np.ndarray

    def scaled(self, size: float) -> np.ndarray:
        """Vertices of a mesh of another size."""
        return (self.vertices * size).astype(np.float32)


def lofted(sections: list[np.ndarray]) -> Mesh:
    """A closed body through sections of equally many points (N, 3), each a ring."""
    count = len(sections[0])
    faces = []
    for first in range(0, count * (len(sections) - 1), count):
        for i in range(count):
            a, b = first + i, first + (i + 1) % count
            faces += [(a, b, b + count), (a, b + count, a + count)]
    ends = [section.mean(axis=0) for section in (sections[0], sections[-1])]
    start, end = count * len(sections), count * len(sections) + 1
    for i in range(count):
        j = (i + 1) % count
        faces += [(start, j, i), (end, start - count + i, start - count + j)]
    return Mesh(np.concatenate([*sections, ends]).astype(np.float32), np.array(faces, np.uint32))


def joined(*meshes: Mesh) -> Mesh:
    """Several bodies as one."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [mesh.faces + np.uint32(offset) for mesh, offset in zip(meshes, offsets, strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    (x0, y0, z0), (x1, y1, z1) = low, high
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return lofted([np.column_stack([corners, np.full(4, z)]) for z in (z0, z1)])


def _outline(beam: float, height: float, length: float = 1.0) -> np.ndarray:
    """A deck with a pointed bow, anticlockwise from above."""
    x = length * np.array([-0.5, 0.1, 0.35, 0.5, 0.35, 0.1, -0.5])
    y = beam * np.array([-0.45, -0.5, -0.3, 0.0, 0.3, 0.5, 0.45])
    return np.column_stack([x, y, np.full(7, height)])


def hull_mesh() -> Mesh:
    """A boat's hull, its water line at z = 0."""
    return lofted([_outline(0.16, -0.14, 0.85), _outline(0.38, 0.0, 0.95), _outline(0.42, 0.14)])


def cabin_mesh() -> Mesh:
    """What stands on its deck: a cabin and a mast."""
    return joined(_box((-0.32, -0.13, 0.14), (0.08, 0.13, 0.32)), _box((-0.2, -0.015, 0.32), (-0.17, 0.015, 0.6)))


def torpedo_mesh() -> Mesh:
    """An AUV: a round body with fins at its stern."""
    profile = ((-0.5, 0.03), (-0.34, 0.1), (0.3, 0.12), (0.42, 0.1), (0.48, 0.06), (0.5, 0.02))
    angles = np.linspace(0, 2 * math.pi, 14, endpoint=False)
    rings = [np.column_stack([np.full(14, x), r * np.cos(angles), r * np.sin(angles)]) for x, r in profile]
    across = _box((-0.5, -0.22, -0.012), (-0.36, 0.22, 0.012))
    upright = _box((-0.5, -0.012, -0.22), (-0.36, 0.012, 0.22))
    return joined(lofted(rings), across, upright)


def sensor_mesh() -> Mesh:
    """A node: a short drum on a foot, its foot at z = 0."""
    angles = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    profile = ((0.5, 0.0), (0.5, 0.1), (0.33, 0.14), (0.33, 0.75), (0.2, 0.95))
    return lofted([np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(16, z)]) for r, z in profile])


def ball_mesh() -> Mesh:
    """A sphere of diameter 1."""
    angles = np.linspace(0, 2 * math.pi, 16, endpoint=False)
    rings = []
    for latitude in np.linspace(-0.48, 0.48, 9) * math.pi:
        r, z = 0.5 * math.cos(latitude), 0.5 * math.sin(latitude)
        rings.append(np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(16, z)]))
    return lofted(rings)


def field_faces(columns: int, rows: int) -> np.ndarray:
    """Triangles (F, 3) of a field of points, row by row, facing up."""
    index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


def rgb(colour: style.Colour) -> tuple[int, int, int]:
    """A colour of the videos, which have it blue first."""
    blue, green, red = colour
    return red, green, blue


class Scene:
    """Draws moments of a session on a viser server.

    Args:
        server: a `viser.ViserServer`.
        session: what is drawn.

    Attributes:
        sea: handle of its surface. boats: of the boats' hulls. nodes: of the nodes, one instance each.
    """

    def __init__(self, server: Any, session: Session) -> None:
        self._server, self._session = server, session
        scenario = session.scenario
        self._size = size = max(scenario.area.width, scenario.area.length)
        self._unit = SYMBOL * size
        self._depth = scenario.auv.depth
        self._colours = [np.array(rgb(style.auv_colour(k)), np.uint8) for k in range(scenario.auv.count)]
        self._shown: Any = None  # the snapshot whose nodes, flow and trails are drawn
        scene = server.scene
        scene.set_background_image(_gradient())
        scene.configure_environment_map(None)
        scene.configure_default_lights(False)
        scene.add_light_hemisphere("/sky", sky_color=(200, 225, 255), ground_color=(70, 84, 96), intensity=0.9)
        scene.add_light_directional("/sun", intensity=2.6, position=(-size, 0.4 * size, 0.55 * size))
        x, y = np.meshgrid(session.grid.x, session.grid.y)
        self._points = np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)
        self.sea = scene.add_mesh_simple(
            "/sea",
            self._points.reshape(-1, 3),
            field_faces(*x.shape[::-1]),
            color=(38, 132, 178),
            opacity=OPACITY,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
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
        scene.add_mesh_simple("/bed", bed, field_faces(columns, rows), color=colour, side="double", cast_shadow=False)
        corners = np.array([(0, 0), (area.width, 0), (area.width, area.length), (0, area.length)])
        floor = np.column_stack([corners, -depth[[0, 0, -1, -1], [0, -1, -1, 0]]])
        top = np.column_stack([corners, np.zeros(4)])
        edges = np.stack([top, floor], axis=1), np.stack([floor, np.roll(floor, -1, axis=0)], axis=1)
        scene.add_line_segments(
            "/edges", np.concatenate(edges), rgb(style.DARK.muted), thickness=1.2, thickness_units="screen"
        )
        nodes = session.history.latest.node
        self._sensor = sensor_mesh()
        self.nodes = scene.add_batched_meshes_simple(
            "/nodes",
            self._sensor.scaled(0.55 * self._unit),
            self._sensor.faces,
            np.tile((1.0, 0.0, 0.0, 0.0), (len(nodes), 1)),
            self._node_places(nodes),
            batched_colors=self._node_colours(nodes),
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _add_vehicles(self) -> None:
        scene, unit = self._server.scene, self._unit
        torpedo, hull, cabin, ball = torpedo_mesh(), hull_mesh(), cabin_mesh(), ball_mesh()
        plain: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}
        self._auvs, self._labels, self._known = [], [], []
        for k, colour in enumerate(self._colours):
            name = f"/auv {k + 1}"
            self._auvs.append(
                scene.add_mesh_simple(name, torpedo.scaled(1.3 * unit), torpedo.faces, color=tuple(colour), **plain)
            )
            self._labels.append(scene.add_label(f"{name} name", f"AUV {k + 1}", font_screen_scale=0.8))
            self._known.append(
                scene.add_mesh_simple(
                    f"{name} estimate",
                    ball.scaled(0.4 * unit),
                    ball.faces,
                    color=tuple(colour),
                    opacity=0.55,
                    **plain,
                )
            )
        self.boats, self._goals = [], []
        for b in range(self._session.scenario.boat.count):
            name = f"/boat {b + 1}"
            white, deck = rgb(style.BOAT), rgb(style.BOAT_DECK)
            self.boats.append(scene.add_mesh_simple(name, hull.scaled(1.3 * unit), hull.faces, color=white, **plain))
            scene.add_mesh_simple(f"{name}/cabin", cabin.scaled(1.3 * unit), cabin.faces, color=deck, **plain)
            self._goals.append(
                scene.add_mesh_simple(
                    f"{name} goal", ball.scaled(0.35 * unit), ball.faces, color=(255, 210, 80), **plain
                )
            )
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
        node = self._node_places(moment.after.node)[moment.after.auv[:, AuvColumn.target].astype(int)]
        self._set("courses", np.stack([place, node], axis=1), self._colours)

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
        return np.column_stack([places, -self._session.world.site.depth_at(places)]).astype(np.float32)

    def _node_colours(self, nodes: np.ndarray) -> np.ndarray:
        """By what they hold; stations have the colours of their AUVs."""
        if self._session.scenario.task_definition.targets == "auvs":
            return np.stack(self._colours)
        fill = nodes[:, NodeColumn.backlog] / self._session.scenario.nodes.buffer
        return np.array([rgb(style.gauge_colour(float(share))) for share in fill], np.uint8)


def _path(points: np.ndarray) -> np.ndarray:
    """Segments (N − 1, 2, 3) from each point (N, 3) to the next."""
    return np.stack([points[:-1], points[1:]], axis=1)


def _gradient() -> np.ndarray:
    """A sky from dark above to light at the horizon, (rows, columns, 3) uint8."""
    share = np.linspace(0, 1, 256)[:, None, None] ** 1.5
    sky = (1 - share) * [14, 24, 38] + share * [60, 88, 112]
    return np.broadcast_to(sky, (256, 16, 3)).astype(np.uint8)
