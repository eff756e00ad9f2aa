"""Positions that a user gives: in metres, or by latitude and longitude where the area has a place on the Earth."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from usvauv.env.scenario.fields import FARTHEST
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.site.site import Site
from usvauv.kernels.errors import UserError

# 60,80 are metres, 22.5101N,114.0203E degrees, which may have minutes and seconds of arc: 22°30.5'N or 22°30'30"N.
ANGLE = re.compile(r"(\d+(?:\.\d+)?)°?(?:(\d+(?:\.\d+)?)['′’](?:(\d+(?:\.\d+)?)[\"″”])?)?([NSEW])")
SIDED = re.compile(r"°|[\d.'′’\"″”]\s*[NSEW]\s*$", re.IGNORECASE)
PLAIN = re.compile(r"\s*-?\d+(?:\.(\d+))?\s*")
FEWEST_DIGITS = 3  # after the point; 0.001° are some 100 m
NEAR = 0.5  # degrees, further than any area reaches; AUVs in metres are farther apart
DEGREES = "metres are expected and these look like degrees, which have a side: 22.5101N,114.0203E"


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
    frame = Site(scenario).frame
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
    frame = Site(scenario).frame
    corner = [frame.latitude, frame.longitude] if frame else [np.inf, np.inf]
    here = any(abs(pairs[0] - order).max() <= NEAR for order in (corner, corner[::-1]))
    return here or all(len(part[1] or "") >= FEWEST_DIGITS for part in parts if part)


def coordinates(latitude: float, longitude: float) -> str:
    """Degrees as `position` reads them, to 0.1 m."""
    longitude -= 360 * round(longitude / 360)
    return f"{abs(latitude):.6f}{'NS'[latitude < 0]},{abs(longitude):.6f}{'EW'[longitude < 0]}"
