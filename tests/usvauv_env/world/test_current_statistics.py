"""The current at the AUVs by the scenario, part by part: against closed forms and means of fields on fine grids."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import rice

from usvauv.env import Scenario
from usvauv.env.sea.long_waves import speed_bound
from usvauv.env.sea.storm import band
from usvauv.env.sea.water import current_bound
from usvauv.env.site.ocean import Flow
from usvauv.env.site.site import Site
from usvauv.env.world.current_statistics import current_model, current_parts, drift_speeds
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.types import Level

WIDTH, LENGTH, DEPTH, G = 300.0, 200.0, 120.0, 9.81
OBLONG = [f"area.width={WIDTH:g}", f"area.length={LENGTH:g}"]
VORTICES = ["current.count=3", "current.circulation_min=10", "current.circulation_max=40"]
STORM = ["boat.vessel=none", "boat.dead_band=0", "storm.spectrum=jonswap", "storm.significant_height=4"]


def site(*changes: str) -> Site:
    return Site(Scenario.load("ideal", [*OBLONG, *changes]))


def with_flow(*changes: str) -> Site:
    """With a steady current whose components are linear in x and y, another one at the surface."""
    y, x = np.meshgrid(np.linspace(0, LENGTH, 5), np.linspace(0, WIDTH, 9), indexing="ij")
    cruise = np.stack([0.2 + 3e-3 * x + 1e-3 * y, -0.3 + 2e-3 * x + 5e-3 * y], axis=-1)
    levels = {Level.surface: 5 * cruise, Level.cruise: cruise}
    velocity = np.stack([levels[level] for level in sorted(levels)])[None].astype(np.float32)
    made = site(*changes)
    vars(made)["current"] = Flow(WIDTH, LENGTH, (0.0, 100.0), np.zeros(1), velocity, "")  # as if it had been read
    return made


def orbital(z: float, depth: float) -> tuple[float, float]:
    """Mean squares of the horizontal speed (m²/s²) and of its change a second in `STORM`, by Newton's wave number."""
    omega, S = band("jonswap", 11.0, 2.2, 20.0, depth, G)
    k = omega**2 / G + 1e-3
    for _ in range(50):
        k -= (G * k * np.tanh(k * depth) - omega**2) / (
            G * np.tanh(k * depth) + G * k * depth / np.cosh(k * depth) ** 2
        )
    square = (omega * np.cosh(k * (z + depth)) / np.sinh(k * depth)) ** 2 * S / S.sum()
    return square.sum(), (omega**2 * square).sum()


