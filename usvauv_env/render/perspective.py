"""The perspective view of a mission: the sea, the boats that ride it, the water below with AUVs and nodes."""

from __future__ import annotations

import cv2
import numpy as np

from usvauv.env.record.trace import Trace
from usvauv.env.render import bodies, style, symbols
from usvauv.env.render.below_surface import BelowSurface
from usvauv.env.render.camera import Camera, Swing
from usvauv.env.render.canvas import Canvas
from usvauv.env.render.frame_layout import Layout, Rectangle
from usvauv.env.render.glass_box import Frame, paint_water
from usvauv.env.render.reply_field import ReplyField
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.env.render.scene import Scene, track
from usvauv.env.render.sea_layers import colour_scale, elevation_limit
from usvauv.env.render.sea_shading import SeaShading
from usvauv.env.render.sound import Sound
from usvauv.env.render.text import shorten, text_width, write
from usvauv.env.render.wave_sheet import Columns, Sheet, look

OPACITY = 0.78  # of the surface before what is below
LEAST_WITH_WORDS = 150  # height in pixels of the design; pictures below it have no scale and no note
BOAT_LENGTH = 0.085  # as drawn, of the area's longer side


class PerspectiveView:
    """Draws world 0 of a trace.

    Attributes:
        scene: where things are drawn and at which scales.
        boats: (T, B, 3) places of their waterlines in it.
    """

    def __init__(self, trace: Trace, running: RunningMetrics, box: Rectangle, layout: Layout) -> None:
        self._trace, self._running, self._box, self._layout = trace, running, box, layout
        sides, limit = (trace.scenario.area.width, trace.scenario.area.length), elevation_limit(trace.surface)
        self.scene = scene = Scene.of(trace.scenario, limit)
        margin = min(layout.unit, box.width / 300, box.height / 150)
        left, right, top, bottom = (round(margin * size) for size in (54, 38, 16, 30))
        room = box.width - left - right, box.height - top - bottom
        self._swing = Swing.around(sides, 0.8 * limit * scene.heights, scene.bed, room).shifted(left, top)
        self._shading = SeaShading(trace.surface, limit, sides, self._swing.middle, scene.heights)
        self._frame = Frame(scene, layout)
        self._backdrop = _backdrop(box.width, box.height)
        self._write_still(limit)
        floating = trace.boat_surface[:, 0] * (scene.heights if trace.surface.size else 0.0)
        self.boats = scene.place(trace.boat_position[:, 0], floating[..., 0])
        self._slopes = floating[..., 1:]
        self._below = BelowSurface(trace, running, scene, layout, self._swing.middle)
        self._sound = Sound(trace, scene, self.boats, self._below.auvs)
        self._field = ReplyField(trace)

    def camera(self, t: int) -> Camera:
        """The camera of step t; its pixels are those of the box."""
        return self._swing.at(t)

    def surface(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """Heights (Y, X) m as drawn and colours (Y, X, 3) of the sea in step t, row 0 in the south."""
        return self._shading.at(t)

    def draw(self, picture: np.ndarray, t: int) -> None:
        """Draw step t inside the box of a BGR picture."""
        canvas, layout = Canvas(self._box.of(picture), self.camera(t)), self._layout
        np.copyto(canvas.picture, self._backdrop)
        columns = Columns.of(canvas.camera, self.scene.sides, self._box.width)
        heights, colours = self.surface(t)
        sheet = look(canvas.camera, columns, self.scene.sides, heights, self._box.height)
        paint_water(canvas, columns, self.scene.bed, sheet)
        self._frame.draw_bed(canvas, columns, sheet)
        self._below.draw_nodes(canvas, t)
        self._sound.draw_below(canvas, t, layout.px(1.2))
        self._below.draw_auvs(canvas, t)
        _paint_surface(canvas.picture, columns, sheet, colours)
        self._frame.draw_edges(canvas, columns, sheet)
        self._draw_field(canvas, t, heights)
        self._sound.draw_afloat(canvas, t, heights, layout.px(1.3))
        for boat in np.argsort(-canvas.camera.away(self.boats[t])):
            self._draw_boat(canvas, t, int(boat), heights)
        self._frame.write_lengths(canvas)
        self._frame.draw_compass(canvas)
        self._below.draw_words(canvas, t)

    def _write_still(self, limit: float) -> None:
        """Words and scale that do not move, on the backdrop."""
        unit, size, picture = self._layout.unit, 11 * self._layout.unit, self._backdrop
        height, width = picture.shape[:2]
        if height < LEAST_WITH_WORDS * unit:
            return
        text = f"{self.scene.note}, vehicles enlarged"
        write(
            picture,
            shorten(text, size, width - 20 * unit),
            (width - 10 * unit, height - 9 * unit),
            size,
            style.DARK.muted,
            anchor="right",
        )
        line, right = round(18 * unit), width - 10 * unit
        high, low = (f"+{limit:g} m", f"sea surface  −{limit:g}") if limit else ("flat sea", "")
        across, up, gap = round(90 * unit), round(9 * unit), 6 * unit
        if text_width(high + low, size) + across + 2 * gap > right:
            return
        write(picture, high, (right, line), size, style.DARK.muted, anchor="right")
        if limit:
            left = round(right - text_width(high, size) - gap) - across
            picture[line - up : line, left : left + across] = colour_scale(across, up)
            write(picture, low, (left - gap, line), size, style.DARK.muted, anchor="right")

    def _draw_field(self, canvas: Canvas, t: int, heights: np.ndarray) -> None:
        """Lines on the water of what replies heard at a place are worth, brighter where it is more."""
        for level, lines in self._field.lines(t):
            ink = style.mix(style.SEA[2], style.FIELD, 0.15 + 0.6 * level)
            for line in lines:
                canvas.line(self.scene.afloat(self.scene.place(line, 0.0)[:, :2], heights), ink, self._layout.px(1.2))

    def _draw_boat(self, canvas: Canvas, t: int, boat: int, heights: np.ndarray) -> None:
        """Wake, way to the goal, goal and body."""
        layout, place, scene = self._layout, self.boats[t, boat], self.scene
        wake = self.boats[track(t, self._trace.scenario.mission.step), boat, :2]
        canvas.trail(scene.afloat(wake, heights), style.BOAT, style.SEA[3], layout.px(1.3))
        goal = scene.place(self._trace.boat_goal[t, 0, boat], 0.0)
        way = place[:2] + np.linspace(0, 1, 24)[:, None] * (goal[:2] - place[:2])
        pixels = canvas.camera.pixel(scene.afloat(way, heights))
        if np.hypot(*(pixels[-1] - pixels[0])) > 20 * layout.unit:  # nearer goals are below the boat
            canvas.pieces(pixels.reshape(-1, 2, 2), style.BOAT)
            symbols.cross(canvas.picture, pixels[-1], 5 * layout.unit, style.BOAT, layout.px(2))
        axes = bodies.turned(self._running.boat_heading[t, boat], self._slopes[t, boat])
        bodies.BOAT.draw(canvas, place, axes, BOAT_LENGTH * max(scene.sides))


def _backdrop(width: int, height: int) -> np.ndarray:
    """A dark room, a little lighter in the middle, whatever the theme."""
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    glow = np.exp(-1.4 * (x * x + (y + 0.25) ** 2))[:, :, None]
    low, high = np.array(style.DARK.background, float), np.array(style.colour("#1d3346"), float)
    grain = np.random.default_rng(0).uniform(-0.5, 0.5, (height, width, 1))  # against bands
    return np.clip(low + (high - low) * glow + grain, 0, 255).round().astype(np.uint8)


def _paint_surface(picture: np.ndarray, columns: Columns, sheet: Sheet, colours: np.ndarray) -> None:
    """Lay the surface, translucent, over what is below."""
    small = cv2.remap(colours, sheet.texel_x, sheet.texel_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    size = 2 * small.shape[1], 2 * small.shape[0]
    region = picture[sheet.top : sheet.top + size[1], 2 * columns.first : 2 * columns.first + size[0]]
    large, shown = cv2.resize(small, size), cv2.resize(sheet.covered, size)
    cv2.threshold(shown, 127, 255, cv2.THRESH_BINARY, shown)
    cv2.copyTo(cv2.addWeighted(region, 1 - OPACITY, large, OPACITY, 0), shown, region)
