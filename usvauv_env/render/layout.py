"""Layout of a frame: map on the left, panel on the right; title, tiles, cards and bars of panels; the legend."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.style import Colour, Theme, clock, shorten, text_width, write
from usvauv.env.scenario.sea import Area


class Rectangle(NamedTuple):
    """Pixels; y runs down."""

    left: int
    top: int
    width: int
    height: int

    @property
    def right(self) -> int:
        return self.left + self.width

    @property
    def bottom(self) -> int:
        return self.top + self.height

    def of(self, image: np.ndarray) -> np.ndarray:
        """The view of an image inside the rectangle."""
        return image[self.top : self.bottom, self.left : self.right]


LEGEND_HEIGHT = 146  # pixels of the design
SMALLEST_PANEL = 430  # height in pixels of the design; panels below it have no legend


@dataclass(frozen=True)
class Layout:
    """Rectangles of a frame designed for 1280 × 720, or upright for 720 × 1280, and scaled to other sizes.

    Attributes:
        width, height: of the frame, pixels.
        unit: pixels to one pixel of the design, for text and margins. It has a lower bound, so that text in small
            frames is legible.
        map: the operating area. panel: numbers and plots.
        legend: below the map if there is room, else below the panel if there is room, else None.
        theme: colours around the map.
        left: of the part of the frame that the map and its scales keep to, pixels.
    """

    width: int
    height: int
    unit: float
    map: Rectangle
    panel: Rectangle
    legend: Rectangle | None
    theme: Theme = style.DARK
    left: int = 0

    @classmethod
    def fit(cls, width: int, height: int, area: Area, with_legend: bool = True, theme: Theme = style.DARK) -> Layout:
        """Divide a frame into the map of an area, true to scale, the panel and, if wanted, the legend."""
        long, short = max(width, height), min(width, height)
        unit = design_unit(width, height)
        upright = height > width
        box = min(short, round((0.5 if upright else 0.5625) * long))
        margin, gap = round(10 * unit), round(7 * unit)
        if upright:
            panel = Rectangle(margin, box, width - 2 * margin, height - box - margin)
        else:
            panel = Rectangle(box + margin // 2, margin, width - box - margin - margin // 2, height - 2 * margin)
        left, right, top, bottom = (round(unit * size) for size in (46, 14, 46, 40))
        room_x = (width if upright else box) - left - right
        room_y = (box if upright else height) - top - bottom
        scale = min(room_x / area.width, room_y / area.length)
        across, up = max(round(scale * area.width), 8), max(round(scale * area.length), 8)
        below, legend = round(LEGEND_HEIGHT * unit), None
        spare = room_y - up
        if with_legend and spare >= below + gap and room_x >= 500 * unit:
            spare -= below + gap
            legend = Rectangle(margin, top + spare // 2 + up + bottom + gap, room_x + left + right - 2 * margin, below)
        elif with_legend and panel.height >= SMALLEST_PANEL * unit:
            panel = panel._replace(height=panel.height - below - gap)
            legend = Rectangle(panel.left, panel.bottom + gap, panel.width, below)
        area_map = Rectangle(left + (room_x - across) // 2, top + spare // 2, across, up)
        return cls(width, height, unit, area_map, panel, legend, theme)

    @property
    def zoom(self) -> int:
        """Factor by which shapes are drawn magnified before they are averaged."""
        return 4 if self.unit < 1.5 else 2

    def px(self, size: float) -> int:
        """A line width or gap of the design in whole pixels, at least 1."""
        return max(1, round(size * self.unit))


def design_unit(width: int, height: int) -> float:
    """Pixels of a frame to one pixel of the design; bounded from below, so that text in small frames is legible."""
    long, short = max(width, height), min(width, height)
    return max(min(long / 1280, short / 720), 0.72 * min(1.0, long / 640))


class MapView:
    """Metres of the area (x east, y north) to pixels of the frame."""

    def __init__(self, area: Area, rectangle: Rectangle) -> None:
        self.rectangle = rectangle
        self.per_metre = rectangle.width / area.width
        self._scale = np.array([rectangle.width / area.width, -rectangle.height / area.length])
        # Pixel centres are whole numbers, so the left edge of the first pixel is at −½.
        self._origin = np.array([rectangle.left - 0.5, rectangle.bottom - 0.5])

    def pixel(self, position: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of positions (..., 2) in metres."""
        return self._origin + np.asarray(position, float) * self._scale

    def vector(self, metres: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of displacements (..., 2) in metres."""
        return np.asarray(metres, float) * self._scale


def nice(value: float) -> float:
    """The largest of 1, 2, 5 × a power of ten that is not above a positive value."""
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return next(step * power for step in (5, 2, 1) if step * power <= value * (1 + 1e-9))


def nice_above(value: float, steps: tuple[float, ...] = (1, 2, 5, 10)) -> float:
    """The smallest of the steps × a power of ten that is not below a positive value."""
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return next(step * power for step in steps if step * power >= value * (1 - 1e-9))


class Head:
    """Title with clock, and tiles with figures below or beside it.

    Args:
        still: picture that frames are copied from.
        title, tiles: their boxes.
        words: first line of the title, and what its second line begins with; both are shortened to what there is room
            for beside the clock, the duration and the play speed.
        names: of the figures.
        end: duration, s. speed_up: play speed, s of mission in a second.
    """

    def __init__(
        self,
        still: np.ndarray,
        title: Rectangle,
        tiles: Rectangle,
        layout: Layout,
        words: tuple[str, str],
        names: list[str],
        end: float,
        speed_up: float,
    ) -> None:
        self.title, self.tiles, self._layout = title, tiles, layout
        unit, theme, edge = layout.unit, layout.theme, 2 * layout.unit
        room = title.width - text_width(clock(end), 24 * unit, bold=True) - 14 * unit
        name = shorten(words[0], 21 * unit, room, bold=True)
        write(still, name, (title.left + edge, title.top + 24 * unit), 21 * unit, theme.text, bold=True)
        line, size = title.top + 44 * unit, 12 * unit
        pace = f"of {clock(end)} · {speed_up:g} × speed"
        run = shorten(words[1], size, title.width - text_width(pace, size) - 14 * unit)
        write(still, run, (title.left + edge, line), size, theme.muted)
        write(still, pace, (title.right - edge, line), size, theme.muted, anchor="right")
        draw_card(still, tiles, layout)
        across = tiles.width / len(names)
        self._columns = [tiles.left + place * across + 10 * unit for place in range(len(names))]
        self._room = across - 14 * unit
        size = min(_fitting(name, 11 * unit, self._room) for name in names)
        for left, name in zip(self._columns, names, strict=True):
            write(still, name, (left, tiles.top + 17 * unit), size, theme.muted)

    def draw(self, picture: np.ndarray, time: float, share: float, values: list[str]) -> None:
        """Draw the time in s, a progress bar filled to `share`, and the values of the figures."""
        unit, theme, title = self._layout.unit, self._layout.theme, self.title
        corner = title.right - 2 * unit, title.top + 24 * unit
        write(picture, clock(time), corner, 24 * unit, theme.text, bold=True, anchor="right")
        top, done = round(title.bottom - 2 * unit), round(title.width * share)
        bar = picture[top : top + self._layout.px(3), title.left : title.right]
        bar[:], bar[:, :done] = theme.line, theme.muted
        for left, value in zip(self._columns, values, strict=True):
            size = _fitting(value, 20 * unit, self._room, bold=True)
            write(picture, value, (left, self.tiles.top + 42 * unit), size, theme.text, bold=True)


def _fitting(text: str, size: float, room: float, bold: bool = False) -> float:
    """Font size, reduced where needed so that the text is no wider than `room` pixels."""
    width = text_width(text, size, bold)
    return size if width <= room else size * max(room, 1.0) / width


def write_heading(picture: np.ndarray, layout: Layout, box: Rectangle, text: str, note: str = "") -> None:
    """Title of a card, and a note at the right if there is room for both."""
    unit, theme = layout.unit, layout.theme
    line = box.top + 18 * unit
    room = box.width - 20 * unit
    text = shorten(text, 12 * unit, room, bold=True)
    write(picture, text, (box.left + 10 * unit, line), 12 * unit, theme.text, bold=True)
    if text_width(text, 12 * unit, bold=True) + 12 * unit + text_width(note, 11 * unit) < room:
        write(picture, note, (box.right - 10 * unit, line), 11 * unit, theme.muted, anchor="right")


def draw_card(picture: np.ndarray, box: Rectangle, layout: Layout) -> None:
    """A rounded background."""
    colour, radius = layout.theme.card, max(1, round(5 * layout.unit))
    left, top, right, bottom = box.left, box.top, box.right - 1, box.bottom - 1
    cv2.rectangle(picture, (left + radius, top), (right - radius, bottom), colour, -1)
    cv2.rectangle(picture, (left, top + radius), (right, bottom - radius), colour, -1)
    for x in (left + radius, right - radius):
        for y in (top + radius, bottom - radius):
            cv2.circle(picture, (x, y), radius, colour, -1, cv2.LINE_AA)


def within_margins(
    box: Rectangle, unit: float, top: float, sides: float, bottom: float, left: float | None = None
) -> Rectangle:
    """The box without its margins, which are in pixels of the design."""
    a, b, c = round((sides if left is None else left) * unit), round(sides * unit), round(top * unit)
    return Rectangle(
        box.left + a, box.top + c, max(box.width - a - b, 8), max(box.height - c - round(bottom * unit), 8)
    )


class Bars:
    """A title, and named values side by side, each with a bar from the middle that `scale` fills."""

    def __init__(
        self, still: np.ndarray, box: Rectangle, layout: Layout, title: tuple[str, str], names: list[str], scale: float
    ) -> None:
        unit, theme = layout.unit, layout.theme
        for line, words in enumerate(title):
            write(still, words, (box.left + 10 * unit, box.top + (18 + 15 * line) * unit), 11 * unit, theme.muted)
        start = box.left + max(text_width(words, 11 * unit) for words in title) + 26 * unit
        across = (box.right - start) / len(names)
        self._layout, self._scale, self._row = layout, scale, box.top
        self._left, self._room = [start + place * across for place in range(len(names))], across - 10 * unit
        self._size = min(_fitting(f"{name} +00.00", 11 * unit, self._room) for name in names)
        row = box.top + 30 * unit
        for left, name in zip(self._left, names, strict=True):
            write(still, name, (left, box.top + 18 * unit), self._size, theme.muted)
            shapes.stroke(still, np.array([(left, row), (left + self._room, row)]), theme.line, layout.px(2))

    def draw(self, picture: np.ndarray, values: list[float]) -> None:
        """Draw the values over a copy of the still picture."""
        layout, unit, room = self._layout, self._layout.unit, self._room
        for left, value in zip(self._left, values, strict=True):
            number, row = f"{value:+.2f}".replace("-", "−"), self._row + 30 * unit
            position = left + room, self._row + 18 * unit
            write(picture, number, position, self._size, layout.theme.text, anchor="right")
            middle, length = left + room / 2, room / 2 * min(max(value / self._scale, -1.0), 1.0)
            ink = style.GAUGE[0] if value > 0 else style.GAUGE[2]
            shapes.stroke(picture, np.array([(middle, row), (middle + length, row)]), ink, layout.px(4))


class LegendSymbol(NamedTuple):
    """Draws symbols of the map at a place of a picture."""

    picture: np.ndarray
    at: np.ndarray
    layout: Layout

    def _line(self, points: Sequence[tuple[float, float]], ink: Colour, width: float = 1.3) -> None:
        """A line through points (N, 2) from the place, pixels of the design."""
        ends = self.at + np.array(points) * self.layout.unit
        shapes.stroke(self.picture, ends, ink, self.layout.px(width))

    def _rings(self, rings: tuple[tuple[float, float], ...], ink: Colour, width: float) -> None:
        """Rings of radii, each in a share of an ink."""
        for radius, share in rings:
            faded = style.mix(self.layout.theme.card, ink, share)
            shapes.ring(self.picture, self.at, radius * self.layout.unit, faded, self.layout.px(width))

    def _gauges(self, *gauges: tuple[float, float, float]) -> None:
        """Nodes beside each other: offset, how full, age."""
        sprites = shapes.NodeGauges(5.5 * self.layout.unit)
        for x, share, old in gauges:
            sprites.draw(self.picture, self.at + np.array([x, 0]) * self.layout.unit, share, old, pulse=0.6)

    def auv(self) -> None:
        shapes.auv(self.picture, self.at, 0.35, 22 * self.layout.unit, self.layout.theme.auv(0), self.layout.zoom)

    def boat(self) -> None:
        shapes.boat(self.picture, self.at, 0.35, 22 * self.layout.unit, self.layout.zoom)

    def goal(self) -> None:
        shapes.cross(self.picture, self.at, 4.5 * self.layout.unit, style.BOAT, self.layout.px(2))

    def ping(self) -> None:
        self._rings(((4, 0.7), (9, 0.35)), self.layout.theme.text, 1.3)

    def heard(self) -> None:
        theme = self.layout.theme
        self._line([(-12, 5), (12, -5)], style.mix(theme.card, theme.auv(0), 0.6), 1.2)

    def target(self) -> None:
        ends = self.at + np.array([(-11, 5), (11, -5)]) * self.layout.unit
        for piece in shapes.dashes(ends[0], ends[1], 4 * self.layout.unit):
            shapes.stroke(self.picture, piece, self.layout.theme.auv(0), self.layout.px(1.3))

    def next(self) -> None:
        points, theme = [(-12, 5), (-3, -4), (5, 5), (13, -3)], self.layout.theme
        for place, share in enumerate((0.4, 0.6, 0.75)):
            self._line(points[place : place + 2], style.mix(theme.auv(0), theme.card, share))

    def age(self) -> None:
        self._gauges((-13, 0.25, 0.0), (0, 0.25, 0.5), (13, 0.25, 1.0))

    def node(self) -> None:
        self._gauges((-13, 0.12, 0.0), (0, 0.5, 0.0), (13, 0.85, 0.0))

    def full(self) -> None:
        self._gauges((0, 1.0, 0.0))

    def station(self) -> None:
        shapes.station(self.picture, self.at, 6.5 * self.layout.unit, self.layout.theme.auv(0), self.layout.zoom)

    def service(self) -> None:
        unit, colour = self.layout.unit, self.layout.theme.auv(0)
        shapes.progress_ring(self.picture, self.at, 8 * unit, 0.65, colour, 2.8 * unit, self.layout.zoom)

    def fix(self) -> None:
        unit, ink, aside = self.layout.unit, self.layout.theme.text, np.array([7, 0]) * self.layout.unit
        shapes.plus(self.picture, self.at - aside, 4.5 * unit, ink, self.layout.px(1))
        shapes.fix(self.picture, self.at + aside, 4.5 * unit, ink, 1.5 * unit, self.layout.zoom)

    def ellipse(self) -> None:
        axes = np.array([(11.0, -3.0), (1.5, 5.0)]) * self.layout.unit
        outline = shapes.ellipse_points(self.at, axes)
        shapes.stroke(self.picture, outline, self.layout.theme.text, self.layout.px(1.2), closed=True)

    def current(self) -> None:
        for y, length in ((-4, 11), (4, 6)):
            self._line([(-length, y), (0, y)], self.layout.theme.line, 1.5)
            self._line([(0, y), (length, y)], self.layout.theme.muted, 1.5)

    def foreseen(self) -> None:
        unit, colour = self.layout.unit, self.layout.theme.auv(0)
        shapes.foreseen(self.picture, self.at, 5 * unit, colour, 1.5 * unit, self.layout.zoom)

    def field(self) -> None:
        self._rings(((3, 0.8), (6, 0.55), (9, 0.3)), self.layout.theme.muted, 1.2)


Entry = tuple[Callable[[LegendSymbol], None], str]
AUV: Entry = LegendSymbol.auv, "underwater vehicle (AUV), last 2 min"
BOAT: Entry = LegendSymbol.boat, "boat (USV): finds the AUVs by sound"
PING: Entry = LegendSymbol.ping, "ring: the boat asks where they are"
HEARD: Entry = LegendSymbol.heard, "line from the boat: an AUV it heard"
GOAL: Entry = LegendSymbol.goal, "where the boat plans to go"
FIX: Entry = LegendSymbol.fix, "true place of an AUV, and estimated"
ELLIPSE: Entry = LegendSymbol.ellipse, "2-σ ellipse: 86 % of errors expected"
CURRENT: Entry = LegendSymbol.current, "drifting streaks: water current"
TO_NODE: Entry = LegendSymbol.target, "way to the sensor node it heads for"
TO_STATION: Entry = LegendSymbol.target, "way back to its station"
NEXT: Entry = LegendSymbol.next, "its way to the next three nodes"
NODE: Entry = LegendSymbol.node, "sensor nodes: how full with data"
FULL: Entry = LegendSymbol.full, "full: new data is being lost"
SERVICE: Entry = LegendSymbol.service, "AUV hovers and takes over data"
AGE: Entry = LegendSymbol.age, "white ring: last visited 5 min ago"
STATION: Entry = LegendSymbol.station, "station that it holds"
ENTRIES = AUV, BOAT, PING, HEARD, TO_NODE, GOAL, NEXT, FIX, NODE, ELLIPSE, FULL, SERVICE, AGE, CURRENT
STATION_ENTRIES = AUV, BOAT, PING, HEARD, TO_STATION, GOAL, CURRENT, FIX, STATION, ELLIPSE
FORESIGHT: tuple[Entry, ...] = (
    (LegendSymbol.foreseen, "where the boat foresees an AUV"),
    (LegendSymbol.field, "lines: what the boat would learn there"),
)

ON_MAP = replace(style.DARK, card=style.SEA[1])
"""Colours of symbols: those of the map, on a stripe of water."""

ABBREVIATIONS = "SDR: data rates of all services, added up · EC: an AUV's energy per second of travel"


def draw_legend(picture: np.ndarray, box: Rectangle, layout: Layout, task: str, foresees: bool) -> None:
    """Two columns of symbols and words, and what the abbreviations stand for; `foresees`: the boat foresees AUVs."""
    draw_card(picture, box, layout)
    unit, size = layout.unit, 11 * layout.unit
    entries = (ENTRIES if task == "data-collection" else STATION_ENTRIES) + FORESIGHT * foresees
    rows, widest = len(entries) // 2, max(text_width(words, size) for _, words in entries)
    size *= min(1.0, (box.width / 2 - 48 * unit) / widest)
    position = box.left + 8 * unit, box.bottom - 5 * unit
    meaning = ABBREVIATIONS if task == "data-collection" else ABBREVIATIONS.split(" · ")[1]
    write(picture, shorten(meaning, size, box.width - 16 * unit), position, size, layout.theme.muted)
    box = box._replace(top=box.top + round(3 * unit), height=box.height - round(22 * unit))
    on_map = replace(layout, theme=ON_MAP)
    for column in range(2):
        left = round(box.left + column * box.width / 2)
        draw_card(picture, Rectangle(left, box.top, round(40 * unit), box.height), on_map)
    for place, (symbol, words) in enumerate(entries):
        left = box.left + (place % 2) * box.width / 2
        middle = box.top + (place // 2 + 0.5) * box.height / rows
        symbol(LegendSymbol(picture, np.array([left + 20 * unit, middle]), on_map))
        write(picture, words, (left + 43 * unit, middle + 0.36 * size), size, layout.theme.text)
