"""Video of the sea alone: map, block diagram, section along the waves, elevation in the middle."""

from __future__ import annotations

import math
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np

from usvauv.cli.sea_view.surface import LONG_WAVES, LevelSurface, Section, land, thumbnail, weather
from usvauv.env.render import shapes, style
from usvauv.env.render.layout import (
    Head,
    Layout,
    Rectangle,
    design_unit,
    draw_card,
    fitting_scale,
    nice,
    nice_above,
    within_margins,
    write_heading,
)
from usvauv.env.render.panel.plots import Plot
from usvauv.env.render.shapes import Overlay
from usvauv.env.render.style import Colour, write
from usvauv.env.render.video import even, one_drawing_thread, video_file
from usvauv.env.render.views.map import draw_map_axes
from usvauv.env.render.views.sea_surface import CurrentStreaks, MapView, SeaSurface
from usvauv.env.scenario.environment import Area
from usvauv.env.sea.simulation import SeaSimulation, Surface
from usvauv.env.sea.storm import wave_systems

TURN = math.radians(-32)  # rotation of the area; the south and the east side are in front
TILT = math.radians(26)  # angle of the line of sight below the horizontal
ITERATIONS = 5  # of the search for the point of the surface that a pixel shows
STEEPEST = 0.75  # upper bound on the slope of the drawn surface over that of the line of sight; the search converges
LEAST_CREST = 0.05  # wanted height of drawn crests over the shorter side


class Block:
    """Draws the surface, two sides of the water below it, its dimensions and a section line."""

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
        """Draw the block, its elevation (Y, X) m, row 0 in the south, in the colours of a relief, the north on top."""
        south, east = field[0].astype(float), field[:, -1].astype(float)
        x, y = (np.linspace(-half, half, len(edge)) for half, edge in zip(self._half, (south, east), strict=True))
        card = self._layout.theme.card
        sides = (
            (np.stack([x, np.full_like(x, -self._half[1])], 1), south, style.mix(style.SEA[2], card, 0.35)),
            (np.stack([np.full_like(y, self._half[0]), y], 1), east, style.mix(style.SEA[1], card, 0.25)),
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
        unit, size, muted = self._layout.unit, 11 * self._layout.unit, self._layout.theme.muted
        (a, b), base = self._half, self._base
        (south_x, south_y), (east_x, east_y) = self._project(np.array([(0.0, -b), (a, 0.0)]), base)
        write(picture, f"{2 * a:g} m", (south_x - 8 * unit, south_y + 15 * unit), size, muted, anchor="right")
        write(picture, f"{2 * b:g} m", (east_x + 8 * unit, east_y + 15 * unit), size, muted)
        height = nice(self._reach)
        (x, foot), (_, head) = self._project(np.array([(-a, -b)] * 2), np.array([base, base + height]))
        if foot - head < 5 * unit:  # too short for a scale
            return
        ends = np.array([(x - 6 * unit, foot), (x - 9 * unit, foot), (x - 9 * unit, head), (x - 6 * unit, head)])
        shapes.stroke(picture, ends, muted, self._layout.px(1.3))
        middle = x - 14 * unit, (foot + head) / 2 + 4 * unit
        write(picture, f"{height:g} m", middle, size, muted, anchor="right")


class LivePlot(Plot):
    """A plot whose curves grow step by step."""

    def __init__(
        self, still: np.ndarray, box: Rectangle, low: float, high: float, duration: float, layout: Layout
    ) -> None:
        super().__init__(still, box, low, high, duration, layout)
        self._ends: dict[Colour, np.ndarray] = {}

    def extend(self, time: float, value: float, colour: Colour) -> None:
        """Extend the curve of a colour to a value, on the still picture."""
        end = self._points(np.array([time]), np.array([value]))[0]
        begin = self._ends.setdefault(colour, end)
        width, zoom = self._line_width, self._zoom
        shapes.stroke(self._fine, np.stack([begin, end]), colour, width)
        self._ends[colour] = end
        first = max(0, int((begin[0] - 2 * width) / zoom))
        last = min(self.box.width, int((end[0] + 2 * width) / zoom) + 1)
        fine = self._fine[:, first * zoom : last * zoom]
        size = last - first, self.box.height
        self.box.of(self._still)[:, first:last] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)


