"""Sentences of USBL systems, one a line, and those of the boat's own position and heading.

$PSIMSSB   Kongsberg Simrad HiPAP and HPR: "NMEA 0183 Sentences", 850-160045/E; Cartesian, relative to the boat
$PSONLLD   Sonardyne Ranger 2: latitude and longitude in decimal degrees
$PTSAG     iXblue GAPS and Posidonia: "GAPS User Guide", MU-GAPS-AN-005; latitude and longitude
USBLLONG   EvoLogics S2C: "AT*" notification; east, north and up relative to the boat
$--GGA     the boat's latitude and longitude, $--HDT its true heading: NMEA 0183
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import reduce
from typing import NamedTuple

CHECKED = re.compile(r"\$(?P<body>[^*$]+)\*(?P<sum>[0-9A-Fa-f]{2})\s*$")
EVOLOGICS = re.compile(r"USBLLONG,(?P<body>.+)$")
XY = {"N": (1, 0), "E": (0, 1)}  # which of the two numbers of $PSIMSSB points east, and which north
VALID_POSITION, BY_SENSOR = "F", "2"  # $PTSAG


class BadLine(Exception):
    """A line is a sentence that is read here, and broken or of a kind that cannot be used; the message says how."""


class Relative(NamedTuple):
    """A fix relative to the boat, m; `ahead` says that x is to starboard and y ahead, else they are east and north."""

    time: float
    name: str
    x: float
    y: float
    depth: float
    ahead: bool = False


class Geographic(NamedTuple):
    """A fix in degrees."""

    time: float
    name: str
    latitude: float
    longitude: float
    depth: float


class Boat(NamedTuple):
    """Where the boat is, degrees."""

    latitude: float
    longitude: float


class Heading(NamedTuple):
    """Of the boat, radians clockwise from north."""

    angle: float


Sentence = Relative | Geographic | Boat | Heading


def parse(line: str) -> Sentence | None:
    """What a line says; None for other sentences and for fixes that the system itself calls invalid.

    Raises:
        BadLine: see there.
    """
    own = EVOLOGICS.search(line)
    if own:
        return _guarded(_evologics, own["body"].split(","))
    if "$" not in line:
        return None
    kind, *_ = line[line.index("$") + 1 :].split(",", 1)
    read = READERS.get(kind) or READERS.get(kind[-3:] if len(kind) == 5 else "")
    if read is None:
        return None
    found = CHECKED.search(line)
    if not found and (kind != "PSIMSSB" or "*" in line):  # which Kongsberg lets do without
        raise BadLine("no checksum")
    if not found:
        return _guarded(read, line.strip().split(",")[1:])
    expected = reduce(lambda total, character: total ^ ord(character), found["body"], 0)
    if expected != int(found["sum"], 16):
        raise BadLine(f"checksum {found['sum']}, the sentence has {expected:02X}")
    return _guarded(read, found["body"].split(",")[1:])


def _guarded(read: Callable[[list[str]], Sentence | None], fields: list[str]) -> Sentence | None:
    try:
        return read(fields)
    except (IndexError, ValueError):
        raise BadLine("a field is missing or not as documented") from None


def _kongsberg(fields: list[str]) -> Relative | None:
    time, name, status, _, system, orientation, _, first, second, depth = fields[:10]
    if status != "A":
        return None
    if system != "C" or orientation not in "HNE":
        raise BadLine(f"coordinates {system}, orientation {orientation}: C with H, N or E is read")
    numbers = _number(first), _number(second)
    east, north = (numbers[i] for i in XY.get(orientation, (0, 1)))
    return Relative(_time(time), name, east, north, _number(depth), orientation == "H")


def _sonardyne(fields: list[str]) -> Geographic | None:
    time, name, status, latitude, longitude, depth = fields[:6]
    if status != "A":
        return None
    return Geographic(_time(time), name, _number(latitude), _number(longitude), _number(depth))


def _ixblue(fields: list[str]) -> Geographic | None:
    _, time, _, _, _, name, latitude, north, longitude, east, valid, calculated, by, sensor = fields[:14]
    if valid != VALID_POSITION:
        return None
    depth = sensor if by == BY_SENSOR else calculated
    return Geographic(
        _time(time), name, _degrees(latitude, north, "NS"), _degrees(longitude, east, "EW"), _number(depth)
    )


def _evologics(fields: list[str]) -> Relative:
    east, north, up = map(_number, fields[6:9])
    return Relative(_number(fields[1]), fields[2], east, north, -up)


def _gga(fields: list[str]) -> Boat | None:
    _, latitude, north, longitude, east, quality = fields[:6]
    return None if quality == "0" else Boat(_degrees(latitude, north, "NS"), _degrees(longitude, east, "EW"))


def _hdt(fields: list[str]) -> Heading:
    return Heading(math.radians(_number(fields[0])))


READERS = {"PSIMSSB": _kongsberg, "PSONLLD": _sonardyne, "PTSAG": _ixblue, "GGA": _gga, "HDT": _hdt}


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _time(text: str) -> float:
    """Seconds of the day of hhmmss.ss."""
    return 3600 * int(text[:2]) + 60 * int(text[2:4]) + _number(text[4:])


def _degrees(text: str, side: str, sides: str) -> float:
    """Degrees of DDMM.MMMM or DDDMM.MMMM and a side."""
    whole = text.index(".") - 2
    value = int(text[:whole]) + _number(text[whole:]) / 60
    return value if sides.index(side) == 0 else -value
