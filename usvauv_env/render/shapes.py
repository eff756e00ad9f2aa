"""Anti-aliased shapes at sub-pixel positions, a translucent layer, and the symbols of vehicles, nodes and fixes.

Positions are (x, y) pixels; headings are anticlockwise from east, rad.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.render import style
from usvauv.env.render.layout import Layout
from usvauv.env.render.style import Colour, text_width, write

SHIFT = 4  # OpenCV takes fixed-point coordinates: 1/16 pixel
_ONE = 1 << SHIFT


def fixed(points: np.ndarray) -> np.ndarray:
    """Fixed-point coordinates of points in pixels."""
    return np.rint(np.asarray(points) * _ONE).astype(np.int32, order="C")


def disc(image: np.ndarray, centre: np.ndarray, radius: float, colour: Colour | int) -> None:
    ring(image, centre, radius, colour, -1)


def dots(image: np.ndarray, centres: np.ndarray, radius: float, colours: np.ndarray) -> None:
    """Small discs at points (N, 2) in colours (N, 3); far faster than as many calls of `disc`."""
    reach = int(radius + 1.5)
    steps = np.arange(-reach, reach + 1)
    whole = np.rint(centres).astype(int)
    columns, rows = whole[:, 0, None, None] + steps, whole[:, 1, None, None] + steps[:, None]
    away = np.hypot(columns - centres[:, 0, None, None], rows - centres[:, 1, None, None])
    cover = np.clip(radius + 0.5 - away, 0.0, 1.0)
    inside = (cover > 0) & (columns >= 0) & (columns < image.shape[1]) & (rows >= 0) & (rows < image.shape[0])
    number, *_ = np.nonzero(inside)
    place = np.broadcast_to(rows, inside.shape)[inside], np.broadcast_to(columns, inside.shape)[inside]
    below = image[place].astype(np.float32)
    image[place] = below + (colours[number] - below) * cover[inside, None] + 0.5


def ring(image: np.ndarray, centre: np.ndarray, radius: float, colour: Colour | int, width: int) -> None:
    cv2.circle(image, fixed(centre).tolist(), round(radius * _ONE), colour, width, cv2.LINE_AA, SHIFT)


def _turned(centre: np.ndarray, radius: float, share: float) -> np.ndarray:
    """Points (N, 2) of the part `share` (0 to 1) of a circle, clockwise from the top."""
    turns = np.linspace(0.0, 2 * np.pi * min(share, 1.0), max(2, round(48 * share) + 1))
    return np.asarray(centre) + radius * np.stack([np.sin(turns), -np.cos(turns)], 1)


def stroke(image: np.ndarray, points: np.ndarray, colour: Colour | int, width: int = 1, closed: bool = False) -> None:
    """A line through points (N, 2)."""
    cv2.polylines(image, [fixed(points)], closed, colour, width, cv2.LINE_AA, SHIFT)


def strokes(image: np.ndarray, lines: Sequence[np.ndarray] | np.ndarray, colour: Colour | int, width: int = 1) -> None:
    """Lines (N, P, 2)."""
    cv2.polylines(image, list(fixed(np.asarray(lines))), False, colour, width, cv2.LINE_AA, SHIFT)


def fill(image: np.ndarray, points: np.ndarray, colour: Colour | int) -> None:
    """A filled polygon (N, 2)."""
    cv2.fillPoly(image, [fixed(points)], colour, cv2.LINE_AA, SHIFT)


def ellipse_points(centre: np.ndarray, axes: np.ndarray, count: int = 48) -> np.ndarray:
    """Outline (count, 2) of the ellipse whose semi-axes are the rows of `axes` (2, 2), pixels."""
    turns = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    return np.asarray(centre) + np.stack([np.cos(turns), np.sin(turns)], 1) @ axes


def dashes(start: np.ndarray, end: np.ndarray, dash: float) -> list[np.ndarray]:
    """The pieces (2, 2) of a dashed line; dashes and gaps are `dash` pixels long."""
    length = float(np.hypot(*(end - start)))
    if length < 1e-6:
        return []
    begin = np.arange(0.0, length, 2 * dash)
    stop = np.minimum(begin + dash, length)
    direction = (end - start) / length
    return [np.stack([start + a * direction, start + b * direction]) for a, b in zip(begin, stop, strict=True)]


def dashed(points: np.ndarray, dash: float) -> list[np.ndarray]:
    """The pieces of a dashed line through points (P, 2); dashes and gaps are `dash` pixels long."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    pieces = []
    for begin in np.arange(0.0, along[-1], 2 * dash):
        ends = begin, min(begin + dash, along[-1])
        first, last = (np.array([[np.interp(end, along, axis) for axis in points.T]]) for end in ends)
        pieces.append(np.concatenate([first, points[(along > ends[0]) & (along < ends[1])], last]))
    return pieces