class TestParts:
    def test_vortices(self):
        """Statistics equal the closed form for the mean square strength and core of this area, which is not square."""
        ((variance, omega),) = current_parts(
            site(*VORTICES, "current.core_radius_min=20", "reference.straight_speed=2")
        )
        strength = np.linspace(10, 40, 100001)
        strength = 3 * np.mean(strength**2) / (WIDTH * LENGTH)
        delta2 = 20.0 * 30.0
        logarithm = math.log(WIDTH * LENGTH / math.pi / delta2) + np.euler_gamma - math.log(2)
        assert variance == pytest.approx(strength * logarithm / (8 * math.pi), rel=1e-3)
        assert variance * omega**2 == pytest.approx(2.0**2 * strength / (8 * math.pi * delta2), rel=1e-3)
        assert current_parts(site("current.count=3")) == []

    def test_a_pattern_of_vortices_at_depth(self):
        """By the sum over wave numbers, for the same mean square core, at the AUVs' depth."""
        pattern = ["current.core_radius_min=15", "current.core_radius_max=15", "current.period=400"]
        ((variance, omega),) = current_parts(
            site(*VORTICES, *pattern, "current.decay_depth=200", "reference.straight_speed=2")
        )
        strength = 3 * np.mean(np.linspace(10, 40, 100001) ** 2) / 400**2
        n = np.arange(-120, 121)
        k2 = (2 * math.pi / 400) ** 2 * (n**2 + n[:, None] ** 2)
        spectrum = np.exp(-k2 * 15**2 / 2) / np.where(k2 > 0, k2, np.inf)
        assert variance == pytest.approx(strength / 400**2 * spectrum.sum() / 2 * math.exp(-1), rel=0.01)
        slopes = strength / 400**2 * (np.exp(-k2 * 15**2 / 2).sum() - 1) / 4
        assert variance * omega**2 == pytest.approx(2.0**2 * slopes * math.exp(-1), rel=0.02)

    def test_short_waves(self):
        ((variance, omega),) = current_parts(site(*STORM, "auv.depth=30"))
        square, change = orbital(-30.0, DEPTH)
        assert variance == pytest.approx(0.5 * square, rel=1e-4)  # η = 1 m: Hs = 4 m
        assert omega == pytest.approx(math.sqrt(change / square), rel=1e-4)

    @pytest.mark.parametrize(("edge", "across"), [("east", WIDTH), ("south", LENGTH)])
    def test_forced_waves_before_a_wall(self, edge, across):
        """The mean square of √(g/h) sin ks/cos kL over the way from the wall; of both axes, only one moves."""
        forced = [
            f"sea.forced_edge={edge}",
            "sea.regular_amplitude=0.5",
            "sea.regular_period=60",
            "sea.irregular_rms=0.3",
        ]
        regular, irregular = current_parts(site(*forced))
        for (variance, omega), square, period in (
            (regular, 0.5**2 / 2, 60.0),
            (irregular, 0.3**2, math.sqrt(75 * 300)),
        ):
            assert omega == pytest.approx(2 * math.pi / period)
            s = (np.arange(100000) + 0.5) / 100000 * across
            k = omega / math.sqrt(G * DEPTH)
            along = G / DEPTH * np.mean(np.sin(k * s) ** 2) / math.cos(k * across) ** 2
            assert variance == pytest.approx(0.5 * along * square, rel=1e-5)

    @pytest.mark.parametrize("lets_out", ["sea.forcing=incident", "sea.radiating_edges=['west']"])
    def test_forced_waves_that_leave(self, lets_out):
        forced = ["sea.forced_edge=east", "sea.regular_amplitude=0.5", "sea.regular_period=40", lets_out]
        ((variance, omega),) = current_parts(site(*forced))
        assert (variance, omega) == pytest.approx((0.5 * G / DEPTH * 0.5**2 / 2, 2 * math.pi / 40))

    def test_a_current_from_a_file(self):
        """The current at the AUVs counts: mean square of a component and of its change along a way in any direction."""
        ((variance, omega),) = current_parts(with_flow("reference.straight_speed=2"))
        y, x = np.meshgrid(np.linspace(0, LENGTH, 5), np.linspace(0, WIDTH, 9), indexing="ij")
        both = np.stack([0.2 + 3e-3 * x + 1e-3 * y, -0.3 + 2e-3 * x + 5e-3 * y])
        assert variance == pytest.approx(np.mean(both**2), rel=1e-5)
        direction = np.linspace(0, 2 * math.pi, 1000, endpoint=False)
        gradient = np.array([[3e-3, 1e-3], [2e-3, 5e-3]]) @ [np.cos(direction), np.sin(direction)]
        assert variance * omega**2 == pytest.approx(2.0**2 * np.mean(gradient**2), rel=1e-4)


