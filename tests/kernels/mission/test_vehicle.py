"""Power of an AUV: the law of Zhang et al. (2024), and what an AUV pays that holds its place in a current."""

import numpy as np
import pytest
import torch

from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.mission.motion import hovering_power, travelling_power


def law(speed):
    """Drag of ½·0.7·60·V² times V over the fitted efficiency, and 15 W for the rest."""
    return 21.0 * speed**3 / np.polyval([-0.081, 0.215, -0.01, 0.541], speed) + 15.0


@pytest.mark.parametrize("speed", [0.0, 0.4, 1.2, 2.2])
def test_travelling(speed):
    assert travelling_power(speed) == pytest.approx(law(speed), rel=1e-6)


def test_beyond_the_fit_power_grows_with_the_cube_of_the_speed():
    """The fitted efficiency falls through zero near 3.25 m/s; at any speed the power stays positive and rises."""
    for speed in (2.6, 3.25, 4.0, 100.0):
        assert travelling_power(speed) == pytest.approx(15.0 + (law(2.5) - 15.0) * (speed / 2.5) ** 3, rel=1e-6)


@pytest.mark.parametrize(
    ("current", "power"),
    [(0.0, 105.0), (1.3, 105.0), (1.6, law(1.6)), (2.5, law(2.5)), (4.0, law(2.5))],
)
def test_hovering_is_travelling_against_the_current_within_limits(current, power):
    assert law(1.3) < 105.0 < law(1.6)
    assert hovering_power(current) == pytest.approx(power, rel=1e-6)


def test_a_mission_charges_hovering_by_the_current_at_the_auv():
    """In vortices of 1.5 to 3 m/s most AUVs that hover pay more than the least."""
    strong = ["current.count=6", "current.circulation_min=300", "current.circulation_max=500"]
    world = World(Scenario.load("ideal", [*strong, "auv.hover_radius=60"]), 64, seed=4)
    policy = policies.load("straight", world)
    observation = world.reset()
    paid, current = [], []
    for _ in range(30):
        before = world.current().clone()
        observation = world.step(policy.act(observation))[0]
        hovering = world.auv[..., AuvColumn.hovering] > 0
        paid.append(world.auv[..., AuvColumn.power][hovering])
        current.append(before[hovering].norm(dim=-1))
    speed = torch.cat(current).double().numpy()
    expected = np.maximum(law(np.minimum(speed, 2.5)), 105.0)
    np.testing.assert_allclose(torch.cat(paid).double().numpy(), expected, rtol=1e-4)
    assert 0.2 < (expected > 105.0).mean() < 1.0
