"""The nonlinear solver against the exact solutions of `tests.cases.solutions`, and its invariants.

Tolerances are the measured errors with 10 to 20% to spare. For comparison, the scheme that most published second-order
codes use (Audusse et al. 2004: hydrostatic reconstruction of limited depths, minmod, Heun), written into these kernels,
gave at the same cells: Stoker 0.23%, Ritter 0.25% (400 cells); after one and three periods 1.7% and 3.8% for Thacker's
plane, 2.0% and 4.2% for his paraboloid (100 × 100).
"""

import dataclasses
import math

import numpy as np
import pytest

from tests.cases.case import order, relative_L1
from tests.cases.plain import GRAVITY as g
from tests.cases.plain import SIDES, centres
from tests.cases.solutions import Paraboloid, PDEBench, Plane, RadialDamBreak, channel, ritter, stoker
from usvauv.kernels import runtime
from usvauv.kernels.shallow_water import nonlinear
from usvauv.kernels.shallow_water.linear import ShallowWater
from usvauv.kernels.shallow_water.nonlinear import NonlinearShallowWater


class TestDamBreak:
    """SWASHES 4.1: a channel of 10 m, 5 mm of water behind the dam, after 6 s."""

    @pytest.mark.parametrize("along_y", [False, True])
    @pytest.mark.parametrize(("h_R", "depth", "discharge"), [(1e-3, 1.4e-3, 8.6e-3), (0.0, 1.3e-3, 8.8e-3)])
    def test_against_stoker_and_ritter(self, h_R, depth, discharge, along_y):
        n = 400
        x = centres(n, 10) - 5
        solver = channel(n, 10, along_y, bed=0.0, interval=6.0)
        start = np.broadcast_to(np.where(x < 0, 5e-3, h_R), (4, n))
        solver.set_state(start.T if along_y else start)
        before = solver.mass()
        solver.advance()
        h, (u, v) = solver.depth(), solver.velocity()
        h, u, v = (h.T, v.T, u.T) if along_y else (h, u, v)
        exact_h, exact_u = stoker(x, 6, 5e-3, h_R) if h_R else ritter(x, 6, 5e-3)
        assert relative_L1(h[0], exact_h) < depth
        assert relative_L1(h[0] * u[0], exact_h * exact_u) < discharge
        assert np.ptp(h, axis=0).max() == 0  # the same in all rows
        assert not v.any()
        assert solver.mass() == pytest.approx(before, rel=1e-7)
        assert h.min() >= 0

    def test_dry_front(self):
        """The place where 1% of the depth behind the dam is left, and the tip, which is infinitely thin."""
        n = 400
        x = centres(n, 10) - 5
        solver = channel(n, 10, bed=0.0, interval=6.0)
        solver.set_state(np.where(x < 0, 5e-3, 0.0))
        solver.advance()
        front, exact = (x[h > 5e-5].max() for h in (solver.depth()[0], ritter(x, 6, 5e-3)[0]))
        assert abs(front - exact) < 0.5 * solver.dx
        tip, exact_tip = x[solver.depth()[0] > 5e-8].max(), 2 * math.sqrt(g * 5e-3) * 6
        assert exact_tip - 16 * solver.dx < tip < exact_tip

    def test_first_order_in_L1(self):
        """Of a solution with a bore not more can be had."""
        errors = []
        for n in (400, 800):
            x = centres(n, 10) - 5
            solver = channel(n, 10, bed=0.0, interval=6.0)
            solver.set_state(np.where(x < 0, 5e-3, 1e-3))
            solver.advance()
            errors.append(relative_L1(solver.depth()[0], stoker(x, 6, 5e-3, 1e-3)[0]))
        assert order(errors) > 0.9


