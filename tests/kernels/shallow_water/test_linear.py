"""The shallow-water solver: its step, boundaries and clock, and against a plain NumPy scheme in f64.

What has a solution is in `tests.cases`. `ROUNDING` = 2⁻²⁴ is half a unit in the last place of an f32 number near one. A
state variable is rounded about four times a substep; in waves these errors add up like a random walk.
"""

import math
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from tests.cases.plain import ROUNDING, SIDES, PlainScheme, centres, rough_bed, waves
from usvauv.kernels.shallow_water import linear
from usvauv.kernels.shallow_water.linear import ShallowWater

KINDS = ("wall", "forced", "incident", "radiating")
# Every kind at two sides and opposite two others.
MIXED = [dict(zip(SIDES, order, strict=True)) for order in (KINDS, (*KINDS[2:], *KINDS[:2]), KINDS[::-1])]


def open_sea(boundaries: dict[str, str], **others) -> ShallowWater:
    """A sea of 200 m × 150 m."""
    return ShallowWater(**{"size": (200, 150), "cells": (37, 29), "boundaries": boundaries} | others)


class TestStep:
    def test_limit_of_table_1(self):
        solver = ShallowWater(size=(200, 200), cells=(50, 50), depth=120, interval=10)
        assert solver.limit == pytest.approx(0.0824, abs=5e-5)
        assert solver.substeps >= 122
        assert solver.time_step * solver.substeps == pytest.approx(10)

    @pytest.mark.parametrize("boundaries", [dict.fromkeys(SIDES, kind) for kind in KINDS])
    def test_limit_is_sharp_for_every_boundary(self, boundaries, monkeypatch):
        """Noise stays bounded just below the limit, also at open boundaries, and explodes just above it."""
        growth = {}
        for courant in (0.999, 1.02):
            monkeypatch.setattr(linear, "COURANT", courant)
            common = {"size": (60, 40), "cells": (18, 12), "depth": 10, "boundaries": boundaries}
            solver = ShallowWater(**common, interval=1)
            # A whole number of substeps, so that rounding up does not shorten them.
            solver = ShallowWater(**common, interval=2000 * courant * solver.limit * (1 - 1e-9))
            assert solver.time_step == pytest.approx(courant * solver.limit)
            solver.set_state(np.random.default_rng(1).normal(size=(1, 12, 18)))
            with suppress(FloatingPointError):
                solver.advance()
            growth[courant] = np.abs(solver.elevation()).max()
        assert growth[0.999] < 100  # near the limit the fastest mode has a large, but constant amplitude
        assert not growth[1.02] < 1e6

    @pytest.mark.parametrize(
        ("changed", "message"),
        [
            ({"cells": (2, 9)}, "cells"),
            ({"depth": 0.0}, "depth"),
            ({"depth": math.nan}, "depth"),
            ({"boundaries": {"up": "wall"}}, "up"),
            ({"boundaries": {"west": "none"}}, "none"),
        ],
    )
    def test_refuses_what_it_cannot_solve(self, changed, message):
        with pytest.raises(ValueError, match=message):
            ShallowWater(**{"size": (9, 9), "cells": (9, 9), "depth": 1.0, "interval": 1.0} | changed)

    def test_waves_continue_without_forcing(self):
        solver = ShallowWater(size=(40, 40), cells=(10, 10), depth=5, interval=2.0, boundaries={"west": "incident"})
        solver.set_forcing(*waves(1.0, 7.0))
        solver.advance()
        before = solver.elevation()
        solver.set_forcing(*waves(0.0, 7.0))
        assert not solver.still
        solver.advance()
        assert np.abs(solver.elevation() - before).max() > 0.1


