"""The plane of an area on the Earth, and how files state it.

Longitude and latitude become x east, y north and back in closed form. The plane is the orthographic projection of the
ellipsoid about the area's south-west corner, EPSG's method 9840. Source: https://cfconventions.org, section 5.6 and
appendix F; IOGP, "Geomatics guidance note 7-2".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from usvauv.env.storage.netcdf import OceanError

EQUATOR = 6378137.0  # semi-major axis a of WGS84, m
FLATTENING = 1 / 298.257223563
SQUEEZE = (1 - FLATTENING) ** 2  # b²/a²

CRS = "crs"  # name of the variable with the grid mapping
LONGITUDE = {"standard_name": "longitude", "long_name": "longitude", "units": "degrees_east"}
LATITUDE = {"standard_name": "latitude", "long_name": "latitude", "units": "degrees_north"}
X_AXIS, Y_AXIS = (
    {
        "standard_name": f"projection_{name}_coordinate",
        "long_name": f"{way} distance from the south-west corner",
        "units": "m",
    }
    for name, way in (("x", "eastward"), ("y", "northward"))
)

DEGREE, METRE = 'ANGLEUNIT["degree",0.0174532925199433]', 'LENGTHUNIT["metre",1]'
WKT = (
    'PROJCRS["plane of the area",BASEGEOGCRS["WGS 84",DATUM["World Geodetic System 1984",'
    f'ELLIPSOID["WGS 84",{EQUATOR:.0f},{{flattening}},{METRE}]],PRIMEM["Greenwich",0,{DEGREE}]],'
    'CONVERSION["about the south-west corner",METHOD["Orthographic",ID["EPSG",9840]],'
    f'PARAMETER["Latitude of natural origin",{{latitude}},{DEGREE},ID["EPSG",8801]],'
    f'PARAMETER["Longitude of natural origin",{{longitude}},{DEGREE},ID["EPSG",8802]],'
    f'PARAMETER["False easting",0,{METRE},ID["EPSG",8806]],PARAMETER["False northing",0,{METRE},ID["EPSG",8807]]],'
    f'CS[Cartesian,2],AXIS["(E)",east,ORDER[1]],AXIS["(N)",north,ORDER[2]],{METRE}]'
)


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
        apart = np.subtract(longitude, self.longitude)
        turn, phi0 = np.radians(apart - 360 * np.round(apart / 360)), math.radians(self.latitude)
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


def wrapped(longitude: np.ndarray) -> np.ndarray:
    """Longitudes from −180 to below 180 degrees."""
    return longitude - 360 * np.floor((longitude + 180) / 360)


def _meridian(latitude: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Distance from the Earth's axis and height above the equator's plane of points of the ellipsoid, m."""
    phi = np.radians(latitude)
    N = EQUATOR / np.sqrt(np.cos(phi) ** 2 + SQUEEZE * np.sin(phi) ** 2)
    return N * np.cos(phi), SQUEEZE * N * np.sin(phi)


def grid_mapping(frame: LocalFrame) -> dict[str, str | float]:
    """Attributes of the variable `CRS`, by CF and as WKT 2."""
    flattening = round(1 / FLATTENING, 9)
    return {
        "grid_mapping_name": "orthographic",
        "long_name": "tangent plane to WGS84 at the south-west corner of the area",
        "longitude_of_projection_origin": frame.longitude,
        "latitude_of_projection_origin": frame.latitude,
        "false_easting": 0.0,
        "false_northing": 0.0,
        "semi_major_axis": EQUATOR,
        "inverse_flattening": flattening,
        "longitude_of_prime_meridian": 0.0,
        "crs_wkt": WKT.format(flattening=flattening, latitude=frame.latitude, longitude=frame.longitude),
    }


def time_attributes(start: str, beginning: str) -> dict[str, str]:
    """Attributes of a coordinate of seconds.

    Args:
        start: date and time of its second 0, ISO 8601, UTC; "" where nothing says it: then it is no CF time.
        beginning: what begins then.
    """
    about = {"long_name": f"time since {beginning}", "axis": "T"}
    if not start:
        return about | {"units": "s"}
    return about | {
        "standard_name": "time",
        "units": f"seconds since {start.replace('T', ' ')}",
        "calendar": "standard",
        "units_metadata": "leap_seconds: none",
    }
