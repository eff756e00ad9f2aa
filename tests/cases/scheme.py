"""Cases that hold for the scheme itself, to rounding: eigenmodes, invariants, and rest.

Their errors are in units of what rounding may do. A state variable is rounded about four times a substep, each time by
at most half a unit in the last place, 2⁻²⁴; such errors add up like a random walk over the substeps, or, where they are
systematic (a rounded coefficient is a slightly different wave speed), in proportion to them.
"""

import math

import numpy as np

from tests.cases.case import Case
from tests.cases.plain import GRAVITY, ROUNDING, centres, many, rough_bed, waves
from usvauv.kernels.shallow_water.linear import ShallowWater


def eigenmode(n: int) -> dict[str, float]:
    """Over three intervals, alone and three seas at once; the worst of it.

    n + ½ half waves fit between a wall and a side held at zero. The rounded coefficients change ω̃ by at most ½ 2⁻²⁴.
    """
    nx, ny, X, Y, h = n, n - 15, 130.0, 90.0, 80.0
    worst = 0.0
    modes = [(3, 2, {}), (nx - 1, ny - 3, {}), (2.5, 3, {"east": "forced"})]
    for mode_x, mode_y, boundaries in modes:
        for num_seas in (1, 3):
            solver = ShallowWater(
                size=(X, Y), cells=(nx, ny), depth=h, interval=3.0, boundaries=boundaries, num_seas=num_seas
            )
            k, m = mode_x * math.pi / X, mode_y * math.pi / Y
            mode = np.cos(m * centres(ny, Y))[:, None] * np.cos(k * centres(nx, X))
            solver.set_state(many(mode, num_seas))
            inner = (math.sin(k * solver.dx / 2) / solver.dx) ** 2 + (math.sin(m * solver.dy / 2) / solver.dy) ** 2
            turn = 2 * math.asin(solver.time_step * math.sqrt(GRAVITY * h * inner))
            for interval in (1, 2, 3):
                solver.advance()
                steps = interval * solver.substeps
                bound = num_seas * ROUNDING * (steps * turn / 2 + 4 * math.sqrt(steps))
                error = np.abs(solver.elevation() - many(math.cos(turn * steps) * mode, num_seas)).max()
                worst = max(worst, error / bound)
    return {"η": worst}


def invariants(n: int) -> dict[str, float]:
    """Noise over a rough bed with an island, over three intervals: one sea, three seas at once, and one sea beside
    boundaries held at zero (there only energy).

    Coefficients are the same on both sides of a face, so that their rounding is one of the depth and leaves both exact.
    """
    nx, ny = n, n - 15
    worst = {"mass": 0.0, "energy": 0.0}
    for num_seas, boundaries in ((1, {}), (3, {}), (1, {"north": "forced", "east": "forced"})):
        solver = ShallowWater(
            size=(130, 90),
            cells=(nx, ny),
            depth=rough_bed(nx, ny),
            interval=20.0,
            boundaries=boundaries,
            num_seas=num_seas,
        )
        solver.set_state(np.random.default_rng(2).normal(size=(num_seas, ny, nx)))
        mass, energy = solver.mass(), solver.energy()
        scale = math.sqrt(nx * ny) * solver.dx * solver.dy
        for interval in (1, 2, 3):
            solver.advance()
            walk = ROUNDING * math.sqrt(interval * solver.substeps)
            worst["energy"] = max(worst["energy"], np.abs(solver.energy() / energy - 1).max() / walk)
            if not boundaries:
                worst["mass"] = max(worst["mass"], np.abs(solver.mass() - mass).max() / (4 * walk * scale))
    return worst


def rest(n: int) -> dict[str, float]:
    """Water of one level over the rough bed, between walls and at a boundary of that elevation."""
    level, worst = 0.75, {"η": 0.0, "u": 0.0}
    for boundaries in ({}, {"north": "forced"}, {"west": "forced", "east": "forced"}):
        nx, ny = n, n - 13
        solver = ShallowWater(
            size=(66, 40), cells=(nx, ny), depth=rough_bed(nx, ny), interval=5.0, boundaries=boundaries
        )
        solver.set_forcing(*waves(level, 1e30))
        solver.set_state(np.full((1, ny, nx), level))
        before = solver.elevation()
        solver.advance()
        worst["η"] = max(worst["η"], np.abs(solver.elevation() - before).max())
        worst["u"] = max(worst["u"], np.abs(solver.velocity()).max())
    return worst


CASES = (
    Case(
        "discrete eigenmode",
        "η = cos kx cos ly cos(ω̃ n Δt), sin²(ω̃Δt/2) = g h Δt² (sin²(kΔx/2)/Δx² + sin²(lΔy/2)/Δy²); "
        "error over 2⁻²⁴ (n ω̃Δt/2 + 4 √n)",
        "von Neumann's analysis of the scheme",
        eigenmode,
        (40,),
        {"η": 1.0},
        {},
    ),
    Case(
        "mass and energy",
        "Σ η Δx Δy and ½ Δx Δy Σ (g η² + U⁻U⁺/h + V⁻V⁺/h) stay; change over 4 · 2⁻²⁴ √n √cells and 2⁻²⁴ √n",
        "summation by parts",
        invariants,
        (40,),
        {"mass": 1.0, "energy": 1.0},
        {},
    ),
    Case("lake at rest over a bump", "η = 0.75 m, u = 0 to the last bit", "—", rest, (33,), {"η": 0.0, "u": 0.0}, {}),
)
