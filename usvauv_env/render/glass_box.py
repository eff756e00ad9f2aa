"""The water below the surface as a box of glass: its light, the grid on its bed, its edges with lengths in metres."""

from __future__ import annotations

import math

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.camera import Camera
from usvauv.env.render.canvas import Canvas
from usvauv.env.render.frame_layout import Layout, nice_above
from usvauv.env.render.scene import Scene
from usvauv.env.render.text import text_width, write
from usvauv.env.render.wave_sheet import Columns, Sheet

COARSE = 4  # pixels of the picture to one of the water's light
LIT = np.array(style.colour("#2a86a3"), np.float32)  # water at the surface
DARK = np.array(style.colour("#07192b"), np.float32)  # water at the bed
BED = np.array(style.colour("#35596a"), np.float32)
_BLEND = np.column_stack([LIT - DARK, BED - DARK, DARK])  # of shares of light and bed
GRID = style.colour("#406a7b")
GLASS = style.colour("#6fb3c4")
HORIZON = style.colour("#4d8aa6")
SHORE = style.colour("#bfe6ee")


def _light(camera: Camera, columns: Columns, bed: float, rows: np.ndarray) -> np.ndarray:
    """Colours (R, C, 3) of the box at rows (R,) of the picture: its bed or far wall, veiled by the water before it."""
    near, far = columns.near.astype(np.float32), columns.far.astype(np.float32)
    fall = ((rows - camera.centre[1]) / camera.focal)[:, None].astype(np.float32)  # m of descent to 1 m of distance
    last = np.minimum(far, np.float32(camera.height - bed) / fall)
    entry = np.minimum(np.maximum(near, np.float32(camera.height) / fall), last)
    way = (last - entry) * (1.5 * np.hypot(*columns.ray.T) / camera.distance).astype(np.float32)
    down, middle = (np.maximum((at * fall - camera.height) / -bed, 0.0) for at in (last, 0.5 * (last + entry)))
    # The edge between bed and wall is as wide as a pixel of this coarse picture.
    on_bed = np.clip((down - 1.0) * np.float32(-bed * camera.focal / (COARSE * camera.distance)) + 1.0, 0.0, 1.0)
    clear = cv2.exp(-way)
    lit = clear * (1.0 - on_bed) * cv2.exp(-2.2 * down) + (1.0 - clear) * cv2.exp(-2.0 * middle)
    return cv2.convertScaleAbs(cv2.transform(cv2.merge([lit, clear * on_bed]), _BLEND))


