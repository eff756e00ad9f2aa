"""The place of an area on the Earth: its tangent plane, that plane in files, and positions given by a user.

Longitude and latitude become x east, y north and back in closed form. The plane is the orthographic projection of the
ellipsoid about the area's south-west corner, EPSG's method 9840. Source: https://cfconventions.org, section 5.6 and
appendix F; IOGP, "Geomatics guidance note 7-2".
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from usvauv.env.scenario import Scenario
from usvauv.env.scenario.fields import FARTHEST
from usvauv.env.storage.netcdf import OceanError
from usvauv.kernels.errors import UserError

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

# 60,80 are metres, 22.5101N,114.0203E degrees, which may have minutes and seconds of arc: 22°30.5'N or 22°30'30"N.
ANGLE = re.compile(r"(\d+(?:\.\d+)?)°?(?:(\d+(?:\.\d+)?)['′’](?:(\d+(?:\.\d+)?)[\"″”])?)?([NSEW])")
SIDED = re.compile(r"°|[\d.'′’\"″”]\s*[NSEW]\s*$", re.IGNORECASE)
PLAIN = re.compile(r"\s*-?\d+(?:\.(\d+))?\s*")
FEWEST_DIGITS = 3  # after the point; 0.001° are some 100 m
NEAR = 0.5  # degrees, further than any area reaches; AUVs in metres are farther apart
DEGREES = "metres are expected and these look like degrees, which have a side: 22.5101N,114.0203E"


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

    @classmethod
    def of(cls, scenario: Scenario) -> LocalFrame | None:
        """The area's plane; None where the scenario names no place: no file, and the default corner."""
        water = scenario.water
        named = water.bathymetry or water.currents or water.waves or water.longitude or water.latitude
        return cls(water.longitude, water.latitude) if named else None

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