class TestRadialDamBreak:
    def test_symmetric_to_the_last_bit(self):
        """About both axes; about the diagonal within what the splitting into x and y leaves."""
        solver = RadialDamBreak().solve(60)
        h, (u, v) = solver.depth(), solver.velocity()
        np.testing.assert_array_equal(h, h[:, ::-1])
        np.testing.assert_array_equal(h, h[::-1])
        np.testing.assert_array_equal(u, -u[:, ::-1])
        np.testing.assert_array_equal(u, u[::-1])
        np.testing.assert_array_equal(v, -v[::-1])
        assert relative_L1(h, h.T) < 0.004

    @pytest.mark.parametrize(("n", "tolerance"), [(100, 0.015), pytest.param(200, 0.007, marks=pytest.mark.slow)])
    def test_against_one_dimension(self, n, tolerance):
        case = RadialDamBreak()
        assert relative_L1(case.solve(n).depth(), case.exact(n)) < tolerance

    @pytest.mark.parametrize(
        ("n", "mean", "rms"), [(128, 2.1e-3, 5.7e-3), (256, 1.4e-3, 3.9e-3), (512, 7.0e-4, 2.6e-3)]
    )
    def test_as_accurate_as_wave_propagation(self, n, mean, rms):
        """On PDEBench's case, in as many steps as that scheme; tolerances are PyClaw's errors."""
        case = PDEBench()
        solver, exact = case.solve(n), case.exact(n)
        assert relative_L1(solver.depth(), exact) < mean
        assert np.linalg.norm(solver.depth() - exact) / np.linalg.norm(exact) < rms
        assert solver.steps < 0.35 * n


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


class TestThacker:
    @pytest.mark.parametrize(
        ("case", "cells", "tolerances"),
        [
            (Plane, 100, {0.25: (0.0075, 0.006), 1: (0.0093, 0.0165), 3: (0.0156, 0.0225)}),
            (Paraboloid, 100, {0.25: (0.0062, 0.0055), 1: (0.0093, 0.0085), 3: (0.0215, 0.0215)}),
            pytest.param(Plane, 200, {1: (0.0032, 0.0047), 3: (0.0047, 0.0065)}, marks=pytest.mark.slow),
            pytest.param(Paraboloid, 200, {1: (0.0027, 0.0045), 3: (0.0057, 0.0076)}, marks=pytest.mark.slow),
        ],
    )
    def test_depth_and_discharge(self, case, cells, tolerances):
        """Relative L1 of depth, and of h v in the L1 of depth times the greatest speed of the case."""
        exact = case(cells)
        fastest = max(np.abs(exact.solution(t)[2]).max() for t in np.linspace(0, exact.period, 17))
        for n, solver in enumerate(exact.solve(3, pieces=12), start=1):
            if n == 1:
                before = exact.solution(0)[0].sum() * solver.dx * solver.dy
            if n / 4 in tolerances:
                h, _, v = exact.solution(solver.time)
                depth, discharge = tolerances[n / 4]
                assert relative_L1(solver.depth(), h) < depth
                assert np.abs(solver.depth() * solver.velocity()[1] - h * v).sum() / (h.sum() * fastest) < discharge
        assert solver.mass() == pytest.approx(before, rel=3e-7)
        assert solver.depth().min() >= 0

    @pytest.mark.parametrize(("case", "least"), [(Plane, 1.4), (Paraboloid, 1.7)])
    def test_order(self, case, least):
        """Below two, because the solution has a kink at the shore."""
        errors = []
        for cells in (50, 100):
            exact = case(cells)
            (solver,) = exact.solve(1)
            errors.append(relative_L1(solver.depth(), exact.solution(exact.period)[0]))
        assert order(errors) > least

    @pytest.mark.parametrize("case", [Plane, Paraboloid])
    def test_shoreline_is_followed(self, case):
        """All through the second period, on the row next to the middle. Wet is what is deeper than 0.2% of h0."""
        exact = case(100)
        row = 50
        x, y = exact.x[row], exact.y[row, 0]
        for n, solver in enumerate(exact.solve(2, pieces=32), start=1):
            if n > 16:
                wet = x[solver.depth()[row] > 2e-3 * exact.h0]
                west, east = exact.shores(solver.time, y)
                assert abs(wet.min() - solver.dx / 2 - west) < 2 * solver.dx
                assert abs(wet.max() + solver.dx / 2 - east) < 2 * solver.dx


