"""The planner's answer for one layout of AUVs: the best place of the boat, and how good fixes from there are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch

from kernels import runtime
from kernels.planning import fisher, global_search, objectives, tilted_array
from kernels.positioning import fix_probability
from usvauv_env.scenario import Scenario
from usvauv_env.site.site import Site
from usvauv_env.world.tables import link_table

LARGEST_VARIANCE = 1e16  # m²; an axis of more than 10⁸ m is unbounded
ROUNDING = 1e-3  # relative, of variances in single precision
NO_INFORMATION = -1e29  # ln of an objective; what is below stands for ln 0


@dataclass(frozen=True)
class FixError:
    """Error to expect of one good fix of an AUV.

    Attributes:
        range: slant range, m.
        major, minor: standard deviations along the axes of the horizontal error ellipse, m; None: unbounded, as that of
            phases alone where the AUV lies in the array's plane.
        angle: of the major axis, rad, anticlockwise from east; None where an axis is unbounded.
        good: probability that the fix is good.
    """

    range: float
    major: float | None
    minor: float | None
    angle: float | None
    good: float


@dataclass(frozen=True)
class BoatPlace:
    """A place of the boat (m), ln of the objective there, rms of all AUVs' errors (m), and the error of each AUV.

    ln of the objective is None where there is no information, rms where an AUV's error is unbounded.
    """

    x: float
    y: float
    log_objective: float | None
    rms: float | None
    errors: list[FixError]


@dataclass(frozen=True)
class AuvPosition:
    """Position of an AUV, m, depth positive down, and its carrier, Hz."""

    x: float
    y: float
    depth: float
    carrier: float


@dataclass(frozen=True)
class Extent:
    """Size of an area, m."""

    width: float
    length: float
    depth: float


@dataclass(frozen=True)
class Plan:
    """The planner's answer; `usvauv plan --json` writes its fields.

    Attributes:
        scenario: name of the scenario.
        objective, measurement: as in its section `planner`.
        attitude_error: rad.
        slope: ∂η/∂x and ∂η/∂y of the surface that the array lies on.
        area: of the scenario.
        auvs: the layout.
        optimum: the best place.
        centroid: the mean of the AUVs' positions.
        compare: further places.
    """

    scenario: str
    objective: str
    measurement: str
    attitude_error: float
    slope: tuple[float, float]
    area: Extent
    auvs: list[AuvPosition]
    optimum: BoatPlace
    centroid: BoatPlace
    compare: list[BoatPlace]


class Landscape(NamedTuple):
    """ln of the objective (m, n) for the boat at x (n,) and y (m,), m."""

    x: np.ndarray
    y: np.ndarray
    log_objective: np.ndarray


def solve(
    scenario: Scenario,
    auvs: Sequence[tuple[float, float, float]],
    others: Sequence[tuple[float, float]],
    objective: str,
    measurement: str,
    slope: tuple[float, float] = (0.0, 0.0),
    arch: str = "auto",
) -> tuple[Plan, Landscape]:
    """Find the best place of the boat for a layout of AUVs, and predict their fixes from there and elsewhere.

    Args:
        auvs: x, y and depth of each, m; as many as the scenario has.
        others: further places of the boat to predict for, m.
        objective, measurement: as in the scenario's section `planner`.
        slope: ∂η/∂x and ∂η/∂y of the surface that the array lies on, for the errors predicted. The best place is that
            of a level array.
        arch: architecture of the kernels, see `kernels.runtime.start`.
    """
    device = runtime.start(arch).device
    link = torch.from_numpy(link_table(Site(scenario))).to(device)
    code = objectives.objective_code(measurement, objective)
    width, length = scenario.area.width, scenario.area.length
    points = torch.tensor(auvs, dtype=torch.float32, device=device)[None]
    best = global_search.plan_batch(link, points, code=code, width=width, length=length)[0, :2].tolist()
    optimum = [min(x, side) for x, side in zip(best, (width, length), strict=True)]  # single precision rounds sides up
    centroid = np.mean(auvs, axis=0)[:2].tolist()

    def log_objective(places: Sequence[Sequence[float]] | np.ndarray) -> np.ndarray:
        boats = torch.as_tensor(np.asarray(places, np.float32), device=device)
        layouts = points.expand(len(boats), -1, -1).contiguous()
        values = objectives.log_objective_batch(link, layouts, boats, code=code)[:, 0].double().cpu().numpy()
        values[values < NO_INFORMATION] = -math.inf
        return values

    boats = [optimum, centroid, *others]
    places = []
    for (x, y), value in zip(boats, log_objective(boats), strict=True):
        errors = predict(link, auvs, (x, y), measurement, slope)
        axes = [axis for error in errors for axis in (error.major, error.minor)]
        rms = None if None in axes else math.hypot(*(axis for axis in axes if axis)) / math.sqrt(len(errors))
        places.append(BoatPlace(x, y, float(value) if math.isfinite(value) else None, rms, errors))
    plan = Plan(
        scenario=scenario.name,
        objective=objective,
        measurement=measurement,
        attitude_error=scenario.usbl.attitude_error,
        slope=slope,
        area=Extent(width, length, scenario.area.depth),
        auvs=[AuvPosition(*auv, scenario.usbl.carrier(k, len(auvs))) for k, auv in enumerate(auvs)],
        optimum=places[0],
        centroid=places[1],
        compare=places[2:],
    )
    x, y = np.linspace(0, width, 201), np.linspace(0, length, 201)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    return plan, Landscape(x, y, log_objective(grid.reshape(-1, 2)).reshape(len(y), len(x)))


def predict(
    link: torch.Tensor,
    auvs: Sequence[tuple[float, float, float]],
    boat: tuple[float, float],
    measurement: str,
    slope: tuple[float, float],
) -> list[FixError]:
    """Errors of one fix of every AUV from a boat at `boat`, m; other arguments as for `solve`."""
    count = len(auvs)
    offset = torch.tensor(
        [[x - boat[0], y - boat[1], -depth] for x, y, depth in auvs], dtype=torch.float32, device=link.device
    )
    index = torch.arange(count, dtype=torch.int32, device=link.device)
    slopes = offset.new_tensor(slope).expand(count, 2).contiguous()
    code = fisher.MEASUREMENTS.index(measurement)
    covariance, information, _ = (
        part.double().cpu().numpy()
        for part in tilted_array.predict_batch(link, index, offset, slopes, measurement=code)
    )
    detected, good = fix_probability.good_probability(link, index, offset, slopes)
    errors = []
    for k in range(count):
        probability = float(detected[k] * good[k])
        errors.append(
            FixError(
                offset[k].double().norm().item(),
                *ellipse(covariance[k], information[k]),
                good=probability if math.isfinite(probability) else 0.0,
            )
        )
    return errors


def ellipse(
    covariance: np.ndarray, information: np.ndarray
) -> tuple[float, float, float] | tuple[None, float | None, None]:
    """Standard deviations along the major and minor axis (m) and angle of the major axis (rad), see `FixError`.

    Args:
        covariance, information: (3,) xx, xy, yy in m² and 1/m², each accurate in its larger eigenvalue.
    """
    strength = _larger_eigenvalue(information)
    minor = 1 / math.sqrt(strength) if 1 / LARGEST_VARIANCE < strength < math.inf else None
    variance = _larger_eigenvalue(covariance)
    if minor is None or not minor**2 * (1 - ROUNDING) <= variance < LARGEST_VARIANCE:
        return None, minor, None
    axes = np.linalg.eigh(covariance[[0, 1, 1, 2]].reshape(2, 2))[1]
    return math.sqrt(variance), minor, math.atan2(axes[1, 1], axes[0, 1]) % math.pi


def _larger_eigenvalue(matrix: np.ndarray) -> float:
    """The larger eigenvalue of (xx, xy, yy); NaN where an entry is not finite."""
    if not np.isfinite(matrix).all():
        return math.nan
    return float(np.linalg.eigvalsh(matrix[[0, 1, 1, 2]].reshape(2, 2))[1])
