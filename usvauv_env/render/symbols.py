"""Symbols of map and legend: vehicles, nodes, fixes. Headings are anticlockwise from east, rad."""

from __future__ import annotations

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.style import Colour
from usvauv.env.render.text import text_width, write

# Outlines in lengths of the vehicle: x forward, y to port.
_HULL = np.array([(0.5, 0), (0.3, 0.17), (0.02, 0.23), (-0.5, 0.2), (-0.5, -0.2), (0.02, -0.23), (0.3, -0.17)])
_CABIN = np.array([(0.16, 0.11), (-0.24, 0.12), (-0.24, -0.12), (0.16, -0.11)])
_TURN = np.linspace(-np.pi / 2, np.pi / 2, 9)
_NOSE = np.stack([0.38 + 0.12 * np.cos(_TURN), 0.12 * np.sin(_TURN)], 1)
_BODY = np.concatenate(
    [_NOSE, [(-0.22, 0.12), (-0.36, 0.06), (-0.5, 0.035), (-0.5, -0.035), (-0.36, -0.06), (-0.22, -0.12)]]
)
_FINS = np.array([(-0.16, 0.1), (-0.36, 0.27), (-0.46, 0.27), (-0.4, 0), (-0.46, -0.27), (-0.36, -0.27), (-0.16, -0.1)])
_BAND = np.array([(0.3, 0.11), (0.22, 0.11), (0.22, -0.11), (0.3, -0.11)])


def _place(outline: np.ndarray, centre: np.ndarray, heading: float, length: float) -> np.ndarray:
    """An outline scaled, rotated and translated; pixels, y down."""
    cos, sin = np.cos(heading), np.sin(heading)
    x, y = outline[:, 0] * length, outline[:, 1] * length
    return np.asarray(centre) + np.stack([x * cos - y * sin, -(x * sin + y * cos)], 1)


def auv(image: np.ndarray, centre: np.ndarray, heading: float, length: float, colour: Colour, factor: int) -> None:
    """A torpedo with tail fins, dark-edged."""

    def draw(fine: np.ndarray, middle: np.ndarray, zoom: int) -> None:
        fins = _place(_FINS, middle, heading, length * zoom)
        body = _place(_BODY, middle, heading, length * zoom)
        edge = max(1, round(0.13 * length * zoom))
        for outline in (fins, body):
            shapes.stroke(fine, outline, style.OUTLINE, edge, closed=True)
        shapes.fill(fine, fins, style.mix(colour, style.OUTLINE, 0.3))
        shapes.fill(fine, body, colour)
        shapes.fill(fine, _place(_BAND, middle, heading, length * zoom), style.OUTLINE)

    shapes.smooth(image, centre, 0.7 * length, factor, draw)


def boat(image: np.ndarray, centre: np.ndarray, heading: float, length: float, factor: int) -> None:
    """A hull with a cabin, dark-edged."""

    def draw(fine: np.ndarray, middle: np.ndarray, zoom: int) -> None:
        hull = _place(_HULL, middle, heading, length * zoom)
        shapes.stroke(fine, hull, style.OUTLINE, max(1, round(0.12 * length * zoom)), closed=True)
        shapes.fill(fine, hull, style.BOAT)
        shapes.fill(fine, _place(_CABIN, middle, heading, length * zoom), style.BOAT_DECK)

    shapes.smooth(image, centre, 0.7 * length, factor, draw)


def progress_ring(
    image: np.ndarray, centre: np.ndarray, radius: float, share: float, colour: Colour, width: float, factor: int
) -> None:
    """A ring filled to `share`, clockwise from the top."""

    def draw(fine: np.ndarray, middle: np.ndarray, zoom: int) -> None:
        dim = style.mix(colour, style.OUTLINE, 0.65)
        shapes.ring(fine, middle, radius * zoom, dim, max(1, round(0.4 * width * zoom)))
        if share > 0:
            shapes.arc(fine, middle, radius * zoom, share, colour, max(1, round(width * zoom)))

    shapes.smooth(image, centre, radius + width, factor, draw)


def cross(image: np.ndarray, centre: np.ndarray, size: float, colour: Colour, width: int) -> None:
    """A diagonal cross with a dark edge."""
    for ink, wide in ((style.OUTLINE, width + 2), (colour, width)):
        for y in (-size, size):
            shapes.stroke(image, np.asarray(centre) + np.array([(-size, y), (size, -y)]), ink, wide)


def plus(image: np.ndarray, centre: np.ndarray, size: float, colour: Colour, width: int) -> None:
    """An upright cross."""
    shapes.stroke(image, np.asarray(centre) + np.array([(-size, 0), (size, 0)]), colour, width)
    shapes.stroke(image, np.asarray(centre) + np.array([(0, -size), (0, size)]), colour, width)


def fix(image: np.ndarray, centre: np.ndarray, size: float, colour: Colour, width: float, factor: int) -> None:
    """A hollow diamond: a measured position."""
    corners = np.array([(0, -size), (size, 0), (0, size), (-size, 0)])

    def draw(fine: np.ndarray, middle: np.ndarray, zoom: int) -> None:
        shapes.stroke(fine, middle + corners * zoom, style.OUTLINE, max(1, round(2 * width * zoom)), closed=True)
        shapes.stroke(fine, middle + corners * zoom, colour, max(1, round(width * zoom)), closed=True)

    shapes.smooth(image, centre, size + 2 * width, factor, draw)