@contextmanager
def smooth(image: np.ndarray, centre: np.ndarray, reach: float, factor: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """A copy, magnified by `factor`, of the square `reach` pixels around a centre, and the centre in it.

    When the context ends, what was drawn on the copy is put back, averaged: OpenCV's own anti-aliasing shows steps in
    lines wider than one pixel.
    """
    x0, y0 = (max(int(c - reach), 0) for c in centre)
    region = image[y0 : max(int(centre[1] + reach) + 2, 0), x0 : max(int(centre[0] + reach) + 2, 0)]
    if not region.size:  # outside the picture, where nothing of it is seen
        region = np.zeros((1, 1, 3), np.uint8)
    fine = cv2.resize(region, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    yield fine, (np.asarray(centre) - (x0, y0) + 0.5) * factor - 0.5
    cv2.resize(fine, (region.shape[1], region.shape[0]), region, interpolation=cv2.INTER_AREA)


class Overlay:
    """A translucent layer over one region of a picture: colour and coverage, blended at once.

    Where shapes overlap, the later one replaces the earlier one.
    """

    def __init__(self, left: int, top: int, width: int, height: int) -> None:
        self._origin = np.array([left, top], float)
        self._region = (slice(top, top + height), slice(left, left + width))
        self._colour = np.full((height, width, 3), 255, np.uint8)
        self._cover = np.zeros((height, width), np.uint8)

    def clear(self) -> None:
        self._colour.fill(255)
        self._cover.fill(0)

    def white_lines(self, lines: np.ndarray, opacity: float, width: int) -> None:
        """White lines (N, P, 2), to be drawn first: they set the coverage alone; a cleared layer is white."""
        strokes(self._cover, lines - self._origin, round(255 * opacity), width)

    def strokes(self, lines: list[np.ndarray], colour: Colour, opacity: float, width: int = 1) -> None:
        """Open lines, each (N, 2) pixels of the whole picture."""
        pieces = [fixed(line - self._origin) for line in lines]
        # The colour is wider and not anti-aliased: the edge is that of the coverage.
        cv2.polylines(self._colour, pieces, False, colour, width + 2, cv2.LINE_8, SHIFT)
        cv2.polylines(self._cover, pieces, False, round(255 * opacity), width, cv2.LINE_AA, SHIFT)

    def ring(self, centre: np.ndarray, radius: float, colour: Colour, opacity: float, width: int = 1) -> None:
        ring(self._colour, np.asarray(centre) - self._origin, radius, colour, width + 2)
        ring(self._cover, np.asarray(centre) - self._origin, radius, round(255 * opacity), width)

    def blend(self, picture: np.ndarray) -> None:
        """Blend the layer into its region of the picture."""
        region = picture[self._region]
        cover = cv2.merge([self._cover] * 3)
        above = cv2.multiply(self._colour, cover, scale=1 / 255)
        below = cv2.multiply(region, cv2.bitwise_not(cover), scale=1 / 255)
        cv2.add(above, below, region)


# Outlines in lengths of the vehicle: x forward, y to port.
_HULL = np.array([(0.5, 0), (0.3, 0.17), (0.02, 0.23), (-0.5, 0.2), (-0.5, -0.2), (0.02, -0.23), (0.3, -0.17)])
_CABIN = np.array([(0.16, 0.11), (-0.24, 0.12), (-0.24, -0.12), (0.16, -0.11)])
_TURN = np.linspace(-np.pi / 2, np.pi / 2, 9)
_NOSE = np.stack([0.38 + 0.12 * np.cos(_TURN), 0.12 * np.sin(_TURN)], 1)
_BODY = np.concatenate(
    [_NOSE, [(-0.22, 0.12), (-0.36, 0.06), (-0.5, 0.035), (-0.5, -0.035), (-0.36, -0.06), (-0.22, -0.12)]]
)
_FINS = np.array([(-0.16, 0.1), (-0.36, 0.27), (-0.46, 0.27), (-0.4, 0), (-0.46, -0.27), (-0.36, -0.27), (-0.16, -0.1)])
_HEAD = np.array([(0.5, 0), (-0.4, 0.45), (-0.15, 0), (-0.4, -0.45)])
_BAND = np.array([(0.3, 0.11), (0.22, 0.11), (0.22, -0.11), (0.3, -0.11)])


def _place(outline: np.ndarray, centre: np.ndarray, heading: float, length: float) -> np.ndarray:
    """An outline scaled, rotated and translated; pixels, y down."""
    cos, sin = np.cos(heading), np.sin(heading)
    x, y = outline[:, 0] * length, outline[:, 1] * length
    return np.asarray(centre) + np.stack([x * cos - y * sin, -(x * sin + y * cos)], 1)


def auv(image: np.ndarray, centre: np.ndarray, heading: float, length: float, colour: Colour, factor: int) -> None:
    """A torpedo with tail fins, dark-edged."""
    with smooth(image, centre, 0.7 * length, factor) as (fine, middle):
        fins, body, band = (_place(part, middle, heading, length * factor) for part in (_FINS, _BODY, _BAND))
        edge = max(1, round(0.11 * length * factor))
        for outline in (fins, body):
            stroke(fine, outline, style.EDGE, edge, closed=True)
        fill(fine, fins, style.mix(colour, style.OUTLINE, 0.3))
        fill(fine, body, colour)
        fill(fine, band, style.OUTLINE)


def arrow(image: np.ndarray, centre: np.ndarray, heading: float, length: float, colour: Colour, factor: int) -> None:
    """The head of an arrow, dark-edged."""
    with smooth(image, centre, length, factor) as (fine, middle):
        outline = _place(_HEAD, middle, heading, length * factor)
        stroke(fine, outline, style.OUTLINE, max(1, round(0.25 * length * factor)), closed=True)
        fill(fine, outline, colour)


def boat(image: np.ndarray, centre: np.ndarray, heading: float, length: float, factor: int) -> None:
    """A hull with a cabin, dark-edged."""
    with smooth(image, centre, 0.7 * length, factor) as (fine, middle):
        hull, cabin = (_place(part, middle, heading, length * factor) for part in (_HULL, _CABIN))
        stroke(fine, hull, style.EDGE, max(1, round(0.1 * length * factor)), closed=True)
        fill(fine, hull, style.BOAT)
        fill(fine, cabin, style.BOAT_DECK)


def progress_ring(
    image: np.ndarray, centre: np.ndarray, radius: float, share: float, colour: Colour, width: float, factor: int
) -> None:
    """A ring filled to `share`, clockwise from the top."""
    with smooth(image, centre, radius + width, factor) as (fine, middle):
        dim = style.mix(colour, style.OUTLINE, 0.65)
        ring(fine, middle, radius * factor, dim, max(1, round(0.4 * width * factor)))
        if share > 0:
            stroke(fine, _turned(middle, radius * factor, share), colour, max(1, round(width * factor)))


def diagonals(centre: np.ndarray, size: float) -> np.ndarray:
    """Lines (2, 2, 2) of a diagonal cross."""
    return np.asarray(centre) + np.array([[(-size, y), (size, -y)] for y in (-size, size)])


def cross(image: np.ndarray, centre: np.ndarray, size: float, colour: Colour, width: int) -> None:
    """A diagonal cross with a dark edge."""
    lines = diagonals(centre, size)
    strokes(image, lines, style.OUTLINE, width + 2)
    strokes(image, lines, colour, width)


def plus(image: np.ndarray, centre: np.ndarray, size: float, colour: Colour, width: int) -> None:
    """An upright cross."""
    lines = np.array([[(-size, 0), (size, 0)], [(0, -size), (0, size)]])
    strokes(image, np.asarray(centre) + lines, colour, width)


def fix(image: np.ndarray, centre: np.ndarray, size: float, colour: Colour, width: float, factor: int) -> None:
    """A hollow diamond: a measured position."""
    corners = np.array([(0, -size), (size, 0), (0, size), (-size, 0)])
    _hollow(image, centre, corners, colour, width, size + 2 * width, factor)


def foreseen(image: np.ndarray, centre: np.ndarray, size: float, colour: Colour, width: float, factor: int) -> None:
    """A hollow square: where a vehicle is expected."""
    corners = np.array([(-size, -size), (size, -size), (size, size), (-size, size)])
    _hollow(image, centre, corners, colour, width, 1.5 * size + 2 * width, factor)


def _hollow(
    image: np.ndarray, centre: np.ndarray, corners: np.ndarray, colour: Colour, width: float, reach: float, factor: int
) -> None:
    """The dark-edged outline of a polygon with corners (N, 2) around a centre."""
    with smooth(image, centre, reach, factor) as (fine, middle):
        for ink, wide in ((style.EDGE, 2 * width), (colour, width)):
            stroke(fine, middle + corners * factor, ink, max(1, round(wide * factor)), closed=True)


def station(image: np.ndarray, centre: np.ndarray, radius: float, colour: Colour, factor: int) -> None:
    """A place to be held: a disc in a ring."""
    with smooth(image, centre, 1.3 * radius, factor) as (fine, middle):
        disc(fine, middle, 1.15 * radius * factor, style.OUTLINE)
        ring(fine, middle, 0.9 * radius * factor, colour, max(1, round(0.22 * radius * factor)))
        disc(fine, middle, 0.35 * radius * factor, colour)


def target(image: np.ndarray, centre: np.ndarray, size: float, colour: Colour, factor: int) -> None:
    """A moving target: a filled diamond with a dark edge."""
    corners = np.array([(0, -size), (size, 0), (0, size), (-size, 0)])
    with smooth(image, centre, 1.6 * size, factor) as (fine, middle):
        fill(fine, middle + 1.35 * corners * factor, style.OUTLINE)
        fill(fine, middle + corners * factor, colour)


def badge(image: np.ndarray, text: str, centre: np.ndarray, size: float, colour: Colour, opacity: float = 1.0) -> None:
    """A short text on a dark pill."""
    half = max(text_width(text, size, bold=True) / 2, 0.3 * size)
    x, y = np.asarray(centre)
    left, top = max(int(x - half - size), 0), max(int(y - size), 0)
    region = image[top : max(int(y + size) + 2, 0), left : max(int(x + half + size) + 2, 0)]
    if not region.size:  # outside the picture
        return
    drawn = region.copy()
    ends = np.array([(x - half + 0.25 * size, y), (x + half - 0.25 * size, y)]) - (left, top)
    stroke(drawn, ends, style.OUTLINE, max(1, round(1.35 * size)))
    write(drawn, text, (x - left, y - top + 0.36 * size), size, colour, bold=True, anchor="centre")
    region[:] = cv2.addWeighted(drawn, opacity, region, 1 - opacity, 0)


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
            disc(cover, middle, radius * 1.12, 245)
            if self._radius < self.TOO_SMALL:
                disc(colour, middle, radius * 0.8, tint)
            else:
                disc(colour, middle, radius * 0.7, style.mix(style.OUTLINE, tint, 0.35))
                if level:
                    part = _turned(middle, radius * 0.7, level / self.LEVELS)
                    fill(colour, np.concatenate([[middle], part]), tint)
                ink = style.mix(*style.AGE, age / self.AGES)
                ring(colour, middle, radius * 0.92, ink, max(1, round(radius * 0.22)))
            if halo:
                reach = radius * (1.3 + 0.35 * halo / self.HALOS)
                for layer, ink in ((colour, style.FULL), (cover, 255)):
                    ring(layer, middle, reach, ink, max(1, round(radius * 0.2)))
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
        region = image[y0 : max(y + half + 1, 0), x0 : max(x + half + 1, 0)]
        below = slice(y0 - y + half, y0 - y + half + region.shape[0])
        beside = slice(x0 - x + half, x0 - x + half + region.shape[1])
        region[:] = ink[below, beside] + ((region * rest[below, beside]) >> 8)


class LegendSymbol(NamedTuple):
    """Draws symbols of the map as its legend shows them, at a place of a picture."""

    picture: np.ndarray
    at: np.ndarray
    layout: Layout

    def _line(self, points: Sequence[tuple[float, float]], ink: Colour, width: float = 1.3) -> None:
        """A line through points (N, 2) from the place, pixels of the design."""
        ends = self.at + np.array(points) * self.layout.unit
        stroke(self.picture, ends, ink, self.layout.px(width))

    def _rings(self, rings: tuple[tuple[float, float], ...], ink: Colour, width: float) -> None:
        """Rings of radii, each in a share of an ink."""
        for radius, share in rings:
            faded = style.mix(self.layout.theme.card, ink, share)
            ring(self.picture, self.at, radius * self.layout.unit, faded, self.layout.px(width))

    def _gauges(self, *gauges: tuple[float, float, float]) -> None:
        """Nodes beside each other: offset, how full, age."""
        sprites = NodeGauges(5.5 * self.layout.unit)
        for x, share, old in gauges:
            sprites.draw(self.picture, self.at + np.array([x, 0]) * self.layout.unit, share, old, pulse=0.6)

    def auv(self) -> None:
        auv(self.picture, self.at, 0.35, 22 * self.layout.unit, self.layout.theme.auv(0), self.layout.zoom)

    def boat(self) -> None:
        boat(self.picture, self.at, 0.35, 22 * self.layout.unit, self.layout.zoom)

    def goal(self) -> None:
        cross(self.picture, self.at, 4.5 * self.layout.unit, style.BOAT, self.layout.px(2))

    def ping(self) -> None:
        self._rings(((4, 0.7), (9, 0.35)), self.layout.theme.text, 1.3)

    def heard(self) -> None:
        theme = self.layout.theme
        self._line([(-12, 5), (12, -5)], style.mix(theme.card, theme.auv(0), 0.6), 1.2)

    def target(self) -> None:
        ends = self.at + np.array([(-11, 5), (11, -5)]) * self.layout.unit
        pieces = dashes(ends[0], ends[1], 4 * self.layout.unit)
        strokes(self.picture, pieces, self.layout.theme.auv(0), self.layout.px(1.3))

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
        station(self.picture, self.at, 6.5 * self.layout.unit, self.layout.theme.auv(0), self.layout.zoom)

    def moving(self) -> None:
        target(self.picture, self.at, 6 * self.layout.unit, style.TARGET, self.layout.zoom)

    def range(self) -> None:
        turns = np.linspace(-0.7, 0.7, 13)
        arc = np.stack([14 * np.cos(turns) - 10, 14 * np.sin(turns)], 1)
        self._line([(x, y) for x, y in arc.tolist()], self.layout.theme.auv(0))

    def tracked(self) -> None:
        unit = self.layout.unit
        outline = ellipse_points(self.at, np.array([(11.0, -3.0), (1.5, 5.0)]) * unit)
        stroke(self.picture, outline, style.TARGET, self.layout.px(1.2), closed=True)
        fix(self.picture, self.at, 3 * unit, style.TARGET, 1.3 * unit, self.layout.zoom)

    def rim(self) -> None:
        unit, turns = self.layout.unit, np.linspace(0.0, 2 * np.pi, 25)
        around = self.at + 8 * unit * np.stack([np.cos(turns), np.sin(turns)], 1)
        for place, share in enumerate(np.cos(turns - 0.5) ** 2):
            ink = style.mix(style.SEA[0], style.TARGET, 0.15 + 0.85 * share)
            stroke(self.picture, around[[place - 1, place]], ink, self.layout.px(3.5))

    def service(self) -> None:
        unit, colour = self.layout.unit, self.layout.theme.auv(0)
        progress_ring(self.picture, self.at, 8 * unit, 0.65, colour, 2.8 * unit, self.layout.zoom)

    def fix(self) -> None:
        unit, ink, aside = self.layout.unit, self.layout.theme.text, np.array([7, 0]) * self.layout.unit
        plus(self.picture, self.at - aside, 4.5 * unit, ink, self.layout.px(1))
        fix(self.picture, self.at + aside, 4.5 * unit, ink, 1.5 * unit, self.layout.zoom)

    def ellipse(self) -> None:
        axes = np.array([(11.0, -3.0), (1.5, 5.0)]) * self.layout.unit
        outline = ellipse_points(self.at, axes)
        stroke(self.picture, outline, self.layout.theme.text, self.layout.px(1.2), closed=True)

    def foreseen(self) -> None:
        unit, colour = self.layout.unit, self.layout.theme.auv(0)
        foreseen(self.picture, self.at, 5 * unit, colour, 1.5 * unit, self.layout.zoom)

    def field(self) -> None:
        self._rings(((3, 0.8), (6, 0.55), (9, 0.3)), self.layout.theme.muted, 1.2)
