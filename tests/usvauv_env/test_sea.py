"""The sea of a scenario, with worlds and alone: the same for any grid and number of seas, its statistics, no shock."""

import math

import numpy as np
import pytest
import torch
from scipy.integrate import quad

from usvauv.env import Scenario
from usvauv.env.sea.long_waves import boundary_waves, build_sea, long_wave_rms
from usvauv.env.sea.simulation import SeaSimulation
from usvauv.env.site.site import Site

SIDES = ["west", "east", "south", "north"]


def scenario(width: float = 200.0, length: float = 200.0, **sea) -> Scenario:
    return Scenario.from_dict({"area": {"width": width, "length": length}, "sea": sea})


def sea_of(scenario: Scenario, seed: int, num_seas: int, cells: tuple[int, int] | None = None):
    """Seas of a scenario at its own site."""
    return build_sea(Site(scenario), [(seed, sea) for sea in range(num_seas)], cells)


STORM = {"forced_edge": "west", "irregular_rms": 0.5, "regular_amplitude": 0.3}


class TestSeeds:
    def test_a_sea_does_not_depend_on_the_others(self):
        few, more = (sea_of(scenario(**STORM), 11, n, (20, 20)) for n in (3, 19))
        for _ in range(3):
            few.advance()
            more.advance()
        np.testing.assert_array_equal(few.elevation(), more.elevation()[:3])

    def test_seeds_and_seas_differ(self):
        storm = scenario(**STORM)
        one, two = (sea_of(storm, seed, 2, (20, 20)).elevation() for seed in (1, 2))
        again = sea_of(storm, 1, 2, (20, 20)).elevation()
        np.testing.assert_array_equal(one, again)
        fields = [one[0], one[1], two[0], two[1]]
        for a in range(4):
            for b in range(a):
                assert np.abs(fields[a] - fields[b]).max() > 0.1


class TestStatistics:
    def test_boundary_wave(self):
        """Exact rms, equal amplitudes, one frequency in each band, and the regular component first, with phase 0."""
        about = {"irregular_rms": 0.8, "irregular_components": 12, "regular_amplitude": 0.3, "regular_period": 500.0}
        waves = boundary_waves(Site(scenario(forced_edge="east", **about)), [(0, 0), (0, 1)])
        for amplitude, period, phase in zip(*waves, strict=True):
            assert (amplitude[0], period[0], phase[0]) == (0.3, 500.0, 0.0)
            np.testing.assert_allclose(amplitude[1:] ** 2 / 2, 0.8**2 / 12)
            band = (1 / period[1:] - 1 / 300) / (1 / 75 - 1 / 300) * 12
            np.testing.assert_array_equal(np.floor(band), np.arange(12))
            assert np.ptp(phase[1:]) > 2
        assert (waves.period[0, 1:] != waves.period[1, 1:]).all()


class TestForcing:
    @pytest.mark.parametrize(("side", "drag"), [*zip(SIDES, (0.0, 0.05, 0.05, 0.0), strict=True)])
    def test_steady_from_the_start(self, side, drag):
        """A regular wave is Eq. 7's seiche, with drag its damped form, from t = 0 on: at every time the same phasor.

        The half cell at the boundary is wrong by (kΔx)²/8 of the elevation = 2e-5, and the start excites free waves of
        that size: a few times that in all.
        """
        wave = {"regular_amplitude": 1.0, "regular_period": 60.0, "drag": drag}
        storm = scenario(200.0, 120.0, forced_edge=side, update_interval=3.0, **wave)
        sea = sea_of(storm, 0, 1, (50, 30))
        across = side in ("west", "east")
        L, n = (200.0, 50) if across else (120.0, 30)
        omega = 2 * math.pi / 60
        k = np.sqrt((omega**2 - 1j * omega * drag) / (9.81 * 120))
        s = (np.arange(n) + 0.5) * L / n
        s = L - s if side in ("west", "south") else s
        shape = np.cos(k * s) / np.cos(k * L)
        for _ in range(25):
            expected = (shape * np.exp(1j * omega * sea.time)).real
            found = sea.elevation()[0] if across else sea.elevation()[0].T
            np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-4)
            sea.advance()

    def test_forcing_sets_in_smoothly(self):
        """The record at the wall is smooth: no second difference in time is larger than the waves' own, a ω² dt²."""
        storm = scenario(forced_edge="west", irregular_rms=1.0, update_interval=1.0)
        sea = sea_of(storm, 4, 1, (50, 50))
        wall = []
        for _ in range(120):
            wall.append(sea.elevation()[0, 20, -1])
            sea.advance()
        most = 16 * math.sqrt(2 / 16) * 1.2 * (2 * math.pi / 75) ** 2  # all components in phase at the shortest period
        assert np.abs(np.diff(wall, n=2)).max() < most


CALM = {"forced_edge": "south", "irregular_rms": 0.02, "update_interval": 2.0}


class TestNonlinear:
    def test_high_waves_over_shallow_water_steepen(self):
        """A wave of a fifth of the depth: the crest catches up with the trough before it, unlike the linear one."""
        about = {"forced_edge": "west", "radiating_edges": ["east"], "regular_amplitude": 1.0, "regular_period": 20.0}
        steepest = {}
        for equations in ("linear", "nonlinear"):
            sea = sea_of(
                Scenario.from_dict(
                    {
                        "area": {"width": 200, "length": 40, "depth": 5},
                        "auv": {"depth": 3, "start_separation": 5},
                        "sea": {**about, "equations": equations},
                    }
                ),
                0,
                1,
                (200, 10),
            )
            for _ in range(60):
                sea.advance()
            slope = np.diff(sea.elevation()[0, 5, 50:190])
            steepest[equations] = slope.max() / -slope.min(), -slope.min() / slope.max()
        assert max(steepest["linear"]) < 1.1
        assert max(steepest["nonlinear"]) > 1.5


