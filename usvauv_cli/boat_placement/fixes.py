"""A fix in a log, lines without a fix, and logs that are tables, as programs and spreadsheets write CSV."""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import NamedTuple

from usvauv.kernels.errors import UserError
from usvauv.kernels.positioning.usbl import UNUSABLE

DAY = 86400.0
LATE = 3600.0  # by which a line may be late in a log, s; of use around midnight alone
LARGEST = 1e20  # of any number: its square is finite
NAMED, REASONS = 3, 5  # bad lines and reasons that are named
LONGEST = 12  # characters of a reason that a log gives

METRES, DEGREES = ("x", "y"), ("latitude", "longitude")
COLUMNS = ("time", "auv", *METRES, *DEGREES, "depth", "flags", "world")
SHORT = {"lat": "latitude", "lon": "longitude", "long": "longitude", "lng": "longitude"}
NEEDED = "time, auv, depth and x, y or latitude, longitude, in s or ISO 8601, m and degrees"
SEPARATORS = ",;\t "
PREAMBLE = 20  # lines among which the header is
FEWEST = 3  # columns by which a line is known as a header
UNIT = re.compile(r"[\s._]*[(\[{]\s*(°|[^\W\d_]+)[^)\]}]*[)\]}]?\W*$|[\s._]+(°|[^\W\d_]+)\W*$")
SECONDS = {"s", "sec", "secs", "second", "seconds", "utc", "unix", "epoch"}
LENGTHS = {"m", "meter", "meters", "metre", "metres"}
ANGLES = {"°", "deg", "degree", "degrees", "decimal", "wgs", "n", "e"}
UNITS = {"time": SECONDS, "depth": LENGTHS} | dict.fromkeys(METRES, LENGTHS) | dict.fromkeys(DEGREES, ANGLES)
COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
SHOWN = 20  # characters of a value that is named


class BadLine(Exception):
    """A line is damaged, or of a kind that cannot be used; the message has the reason."""


class NoFix(Exception):
    """A line has the documented form, but contains no usable fix or position; the message has the reason."""


class Fix(NamedTuple):
    """A fix in metres, or in degrees with metres to add to it."""

    name: str  # of the beacon
    time: float  # s
    depth: float  # m
    offset: tuple[float, float]  # east and north, m
    origin: tuple[float, float] | None = None  # latitude and longitude, degrees
    from_boat: float = math.nan  # horizontal distance, m; NaN where the log does not say
    ship: bool = False  # the system says that it is the boat itself


@dataclass
class Contents:
    """Contents of a log: its fixes, bad lines, numbers of fixes left out for each reason, and notes."""

    fixes: list[Fix] = field(default_factory=list)
    bad: list[str] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    def warnings(self) -> list[str]:
        """A line about bad lines, one about what is left out, and the notes; each only where there is any."""
        lines = []
        if self.bad:
            more = f" and {len(self.bad) - NAMED} more" if len(self.bad) > NAMED else ""
            noun = "line" if len(self.bad) == 1 else "lines"
            lines.append(f"{len(self.bad)} bad {noun} left out: {'; '.join(self.bad[:NAMED])}{more}")
        if self.left_out:
            lines.append(f"left out: {self.reasons()}")
        return lines + self.notes

    def reasons(self) -> str:
        """Numbers of fixes left out for each reason, in words."""
        most = self.left_out.most_common()
        rest = sum(count for _, count in most[REASONS:])
        return "; ".join([f"{count} × {reason}" for reason, count in most[:REASONS]] + [f"{rest} others"] * bool(rest))


class DayClock:
    """Times of the day that go on after midnight, also where lines are up to an hour late."""

    def __init__(self) -> None:
        self.latest: float | None = None
        self.own: dict[str, float] = {}  # the latest of each source

    def __call__(self, time: float, source: str) -> float:
        """Seconds, from the midnight before the first line on, of a time of the day in the next line.

        What would be more than an hour late of one source, which is named, is of the next day.
        """
        if self.latest is not None:
            step = time - self.latest % DAY
            time = self.latest + step + DAY * (int(step < -DAY / 2) - int(step > DAY - LATE))
        last = self.own.get(source, time)
        time += DAY * (time < last - LATE)
        self.own[source] = max(time, last)
        self.latest = time if self.latest is None else max(self.latest, time)
        return time


def number(text: str) -> float:
    """A number in a log; ValueError where it is none, not finite or beyond all that is measured."""
    value = float(text)
    if not abs(value) < LARGEST:
        raise ValueError(text)
    return value


def geographic(latitude: float, longitude: float) -> tuple[float, float]:
    """A latitude and a longitude, degrees; `NoFix` where both are 0, which receivers without a position write."""
    if not (abs(latitude) <= 90 and abs(longitude) <= 360):
        raise BadLine(f"latitude {latitude:g}, longitude {longitude:g}: allowed are ±90 and ±360")
    if latitude == 0 == longitude:
        raise NoFix("at latitude and longitude 0")
    return latitude, longitude


def near(longitude: float, other: float) -> float:
    """A longitude within ±180° of another one, degrees."""
    return other + math.remainder(longitude - other, 360)