class TestModel:
    @pytest.mark.parametrize(("attitude", "sides"), [(0.0, (WIDTH, LENGTH)), (0.01, (LENGTH, WIDTH))])
    def test_fixes_are_those_from_a_quarter_of_the_smaller_side(self, attitude, sides):
        """m⁴ D(m)/m = R t; R is the planner's noise there, in the mean of the AUVs, and the attitude's by the depth."""
        area = [f"area.width={sides[0]:g}", f"area.length={sides[1]:g}"]
        changes = [*STORM, *VORTICES, *area, "auv.depth=40", "mission.step=2", f"usbl.attitude_error={attitude}"]
        place = site(*changes)
        link = link_table(place).astype(float)
        slant = math.hypot(40.0, LENGTH / 4)
        noise = [
            (slant / row[acoustic_link.REFERENCE]) ** (2 * row[acoustic_link.POWER])
            / math.exp(row[acoustic_link.LEVEL])
            for row in link
        ]
        assert noise[0] != pytest.approx(noise[1], rel=0.01)
        R = np.mean(noise) + (attitude * 40) ** 2
        parts = current_parts(place)

        def increment(m: float) -> float:
            return sum(2 * square * (1 - math.exp(-((omega * m) ** 2) / 2)) for square, omega in parts)

        m = brentq(lambda m: m**3 * increment(m) - R * 2.0, 1e-3, 1e3)
        variance, time = current_model(place, link_table(place))
        assert variance == pytest.approx(sum(square for square, _ in parts))
        assert 2 * variance / time == pytest.approx(increment(m) / m, rel=1e-4)


def test_speeds_to_expect_about_a_uniform_current():
    """Normal about it with the variance of the eddies."""
    (variance, _), U = current_parts(site(*VORTICES))[0], 0.4
    found = drift_speeds(site(*VORTICES, f"current.speed={U}"), Level.cruise, (0.5, 0.99))
    deviation = math.sqrt(variance)
    np.testing.assert_allclose(found, rice.ppf((0.5, 0.99), U / deviation, scale=deviation), rtol=5e-3)
    alone = drift_speeds(site(f"current.speed={U}"), Level.cruise, (0.5, 0.99))
    np.testing.assert_allclose(alone, U, rtol=1e-6)


class TestBound:
    def test_still_water_leaves_a_box(self):
        assert current_bound(site()) == 0.1

    def test_vortices(self):
        """1.001 times the sum of their largest speeds, of Lamb and Oseen."""
        r = np.linspace(0.1, 90, 100000)
        fastest = (40 / (2 * math.pi * r) * -np.expm1(-((r / 30) ** 2))).max()
        assert current_bound(site(*VORTICES)) == pytest.approx(1.001 * 3 * fastest, rel=1e-4)

    def test_short_waves(self):
        square, _ = orbital(-30.0, DEPTH)
        assert current_bound(site(*STORM, "auv.depth=30")) == pytest.approx(1.001 * 6 * math.sqrt(square), rel=1e-4)

    def test_a_current_from_a_file(self):
        """The largest speed at the AUVs' depth lies in the north-east corner."""
        u, v = 0.2 + 3e-3 * WIDTH + 1e-3 * LENGTH, -0.3 + 2e-3 * WIDTH + 5e-3 * LENGTH
        assert current_bound(with_flow()) == pytest.approx(1.001 * math.hypot(u, v), rel=1e-5)

    @pytest.mark.parametrize(("edge", "across"), [("west", WIDTH), ("north", LENGTH)])
    def test_long_waves(self, edge, across):
        """Forced ones in phase before a wall, √(g/h) |sin ks|/|cos kL|."""
        forced = [f"sea.forced_edge={edge}", "sea.regular_amplitude=0.5", "sea.regular_period=40"]
        k = 2 * math.pi / 40 / math.sqrt(G * DEPTH)
        s = np.linspace(0, across, 65)
        wave = 0.5 * math.sqrt(G / DEPTH) * np.abs(np.sin(k * s)).max() / abs(math.cos(k * across))
        assert speed_bound(site(*forced)) == pytest.approx(wave, rel=1e-6)
        assert speed_bound(site()) == 0.0
        incident = speed_bound(site(*forced, "sea.forcing=incident"))
        assert incident == pytest.approx(2 * wave * abs(math.cos(k * across)), rel=1e-6)
        out = {"west": "east", "north": "south"}[edge]
        leaving = speed_bound(site(*forced, f"sea.radiating_edges=['{out}']"))
        assert leaving == pytest.approx(0.5 * math.sqrt(G / DEPTH), rel=1e-6)
