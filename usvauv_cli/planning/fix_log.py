"""Fixes that a real USBL system made, from CSV or its sentences: where AUVs are by them, and how much they scatter."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from usvauv.cli.planning import sentences
from usvauv.cli.planning.sentences import BadLine, Boat, Geographic, Heading
from usvauv.env import Scenario
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.site import Site
from usvauv.kernels.errors import UserError
from usvauv.kernels.positioning.usbl import UNUSABLE

METRES, DEGREES = ("x", "y"), ("latitude", "longitude")
DAY = 86400.0
NAMED = 3  # bad lines that are named
LARGEST = 2**25  # bytes of a log
LAST = 7  # fixes that give the place; of an AUV that turns, older ones say little about where it is
FEWEST = 4  # fixes of which the scatter is known
NORMAL = 1.4826  # standard deviation over the median of absolute values, of a normal distribution
HUBER = 1.345  # standard deviations from which a fix pulls no more: 95 % efficient for normal errors
ROUNDS = 30


class Fixes(NamedTuple):
    """The fixes of one AUV in the order of the log.

    Attributes:
        name: as in the log.
        time: (N,), s.
        places: (N, 2), x and y in the scenario's area, m.
        depth: (N,), m.
    """

    name: str
    time: np.ndarray
    places: np.ndarray
    depth: np.ndarray


class PositionEstimate(NamedTuple):
    """An AUV by its fixes.

    Attributes:
        name: as in the log.
        fixes, used: their number in the log, and that of the last ones, which give the place.
        x, y, depth: at its last fix, m.
        noise: rms of a fix about the AUV's way, horizontally, m, of all fixes in the log; None of fewer than four.
        accuracy: of the place by this scatter, rms, m; None as `noise`.
    """

    name: str
    fixes: int
    used: int
    x: float
    y: float
    depth: float
    noise: float | None
    accuracy: float | None


class _Fix(NamedTuple):
    """A fix in metres, or in degrees with metres to add to it."""

    name: str
    time: float
    depth: float
    offset: tuple[float, float]
    origin: tuple[float, float] | None = None  # latitude, longitude


def auvs_of_log(path: Path, scenario: Scenario) -> tuple[list[PositionEstimate], Scenario, list[str]]:
    """The AUVs in a log, the scenario with a place on Earth where the log has one, and a line about bad lines.

    Raises:
        UserError: as `read_log`, or an AUV is not in the scenario's water.
    """
    fixes, scenario, bad = read_log(path, scenario)
    found, area = [estimate(each) for each in fixes], scenario.area
    for auv in found:
        if not (0 <= auv.x <= area.width and 0 <= auv.y <= area.length and 0 < auv.depth <= area.depth):
            raise UserError(
                f"--log {path}: AUV {auv.name!r} is at x = {auv.x:.1f} m, y = {auv.y:.1f} m, depth {auv.depth:.1f} m,"
                f" outside the area [0, {area.width:g}] × [0, {area.length:g}] m of depth {area.depth:g} m;"
                " --set area.width=…, area.length=… and area.depth=… change it"
            )
    return found, scenario, bad


def read_log(path: Path, scenario: Scenario) -> tuple[list[Fixes], Scenario, list[str]]:
    """The fixes in a log by AUV, the scenario with a place on Earth, and one line about lines that are bad.

    Where the log has degrees and the scenario no place on Earth, its area is laid around the middle of the fixes.

    Raises:
        UserError: the file cannot be read, or has no fix.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise UserError(f"--log {path}: larger than {LARGEST // 2**20} MiB")
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise UserError(f"--log {path}: cannot be read: {error.strerror}") from None
    bad: list[str] = []
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    try:
        found = list(_rows(header, lines, bad) if "time" in header else _sentences(lines, bad))
    except UserError as error:
        raise UserError(f"--log {path}: {error}") from None
    if not found:
        reason = f"; line {bad[0]}" if bad else ""
        raise UserError(f"--log {path}: no fix in it: expected CSV with a header or sentences of a USBL system{reason}")
    scenario = _placed(found, scenario)
    frame = Site(scenario).frame
    by_name: dict[str, list[_Fix]] = {}
    for fix in found:
        by_name.setdefault(fix.name, []).append(fix)
    fixes = [
        Fixes(
            name,
            _unwrapped(np.array([fix.time for fix in own])),
            np.array([_place(fix, frame) for fix in own]),
            np.array([fix.depth for fix in own]),
        )
        for name, own in by_name.items()
    ]
    return fixes, scenario, [_about(path, bad)] if bad else []


def _rows(header: list[str], lines: list[str], bad: list[str]) -> Iterator[_Fix]:
    """Fixes of CSV: time, auv, depth and x, y or latitude, longitude; world and flags as `usvauv export` has."""
    where = METRES if set(METRES) <= set(header) else DEGREES
    missing = [name for name in ("auv", *where, "depth") if name not in header]
    if missing:
        needed = "time, auv, depth and x, y or latitude, longitude"
        raise UserError(f"no column {', '.join(missing)}; it needs {needed}")
    worlds = set()
    for number, row in enumerate(csv.DictReader(lines[1:], header), 2):
        try:
            first, second, time, depth = (_finite(row[name]) for name in (*where, "time", "depth"))
            flags = int(row.get("flags") or 0)
        except (TypeError, ValueError):
            bad.append(f"{number}: a number is missing or none")
            continue
        worlds.add(row.get("world"))
        if len(worlds) > 1:
            raise UserError("fixes of several episodes, see its column world; keep one")
        if flags & UNUSABLE:
            continue
        if where is METRES:
            yield _Fix(row["auv"], time, depth, (first, second))
        else:
            yield _Fix(row["auv"], time, depth, (0.0, 0.0), (first, second))


