"""Loss in near-surface bubbles: the handbook's equations, the integral over depth, limits and monotony."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from usvauv.kernels.positioning.sonar import LAYER_PER_WIND, bubble_loss, vertical_bubble_loss

# APL-UW TR 9407, Eqs. 28a and 28b, both ways, worked out by hand: Hz, m/s, degrees, dB.
HANDBOOK = [
    (3e4, 10.0, 10.0, 4.858),  # 1.26e-3 · 37.154 · 18.012/0.17365
    (2e4, 15.0, 20.0, 3.303),  # 1.26e-3 · 70.228 · 12.764/0.34202
    (4e4, 6.0, 90.0, 0.4827),  # 1.26e-3 · 16.660 · 23.000
    (4e4, 3.0, 90.0, 0.01319),  # the same times e^−3.6
]


@pytest.mark.parametrize(("frequency", "wind", "degrees", "loss"), HANDBOOK)
def test_handbook(frequency, wind, degrees, loss):
    assert 2 * bubble_loss(frequency, wind, math.radians(degrees), 0.0) == pytest.approx(loss, rel=2e-3)


@pytest.mark.parametrize("depth", [0.0, 0.5, 3.0])
def test_integral_along_the_ray(depth):
    """Attenuation β exp(−z/L) per metre of a straight ray at 20°, from 50 m below up to the receiver."""
    f, wind, grazing = 25e3, 12.0, math.radians(20.0)
    surface = 0.63e-3 * 12.0**1.57 * 25**0.85 / (0.07 * 12.0)
    along = quad(lambda z: surface * math.exp(-z / (0.07 * 12.0)) / math.sin(grazing), depth, 50.0, epsabs=1e-12)[0]
    assert bubble_loss(f, wind, grazing, depth) == pytest.approx(along)


@pytest.mark.parametrize("wind", [7.5, 10.0, 13.0, 17.0])
def test_depth_of_the_layer(wind):
    """Hall (1989), doi 10.1121/1.398102: bubbles decrease with depth over 0.4 m + 0.115 s (U − 7.5 m/s)."""
    assert LAYER_PER_WIND * wind == pytest.approx(0.4 + 0.115 * (wind - 7.5), rel=0.35)


def test_more_in_more_wind_nearer_the_surface_and_at_grazing():
    winds, depths, angles = (
        np.linspace(0.1, 25.0, 50),
        np.linspace(0.0, 5.0, 20),
        np.radians(np.linspace(5.0, 90.0, 20)),
    )
    assert np.all(np.diff([bubble_loss(25e3, wind, 0.5, 1.0) for wind in winds]) > 0)
    assert np.all(np.diff([bubble_loss(25e3, 15.0, 0.5, depth) for depth in depths]) < 0)
    assert np.all(np.diff([bubble_loss(25e3, 15.0, angle, 1.0) for angle in angles]) < 0)
    assert np.all(np.diff([bubble_loss(f, 15.0, 0.5, 1.0) for f in (1e4, 2e4, 4e4)]) > 0)


def test_waves_break_from_6_metres_a_second():
    below, above = vertical_bubble_loss(25e3, 6.0 - 1e-9), vertical_bubble_loss(25e3, 6.0 + 1e-9)
    assert above == pytest.approx(below)
    assert vertical_bubble_loss(25e3, 5.0) / above == pytest.approx(math.exp(-1.2))


def test_calm_and_deep_water_have_none():
    assert bubble_loss(25e3, 0.0, 0.5, 3.0) == 0.0
    assert bubble_loss(25e3, 17.0, 0.5, 50.0) < 1e-12
