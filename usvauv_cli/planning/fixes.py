"""A fix in a log, what of a log is no fix, and the numbers and times in it."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

DAY = 86400.0
LATE = 3600.0  # by which a line may be late in a log, s; of use around midnight alone
LARGEST = 1e20  # of any number: its square is finite
NAMED, REASONS = 3, 5  # bad lines and reasons that are named
LONGEST = 12  # characters of a reason that a log gives


class BadLine(Exception):
    """A line is broken, or of a kind that cannot be used; the message says how."""


class NoFix(Exception):
    """A line is as its maker documents it, and what it says is no good fix or position; the message says why."""


class Fix(NamedTuple):
    """A fix in metres, or in degrees with metres to add to it.

    Attributes:
        name: of the beacon.
        time, depth: s and m.
        offset: east and north, m.
        origin: latitude and longitude, degrees.
        from_boat: horizontal distance from the boat, m; not a number where the log does not say.
        ship: the system says that it is the boat itself.
    """

    name: str
    time: float
    depth: float
    offset: tuple[float, float]
    origin: tuple[float, float] | None = None
    from_boat: float = math.nan
    ship: bool = False


@dataclass
class Contents:
    """What is in a log: its fixes, the lines that are bad, how many are left out for which reason, and notes."""

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
        """How many are left out for which reason, in words."""
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
    """A number in a log.

    Raises:
        ValueError: it is none, not finite or beyond all that is measured.
    """
    value = float(text)
    if not abs(value) < LARGEST:
        raise ValueError(text)
    return value


def geographic(latitude: float, longitude: float) -> tuple[float, float]:
    """A latitude and a longitude, degrees.

    Raises:
        BadLine: they are not on the Earth.
        NoFix: both are 0, which receivers without a position write.
    """
    if not (abs(latitude) <= 90 and abs(longitude) <= 360):
        raise BadLine(f"latitude {latitude:g}, longitude {longitude:g}: allowed are ±90 and ±360")
    if latitude == 0 == longitude:
        raise NoFix("at latitude and longitude 0")
    return latitude, longitude


def near(longitude: float, other: float) -> float:
    """A longitude within ±180° of another one, degrees."""
    return other + math.remainder(longitude - other, 360)
