"""Layout of a frame: a map on the left, a panel on the right; map coordinates; round numbers for scales."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from usvauv.env.render import style
from usvauv.env.render.style import Theme
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
