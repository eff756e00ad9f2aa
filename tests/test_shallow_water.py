"""The shallow-water solver against exact discrete solutions, analytic ones, and a plain NumPy scheme in f64.

Tolerances: `ROUNDING` = 2⁻²⁴ is half a unit in the last place of an f32 number near one. A state variable is rounded
about four times a substep. In waves these errors add up like a random walk or, where they are systematic (a rounded
coefficient is a slightly different wave speed), in proportion to the number of substeps; each test says which.
"""

import math

import numpy as np
import pytest

from kernels import runtime, shallow_water
from kernels.shallow_water import ShallowWater

ROUNDING = 2.0**-24
GRAVITY = 9.81
EDGES = ("west", "east", "south", "north")


def centres(cells: int, length: float) -> np.ndarray:
    return (np.arange(cells) + 0.5) * (length / cells)


def faces(cells: int, length: float) -> np.ndarray:
    return np.arange(cells + 1) * (length / cells)


def many(field: np.ndarray, num_seas: int) -> np.ndarray:
    """The same field for each sea, times 1, 2, 3, … so that seas cannot be confused."""
    return field * np.arange(1, num_seas + 1)[:, None, None]


def from_wall(coordinate: np.ndarray, edge: str, length: float) -> np.ndarray:
    """Distance from the wall opposite a forced edge."""
    return length - coordinate if edge in ("west", "south") else coordinate


