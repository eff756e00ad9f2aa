"""Exact solutions of the nonlinear equations, whose formulas are written out here from where they were published.

SWASHES is Delestre et al. 2013, doi 10.1002/fld.3741 (section numbers of arXiv 1110.0288).
"""

import functools
import math

import numpy as np

from tests.cases.plain import GRAVITY as g
from tests.cases.plain import SIDES, centres
from usvauv.kernels.shallow_water.nonlinear import NonlinearShallowWater


def channel(cells: int, length: float, along_y: bool = False, **others) -> NonlinearShallowWater:
    """A channel of 4 cells across, along x or y."""
    size, grid = (length, 4 * length / cells), (cells, 4)
    return NonlinearShallowWater(
        size=size[::-1] if along_y else size, cells=grid[::-1] if along_y else grid, **{"dry": 1e-7} | others
    )


def stoker(x: np.ndarray, t: float, h_L: float, h_R: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth and velocity of a dam break on a wet bed, dam at x = 0 (Stoker 1957, "Water waves"; SWASHES 4.1.1)."""
    c_L = math.sqrt(g * h_L)
    low, high = h_R, h_L
    for _ in range(200):  # bisection: the rarefaction from the left must meet the bore into the right
        h_m = (low + high) / 2
        u_m = 2 * (c_L - math.sqrt(g * h_m))
        if u_m > (h_m - h_R) * math.sqrt(g * (h_m + h_R) / (2 * h_m * h_R)):
            low = h_m
        else:
            high = h_m
    xi, c_m, bore = x / t, math.sqrt(g * h_m), h_m * u_m / (h_m - h_R)
    where = [xi < -c_L, xi < u_m - c_m, xi < bore]
    fan = (2 * c_L - xi) / 3
    return np.select(where, [h_L, fan**2 / g, h_m], h_R), np.select(where, [0 * xi, 2 * (c_L - fan), u_m], 0)


def ritter(x: np.ndarray, t: float, h_L: float) -> tuple[np.ndarray, np.ndarray]:
    """Depth and velocity of a dam break on a dry bed, dam at x = 0 (Ritter 1892; SWASHES 4.1.2)."""
    c_L, xi = math.sqrt(g * h_L), x / t
    fan = (2 * c_L - xi) / 3
    where = [xi < -c_L, xi < 2 * c_L]
    return np.select(where, [h_L, fan**2 / g], 0), np.select(where, [0 * xi, 2 * (c_L - fan)], 0)


class RadialDamBreak:
    """Circular dam of 11 m with 10 m of water inside and 1 m outside, after 0.69 s, in a basin of 50 m.

    The reference is h and h u of the equations in r alone, solved here in f64: MUSCL with the monotonised-central
    limiter, Rusanov's flux, Heun. In shells of volume r Δr the pressure acts as (r_+ p_+ − r_- p_-)/(r Δr) − p/r.
    """

    radius, inside, outside, time, size, reach, gravity = 11.0, 10.0, 1.0, 0.69, 50.0, 36.0, g
    shells = 1800
    points = 16  # of a cell each way, over which `start` takes the mean

    def start(self, n: int) -> np.ndarray:
        """Depth at the beginning in n × n cells."""
        x = centres(self.points * n, self.size) - self.size / 2
        h = np.where(np.hypot(x, x[:, None]) <= self.radius, self.inside, self.outside)
        return h.reshape(n, self.points, n, self.points).mean(axis=(1, 3))

    def exact(self, n: int) -> np.ndarray:
        """Depth at the end in n × n cells, the mean over at least 4 × 4 points in each."""
        points = max(4, 2048 // n)
        x = centres(points * n, self.size) - self.size / 2
        depth = np.interp(np.hypot(x, x[:, None]), *self.reference())
        return depth.reshape(n, points, n, points).mean(axis=(1, 3))

    @classmethod
    @functools.cache
    def reference(cls) -> tuple[np.ndarray, np.ndarray]:
        """Radii and depths at the end."""
        n, g = cls.shells, cls.gravity
        dr = cls.reach / n
        r, faces = centres(n, cls.reach), np.arange(n + 1) * dr
        U = np.stack([np.where(r < cls.radius, cls.inside, cls.outside), np.zeros(n)])

        def tendency(U):
            W = np.stack([U[0], U[1] / U[0]])
            W = np.concatenate([W[:, 1::-1] * [[1], [-1]], W, W[:, -1:], W[:, -1:]], axis=1)
            d = np.diff(W, axis=1)
            below, above = abs(d[:, :-1]), abs(d[:, 1:])
            steepest = np.minimum(2 * np.minimum(below, above), (below + above) / 2)
            slope = np.where(d[:, 1:] * d[:, :-1] > 0, np.sign(d[:, 1:]) * steepest, 0)
            left, right = (W[:, 1:-1] + slope / 2)[:, :-1], (W[:, 1:-1] - slope / 2)[:, 1:]
            flux = [np.stack([h * u, h * u * u + g * h * h / 2]) for h, u in (left, right)]
            speed = np.maximum(*(abs(u) + np.sqrt(g * h) for h, u in (left, right)))
            jump = np.stack([right[0] - left[0], right[0] * right[1] - left[0] * left[1]])
            F = faces * ((flux[0] + flux[1]) / 2 - speed * jump / 2)
            rate = -np.diff(F, axis=1) / (r * dr)
            rate[1] += g * U[0] ** 2 / 2 / r
            return rate, speed.max()

        t = 0.0
        while t < cls.time:
            rate, speed = tendency(U)
            dt = min(0.4 * dr / speed, cls.time - t)
            first = U + dt * rate
            U = (U + first + dt * tendency(first)[0]) / 2
            t += dt
        return r, U[0]

    def solver(self, n: int) -> NonlinearShallowWater:
        """At the beginning; an interval leads to the end."""
        solver = NonlinearShallowWater(
            size=(self.size, self.size),
            cells=(n, n),
            bed=-self.outside,
            interval=self.time,
            gravity=self.gravity,
            boundaries=dict.fromkeys(SIDES, "radiating"),
        )
        solver.set_state(self.start(n) - self.outside)
        return solver

    def solve(self, n: int) -> NonlinearShallowWater:
        """At the end."""
        solver = self.solver(n)
        solver.advance()
        return solver


class PDEBench(RadialDamBreak):
    """The radial dam break of PDEBench (Takamoto et al. 2022, arXiv 2210.07182): a start at points, g = 1 m/s²."""

    radius, inside, outside, time, size, reach, gravity = 0.5, 2.0, 1.0, 1.0, 5.0, 2.5, 1.0
    shells = 4000
    points = 1


class Thacker:
    """Oscillations in the paraboloid b = −h0 (1 − r²/a²), h0 = 0.1 m, a = 1 m, in a square of 4 m, shores free to move.

    Thacker 1981, doi 10.1017/S0022112081001882; SWASHES 4.2.2 with its numbers.
    """

    h0, a, size = 0.1, 1.0, 4.0

    def __init__(self, cells: int) -> None:
        x = centres(cells, self.size) - self.size / 2
        self.x, self.y = np.meshgrid(x, x)
        self.r2 = self.x**2 + self.y**2
        self.bed = -self.h0 * (1 - self.r2 / self.a**2)

    def solution(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depth, u and v."""
        surface, u, v = self.surface_and_velocity(t)
        h = np.maximum(surface - self.bed, 0)
        return h, np.where(h > 0, u, 0), np.where(h > 0, v, 0)

    def solve(self, periods: float, pieces: int = 1):
        solver = NonlinearShallowWater(
            size=(self.size, self.size),
            cells=self.bed.shape,
            bed=self.bed,
            interval=self.period * periods / pieces,
            dry=1e-6,
        )
        surface, u, v = self.surface_and_velocity(0)
        solver.set_state(surface, u, v)
        for _ in range(pieces):
            solver.advance()
            yield solver


class Plane(Thacker):
    """The surface stays a plane; its lowest point goes round."""

    eta = 0.5
    omega = math.sqrt(2 * g * Thacker.h0) / Thacker.a
    period = 2 * math.pi / omega

    def surface_and_velocity(self, t):
        c, s = math.cos(self.omega * t), math.sin(self.omega * t)
        surface = self.eta * self.h0 / self.a**2 * (2 * self.x * c + 2 * self.y * s - self.eta)
        return surface, -self.eta * self.omega * s + 0 * self.x, self.eta * self.omega * c + 0 * self.x

    def shores(self, t, y):
        """Western and eastern end of the water at y: it is a circle of radius a round η (cos ωt, sin ωt)."""
        half = math.sqrt(self.a**2 - (y - self.eta * math.sin(self.omega * t)) ** 2)
        middle = self.eta * math.cos(self.omega * t)
        return middle - half, middle + half


class Paraboloid(Thacker):
    """The surface stays a paraboloid, which at first reaches out to r0 = 0.8 m."""

    r0 = 0.8
    A = (Thacker.a**2 - r0**2) / (Thacker.a**2 + r0**2)
    omega = math.sqrt(8 * g * Thacker.h0) / Thacker.a
    period = 2 * math.pi / omega

    def surface_and_velocity(self, t):
        A, d = self.A, 1 - self.A * math.cos(self.omega * t)
        surface = math.sqrt(1 - A * A) / d - 1 - self.r2 / self.a**2 * ((1 - A * A) / d**2 - 1)
        speed = self.omega * A * math.sin(self.omega * t) / (2 * d)
        return self.h0 * surface, speed * self.x, speed * self.y

    def shores(self, t, y):
        d = 1 - self.A * math.cos(self.omega * t)
        half = math.sqrt(self.a**2 * d / math.sqrt(1 - self.A**2) - y**2)
        return -half, half
