"""Cases with solutions of the differential equations: standing, forced, damped and running waves, and a hill."""

import math

import numpy as np

from tests.cases.case import Case
from tests.cases.plain import GRAVITY, SIDES, centres, faces, from_wall, many, waves
from usvauv.kernels.shallow_water.linear import ShallowWater

SECOND = (1.9, 2.2)


def rms(difference: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.abs(difference) ** 2)))


def standing_wave(n: int) -> dict[str, float]:
    """At t = T/8; at t = T, where elevation is at its extreme again, the error would falsely be of fourth order."""
    X, Y, h = 100.0, 70.0, 30.0
    k, m = 2 * math.pi / X, math.pi / Y
    omega = math.sqrt(GRAVITY * h * (k**2 + m**2))
    x, y = centres(n, X), centres(n, Y)[:, None]
    solver = ShallowWater(size=(X, Y), cells=(n, n), depth=h, interval=2 * math.pi / omega / 8)
    solver.set_state((np.cos(k * x) * np.cos(m * y))[None])
    solver.advance()
    speed = GRAVITY / omega * math.sin(math.pi / 4)
    u, v = solver.velocity()
    return {
        "η": rms(solver.elevation()[0] - np.cos(k * x) * np.cos(m * y) * math.cos(math.pi / 4)),
        "u": rms(u[0] - speed * k * np.sin(k * x) * np.cos(m * y)),
        "v": rms(v[0] - speed * m * np.cos(k * x) * np.sin(m * y)),
    }


def basin(
    n: int,
    kind: str,
    side: str,
    *,
    length: float,
    depth: float,
    period: float,
    drag: float = 0.0,
    phase: float = 0.0,
    pieces: int,
    intervals: int,
    num_seas: int,
) -> np.ndarray:
    """Rms errors of η and of the velocity across, from a start in the steady state, over some intervals of T/pieces.

    With s the distance from the wall and B = 1/cos kL beside a forced boundary, 2 e^{−ikL} beside an incident one:
    η = Re B cos ks e^{iωt}, u_s = Re B g k sin ks/(iω + r) e^{iωt}.
    """
    omega = 2 * math.pi / period
    k = np.sqrt((omega**2 - 1j * omega * drag) / (GRAVITY * depth))
    B = 1 / np.cos(k * length) if kind == "forced" else 2 * np.exp(-1j * k * length)
    across = side in ("west", "east")
    outward = -1 if side in ("west", "south") else 1
    cells, size = ((n, 5), (length, 5 * length / n)) if across else ((5, n), (5 * length / n, length))
    solver = ShallowWater(
        size=size,
        cells=cells,
        depth=depth,
        interval=period / pieces,
        drag=drag,
        boundaries={side: kind},
        num_seas=num_seas,
    )

    def field(shape, t):
        wave = np.broadcast_to((B * shape * np.exp(1j * (omega * t + phase))).real, (5, len(shape)))
        return many(wave if across else wave.T, num_seas)

    s, s_faces = (from_wall(points(n, length), side, length) for points in (centres, faces))
    speed = outward * GRAVITY * k / (1j * omega + drag)
    solver.set_forcing(*waves(1.0, period, phase, num_seas))
    solver.set_state(field(np.cos(k * s), 0), **{"u" if across else "v": field(speed * np.sin(k * s_faces), 0)})
    squares = np.zeros(2)
    for _ in range(intervals):
        solver.advance()
        t, velocity = solver.time, solver.velocity()[0 if across else 1]
        errors = solver.elevation() - field(np.cos(k * s), t), velocity - field(speed * np.sin(k * s), t)
        squares += [np.mean(error**2) for error in errors]
    return np.sqrt(squares / intervals)


def seiche(n: int) -> dict[str, float]:
    """All four boundaries, two seas, two periods of 30 s; the worst."""
    about = {"length": 200.0, "depth": 120.0, "period": 30.0, "phase": 0.6, "pieces": 7, "intervals": 14, "num_seas": 2}
    return dict(zip(("η", "u"), np.max([basin(n, "forced", side, **about) for side in SIDES], axis=0), strict=True))


def incident_wave(n: int) -> dict[str, float]:
    """Wave-maker beside open sea: at every boundary in turn, a wall opposite, three periods."""
    about = {"length": 300.0, "depth": 40.0, "period": 20.0, "phase": 0.7, "pieces": 5, "intervals": 15, "num_seas": 2}
    return {"η": max(basin(n, "incident", side, **about)[0] for side in SIDES)}


