"""The sea as a block diagram: surface and two sides of the water, seen obliquely in parallel projection."""

from __future__ import annotations

import math

import cv2
import numpy as np

from usvauv.cli.sea_view.section import Section
from usvauv.env.render import shapes, style
from usvauv.env.render.layout import Layout, Rectangle, nice
from usvauv.env.render.style import write
from usvauv.env.scenario.sea import Area

TURN = math.radians(-32)  # rotation of the area; the south and the east side are in front
TILT = math.radians(26)  # angle of the line of sight below the horizontal
ITERATIONS = 5  # of the search for the point of the surface that a pixel shows
STEEPEST = 0.75  # upper bound on the slope of the drawn surface over that of the line of sight; the search converges
LEAST_CREST = 0.05  # wanted height of drawn crests over the shorter side


class Block:
    """Draws the surface, two sides of the water below it, its dimensions and a section line.

    Args:
        area: the area of the sea.
        room: rectangle of the frame to draw in.
        layout: of the frame.
        sample: elevations to expect, (T, Y, X) m.
        reach: largest elevation to expect, m.

    Attributes:
        note: vertical exaggeration in words.
    """

    def __init__(self, area: Area, room: Rectangle, layout: Layout, sample: np.ndarray, reach: float) -> None:
        self._room, self._layout = room, layout
        self._half = np.array([area.width, area.length]) / 2
        self._heights = self._exaggeration(area, sample, reach)
        self.note = "heights to scale" if self._heights == 1 else f"heights × {self._heights:g}"
        self._reach = reach
        self._base = -1.5 * reach
        corners = np.array([(x, y) for x in (-1, 1) for y in (-1, 1)]) * self._half
        turned = self._turn(corners)
        width = np.ptp(turned[:, 0])
        rise = reach * self._heights * math.cos(TILT)
        height = np.ptp(turned[:, 1]) * math.sin(TILT) + 2.5 * rise
        margin = 16 * layout.unit
        self._scale = min((room.width - 5.5 * margin) / width, (room.height - margin) / height)
        # Centre of the block, with room above it for a crest and below it for a side and its dimensions.
        self._centre = np.array([room.width / 2, room.height / 2 - (0.25 * rise * self._scale + 0.35 * margin)])
        columns, rows = np.meshgrid(np.arange(room.width, dtype=np.float32), np.arange(room.height, dtype=np.float32))
        self._across = (columns - np.float32(self._centre[0])) / np.float32(self._scale)
        self._up = (np.float32(self._centre[1]) - rows) / np.float32(self._scale)

    @staticmethod
    def _exaggeration(area: Area, sample: np.ndarray, reach: float) -> float:
        """Vertical exaggeration ≥ 1: waves become visible, and slopes stay below the line of sight."""
        if not np.abs(sample).max() > 1e-3:
            return 1.0
        spacing = area.length / sample.shape[1], area.width / sample.shape[2]
        slope = float(np.quantile(np.hypot(*np.gradient(sample, *spacing, axis=(1, 2))), 0.999))
        wanted = LEAST_CREST * min(area.width, area.length) / reach
        return max(1.0, nice(min(max(wanted, 1.0), max(1.0, STEEPEST * math.tan(TILT) / max(slope, 1e-9)))))

    @staticmethod
    def _turn(points: np.ndarray) -> np.ndarray:
        cos, sin = math.cos(TURN), math.sin(TURN)
        return points @ np.array([[cos, sin], [-sin, cos]])

    def _project(self, points: np.ndarray, elevation: np.ndarray | float) -> np.ndarray:
        """Pixels (P, 2) of points (P, 2) m from the middle at elevations in m."""
        turned = self._turn(points)
        up = turned[:, 1] * math.sin(TILT) + np.asarray(elevation) * (self._heights * math.cos(TILT))
        x = self._centre[0] + turned[:, 0] * self._scale
        return np.stack([x + self._room.left, self._centre[1] - up * self._scale + self._room.top], 1)

    def draw(self, picture: np.ndarray, field: np.ndarray, relief: np.ndarray, section: Section) -> None:
        """Draw the block.

        Args:
            field: elevation (Y, X) m, row 0 in the south.
            relief: picture of the surface, the north on top.
            section: line to draw on the surface.
        """
        south, east = field[0].astype(float), field[:, -1].astype(float)
        x, y = (np.linspace(-half, half, len(edge)) for half, edge in zip(self._half, (south, east), strict=True))
        sides = (
            (
                np.stack([x, np.full_like(x, -self._half[1])], 1),
                south,
                style.mix(style.SEA[2], self._layout.theme.card, 0.35),
            ),
            (
                np.stack([np.full_like(y, self._half[0]), y], 1),
                east,
                style.mix(style.SEA[1], self._layout.theme.card, 0.25),
            ),
        )
        for points, level, colour in sides:
            top, bottom = self._project(points, level), self._project(points[[-1, 0]], self._base)
            shapes.fill(picture, np.concatenate([top, bottom]), colour)
        self._lay_surface(picture, field, relief)
        for points, level, _ in sides:
            shapes.stroke(picture, self._project(points, level), style.SEA[4], self._layout.px(1))
        line = self._project(section.points - self._half, section.along(field))
        shapes.stroke(picture, line, style.WHITE, self._layout.px(1))
        for name, end in (("A", line[0]), ("B", line[-1])):
            at = end[0], end[1] - 6 * self._layout.unit
            write(picture, name, at, 11 * self._layout.unit, style.WHITE, bold=True, anchor="centre")
        self._write_dimensions(picture)

    def _lay_surface(self, picture: np.ndarray, field: np.ndarray, relief: np.ndarray) -> None:
        """Find the point of the surface that each pixel shows by fixed-point iteration, and colour the pixel."""
        north_up = np.ascontiguousarray(field[::-1], np.float32)
        rows, columns = field.shape
        cos, sin = np.float32(math.cos(TURN)), np.float32(math.sin(TURN))
        rise, flat = np.float32(self._heights * math.cos(TILT)), np.float32(math.sin(TILT))
        per_x, per_y = np.float32(columns / (2 * self._half[0])), np.float32(rows / (2 * self._half[1]))
        z = np.zeros_like(self._up)
        for _ in range(ITERATIONS):
            away = (self._up - z * rise) / flat
            x, y = self._across * cos + away * sin, away * cos - self._across * sin
            u, v = x * per_x + np.float32(columns / 2 - 0.5), np.float32(rows / 2 - 0.5) - y * per_y
            z = cv2.remap(north_up, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        within = np.minimum(np.float32(self._half[0]) - np.abs(x), np.float32(self._half[1]) - np.abs(y))
        cover = np.clip(within * np.float32(self._scale) + 0.5, 0, 1)[:, :, None]
        scale = relief.shape[1] / columns, relief.shape[0] / rows
        u, v = ((w + np.float32(0.5)) * np.float32(s) - np.float32(0.5) for w, s in zip((u, v), scale, strict=True))
        colours = cv2.remap(relief, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        region = self._room.of(picture)
        region[:] = (region + (colours - region.astype(np.float32)) * cover + 0.5).astype(np.uint8)

    def _write_dimensions(self, picture: np.ndarray) -> None:
        unit, size = self._layout.unit, 11 * self._layout.unit
        (a, b), base = self._half, self._base
        (south_x, south_y), (east_x, east_y) = self._project(np.array([(0.0, -b), (a, 0.0)]), base)
        write(
            picture,
            f"{2 * a:g} m",
            (south_x - 8 * unit, south_y + 15 * unit),
            size,
            self._layout.theme.muted,
            anchor="right",
        )
        write(picture, f"{2 * b:g} m", (east_x + 8 * unit, east_y + 15 * unit), size, self._layout.theme.muted)
        height = nice(self._reach)
        (x, foot), (_, head) = self._project(np.array([(-a, -b)] * 2), np.array([base, base + height]))
        if foot - head < 5 * unit:  # too short for a scale
            return
        ends = np.array([(x - 6 * unit, foot), (x - 9 * unit, foot), (x - 9 * unit, head), (x - 6 * unit, head)])
        shapes.stroke(picture, ends, self._layout.theme.muted, self._layout.px(1.3))
        middle = x - 14 * unit, (foot + head) / 2 + 4 * unit
        write(picture, f"{height:g} m", middle, size, self._layout.theme.muted, anchor="right")
