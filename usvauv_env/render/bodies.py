"""Vehicles as small solids, turned to their heading and lit from above."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.canvas import Canvas
from usvauv.env.render.style import Colour

LIGHT = np.array([-0.42, -0.25, 0.87])  # unit vector to the light: east, north, up
FACTOR = 3  # by which bodies are drawn magnified before they are averaged


class Body(NamedTuple):
    """A solid of F flat faces, which is as long as 1.

    Attributes:
        corners: (F, 4, 3) of the faces, anticlockwise seen from outside; x forward, y to port, z up.
        normals: (F, 3) unit vectors. colours: (F, 3).
    """

    corners: np.ndarray
    normals: np.ndarray
    colours: np.ndarray

    @classmethod
    def of(cls, faces: list[np.ndarray], colours: list[Colour]) -> Body:
        corners = np.array(faces)
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        return cls(corners, normals / np.linalg.norm(normals, axis=1, keepdims=True), np.array(colours, float))

    def draw(self, canvas: Canvas, place: np.ndarray, axes: np.ndarray, length: float) -> None:
        """Draw it around a place (3,) of the scene, `length` m long, with the axes of `turned`."""
        corners = self.corners * length @ axes + place
        pixels, centre = canvas.camera.pixel(corners), canvas.camera.pixel(place)
        (ax, ay), (bx, by) = (pixels[:, 2] - pixels[:, 0]).T, (pixels[:, 3] - pixels[:, 1]).T
        seen = np.flatnonzero(ax * by - ay * bx < 0)  # rows run down
        seen = seen[np.argsort(-canvas.camera.away(corners[seen].mean(axis=1)))]
        lit = 0.7 + 0.3 * self.normals[seen] @ (axes @ LIGHT)
        colours = (self.colours[seen] * lit[:, None]).tolist()

        def paint(fine: np.ndarray, middle: np.ndarray, zoom: int) -> None:
            outlines = shapes.fixed((pixels[seen] - centre) * zoom + middle)
            cv2.polylines(fine, list(outlines), True, style.OUTLINE, 2 * zoom, cv2.LINE_8, shapes.SHIFT)
            for outline, colour in zip(outlines, colours, strict=True):
                cv2.fillConvexPoly(fine, outline, colour, cv2.LINE_8, shapes.SHIFT)

        shapes.smooth(canvas.picture, centre, float(np.abs(pixels - centre).max()) + 3, FACTOR, paint)


def turned(heading: float, slope: np.ndarray) -> np.ndarray:
    """Axes (3, 3) of a body, one a row: forward, to port, up; it stands on a slope (2,) to the east and north, m/m."""
    # The horizontal part of its forward axis is its heading.
    ahead = np.array([math.cos(heading), math.sin(heading)])
    rise = float(slope @ ahead)
    forward = np.array([*ahead, rise]) / math.hypot(1.0, rise)
    up = np.array([-slope[0], -slope[1], 1.0]) / math.sqrt(1.0 + float(slope @ slope))
    (a, b, c), (x, y, z) = up, forward
    return np.array([forward, (b * z - c * y, c * x - a * z, a * y - b * x), up])


def _tube(rings: list[np.ndarray], colours: list[Colour]) -> tuple[list[np.ndarray], list[Colour]]:
    """Faces between rings (N, 3) of corners, each ring with a colour for the faces up to the next."""
    faces, inks = [], []
    for low, high, ink in zip(rings[:-1], rings[1:], colours, strict=True):
        faces += list(np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1))
        inks += [ink] * len(low)
    return faces, inks


def _deck(half: tuple[tuple[float, float], ...], up: float) -> np.ndarray:
    """A ring (2 N, 3) at a height, anticlockwise from above, of its starboard half (N, 2) from stern to bow."""
    starboard = np.array(half)
    whole = np.concatenate([starboard, starboard[::-1] * (1, -1)])
    return np.column_stack([whole, np.full(len(whole), up)])


def _lid(ring: np.ndarray) -> list[np.ndarray]:
    """Faces of a flat ring (2 N, 3): strips from side to side."""
    last = len(ring) - 1
    return [ring[[i, i + 1, last - i - 1, last - i]] for i in range(len(ring) // 2 - 1)]


def _boat() -> Body:
    keel = _deck(((-0.46, -0.12), (0.02, -0.14), (0.24, -0.08), (0.38, -0.005)), -0.08)
    line = _deck(((-0.48, -0.16), (0.03, -0.185), (0.29, -0.1), (0.46, -0.005)), 0.02)
    rail = _deck(((-0.5, -0.19), (0.04, -0.21), (0.32, -0.13), (0.56, -0.005)), 0.12)
    faces, inks = _tube([keel, line, rail], [style.colour("#c8402f"), style.BOAT])
    faces += _lid(rail)
    inks += [style.colour("#b9c4ce")] * 3
    room = [_deck(((-0.3, -0.13), (0.14, -0.13)), 0.12), _deck(((-0.29, -0.12), (0.09, -0.12)), 0.22)]
    room += [_deck(((-0.28, -0.115), (0.03, -0.115)), 0.34)]
    walls, shades = _tube(room, [style.BOAT, style.BOAT_DECK])
    faces += [*walls, *_lid(room[-1])]
    inks += [*shades, style.BOAT]
    return Body.of(faces, inks)


def auv(colour: Colour) -> Body:
    """A torpedo with four fins."""
    turns = np.linspace(0.0, 2 * np.pi, 6, endpoint=False)
    profile = ((-0.5, 0.02), (-0.24, 0.1), (0.34, 0.1), (0.5, 0.02))  # along the axis, radius
    rings = [np.stack([np.full(6, x), r * np.cos(turns), r * np.sin(turns)], 1) for x, r in profile]
    band = style.mix(colour, style.WHITE, 0.55)
    faces, inks = _tube(rings, [colour, colour, band])
    fin = np.array([(-0.46, 0.03), (-0.28, 0.07), (-0.36, 0.25), (-0.48, 0.25)])
    for y, z in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        blade = np.stack([fin[:, 0], fin[:, 1] * y, fin[:, 1] * z], 1)
        faces += [blade, blade[::-1]]
        inks += [style.mix(colour, style.OUTLINE, 0.3)] * 2
    return Body.of(faces, inks)


BOAT = _boat()