def read_table(lines: Sequence[str]) -> Contents | None:
    """The fixes, what is bad and what is left out of a table; None if it is none.

    Lines before the header are passed over. Its columns may be quoted, in capitals and with units; they are separated
    by commas, semicolons, tabs or spaces. A first column without a heading, as of R's row names, is passed over.

    Raises:
        UserError: a column is missing or there twice, a number has a decimal comma, times are written in several ways,
            or the fixes are of several worlds.
    """
    headers = (
        (start, separator, _header(line, separator))
        for start, line in enumerate(lines[:PREAMBLE])
        for separator in SEPARATORS
    )
    found = next((each for each in headers if len(set(each[2]) & set(COLUMNS)) >= FEWEST), None)
    if found is None:
        return None
    start, separator, header = found
    where = METRES if set(METRES) <= set(header) else DEGREES
    missing = [name for name in ("time", "auv", *where, "depth") if name not in header]
    if missing:
        raise UserError(f"no column {', '.join(missing)}; it needs {NEEDED}")
    twice = [name for name, count in Counter(header).items() if count > 1 and name in COLUMNS]
    if twice:
        raise UserError(f"column {twice[0]} is there twice")
    contents, worlds, ways = Contents(), set[str](), set[str]()
    for k, line in enumerate(lines[start + 1 :], start + 2):
        if not line.strip(SEPARATORS):
            continue
        try:
            cells = _cells(line, separator)
            if k == start + 2 and len(cells) == len(header) + 1 and cells[0] == "1" and line.lstrip()[0] == '"':
                header.insert(0, "")
            while len(cells) > len(header) and not cells[-1]:
                cells.pop()
            if len(cells) != len(header):
                raise BadLine(f"{len(cells)} fields, the header has {len(header)}")
            row = dict(zip(header, cells, strict=True))
            worlds.add(row.get("world", ""))
            time, way = _time(row["time"])
            ways.add(way)
            if len(ways) > 1:
                raise UserError(f"time {_shown(row['time'])} is {way}, those before are {(ways - {way}).pop()}")
            contents.fixes.append(_fix(row, where, time))
        except BadLine as error:
            contents.bad.append(f"{k}: {error}")
        except NoFix as error:
            contents.left_out[str(error)] += 1
        except UserError as error:
            raise UserError(f"line {k}: {error}") from None
        if len(worlds) > 1:
            raise UserError("fixes of several episodes, see its column world; keep one")
    return contents


def _cells(line: str, separator: str) -> list[str]:
    """The fields of a line; `BadLine` where one is longer than 131,072 characters."""
    try:
        row = next(csv.reader([line.strip(" ")], delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise BadLine(str(error)) from None
    return [cell.strip() for cell in row]


def _header(line: str, separator: str) -> list[str]:
    """The columns that the headings of a line name, without capitals and units; none if it cannot be a header."""
    try:
        names = [name.casefold() for name in _cells(line.lstrip("#% "), separator)]  # NumPy, MATLAB
    except BadLine:
        return []
    while names and not names[-1]:
        names.pop()
    plain = [_plain(name) for name in names]
    return [name if name in COLUMNS or short in names else short for name, short in zip(names, plain, strict=True)]


def _plain(name: str) -> str:
    """A heading without its unit, and the short name in full; as it is, where its column has other units."""
    unit = UNIT.search(name)
    plain = (name[: unit.start()] if unit else name).strip(" ._")
    plain = SHORT.get(plain, plain)
    return name if unit and (unit[1] or unit[2]) not in UNITS.get(plain, {unit[1]}) else plain


def _fix(row: dict[str, str], where: tuple[str, str], time: float) -> Fix:
    first, second, depth = (_number(name, row[name]) for name in (*where, "depth"))
    if int(_number("flags", row.get("flags") or "0")) & UNUSABLE:
        raise NoFix("not usable by its flags")
    if not row["auv"]:
        raise BadLine("no name of an AUV")
    if where == METRES:
        return Fix(row["auv"], time, depth, (first, second))
    return Fix(row["auv"], time, depth, (0.0, 0.0), geographic(first, second))


def _time(text: str) -> tuple[float, str]:
    """Seconds of a number, of a time of the day or, from 1970 on, of a date with one (ISO 8601), and which it is."""
    with suppress(BadLine):
        return _number("time", text), "a number"
    for what, day in ("a date", ""), ("a time of the day", "1970-01-01T"):
        with suppress(ValueError):
            if ":" not in text and "T" not in text:
                break  # a date alone
            moment = datetime.fromisoformat(day + text)
            seconds = moment.replace(tzinfo=moment.tzinfo or UTC).timestamp()
            zone = "with" if moment.tzinfo else "without"
            return seconds % DAY if day else seconds, f"{what} {zone} an offset from UTC"
    raise BadLine(f"time {_shown(text)} is neither s nor like 2026-05-01T12:00:00Z")


def _number(name: str, text: str) -> float:
    try:
        return number(text)
    except ValueError:
        value = _shown(text)
    if COMMA.fullmatch(text):
        raise UserError(f"{name} {value} has a decimal comma; numbers have a decimal point")
    raise BadLine(f"{name} {value} is not a number of at most {LARGEST:g}")


def _shown(text: str) -> str:
    return repr(text if len(text) <= SHOWN else text[:SHOWN] + "…")