def damped_resonance(n: int) -> dict[str, float]:
    """At T = 4L/c, where the gain without drag is infinite, with r = ω/5: at the wall |1/cos kL| = 6.4."""
    T = 4 * 200.0 / math.sqrt(GRAVITY * 120.0)
    about = {"length": 200.0, "depth": 120.0, "period": T, "drag": 2 * math.pi / T / 5}
    errors = basin(n, "forced", "east", **about, pieces=7, intervals=7, num_seas=1)
    return dict(zip(("η", "u"), errors, strict=True))


GAIN_PERIODS = (10.0, 15.0, 20.0, 30.0, 45.0, 60.0)


def quarter_wave_gain(n: int) -> dict[str, float]:
    """Relative error of the gain in the last cell, from a start in the steady state, over 24 periods.

    They are weighted by Hann's window, which leaves out the free waves that the start makes on a grid. The scheme's own
    steady state is cos k̃s with its dispersion relation, and exactly 1/cos k̃L in the last cell.
    """
    L, h, samples = 200.0, 120.0, 24 * 8
    window = 1 - np.cos(2 * math.pi * (np.arange(samples) + 1) / samples)
    errors = {"against the scheme's": 0.0}
    for T in GAIN_PERIODS:
        k = 2 * math.pi / T / math.sqrt(GRAVITY * h)
        gain = 1 / math.cos(k * L)
        solver = ShallowWater(size=(L, 4 * L / n), cells=(n, 4), depth=h, interval=T / 8, boundaries={"west": "forced"})
        solver.set_forcing(*waves(1.0, T))
        solver.set_state(np.broadcast_to(gain * np.cos(k * from_wall(centres(n, L), "west", L)), (1, 4, n)))
        wall = []
        for _ in range(samples):
            solver.advance()
            wall.append(solver.elevation()[0, 0, -1] * math.cos(2 * math.pi * solver.time / T))
        found = 2 * np.mean(window * wall)
        errors[f"T = {T:.0f} s"] = abs(found / gain - 1)
        courant = math.sqrt(GRAVITY * h) * solver.time_step / solver.dx
        discrete = 2 / solver.dx * math.asin(math.sin(math.pi * solver.time_step / T) / courant)
        missed = abs(found * math.cos(discrete * L) - 1)
        errors["against the scheme's"] = max(errors["against the scheme's"], missed)
    return errors


def resonant_growth(n: int) -> dict[str, float]:
    """From rest with sin ωt at the boundary, after 2, 4 and 6 periods.

    The solution is a sum of images, η(0, t) = 2 Σ (−1)^j f(t − (2j + 1) L/c): 2 more at each crest, twice a period.
    """
    L, h = 200.0, 120.0
    T = 4 * L / math.sqrt(GRAVITY * h)
    solver = ShallowWater(size=(L, 4 * L / n), cells=(n, 4), depth=h, interval=2 * T, boundaries={"east": "forced"})
    solver.set_forcing(*waves(1.0, T, -math.pi / 2))
    solver.set_state(np.zeros((1, 4, n)))
    errors = []
    for periods in (2, 4, 6):
        solver.advance()
        errors.append(abs(solver.elevation()[0, 0, 0] / (-4 * periods) - 1))
    return {"η": max(errors)}


def wave_maker(n: int) -> dict[str, float]:
    """Wave number between the boundary and a point that no wave from the far wall has reached, n cells to a wave.

    Waves of 12 s; the complex amplitude is that of the last of 12 periods, its wave number the slope of its phase.
    """
    T, h = 12.0, 50.0
    c = math.sqrt(GRAVITY * h)
    dx = c * T / n
    cells, near = 14 * n, 4 * n
    solver = ShallowWater(
        size=(cells * dx, 4 * dx), cells=(cells, 4), depth=h, interval=T / 16, boundaries={"west": "forced"}
    )
    solver.set_forcing(*waves(1.0, T))
    solver.set_state(np.zeros((1, 4, cells)))
    amplitude = np.zeros(near, complex)
    for step in range(1, 12 * 16 + 1):
        solver.advance()
        if step > 11 * 16:
            amplitude += solver.elevation()[0, 0, :near] * np.exp(-2j * math.pi * solver.time / T) / 8
    k = -np.polyfit(centres(near, near * dx), np.unwrap(np.angle(amplitude)), 1)[0]
    discrete = 2 / dx * math.asin(dx / (c * solver.time_step) * math.sin(math.pi * solver.time_step / T))
    return {"k against the scheme's": abs(k / discrete - 1), "speed against c": abs(2 * math.pi / T / k / c - 1)}


