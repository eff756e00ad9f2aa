"""The nonlinear solver against closed forms and the linear solver, and its invariants.

Tolerances are the measured errors with 10 to 20% to spare.
"""

import dataclasses
import math

import numpy as np
import pytest

from tests.cases.case import order, relative_L1
from tests.cases.plain import GRAVITY as g
from tests.cases.plain import SIDES, centres, from_wall
from tests.cases.solutions import channel
from usvauv.kernels import runtime
from usvauv.kernels.shallow_water import nonlinear
from usvauv.kernels.shallow_water.linear import ShallowWater
from usvauv.kernels.shallow_water.nonlinear import NonlinearShallowWater


def start(solver: NonlinearShallowWater, along_y: bool, eta: np.ndarray, u: np.ndarray | float = 0.0) -> None:
    """Give a channel an elevation and a velocity along it, (n,)."""
    eta, u = (np.broadcast_to(f, (4, len(eta))) for f in (eta, u))
    solver.set_state(eta.T if along_y else eta, **{"v": u.T} if along_y else {"u": u})


def along(field: np.ndarray, along_y: bool) -> np.ndarray:
    """A field of a channel, (4, n)."""
    return field.T if along_y else field


class TestRunUp:
    def test_solitary_wave_runs_up_a_beach(self):
        """η = H sech² before a beach of 1 : 19.85 under 1 m of water: R = 2.831 √cot β H^(5/4) (m).

        Synolakis 1987, doi 10.1017/S002211208700329X, for waves that do not break.
        """
        n, length, shore, cot, H = 1600, 90.0, 10.0, 19.85, 0.0185
        x = centres(n, length) - shore
        bed = np.maximum(-1.0, -x / cot)
        k = math.sqrt(3 * H / 4)
        wave = H / np.cosh(k * (x - cot - math.acosh(math.sqrt(20)) / k)) ** 2
        solver = channel(n, length, bed=np.tile(bed, (4, 1)), interval=0.2, dry=1e-5)
        solver.set_state(np.tile(np.maximum(wave, bed), (4, 1)), u=np.tile(-math.sqrt(g) * wave, (4, 1)))
        highest = 0.0
        while solver.time < 20:
            solver.advance()
            depth = solver.depth()[0]
            highest = max(highest, (bed + depth)[depth > 1e-4][0])
        assert highest == pytest.approx(2.831 * math.sqrt(cot) * H**1.25, rel=0.01)


class TestSmooth:
    @pytest.mark.parametrize("along_y", [False, True])
    def test_simple_wave_is_second_order(self, along_y):
        """A hump running into still water, half way to breaking: c = √(gh) is constant along x = x0 + (3c − 2c0) t."""
        h0, t = 1.0, 0.3
        c0 = math.sqrt(g * h0)
        points = np.linspace(0, 10, 200001)
        c = c0 * (1 + 0.1 * np.exp(-((points - 3) ** 2) * 2))
        moved = points + (3 * c - 2 * c0) * t
        assert np.diff(moved).min() > 0.3 * (points[1] - points[0])  # not broken, but steeper
        errors = []
        for n in (100, 200, 400):
            average = lambda at, n=n: np.interp(centres(20 * n, 10), at, c).reshape(n, 20)  # noqa: E731
            begin, end = ([(s**2 / g).mean(1), 2 * (s.mean(1) - c0)] for s in (average(points), average(moved)))
            solver = channel(n, 10, along_y, bed=-h0, interval=t)
            start(solver, along_y, begin[0] - h0, begin[1])
            solver.advance()
            found = solver.depth(), solver.velocity()[along_y]
            errors.append([np.abs(along(f, along_y) - e).mean() for f, e in zip(found, end, strict=True)])
        for series in zip(*errors, strict=True):
            assert order(series) > 1.8