class TestRest:
    @pytest.mark.parametrize("level", [0.0, 0.75, -3.3])
    @pytest.mark.parametrize("kind", ["wall", "forced"])
    def test_lake_round_islands_stays(self, level, kind):
        """Nothing moves by a single bit over a rough bed of 120 m depth with dry peaks."""
        n = 64
        x = centres(n, 200)
        bed = -120 + 140 * np.exp(-((x - 100) ** 2 + (x[:, None] - 90) ** 2) / 900)
        bed = bed + 3 * np.random.default_rng(0).normal(size=(n, n))
        solver = NonlinearShallowWater(
            size=(200, 200), cells=(n, n), bed=bed, interval=5.0, boundaries=dict.fromkeys(SIDES, kind)
        )
        solver.set_forcing(np.array([level]), np.array([1e30]), np.zeros(1))
        solver.set_state(np.maximum(level, bed))
        before = solver.elevation()
        assert 20 < (solver.depth() == 0).sum() < 400
        solver.advance()
        assert solver.steps > 50
        np.testing.assert_array_equal(solver.elevation(), before)
        assert not np.any(solver.velocity())

    def test_still_sea_beside_radiating_boundaries(self):
        solver = NonlinearShallowWater(
            size=(9, 9),
            cells=(20, 9),
            bed=np.linspace(-2, 0.5, 20),
            interval=5.0,
            boundaries=dict.fromkeys(SIDES, "radiating"),
        )
        solver.set_state(0.0)
        solver.advance()
        np.testing.assert_array_equal(solver.depth() > 0, solver.bed < 0)
        assert not np.any(solver.velocity())


class TestClock:
    @pytest.mark.parametrize("cells", [(40, 6), (6, 40)])
    def test_steps_are_as_long_as_the_fastest_wave_allows(self, cells):
        """In long cells, small waves pass 0.95 of the shorter side in a step; the first is a tenth."""
        size, depth, interval = (4000.0, 4200.0), 10.0, 300.0
        solver = NonlinearShallowWater(size=size, cells=cells, bed=-depth, interval=interval)
        assert (solver.time, solver.steps) == (0.0, 0)
        x, y = centres(cells[0], size[0]), centres(cells[1], size[1])[:, None]
        solver.set_state(0.01 * np.cos(math.pi * x / size[0]) * np.cos(math.pi * y / size[1]), time=50.0)
        mass = solver.mass()
        assert mass == pytest.approx(depth * size[0] * size[1], rel=1e-6)
        least = interval * math.sqrt(g * depth) / min(solver.dx, solver.dy) / 0.95
        before = 0
        for n in range(1, 4):
            solver.advance()
            assert solver.time == 50.0 + n * interval
            assert least <= solver.steps - before <= least + 4
            before = solver.steps
        assert solver.mass() == pytest.approx(mass, rel=1e-6)


