"""Where should the boat be, and how good is a fix from there? The planner's answer for one layout of AUVs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch

from kernels import fisher, runtime, usbl
from usvauv_env.parameters import link_table
from usvauv_env.scenario import Scenario


def solve(
    scenario: Scenario,
    auvs: Sequence[tuple[float, float, float]],
    others: Sequence[tuple[float, float]],
    objective: str,
    measurement: str,
    arch: str = "auto",
) -> tuple[dict, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Where the boat should be for a layout of AUVs, and how good their fixes are there and elsewhere.

    Args:
        auvs: x, y and depth of each, m; as many as the scenario has.
        others: further places of the boat to predict for, m.
        objective, measurement: as in the scenario's section `planner`.

    Returns:
        The result as plain data (`usvauv plan --help` lists its keys), and the landscape to draw: x (n,) and y (m,), m,
        and the objective (m, n).
    """
    device = runtime.start(arch).device
    link = torch.from_numpy(link_table(scenario)).to(device)
    form = fisher.form(measurement, objective)
    width, length = scenario.area.width, scenario.area.length
    points = torch.tensor(auvs, dtype=torch.float32, device=device)[None]
    optimum = fisher.plan_batch(link, points, form=form, width=width, length=length)[0, :2].tolist()
    centroid = np.mean(auvs, axis=0)[:2].tolist()

    def log_det(boats) -> np.ndarray:
        boats = torch.as_tensor(np.asarray(boats, np.float32), device=device)
        layouts = points.expand(len(boats), -1, -1).contiguous()
        return fisher.log_det_batch(link, layouts, boats, form=form)[:, 0].double().cpu().numpy()

    boats = [optimum, centroid, *others]
    values = log_det(boats)
    predicted = [predict(scenario, link, auvs, boat, measurement) for boat in boats]
    places = [
        {
            "x": x,
            "y": y,
            "log_det": float(value),
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
    return result, (x, y, log_det(grid.reshape(-1, 2)).reshape(len(y), len(x)))


def predict(
    scenario: Scenario,
    link: torch.Tensor,
    auvs: Sequence[tuple[float, float, float]],
    boat: Sequence[float],
    measurement: str,
) -> list[dict]:
    """Horizontal error ellipse of one fix of every AUV by a level array on a boat at `boat`.

    With v = S²σ²/κ² + ε² z², the horizontal offset d and q = S²: v I + (σ_S²/q) d dᵀ of phases and slant range;
    v (I + (q + z²)/z⁴ d dᵀ) of the phases alone, brought to the known depth along the measured direction.
    """
    count = len(auvs)
    offset = torch.tensor(
        [[x - boat[0], y - boat[1], -depth] for x, y, depth in auvs], dtype=torch.float32, device=link.device
    )
    index = torch.arange(count, dtype=torch.int32, device=link.device)
    level, no_noise = offset.new_zeros(count, 2), offset.new_zeros(count, 5)
    attitude_error = scenario.usbl.attitude_error
    estimate, covariance = usbl.fixes(link, index, offset, level, attitude_error, no_noise)
    sigma = estimate[:, 3].double().cpu().numpy()
    covariance = covariance.double().cpu().numpy()
    kappa = link[:, usbl.KAPPA].double().cpu().numpy()
    ellipses = []
    for (dx, dy, z), s, k, (xx, xy, yy) in zip(offset.double().tolist(), sigma, kappa, covariance, strict=True):
        S = math.hypot(dx, dy, z)
        C = np.array([[xx, xy], [xy, yy]])
        if measurement == "phase":
            d = np.array([dx, dy])
            v = (S * s / k) ** 2 + (attitude_error * z) ** 2
            C = v * (np.eye(2) + (S * S + z * z) / z**4 * np.outer(d, d))
        variances, axes = np.linalg.eigh(C)
        ellipses.append(
            {
                "range": S,
                "major": math.sqrt(variances[1]),
                "minor": math.sqrt(variances[0]),
                "angle": math.atan2(axes[1, 1], axes[0, 1]) % math.pi,
                "ambiguous": bool(k * math.hypot(dx, dy) / S + 3 * s > math.pi),
            }
        )
    return ellipses
