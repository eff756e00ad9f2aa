"""Fixes in a log of sentences, one per line, from USBL systems and of the boat's own position and heading.

$PSIMSSB   Kongsberg Simrad HiPAP and HPR: "NMEA 0183 Sentences", 850-160045/E; Cartesian, relative to the boat
$PSONLLD   Sonardyne Ranger 2: latitude and longitude in decimal degrees
$PTSAG     iXblue GAPS and Posidonia: "GAPS User Guide", MU-GAPS-AN-005; latitude and longitude
USBLLONG   EvoLogics S2C: "AT*" notification; east, north and up relative to the boat
$--GGA     the boat's latitude and longitude, $--HDT its true heading: NMEA 0183
"""

from __future__ import annotations

import math
import re
from bisect import bisect
from collections.abc import Callable, Sequence
from functools import reduce
from itertools import compress
from typing import NamedTuple

import numpy as np

from usvauv.cli.boat_placement.fixes import LONGEST, BadLine, Contents, DayClock, Fix, NoFix, geographic, near, number

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

LONGEST_GAP = 60.0  # between positions of the boat that are interpolated, and from the last one, s
BASE = 10.0  # time that a speed at the end of a series is taken over at least, and holds for at most, s
DRIFT = 10.0  # most that the boat may have gone since its last position, m
FASTEST, JUMP = 20.0, 5.0  # most that it goes, m/s, and beyond that its receiver may err from one to the next, m
BOAT = "$--GGA"  # no name of a beacon has a dollar
LATENCY = 10.0  # after which a fix is logged, from as far down as there is, s
SOON = 5.0  # s since a position within which nothing is said of its age
DEGREE = 111_200.0  # of a meridian, m
LEVER = 100.0  # distance of an AUV at which an error of the heading is a drift, m


class Relative(NamedTuple):
    """A fix relative to the boat, m; `ahead` says that x is to starboard and y ahead, else they are east and north.

    `said`: time of the sentence by the system's own clock, s, if that is no time of day: then `time` is by it too.
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
    """The heading of the boat, radians clockwise from north."""

    angle: float


Sentence = Relative | Geographic | Boat | Heading


def parse(line: str) -> Sentence | None:
    """Contents of a line; None for other sentences. Raises `BadLine` and `NoFix`, see there."""
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
    if not found and kind == "PSIMSSB" and "*" not in line:  # which Kongsberg lets do without
        return _guarded(read, line.split(",")[1:])
    if not found:
        raise BadLine("no checksum")
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


class TimeSeries(NamedTuple):
    """Positions or headings of the boat in time."""

    what: str  # it is, in words
    times: np.ndarray  # (N,), s, in order
    values: np.ndarray  # (N, D), degrees or radians
    metres: tuple[float, ...]  # (D,), that a unit of each moves a fix by

    def at(self, when: np.ndarray, contents: Contents | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Values (M, D) at (M,) times, and whether they are known there.

        They are known between two positions at most a minute apart; before the first and after the last for as long as
        to the next one, at most `BASE`, and everywhere for a minute in which the boat moves less than `DRIFT`.
        `contents` receives the number of unknown values, and for how long a position was assumed to hold.
        """
        last = len(self.times) - 1
        after = np.searchsorted(self.times, when, side="right")
        before, after = np.clip(after - 1, 0, last), np.clip(after, 0, last)
        nearest = np.where(when - self.times[before] <= self.times[after] - when, before, after)
        inside = before < after
        head = np.searchsorted(self.times, self.times[0] + BASE).clip(max=last)
        tail = np.searchsorted(self.times, self.times[-1] - BASE, side="right").clip(1) - 1
        end = np.where(after == 0, head, tail)
        other = np.where(inside, before + after - nearest, end)
        beside = np.where(inside, other, np.where(after == 0, min(1, last), max(last - 1, 0)))
        span, age = self.times[other] - self.times[nearest], when - self.times[nearest]
        slope = (self.values[other] - self.values[nearest]) / np.where(span, span, np.inf)[:, None]
        interval = abs(self.times[beside] - self.times[nearest])
        sure = (abs(age) <= np.minimum(interval, np.where(inside, LONGEST_GAP, BASE))) & (interval <= LONGEST_GAP)
        drift = abs(age) * np.linalg.norm(slope * self.metres, axis=1)
        known = sure | (abs(age) <= LONGEST_GAP) & (drift <= DRIFT)
        steps = np.linalg.norm(np.diff(self.values, axis=0) * self.metres, axis=1)
        jumps = int((steps > JUMP + FASTEST * np.diff(self.times)).sum())
        if contents and jumps:
            contents.notes.append(f"{self.what} jumps {jumps} times, as if it came from two instruments; keep one")
        if contents and not known.all():
            worst = max(age[~known], key=abs)
            side = "older" if worst > 0 else "later"
            contents.left_out[f"{self.what} is up to {abs(worst):.0f} s {side} than the fix"] += int((~known).sum())
        carried = abs(age)[known & ~sure].max(initial=0.0)
        if contents and carried > SOON:
            contents.notes.append(f"{self.what} is up to {carried:.0f} s from the time of a fix")
        return self.values[nearest] + slope * age[:, None], known