class TestBoundaries:
    def test_energy_only_falls(self):
        """With nothing prescribed; half of the noise is waves so short that they hardly move."""
        solver = open_sea(MIXED[0], depth=rough_bed(37, 29), interval=0.5)
        solver.set_state(np.random.default_rng(1).normal(size=(1, 29, 37)))
        energy = [solver.energy()[0]]
        for _ in range(40):
            solver.advance()
            energy.append(solver.energy()[0])
        assert (np.diff(energy) < ROUNDING * energy[0]).all()
        assert energy[-1] < 0.7 * energy[0]

    @pytest.mark.parametrize("num_seas", [1, 3])
    def test_state_is_restored(self, num_seas):
        boundaries = dict(zip(SIDES, KINDS, strict=True))
        first, second = (
            open_sea(boundaries, depth=rough_bed(37, 29), interval=1.0, num_seas=num_seas) for _ in range(2)
        )
        first.set_state(np.random.default_rng(1).normal(size=(num_seas, 29, 37)))
        for solver in (first, second):
            solver.set_forcing(*waves(1.0, 9.0, 0.3, num_seas))
        first.advance()
        second.load_state(*first.state())
        for solver in (first, second):
            solver.advance()
        for one, other in zip(*((s.elevation(), *s.velocity(), s.time) for s in (first, second)), strict=True):
            np.testing.assert_array_equal(one, other)

    def test_boundary_on_land_is_a_wall(self):
        depth = np.full((29, 37), 30.0)
        depth[:, 0] = 0
        seas = []
        for boundaries in ({}, {"west": "radiating"}):
            solver = open_sea(boundaries, depth=depth, interval=5.0)
            solver.set_state(np.random.default_rng(1).normal(size=(1, 29, 37)))
            solver.advance()
            seas.append(solver.elevation())
        np.testing.assert_allclose(*seas, atol=20 * ROUNDING)


class TestDiagnostics:
    @pytest.mark.parametrize("boundaries", [{}, {"south": "forced", "east": "forced"}])
    def test_mass_and_energy_are_those_of_the_integrals(self, boundaries):
        """Of two seas with a wave and an even current, in cells that are no squares."""
        solver = open_sea(boundaries, depth=40.0, interval=1e-3, num_seas=2, gravity=5.0)
        x, y = centres(37, 200.0), centres(29, 150.0)[:, None]
        eta = 0.3 + np.cos(math.pi * x / 200) * np.cos(2 * math.pi * y / 150)
        u, v = np.full((2, 29, 38), 0.4), np.full((2, 30, 37), -0.2)
        if not boundaries:
            u[:, :, [0, -1]], v[:, [0, -1]] = 0, 0
        solver.set_state(np.stack([eta, -2 * eta]), np.stack([u[0], 3 * u[1]]), np.stack([v[0], 3 * v[1]]))
        area = 200.0 * 150.0
        np.testing.assert_allclose(solver.mass(), [0.3 * area, -0.6 * area], rtol=1e-6)
        height = 5 / 2 * (0.09 + 0.25) * area
        still = 0.5 if boundaries else 1  # cells' worth of the faces at the ends of each axis: walls, or half open
        speed = 40 / 2 * area * (0.16 * (37 - still) / 37 + 0.04 * (29 - still) / 29)
        np.testing.assert_allclose(solver.energy(), [height + speed, 4 * height + 9 * speed], rtol=1e-3)

    @pytest.mark.parametrize("num_seas", [1, 2])
    def test_a_new_state_forgets_the_old_one(self, num_seas):
        boundaries = dict(zip(SIDES, KINDS, strict=True))
        start, seen = np.random.default_rng(5).normal(size=(num_seas, 29, 37)), []
        for used in (False, True):
            solver = open_sea(boundaries, depth=rough_bed(37, 29), interval=1.0, num_seas=num_seas)
            solver.set_forcing(*waves(1.0, 9.0, 0.3, num_seas))
            if used:
                solver.set_state(100 * start, time=3.0)
                solver.advance()
                for field in (solver.eta, *solver.transports):
                    field.fill_(math.nan)
            solver.set_state(start)
            solver.advance()
            assert solver.time == 1.0
            seen.append([solver.elevation(), *solver.velocity()])
        np.testing.assert_array_equal(*seen)


