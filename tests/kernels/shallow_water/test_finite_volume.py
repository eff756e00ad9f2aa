"""The steps of the nonlinear solver beside the same scheme in NumPy and f64, over every kind of ground and boundary."""

import math

import numpy as np
import pytest

from tests.cases.plain import GRAVITY, SIDES
from tests.kernels.shallow_water.plain_finite_volume import PlainFiniteVolumes
from usvauv.kernels.shallow_water.nonlinear import NonlinearShallowWater

KINDS = ("wall", "radiating", "forced", "incident")
NX, NY = 37, 11  # lanes overlap, and more lanes than rows
GROUND = {
    "deep": lambda noise, x, y: -10 - 2 * x + y + 0.2 * noise,
    "jumps": lambda noise, x, y: -10 + 4 * noise,
    "shores": lambda noise, x, y: -1 + 2 * np.sin(7 * x + 3 * y) + 0.1 * noise,
}


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("ground", GROUND)
@pytest.mark.parametrize(("drag", "manning"), [(0.0, 0.0), (0.05, 0.04)])
def test_steps(ground, turn, drag, manning, rounding):
    """From waves and currents that are partly faster than waves; each kind of boundary on each side."""
    random = np.random.default_rng(7)
    x, y = (np.arange(NX) + 0.5) / NX, (np.arange(NY)[:, None] + 0.5) / NY
    bed = GROUND[ground](random.uniform(-1, 1, (NY, NX)), x, y).astype(np.float32)
    kind = {side: KINDS[(n + turn) % 4] for n, side in enumerate(SIDES)}
    solver = NonlinearShallowWater(
        size=(3.0 * NX, 2.0 * NY), cells=(NX, NY), bed=bed, interval=0.6, drag=drag, manning=manning, boundaries=kind,
        dry=1e-3,
    )  # fmt: skip
    solver.set_forcing(np.array([0.3, 0.2]), np.array([4.0, 2.5]), np.array([0.5, 2.0]))
    eta = 0.5 * np.cos(9 * x + 2 * y) + 0.2 * random.uniform(-1, 1, (NY, NX))
    u, v = (4 * random.uniform(-1, 1, (NY, NX)) for _ in range(2))
    start = tuple(field.astype(np.float32) for field in (eta, u, v))
    solver.set_state(*start, time=50.0)
    omega = 2 * math.pi / np.array([4.0, 2.5])
    tide = lambda t: float((np.array([0.3, 0.2]) * np.cos(omega * t + [0.5, 2.0])).sum())  # noqa: E731
    plain = PlainFiniteVolumes(solver, kind, start, tide)
    plain.advance()
    solver.advance()
    assert solver.steps == plain.steps > 3
    assert solver.gravity == GRAVITY
    np.testing.assert_allclose(solver.depth() - np.maximum(-solver.bed, 0), plain.D, atol=1e-5 * rounding)
    thick = solver.depth() > 0.01
    for found, expected in zip(solver.velocity(), (plain.u, plain.v), strict=True):
        np.testing.assert_allclose(found[thick], expected[thick], atol=5e-5 * rounding)