FINE = 512


def hill(n: int) -> dict[str, float]:
    """A hump of water beside a hill of half the depth, seen when it has run over the hill; the fine grid has 512²."""
    X, h = 400.0, 60.0

    def run(n: int) -> np.ndarray:
        x = centres(n, X)
        depth = h - h / 2 * np.exp(-((x - 220) ** 2 + (x[:, None] - 180) ** 2) / (2 * 50**2))
        eta = np.exp(-((x - 130) ** 2 + (x[:, None] - 200) ** 2) / (2 * 30**2))
        solver = ShallowWater(size=(X, X), cells=(n, n), depth=depth, interval=7.0)
        solver.set_state(eta[None])
        solver.advance()
        return solver.elevation()[0].astype(np.float64)

    # A coarse centre lies among the middle 2 × 2 of its fine cells.
    every, middle = FINE // n, FINE // n // 2
    fine = sum(run(FINE)[middle - i :: every, middle - j :: every] for i in (0, 1) for j in (0, 1)) / 4
    return {"η": rms(run(n) - fine) / rms(fine)}


CASES = (
    Case(
        "standing wave at T/8",
        "η = cos kx cos ly cos ωt, ω² = g h (k² + l²); rms",
        "d'Alembert",
        standing_wave,
        (16, 32, 64),
        {"η": 5e-5, "u": 4e-4, "v": 1e-4},
        {"η": SECOND, "u": SECOND, "v": SECOND},
    ),
    Case(
        "seiche, each boundary forced",
        "η = a cos kx/cos kL cos(ωt + φ), u = a (g k/ω) sin kx/cos kL sin(ωt + φ); rms of a = 1 and 2 m, T = 30 s",
        "Eq. 7",
        seiche,
        (40, 80, 160),
        {"η": 5e-5, "u": 1e-5},
        {"η": SECOND, "u": SECOND},
    ),
    Case(
        "quarter-wave gain",
        "|η(0)|/a = 1/|cos kL|, 10 to 60 s; relative",
        "Eq. 7 at the wall",
        quarter_wave_gain,
        (25, 50, 100),
        {"against the scheme's": 1e-5} | {f"T = {T:.0f} s": 1e-4 for T in GAIN_PERIODS},
        {f"T = {T:.0f} s": SECOND for T in GAIN_PERIODS if T <= 30},
    ),
    Case(
        "growth at resonance",
        "T = 4L/c from rest: η(0, nT) = −4 n a; relative, the worst of n = 2, 4, 6",
        "images at wall and boundary",
        resonant_growth,
        (30, 60, 120),
        {"η": 2e-4},
        {},
    ),
    Case(
        "peak of a damped resonance",
        "T = 4L/c: η = Re a cos kx/cos kL e^{iωt}, g h k² = ω² − iωr, r = ω/5; rms, a = 1 m, 6.4 m at the wall",
        "Eq. 7 with drag",
        damped_resonance,
        (20, 40, 80),
        {"η": 2e-4, "u": 6e-5},
        {"η": SECOND, "u": SECOND},
    ),
    Case(
        "wave-maker, n cells to a wave",
        "sin(ωΔt/2) = (cΔt/Δx) sin(kΔx/2); relative, and ω/k against c = √(g h)",
        "dispersion relation of the scheme",
        wave_maker,
        (10, 20, 40),
        {"k against the scheme's": 2e-6, "speed against c": 8e-4},
        {"speed against c": SECOND},
    ),
    Case(
        "wave-maker beside open sea",
        "boundary incident, wall at 0: η = 2 a cos kx cos(ωt − kL + φ); rms, a = 1 and 2 m",
        "d'Alembert",
        incident_wave,
        (40, 80, 160),
        {"η": 2e-4},
        {"η": SECOND},
    ),
    Case(
        "refraction over a hill",
        f"h = 60 − 30 exp(−r²/2·50²) m; relative rms to the same on {FINE} × {FINE} cells",
        "fine grid",
        hill,
        (32, 64, 128),
        {"η": 0.004},
        {"η": (1.9, 2.3)},
    ),
)