class _Lines:
    """Contents of a log's lines, each with its number, and times that continue after midnight."""

    def __init__(self, lines: Sequence[str], contents: Contents) -> None:
        self.boats: list[tuple[int, Boat]] = []
        self.headings: list[tuple[int, Heading]] = []
        self.relative: list[tuple[int, Relative]] = []
        self.geographic: list[Geographic] = []
        self.lag = -math.inf  # of the time of the day over that of a system with a clock of its own, s
        clock = DayClock()
        for k, line in enumerate(lines, 1):
            try:
                self._add(k, parse(line), clock)
            except BadLine as error:
                contents.bad.append(f"{k}: {error}")
            except NoFix as error:
                contents.left_out[str(error)] += 1

    def _add(self, k: int, said: Sentence | None, clock: DayClock) -> None:
        if isinstance(said, Heading):
            self.headings.append((k, said))
        elif isinstance(said, Boat):
            self.boats.append((k, said._replace(time=clock(said.time, BOAT))))
        elif said is not None and not said.name.strip():
            raise BadLine("a beacon without a name")
        elif isinstance(said, Relative) and said.x == said.y == said.depth == 0:
            raise NoFix("at 0, 0, 0")
        elif isinstance(said, Geographic):
            self.geographic.append(said._replace(time=clock(said.time, said.name)))
        elif said is not None and said.said is None:
            self.relative.append((k, said._replace(time=clock(said.time, said.name))))
        elif said is not None and said.said is not None:
            self.relative.append((k, said))
            if self.boats:
                self.lag = max(self.lag, self.boats[-1][1].time - said.said)

    def _between(self, line: int) -> tuple[float, float]:
        """Times of the positions logged before and after a line, in order; ±∞ where there is none."""
        i = bisect(self.boats, line, key=lambda boat: boat[0])
        times = [boat.time for _, boat in self.boats[max(i - 1, 0) : i + 1]]
        return (min(times) if i else -math.inf, max(times) if i < len(self.boats) else math.inf)

    def shift(self) -> float:
        """By how much the times of fixes are not between those of the positions logged before and after, median, s."""
        between = [(fix.time, *self._between(k)) for k, fix in self.relative if fix.said is None]
        shifts = [
            max(low - time, time - high, 0.0) for time, low, high in between if -math.inf < low and high < math.inf
        ]
        return float(np.median(shifts)) if shifts else 0.0

    def boat_series(self) -> tuple[TimeSeries | None, TimeSeries | None]:
        """Positions and headings of the boat; a heading has the time of its line, between lines that have one."""
        if not self.boats:
            return None, None
        _, boats = zip(*self.boats, strict=True)
        times = np.array([boat.time for boat in boats])
        places = np.array([(boat.latitude, near(boat.longitude, boats[0].longitude)) for boat in boats])
        order = np.argsort(times, kind="stable")
        metres = DEGREE, DEGREE * math.cos(math.radians(boats[0].latitude))
        positions = TimeSeries("the boat's position", times[order], places[order], metres)
        if not self.headings:
            return positions, None
        lines, angles = zip(*self.headings, strict=True)
        timed = [(k, boat.time) for k, boat in self.boats]
        for k, fix in self.relative:  # a fix is logged some time after it is made, and then says nothing of its line
            low, high = self._between(k)
            if fix.said is None and low <= fix.time <= high:
                timed.append((k, fix.time))
        when = np.interp(lines, *np.array(sorted(timed)).T)
        turned = np.unwrap([heading.angle for heading in angles])[:, None]
        order = np.argsort(when, kind="stable")
        return positions, TimeSeries("the boat's heading", when[order], turned[order], (LEVER,))


def read(lines: Sequence[str]) -> Contents:
    """The fixes, what is bad and what is left out of a log of sentences."""
    contents = Contents()
    found = _Lines(lines, contents)
    positions, headings = found.boat_series()
    usable: list[Relative] = []
    for k, fix in found.relative:
        if positions is None or (fix.ahead and headings is None):
            contents.bad.append(f"{k}: a fix relative to the boat, and no ${'--HDT' if positions else '--GGA'}")
        elif fix.said is None:
            usable.append(fix)
        elif found.lag > -math.inf:
            usable.append(fix._replace(time=fix.time + found.lag))
        else:
            contents.bad.append(f"{k}: a fix by a clock of its own, and no $--GGA before it")
    if found.shift() > LATENCY:
        contents.notes.append(
            f"fixes are logged {found.shift():.0f} s off the times of $--GGA beside them: is one not UTC?"
        )
    contents.fixes = [*_geographic(found.geographic, positions), *_relative(usable, positions, headings, contents)]
    return contents


def _geographic(found: Sequence[Geographic], positions: TimeSeries | None) -> list[Fix]:
    apart = np.full(len(found), np.nan)
    if positions and found:
        boats, known = positions.at(np.array([fix.time for fix in found]))
        places = np.array([(fix.latitude, near(fix.longitude, positions.values[0, 1])) for fix in found])
        apart = np.where(known, np.linalg.norm((places - boats) * positions.metres, axis=1), np.nan)
    return [
        Fix(fix.name, fix.time, fix.depth, (0.0, 0.0), (fix.latitude, fix.longitude), float(distance), fix.ship)
        for fix, distance in zip(found, apart, strict=True)
    ]


def _relative(
    found: Sequence[Relative], positions: TimeSeries | None, headings: TimeSeries | None, contents: Contents
) -> list[Fix]:
    if positions is None or not found:
        return []
    when, ahead = np.array([fix.time for fix in found]), np.array([fix.ahead for fix in found])
    boats, known = positions.at(when, contents)
    if not known.any():
        contents.notes.append("the times of fixes and of $--GGA must both be UTC")
    angle = np.zeros(len(found))
    if headings and ahead.any():
        turned, headed = headings.at(when[ahead], contents)
        angle[ahead], known[ahead] = turned[:, 0], known[ahead] & headed
    x, y = np.array([(fix.x, fix.y) for fix in found]).T
    east, north = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
    return [
        Fix(fix.name, fix.time, fix.depth, (float(e), float(n)), (float(at[0]), float(at[1])), math.hypot(fix.x, fix.y))
        for fix, e, n, at in compress(zip(found, east, north, boats, strict=True), known)
    ]
