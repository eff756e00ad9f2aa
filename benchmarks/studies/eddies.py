"""Eddies of a scenario beside the equations that they approximate: how far vortices that keep their shape go astray.

    python -m benchmarks.studies.eddies                              # `extreme`
    python -m benchmarks.studies.eddies wide --draws 4 --points 256

The vorticity equation of an ideal fluid, ∂ζ/∂t + c V·∇ζ = 0 with the column's share c of the surface velocity
(`usvauv.env.site.Site.eddies`), is solved by a pseudo-spectral method in the doubly periodic square of the scenario,
from the vorticity of the scenario's own draws. The error is the rms difference of velocity over the square, relative to
the rms velocity. Vortices that merge, and deform one another, are what the model leaves out.
"""

from __future__ import annotations

import argparse

import numpy as np
import torch

from usvauv.env import Scenario
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import first_vortices
from usvauv.kernels.flow import vortex, vortex_motion

TIMES = (100, 200, 500, 1000)  # s
COURANT = 0.5  # of a grid cell that the fastest water crosses in a step


class PeriodicFlow:
    """Two-dimensional flow in a square with periodic sides: Fourier series, the 2/3 rule, Runge–Kutta of fourth order.

    Args:
        vorticity: (..., N, N) at x, y = 0, L/N, …, 1/s. side: L, m. viscosity: m²/s.
        advection: velocity that carries the vorticity over that which belongs to it.
    """

    def __init__(self, vorticity: np.ndarray, side: float, viscosity: float = 0.0, advection: float = 1.0) -> None:
        n = vorticity.shape[-1]
        k = 2 * np.pi / side * np.fft.fftfreq(n, 1 / n)
        self.kx, self.ky = k[: n // 2 + 1].copy(), k[:, None]
        self.kx[-1] = abs(self.kx[-1])
        square = self.kx**2 + self.ky**2
        self.keep = (abs(self.kx) < k.max() * 2 / 3) & (abs(self.ky) < k.max() * 2 / 3)
        self.inverse = np.where(square > 0, 1 / np.where(square > 0, square, 1), 0)
        self.viscosity, self.square, self.advection, self.cell = viscosity, square, advection, side / n
        self.spectrum = np.fft.rfft2(vorticity) * self.keep

    def velocity(self, spectrum: np.ndarray | None = None) -> np.ndarray:
        """(2, ..., N, N), m/s."""
        psi = (self.spectrum if spectrum is None else spectrum) * self.inverse
        return np.fft.irfft2(np.stack([1j * self.ky * psi, -1j * self.kx * psi]))

    def _tendency(self, spectrum: np.ndarray) -> np.ndarray:
        slope = np.fft.irfft2(np.stack([1j * self.kx * spectrum, 1j * self.ky * spectrum]))
        carried = np.fft.rfft2((self.velocity(spectrum) * slope).sum(0)) * self.keep
        return -self.advection * carried - self.viscosity * self.square * spectrum

    def advance(self, time: float) -> None:
        """Go on for a time, s."""
        fastest = self.advection * abs(self.velocity()).max()
        steps = max(1, int(np.ceil(time * fastest / (COURANT * self.cell))))
        dt = time / steps
        for _ in range(steps):
            a = self._tendency(self.spectrum)
            b = self._tendency(self.spectrum + dt / 2 * a)
            c = self._tendency(self.spectrum + dt / 2 * b)
            d = self._tendency(self.spectrum + dt * c)
            self.spectrum = self.spectrum + dt / 6 * (a + 2 * b + 2 * c + d)


def vorticity(vortices: np.ndarray, side: float, n: int) -> np.ndarray:
    """Of Gaussian cores (..., V, 4) and their images on a grid, (..., N, N), 1/s."""
    at = side / n * np.arange(n)
    x, y, Gamma, delta = np.moveaxis(vortices[..., None, None], -3, 0)
    dx, dy = (way - side * np.round(way / side) for way in (at - x, at[:, None] - y))
    return np.sum(Gamma / (np.pi * delta**2) * np.exp(-(dx**2 + dy**2) / delta**2), axis=-3)


def errors(scenario: Scenario, draws: int, n: int) -> np.ndarray:
    """Relative rms errors of velocity, (draws, times)."""
    site, current = Site(scenario), scenario.current
    side = current.period
    centres = torch.cat([first_vortices(scenario, seed) for seed in range(draws)])
    start = vorticity(centres.double().cpu().numpy(), side, n)
    flow = PeriodicFlow(start, side, current.viscosity, site.eddies.column)
    grid = np.stack(np.meshgrid(*2 * [side / n * np.arange(n)]), axis=-1).reshape(1, -1, 2)
    points = torch.tensor(grid, dtype=torch.float32, device=centres.device).expand(draws, -1, -1).contiguous()
    step = vortex_motion.evolution(centres, scenario.mission.step, current.viscosity, current.mutual, site.eddies)
    found, now = [], 0.0
    for time in (0, *TIMES):
        if time:
            flow.advance(time - now)
            for _ in range(round((time - now) / scenario.mission.step)):
                step()
        now = time
        model = vortex.sample_current(centres, points, side).double().cpu().numpy().reshape(draws, n, n, 2)
        exact = np.moveaxis(flow.velocity(), 0, -1)
        wrong, whole = (np.sum(field**2, axis=(1, 2, 3)) for field in (model - exact, exact))
        found.append(np.sqrt(wrong / whole))
    return np.stack(found, axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", nargs="?", default="extreme")
    parser.add_argument("--set", dest="overrides", action="append", default=[], help="a scenario's field")
    parser.add_argument("--draws", type=int, default=8)
    parser.add_argument("--points", type=int, default=256, help="along a side of the square")
    given = parser.parse_args()
    scenario = Scenario.load(given.scenario, given.overrides)
    found = errors(scenario, given.draws, given.points)
    print(f"{scenario.name}: relative rms error of the velocity, {given.draws} draws")
    print("time, s   median   mean   largest")
    for time, column in zip((0, *TIMES), found.T, strict=True):
        print(f"{time:7d}   {np.median(column):6.3f} {column.mean():6.3f}   {column.max():7.3f}")


if __name__ == "__main__":
    main()