class Reference:
    """The scheme written plainly in NumPy f64, for one sea; `potential` is the two-array form for r = 0."""

    def __init__(self, solver: ShallowWater, eta: np.ndarray, edge_elevation=lambda t: 0.0) -> None:
        self.s, self.edge_elevation, self.steps = solver, edge_elevation, 0
        h = solver.depth
        wet = np.pad(h, 1)
        self.hx = np.where((wet[1:-1, 1:] > 0) & (wet[1:-1, :-1] > 0), (wet[1:-1, 1:] + wet[1:-1, :-1]) / 2, 0)
        self.hy = np.where((wet[1:, 1:-1] > 0) & (wet[:-1, 1:-1] > 0), (wet[1:, 1:-1] + wet[:-1, 1:-1]) / 2, 0)
        place = {"west": (self.hx, np.s_[:, 0]), "east": (self.hx, np.s_[:, -1])}
        place |= {"south": (self.hy, np.s_[0]), "north": (self.hy, np.s_[-1])}
        if solver.forced_edge != "none":
            depths, self.at = place[solver.forced_edge]
            depths[self.at] = h[self.at]
        self.eta = np.where(h > 0, eta, 0.0)
        gx, gy = self.gradient(self.eta)
        dt = solver.time_step
        self.U, self.V = dt / 2 * GRAVITY * self.hx * gx, dt / 2 * GRAVITY * self.hy * gy
        self.phi = dt / 2 * GRAVITY * self.eta

    def gradient(self, field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = self.s
        gx, gy = np.zeros_like(self.hx), np.zeros_like(self.hy)
        gx[:, 1:-1], gy[1:-1] = np.diff(field, axis=1) / s.dx, np.diff(field, axis=0) / s.dy
        if s.forced_edge != "none":
            ghost = 2 * self.edge_elevation(self.steps * s.time_step) - field[self.at]
            across, size = (gx, s.dx) if s.forced_edge in ("west", "east") else (gy, s.dy)
            away = -1 if s.forced_edge in ("west", "south") else 1
            across[self.at] = away * (ghost - field[self.at]) / size
        return gx, gy

    def advance(self, substeps: int) -> np.ndarray:
        s, dt, r = self.s, self.s.time_step, self.s.drag
        for _ in range(substeps):
            gx, gy = self.gradient(self.eta)
            self.U = ((1 - r * dt / 2) * self.U - dt * GRAVITY * self.hx * gx) / (1 + r * dt / 2)
            self.V = ((1 - r * dt / 2) * self.V - dt * GRAVITY * self.hy * gy) / (1 + r * dt / 2)
            self.eta = self.eta - dt * (np.diff(self.U, axis=1) / s.dx + np.diff(self.V, axis=0) / s.dy)
            self.steps += 1
        return self.eta

    def advance_potential(self, substeps: int) -> np.ndarray:
        s, dt = self.s, self.s.time_step
        for _ in range(substeps):
            self.phi = self.phi - dt * GRAVITY * self.eta
            gx, gy = self.gradient(self.phi)
            self.eta = self.eta - dt * (np.diff(self.hx * gx, axis=1) / s.dx + np.diff(self.hy * gy, axis=0) / s.dy)
        return self.eta


def rough_bed(nx: int, ny: int) -> np.ndarray:
    """Depths from 20 to 120 m with an island and a dry corner."""
    depth = np.random.default_rng(5).uniform(20, 120, (ny, nx))
    depth[ny // 3 : ny // 2, nx // 4 : nx // 3] = 0
    depth[-3:, -2:] = 0
    return depth


class TestStep:
    def test_limit_of_table_1(self):
        solver = ShallowWater(size=(200, 200), cells=(50, 50), depth=120, interval=10)
        assert solver.limit == pytest.approx(0.0824, abs=5e-5)
        assert solver.substeps >= 122
        assert solver.time_step * solver.substeps == pytest.approx(10)

    @pytest.mark.parametrize("edge", ["none", *EDGES])
    def test_limit_is_sharp_for_every_edge(self, edge, monkeypatch):
        """Noise stays bounded just below the limit, also at a forced edge, and explodes just above it."""
        growth = {}
        for courant in (0.999, 1.02):
            monkeypatch.setattr(shallow_water, "COURANT", courant)
            solver = ShallowWater(size=(60, 40), cells=(18, 12), depth=10, interval=1, forced_edge=edge)
            # A whole number of substeps, so that rounding up does not shorten them.
            interval = 2000 * courant * solver.limit * (1 - 1e-9)
            solver = ShallowWater(size=(60, 40), cells=(18, 12), depth=10, interval=interval, forced_edge=edge)
            assert solver.time_step == pytest.approx(courant * solver.limit)
            solver.set_state(np.random.default_rng(1).normal(size=(1, 12, 18)))
            solver.advance()
            growth[courant] = np.abs(solver.elevation()).max()
        assert growth[0.999] < 100  # near the limit the fastest mode has a large, but constant amplitude
        assert not growth[1.02] < 1e6

    @pytest.mark.parametrize(
        ("changed", "message"),
        [
            ({"cells": (2, 9)}, "cells"),
            ({"depth": 0.0}, "depth"),
            ({"depth": -1.0}, "depth"),
            ({"depth": math.nan}, "depth"),
            ({"depth": np.full((9, 9), math.inf)}, "depth"),
        ],
    )
    def test_refuses_what_it_cannot_solve(self, changed, message):
        with pytest.raises(ValueError, match=message):
            ShallowWater(**{"size": (9, 9), "cells": (9, 9), "depth": 1.0, "interval": 1.0} | changed)


class TestInvariants:
    @pytest.mark.parametrize("num_seas", [1, 3])
    @pytest.mark.parametrize(("mode_x", "mode_y", "edge"), [(3, 2, "none"), (39, 22, "none"), (2.5, 3, "east")])
    def test_discrete_eigenmode(self, mode_x, mode_y, edge, num_seas):
        """cos(ω̃ n Δt) times the mode, sin²(ω̃Δt/2) = g h Δt² (sin²(kΔx/2)/Δx² + sin²(lΔy/2)/Δy²), to round-off.

        n + ½ half waves fit between a wall and an edge held at zero. The rounded coefficients change ω̃ by at most
        ½ `ROUNDING`, so the error grows at most like that times the phase, beside the random walk.
        """
        nx, ny, X, Y, h = 40, 25, 130.0, 90.0, 80.0
        solver = ShallowWater(size=(X, Y), cells=(nx, ny), depth=h, interval=3.0, forced_edge=edge, num_seas=num_seas)
        k, m = mode_x * math.pi / X, mode_y * math.pi / Y
        mode = np.cos(m * centres(ny, Y))[:, None] * np.cos(k * centres(nx, X))
        solver.set_state(many(mode, num_seas))
        inner = (math.sin(k * solver.dx / 2) / solver.dx) ** 2 + (math.sin(m * solver.dy / 2) / solver.dy) ** 2
        turn = 2 * math.asin(solver.time_step * math.sqrt(GRAVITY * h * inner))
        for n in (1, 2, 3):
            solver.advance()
            steps = n * solver.substeps
            expected = many(math.cos(turn * steps) * mode, num_seas)
            tolerance = num_seas * ROUNDING * (steps * turn / 2 + 4 * math.sqrt(steps))
            np.testing.assert_allclose(solver.elevation(), expected, atol=tolerance, rtol=0)

    @pytest.mark.parametrize("num_seas", [1, 3])
    def test_mass_and_energy(self, num_seas):
        """Exact for the scheme; a substep rounds each cell a few times, independently of the others."""
        nx, ny = 40, 25
        solver = ShallowWater(size=(130, 90), cells=(nx, ny), depth=rough_bed(nx, ny), interval=20.0, num_seas=num_seas)
        solver.set_state(np.random.default_rng(2).normal(size=(num_seas, ny, nx)))
        mass, energy = solver.mass(), solver.energy()
        scale = math.sqrt(nx * ny) * solver.dx * solver.dy
        for n in range(1, 4):
            solver.advance()
            steps = n * solver.substeps
            assert np.abs(solver.mass() - mass).max() < 4 * ROUNDING * math.sqrt(steps) * scale
            # A random walk even if all cells rounded alike; coefficients are the same on both sides of a face, so
            # their rounding is that of the depth and leaves an invariant.
            np.testing.assert_allclose(solver.energy(), energy, rtol=ROUNDING * math.sqrt(steps))

    @pytest.mark.parametrize("edge", ["none", "north"])
    def test_lake_at_rest_over_a_bump_is_exact(self, edge):
        nx, ny, level = 33, 20, 0.75
        solver = ShallowWater(size=(66, 40), cells=(nx, ny), depth=rough_bed(nx, ny), interval=5.0, forced_edge=edge)
        solver.set_forcing(np.full((1, 1), level), np.full((1, 1), 1e30), np.zeros((1, 1)))
        solver.set_state(np.full((1, ny, nx), level))
        before = solver.elevation()
        solver.advance()
        np.testing.assert_array_equal(solver.elevation(), before)
        assert not np.any(solver.velocity())

    def test_a_still_sea_costs_nothing(self, monkeypatch):
        solver = ShallowWater(size=(40, 40), cells=(10, 10), depth=5, interval=2.0, forced_edge="west")
        solver.set_state(np.zeros((1, 10, 10)))
        monkeypatch.setattr(shallow_water, "march", None)  # would fail if called
        solver.advance()
        assert solver.still
        assert solver.time == 2.0
        solver.set_forcing(np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
        assert not solver.still


def order(errors: list[float]) -> float:
    """Order of convergence of errors on grids that are refined by two."""
    return math.log2(errors[-2] / errors[-1])


class TestAnalytic:
    def test_standing_wave_is_second_order_at_an_eighth_period(self):
        """η = cos kx cos ly cos ωt and its velocities; at t = T the error would falsely be of fourth order."""
        X, Y, h = 100.0, 70.0, 30.0
        k, m = 2 * math.pi / X, math.pi / Y
        omega = math.sqrt(GRAVITY * h * (k**2 + m**2))
        errors = []
        for n in (16, 32, 64):
            x, y = centres(n, X), centres(n, Y)[:, None]
            solver = ShallowWater(size=(X, Y), cells=(n, n), depth=h, interval=2 * math.pi / omega / 8)
            solver.set_state((np.cos(k * x) * np.cos(m * y))[None])
            solver.advance()
            speed = GRAVITY / omega * math.sin(math.pi / 4)
            u, v = solver.velocity()
            exact = (
                (solver.elevation(), np.cos(k * x) * np.cos(m * y) * math.cos(math.pi / 4)),
                (u, speed * k * np.sin(k * x) * np.cos(m * y)),
                (v, speed * m * np.cos(k * x) * np.sin(m * y)),
            )
            errors.append([float(np.sqrt(np.mean((a[0] - b) ** 2))) for a, b in exact])
        for series in zip(*errors, strict=True):
            assert 1.9 < order(series) < 2.2

    @pytest.mark.parametrize("edge", EDGES)
    def test_seiche_is_second_order(self, edge):
        """Eq. 7 with a phase, started in its steady state: rms error of η and velocity over 2 periods."""
        L, h, T, phase = 200.0, 120.0, 30.0, 0.6
        omega = 2 * math.pi / T
        k = omega / math.sqrt(GRAVITY * h)
        across = edge in ("west", "east")
        outward = -1 if edge in ("west", "south") else 1
        errors = []
        for n in (80, 160):
            cells, size = ((n, 5), (L, 50.0)) if across else ((5, n), (50.0, L))
            solver = ShallowWater(size=size, cells=cells, depth=h, interval=T / 7, forced_edge=edge, num_seas=2)
            turned = (lambda a: a) if across else (lambda a: a.swapaxes(1, 2))

            def seiche(s, t, turned=turned):
                wave = np.cos(k * s) / math.cos(k * L) * math.cos(omega * t + phase)
                return turned(many(np.broadcast_to(wave, (5, len(s))), 2))

            def current(s, t, turned=turned):
                slope = GRAVITY * k / omega * np.sin(k * s) / math.cos(k * L) * math.sin(omega * t + phase)
                return turned(many(np.broadcast_to(outward * slope, (5, len(s))), 2))

            s, sf = from_wall(centres(n, L), edge, L), from_wall(faces(n, L), edge, L)
            solver.set_forcing(np.array([[1.0], [2.0]]), np.full((2, 1), T), np.full((2, 1), phase))
            solver.set_state(seiche(s, 0), **{"u" if across else "v": current(sf, 0)})
            squares = np.zeros(2)
            for _ in range(14):
                solver.advance()
                t, velocity = solver.time, solver.velocity()[0 if across else 1]
                squares[0] += np.mean((solver.elevation() - seiche(s, t)) ** 2)
                squares[1] += np.mean((velocity - current(s, t)) ** 2)
            errors.append(np.sqrt(squares))
        for series in zip(*errors, strict=True):
            assert 1.9 < order(series) < 2.2

    @pytest.mark.parametrize("T", [10.0, 15.0, 20.0, 30.0, 45.0, 60.0])
    def test_quarter_wave_gain(self, T):
        """The wall's response to a unit wave at the edge is 1/cos kL.

        The grid misses kL by (kΔx)²/24 of itself, and so the gain by kL tan(kL) times that. The start is the exact
        steady state, so free waves of the size of that change are left: twice that again.
        """
        L, h, n = 200.0, 120.0, 100
        k = 2 * math.pi / T / math.sqrt(GRAVITY * h)
        gain = 1 / math.cos(k * L)
        solver = ShallowWater(size=(L, 20.0), cells=(n, 4), depth=h, interval=T / 8, forced_edge="west")
        solver.set_forcing(np.ones((1, 1)), np.full((1, 1), T), np.zeros((1, 1)))
        solver.set_state(np.broadcast_to(gain * np.cos(k * from_wall(centres(n, L), "west", L)), (1, 4, n)))
        wall = []
        for _ in range(16):
            solver.advance()
            wall.append(solver.elevation()[0, 0, -1] * math.cos(2 * math.pi * solver.time / T))
        missed = abs(k * L * math.tan(k * L)) * (k * L / n) ** 2 / 24
        assert 2 * np.mean(wall) == pytest.approx(gain, rel=3 * missed + 1e-4)

    def test_linear_growth_at_resonance(self):
        """From rest, forced with T = 4L/c, the wall follows (2/π) ω t sin ωt plus bounded terms."""
        L, h, n = 200.0, 120.0, 60
        T = 4 * L / math.sqrt(GRAVITY * h)
        solver = ShallowWater(size=(L, 20.0), cells=(n, 4), depth=h, interval=T, forced_edge="east")
        solver.set_forcing(np.ones((1, 1)), np.full((1, 1), T), np.full((1, 1), -math.pi / 2))  # sin ωt
        solver.set_state(np.zeros((1, 4, n)))
        wall = []
        for _ in range(6):
            solver.advance()
            wall.append(solver.elevation()[0, 0, 0])
        # With sin ωt at the edge it is −(2/π) ω t cos ωt: 4 more each period, seen at its crests.
        np.testing.assert_allclose(np.diff(wall), -4.0, rtol=0.01)


class TestAgainstPlainNumpy:
    @pytest.mark.parametrize("num_seas", [1, 18])
    @pytest.mark.parametrize("edge", ["none", *EDGES])
    def test_variable_depth_drag_and_forcing(self, edge, num_seas):
        nx, ny = 37, 29
        random = np.random.default_rng(7)
        solver = ShallowWater(
            size=(200, 150),
            cells=(nx, ny),
            depth=rough_bed(nx, ny),
            interval=1.0,
            drag=0.02,
            forced_edge=edge,
            num_seas=num_seas,
        )
        a, T, phase = random.normal(size=(num_seas, 3)), random.uniform(3, 20, (num_seas, 3)), np.ones((num_seas, 3))
        start = random.normal(size=(num_seas, ny, nx))
        solver.set_forcing(a, T, phase)
        solver.set_state(start)
        for _ in range(4):
            solver.advance()
        s = num_seas - 1
        wave = lambda t: float((a[s] * np.cos(2 * math.pi * t / T[s] + phase[s])).sum())  # noqa: E731
        expected = Reference(solver, start[s], wave).advance(4 * solver.substeps)
        assert np.abs(expected).max() > 1
        # About 50 substeps of independent rounding of numbers near 3: a random walk, at its largest of 1000 cells.
        np.testing.assert_allclose(solver.elevation()[s], expected, atol=100 * ROUNDING, rtol=0)
        assert not solver.elevation()[:, solver.depth == 0].any()

    def test_potential_form_is_the_same_scheme(self):
        nx, ny = 37, 29
        solver = ShallowWater(size=(200, 150), cells=(nx, ny), depth=rough_bed(nx, ny), interval=10.0)
        start = np.random.default_rng(8).normal(size=(ny, nx))
        solver.set_state(start[None])
        solver.advance()
        potential = Reference(solver, start).advance_potential(solver.substeps)
        three_fields = Reference(solver, start).advance(solver.substeps)
        np.testing.assert_allclose(potential, three_fields, atol=1e-11)  # f64 rounding
        np.testing.assert_allclose(solver.elevation()[0], potential, atol=100 * ROUNDING)

    def test_potential_form_rounds_worse(self):
        """Why three fields: a seiche on 256 cells of 0.8 m for 50 s. In f32 its error is over 50 times ours.

        Measured: 7.6e-5 against 8.2e-7 of the amplitude (92 times). The potential reaches g η/ω, but only its
        difference between neighbouring cells, k Δx times smaller, moves water.
        """
        n, L, h = 256, 200.0, 120.0
        solver = ShallowWater(size=(L, 4 * L / n), cells=(n, 4), depth=h, interval=50.0)
        start = np.broadcast_to(np.cos(math.pi * centres(n, L) / L), (1, 4, n))
        solver.set_state(start)
        solver.advance()
        exact = Reference(solver, start[0]).advance(solver.substeps)[0]
        eta = start[0, 0].astype(np.float32)
        c = np.float32(h * solver.time_step / solver.dx**2)
        push = np.float32(solver.time_step * GRAVITY)
        phi = push / 2 * eta
        flux = np.zeros(n + 1, np.float32)
        for _ in range(solver.substeps):
            phi = phi - push * eta
            flux[1:-1] = c * np.diff(phi)
            eta = eta - np.diff(flux)
        rms = [math.sqrt(np.mean((e.astype(np.float64) - exact) ** 2)) for e in (solver.elevation()[0, 0], eta)]
        assert eta.dtype == np.float32
        assert rms[0] < 100 * ROUNDING
        assert rms[1] > 50 * rms[0]

    def test_forcing_can_be_switched_off(self):
        """The edge is then held at zero, not closed."""
        random = np.random.default_rng(3)
        solver = ShallowWater(size=(80, 80), cells=(20, 16), depth=50, interval=2.0, forced_edge="west", num_seas=2)
        solver.set_forcing(np.ones((2, 1)), np.full((2, 1), 9.0), np.zeros((2, 1)))
        solver.set_state(np.zeros((2, 16, 20)))
        solver.advance()
        solver.set_forcing(np.zeros((2, 1)), np.full((2, 1), 9.0), np.zeros((2, 1)))
        start = random.normal(size=(2, 16, 20))
        solver.set_state(start)
        before = solver.elevation()
        solver.advance()
        expected = Reference(solver, start[1]).advance(solver.substeps)
        np.testing.assert_allclose(solver.elevation()[1], expected, atol=100 * ROUNDING, rtol=0)
        np.testing.assert_array_equal(before, start.astype(np.float32))  # a copy

    def test_clock_carries_the_phase(self):
        """Started late, the edge wave goes on where it would be: the same as one at zero with the phase moved on."""
        late, T = 1.0e6, 17.0
        states = []
        for time, phase in ((late, 0.3), (0.0, 0.3 + 2 * math.pi * math.fmod(late, T) / T)):
            solver = ShallowWater(size=(80, 80), cells=(20, 16), depth=50, interval=2.0, forced_edge="south")
            solver.set_forcing(np.ones((1, 1)), np.full((1, 1), T), np.full((1, 1), phase))
            solver.set_state(np.zeros((1, 16, 20)), time=time)
            for _ in range(3):
                solver.advance()
            states.append(solver.elevation())
            assert solver.time == time + 6
        np.testing.assert_allclose(states[0], states[1], atol=1e-5)  # f64 phase at 10⁶ s: 1e-10; the rest is f32


def test_runs_where_the_runtime_says():
    solver = ShallowWater(size=(10, 10), cells=(4, 4), depth=1, interval=1)
    assert solver.eta.device.type == runtime.start().device.type
