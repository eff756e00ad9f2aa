"""Lines and circles of a scene in a picture, as a camera sees them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.camera import Camera
from usvauv.env.render.style import Colour

TRAIL_PIECES = 5  # of one colour each


class Canvas(NamedTuple):
    """A BGR picture and the camera whose pixels are its own."""

    picture: np.ndarray
    camera: Camera

    def line(self, points: np.ndarray, ink: Colour, width: int = 1) -> None:
        """A line through points (N, 3) of the scene."""
        shapes.stroke(self.picture, self.camera.pixel(points), ink, width)

    def pieces(self, pixels: np.ndarray, ink: Colour, width: int = 1) -> None:
        """Lines (N, P, 2) in pixels."""
        if len(pixels):
            cv2.polylines(self.picture, list(shapes.fixed(pixels)), False, ink, width, cv2.LINE_AA, shapes.SHIFT)

    def circle(self, centre: np.ndarray, radius: float, ink: Colour, width: int = 1, share: float = 1.0) -> None:
        """The part `share` of a level circle of a radius in m, clockwise from the north."""
        turn = np.linspace(0, 2 * np.pi * share, max(3, round(40 * share)))
        self.line(centre + radius * np.stack([np.sin(turn), np.cos(turn), 0 * turn], 1), ink, width)

    def trail(self, points: np.ndarray, ink: Colour, faded: Colour, width: int) -> None:
        """A line through points (N, 3), oldest first, that fades towards the oldest."""
        pixels = self.camera.pixel(points)
        length = max(2, len(pixels) // TRAIL_PIECES + 1)
        begins = range(0, len(pixels) - 1, length)
        for place, begin in enumerate(begins):
            shade = style.mix(faded, ink, (place + 1) / len(begins))
            shapes.stroke(self.picture, pixels[begin : begin + length + 1], shade, width)
