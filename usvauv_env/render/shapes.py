"""Anti-aliased shapes at sub-pixel positions, and a translucent layer. Positions are (x, y) pixels."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from usvauv.env.render.style import Colour

SHIFT = 4  # OpenCV takes fixed-point coordinates: 1/16 pixel
_ONE = 1 << SHIFT


def fixed(points: np.ndarray) -> np.ndarray:
    """Fixed-point coordinates of points in pixels."""
    return np.rint(np.asarray(points) * _ONE).astype(np.int32, order="C")


def _fixed_point(point: np.ndarray) -> tuple[int, int]:
    return round(float(point[0]) * _ONE), round(float(point[1]) * _ONE)


def disc(image: np.ndarray, centre: np.ndarray, radius: float, colour: Colour | int) -> None:
    cv2.circle(image, _fixed_point(centre), round(radius * (1 << SHIFT)), colour, -1, cv2.LINE_AA, SHIFT)


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
    cv2.circle(image, _fixed_point(centre), round(radius * (1 << SHIFT)), colour, width, cv2.LINE_AA, SHIFT)


def arc(image: np.ndarray, centre: np.ndarray, radius: float, share: float, colour: Colour, width: int) -> None:
    """The part `share` (0 to 1) of a circle, clockwise from the top."""
    stroke(image, _turned(centre, radius, share), colour, width)


def sector(image: np.ndarray, centre: np.ndarray, radius: float, share: float, colour: Colour) -> None:
    """The part `share` (0 to 1) of a disc, clockwise from the top."""
    fill(image, np.concatenate([[centre], _turned(centre, radius, share)]), colour)


def _turned(centre: np.ndarray, radius: float, share: float) -> np.ndarray:
    """Points (N, 2) of the part `share` (0 to 1) of a circle, clockwise from the top."""
    turns = np.linspace(0.0, 2 * np.pi * min(share, 1.0), max(2, round(48 * share) + 1))
    return np.asarray(centre) + radius * np.stack([np.sin(turns), -np.cos(turns)], 1)


def stroke(image: np.ndarray, points: np.ndarray, colour: Colour | int, width: int = 1, closed: bool = False) -> None:
    """A line through points (N, 2)."""
    cv2.polylines(image, [fixed(points)], closed, colour, width, cv2.LINE_AA, SHIFT)


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


def smooth(
    image: np.ndarray,
    centre: np.ndarray,
    reach: float,
    factor: int,
    draw: Callable[[np.ndarray, np.ndarray, int], None],
) -> None:
    """Draw on a copy, magnified by `factor`, of the square `reach` pixels around a centre; put it back, averaged.

    OpenCV's own anti-aliasing shows steps in lines wider than one pixel. `draw` receives the copy, the centre in it and
    the factor.
    """
    x0, y0 = (max(int(c - reach), 0) for c in centre)
    region = image[y0 : max(int(centre[1] + reach) + 2, 0), x0 : max(int(centre[0] + reach) + 2, 0)]
    if not region.size:
        return
    fine = cv2.resize(region, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    draw(fine, (np.asarray(centre) - (x0, y0) + 0.5) * factor - 0.5, factor)
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
        pieces = list(fixed(lines - self._origin))
        cv2.polylines(self._cover, pieces, False, round(255 * opacity), width, cv2.LINE_AA, SHIFT)

    def strokes(self, lines: list[np.ndarray], colour: Colour, opacity: float, width: int = 1) -> None:
        """Open lines, each (N, 2) pixels of the whole picture."""
        pieces = [fixed(line - self._origin) for line in lines]
        # The colour is wider and not anti-aliased: the edge is that of the coverage.
        cv2.polylines(self._colour, pieces, False, colour, width + 2, cv2.LINE_8, SHIFT)
        cv2.polylines(self._cover, pieces, False, round(255 * opacity), width, cv2.LINE_AA, SHIFT)

    def ring(self, centre: np.ndarray, radius: float, colour: Colour, opacity: float, width: int = 1) -> None:
        ring(self._colour, np.asarray(centre) - self._origin, radius, colour, width + 2)
        ring(self._cover, np.asarray(centre) - self._origin, radius, round(255 * opacity), width)

    def disc(self, centre: np.ndarray, radius: float, colour: Colour, opacity: float) -> None:
        disc(self._colour, np.asarray(centre) - self._origin, radius + 1, colour)
        disc(self._cover, np.asarray(centre) - self._origin, radius, round(255 * opacity))

    def blend(self, picture: np.ndarray) -> None:
        """Blend the layer into its region of the picture."""
        region = picture[self._region]
        cover = cv2.merge([self._cover] * 3)
        above = cv2.multiply(self._colour, cover, scale=1 / 255)
        below = cv2.multiply(region, cv2.bitwise_not(cover), scale=1 / 255)
        cv2.add(above, below, region)
