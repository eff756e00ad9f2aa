"""Fixes of a real USBL system, from CSV or its sentences: the AUVs' positions, and the scatter of the fixes."""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from usvauv.cli.boat_placement import ship_log
from usvauv.cli.boat_placement.fixes import DAY, LATE, NEEDED, Contents, Fix, near, read_table
from usvauv.env.scenario import Scenario
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.site import Site
from usvauv.kernels.errors import UserError
from usvauv.kernels.limits import MAX_AUVS

LARGEST = 2**25  # bytes of a log
SHIP = re.compile(
    r"(?<![^\W_])((own|mother|support|survey)?(ship|vessel|boat)|[rm]/?v|usv|asv)(?![^\W\d_])", re.IGNORECASE
)
SURFACE = 1.0  # depth above which a beacon is at the surface, m
BESIDE, DRAUGHT = 3.0, 10.0  # distance from the boat's position, and depth, within which a beacon is its own, m
LAST = 7  # fixes that give the place; of an AUV that turns, older ones say little about where it is
FEWEST = 4  # fixes of which the scatter is known
NORMAL = 1.4826  # standard deviation over the median of absolute values, of a normal distribution
HUBER = 1.345  # standard deviations from which a fix pulls no more: 95 % efficient for normal errors
LIGHTEST = 1e-9  # weight of a fix, that the line through all stays defined
INSTANT = 1e-6  # between fixes that are of one time, s
ROUNDS = 30
TURNING_TIME = 60.0  # s, correlation time of an AUV's velocity: some minutes are from node to node, or along a line


class Fixes(NamedTuple):
    """The fixes of one AUV in the order of the log."""

    name: str  # as in the log
    time: np.ndarray  # (N,), s
    places: np.ndarray  # (N, 2), x and y in the scenario's area, m
    depth: np.ndarray  # (N,), m


class Log(NamedTuple):
    """A log that was read."""

    fixes: list[Fixes]
    end: float  # time of the last fix in the log, of any beacon, s: the present
    scenario: Scenario  # with a place on Earth where the log has one
    left_out: dict[str, int]  # how many fixes and positions for which reason
    warnings: list[str]  # about bad lines, what is left out, and ages


class PositionEstimate(NamedTuple):
    """An AUV by its fixes; x, y and depth are at its last one, m."""

    name: str  # as in the log
    fixes: int  # their number in the log
    used: int  # number of the last ones, which give the place
    x: float
    y: float
    depth: float
    noise: float | None  # rms of a fix about the AUV's way, horizontally, m, of all fixes; None of fewer than four
    accuracy: float | None  # of the place by this scatter, rms, m; None as `noise`
    age: float  # of the last fix at the end of the log, s
    uncertainty: float  # horizontal rms of the error of the place as the AUV's present one, m


def auvs_of_log(path: Path, scenario: Scenario, beacons: Sequence[str] = ()) -> tuple[list[PositionEstimate], Log]:
    """The AUVs in a log, which must be in the scenario's water, and the log, see `read_log`.

    An AUV that can have gone so far since its last fix that nothing is known but that it is in the area is left out.

    Raises:
        UserError: an AUV is outside the water, all are left out, or as `read_log`.
    """
    log = read_log(path, scenario, beacons)
    area = scenario.area
    found = [estimate(each, log.end, scenario.auv.speed_max) for each in log.fixes]
    unknown = area.diagonal / math.sqrt(12)  # rms of a place uniform in the area
    lost = [auv for auv in found if auv.uncertainty > unknown]
    found = [auv for auv in found if auv.uncertainty <= unknown]
    if lost:
        names = ", ".join(f"{auv.name[:20]!r} ({auv.age:.0f} s)" for auv in lost)
        speed = f"at up to {scenario.auv.speed_max:g} m/s (auv.speed_max)"
        why = f"last heard so long before the end of the log that {speed} they can be anywhere in the area"
        if not found:
            raise UserError(f"--log {path}: no AUV is left: {names} {why}")
        log.warnings.append(f"--log {path}: left out {names}, {why}")
    for auv in found:
        if not (0 <= auv.x <= area.width and 0 <= auv.y <= area.length and 0 < auv.depth <= area.depth):
            raise UserError(
                f"--log {path}: AUV {auv.name!r} is at x = {auv.x:.1f} m, y = {auv.y:.1f} m, depth {auv.depth:.1f} m,"
                f" outside the area [0, {area.width:g}] × [0, {area.length:g}] m of depth {area.depth:g} m;"
                " --set area.width=…, area.length=… and area.depth=… change it, --beacon picks others"
            )
    return found, log