class TestOpenWater:
    @pytest.mark.parametrize("name", ["extreme", "wide"])
    def test_long_waves_run_through(self, name):
        """Σ a cos(ω(t − (L − x)/c) + φ) for half an hour, the same at all y: no wave comes back, and none grows."""
        site = Site(Scenario.load(name))
        seas = [(7, index) for index in range(16)]
        wave, sea = boundary_waves(site, seas), build_sea(site, seas)
        c, L = math.sqrt(9.81 * 120), site.scenario.area.width
        late = (L - (np.arange(sea.nx) + 0.5) * sea.dx) / c
        angle = 2 * math.pi / wave.period
        worst, squares = 0.0, np.zeros(sea.nx)
        for _ in range(1800):
            sea.advance()
            found = sea.elevation().astype(float)
            phase = angle[:, :, None] * (sea.time - late) + wave.phase[:, :, None]
            expected = (wave.amplitude[:, :, None] * np.cos(phase)).sum(axis=1)
            worst = max(worst, np.abs(found - expected[:, None, :]).max())
            squares += (found**2).mean(axis=(0, 1)) / 1800
        rms = long_wave_rms(site)
        assert worst < 0.02 * rms
        np.testing.assert_allclose(np.sqrt(squares), rms, rtol=0.02)
        np.testing.assert_allclose(squares, squares.mean(), rtol=0.01)

    def test_infragravity_height(self):
        """α1 Hs Tm² √(g/h) of the spectrum integrated here: two decimetres over 120 m."""

        def density(f: float) -> float:
            r = 11 * f
            return r**-5 * math.exp(-1.25 * r**-4) * 2.2 ** math.exp(-((r - 1) ** 2) / (0.0098 if r < 1 else 0.0162))

        ends = 0.5 / 11, math.sqrt(9.81 * 2 * math.pi / 20) / (2 * math.pi)  # down to waves of 20 m
        square = quad(lambda f: density(f) / f**2, *ends)[0] / quad(density, *ends)[0]
        height = 1.2e-3 * 6.5 * square * math.sqrt(9.81 / 120)
        assert 0.15 < height < 0.3
        assert 4 * long_wave_rms(Site(Scenario.load("extreme"))) == pytest.approx(height, rel=1e-3)
        deep = ["area.depth=480", "storm.swells=[[6.5, 11.0, 2.2, 0.0, 10.0]]"]  # twice the energy
        assert 4 * long_wave_rms(Site(Scenario.load("extreme", deep))) == pytest.approx(height / math.sqrt(2), rel=1e-3)
        assert long_wave_rms(Site(Scenario.load("extreme", ["storm.spectrum=none"]))) == 0.0


def test_table_1_tide_is_flat():
    """Five metres high and flat to 2 µm by Eq. 7 (λ is 1482 km, the area 0.2 km); solved, to single precision."""
    kL = 2 * math.pi / 43200 / math.sqrt(9.81 * 120) * 200
    assert 5 * (1 / math.cos(kL) - 1) < 2e-6
    sea = sea_of(Scenario.load("paper-extreme"), 0, 1, (50, 50))
    for _ in range(3):
        sea.advance()
    elevation = sea.elevation()[0]
    assert elevation.mean() == pytest.approx(5.0, abs=1e-3)
    assert np.ptp(elevation) < 64 * np.spacing(np.float32(5))


WIDTH, LENGTH, SHAPE = 210.0, 100.0, (7, 5)  # cells of 30 × 20 m
WAVES = {"forced_edge": "west", "irregular_rms": 0.5}


@pytest.fixture
def vortices(device) -> torch.Tensor:
    return torch.tensor([[[90.0, 40.0, 30.0, 10.0], [110.0, 60.0, 30.0, 15.0]]], device=device)


def alone(step: float = 1.0, **current: object) -> Scenario:
    return Scenario.from_dict(
        {
            "area": {"width": WIDTH, "length": LENGTH},
            "mission": {"step": step},
            "sea": WAVES,
            "storm": {"spectrum": "pm"},
            "current": current,
        }
    )


class TestVortices:
    def test_cores_spread(self, vortices):
        """dδ²/dt = 4ν; what was given stays as it is."""
        sea = SeaSimulation(alone(viscosity=0.7), 0, SHAPE, 1.6, vortices)
        given = vortices.cpu().numpy().copy()
        for _ in range(3):
            sea.advance()
        np.testing.assert_allclose(sea.vortices[:, 3] ** 2, np.array([100, 225]) + 4 * 0.7 * 4.8, rtol=1e-5)
        np.testing.assert_array_equal(sea.vortices[:, :3], given[0, :, :3])
        np.testing.assert_array_equal(vortices.cpu(), given)
        assert not sea.steady

    def test_that_neither_spread_nor_move_are_steady(self, vortices):
        sea = SeaSimulation(alone(), 0, SHAPE, 1.0, vortices)
        sea.advance()
        np.testing.assert_array_equal(sea.vortices, vortices[0].cpu())
        assert sea.steady
        assert SeaSimulation(alone(viscosity=1, mutual=True), 0, SHAPE, 1.0).steady  # has none
