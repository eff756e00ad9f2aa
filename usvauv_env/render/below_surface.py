"""AUVs and nodes in perspective, with where the AUVs came from, where they go and how well they are known."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from usvauv.env.record.collection import age
from usvauv.env.record.trace import Trace
from usvauv.env.render import bodies, shapes, style, symbols
from usvauv.env.render.camera import Camera
from usvauv.env.render.canvas import Canvas
from usvauv.env.render.frame_layout import Layout, Rectangle
from usvauv.env.render.itinerary import Itinerary
from usvauv.env.render.map import OLD, error_axes
from usvauv.env.render.popups import Popups
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.env.render.scene import WATER, Scene, track

AUV_LENGTH = 0.06  # as drawn, of the area's longer side
SMALL = 300  # height up to which a view leaves words to the map beside it, pixels of the design
ZOOMS = (0.85, 1.0, 1.15)  # of nodes by their distance, of which each size has a picture of its own


class BelowSurface:
    """World 0 of a trace.

    Attributes:
        auvs: (T, K, 3) their places in the scene.
    """

    def __init__(self, trace: Trace, running: RunningMetrics, scene: Scene, layout: Layout, camera: Camera) -> None:
        scenario, unit = trace.scenario, layout.unit
        self._trace, self._running, self._scene, self._layout = trace, running, scene, layout
        self.auvs = scene.place(trace.auv_position[:, 0], scene.auvs)
        self._foreseen = scene.place(trace.foreseen_position[:, 0], scene.auvs)
        self._estimated = scene.place(trace.estimate[:, 0], scene.auvs)
        self._error_axes = error_axes(trace.estimate_covariance[:, 0])
        self._nodes = scene.place(trace.node_position[0], scene.nodes)
        self._fill = trace.backlog[:, 0] / scenario.nodes.buffer
        # Stations have no data that could be old.
        self._age = age(trace)[:, 0] / OLD * (scenario.task == "data-collection")
        spacing = math.sqrt(scene.sides[0] * scene.sides[1] / len(self._nodes)) * camera.focal / camera.distance
        self._radii = np.clip(spacing / 8, 3.0 * unit, 9.0 * unit) * np.array(ZOOMS)
        self._gauges = [symbols.NodeGauges(float(radius)) for radius in self._radii]
        self._serving, self._itinerary = trace.hovering[:, 0].astype(bool), Itinerary(trace)
        self._popups = Popups(trace, self._itinerary, layout.unit)
        self._bodies = [bodies.auv(style.auv_colour(auv)) for auv in range(self.auvs.shape[1])]

    def draw_nodes(self, canvas: Canvas, t: int) -> None:
        """Gauges on stalks, far to near, or the stations."""
        away, feet = canvas.camera.away(self._nodes), canvas.camera.pixel(self._nodes)
        zoom = np.digitize(canvas.camera.distance / away, (0.93, 1.07))
        heads = feet - self._radii[zoom][:, None] * (0.0, 1.5)
        canvas.pieces(np.stack([feet, heads], 1), style.OUTLINE, self._layout.px(2))
        if self._trace.scenario.task == "station-keeping":
            for auv, (head, radius) in enumerate(zip(heads, self._radii[zoom], strict=True)):
                symbols.station(canvas.picture, head, radius, style.auv_colour(auv), self._layout.zoom)
            return
        pulse = 0.5 + 0.5 * math.sin(0.35 * t)
        for node in np.argsort(-away):
            gauges = self._gauges[zoom[node]]
            gauges.draw(canvas.picture, heads[node], self._fill[t, node], self._age[t, node], pulse)

    def draw_auvs(self, canvas: Canvas, t: int) -> None:
        """All of them, far to near."""
        for auv in np.argsort(-canvas.camera.away(self.auvs[t])):
            self._draw_auv(canvas, t, int(auv))

    def draw_words(self, canvas: Canvas, t: int) -> None:
        """The AUVs' numbers beside them, and the data of their latest services, which a small view leaves out."""
        (height, width), unit = canvas.picture.shape[:2], self._layout.unit
        nodes, labels = canvas.camera.pixel(self._nodes), canvas.camera.pixel(self.auvs[t]) + np.array([14, -13]) * unit
        if height > SMALL * unit:
            box = Rectangle(0, 0, width, height)
            self._popups.draw(canvas.picture, box, t, nodes, 3 * float(self._radii[-1]), labels)
        for auv, label in enumerate(labels):
            symbols.badge(canvas.picture, str(auv + 1), label, 11 * unit, style.auv_colour(auv))

    def _draw_auv(self, canvas: Canvas, t: int, auv: int) -> None:
        """Trail, line down to the bed, ways to its next nodes, error ellipse, estimate, and the body."""
        colour, place, layout, size = style.auv_colour(auv), self.auvs[t, auv], self._layout, max(self._scene.sides)
        dim = style.mix(WATER, colour, 0.6)
        canvas.trail(self.auvs[track(t, self._trace.scenario.mission.step), auv], colour, WATER, layout.px(2))
        foot = np.array([*place[:2], self._scene.bed])
        canvas.line(np.stack([place, foot]), dim)
        canvas.circle(foot, 0.012 * size, dim)
        stops = self._nodes[[self._itinerary.node(t, auv), *self._itinerary.after(t, auv)]]
        for number, leg in enumerate(pairwise(stops)):
            canvas.line(np.stack(leg), style.mix(WATER, colour, 0.5 - 0.12 * number), layout.px(1.3))
        node = stops[0]
        if self._serving[t, auv]:
            reach = max(self._trace.scenario.auv.hover_radius, 0.04 * size)
            canvas.circle(node, reach, dim)
            canvas.circle(node, reach, colour, layout.px(3), self._running.service_share[t, auv])
        ends = np.stack([place, node, self._estimated[t, auv], self._foreseen[t, auv]])
        begin, end, fix, foreseen = canvas.camera.pixel(ends)
        canvas.pieces(np.array(shapes.dashes(begin, end, 4 * layout.unit)), dim, layout.px(1.3))
        outline = shapes.ellipse_points(self._estimated[t, auv, :2], self._error_axes[t, auv], 64)[[*range(64), 0]]
        for line in self._scene.inside(np.column_stack([outline, np.full(len(outline), place[2])])):
            canvas.line(line, style.mix(colour, style.WHITE, 0.3), layout.px(1.2))
        if np.hypot(*(foreseen - fix)) > 5 * layout.unit:
            canvas.pieces(np.array(shapes.dashes(foreseen, begin, 3 * layout.unit)), dim)
            symbols.foreseen(canvas.picture, foreseen, 6 * layout.unit, colour, 1.6 * layout.unit, layout.zoom)
        if np.hypot(*(fix - begin)) > 5 * layout.unit:
            symbols.fix(canvas.picture, fix, 4 * layout.unit, style.WHITE, 1.5 * layout.unit, layout.zoom)
        axes = bodies.turned(self._running.heading[t, auv], np.zeros(2))
        self._bodies[auv].draw(canvas, place, axes, AUV_LENGTH * size)