class TestAgainstLinear:
    """Where waves are small both solvers must agree, over a hill rising from 120 to 60 m."""

    def both(self, n: int, amplitude: float) -> tuple[np.ndarray, np.ndarray]:
        x = centres(n, 200)
        depth = 120 - 60 * np.exp(-((x - 120) ** 2 + (x[:, None] - 90) ** 2) / 1500)
        eta = amplitude * np.exp(-((x - 70) ** 2 + (x[:, None] - 90) ** 2) / 800)
        linear = ShallowWater(size=(200, 200), cells=(n, n), depth=depth, interval=4.0)
        solver = NonlinearShallowWater(size=(200, 200), cells=(n, n), bed=-depth, interval=4.0)
        linear.set_state(eta[None])
        solver.set_state(eta)
        linear.advance()
        solver.advance()
        return solver.elevation() / amplitude, linear.elevation()[0] / amplitude

    def test_small_waves_agree(self):
        errors = [relative_L1(*self.both(n, 1e-3)) for n in (64, 128)]
        assert errors[-1] < 0.011
        assert order(errors) > 1.8

    def test_rounding_is_that_of_the_wave(self):
        """A wave of a micrometre on 120 m comes out like one of a millimetre, where one ulp of the depth is 8 µm."""
        small, large = (self.both(64, a)[0] for a in (1e-6, 1e-3))
        np.testing.assert_allclose(small, large, atol=1e-4 * np.abs(large).max())


