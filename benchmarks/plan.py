"""The boat's planner: its speed against differential evolution, its gap to a dense search, the loss by tilt.

    python -m benchmarks.plan --json

Links are those of scenario `extreme`, the area is 200 m × 200 m. Objectives "d fix" and "a fix" are the determinant and
the trace of the inverse of the information on all positions by whole fixes, "sum phase" is the determinant of the
paper's sum (`paper-*`). Differential evolution is SciPy's with its default settings on the same objective in NumPy, in
two versions: one place a call, and a whole generation a call; ratios are to the faster. Gaps are differences of ln of
the objective, in double precision, to the best of a dense grid, polished by a search that knows no derivatives.
`unequal` has the gaps where levels, carriers and depths differ from AUV to AUV (source levels by 60 dB, depths from 3 m
to 500 m, areas of 200 m to 2 km, with and without errors beside noise), and the error in ln of the value reported, at
the planned and at random places. `tilt` is what ln of the objective loses, on a sea of slope 0.1, because the boat
plans with a level array."""

from __future__ import annotations

import math

import numpy as np
import torch
from scipy.optimize import differential_evolution

from benchmarks.machine import batch, best_time, command_line, describe, parse, show
from usvauv.env import Scenario
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels import runtime
from usvauv.kernels.planning import information, objectives, search
from usvauv.kernels.positioning import acoustic_link

SIDE = 200.0
TEAMS = (2, 4, 8, 16)
CODES = {
    f"{objective} {measurement}": objectives.objective_code(measurement, objective)
    for objective, measurement in (("d", "fix"), ("a", "fix"), ("sum", "phase"))
}
ALL_CODES = {
    f"{objective} {measurement}": objectives.objective_code(measurement, objective)
    for objective in ("d", "a", "sum")
    for measurement in ("phase", "fix")
}
KINDS = ("anywhere", "near-collinear", "coincident", "beneath the boat", "any depth", "shallow corners")
GRID = 41
STEPS = 120  # of the polish
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
    elif kind == "shallow corners":
        place = np.where(random.random((count, auvs, 2)) < 0.5, 0.2 * place, SIDE - 0.2 * place)
        z = -(10 + 30 * random.random((count, 1))) * (1 + 0.1 * random.standard_normal((count, auvs)))
    return np.concatenate([place, z[..., None]], axis=-1).astype(np.float32)


