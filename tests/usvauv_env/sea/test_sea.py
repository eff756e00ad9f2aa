"""The sea of a scenario: the same for every grid and number of seas, with the stated statistics, without a shock."""

import math

import numpy as np
import pytest
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


def between_cells(fine: np.ndarray, cells: tuple[int, int]) -> np.ndarray:
    """A finely resolved elevation at the cell centres of another grid, bilinear."""
    for axis, count in ((0, cells[1]), (1, cells[0])):
        at = (np.arange(count) + 0.5) * fine.shape[axis] / count - 0.5
        low = np.clip(np.floor(at).astype(int), 0, fine.shape[axis] - 2)
        weight = (at - low).reshape((-1, 1) if axis == 0 else (1, -1))
        fine = np.take(fine, low, axis) * (1 - weight) + np.take(fine, low + 1, axis) * weight
    return fine


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

    def test_open_basin_carries_a_progressive_wave(self):
        """Forced in the west with an open east: e^{i(ωt − kx)} from the start on, in exact arithmetic."""
        wave = {"regular_amplitude": 1.0, "regular_period": 60.0}
        sea = sea_of(scenario(forced_edge="west", radiating_edges=["east"], **wave), 0, 1, (100, 20))
        k = 2 * math.pi / 60 / math.sqrt(9.81 * 120)
        x = (np.arange(100) + 0.5) * 2
        for _ in range(90):
            expected = np.cos(2 * math.pi / 60 * sea.time - k * x)
            np.testing.assert_allclose(sea.elevation()[0], np.broadcast_to(expected, (20, 100)), atol=1e-3)
            sea.advance()

    def test_incoming_wave(self):
        """Prescribed as the incoming wave at the open side opposite a wall: twice its amplitude stands at the wall."""
        wave = {"regular_amplitude": 1.0, "regular_period": 40.0, "forcing": "incident"}
        sea = sea_of(scenario(forced_edge="west", **wave), 0, 1, (100, 20))
        k = 2 * math.pi / 40 / math.sqrt(9.81 * 120)
        x = (np.arange(100) + 0.5) * 2
        for _ in range(90):
            t = sea.time * 2 * math.pi / 40
            expected = np.cos(t - k * x) + np.cos(t + k * (x - 400))
            np.testing.assert_allclose(sea.elevation()[0], np.broadcast_to(expected, (20, 100)), atol=2e-3)
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


class TestResolution:
    def test_table_1_and_fine_grid_see_the_same_storm(self):
        """With forcing and drag: the error against 512² is what Richardson predicts from 25² and 50², a third of
        their difference; half of it is allowed."""
        sea = {"forced_edge": "south", "irregular_rms": 0.5, "drag": 0.01}
        storm = scenario(**sea, update_interval=2.0)
        coarse, middle, fine = (sea_of(storm, 9, 1, cells) for cells in ((25, 25), (50, 50), (512, 512)))
        predicted, found = 0.0, 0.0
        for _ in range(10):
            for solver in (coarse, middle, fine):
                solver.advance()
            seen = middle.elevation()[0]
            at_coarse = between_cells(seen.astype(float), (25, 25))
            predicted += np.mean((coarse.elevation()[0] - at_coarse) ** 2)
            found += np.mean((seen - between_cells(fine.elevation()[0].astype(float), (50, 50))) ** 2)
        assert math.sqrt(found) < math.sqrt(predicted) / 2
        assert math.sqrt(found / 10) < 0.05 * np.std(seen)


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

    def test_no_resonance(self):
        """A wave four times as long as the area, ten times as high at a wall as at the edge, is as high everywhere."""
        wide = Scenario.load("wide", ["sea.irregular_rms=0", "sea.regular_amplitude=0.1", "sea.regular_period=69.9"])
        sea = sea_of(wide, 0, 1)
        highest = np.zeros((sea.ny, sea.nx))
        for _ in range(700):
            sea.advance()
            highest = np.maximum(highest, sea.elevation()[0])
        np.testing.assert_allclose(highest, 0.1, rtol=0.01)

    def test_infragravity_height(self):
        """α1 Hs Tm² √(g/h) of the spectrum integrated here: two decimetres over 120 m."""

        def density(f: float) -> float:
            r = 11 * f
            return r**-5 * math.exp(-1.25 * r**-4) * 2.2 ** math.exp(-((r - 1) ** 2) / (0.0098 if r < 1 else 0.0162))

        ends = 0.5 / 11, math.sqrt(9.81 * 2 * math.pi / 7.7) / (2 * math.pi)  # down to waves of the boat's length
        square = quad(lambda f: density(f) / f**2, *ends)[0] / quad(density, *ends)[0]
        height = 1.2e-3 * 6.5 * square * math.sqrt(9.81 / 120)
        assert 0.15 < height < 0.3
        assert 4 * long_wave_rms(Site(Scenario.load("extreme"))) == pytest.approx(height, rel=1e-3)
        deep = ["area.depth=480", "storm.swells=[[6.5, 11.0, 2.2, 0.0, 10.0]]"]  # twice the energy
        assert 4 * long_wave_rms(Site(Scenario.load("extreme", deep))) == pytest.approx(height / math.sqrt(2), rel=1e-3)
        assert long_wave_rms(Site(Scenario.load("extreme", ["storm.spectrum=none"]))) == 0.0


def test_the_swell_of_bore_breaks_into_fronts_that_conserve_water():
    """A front moves at [h u]/[h] (Rankine and Hugoniot), the jumps of transport and depth between its two sides."""
    sea = SeaSimulation(Scenario.load("bore"), 0, (400, 4), 0.5)
    x, demanded, heights = [], [], []
    for step in range(80):
        sea.advance()
        if step >= 60:
            eta, u = sea.surface().elevation[1], sea.velocity()[0][1]
            front = np.argmin(np.diff(eta))
            sides = front + np.array([-4, 5])
            h = 6.0 + eta[sides]
            x.append(sea.x[front])
            demanded.append(np.diff(h * u[sides])[0] / np.diff(h)[0])
            heights.append(eta[sides[0]] - eta[sides[1]])
    assert min(heights) > 1.5
    assert np.polyfit(0.5 * np.arange(20), x, 1)[0] == pytest.approx(np.mean(demanded), rel=0.02)


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