def _sentences(lines: list[str], bad: list[str]) -> Iterator[_Fix]:
    boat, heading = None, None
    for number, line in enumerate(lines, 1):
        try:
            said = sentences.parse(line)
            if isinstance(said, Boat):
                boat = said
            elif isinstance(said, Heading):
                heading = said.angle
            elif isinstance(said, Geographic):
                yield _Fix(said.name, said.time, said.depth, (0.0, 0.0), (said.latitude, said.longitude))
            elif said is not None:
                if boat is None or (said.ahead and heading is None):
                    raise BadLine(f"a fix relative to the boat, and no ${'--HDT' if boat else '--GGA'} before it")
                offset = said.x, said.y
                if said.ahead:
                    sin, cos = math.sin(heading or 0.0), math.cos(heading or 0.0)
                    offset = cos * said.x + sin * said.y, cos * said.y - sin * said.x
                yield _Fix(said.name, said.time, said.depth, offset, (boat.latitude, boat.longitude))
        except BadLine as error:
            bad.append(f"{number}: {error}")


def _placed(fixes: Iterable[_Fix], scenario: Scenario) -> Scenario:
    """The scenario; if it needs a place on Earth and has none, with its area around the middle of the fixes."""
    origins = np.array([fix.origin for fix in fixes if fix.origin])
    if not len(origins) or Site(scenario).frame:
        return scenario
    latitude, longitude = np.median(origins, axis=0)
    area = scenario.area
    corner = LocalFrame(longitude, latitude).to_geographic(np.array(-area.width / 2), np.array(-area.length / 2))
    place = {"longitude": float(corner[0]), "latitude": float(corner[1])}
    return scenario.model_copy(update={"water": scenario.water.model_copy(update=place)})


def _place(fix: _Fix, frame: LocalFrame | None) -> tuple[float, float]:
    if fix.origin is None or frame is None:
        return fix.offset
    x, y = frame.to_local(np.array(fix.origin[1]), np.array(fix.origin[0]))
    return float(x) + fix.offset[0], float(y) + fix.offset[1]


def _unwrapped(time: np.ndarray) -> np.ndarray:
    """Times that go on after midnight."""
    return time + DAY * np.cumsum(np.diff(time, prepend=time[:1]) < -DAY / 2)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _about(path: Path, bad: list[str]) -> str:
    more = f" and {len(bad) - NAMED} more" if len(bad) > NAMED else ""
    lines = "line" if len(bad) == 1 else "lines"
    return f"--log {path}: {len(bad)} bad {lines} left out: {'; '.join(bad[:NAMED])}{more}"


def estimate(fixes: Fixes) -> PositionEstimate:
    """Place and scatter of an AUV that runs straight between one fix and the one after the next.

    Of a fix and its two neighbours, the middle one less the line through the others has the variance σ² (1 + a² + b²),
    a and b the weights of the two. σ is the median of its absolute values, scaled. The place is that of a line through
    the last seven fixes at the time of the last one, by Huber's M-estimator (Ann. Math. Statist. 35, 1964, doi
    10.1214/aoms/1177703732), which begins with the line of the median slope (P. K. Sen, J. Am. Stat. Assoc. 63, 1968,
    doi 10.1080/01621459.1968.10480934).
    """
    order = np.argsort(fixes.time, kind="stable")
    time, places, depth = fixes.time[order], fixes.places[order], fixes.depth[order]
    age, near, sigma = time[-LAST:] - time[-1], places[-LAST:], _scatter(time, places)
    place, variance = np.median(near, axis=0), np.zeros(2)
    for axis in (0, 1):
        if sigma is not None and age[0] < 0:
            place[axis], variance[axis] = _line_now(age, near[:, axis], sigma[axis])
    return PositionEstimate(
        name=fixes.name,
        fixes=len(time),
        used=len(near),
        x=float(place[0]),
        y=float(place[1]),
        depth=float(np.median(depth[-LAST:])),
        noise=float(np.hypot(*sigma)) if sigma is not None else None,
        accuracy=float(np.sqrt(variance.sum())) if sigma is not None else None,
    )


def _scatter(time: np.ndarray, places: np.ndarray) -> np.ndarray | None:
    """Standard deviation (2,) along x and y of the error of a fix, m; None of too few fixes."""
    step = time[2:] - time[:-2]
    useful = step > 0
    if useful.sum() < FEWEST - 2:
        return None
    later = ((time[1:-1] - time[:-2])[useful] / step[useful])[:, None]
    residual = places[1:-1][useful] - (1 - later) * places[:-2][useful] - later * places[2:][useful]
    residual /= np.sqrt(1 + later**2 + (1 - later) ** 2)
    return np.maximum(NORMAL * np.median(abs(residual), axis=0), 1e-6)


def _line_now(age: np.ndarray, values: np.ndarray, sigma: float) -> tuple[float, float]:
    """Where a line through values (N,) at ages (N,), not all the same, stands at age 0; and the variance of that."""
    first, second = np.triu_indices(len(age), 1)
    apart = age[second] > age[first]
    slope = np.median((values[second] - values[first])[apart] / (age[second] - age[first])[apart])
    line = np.array([np.median(values - slope * age), slope])
    columns = np.stack([np.ones_like(age), age], axis=-1)
    for _ in range(ROUNDS):
        weight = 1 / np.maximum(abs(values - columns @ line) / (HUBER * sigma), 1.0)
        information = columns.T @ (weight[:, None] * columns)
        line = np.linalg.solve(information, columns.T @ (weight * values))
    return float(line[0]), sigma**2 * float(np.linalg.inv(information)[0, 0])