def read_log(path: Path, scenario: Scenario, beacons: Sequence[str] = ()) -> Log:
    """The fixes in a log by AUV.

    Where the log has degrees and the scenario no place on Earth, its area is laid around the middle of the fixes. The
    ship itself and beacons at the surface are left out, unless picked.

    Args:
        beacons: names of those picked; by default all.

    Raises:
        UserError: the file cannot be read, has no fix of an AUV or of one picked, or more AUVs than a plan can have.
    """
    try:
        lines = _lines(path)
        contents = read_table(lines) or ship_log.read(lines)
        _leave_out_repeated(contents)
        by_name = _of_auvs(contents, beacons)
        scenario = _placed([fix for own in by_name.values() for fix in own], scenario)
        frame = Site(scenario).frame
    except UserError as error:
        raise UserError(f"--log {path}: {error}") from None
    named: dict[str, list[float]] = {}
    for fix in contents.fixes:
        named.setdefault(fix.name, []).append(fix.time)
    end = max(float(_unwrapped(np.array(times)).max()) for times in named.values())
    fixes = []
    for name, own in by_name.items():
        times, places, depths = zip(*((fix.time, _place(fix, frame), fix.depth) for fix in own), strict=True)
        fixes.append(Fixes(name, _unwrapped(np.array(times)), np.array(places), np.array(depths)))
    bad = {"bad line": len(contents.bad)} if contents.bad else {}
    warnings = [f"--log {path}: {line}" for line in contents.warnings()]
    return Log(fixes, end, scenario, {**contents.left_out, **bad}, warnings)