def paint_water(canvas: Canvas, columns: Columns, bed: float, sheet: Sheet) -> None:
    """Fill the box from the highest line of the surface to the near edges of the bed, at height `bed`."""
    picture, camera = canvas
    foot = camera.centre[1] + camera.focal * (camera.height - bed) / columns.near
    top = max(int(sheet.horizon.min()), 0)
    rows = np.arange(top + 0.5 * COARSE - 0.5, foot.max() + COARSE, COARSE)
    coarse = columns.every(COARSE // 2)
    small = _light(camera, coarse, bed, rows)
    large = cv2.resize(small, None, fx=COARSE, fy=COARSE, interpolation=cv2.INTER_LINEAR)
    region = picture[top : top + large.shape[0], 2 * columns.first : 2 * columns.first + large.shape[1]]
    mask = np.zeros(region.shape[:2], np.uint8)
    above, below = (np.stack([columns.x - 2 * columns.first, line - top], 1) for line in (sheet.horizon, foot))
    cv2.fillPoly(mask, [np.rint(np.concatenate([above, below[::-1]])).astype(np.int32)], 255)
    cv2.copyTo(large[: region.shape[0], : region.shape[1]], mask, region)


def _labels_apart(places: np.ndarray, width: float, height: float) -> int:
    """Every how many of the places (N, 2) in a row can have a label of that width and height, pixels."""
    if len(places) < 2:
        return 1
    across, up = np.abs(np.diff(places, axis=0)).min(axis=0)
    return max(1, math.ceil(min(width / max(across, 1e-3), height / max(up, 1e-3))))


class Frame:
    """Lines and words of the box."""

    def __init__(self, scene: Scene, layout: Layout) -> None:
        self._scene, self._layout = scene, layout
        self._half = 0.5 * np.array(scene.sides)
        spacing = nice_above(max(scene.sides) / 5)
        depth = -scene.bed / scene.depths
        self._depths = np.arange(0, depth * 1.0001, nice_above(depth / 4))
        self._ticks = [np.arange(0, side * 1.0001, spacing) for side in scene.sides]

    def _near(self, camera: Camera) -> np.ndarray:
        """The area's nearest corner (2,), m."""
        return -self._half * np.sign(camera.forward)

    def draw_bed(self, canvas: Canvas, columns: Columns, sheet: Sheet) -> None:
        """The grid, and the edge behind the water."""
        bed, lines = self._scene.bed, []
        for axis in (0, 1):
            across = self._half[1 - axis]
            for tick in self._ticks[axis]:
                ends = np.full((2, 3), bed)
                ends[:, axis], ends[:, 1 - axis] = tick - self._half[axis], (-across, across)
                lines.append(ends)
        canvas.pieces(canvas.camera.pixel(np.array(lines)), GRID)
        x, foot = canvas.camera.pixel(np.array([*-self._near(canvas.camera), bed]))
        canvas.pieces(np.array([[(x, sheet.horizon[columns.at(x)]), (x, foot)]]), GRID, self._layout.px(1))

    def draw_edges(self, canvas: Canvas, columns: Columns, sheet: Sheet) -> None:
        """The near edges of the glass, and the lines where the surface meets it."""
        near, bed, width = self._near(canvas.camera), self._scene.bed, self._layout.px(1)
        foot = np.array([(near[0], -near[1], bed), (*near, bed), (-near[0], near[1], bed)])
        canvas.line(foot, GLASS, width)
        feet = canvas.camera.pixel(foot)
        tops = [(x, sheet.shore[columns.at(x)]) for x in feet[:, 0]]
        canvas.pieces(np.stack([feet, tops], 1), GLASS, width)
        for line, ink in ((sheet.horizon, HORIZON), (sheet.shore, SHORE)):
            canvas.pieces(np.stack([columns.x, line], 1)[None, ::2], ink, width)

    def write_lengths(self, canvas: Canvas) -> None:
        """Metres along the near edges of the bed, and of depth at the left."""
        picture, camera = canvas
        unit, near = self._layout.unit, self._near(camera)
        size, out = 11 * unit, 0.02 * max(self._scene.sides)
        for axis in (0, 1):
            ends = np.tile([*near, self._scene.bed], (2, len(self._ticks[axis]), 1))
            ends[:, :, axis] = self._ticks[axis] - self._half[axis]
            ends[1, :, 1 - axis] += math.copysign(out, near[1 - axis])
            ends = camera.pixel(ends).swapaxes(0, 1)
            canvas.pieces(ends, style.DARK.muted)
            anchor, gap = ("left", 3 * unit) if ends[0, 1, 0] > ends[0, 0, 0] else ("right", -3 * unit)
            words = [f"{tick:g}" for tick in self._ticks[axis]]
            words[-1] += " m"
            every = _labels_apart(ends[:, 1], text_width(words[-1], size), size)
            for text, (_, (x, y)) in list(zip(words, ends, strict=True))[(len(words) - 1) % every :: every]:
                write(picture, text, (x + gap, y + 10 * unit), size, style.DARK.muted, anchor=anchor)
        corners = np.array([(near[0], -near[1]), (-near[0], near[1])])
        left = corners[np.argmin(corners @ camera.right)]
        marks = [np.array([*left, -depth * self._scene.depths]) for depth in self._depths]
        places = camera.pixel(np.array(marks))
        every = _labels_apart(places, math.inf, size)
        for depth, (x, y) in list(zip(self._depths, places, strict=True))[::every]:
            shapes.stroke(picture, np.array([(x, y), (x - 5 * unit, y)]), style.DARK.muted)
            words = f"−{depth:g} m" if depth else "0 m"
            write(picture, words, (x - 8 * unit, y + 4 * unit), size, style.DARK.muted, anchor="right")

    def draw_compass(self, canvas: Canvas) -> None:
        """An arrow to the north, lying level, at the lower left."""
        unit, (picture, camera) = self._layout.unit, canvas
        middle = np.array([34 * unit, picture.shape[0] - 34 * unit])
        level = np.array([camera.right, camera.forward * -camera.height / camera.distance]) * 20 * unit
        turns = np.linspace(0.0, 2 * np.pi, 48)
        shapes.stroke(picture, middle + np.stack([np.cos(turns), np.sin(turns)], 1) @ level.T, style.DARK.line)
        arrow = np.array([(0.0, 0.95), (0.26, -0.55), (0.0, -0.3), (-0.26, -0.55)]) @ level.T + middle
        shapes.fill(picture, arrow[[0, 1, 2]], style.DARK.muted)
        shapes.fill(picture, arrow[[0, 2, 3]], style.DARK.text)
        x, y = middle + level @ (0.0, 1.55)
        write(picture, "N", (x, y + 4 * unit), 11 * unit, style.DARK.text, bold=True, anchor="centre")