class TestSmooth:
    def test_standing_wave_is_second_order(self):
        """η = a cos kx cos ky cos ωt of 1e-5 of the depth, at t = T/8; η and u."""
        h, k = 1.0, 2 * math.pi
        omega = math.sqrt(2 * g * h) * k
        errors = []
        for n in (32, 64, 128):
            x = centres(n, 1.0)
            mode = np.cos(k * x) * np.cos(k * x)[:, None]
            solver = NonlinearShallowWater(size=(1, 1), cells=(n, n), bed=-h, interval=math.pi / 4 / omega)
            solver.set_state(1e-5 * mode)
            solver.advance()
            u = g * k / omega * math.sin(math.pi / 4) * np.sin(k * x) * np.cos(k * x)[:, None]
            errors.append(
                (
                    relative_L1(solver.elevation() / 1e-5, mode * math.cos(math.pi / 4)),
                    relative_L1(solver.velocity()[0] / 1e-5, u),
                )
            )
        for series in zip(*errors, strict=True):
            assert order(series) > 1.9
            assert series[-1] < 3e-4

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
            start, end = average(points), average(moved)
            solver = channel(n, 10, along_y, bed=-h0, interval=t)
            h, u = (start**2 / g).mean(axis=1), 2 * (start.mean(axis=1) - c0)
            eta, u = (np.broadcast_to(f, (4, n)) for f in (h - h0, u))
            solver.set_state(eta.T if along_y else eta, **{"v": u.T} if along_y else {"u": u})
            solver.advance()
            h, speed = solver.depth(), solver.velocity()[along_y]
            h, speed = (h.T, speed.T) if along_y else (h, speed)
            exact = (end**2 / g).mean(axis=1)
            errors.append((np.abs(h[0] - exact).mean(), np.abs(speed[0] - 2 * (end.mean(axis=1) - c0)).mean()))
        for series in zip(*errors, strict=True):
            assert order(series) > 1.8

    @pytest.mark.slow
    def test_nonlinear_waves_over_a_hill_are_second_order(self):
        """By the differences between three grids, of the elevation and of h u."""
        fields = []
        for n in (64, 128, 256):
            x = centres(n, 1.0)
            bed = -1 + 0.3 * np.exp(-30 * ((x - 0.6) ** 2 + (x[:, None] - 0.55) ** 2))
            solver = NonlinearShallowWater(size=(1, 1), cells=(n, n), bed=bed, interval=0.06)
            solver.set_state(0.2 * np.exp(-40 * ((x - 0.4) ** 2 + (x[:, None] - 0.45) ** 2)))
            solver.advance()
            fields.append((solver.elevation(), solver.depth() * solver.velocity()[0]))
        for coarse, middle, fine in zip(*fields, strict=True):
            halved = [f.reshape(len(f) // 2, 2, -1, 2).mean(axis=(1, 3)) for f in (middle, fine)]
            assert order([np.abs(halved[0] - coarse).mean(), np.abs(halved[1] - middle).mean()]) > 1.85


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
    @pytest.mark.parametrize(
        ("kind", "amplitude", "reflected"),
        [("radiating", 1e-3, 1e-4), ("radiating", 2.0, 0.003), ("incident", 2.0, 0.003)],
    )
    def test_open_boundary_lets_waves_out(self, side, kind, amplitude, reflected):
        """A hump of 40 m length on 10 m of water leaves; the rest, as a fraction of its height."""
        n, h = 200, 10.0
        x = centres(n, 200.0)
        x = x if side in ("east", "north") else x[::-1]
        along_y = side in ("south", "north")
        outward = 1 if side in ("east", "north") else -1
        solver = channel(n, 200.0, along_y, bed=-h, interval=180 / math.sqrt(g * h), boundaries={side: kind})
        eta = np.broadcast_to(amplitude * np.exp(-(((x - 100) / 20) ** 2)), (4, n))
        u = outward * 2 * (np.sqrt(g * (h + eta)) - math.sqrt(g * h))  # a simple wave
        solver.set_state(eta.T if along_y else eta, **{"v": u.T} if along_y else {"u": u})
        solver.advance()
        assert np.abs(solver.elevation()).max() < reflected * amplitude

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

    @pytest.mark.parametrize("side", SIDES)
    def test_high_wave_enters_incident_boundary_and_leaves_radiating_one(self, side):
        """E = a (1 − cos ωt)/2 of a tenth of the depth: a simple wave, η = E(s) at x = (3c(s) − 2c0) (t − s)."""
        h, a, T, L, t = 10.0, 1.0, 10.0, 100.0, 9.0
        c0 = math.sqrt(g * h)
        start = np.linspace(t, 0, 20001)
        E = a * (1 - np.cos(2 * math.pi / T * start)) / 2
        at = (3 * np.sqrt(g * (h + E)) - 2 * c0) * (t - start)
        along_y, opposite = side in ("south", "north"), SIDES[SIDES.index(side) ^ 1]
        errors = []
        for n in (50, 100, 200):
            x = centres(n, L)
            exact = np.interp(x if side in ("west", "south") else L - x, at, E, right=0.0)
            boundaries = {side: "incident", opposite: "radiating"}
            solver = channel(n, L, along_y, bed=-h, interval=t, boundaries=boundaries)
            solver.set_forcing(np.array([a / 2, -a / 2]), np.array([1e30, T]), np.zeros(2))
            solver.set_state(0.0)
            solver.advance()
            errors.append(np.abs((solver.elevation().T if along_y else solver.elevation())[0] - exact).mean() / a)
        assert order(errors) > 1.7
        assert errors[-1] < 5e-4
        solver.set_forcing(np.zeros(1), np.ones(1), np.zeros(1))  # no more waves: the sea comes to rest
        for _ in range(4):
            solver.advance()
        assert np.abs(solver.elevation()).max() < 2e-3 * a

    @pytest.mark.parametrize("side", SIDES)
    def test_forced_boundary_is_second_order(self, side):
        """The seiche η = a cos kx / cos kL cos ωt between a wall and a forced boundary: rms over two periods."""
        L, h, T, a = 200.0, 120.0, 30.0, 1e-4
        omega = 2 * math.pi / T
        k = omega / math.sqrt(g * h)
        along_y = side in ("south", "north")
        errors = []
        for n in (25, 50, 100):
            x = centres(n, L)
            shape = np.cos(k * (L - x if side in ("west", "south") else x)) / math.cos(k * L)
            solver = channel(n, L, along_y, bed=-h, interval=T / 8, boundaries={side: "forced"})
            solver.set_forcing(np.array([a]), np.array([T]), np.zeros(1))
            eta = np.broadcast_to(a * shape, (4, n))
            solver.set_state(eta.T if along_y else eta)
            squares = 0.0
            for _ in range(16):
                solver.advance()
                eta = solver.elevation().T if along_y else solver.elevation()
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

    def test_damped_wave_is_second_order(self):
        """η = a cos kx e^{−rt/2} (cos σt + r/(2σ) sin σt), σ² = g h k² − r²/4, with r = ω, and its velocity."""
        h, a, k = 1.0, 1e-5, 2 * math.pi
        r = math.sqrt(g * h) * k
        sigma = math.sqrt(3) / 2 * r
        t = math.pi / 3 / sigma
        errors = []
        for n in (32, 64, 128):
            x = centres(n, 1.0)
            solver = channel(n, 1.0, bed=-h, interval=t, drag=r)
            solver.set_state(a * np.cos(k * x))
            solver.advance()
            fading = math.exp(-r * t / 2)
            eta = fading * (math.cos(sigma * t) + r / (2 * sigma) * math.sin(sigma * t)) * np.cos(k * x)
            u = fading * g * k / sigma * math.sin(sigma * t) * np.sin(k * x)
            errors.append((relative_L1(solver.elevation()[0] / a, eta), relative_L1(solver.velocity()[0][0] / a, u)))
        for series in zip(*errors, strict=True):
            assert order(series) > 1.9

    @pytest.mark.parametrize("along_y", [False, True])
    def test_damped_oscillation_with_moving_shores(self, along_y):
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
        across = np.broadcast_to(bed, (4, n))
        solver = channel(n, 10000, along_y, bed=across.T if along_y else across, interval=T, drag=tau, dry=1e-4)
        start = np.broadcast_to(bed + depth(0), (4, n))
        solver.set_state(start.T if along_y else start)
        solver.advance()
        h = solver.depth().T if along_y else solver.depth()
        assert relative_L1(h[0], depth(T)) < 0.006
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

    @pytest.mark.parametrize("manning", [0.0, 0.03])
    def test_turned_and_mirrored_ground_turns_and_mirrors_the_flow(self, manning):
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
                size=size, cells=cells, bed=change(given.bed), interval=1.0, boundaries=sides, manning=manning
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


@pytest.mark.parametrize("cells", [(3, 3), (5, 17), (16, 4), (17, 5), (33, 7), (50, 3)])
def test_fields_are_unpacked_from_any_grid(cells):
    nx, ny = cells
    solver = NonlinearShallowWater(size=(nx, ny), cells=cells, bed=-2.0, interval=1e-3)
    eta, u, v = np.random.default_rng(0).normal(size=(3, ny, nx)).astype(np.float32)
    solver.set_state(0.1 * eta, u, v)
    np.testing.assert_array_equal(solver.elevation(), (0.1 * eta).astype(np.float32))
    np.testing.assert_array_equal(solver.velocity(), (u, v))
    mass = solver.mass()
    solver.advance()
    assert solver.mass() == pytest.approx(mass, rel=1e-6)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"cells": (2, 9)}, "cells"),
        ({"bed": math.nan}, "bed"),
        ({"boundaries": {"west": "sponge"}}, "sponge"),
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
