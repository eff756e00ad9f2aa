"""The camera of the perspective view: a pinhole that looks level, with its picture shifted down to the scene.

Verticals stay vertical in such a picture, as in one of a view camera with a shifted lens. A column of it is then a
vertical plane of the scene, so that the sea can be drawn column by column (`wave_sheet`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

ELEVATION = math.radians(25)  # of the camera above the scene's centre
DISTANCE = 2.6  # from the camera to the scene's centre, in diagonals of the area
OFF_AXIS = math.radians(28)  # from the direction in which a side of the area is seen frontally
SWING = math.radians(9)  # to both sides, by which the camera moves around the scene
SWING_FRAMES = 3600  # of one movement there and back


@dataclass(frozen=True)
class Camera:
    """Scene coordinates are metres from the area's centre at mean sea level: east, north, up.

    Attributes:
        heading: in which it looks, anticlockwise from east, rad. distance, height: from the scene's centre, m.
        focal: length in pixels. centre: pixel (x, y) of what is straight ahead at infinity.
    """

    heading: float
    distance: float
    height: float
    focal: float
    centre: tuple[float, float]

    @cached_property
    def forward(self) -> np.ndarray:
        """Horizontal unit vector (2,) in which it looks."""
        return np.array([math.cos(self.heading), math.sin(self.heading)])

    @cached_property
    def right(self) -> np.ndarray:
        """Horizontal unit vector (2,) to its right."""
        return np.array([math.sin(self.heading), -math.cos(self.heading)])

    @cached_property
    def _matrix(self) -> tuple[np.ndarray, np.ndarray]:
        """Linear (3, 3) and constant (3,) part of the map to homogeneous pixels, transposed."""
        lens = np.array([(self.focal, 0, self.centre[0]), (0, self.focal, self.centre[1]), (0, 0, 1)])
        axes = np.array([(*self.right, 0.0), (0.0, 0.0, -1.0), (*self.forward, 0.0)])
        return (lens @ axes).T, lens @ (0.0, self.height, self.distance)

    def away(self, points: np.ndarray) -> np.ndarray:
        """Distances (...) of points (..., 2 or 3) along the direction in which it looks, m."""
        return points[..., :2] @ self.forward + self.distance

    def pixel(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3)."""
        linear, constant = self._matrix
        seen = points @ linear + constant
        return seen[..., :2] / seen[..., 2:]


class Swing(NamedTuple):
    """A camera that moves slowly to and fro around a scene, which stays within the picture."""

    middle: Camera

    @classmethod
    def around(cls, sides: tuple[float, float], top: float, bottom: float, size: tuple[int, int]) -> Swing:
        """The camera to which the box of an area is as large as fits in all of its movement.

        Args:
            sides: of the area, in x and y, m. It is seen across the longer one, from the south or from the east.
            top, bottom: of the box, m.
            size: of the room in the picture, pixels.
        """
        frontal = math.pi / 2 if sides[0] >= sides[1] else math.pi
        distance = DISTANCE * math.hypot(*sides)
        camera = Camera(frontal + OFF_AXIS, distance, distance * math.tan(ELEVATION), 1.0, (0.0, 0.0))
        half = 0.5 * np.array(sides)
        corners = np.array([(x, y, z) for x in (-half[0], half[0]) for y in (-half[1], half[1]) for z in (top, bottom)])
        turns = np.linspace(-SWING, SWING, 9)
        seen = np.concatenate([replace(camera, heading=camera.heading + turn).pixel(corners) for turn in turns])
        low, high = seen.min(axis=0), seen.max(axis=0)
        focal = float((size / (high - low)).min())
        x, y = 0.5 * np.array(size) - 0.5 * focal * (low + high)
        return cls(replace(camera, focal=focal, centre=(float(x), float(y))))

    def at(self, frame: int) -> Camera:
        """The camera in a frame."""
        turn = SWING * math.sin(2 * math.pi * frame / SWING_FRAMES)
        return replace(self.middle, heading=self.middle.heading + turn)

    def shifted(self, x: float, y: float) -> Swing:
        """The same with a picture shifted by (x, y) pixels."""
        return Swing(replace(self.middle, centre=(self.middle.centre[0] + x, self.middle.centre[1] + y)))
