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

from usvauv.cli.planning.fixes import LONGEST, BadLine, NoFix, geographic, number

CHECKED = re.compile(r"\$(?P<body>.+)\*(?P<sum>[0-9A-Fa-f]{2})(?!\w)")  # a logger may write on
EVOLOGICS = re.compile(r"USBLLONG,(?P<body>.+)$")
TIME = re.compile(r"([01]\d|2[0-3])([0-5]\d)([0-5]\d(?:\.\d*)?|60(?:\.\d*)?)", re.ASCII)
ANGLE = re.compile(r"(\d{1,3})([0-5]\d(?:\.\d*)?)", re.ASCII)
XY = {"N": (1, 0), "E": (0, 1)}  # which of the two numbers of $PSIMSSB points east, and which north
PREDICTED = "P"
# $PTSAG: identifier of the ship, hydrophones of four that make a position, whence the depth is
SHIP, HYDROPHONES, CALCULATED, BY_SENSOR, NO_SENSOR = 0, 3, "1", "2", 9999
WEAK = 100  # EvoLogics: integrity of the signal below which a link is weak
MEASURED = {"1", "2", "3", "4", "5", "9"}  # qualities of $--GGA; 0 none, 6 estimated, 7 by hand, 8 simulated


class Relative(NamedTuple):
    """A fix relative to the boat, m; `ahead` says that x is to starboard and y ahead, else they are east and north.

    `said`: when it was said by the system's own clock, s, if that is no time of the day: then `time` is by it too.
    """

    time: float
    name: str
    x: float
    y: float
    depth: float
    ahead: bool = False
    said: float | None = None


class Geographic(NamedTuple):
    """A fix in degrees; `ship` says that it is of the boat itself."""

    time: float
    name: str
    latitude: float
    longitude: float
    depth: float
    ship: bool = False


class Boat(NamedTuple):
    """Where the boat is, degrees, at a time of the day, s."""

    time: float
    latitude: float
    longitude: float


class Heading(NamedTuple):
    """Of the boat, radians clockwise from north."""

    angle: float


Sentence = Relative | Geographic | Boat | Heading


def parse(line: str) -> Sentence | None:
    """What a line says; None for other sentences.

    Raises:
        BadLine, NoFix: see there.
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
        return _guarded(read, line.split(",")[1:])
    sums = [
        reduce(lambda total, byte: total ^ byte, found["body"].encode(encoding, "replace"), 0)
        for encoding in ("utf-8", "cp1252")
    ]
    if int(found["sum"], 16) not in sums:
        raise BadLine(f"checksum {found['sum']}, the sentence has {sums[0]:02X}")
    return _guarded(read, found["body"].split(",")[1:])


def _guarded(read: Callable[[list[str]], Sentence], fields: list[str]) -> Sentence:
    try:
        return read([field.strip() for field in fields])
    except (IndexError, ValueError):
        raise BadLine("a field is missing or not as documented") from None


def _kongsberg(fields: list[str]) -> Relative:
    # The field after the depth shows that a sentence without a checksum is not cut in the depth.
    time, name, status, error, system, orientation, source, first, second, depth, _ = fields[:11]
    if error:
        raise NoFix(f"error code {error[:LONGEST]!r}")
    _need_valid(status)
    if source == PREDICTED:
        raise NoFix("predicted, not measured")
    if system != "C" or orientation not in ("H", "N", "E"):
        raise BadLine(f"coordinates {system}, orientation {orientation}: C with H, N or E is read")
    numbers = number(first), number(second)
    east, north = (numbers[i] for i in XY.get(orientation, (0, 1)))
    return Relative(_time(time), name, east, north, number(depth), orientation == "H")


def _sonardyne(fields: list[str]) -> Geographic:
    time, name, status, latitude, longitude, depth = fields[:6]
    _need_valid(status)
    return Geographic(_time(time), name, *geographic(number(latitude), number(longitude)), number(depth))


def _ixblue(fields: list[str]) -> Geographic:
    _, time, _, _, _, name, latitude, north, longitude, east, valid, calculated, by, sensor = fields[:14]
    if int(name) < SHIP:
        raise NoFix("unknown transponder")
    if int(valid, 16).bit_count() < HYDROPHONES:
        raise NoFix(f"position validity {valid[:LONGEST]!r}")
    depth = number(sensor if by == BY_SENSOR else calculated)
    if by not in (CALCULATED, BY_SENSOR) or depth == NO_SENSOR:
        raise NoFix(f"depth validity {by[:LONGEST]!r}, depth {depth:g}")
    place = geographic(_degrees(latitude, north, "NS"), _degrees(longitude, east, "EW"))
    return Geographic(_time(time), name, *place, depth, int(name) == SHIP)


def _evologics(fields: list[str]) -> Relative:
    said, time, name, _, _, _, east, north, up, _, _, _, _, _, integrity, accuracy = fields[:16]
    if number(accuracy) < 0:
        raise NoFix("accuracy below 0")
    if number(integrity) < WEAK:
        raise NoFix(f"integrity below {WEAK}")
    return Relative(number(time), name, number(east), number(north), -number(up), said=number(said))


def _gga(fields: list[str]) -> Boat:
    time, latitude, north, longitude, east, quality = fields[:6]
    if quality not in MEASURED:
        raise NoFix(f"boat's position of quality {quality[:LONGEST]!r}")
    return Boat(_time(time), *geographic(_degrees(latitude, north, "NS"), _degrees(longitude, east, "EW")))


def _hdt(fields: list[str]) -> Heading:
    angle = number(fields[0])
    if not 0 <= angle <= 360:
        raise BadLine(f"heading {angle:g}: allowed is 0 to 360")
    return Heading(math.radians(angle))


READERS = {"PSIMSSB": _kongsberg, "PSONLLD": _sonardyne, "PTSAG": _ixblue, "GGA": _gga, "HDT": _hdt}


def _need_valid(status: str) -> None:
    if status != "A":
        raise NoFix(f"status {status[:LONGEST]!r}")


def _time(text: str) -> float:
    """Seconds of the day of hhmmss.ss."""
    found = TIME.fullmatch(text)
    if not found:
        raise ValueError(text)
    hours, minutes, seconds = found.groups()
    return 3600 * int(hours) + 60 * int(minutes) + float(seconds)


def _degrees(text: str, side: str, sides: str) -> float:
    """Degrees of DDMM.MMMM or DDDMM.MMMM and a side."""
    found = ANGLE.fullmatch(text)
    if not found:
        raise ValueError(text)
    value = int(found[1]) + float(found[2]) / 60
    return (value, -value)[sides.index(side)]