def log_objective(boat: np.ndarray, auvs: np.ndarray, link: np.ndarray, code: int) -> np.ndarray:
    """ln of the objective in double precision: boat (..., 2) and auvs (..., K, 3) in m, link (K, COLUMNS)."""
    dx, dy = boat[..., None, 0] - auvs[..., 0], boat[..., None, 1] - auvs[..., 1]
    z2 = auvs[..., 2] ** 2
    q = dx * dx + dy * dy + z2
    S0 = link[:, acoustic_link.REFERENCE]
    log_T = (
        link[:, acoustic_link.LEVEL]
        - link[:, acoustic_link.POWER] * np.log(q / S0**2)
        - link[:, acoustic_link.DECAY] * (np.sqrt(q) - S0)
    )
    v = np.exp(-log_T) + link[:, acoustic_link.ATTITUDE] * z2
    objective, measurement = objectives.OBJECTIVES[code // 2], objectives.MEASUREMENTS[code % 2]
    if objective != "sum":
        rho2 = dx * dx + dy * dy
        turned = v + link[:, acoustic_link.ALIGNMENT] * z2
        place, stretch = link[:, acoustic_link.POSITION], link[:, acoustic_link.SOUND_SPEED] * rho2
        across = turned + place + link[:, acoustic_link.HEADING] * rho2
        along = (turned + stretch) * (q / z2) ** 2 + place if measurement == "phase" else turned + place + 4 * stretch
        return -(np.log(across) + np.log(along)).sum(-1) if objective == "d" else -np.log((across + along).sum(-1))
    if measurement == "fix":
        return 2 * np.log((1 / v).sum(-1))
    T, s2 = 1 / v, z2 / q
    a, b = T * s2 * s2, T * (1 + s2) / q
    xx, yy, xy = ((a + b * dy * dy).sum(-1), (a + b * dx * dx).sum(-1), (b * dx * dy).sum(-1))
    return np.log(xx * yy - xy * xy)  # a sum 1e-12 from singular keeps four digits


def best_by_search(auvs: np.ndarray, link: np.ndarray, code: int, side: float = SIDE) -> np.ndarray:
    """Global maximum of each layout (n, K, 3): dense grid, then a pattern search.

    The search starts at the grid's best peaks, at the best places between two AUVs, and at every AUV.
    """
    axis = np.linspace(0, side, GRID)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    value = np.concatenate(
        [log_objective(grid, part[:, None], link, code) for part in np.array_split(auvs, 1 + len(auvs) // 20)]
    )
    padded = np.pad(value.reshape(-1, GRID, GRID), ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    around = [padded[:, i : i + GRID, j : j + GRID] for i in range(3) for j in range(3)]
    peaks = np.where(value >= np.max(around, axis=0).reshape(value.shape), value, -np.inf)
    x = grid[np.argsort(peaks, axis=1)[:, -PEAKS:]]
    one, other = np.triu_indices(auvs.shape[1], 1)
    share = np.linspace(0.05, 0.95, 10)[:, None, None]
    way = auvs[:, None, other, :2] - auvs[:, None, one, :2]
    between = np.clip(auvs[:, None, one, :2] + share * way, 0, side).reshape(len(auvs), -1, 2)
    leaders = np.argsort(log_objective(between, auvs[:, None], link, code), axis=1)[:, -PEAKS:]
    between = np.take_along_axis(between, leaders[..., None], 1)
    x = np.concatenate([x, between, np.clip(auvs[..., :2], 0, side)], axis=1)
    best = log_objective(x, auvs[:, None], link, code)
    h = np.full(x.shape[:2], side / (GRID - 1))
    pattern = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j], float)
    for _ in range(STEPS):
        there = np.clip(x[:, :, None] + h[..., None, None] * pattern, 0, side)
        height = log_objective(there, auvs[:, None, None], link, code)
        leader = height.argmax(-1)[..., None]
        top = np.take_along_axis(height, leader, -1)[..., 0]
        better = top > best
        x = np.where(better[..., None], np.take_along_axis(there, leader[..., None], 2)[:, :, 0], x)
        best = np.where(better, top, best)
        h = np.where(better, 1.5 * h, 0.5 * h)
    return best.max(1)


def evolution(auvs: np.ndarray, link: np.ndarray, code: int, whole_generation: bool) -> float:
    """Highest ln of the objective that SciPy's differential evolution finds for one layout (K, 3)."""
    settings = {"vectorized": True, "updating": "deferred"} if whole_generation else {}
    found = differential_evolution(
        lambda x: -log_objective(np.asarray(x).T, auvs, link, code), [(0, SIDE)] * 2, rng=0, **settings
    )
    return -float(found.fun)


def measure_team(auvs: int, name: str, trials: int, seconds: float) -> dict[str, object]:
    """Rates, ratio and gap of one objective for teams of `auvs`."""
    device, code = runtime.start().device, CODES[name]
    link = torch.from_numpy(link_table(Site(Scenario.load("extreme", [f"auv.count={auvs}"])))).to(device)
    link[:, acoustic_link.CERTAIN] = 0.0  # all fixes count as good, as in `log_objective`
    exact_link = link.double().cpu().numpy()
    random = np.random.default_rng(auvs)
    count = batch(1 << 17, 1 << 24) // auvs
    points = torch.from_numpy(layouts("anywhere", count, auvs, random)).to(device)
    time = best_time(lambda: search.plan_batch(link, points, code=code, width=SIDE, length=SIDE), seconds)
    plans_per_second = count / time

    trial = np.concatenate([layouts(kind, trials // len(KINDS), auvs, random) for kind in KINDS])
    found = search.plan_batch(link, torch.from_numpy(trial).to(device), code=code, width=SIDE, length=SIDE)
    exact = trial.astype(float)
    reached = log_objective(found[:, :2].double().cpu().numpy(), exact, exact_link, code)
    gap = best_by_search(exact, exact_link, code) - reached

    few = range(0, len(exact), max(1, len(exact) // 3))
    slow = {
        word: len(few) / best_time(lambda w=whole: [evolution(exact[i], exact_link, code, w) for i in few], 0.0, 1)
        for word, whole in (("one_place_a_call", False), ("one_generation_a_call", True))
    }
    return {
        "auvs": auvs,
        "objective": name,
        "batch": count,
        "plans_per_second": plans_per_second,
        "differential_evolution_per_second": slow,
        "over_differential_evolution": plans_per_second / max(slow.values()),
        "layouts": len(trial),
        "largest_gap": float(gap.max()),
        "largest_gap_by_kind": dict(zip(KINDS, gap.reshape(len(KINDS), -1).max(1).tolist(), strict=True)),
        "largest_gap_of_differential_evolution": float(
            max((reached + gap)[i] - evolution(exact[i], exact_link, code, True) for i in few)
        ),
    }


def unequal_links(auvs: int, attitude_error: float, random: np.random.Generator) -> np.ndarray:
    """A link table of AUVs with levels and carriers of their own, (auvs, COLUMNS)."""
    common = {
        "path": random.choice(["echo", "transponder"]),
        "noise_law": random.choice(["density", "demonstration"]),
        "planner_noise": random.choice(["range", "constant"]),
        "reference_range": random.choice([10.0, 100.0, 300.0]),
        "accuracy": acoustic_link.Accuracy(
            attitude_error,
            alignment=random.choice([0.0, 0.001]),
            heading=random.choice([0.0, 0.004, 0.02]),
            sound_speed=random.choice([0.0, 7e-4]),
            position=random.choice([0.0, 0.3]),
        ),
    }
    rows = [
        acoustic_link.link_table(
            [random.uniform(8e3, 3e4)], acoustic_link.Sonar(source_level=random.uniform(120, 180), **common)
        )
        for _ in range(auvs)
    ]
    return np.concatenate(rows)


def unequal_layouts(count: int, auvs: int, side: float, random: np.random.Generator) -> np.ndarray:
    """AUVs 3 m to 500 m below an area, anywhere or in a cluster, (count, auvs, 3), m."""
    place = side * random.random((count, auvs, 2))
    place[::3] = np.clip(place[::3, :1] + 0.1 * side * random.standard_normal((len(place[::3]), auvs, 2)), 0, side)
    z = -np.exp(random.uniform(math.log(3), math.log(500), (count, auvs, 1)))
    return np.concatenate([place, z], axis=-1).astype(np.float32)


def measure_unequal(name: str, teams: tuple[int, ...], tables: int, layouts_each: int = 6) -> dict[str, object]:
    """Gap and error of the reported value of one objective, `tables` link tables for each of `teams`."""
    device, code = runtime.start().device, ALL_CODES[name]
    gaps, errors = [], []
    for auvs in teams:
        random = np.random.default_rng(auvs)
        for i in range(tables):
            side = (200.0, 700.0, 2000.0)[i % 3]
            table = unequal_links(auvs, (0.0, 0.002, 0.01)[i // 3 % 3], random)
            team = unequal_layouts(layouts_each, auvs, side, random)
            boat = (side * random.random((layouts_each, 2))).astype(np.float32)
            link, points = torch.from_numpy(table).to(device), torch.from_numpy(team).to(device)
            found = search.plan_batch(link, points, code=code, width=side, length=side).double().cpu().numpy()
            anywhere = objectives.log_objective_batch(link, points, torch.from_numpy(boat).to(device), code=code)
            exact, exact_link = team.astype(float), table.astype(float)
            reached = log_objective(found[:, :2], exact, exact_link, code)
            gaps.append(best_by_search(exact, exact_link, code, side) - reached)
            elsewhere = log_objective(boat.astype(float), exact, exact_link, code)
            errors += [found[:, 2] - reached, anywhere[:, 0].double().cpu().numpy() - elsewhere]
    gap, error = np.concatenate(gaps), np.abs(np.concatenate(errors))
    return {
        "objective": name,
        "layouts": len(gap),
        "largest_gap": float(gap.max()),
        "gap_99_percent": float(np.quantile(gap, 0.99)),
        "share_above_1e-3": float((gap > 1e-3).mean()),
        "largest_error_of_value": float(error.max()),
    }


def measure_tilt(auvs: int, name: str, count: int, slope: float = 0.1) -> dict[str, object]:
    """Loss in ln of the objective from planning level while the surface slopes towards a random direction."""
    device, code = runtime.start().device, CODES[name]
    objective, measurement = objectives.OBJECTIVES[code // 2], code % 2
    link = torch.from_numpy(link_table(Site(Scenario.load("extreme", [f"auv.count={auvs}"])))).to(device)
    random = np.random.default_rng(auvs)
    team = layouts("anywhere", count, auvs, random)
    level = search.plan_batch(link, torch.from_numpy(team).to(device), code=code, width=SIDE, length=SIDE)
    angle = 2 * math.pi * random.random(count)
    tilt_of = torch.from_numpy(slope * np.stack([np.cos(angle), np.sin(angle)], axis=-1).astype(np.float32)).to(device)

    def value(boat: np.ndarray) -> np.ndarray:
        """ln of the objective from boats (count, m, 2)."""
        m = boat.shape[1]
        place = np.broadcast_to(
            np.concatenate([boat, np.zeros_like(boat[..., :1])], -1)[:, :, None], (count, m, auvs, 3)
        )
        offset = torch.from_numpy((team[:, None] - place).reshape(-1, 3).astype(np.float32)).to(device)
        row = torch.arange(auvs, dtype=torch.int32, device=device).repeat(count * m)
        slopes = tilt_of.repeat_interleave(m * auvs, dim=0).contiguous()
        C = information.tilted_batch(link, row, offset, slopes, measurement=measurement)[0].double().cpu().numpy()
        xx, xy, yy = np.moveaxis(C.reshape(count, m, auvs, 3), -1, 0)
        if objective == "d":
            return -np.log(xx * yy - xy * xy).sum(-1)
        return -np.log((xx + yy).sum(-1))

    planned = level[:, None, :2].double().cpu().numpy()
    best, size = planned, SIDE / 2
    cell = np.linspace(-1, 1, 41)
    grid = np.stack(np.meshgrid(cell, cell), axis=-1).reshape(1, -1, 2)
    for _ in range(4):
        around = np.clip(best + size * grid, 0, SIDE)
        best = np.take_along_axis(around, value(around).argmax(1)[:, None, None], 1)
        size /= 8
    loss = (value(best) - value(planned))[:, 0]
    away = np.linalg.norm(best - planned, axis=-1)
    return {
        "auvs": auvs,
        "objective": name,
        "slope": slope,
        "layouts": count,
        "median_loss": float(np.median(loss)),
        "largest_loss": float(loss.max()),
        "median_distance": float(np.median(away)),
    }


def measure(teams: tuple[int, ...], trials: int, tables: int, seconds: float) -> dict[str, object]:
    """All figures."""
    return {
        "machine": describe(),
        "plans": [measure_team(auvs, name, trials, seconds) for auvs in teams for name in CODES],
        "unequal": [measure_unequal(name, teams, tables) for name in ALL_CODES],
        "tilt": [measure_tilt(auvs, name, 100) for auvs in teams[:2] for name in CODES if not name.startswith("sum")],
    }


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--trials", type=int, default=1200, help="random layouts the gap is searched over")
    parser.add_argument("--tables", type=int, default=18, help="tables of unequal links, for each number of AUVs")
    parser.add_argument("--seconds", type=float, default=1.0, help="time spent on each rate, s")
    arguments = parse(parser)
    show(measure(TEAMS, arguments.trials, arguments.tables, arguments.seconds), arguments.json)


if __name__ == "__main__":
    main()
