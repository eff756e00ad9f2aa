"""Where should the boat be, and how good is a fix from there? The planner's answer for one layout of AUVs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch

from kernels import runtime
from kernels.planning import fisher, global_search, objectives, tilted_array
from kernels.positioning import fix_probability
from usvauv_env.scenario import Scenario
from usvauv_env.site.site import Site
from usvauv_env.world.tables import link_table


def solve(
    scenario: Scenario,
    auvs: Sequence[tuple[float, float, float]],
    others: Sequence[tuple[float, float]],
    objective: str,
    measurement: str,
    slope: tuple[float, float] = (0.0, 0.0),
    arch: str = "auto",
) -> tuple[dict, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Where the boat should be for a layout of AUVs, and how good their fixes are there and elsewhere.

    Args:
        auvs: x, y and depth of each, m; as many as the scenario has.
        others: further places of the boat to predict for, m.
        objective, measurement: as in the scenario's section `planner`.
        slope: ∂η/∂x and ∂η/∂y of the surface that the array lies on, for the errors predicted. The best place is that
            of a level array.

    Returns:
        The result as plain data (`usvauv plan --help` lists its keys), and the landscape to draw: x (n,) and y (m,), m,
        and the objective (m, n).
    """
    device = runtime.start(arch).device
    link = torch.from_numpy(link_table(Site(scenario))).to(device)
    code = objectives.objective_code(measurement, objective)
    width, length = scenario.area.width, scenario.area.length
    points = torch.tensor(auvs, dtype=torch.float32, device=device)[None]
    optimum = global_search.plan_batch(link, points, code=code, width=width, length=length)[0, :2].tolist()
    centroid = np.mean(auvs, axis=0)[:2].tolist()

    def log_objective(boats) -> np.ndarray:
        boats = torch.as_tensor(np.asarray(boats, np.float32), device=device)
        layouts = points.expand(len(boats), -1, -1).contiguous()
        return objectives.log_objective_batch(link, layouts, boats, code=code)[:, 0].double().cpu().numpy()

    boats = [optimum, centroid, *others]
    values = log_objective(boats)
    predicted = [predict(link, auvs, boat, measurement, slope) for boat in boats]
    places = [
        {
            "x": x,
            "y": y,
            "log_objective": float(value),
            "rms": math.sqrt(sum(e["major"] ** 2 + e["minor"] ** 2 for e in errors) / len(errors)),
            "errors": errors,
        }
        for (x, y), value, errors in zip(boats, values, predicted, strict=True)
    ]
    result = {
        "scenario": scenario.name,
        "objective": objective,
        "measurement": measurement,
        "attitude_error": scenario.usbl.attitude_error,
        "slope": list(slope),
        "area": {"width": width, "length": length, "depth": scenario.area.depth},
        "auvs": [
            {"x": x, "y": y, "depth": depth, "carrier": scenario.usbl.carrier(k, len(auvs))}
            for k, (x, y, depth) in enumerate(auvs)
        ],
        "optimum": places[0],
        "centroid": places[1],
        "compare": places[2:],
    }
    x, y = np.linspace(0, width, 201), np.linspace(0, length, 201)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    return result, (x, y, log_objective(grid.reshape(-1, 2)).reshape(len(y), len(x)))


def predict(
    link: torch.Tensor,
    auvs: Sequence[tuple[float, float, float]],
    boat: Sequence[float],
    measurement: str,
    slope: tuple[float, float],
) -> list[dict]:
    """Horizontal error ellipse of one fix of every AUV from a boat at `boat`, and how likely the fix is good."""
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
    ellipses = []
    for k in range(count):
        variances, axes = np.linalg.eigh(covariance[k, [0, 1, 1, 2]].reshape(2, 2))
        strengths = np.linalg.eigvalsh(information[k, [0, 1, 1, 2]].reshape(2, 2))
        ellipses.append(
            {
                "range": offset[k].double().norm().item(),
                "major": math.sqrt(variances[1]),
                "minor": 1 / math.sqrt(strengths[1]),
                "angle": math.atan2(axes[1, 1], axes[0, 1]) % math.pi,
                "good": float(detected[k] * good[k]),
            }
        )
    return ellipses
