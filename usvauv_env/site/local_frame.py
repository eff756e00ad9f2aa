"""The plane of an area on the Earth: longitude and latitude to x east, y north, and back, in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from usvauv.env.site.cf import OceanError

EQUATOR = 6378137.0  # semi-major axis a of WGS84, m
FLATTENING = 1 / 298.257223563
SQUEEZE = (1 - FLATTENING) ** 2  # b²/a²


@dataclass(frozen=True)
class LocalFrame:
    """The tangent plane to WGS84 at the area's south-west corner: x east, y north, both 0 there, m.

    A point of the ellipsoid is projected along the plane's normal. Distances in a square of 20 km agree with geodesics
    to 0.1 m; parallels are not quite straight and meridians not quite parallel, as in any true plane.

    Attributes:
        longitude, latitude: of the corner, degrees; latitudes from −85 to 85.
    """

    longitude: float
    latitude: float

    def __post_init__(self) -> None:
        if not -85 <= self.latitude <= 85:
            raise OceanError(f"latitude {self.latitude:g} degrees; allowed: -85 to 85")
        if not -360 <= self.longitude <= 360:
            raise OceanError(f"longitude {self.longitude:g} degrees; allowed: -360 to 360")

    def to_local(self, longitude: np.ndarray, latitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x, y (m) of points on the ellipsoid (degrees), any shape."""
        radius0, Z0 = _meridian(self.latitude)
        radius, Z = _meridian(latitude)
        turn, phi0 = np.radians(np.subtract(longitude, self.longitude)), math.radians(self.latitude)
        return radius * np.sin(turn), math.cos(phi0) * (Z - Z0) - math.sin(phi0) * (radius * np.cos(turn) - radius0)

    def to_geographic(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Longitude, latitude (degrees) of points of the plane (m), any shape: the inverse of `to_local`.

        h, by which the ellipsoid lies above the plane at (x, y), solves X² + Y² + Z² a²/b² = a².
        """
        radius0, Z0 = _meridian(self.latitude)
        sin, cos = math.sin(math.radians(self.latitude)), math.cos(math.radians(self.latitude))
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        X, Z = radius0 - sin * y, Z0 + cos * y
        A = cos**2 + sin**2 / SQUEEZE
        B = X * cos + Z * sin / SQUEEZE
        C = X**2 + x**2 + Z**2 / SQUEEZE - EQUATOR**2
        h = -C / (B + np.sqrt(B**2 - A * C))
        X, Z = X + h * cos, Z + h * sin
        return self.longitude + np.degrees(np.arctan2(x, X)), np.degrees(np.arctan2(Z, SQUEEZE * np.hypot(X, x)))

    def to_plane(
        self, longitude: np.ndarray, latitude: np.ndarray, east: np.ndarray, north: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Components along x and y of vectors given as east and north at points (degrees): meridians converge."""
        turn, phi, phi0 = np.radians(longitude - self.longitude), np.radians(latitude), math.radians(self.latitude)
        along_x = east * np.cos(turn) - north * np.sin(phi) * np.sin(turn)
        tilt = math.cos(phi0) * np.cos(phi) + math.sin(phi0) * np.sin(phi) * np.cos(turn)
        return along_x, east * math.sin(phi0) * np.sin(turn) + north * tilt


def _meridian(latitude: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Distance from the Earth's axis and height above the equator's plane of points of the ellipsoid, m."""
    phi = np.radians(latitude)
    N = EQUATOR / np.sqrt(np.cos(phi) ** 2 + SQUEEZE * np.sin(phi) ** 2)
    return N * np.cos(phi), SQUEEZE * N * np.sin(phi)
