"""What comes back from a radiating boundary: packets of waves, against the theory of the scheme.

All lengths are in cells, Δx = Δy = 1. A packet of waves a(k) e^{i(ωt + kx)} cos ly runs west at an angle θ,
tan θ = l/k, towards the boundary at x = 0; the velocities it starts with are those of the scheme's own waves, so that
nothing else is there. The measured reflection is √(energy after it has come back / energy before). The theory adds up
|ρ(k)|² over the packet, ρ of the scheme's harmonic waves.
"""

import math
from dataclasses import dataclass

import numpy as np

from tests.cases.case import Case
from tests.cases.plain import GRAVITY, SIDES, centres, faces
from usvauv.kernels.shallow_water.linear import ShallowWater

DEPTH = 50.0
CELERITY = math.sqrt(GRAVITY * DEPTH)


@dataclass(frozen=True)
class Packet:
    """Waves of `points` cells at an angle (degrees) to the normal of the western boundary."""

    points: int
    angle: float

    def grid(self) -> tuple[int, int, float]:
        """Cells nx and ny, half a wave along the boundary, and the mean wave number kx."""
        theta = math.radians(self.angle)
        ny = max(4, round(self.points / 2 / max(math.sin(theta), 1e-9))) if self.angle else 4
        kx = math.pi / ny / math.tan(theta) if self.angle else 2 * math.pi / self.points
        return round(9 * self.width(kx)), ny, kx

    @staticmethod
    def width(kx: float) -> float:
        """Standard deviation of the packet: two waves."""
        return 2 * 2 * math.pi / kx

    def run(self) -> tuple[float, float]:
        """Reflection measured and in theory."""
        nx, ny, kx = self.grid()
        ky = math.pi / ny if self.angle else 0.0
        width = self.width(kx)
        there = 4.5 * width
        time = 2 * 4.5 * width / (CELERITY * math.cos(math.radians(self.angle)))
        solver = ShallowWater(
            size=(nx, ny),
            cells=(nx, ny),
            depth=DEPTH,
            interval=time,
            boundaries={"west": "radiating"},
        )
        courant = CELERITY * solver.time_step
        k = kx + np.linspace(-5, 5, 401) / width
        a = np.exp(-(((k - kx) * width) ** 2) / 2 - 1j * k * there)
        half = np.arcsin(courant * np.sqrt(np.sin(k / 2) ** 2 + math.sin(ky / 2) ** 2))  # ωΔt/2
        x, y = centres(nx, nx), centres(ny, ny)[:, None]
        wave_x = lambda x, amplitude: np.exp(1j * np.outer(x, k)) @ amplitude  # noqa: E731
        u = -courant * CELERITY / DEPTH * np.sin(k / 2) / np.tan(half)
        v = courant * CELERITY / DEPTH * math.sin(ky / 2) / (1j * np.tan(half))
        solver.set_state(
            (wave_x(x, a) * np.cos(ky * y)).real[None],
            (wave_x(faces(nx, nx), a * u) * np.cos(ky * y)).real[None],
            (wave_x(x, a * v) * np.sin(ky * faces(ny, ny)[:, None])).real[None],
        )
        before = solver.energy()[0]
        solver.advance()
        theory = np.array([self.theory(kk, ky, courant) for kk in k])
        weight = np.abs(a) ** 2
        return math.sqrt(solver.energy()[0] / before), math.sqrt((theory**2 * weight).sum() / weight.sum())

    def theory(self, kx: float, ky: float, courant: float) -> float:
        """|ρ| of a harmonic wave.

        ρ = (s cos ωΔt/2 − cos kΔx/2)/(s cos ωΔt/2 + cos kΔx/2), s = (cΔt/Δx) sin kΔx/2/sin ωΔt/2 → cos θ.
        """
        half = math.asin(courant * math.hypot(math.sin(kx / 2), math.sin(ky / 2)))
        s = courant * math.sin(kx / 2) / math.sin(half) * math.cos(half)
        return abs((s - math.cos(kx / 2)) / (s + math.cos(kx / 2)))


def radiating(n: int) -> dict[str, float]:
    """n cells to a wave."""
    normal, oblique = Packet(n, 0).run(), Packet(n, 45).run()
    return {
        "ρ at 0°": normal[0],
        "ρ at 0° against theory": abs(normal[0] - normal[1]),
        "ρ at 45°": oblique[0],
        "ρ at 45° against theory": abs(oblique[0] - oblique[1]),
    }


def pulse(n: int) -> dict[str, float]:
    """Energy left of a round hump in the middle of a square, all sides radiating, when each ray has met one of them.

    A ray that meets a boundary at θ keeps tan⁴ θ/2 of its energy; rays are even over 0 to 45°. Some have met a second
    boundary by then, so that this is a bound.
    """
    x = centres(n, 1.0)
    r2 = (x - 0.5) ** 2 + (x[:, None] - 0.5) ** 2
    interval = (math.sqrt(0.5) + 0.15) / CELERITY
    solver = ShallowWater(
        size=(1.0, 1.0), cells=(n, n), depth=DEPTH, interval=interval, boundaries=dict.fromkeys(SIDES, "radiating")
    )
    solver.set_state(np.exp(-r2 / (2 * 0.04**2))[None])
    before = solver.energy()[0]
    solver.advance()
    theta = centres(1000, math.pi / 4)
    return {"energy over the bound": solver.energy()[0] / before / np.mean(np.tan(theta / 2) ** 4)}


def drain(n: int) -> dict[str, float]:
    """A channel filled 1 m too high, seen each quarter of the time L/c that the wave front takes."""
    L = 100.0
    solver = ShallowWater(
        size=(L, 4 * L / n), cells=(n, 4), depth=DEPTH, interval=L / CELERITY / 4, boundaries={"west": "radiating"}
    )
    solver.set_state(np.ones((1, 4, n)))
    errors = []
    for quarter in range(1, 17):
        solver.advance()
        exact = max(1 - quarter / 8, 0)  # half of it leaves with the first front, half after the wall
        errors.append(abs(solver.elevation().mean() - exact))
    return {"mean η": max(errors), "mean η after 4 L/c": errors[-1]}


CASES = (
    Case(
        "radiating boundary, n cells to a wave",
        "ρ = (s cos ωΔt/2 − cos kΔx/2)/(s cos ωΔt/2 + cos kΔx/2) → (1 − cos θ)/(1 + cos θ), "
        "s = (cΔt/Δx) sin kΔx/2/sin ωΔt/2",
        "harmonic waves put into the scheme",
        radiating,
        (10, 20, 40),
        {"ρ at 0°": 0.001, "ρ at 0° against theory": 2e-5, "ρ at 45°": 0.173, "ρ at 45° against theory": 5e-4},
        {"ρ at 0°": (1.9, 2.1), "ρ at 45°": (-0.02, 0.02)},
    ),
    Case(
        "a pulse leaves, all boundaries radiating",
        "energy left ≤ 4/π ∫ tan⁴ θ/2 dθ, θ = 0 … 45°",
        "geometrical optics",
        pulse,
        (64, 128),
        {"energy over the bound": 1.0},
        {},
    ),
    Case(
        "a basin filled too high drains",
        "mean η = max(1 − ct/2L, 0): worst of t = L/4c … 4L/c",
        "d'Alembert",
        drain,
        (50, 100, 200),
        {"mean η": 0.01, "mean η after 4 L/c": 1e-3},
        {},
    ),
)