def foreseen(image: np.ndarray, centre: np.ndarray, size: float, colour: Colour, width: float, factor: int) -> None:
    """A hollow square: where a vehicle is expected."""
    corners = np.array([(-size, -size), (size, -size), (size, size), (-size, size)])

    def draw(fine: np.ndarray, middle: np.ndarray, zoom: int) -> None:
        for ink, wide in ((style.OUTLINE, 2 * width), (colour, width)):
            shapes.stroke(fine, middle + corners * zoom, ink, max(1, round(wide * zoom)), closed=True)

    shapes.smooth(image, centre, 1.5 * size + 2 * width, factor, draw)


def station(image: np.ndarray, centre: np.ndarray, radius: float, colour: Colour, factor: int) -> None:
    """A place to be held: a disc in a ring."""

    def draw(fine: np.ndarray, middle: np.ndarray, zoom: int) -> None:
        shapes.disc(fine, middle, 1.15 * radius * zoom, style.OUTLINE)
        shapes.ring(fine, middle, 0.9 * radius * zoom, colour, max(1, round(0.22 * radius * zoom)))
        shapes.disc(fine, middle, 0.35 * radius * zoom, colour)

    shapes.smooth(image, centre, 1.3 * radius, factor, draw)


def badge(image: np.ndarray, text: str, centre: np.ndarray, size: float, colour: Colour) -> None:
    """A short text on a dark pill."""
    half = max(text_width(text, size, bold=True) / 2, 0.3 * size)
    ends = np.asarray(centre) + np.array([(-half + 0.25 * size, 0), (half - 0.25 * size, 0)])
    shapes.stroke(image, ends, style.OUTLINE, max(1, round(1.35 * size)))
    write(image, text, (centre[0], centre[1] + 0.36 * size), size, colour, bold=True, anchor="centre")


class NodeGauges:
    """Pies that fill clockwise, green to amber to red, in a ring that is the brighter the older the data.

    Full ones have a halo. Each picture is drawn once, magnified, and copied from then on.
    """

    LEVELS = 48
    AGES = 16
    HALOS = 8
    MAGNIFIED = 6
    TOO_SMALL = 4.5  # pixels of radius below which there is a disc and no ring

    def __init__(self, radius: float) -> None:
        self._radius = radius
        self._sprites: dict[tuple[int, int, int], tuple[np.ndarray, np.ndarray]] = {}

    def _sprite(self, level: int, age: int, halo: int) -> tuple[np.ndarray, np.ndarray]:
        """Colour times coverage (n, n, 3), and 256 − coverage (n, n, 1); `halo` from 1 is its size, 0 for none."""
        if (level, age, halo) not in self._sprites:
            half = int(np.ceil(self._radius * (1.8 if halo else 1.15))) + 1
            size = (2 * half + 1) * self.MAGNIFIED
            middle, radius = np.array([size / 2 - 0.5] * 2), self._radius * self.MAGNIFIED
            colour, cover = np.zeros((size, size, 3), np.uint8), np.zeros((size, size), np.uint8)
            colour[:] = style.OUTLINE
            tint = style.gauge_colour(level / self.LEVELS)
            shapes.disc(cover, middle, radius * 1.12, 245)
            if self._radius < self.TOO_SMALL:
                shapes.disc(colour, middle, radius * 0.8, tint)
            else:
                shapes.disc(colour, middle, radius * 0.7, style.mix(style.OUTLINE, tint, 0.35))
                if level:
                    shapes.sector(colour, middle, radius * 0.7, level / self.LEVELS, tint)
                ink = style.mix(*style.AGE, age / self.AGES)
                shapes.ring(colour, middle, radius * 0.92, ink, max(1, round(radius * 0.22)))
            if halo:
                reach = radius * (1.3 + 0.35 * halo / self.HALOS)
                for layer, ink in ((colour, style.FULL), (cover, 255)):
                    shapes.ring(layer, middle, reach, ink, max(1, round(radius * 0.2)))
            shape = (2 * half + 1, 2 * half + 1)
            premultiplied = colour.astype(np.float32) * (cover[:, :, None] / np.float32(255))
            small = cv2.resize(premultiplied, shape, interpolation=cv2.INTER_AREA)
            shade = cv2.resize(cover, shape, interpolation=cv2.INTER_AREA)
            self._sprites[level, age, halo] = (
                np.rint(small).astype(np.uint16),
                256 - shade.astype(np.uint16)[:, :, None],
            )
        return self._sprites[level, age, halo]

    def draw(self, image: np.ndarray, centre: np.ndarray, share: float, age: float = 0.0, pulse: float = 0.0) -> None:
        """A node whose buffer is filled to `share`, with data of some age, 0 (fresh) to 1 (old).

        The halo of a full one swells with `pulse`, 0 to 1.
        """
        halo = 1 + round(pulse * (self.HALOS - 1)) if share >= 0.9999 else 0
        level = round(min(max(share, 0.0), 1.0) * self.LEVELS)
        ink, rest = self._sprite(level, round(min(max(age, 0.0), 1.0) * self.AGES), halo)
        half = ink.shape[0] // 2
        x, y = round(float(centre[0])), round(float(centre[1]))
        x0, y0 = max(x - half, 0), max(y - half, 0)
        region = image[y0 : y + half + 1, x0 : x + half + 1]
        below = slice(y0 - y + half, y0 - y + half + region.shape[0])
        beside = slice(x0 - x + half, x0 - x + half + region.shape[1])
        region[:] = ink[below, beside] + ((region * rest[below, beside]) >> 8)