def numbers(option: str, text: str, form: str, unit: str = " in metres") -> list[float]:
    """Comma-separated numbers, as many as `form` names, for example X,Y.

    Raises:
        UserError: another count, or not numbers.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != len(form.split(",")):
        raise UserError(f"{option} {text!r}: expected {form}{unit}")
    return values


def angle(option: str, text: str, part: str, sides: str) -> float:
    """Degrees of a latitude (`sides` "NS") or a longitude ("EW"), south and west being negative.

    Raises:
        UserError: `part` of `text` is no such angle, or too large.
    """
    name, largest, example = ("latitude", 90, "22.5101N") if sides == "NS" else ("longitude", 180, "114.0203E")
    found = ANGLE.fullmatch(part.strip().upper())
    if not found or found[4] not in sides:
        raise UserError(f"{option} {text!r}: {part!r} is not a {name}; expected one such as {example}")
    degrees, minutes, seconds = (float(number or 0) for number in found.groups()[:3])
    value = degrees + minutes / 60 + seconds / 3600
    if value > largest or max(minutes, seconds) >= 60:
        raise UserError(
            f"{option} {text!r}: {part!r}: a {name} has at most {largest} degrees, and minutes and seconds below 60"
        )
    return value if found[4] == sides[0] else -value


def position(option: str, text: str, form: str, scenario: Scenario, hint: str = "") -> list[float]:
    """A position as x and y, m, and what else `form` names; x and y may have been given as latitude and longitude.

    Args:
        form: "X,Y" or "X,Y,Z".
        hint: further sentence for a position that is not in the area.

    Raises:
        UserError: no such position, not in the area, or degrees where the scenario has no place on Earth.
    """
    parts = text.split(",")
    if not any(SIDED.search(part) for part in parts[:2]):
        x, y, *rest = numbers(option, text, form)
        inside = True
    else:
        x, y, inside = _on_plane(option, text, parts, form, scenario)
        rest = numbers(option, ",".join(parts[2:]), form[4:]) if parts[2:] else []
    area = scenario.area
    if not (inside and 0 <= x <= area.width and 0 <= y <= area.length):
        raise UserError(
            f"{option} {text!r}: outside the area [0, {area.width:g}] × [0, {area.length:g}] m;"
            f" --set area.width=… and area.length=… change it{hint and '; '}{hint}"
        )
    return [x, y, *rest]


def _on_plane(option: str, text: str, parts: Sequence[str], form: str, scenario: Scenario) -> tuple[float, float, bool]:
    """x and y, m, of the latitude and longitude that the parts of a text begin with, and whether they are on this side
    of the Earth: the other side projects there too.

    Raises:
        UserError: no such position, or a scenario without a place on Earth.
    """
    frame = LocalFrame.of(scenario)
    if frame is None:
        raise UserError(
            f"{option} {text!r}: the scenario has no place on Earth; water.latitude and water.longitude give it,"
            " the area's south-west corner in degrees"
        )
    if len(parts) != len(form.split(",")):
        unit = ", Z in metres" if "Z" in form else ""
        raise UserError(f"{option} {text!r}: expected {form.replace('X,Y', '22.5101N,114.0203E')}{unit}")
    latitude, longitude = angle(option, text, parts[0], "NS"), angle(option, text, parts[1], "EW")
    x, y = (float(side) for side in frame.to_local(np.array(longitude), np.array(latitude)))
    return x, y, bool(np.cos(np.radians(longitude - frame.longitude)) > 0)


def far_position(field: str, text: str, scenario: Scenario) -> tuple[float, float]:
    """x and y, m, of a latitude and longitude that may lie outside the area, up to `FARTHEST`.

    Raises:
        UserError: it does not, is none, or the scenario has no place on Earth.
    """
    x, y, inside = _on_plane(field, text, text.split(","), "X,Y", scenario)
    if not inside or max(abs(x), abs(y)) > FARTHEST:
        raise UserError(
            f"{field} {text!r}: is {math.hypot(x, y) / 1000:.0f} km from the area's corner; at most"
            f" {FARTHEST / 1000:g} km east and north of it are allowed"
        )
    return x, y


def auv_position(text: str, scenario: Scenario, hint: str = "") -> tuple[float, float, float]:
    """Read X,Y,Z of an AUV in the area and between surface and bed, see `position`.

    Raises:
        UserError: it is not.
    """
    x, y, depth = position("--auv", text, "X,Y,Z", scenario, hint)
    if not 0 < depth <= scenario.area.depth:
        raise UserError(
            f"--auv {text!r}: the depth must be above 0 and at most the water's {scenario.area.depth:g} m;"
            " --set area.depth=… changes it"
        )
    return x, y, depth


def boat_position(text: str, scenario: Scenario) -> tuple[float, float]:
    """Read X,Y of the boat in the area, see `position`.

    Raises:
        UserError: it is not.
    """
    x, y = position("--compare", text, "X,Y", scenario)
    return x, y


def look_geographic(texts: Sequence[str], scenario: Scenario) -> bool:
    """Whether positions without sides, which are metres, look as if they were latitudes and longitudes.

    They do if all could be degrees, lie within half a degree of each other - AUVs that far apart in metres collide -
    and either all have three digits after the point or they lie within half a degree of the area's corner.
    """
    parts = [PLAIN.fullmatch(part) for text in texts for part in text.split(",")[:2]]
    if not texts or len(parts) != 2 * len(texts) or not all(parts):
        return False
    pairs = np.array([float(part[0]) for part in parts if part]).reshape(-1, 2)
    small, large = np.sort(abs(pairs), axis=1).T
    if small.max() > 90 or large.max() > 180 or np.ptp(pairs, axis=0).max() > NEAR:
        return False
    frame = LocalFrame.of(scenario)
    corner = [frame.latitude, frame.longitude] if frame else [np.inf, np.inf]
    here = any(abs(pairs[0] - order).max() <= NEAR for order in (corner, corner[::-1]))
    return here or all(len(part[1] or "") >= FEWEST_DIGITS for part in parts if part)


def coordinates(latitude: float, longitude: float) -> str:
    """Degrees as `position` reads them, to 0.1 m."""
    longitude -= 360 * round(longitude / 360)
    return f"{abs(latitude):.6f}{'NS'[latitude < 0]},{abs(longitude):.6f}{'EW'[longitude < 0]}"
