"""The boat's planner against differential evolution, its gap to a dense search, and the rate of statistical fixes.

    python -m benchmarks.plan --json

Links are those of scenario `extreme`, the area is 200 m × 200 m. Two objectives: "joint fix", the determinant of the
information on all positions by whole fixes (`ideal`, `extreme`), and "sum phase", of the paper's sum (`paper-*`).
Differential evolution is SciPy's with its default settings on the same objective in NumPy, in two versions: one place a
call, and a whole generation a call; ratios are to the faster. Gaps are differences of ln det, in double precision, to
the best of a dense grid, polished by a pattern search that knows no derivatives.
"""

from __future__ import annotations

import argparse
import json

import numpy as np
import torch
from scipy.optimize import differential_evolution

from benchmarks.machine import best_time, describe
from kernels import fisher, runtime, usbl
from usvauv_env import Scenario
from usvauv_env.parameters import link_table

SIDE = 200.0
TEAMS = (2, 4, 8, 16)
OBJECTIVES = {"joint fix": fisher.JOINT_FIX, "sum phase": fisher.PHASE}
KINDS = ("anywhere", "near-collinear", "coincident", "beneath the boat", "any depth")
GRID = 41
PEAKS = 5  # grid points of each layout that are polished, beside its AUVs


def layouts(kind: str, count: int, auvs: int, random: np.random.Generator) -> np.ndarray:
    """Random AUVs about 100 m below the area, (count, auvs, 3), m."""
    place = SIDE * random.random((count, auvs, 2))
    z = -100 + 4 * random.standard_normal((count, auvs))
    if kind == "near-collinear":
        ends = SIDE * random.random((count, 2, 1, 2))
        place = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * random.random((count, auvs, 1))
        place = np.clip(place + 0.1 * random.standard_normal(place.shape), 0, SIDE)
    elif kind == "coincident":
        place[:, 1:] = place[:, :1]
        place[::2] += 0.3 * random.standard_normal(place[::2].shape)
    elif kind == "beneath the boat":
        place[:, 0] = SIDE / 2  # where the boat is, the planner's start
    elif kind == "any depth":
        z = -5 - 295 * random.random((count, auvs))
    return np.concatenate([place, z[..., None]], axis=-1).astype(np.float32)


def log_det(boat: np.ndarray, auvs: np.ndarray, link: np.ndarray, form: int) -> np.ndarray:
    """The objective in double precision: boat (..., 2) and auvs (..., K, 3) in m, link (K, COLUMNS)."""
    dx, dy = boat[..., None, 0] - auvs[..., 0], boat[..., None, 1] - auvs[..., 1]
    z2 = auvs[..., 2] ** 2
    q = dx * dx + dy * dy + z2
    S0 = link[:, usbl.REFERENCE]
    log_T = link[:, usbl.LEVEL] - link[:, usbl.POWER] * np.log(q / S0**2) - link[:, usbl.DECAY] * (np.sqrt(q) - S0)
    if form == fisher.JOINT_FIX:
        return 2 * log_T.sum(-1)
    T, s2 = np.exp(log_T), z2 / q
    a, b = T * s2 * s2, T * (1 + s2) / q
    xx, yy, xy = ((a + b * dy * dy).sum(-1), (a + b * dx * dx).sum(-1), (b * dx * dy).sum(-1))
    return np.log(xx * yy - xy * xy)