class TestBoundaries:
    @pytest.mark.cpu("the same bits of sums in another order")
    @pytest.mark.parametrize("axis", [0, 1])
    def test_wall_is_a_mirror(self, axis):
        """Half of a flow that is symmetric, behind a wall in the middle: the same bits."""
        half = rough_water()
        mirrored = lambda f, sign=1: np.concatenate([f, sign * np.flip(f, axis)], axis)  # noqa: E731
        eta = np.where(half.depth() > 0, half.elevation(), -100.0)
        velocities = half.velocity()
        cells, size = (half.nx, half.ny), (half.nx * half.dx, half.ny * half.dy)
        twice = (1, 2) if axis == 0 else (2, 1)
        whole = NonlinearShallowWater(
            size=tuple(np.multiply(size, twice)),
            cells=tuple(np.multiply(cells, twice)),
            bed=mirrored(half.bed),
            interval=2.0,
        )
        signs = (1, -1) if axis == 0 else (-1, 1)
        whole.set_state(mirrored(eta), *(mirrored(f, sign) for f, sign in zip(velocities, signs, strict=True)))
        half.set_state(eta, *velocities)
        whole.advance()
        half.advance()
        np.testing.assert_array_equal(whole.depth()[: half.ny, : half.nx], half.depth())

    @pytest.mark.parametrize("side", SIDES)
    @pytest.mark.parametrize("kind", ["radiating", "incident"])
    def test_open_boundary_lets_waves_out(self, side, kind):
        """A hump of 40 m length on 10 m of water leaves; the rest, as a fraction of its height."""
        n, h, amplitude = 200, 10.0, 2.0
        x = from_wall(centres(n, 200.0), side, 200.0)
        along_y = side in ("south", "north")
        outward = 1 if side in ("east", "north") else -1
        solver = channel(n, 200.0, along_y, bed=-h, interval=180 / math.sqrt(g * h), boundaries={side: kind})
        eta = amplitude * np.exp(-(((x - 100) / 20) ** 2))
        u = outward * 2 * (np.sqrt(g * (h + eta)) - math.sqrt(g * h))  # a simple wave
        start(solver, along_y, eta, u)
        solver.advance()
        assert np.abs(solver.elevation()).max() < 0.003 * amplitude

    @pytest.mark.parametrize("kind", ["wall", "radiating", "incident", "forced"])
    def test_noise_does_not_grow(self, kind):
        """Small waves a cell long, over a flat bed and over beds that rise and fall by 30 and 70 % of the depth."""
        random = np.random.default_rng(0)
        for roughness in (0.0, 3.0, 7.0):
            bed = -10 + roughness * random.uniform(-1, 1, (40, 40))
            boundaries = dict.fromkeys(SIDES, kind)
            solver = NonlinearShallowWater(size=(40, 40), cells=(40, 40), bed=bed, interval=20.0, boundaries=boundaries)
            solver.set_state(*(1e-3 * random.normal(size=(3, 40, 40))))
            speeds = []
            for _ in range(4):
                solver.advance()
                speeds.append(np.abs(solver.velocity()).max())
            assert np.abs(solver.elevation()).max() < 1e-3
            assert speeds[-1] < 0.9 * speeds[0] < 2e-3

    @pytest.mark.parametrize("side", ["west", "north"])
    def test_high_wave_enters_incident_boundary_and_leaves_radiating_one(self, side):
        """E = a (1 − cos ωt)/2 of a tenth of the depth: a simple wave, η = E(s) at x = (3c(s) − 2c0) (t − s)."""
        h, a, T, L, t = 10.0, 1.0, 10.0, 100.0, 9.0
        c0 = math.sqrt(g * h)
        entry = np.linspace(t, 0, 20001)
        E = a * (1 - np.cos(2 * math.pi / T * entry)) / 2
        at = (3 * np.sqrt(g * (h + E)) - 2 * c0) * (t - entry)
        along_y, opposite = side in ("south", "north"), SIDES[SIDES.index(side) ^ 1]
        errors = []
        for n in (50, 100, 200):
            exact = np.interp(L - from_wall(centres(n, L), side, L), at, E, right=0.0)
            boundaries = {side: "incident", opposite: "radiating"}
            solver = channel(n, L, along_y, bed=-h, interval=t, boundaries=boundaries)
            solver.set_forcing(np.array([a / 2, -a / 2]), np.array([1e30, T]), np.zeros(2))
            solver.set_state(0.0)
            solver.advance()
            errors.append(np.abs(along(solver.elevation(), along_y) - exact).mean() / a)
        assert order(errors) > 1.7
        assert errors[-1] < 5e-4
        solver.set_forcing(np.zeros(1), np.ones(1), np.zeros(1))  # no more waves: the sea comes to rest
        for _ in range(4):
            solver.advance()
        assert np.abs(solver.elevation()).max() < 2e-3 * a

    @pytest.mark.parametrize("side", ["east", "south"])
    def test_forced_boundary_is_second_order(self, side):
        """The seiche η = a cos kx / cos kL cos ωt between a wall and a forced boundary: rms over two periods."""
        L, h, T, a = 200.0, 120.0, 30.0, 1e-4
        omega = 2 * math.pi / T
        k = omega / math.sqrt(g * h)
        along_y = side in ("south", "north")
        errors = []
        for n in (25, 50, 100):
            shape = np.cos(k * from_wall(centres(n, L), side, L)) / math.cos(k * L)
            solver = channel(n, L, along_y, bed=-h, interval=T / 8, boundaries={side: "forced"})
            solver.set_forcing(np.array([a]), np.array([T]), np.zeros(1))
            start(solver, along_y, a * shape)
            squares = 0.0
            for _ in range(16):
                solver.advance()
                eta = along(solver.elevation(), along_y)
                squares += np.mean((eta / a - shape * math.cos(omega * solver.time)) ** 2) / 16
            errors.append(math.sqrt(squares))
        assert errors[-1] < 5e-4
        assert order(errors) > 1.8

    def test_high_tide_floods_a_beach_and_leaves_it(self):
        """A tide of 2 m that is slow against the basin: the sea on a beach of 1:20 has the level of the boundary."""
        n, T = 50, 1800.0
        x = centres(n, 200.0)
        bed = np.broadcast_to(-5 + x / 20, (4, n))
        solver = channel(n, 200.0, bed=bed, interval=T / 4, boundaries={"west": "forced"}, manning=0.03, dry=1e-4)
        solver.set_forcing(np.array([2.0]), np.array([T]), np.array([-math.pi / 2]))
        solver.set_state(np.maximum(0.0, bed))
        for level in (2, 0, -2, 0, 2):
            solver.advance()
            deep = bed[0] < level - 0.2
            np.testing.assert_allclose(solver.elevation()[0, deep], level, atol=0.1)
            assert solver.depth()[0, bed[0] > level + 0.4].max() < 2e-3


