"""Where an AUV is by its fixes, and how much they scatter; outliers change neither."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from usvauv.cli.fix_log.reader import Fixes, read_log
from usvauv.env import Scenario
from usvauv.kernels.errors import UserError

LAST = 7  # fixes that give the place; of an AUV that turns, older ones say little about where it is
FEWEST = 4  # fixes of which the scatter is known
NORMAL = 1.4826  # standard deviation over the median of absolute values, of a normal distribution
HUBER = 1.345  # standard deviations from which a fix pulls no more: 95 % efficient for normal errors
ROUNDS = 30


class Estimate(NamedTuple):
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


def auvs_of_log(path: Path, scenario: Scenario) -> tuple[list[Estimate], Scenario, list[str]]:
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


def estimate(fixes: Fixes) -> Estimate:
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
    return Estimate(
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
