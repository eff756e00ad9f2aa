"""A mirrored linear sea stays mirrored, on a rough bed and between boundaries of every kind."""

import numpy as np
import pytest

from tests.cases.plain import rough_bed, waves
from usvauv.kernels.shallow_water.linear import ShallowWater

MIRRORS = {
    "x": (lambda field: field[..., ::-1], {"west": "east", "east": "west"}),
    "y": (lambda field: field[..., ::-1, :], {"south": "north", "north": "south"}),
    "diagonal": (
        lambda field: field.swapaxes(-1, -2),
        {"west": "south", "south": "west", "east": "north", "north": "east"},
    ),
}


def start(num_seas: int, seed: int, wet: np.ndarray) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(num_seas, *wet.shape)) * wet


@pytest.mark.parametrize("mirror", MIRRORS)
@pytest.mark.parametrize("num_seas", [1, 9])
def test_mirrored_sea_stays_mirrored(mirror, num_seas):
    """With an incoming wave at one side and every other kind of boundary round about."""
    turn, side = MIRRORS[mirror]
    boundaries = {"west": "incident", "east": "radiating", "south": "sponge", "north": "forced"}
    depth = rough_bed(31, 31)
    depth[:, [0, -1]] = depth[[0, -1]] = 60.0
    common = {"size": (310, 310), "cells": (31, 31), "interval": 1.0, "sponge_width": 60.0, "num_seas": num_seas}
    one = ShallowWater(depth=depth, boundaries=boundaries, **common)
    mirrored = {side.get(name, name): kind for name, kind in boundaries.items()}
    other = ShallowWater(depth=np.ascontiguousarray(turn(depth)), boundaries=mirrored, **common)
    eta = start(num_seas, 3, depth > 0)
    for solver, surface in ((one, eta), (other, turn(eta))):
        solver.set_forcing(*waves(0.5, 12.0, num_seas=num_seas))
        solver.set_state(np.ascontiguousarray(surface))
        for _ in range(40):
            solver.advance()
    scale = np.abs(one.elevation()).max()
    assert scale > 0.3
    np.testing.assert_allclose(turn(one.elevation()), other.elevation(), atol=2e-5 * scale)
