"""Layout of a frame: its rectangles and the unit of its letters; title, tiles, cards and bars of panels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.render import style
from usvauv.env.render.style import Theme, clock, shorten, text_width, write
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


SMALLEST_LETTERS = 8.8  # size in pixels below which letters are not legible
LEAST_UNIT = SMALLEST_LETTERS / 11  # the design's smallest letters are of 11 pixels
AXES = (46.0, 14.0, 36.0, 34.0)  # at the left, at the right, above and below a map, pixels of the design


@dataclass(frozen=True)
class Layout:
    """Rectangles of a frame designed for 1280 × 720, or upright for 720 × 1280, and scaled to other sizes.

    Attributes:
        width, height: of the frame, pixels.
        unit: pixels to one pixel of the design, for text and margins. It has a lower bound, so that text in small
            frames is legible.
        boxes: by name; "map" is the operating area.
        theme: colours around the map.
        left: of the part of the frame that the map and its scales keep to, pixels.
    """

    width: int
    height: int
    unit: float
    boxes: Mapping[str, Rectangle]
    theme: Theme = style.DARK
    left: int = 0

    @classmethod
    def fit(cls, width: int, height: int, area: Area, theme: Theme = style.DARK) -> Layout:
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
        return cls(width, height, unit, {"map": chart, "panel": panel}, theme)

    @property
    def map(self) -> Rectangle:
        return self.boxes["map"]

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
    return max(min(long / 1280, short / 720), LEAST_UNIT)


def fitting_scale(width: float, height: float, area: Area) -> float:
    """Pixels a metre with which an area fits into a width and height; its longer side has at least 8 pixels."""
    return max(min(width / area.width, height / area.length), 8.0 / max(area.width, area.length))


def tile_columns(names: Sequence[str], width: float, unit: float) -> int:
    """Figures in a row of tiles of a width in pixels, so that names are legible, and rows are about equally long."""
    widest = max(text_width(name, 11 * unit) for name in names) + 14 * unit
    most = min(max(int(width / widest), 1), len(names))
    return -(-len(names) // -(-len(names) // most))


class MapView:
    """Metres of the area (x east, y north) to pixels of the frame.

    Args:
        area: the whole area. rectangle: that shows it. zoom: ≥ 1, shows a part of it that is so many times smaller.

    Attributes:
        bounds: south-western and north-eastern corner of what is shown, (2, 2) m.
    """

    def __init__(self, area: Area, rectangle: Rectangle, zoom: float = 1.0) -> None:
        self.rectangle, self.zoom = rectangle, zoom
        self.per_metre = zoom * rectangle.width / area.width
        self._sides = np.array([area.width, area.length])
        self._scale = zoom * np.array([rectangle.width, -rectangle.height]) / self._sides
        self.look(0.5 * self._sides)

    def look(self, place: np.ndarray) -> None:
        """Show what is around a place (2,), m, as far as it is within the area."""
        shown = self._sides / self.zoom
        corner = np.clip(place - 0.5 * shown, 0.0, self._sides - shown)
        self.bounds = np.stack([corner, corner + shown])
        # Pixel centres are whole numbers, so the left edge of the first pixel is at −½.
        self._origin = np.array([self.rectangle.left - 0.5, self.rectangle.bottom - 0.5]) - corner * self._scale

    def grid(self, pixels: int = 160) -> tuple[np.ndarray, np.ndarray]:
        """Middles x (X,) and y (Y,) of cells that cover what is shown, at most `pixels` on a side, m."""
        low, high = self.bounds
        counts = np.maximum(np.round((high - low) / (high - low).max() * pixels).astype(int), 2)
        x, y = (a + (np.arange(n) + 0.5) * (b - a) / n for a, b, n in zip(low, high, counts, strict=True))
        return x, y

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
    """Title with clock, and tiles with figures.

    Args:
        still: picture that frames are copied from.
        title, tiles: their boxes; no tiles for None.
        words: first line of the title, and what its second line begins with; both are shortened to what there is room
            for beside the clock and the play speed.
        names: of the figures.
        end: duration, s. speed_up: play speed, s of mission in a second.
    """

    def __init__(
        self,
        still: np.ndarray,
        title: Rectangle,
        tiles: Rectangle | None,
        layout: Layout,
        words: tuple[str, str],
        names: list[str],
        end: float,
        speed_up: float,
    ) -> None:
        self.title, self._layout = title, layout
        unit, theme, edge = layout.unit, layout.theme, 2 * layout.unit
        room = title.width - text_width(clock(end), 24 * unit, bold=True) - 14 * unit
        size = max(fitting(words[0], 21 * unit, room, bold=True), 13 * unit)
        name = shorten(words[0], size, room, bold=True)
        write(still, name, (title.left + edge, title.top + 24 * unit), size, theme.text, bold=True)
        line, size = title.top + 44 * unit, 12 * unit
        room = title.width - 14 * unit
        paces = [f"of {clock(end)} · {speed_up:g} × speed", f"{speed_up:g} × speed", f"{speed_up:g} ×"]
        fits = [pace for pace in paces if text_width(words[1], size) + text_width(pace, size) <= room]
        pace = (fits or paces[-1:])[0]
        run = shorten(words[1], size, room - text_width(pace, size))
        write(still, run, (title.left + edge, line), size, theme.muted)
        write(still, pace, (title.right - edge, line), size, theme.muted, anchor="right")
        self._places: list[tuple[float, float]] = []
        if tiles:
            self._draw_tiles(still, tiles, names)

    def _draw_tiles(self, still: np.ndarray, tiles: Rectangle, names: list[str]) -> None:
        unit = self._layout.unit
        draw_card(still, tiles, self._layout)
        columns, height = tile_columns(names, tiles.width, unit), tiles.height - 8 * unit
        rows = min(-(-len(names) // columns), max(1, int(height / (45 * unit))))
        across, down = tiles.width / columns, height / rows
        self._room = across - 14 * unit
        for place, name in enumerate(names[: rows * columns]):
            left = tiles.left + place % columns * across + 10 * unit
            top = tiles.top + 4 * unit + place // columns * down + (down - 46 * unit) / 2
            write(still, name, (left, top + 13 * unit), 11 * unit, self._layout.theme.muted)
            self._places.append((left, top + 37 * unit))

    def draw(self, picture: np.ndarray, time: float, share: float, values: list[str]) -> None:
        """Draw the time in s, a progress bar filled to `share`, and the values of the figures."""
        unit, theme, title = self._layout.unit, self._layout.theme, self.title
        corner = title.right - 2 * unit, title.top + 24 * unit
        write(picture, clock(time), corner, 24 * unit, theme.text, bold=True, anchor="right")
        top, done = round(title.bottom - 2 * unit), round(title.width * share)
        bar = picture[top : top + self._layout.px(3), title.left : title.right]
        bar[:], bar[:, :done] = theme.line, theme.muted
        for place, value in zip(self._places, values, strict=False):
            size = fitting(value, 20 * unit, self._room, bold=True)
            write(picture, value, place, size, theme.text, bold=True)


def fitting(text: str, size: float, room: float, bold: bool = False) -> float:
    """Font size, reduced down to legible ones where needed so that the text is no wider than `room` pixels."""
    while (width := text_width(text, size, bold)) > room and size > SMALLEST_LETTERS:
        size = max(size * min(room / width, 0.99), SMALLEST_LETTERS)
    return size


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
