"""What waves do to a boat of some length: it follows long ones, and they slow it down."""

import math

import numpy as np
import pytest
import torch
from scipy.integrate import trapezoid

from usvauv.env import Scenario, ScenarioError
from usvauv.env.sea.hull import Hull
from usvauv.env.sea.storm import band
from usvauv.env.sea.water import build_short_waves
from usvauv.env.site.site import Site
from usvauv.env.world.boat_speed import top_speed
from usvauv.kernels.flow import airy

G, H = 9.81, 120.0
L, B, T = 8.0, 2.0, 0.5
BOAT = [f"boat.length={L}", f"boat.beam={B}", f"boat.draught={T}"]
SEA = ["storm.significant_height=1.5", "storm.peak_period=5"]


def closed_form(k: float) -> float:
    """η f κ of Jensen, Mansour and Olsen (2004) at rest, from their real formulas."""
    A2 = (2 * math.sin(k * B / 2) * math.exp(-k * T)) ** 2
    eta = 1 / math.hypot(1 - 2 * k * T, A2 / (k * B))
    return eta * math.hypot(1 - k * T, A2 / (k * B)) * math.exp(-k * T)


def fitted(k: float, heading: float) -> tuple[float, float]:
    """Amplitudes of elevation and slope of the plane that fits a wave over the water plane best, least squares."""
    along = (np.arange(40) + 0.5) / 40 - 0.5
    points = np.stack(np.meshgrid(L * along, B * along), axis=-1).reshape(-1, 2)
    wave = np.exp(1j * k * (points @ [math.cos(heading), math.sin(heading)]))
    plane = np.linalg.lstsq(np.column_stack([np.ones(len(points)), points]).astype(complex), wave, rcond=None)[0]
    return abs(plane[0]), float(np.linalg.norm(plane[1:]))


def test_elevation_and_tilt_over_many_seas():
    """Their variances are those of the spectrum times the squares of the responses, over all headings."""
    sea = build_short_waves(Site(Scenario.load("extreme", [*BOAT, *SEA])), [(1, index) for index in range(256)])
    points = torch.rand((256, 64, 2), generator=torch.Generator().manual_seed(1)) * 200
    found = airy.sample(sea.wave, sea.since, points.to(sea.wave.device), 0).double().cpu().numpy()
    omega, S = band("jonswap", 5.0, 2.2, L, H, G)
    S *= (1.5 / 4) ** 2 / trapezoid(S, omega)
    k = np.geomspace(1e-2, 2 * math.pi / L, 60)
    plane = np.array([[fitted(x, heading) for heading in np.linspace(0, math.pi, 24, endpoint=False)] for x in k])
    followed = (plane**2).mean(axis=1) * np.array([closed_form(x) ** 2 for x in k])[:, None]
    waves = airy.wavenumber(omega, H, G)
    elevation, slope = (trapezoid(np.interp(waves, k, part) * S, omega) for part in followed.T)
    assert (found[..., 0] ** 2).mean() == pytest.approx(elevation, rel=0.05)
    assert (found[..., 1:3] ** 2).sum(axis=-1).mean() == pytest.approx(slope, rel=0.05)
    assert slope < 0.8 * trapezoid(waves**2 * S, omega)


def test_long_waves_are_followed():
    for part in Hull(L, B, T).motion(2 * math.pi / np.array([50 * L, 100 * L])):
        np.testing.assert_allclose(part, 1.0, atol=2e-3)


def test_a_wave_moves_it_alike_whichever_are_beside_it():
    """As single precision has it: seas of worlds in a batch are in one array."""
    k = np.geomspace(0.013, 0.77, 2000)
    together, *apart = (np.float32(Hull(L, B, T).motion(each)) for each in (k, *np.split(k, 20)))
    np.testing.assert_array_equal(np.concatenate(apart, axis=1), together)


def test_long_waves_add_no_resistance_and_those_of_the_hulls_length_do():
    """It vanishes for waves far longer and far shorter, and grows with the square of the height: less speed."""
    k = 2 * math.pi / np.array([0.3 * L, 2 * L, 30 * L])
    short, equal, long = Hull(L, B, T).added_resistance(k, np.sqrt(G * k), 3.0, G)
    assert max(short, long) < 0.02 * equal
    assert 1 < equal / (1025 * G * B**2 / L) < 20  # as measured for ships, in these units
    own = [*BOAT, "boat.top_speed=6", "boat.thrust=2000", *SEA]
    calm, low, high = (
        top_speed(Site(Scenario.load("extreme", [*own, f"storm.significant_height={height}"])))
        for height in (0.001, 0.75, 1.5)
    )
    assert calm == pytest.approx(6.0, rel=1e-3)
    added = [2000 * (1 - (speed / 6) ** 2) for speed in (low, high)]
    assert added[1] / added[0] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["boat.beam=2"], r"boat.*beam = 2: needs a length above 0"),
        (["boat.length=8", "boat.beam=2"], r"boat.*length = 8: needs a draught above 0"),
        ([*BOAT, "storm.peak_period=4"], r"boat.length = 8: a wave of that length must have at least twice the freq"),
    ],
)
def test_what_is_refused(given, said):
    with pytest.raises(ScenarioError, match=said):
        Scenario.load("extreme", ["boat.vessel=none", "boat.dead_band=0", "storm.significant_height=1", *given])