def _lines(path: Path) -> list[str]:
    """The lines of a file in UTF-8, in UTF-16, or for those that are no UTF-8, in Windows' western encoding."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror}") from None
    if len(data) > LARGEST:
        raise UserError(f"larger than {LARGEST // 2**20} MiB")
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        data = data.decode("utf-16", errors="replace").encode("utf-8")
    lines = re.split(rb"\r\n|\r|\n", data.removeprefix(codecs.BOM_UTF8))
    return [_decoded(line) for line in lines]


def _decoded(line: bytes) -> str:
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace")


def _leave_out_repeated(contents: Contents) -> None:
    """Keep one of fixes that are the same, as in a log of two ports: beside its copy a fix seems to have no error."""
    once = {(fix.name, fix.time, fix.depth, fix.offset, fix.origin): fix for fix in contents.fixes}
    if repeated := len(contents.fixes) - len(once):
        contents.left_out["logged again"] += repeated
    contents.fixes = list(once.values())


def _of_auvs(contents: Contents, beacons: Sequence[str]) -> dict[str, list[Fix]]:
    """The fixes by name, without those of the ship and at the surface, or of the beacons picked; counts the others."""
    if not contents.fixes:
        reasons = contents.warnings() or [f"expected CSV with a header ({NEEDED}) or a USBL system's sentences"]
        raise UserError(f"no fix in it: {'; '.join(reasons)}")
    by_name: dict[str, list[Fix]] = {}
    for fix in sorted(contents.fixes, key=lambda fix: (len(fix.name), fix.name)):  # 2 before 10
        by_name.setdefault(fix.name, []).append(fix)
    listed = ", ".join(f"{name[:20]!r} ({len(own)})" for name, own in by_name.items())
    unknown = [name for name in beacons if name not in by_name]
    if unknown:
        raise UserError(f"no fix of --beacon {unknown[0]!r}; beacons and their fixes: {listed}")
    chosen = {}
    for name, own in by_name.items():
        reason = "" if beacons else _no_auv(own)
        if reason:
            contents.left_out[f"{name[:20]!r}, {reason}"] += len(own)
        elif not beacons or name in beacons:
            chosen[name] = own
    if not chosen:
        raise UserError(f"no fix of an AUV in it; left out: {contents.reasons()}")
    if len(chosen) > MAX_AUVS:
        raise UserError(
            f"{len(chosen)} beacons, at most {MAX_AUVS} are possible; pick them with --beacon NAME, which may be"
            f" repeated; beacons and their fixes: {listed}"
        )
    return chosen


def _no_auv(own: Sequence[Fix]) -> str:
    """Why a beacon is no AUV under water, "" if it is one."""
    order = np.argsort(_unwrapped(np.array([fix.time for fix in own])), kind="stable")
    last = [own[i] for i in order[-LAST:]]
    depth = float(np.median([fix.depth for fix in last]))
    if last[-1].ship or SHIP.search(last[-1].name):
        return "the ship"
    if depth < SURFACE:
        return f"{'at' if depth > -SURFACE else 'above'} the surface, depth {depth:.1f} m"
    if depth < DRAUGHT and np.median([fix.from_boat for fix in last]) < BESIDE:
        return f"at the boat, depth {depth:.1f} m"
    return ""


def _placed(fixes: Sequence[Fix], scenario: Scenario) -> Scenario:
    """The scenario; if it needs a place on Earth and has none, with its area around the middle of the fixes."""
    origins = [fix.origin for fix in fixes if fix.origin]
    if not origins or Site(scenario).frame:
        return scenario
    latitude, longitude = np.median([(place[0], near(place[1], origins[0][1])) for place in origins], axis=0)
    area = scenario.area
    corner = LocalFrame(longitude, latitude).to_geographic(np.array(-area.width / 2), np.array(-area.length / 2))
    place = {"longitude": near(float(corner[0]), 0.0), "latitude": float(corner[1])}
    return scenario.model_copy(update={"water": scenario.water.model_copy(update=place)})


def _place(fix: Fix, frame: LocalFrame | None) -> tuple[float, float]:
    if fix.origin is None or frame is None:
        return fix.offset
    x, y = frame.to_local(np.array(fix.origin[1]), np.array(fix.origin[0]))
    return float(x) + fix.offset[0], float(y) + fix.offset[1]


def _unwrapped(time: np.ndarray) -> np.ndarray:
    """Times of the day that go on after midnight, also from the newest to the oldest; others as they are."""
    if time.min() < 0 or time.max() > DAY:
        return time
    step = np.diff(time, prepend=time[0])
    return time + DAY * np.cumsum((step < -DAY / 2).astype(int) - (step > DAY - LATE))


def growth(age: float, speed: float) -> float:
    """Horizontal rms of the way that an AUV of some speed (m/s) can have gone in some time (s), m.

    Its velocity is a Gauss–Markov process of the correlation time τ = `TURNING_TIME`, so that it goes straight at first
    and then as in a random walk: v √(2τ (t − τ (1 − e^{−t/τ}))) (Uhlenbeck and Ornstein, Phys. Rev. 36, 1930, doi
    10.1103/PhysRev.36.823).
    """
    tau = TURNING_TIME
    return speed * math.sqrt(2 * tau * max(age + tau * math.expm1(-age / tau), 0.0))


def estimate(fixes: Fixes, now: float | None = None, speed: float = 0.0) -> PositionEstimate:
    """Place and scatter of an AUV that runs straight between one fix and the one after the next.

    Of a fix and its two neighbours, the middle one less the line through the others has the variance σ² (1 + a² + b²),
    a and b the weights of the two. σ is the median of its absolute values, scaled. The place is that of a line through
    the last seven fixes at the time of the last one, by Huber's M-estimator (Ann. Math. Statist. 35, 1964, doi
    10.1214/aoms/1177703732), which begins with the line of the median slope (P. K. Sen, J. Am. Stat. Assoc. 63, 1968,
    doi 10.1080/01621459.1968.10480934).

    Args:
        now: the present, s; default the time of the last fix.
        speed: of the AUV at most, m/s, by which its uncertainty grows since then (`growth`).
    """
    order = np.argsort(fixes.time, kind="stable")
    time, places, depth = fixes.time[order], fixes.places[order], fixes.depth[order]
    age, near, sigma = time[-LAST:] - time[-1], places[-LAST:], _scatter(time, places)
    place, variance = np.median(near, axis=0), np.zeros(2)
    for axis in (0, 1):
        if sigma is not None and age[0] < -INSTANT:
            place[axis], variance[axis] = _line_now(age, near[:, axis], sigma[axis])
    accuracy = float(np.sqrt(variance.sum())) if sigma is not None else None
    since = 0.0 if now is None else max(now - float(time[-1]), 0.0)
    return PositionEstimate(
        name=fixes.name,
        fixes=len(time),
        used=len(near),
        x=float(place[0]),
        y=float(place[1]),
        depth=float(np.median(depth[-LAST:])),
        noise=float(np.hypot(*sigma)) if sigma is not None else None,
        accuracy=accuracy,
        age=since,
        uncertainty=math.hypot(accuracy or 0.0, growth(since, speed)),
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
    apart = age[second] - age[first] > INSTANT
    slope = np.median((values[second] - values[first])[apart] / (age[second] - age[first])[apart])
    line = np.array([np.median(values - slope * age), slope])
    columns = np.stack([np.ones_like(age), age], axis=-1)
    for _ in range(ROUNDS):
        weight = 1 / np.clip(abs(values - columns @ line) / (HUBER * sigma), 1.0, 1 / LIGHTEST)
        information = columns.T @ (weight[:, None] * columns)
        line = np.linalg.solve(information, columns.T @ (weight * values))
    return float(line[0]), sigma**2 * float(np.linalg.inv(information)[0, 0])
