"""The nonlinear cases of the table."""

import numpy as np

from tests.cases import solutions
from tests.cases.case import Case, relative_L1
from tests.cases.plain import SIDES, centres
from usvauv.kernels.shallow_water.nonlinear import NonlinearShallowWater


def dam_break(n: int, behind: float, before: float) -> dict[str, float]:
    x = centres(n, 10.0) - 5
    solver = solutions.channel(n, 10.0, bed=0.0, interval=6.0)
    solver.set_state(np.where(x < 0, behind, before))
    solver.advance()
    h, u = solutions.stoker(x, 6.0, behind, before) if before else solutions.ritter(x, 6.0, behind)
    computed = solver.depth()[0]
    return {"h": relative_L1(computed, h), "hu": relative_L1(computed * solver.velocity()[0][0], h * u)}


def radial(n: int, case: type[solutions.RadialDamBreak]) -> dict[str, float]:
    exact = case().exact(n)
    error = case().solve(n).depth() - exact
    return {"h": np.abs(error).sum() / exact.sum(), "h, rms": float(np.linalg.norm(error) / np.linalg.norm(exact))}


def thacker(n: int, case: type[solutions.Thacker]) -> dict[str, float]:
    """After a period; the shore on the row next to the middle, in cells."""
    exact = case(n)
    (solver,) = exact.solve(1)
    h, _, _ = exact.solution(exact.period)
    wet = exact.x[n // 2, solver.depth()[n // 2] > 2e-3 * exact.h0]
    west, east = exact.shores(exact.period, exact.y[n // 2, 0])
    ends = abs(wet.min() - solver.dx / 2 - west), abs(wet.max() + solver.dx / 2 - east)
    return {"h": relative_L1(solver.depth(), h), "shore": max(ends) / solver.dx}


def rest(n: int) -> dict[str, float]:
    """Over a rough bed with a dry peak, between walls and between boundaries of that elevation; the worst."""
    x, level, worst = centres(n, 200.0), 0.75, {"η": 0.0, "u": 0.0}
    bed = -120 + 140 * np.exp(-((x - 100) ** 2 + (x[:, None] - 90) ** 2) / 900)
    bed = bed + 3 * np.random.default_rng(0).normal(size=(n, n))
    for kind in ("wall", "forced"):
        sides = dict.fromkeys(SIDES, kind)
        solver = NonlinearShallowWater(size=(200, 200), cells=(n, n), bed=bed, interval=2.0, boundaries=sides)
        solver.set_forcing(np.array([level]), np.array([1e30]), np.zeros(1))
        solver.set_state(np.maximum(level, bed))
        before = solver.elevation()
        solver.advance()
        worst["η"] = max(worst["η"], np.abs(solver.elevation() - before).max())
        worst["u"] = max(worst["u"], np.abs(solver.velocity()).max())
    return worst


CASES = (
    Case(
        "Stoker's dam break",
        "rarefaction u + 2c = 2c_L, bore h_R | h_m by its jump conditions; 5 mm over 1 mm, 6 s; relative L1",
        "Stoker 1957; SWASHES 4.1.1",
        lambda n: dam_break(n, 5e-3, 1e-3),
        (200, 400),
        {"h": 1.4e-3, "hu": 8.6e-3},
        {},
    ),
    Case(
        "Ritter's dam break",
        "h = (2 c_L − x/t)²/9g; 5 mm over dry ground, 6 s; relative L1",
        "Ritter 1892; SWASHES 4.1.2",
        lambda n: dam_break(n, 5e-3, 0.0),
        (200, 400),
        {"h": 1.3e-3, "hu": 8.8e-3},
        {},
    ),
    Case(
        "radial dam break",
        "the equations in r, 1800 cells in f64; 10 m over 1 m, 0.69 s; relative L1",
        "one-dimensional reference",
        lambda n: radial(n, solutions.RadialDamBreak),
        (50, 100),
        {"h": 0.015, "h, rms": 0.028},
        {},
    ),
    Case(
        "radial dam break of PDEBench",
        "the equations in r, 4000 cells in f64; 2 m over 1 m, g = 1 m/s², 1 s; relative L1 and L2",
        "Takamoto et al. 2022; one-dimensional reference",
        lambda n: radial(n, solutions.PDEBench),
        (128, 256, 512),
        {"h": 7.0e-4, "h, rms": 2.6e-3},
        {"h": (0.5, 1.5)},
    ),
    Case(
        "Thacker's plane",
        "η = σ h0/a² (2x cos ωt + 2y sin ωt − σ), ω = √(2 g h0)/a, σ = a/2; one period",
        "Thacker 1981; SWASHES 4.2.2",
        lambda n: thacker(n, solutions.Plane),
        (50, 100),
        {"h": 0.0093, "shore": 2.0},
        {"h": (1.4, 2.5)},
    ),
    Case(
        "Thacker's paraboloid",
        "η = h0 (√(1 − A²)/(1 − A cos ωt) − 1 − r²/a² ((1 − A²)/(1 − A cos ωt)² − 1)); one period",
        "Thacker 1981; SWASHES 4.2.2",
        lambda n: thacker(n, solutions.Paraboloid),
        (50, 100),
        {"h": 0.0093, "shore": 2.0},
        {"h": (1.7, 2.5)},
    ),
    Case(
        "lake at rest round an island",
        "η = 0.75 m, u = 0 to the last bit",
        "—",
        rest,
        (64,),
        {"η": 0, "u": 0},
        {},
    ),
)