class TestFriction:
    def test_manning_and_drag_slow_an_even_current(self):
        """|u| = u0 e^{−rt}/(1 + K u0 (1 − e^{−rt})/r), K = g n²/h^(4/3), as long as no wave has come from the walls."""
        h, n, r, t, start = 2.0, 0.05, 0.02, 5.0, np.array([1.5, -2.0])
        K, speed = g * n**2 / h ** (4 / 3), np.linalg.norm(start)
        for drag, manning, factor in (
            (0.0, n, 1 / (1 + K * speed * t)),
            (r, 0.0, math.exp(-r * t)),
            (r, n, math.exp(-r * t) / (1 + K * speed * -math.expm1(-r * t) / r)),
        ):
            solver = NonlinearShallowWater(
                size=(100, 100), cells=(40, 40), bed=-h, interval=t, drag=drag, manning=manning
            )
            solver.set_state(0.0, *np.broadcast_to(start[:, None, None], (2, 40, 40)))
            solver.advance()
            middle = [field[20, 20] for field in solver.velocity()]
            np.testing.assert_allclose(middle, start * factor, rtol=1e-5)

    def test_damped_oscillation_with_moving_shores(self):
        """A parabolic channel with linear drag, one period (Sampson, Easton and Singh 2006, ANZIAM J. 47, C373)."""
        h0, a, tau, B, n = 10.0, 3000.0, 1e-3, 5.0, 200
        p = math.sqrt(8 * g * h0) / a
        s = math.sqrt(p**2 - tau**2) / 2
        x = centres(n, 10000) - 5000
        bed = h0 * (x / a) ** 2 - h0

        def depth(t):
            sin, cos = math.sin(2 * s * t), math.cos(2 * s * t)
            level = a**2 * B**2 * math.exp(-tau * t) / (8 * g**2 * h0) * (-s * tau * sin + (tau**2 / 4 - s**2) * cos)
            level -= B**2 * math.exp(-tau * t) / (4 * g)
            tilt = -math.exp(-tau * t / 2) / g * (B * s * math.cos(s * t) + tau * B / 2 * math.sin(s * t))
            return np.maximum(level + tilt * x - bed, 0)

        T = 2 * math.pi / s
        solver = channel(n, 10000, bed=bed, interval=T, drag=tau, dry=1e-4)
        solver.set_state(bed + depth(0))
        solver.advance()
        assert relative_L1(solver.depth()[0], depth(T)) < 0.006
        still = np.maximum(-bed, 0)
        assert relative_L1(still, depth(T)) > 0.05  # the drag has not stopped it: 23% of the first swing is left


def rough_water(nx: int = 50, ny: int = 40, **others) -> NonlinearShallowWater:
    """Water of 5 m here and there, thrown at 5 m/s over ground that rises and falls by 5 m from cell to cell."""
    random = np.random.default_rng(0)
    bed = 5 * random.normal(size=(ny, nx))
    solver = NonlinearShallowWater(size=(3 * nx, 3 * ny), cells=(nx, ny), bed=bed, **{"interval": 2.0} | others)
    eta = bed + np.where(random.random((ny, nx)) < 0.5, random.exponential(5, (ny, nx)), -1)
    solver.set_state(eta, *(5 * random.normal(size=(2, ny, nx))))
    return solver


def energy(solver: NonlinearShallowWater) -> float:
    """Σ ½ h (u² + v²) + g h (h/2 + b)."""
    h = solver.depth().astype(np.float64)
    u, v = solver.velocity()
    return float((h * (u**2 + v**2) / 2 + g * h * (h / 2 + solver.bed)).sum())