class SectionPlot(Plot):
    """A plot of elevation along a section, drawn anew in each frame: its time axis is the distance, m."""

    def _time_ticks(self) -> list[tuple[float, str]]:
        spacing = nice_above(self._duration / max(2.0, self.box.width / (64 * self._unit)))
        return [(x, f"{x:g}") for x in np.arange(0, self._duration * 1.0001, spacing)]

    def draw(self, picture: np.ndarray, distance: np.ndarray, level: np.ndarray, bounds: np.ndarray) -> None:
        """Draw the water up to its level (P,) m at distances (P,) m, and thin lines at its `bounds` (2, P) m."""
        fine, width = self._fine.copy(), self._line_width
        points = self._points(distance, level)
        bottom = [(points[-1, 0], fine.shape[0]), (points[0, 0], fine.shape[0])]
        shapes.fill(fine, np.concatenate([points, bottom]), style.mix(self._theme.card, style.SEA[3], 0.55))
        for bound in bounds:
            shapes.stroke(
                fine, self._points(distance, bound), style.mix(self._theme.card, self._theme.muted, 0.7), width // 2
            )
        shapes.stroke(fine, points, self._theme.water, width)
        size = self.box.width, self.box.height
        self.box.of(picture)[:] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)


def sea_layout(width: int, height: int, area: Area) -> Layout:
    """A map, true to scale, beside a panel, or above it in an upright frame."""
    long, short = max(width, height), min(width, height)
    unit, upright = design_unit(width, height), height > width
    box, margin = min(short, round((0.5 if upright else 0.5625) * long)), round(10 * unit)
    if upright:
        panel = Rectangle(margin, box, width - 2 * margin, height - box - margin)
    else:
        panel = Rectangle(box + margin // 2, margin, width - box - margin - margin // 2, height - 2 * margin)
    left, right, top, bottom = (round(unit * size) for size in (46, 14, 46, 40))
    room_x = (width if upright else box) - left - right
    room_y = (box if upright else height) - top - bottom
    scale = fitting_scale(room_x, room_y, area)
    across, up = max(round(scale * area.width), 8), max(round(scale * area.length), 8)
    chart = Rectangle(left + (room_x - across) // 2, top + (room_y - up) // 2, across, up)
    return Layout(width, height, unit, {"map": chart, "panel": panel})


class SeaPainter:
    """Draws the frames of a sea, in order of time; scales are fitted to the elevations expected, (T, Y, X) m."""

    def __init__(self, sea: SeaSimulation, expected: np.ndarray, frames: int, size: tuple[int, int], fps: int) -> None:
        area = sea.scenario.area
        self.layout = layout = sea_layout(*size, area)
        self._frames, self._frame, self._fps = frames, 0, fps
        self._duration = max(frames - 1, 1) * sea.interval
        self.view = MapView(area, layout.map)
        first = thumbnail(sea.surface().elevation)
        rows, columns = first.shape
        some = expected[:: max(1, len(expected) // 20)]
        sample = np.stack([first, *(cv2.resize(field, (columns, rows)) for field in some)])
        surface = LevelSurface(sample, self.view, sample)
        self.surface: SeaSurface = surface
        self._stillness = surface.stillness
        self._level = level = surface.level
        self.streaks = CurrentStreaks(
            sea.vortices, sea.stream(), area.width, area.length, self.view, layout.unit, sea.site.eddies
        )
        self._streak_step = min(sea.interval, 0.25 * self.streaks.tail)
        self._overlay = Overlay(*layout.map)
        self._land = land(sea, layout.map.width, layout.map.height)
        shaded = self.surface.relief(first).shape
        self._shaded_land = land(sea, shaded[1], shaded[0])
        self._section = Section(sea.site)
        self._bounds = np.stack([np.full(len(self._section.distance), edge) for edge in (math.inf, -math.inf)])
        self._highest, self._lowest, self._squares, self._fastest = -math.inf, math.inf, 0.0, 0.0
        highest = 1.08 * float(np.abs(expected - level).max()) if self.surface.limit else 1.0
        self._reach = nice_above(highest, (1, 1.5, 2, 3, 4, 5, 6, 8, 10))
        self._storm = bool(wave_systems(sea.site))
        self._both = self._storm and not getattr(sea.long_waves, "still", False)

        self._still = np.full((layout.height, layout.width, 3), self.layout.theme.background, np.uint8)
        self._picture = np.empty_like(self._still)
        cells = f"{len(sea.x)} × {len(sea.y)} cells of {sea.spacing[0]:.3g} m"
        note = f"colours about η = {level:+g} m" if level else cells
        draw_map_axes(self._still, self, layout, note)
        self._draw_still_panel(sea, sample)

    def _draw_still_panel(self, sea: SeaSimulation, sample: np.ndarray) -> None:
        """Draw the still parts of the panel and set up its plots."""
        layout, unit, still = self.layout, self.layout.unit, self._still
        box, gap = layout.boxes["panel"], round(7 * layout.unit)
        heights = [round(height * unit) for height in (56, 54)]
        rest = box.height - sum(heights) - 4 * gap
        block, section = round(0.45 * rest), round(0.3 * rest)
        heights += [block, section, rest - block - section]
        tops = [box.top + sum(heights[:place]) + place * gap for place in range(5)]
        boxes = [Rectangle(box.left, top, box.width, height) for top, height in zip(tops, heights, strict=True)]
        title, tiles, block_box, section_box, level_box = boxes
        for card in boxes[2:]:
            draw_card(still, card, layout)
        scenario = sea.scenario
        words = f"Sea of “{scenario.name}”", f"{weather(sea)} · seed {sea.seed}"
        names = [name for name, _ in self.figures(0.0)]
        self._head = Head(still, title, tiles, layout, words, names, self._duration, self._fps * sea.interval)

        room = within_margins(block_box, unit, top=26, sides=8, bottom=6)
        self._block = Block(scenario.area, room, layout, sample - self._level, self._reach)
        write_heading(still, layout, block_box, "The surface, seen from the south-east", self._block.note)
        plot_room = {"top": 28, "sides": 18, "bottom": 20, "left": 42}
        room = within_margins(section_box, unit, **plot_room)
        values = self._level - self._reach, self._level + self._reach
        self._section_plot = SectionPlot(still, room, *values, self._section.length, layout)
        write_heading(
            still, layout, section_box, f"Section from {self._section.words}, m", "thin: highest and lowest so far"
        )
        room = within_margins(level_box, unit, **plot_room)
        self._level_plot = LivePlot(still, room, *values, self._duration, layout)
        parts = "amber: long waves alone" if self._both else ""
        write_heading(still, layout, level_box, "Elevation in the middle, m", parts)

    def frame(self, sea: SeaSimulation) -> np.ndarray:
        """Picture (height, width, 3) BGR of the present sea; the next call overwrites it."""
        surface = sea.surface()
        self._measure(sea, surface)
        field = thumbnail(surface.elevation)
        relief = self.surface.relief(field)
        relief[self._shaded_land] = style.LAND
        level = self._section.along(field)
        self._bounds[0] = np.minimum(self._bounds[0], level)
        self._bounds[1] = np.maximum(self._bounds[1], level)
        middle = len(sea.y) // 2, len(sea.x) // 2
        now = float(surface.elevation[middle])
        if self._both:
            self._level_plot.extend(sea.time, now - float(surface.storm[middle]), LONG_WAVES)
        self._level_plot.extend(sea.time, now, style.SEA[4])

        picture, unit = self._picture, self.layout.unit
        np.copyto(picture, self._still)
        if not sea.steady:
            self.streaks.update(sea.vortices, sea.stream())
        self._draw_map(picture, relief)
        self._block.draw(picture, field - self._level, relief, self._section)
        self._section_plot.draw(picture, self._section.distance, level, self._bounds)
        box, line = self._section_plot.box, self._section_plot.box.top + 14 * unit
        write(picture, "A", (box.left + 6 * unit, line), 11 * unit, self.layout.theme.text, bold=True)
        write(picture, "B", (box.right - 6 * unit, line), 11 * unit, self.layout.theme.text, bold=True, anchor="right")
        self._frame += 1
        values = [value for _, value in self.figures(now)]
        self._head.draw(picture, sea.time, self._frame / self._frames, values)
        return picture

    def _measure(self, sea: SeaSimulation, surface: Surface) -> None:
        """Update the figures of the tiles."""
        self._highest = max(self._highest, float(surface.elevation.max(where=sea.wet, initial=-math.inf)))
        self._lowest = min(self._lowest, float(surface.elevation.min(where=sea.wet, initial=math.inf)))
        part = surface.storm if self._storm else surface.elevation - self._level
        self._squares += float(np.mean(np.square(part), where=sea.wet, dtype=np.float64))
        if self._frame == 0 or not (sea.steady or self._frame % self._fps):  # once a second of the video
            self._fastest = float(np.hypot(*np.moveaxis(sea.current(), -1, 0)).max())

    def figures(self, now: float) -> list[tuple[str, str]]:
        """Contents of the tiles: name with unit, and value; heights are 4σ over area and time so far."""
        rms = math.sqrt(self._squares / max(self._frame, 1))
        height = ("storm Hs, m", f"{4 * rms:.2f}") if self._storm else ("rms of η, m", f"{rms:.2f}")
        return [
            ("highest, m", signed(self._highest)),
            ("lowest, m", signed(self._lowest)),
            height,
            ("middle now, m", signed(now)),
            ("current to, m/s", f"{self._fastest:.2f}"),
        ]

    def _draw_map(self, picture: np.ndarray, relief: np.ndarray) -> None:
        layout, box = self.layout, self.layout.map
        box.of(picture)[:] = cv2.resize(relief, (box.width, box.height), interpolation=cv2.INTER_CUBIC)
        self._overlay.clear()
        self.streaks.draw(self._overlay, self._frame * self._streak_step, layout.px(1.2))
        self._overlay.blend(picture)
        box.of(picture)[self._land] = style.LAND
        ends = self.view.pixel(self._section.ends)
        for piece in shapes.dashes(ends[0], ends[1], 6 * layout.unit):
            shapes.stroke(picture, piece, self.layout.theme.text, layout.px(1.3))
        along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
        waves = self._section.direction * (1, -1)
        tip, side = ends.mean(axis=0) + 9 * layout.unit * waves, np.array([-waves[1], waves[0]])
        head = [tip, *(tip - (13 * waves - turn * 6 * side) * layout.unit for turn in (1, -1))]
        shapes.fill(picture, np.array(head), style.WHITE)
        for name, end, inwards in (("A", ends[0], along), ("B", ends[1], -along)):
            shapes.badge(picture, name, end + 14 * layout.unit * inwards, 12 * layout.unit, style.WHITE)
        if self._stillness:
            middle = box.left + box.width / 2, box.top + 0.3 * box.height
            write(picture, self._stillness, middle, 14 * layout.unit, self.layout.theme.text, anchor="centre")


class SeaVideo(ExitStack):
    """A video of a sea, one frame a step; the file appears when the context ends, and not at all after an error."""

    def __init__(
        self, out: Path, sea: SeaSimulation, expected: np.ndarray, frames: int, size: tuple[int, int], fps: int
    ) -> None:
        super().__init__()
        size = even(size, out)
        self._painter = SeaPainter(sea, expected, frames, size, fps)
        self.enter_context(one_drawing_thread())
        self._append = self.enter_context(video_file(out, *size, fps))

    def add(self, sea: SeaSimulation) -> None:
        """Append a frame of the present sea."""
        self._append(self._painter.frame(sea))


def signed(value: float) -> str:
    """A height with its sign."""
    return f"{value:+.2f}".replace("-", "−")