def best_by_search(auvs: np.ndarray, link: np.ndarray, form: int) -> np.ndarray:
    """Global maximum of each layout (n, K, 3): dense grid, then a pattern search from its best peaks and every AUV."""
    axis = np.linspace(0, SIDE, GRID)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    value = np.concatenate([log_det(grid, part[:, None], link, form) for part in np.array_split(auvs, len(auvs) // 20)])
    padded = np.pad(value.reshape(-1, GRID, GRID), ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    around = [padded[:, i : i + GRID, j : j + GRID] for i in range(3) for j in range(3)]
    peaks = np.where(value >= np.max(around, axis=0).reshape(value.shape), value, -np.inf)
    x = grid[np.argsort(peaks, axis=1)[:, -PEAKS:]]
    x = np.concatenate([x, np.clip(auvs[..., :2], 0, SIDE)], axis=1)
    best = log_det(x, auvs[:, None], link, form)
    h = np.full(x.shape[:2], SIDE / (GRID - 1))
    pattern = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j], float)
    while h.max() > 1e-4:
        there = np.clip(x[:, :, None] + h[..., None, None] * pattern, 0, SIDE)
        height = log_det(there, auvs[:, None, None], link, form)
        leader = height.argmax(-1)[..., None]
        top = np.take_along_axis(height, leader, -1)[..., 0]
        better = top > best
        x = np.where(better[..., None], np.take_along_axis(there, leader[..., None], 2)[:, :, 0], x)
        best = np.where(better, top, best)
        h = np.where(better, h, 0.5 * h)
    return best.max(1)


def evolution(auvs: np.ndarray, link: np.ndarray, form: int, whole_generation: bool) -> float:
    """Highest ln det that SciPy's differential evolution finds for one layout (K, 3)."""
    settings = {"vectorized": True, "updating": "deferred"} if whole_generation else {}
    found = differential_evolution(
        lambda x: -log_det(np.asarray(x).T, auvs, link, form), [(0, SIDE)] * 2, rng=0, **settings
    )
    return -float(found.fun)


def measure_team(auvs: int, name: str, trials: int, seconds: float) -> dict[str, object]:
    """Rates, ratio and gap of one objective for teams of `auvs`."""
    device, form = runtime.start().device, OBJECTIVES[name]
    link = torch.from_numpy(link_table(Scenario.load("extreme", [f"auv.count={auvs}"]))).to(device)
    exact_link = link.double().cpu().numpy()
    random = np.random.default_rng(auvs)
    batch = (1 << 17) // auvs if device.type == "cpu" else (1 << 24) // auvs
    points = torch.from_numpy(layouts("anywhere", batch, auvs, random)).to(device)
    time = best_time(lambda: fisher.plan_batch(link, points, form=form, width=SIDE, length=SIDE), seconds)
    plans_per_second = batch / time

    trial = np.concatenate([layouts(kind, trials // len(KINDS), auvs, random) for kind in KINDS])
    found = fisher.plan_batch(link, torch.from_numpy(trial).to(device), form=form, width=SIDE, length=SIDE)
    exact = trial.astype(float)
    reached = log_det(found[:, :2].double().cpu().numpy(), exact, exact_link, form)
    gap = best_by_search(exact, exact_link, form) - reached

    few = range(0, len(exact), max(1, len(exact) // 3))
    slow = {
        word: len(few) / best_time(lambda w=whole: [evolution(exact[i], exact_link, form, w) for i in few], 0.0, 1)
        for word, whole in (("one_place_a_call", False), ("one_generation_a_call", True))
    }
    return {
        "auvs": auvs,
        "objective": name,
        "batch": batch,
        "plans_per_second": plans_per_second,
        "differential_evolution_per_second": slow,
        "over_differential_evolution": plans_per_second / max(slow.values()),
        "layouts": len(trial),
        "largest_gap": float(gap.max()),
        "largest_gap_by_kind": dict(zip(KINDS, gap.reshape(len(KINDS), -1).max(1).tolist(), strict=True)),
        "largest_gap_of_differential_evolution": float(
            max((reached + gap)[i] - evolution(exact[i], exact_link, form, True) for i in few)
        ),
    }


def measure_fixes(seconds: float) -> dict[str, float]:
    """Statistical fixes with their covariance a second: noise at hand, and drawn by PyTorch in the same time."""
    device = runtime.start().device
    count = 1 << 20 if device.type == "cpu" else 1 << 24
    scenario = Scenario.load("extreme")
    link = torch.from_numpy(link_table(scenario)).to(device)
    offset = torch.from_numpy(layouts("anywhere", count, 1, np.random.default_rng(0))[:, 0] - [SIDE / 2, SIDE / 2, 0])
    offset = offset.float().contiguous().to(device)
    slope = 0.05 * torch.randn((count, 2), generator=torch.Generator().manual_seed(1)).to(device)
    index = (torch.arange(count, device=device) % 2).int()
    generator = torch.Generator(device).manual_seed(2)
    noise = torch.randn((count, 5), generator=generator, device=device)

    def take(noise: torch.Tensor) -> None:
        usbl.fixes(link, index, offset, slope, scenario.usbl.attitude_error, noise)

    def draw_and_take() -> None:
        take(torch.randn((count, 5), generator=generator, device=device))

    return {
        "per_second": count / best_time(lambda: take(noise), seconds),
        "per_second_with_noise_drawn": count / best_time(draw_and_take, seconds),
    }


def measure(teams: tuple[int, ...], trials: int, seconds: float) -> dict[str, object]:
    """All figures."""
    return {
        "machine": describe(),
        "plans": [measure_team(auvs, name, trials, seconds) for auvs in teams for name in OBJECTIVES],
        "statistical_fixes": measure_fixes(seconds),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--trials", type=int, default=1000, help="random layouts the gap is searched over")
    parser.add_argument("--seconds", type=float, default=1.0, help="time spent on each rate, s")
    arguments = parser.parse_args()
    result = measure(TEAMS, arguments.trials, arguments.seconds)
    if arguments.json:
        print(json.dumps(result, indent=1))
        return
    print(result["machine"])
    for row in result["plans"]:
        print(
            f"{row['auvs']:2d} AUVs, {row['objective']}: {row['plans_per_second']:,.0f} plans/s,"
            f" {row['over_differential_evolution']:,.0f} × differential evolution,"
            f" largest gap {row['largest_gap']:.1e} in {row['layouts']} layouts"
        )
    fixes = result["statistical_fixes"]
    print(
        f"statistical fixes: {fixes['per_second'] / 1e6:.1f} million/s,"
        f" with the noise drawn {fixes['per_second_with_noise_drawn'] / 1e6:.1f} million/s"
    )


if __name__ == "__main__":
    main()