class TestRoughGround:
    def test_stays_positive_keeps_mass_and_loses_energy(self):
        """Over the whole time: puddles and waterfalls must not gain speed from nothing."""
        solver = rough_water(dry=1e-3)
        mass, last = solver.mass(), energy(solver)
        for _ in range(15):
            solver.advance()
            assert solver.depth().min() >= 0
            assert energy(solver) < last
            last = energy(solver)
        assert solver.mass() == pytest.approx(mass, rel=1e-6)
        assert np.abs(solver.velocity()).max() < 40

    def test_any_number_of_bands_gives_the_same_bits(self, monkeypatch):
        """The basin on one thread in one launch, and cut into bands with a launch for each step: the same bits."""
        results = []
        for threads in (1, 2, 3, 7):
            monkeypatch.setattr(nonlinear, "ALONE", 1)
            monkeypatch.setattr(runtime, "_running", dataclasses.replace(runtime.start(), threads=threads))
            solver = rough_water(
                250, 200, manning=0.03, boundaries={"west": "radiating", "north": "forced"}, interval=0.3
            )
            for _ in range(2):
                solver.advance()
            results.append((solver.steps, solver.depth(), *solver.velocity()))
        for other in results[1:]:
            for a, b in zip(results[0], other, strict=True):
                np.testing.assert_array_equal(a, b)

    @pytest.mark.cpu("the same bits of sums in another order")
    def test_turned_and_mirrored_ground_turns_and_mirrors_the_flow(self):
        """West and east exchanged: the same bits in other places, also with other lanes. x and y exchanged: nearly."""
        given = rough_water()
        eta, (u, v) = given.elevation(), given.velocity()
        eta = np.where(given.depth() > 0, eta, -100.0)
        boundaries = {"west": "radiating", "north": "forced"}
        results = []
        for size, cells, sides, change, velocities in (
            ((150, 120), (50, 40), boundaries, lambda f: f, (u, v)),
            ((120, 150), (40, 50), {"south": "radiating", "east": "forced"}, np.transpose, (v.T, u.T)),
            ((150, 120), (50, 40), {"east": "radiating", "north": "forced"}, np.fliplr, (-u[:, ::-1], v[:, ::-1])),
        ):
            solver = NonlinearShallowWater(
                size=size, cells=cells, bed=change(given.bed), interval=1.0, boundaries=sides, manning=0.03
            )
            solver.set_forcing(np.ones(1), np.full(1, 3.0), np.zeros(1))
            solver.set_state(change(eta), *velocities)
            solver.advance()
            results.append(change(solver.depth()))
        np.testing.assert_array_equal(results[2], results[0])
        assert relative_L1(results[1], results[0]) < 0.1

    def test_state_is_restored(self):
        solver, other = rough_water(), rough_water()
        solver.advance()
        saved = solver.state()
        solver.advance()
        other.load_state(*saved)
        assert other.time == 2
        other.advance()
        np.testing.assert_array_equal(other.depth(), solver.depth())
        np.testing.assert_array_equal(other.velocity(), solver.velocity())
        assert (other.time, other.steps) == (solver.time, solver.steps)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"cells": (2, 9)}, "cells"),
        ({"bed": math.nan}, "bed"),
        ({"boundaries": {"west": "open"}}, "open"),
        ({"boundaries": {"up": "wall"}}, "up"),
    ],
)
def test_refuses_what_it_cannot_solve(changed, message):
    with pytest.raises(ValueError, match=message):
        NonlinearShallowWater(**{"size": (9, 9), "cells": (9, 9), "bed": -1.0, "interval": 1.0} | changed)


@pytest.mark.parametrize(("above", "wet"), [(3e-6, False), (5e-6, True)])
def test_a_surface_given_as_the_bed_is_no_water(above, wet):
    """Within a millionth of its height, 4 m, on the eastern half; elsewhere there is water."""
    bed = np.where(np.arange(9) < 4, -3.0, 4.0) * np.ones((5, 1))
    solver = NonlinearShallowWater(size=(9, 5), cells=(9, 5), bed=bed, interval=1.0)
    solver.set_state(np.maximum(0.0, bed + above), u=2.0, v=-1.0)
    np.testing.assert_array_equal(solver.depth() > 0, (bed < 0) | wet)
    for found, given in zip(solver.velocity(), (2.0, -1.0), strict=True):
        np.testing.assert_array_equal(found, given * ((bed < 0) | wet))


def test_refuses_a_state_that_is_not_finite():
    solver = NonlinearShallowWater(size=(9, 9), cells=(9, 9), bed=-1.0, interval=1.0)
    with pytest.raises(ValueError, match="finite"):
        solver.set_state(np.full((9, 9), np.nan))
    solver.set_state(0.0, u=np.full((9, 9), 1e30))
    with pytest.raises(FloatingPointError, match="fast"):
        solver.advance()