MEMORY = """
import numpy as np
from usvauv.kernels.shallow_water.linear import ShallowWater

def sea(n):
    depth = np.full((n, n), 50, np.float32) + np.arange(n, dtype=np.float32)[:, None] / n
    eta = np.ones((1, n, n), np.float32)
    solver = yield depth, eta
    solver = ShallowWater(size=(n, n), cells=(n, n), depth=depth, interval=0.1, boundaries={"west": "radiating"})
    solver.set_state(eta)
    solver.advance()
    yield solver

def status(name):
    return next(int(line.split()[1]) * 1024 for line in open("/proc/self/status") if line.startswith(name))

for n in (64, 4096):  # the small one compiles
    run = sea(n)
    next(run)
    before = status("VmRSS")
    solver = run.send(None)
held = sum(array.nbytes for array in (solver._state, solver._C, solver._prescribed, solver._coefficient_row))
print(status("VmHWM") - before, held)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads the peak of the process from Linux")
def test_memory_is_that_of_the_fields():
    """Peak of construction, start and first interval over what was there before: within 10% of the arrays held."""
    run = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True, cwd=Path(__file__).parents[3])
    peak, held = map(int, run.stdout.split()[-2:])
    assert held > 190 * 2**20
    assert peak < 1.1 * held, f"{peak / held:.3f}"


class TestAgainstPlainNumpy:
    @pytest.mark.parametrize("num_seas", [1, 18])
    @pytest.mark.parametrize(
        "boundaries", [{}, *MIXED], ids=lambda boundaries: "-".join(boundaries.values()) or "walls"
    )
    def test_depth_drag_and_boundaries(self, boundaries, num_seas):
        nx, ny = 37, 29
        random = np.random.default_rng(7)
        solver = open_sea(boundaries, depth=rough_bed(nx, ny), interval=1.0, drag=0.02, num_seas=num_seas)
        a, T, phase = random.normal(size=(num_seas, 3)), random.uniform(3, 20, (num_seas, 3)), np.ones((num_seas, 3))
        start = random.normal(size=(num_seas, ny, nx))
        solver.set_forcing(a, T, phase)
        solver.set_state(start)
        for _ in range(4):
            solver.advance()
        s = num_seas - 1
        wave = lambda t: float((a[s] * np.cos(2 * math.pi * t / T[s] + phase[s])).sum())  # noqa: E731
        expected = PlainScheme(solver, start[s], wave).advance(4 * solver.substeps)
        assert np.abs(expected).max() > 0.5
        # About 50 substeps of independent rounding of numbers near 3: a random walk, at its largest of 1000 cells.
        np.testing.assert_allclose(solver.elevation()[s], expected, atol=100 * ROUNDING, rtol=0)
        assert not solver.elevation()[:, solver.depth == 0].any()

    def test_clock_carries_the_phase(self):
        """Started late, the prescribed wave has its phase of that time: the same as from zero with a later phase."""
        late, T = 1.0e6, 17.0
        states = []
        for time, phase in ((late, 0.3), (0.0, 0.3 + 2 * math.pi * math.fmod(late, T) / T)):
            solver = ShallowWater(size=(80, 80), cells=(20, 16), depth=50, interval=2.0, boundaries={"south": "forced"})
            solver.set_forcing(np.ones((1, 1)), np.full((1, 1), T), np.full((1, 1), phase))
            solver.set_state(np.zeros((1, 16, 20)), time=time)
            for _ in range(3):
                solver.advance()
            states.append(solver.elevation())
            assert solver.time == time + 6
        np.testing.assert_allclose(states[0], states[1], atol=1e-5)  # f64 phase at 10⁶ s: 1e-10; the rest is f32


MIRRORS = {
    "x": (lambda field: field[..., ::-1], {"west": "east", "east": "west"}),
    "y": (lambda field: field[..., ::-1, :], {"south": "north", "north": "south"}),
    "diagonal": (
        lambda field: field.swapaxes(-1, -2),
        {"west": "south", "south": "west", "east": "north", "north": "east"},
    ),
}


@pytest.mark.parametrize("mirror", MIRRORS)
def test_mirrored_sea_stays_mirrored(mirror):
    """With an incoming wave at one side and every other kind of boundary round about."""
    turn, side = MIRRORS[mirror]
    boundaries = {"west": "incident", "east": "radiating", "north": "forced"}
    depth = rough_bed(31, 31)
    depth[:, [0, -1]] = depth[[0, -1]] = 60.0
    common = {"size": (310, 310), "cells": (31, 31), "interval": 1.0}
    one = ShallowWater(depth=depth, boundaries=boundaries, **common)
    mirrored = {side.get(name, name): kind for name, kind in boundaries.items()}
    other = ShallowWater(depth=np.ascontiguousarray(turn(depth)), boundaries=mirrored, **common)
    eta = np.random.default_rng(3).normal(size=(1, 31, 31)) * (depth > 0)
    for solver, surface in ((one, eta), (other, turn(eta))):
        solver.set_forcing(*waves(0.5, 12.0))
        solver.set_state(np.ascontiguousarray(surface))
        for _ in range(40):
            solver.advance()
    scale = np.abs(one.elevation()).max()
    assert scale > 0.3
    np.testing.assert_allclose(turn(one.elevation()), other.elevation(), atol=2e-5 * scale)
