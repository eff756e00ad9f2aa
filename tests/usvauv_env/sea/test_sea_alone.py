"""The sea without vehicles: its vortices and currents."""

import math

import numpy as np
import pytest
import torch

from usvauv.env import Scenario
from usvauv.env.sea.simulation import SeaSimulation
from usvauv.env.site.site import Site

WIDTH, LENGTH, SHAPE = 210.0, 100.0, (7, 5)  # cells of 30 × 20 m
WAVES = {"forced_edge": "west", "irregular_rms": 0.5}


@pytest.fixture
def vortices(device) -> torch.Tensor:
    return torch.tensor([[[90.0, 40.0, 30.0, 10.0], [110.0, 60.0, 30.0, 15.0]]], device=device)


def scenario(step: float = 1.0, **current: object) -> Scenario:
    return Scenario.from_dict(
        {
            "area": {"width": WIDTH, "length": LENGTH},
            "mission": {"step": step},
            "sea": WAVES,
            "storm": {"spectrum": "pm"},
            "current": current,
        }
    )


class Flow:
    """A current that is linear in x, y and time, until its last time."""

    start = "2020-01-02T03:00:00"

    def __init__(self, *times: float) -> None:
        self.times = np.array(times)

    def at(self, t: float) -> np.ndarray:
        y, x = np.mgrid[0:3, 0:4] * np.array([LENGTH / 2, WIDTH / 3])[:, None, None]
        surface = np.stack([1 + 2e-3 * x + 3e-3 * y + min(t, max(self.times, default=t)), -2 + 4e-3 * x - 5e-3 * y], -1)
        return np.stack([surface, 9 + surface]).astype(np.float32)


class TestVortices:
    def test_cores_spread(self, vortices):
        """dδ²/dt = 4ν; what was given stays as it is."""
        sea = SeaSimulation(scenario(viscosity=0.7), 0, SHAPE, 1.6, vortices)
        given = vortices.cpu().numpy().copy()
        for _ in range(3):
            sea.advance()
        np.testing.assert_allclose(sea.vortices[:, 3] ** 2, np.array([100, 225]) + 4 * 0.7 * 4.8, rtol=1e-5)
        np.testing.assert_array_equal(sea.vortices[:, :3], given[0, :, :3])
        np.testing.assert_array_equal(vortices.cpu(), given)
        assert not sea.steady

    def test_a_pair_turns_about_its_middle(self, vortices):
        """At the rate Γ/(π d²)(1 − e^(−d²/(δ₁² + δ₂²))), d apart, of equal circulations."""
        sea = SeaSimulation(scenario(mutual=True), 0, SHAPE, 2.5, vortices)
        for _ in range(4):
            sea.advance()
        d2 = 20**2 + 20**2
        turned = math.pi / 4 + 10 * 30 / (math.pi * d2) * -math.expm1(-d2 / (100 + 225))
        expected = np.array([100.0, 50.0]) + math.sqrt(d2) / 2 * np.array([math.cos(turned), math.sin(turned)])
        np.testing.assert_allclose(sea.vortices[1, :2], expected, atol=1e-3)
        assert not sea.steady

    def test_that_neither_spread_nor_move_are_steady(self, vortices):
        sea = SeaSimulation(scenario(), 0, SHAPE, 1.0, vortices)
        sea.advance()
        np.testing.assert_array_equal(sea.vortices, vortices[0].cpu())
        assert sea.steady
        assert SeaSimulation(scenario(viscosity=1, mutual=True), 0, SHAPE, 1.0).steady  # has none


class TestRealCurrent:
    def test_is_linear_between_its_points_and_stays_after_its_end(self, monkeypatch, vortices):
        """On a grid of 3 by 4 points, beside a vortex, on water and not on land."""
        monkeypatch.setattr(Site, "current", Flow(0.0, 3.0))
        depth = np.full((5, 7), 50.0)
        depth[0, 2] = depth[4, 6] = 0.0
        monkeypatch.setattr(Site, "still_depth", lambda _, cells: depth)
        sea = SeaSimulation(scenario(), 0, SHAPE, 2.0, vortices[:, :1])
        assert not sea.steady
        x, y = np.meshgrid(sea.x, sea.y)
        r2 = (x - 90) ** 2 + (y - 40) ** 2
        turn = 30 / (2 * math.pi * r2) * -np.expm1(-r2 / 100)
        for t in (0.0, 2.0, 3.0):
            u, v = 1 + 2e-3 * x + 3e-3 * y + t - turn * (y - 40), -2 + 4e-3 * x - 5e-3 * y + turn * (x - 90)
            np.testing.assert_allclose(sea.current(), np.stack([u, v], -1) * (depth > 0)[..., None], atol=1e-5)
            np.testing.assert_array_equal(sea.stream(), Flow().at(t)[0])
            sea.advance()
