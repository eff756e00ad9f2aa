"""Seas as they are drawn: strata of a storm, systems of files, the start of forced waves, and costs."""

import math
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from usvauv.env import Scenario, ScenarioError
from usvauv.env.sea import build, storm
from usvauv.env.sea.build import BoundaryWave, add_response, boundary_wave, start_elevation
from usvauv.env.sea.long_waves import SeaWatch
from usvauv.env.sea.storm import _as_storm, band, build_storm, cut_off, moment, total_height, wave_systems
from usvauv.env.site.site import Site
from usvauv.env.site.waves import Partition, Waves, WaveSpectrum
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.flow.airy import wavenumber
from usvauv.kernels.shallow_water.discretisation import LANES, Packing

G, DEPTH = 9.81, 40.0
LONG = {"significant_height": 1.0, "peak_period": 20.0}
SWELL = [2.0, 16.0, 3.3, 0.5, 40.0]


def scenario(width: float = 210.0, length: float = 100.0, storm: dict | None = None, **sea) -> Scenario:
    area = {"width": width, "length": length, "depth": DEPTH}
    return Scenario.from_dict({"area": area, "auv": {"depth": 30}, "sea": sea, "storm": storm or {}})


class TestStrata:
    STORM = scenario(storm={"spectrum": "jonswap", "components": 16, "direction": 2.0, "swells": [SWELL]}).storm

    def test_components_have_equal_parts_of_energy_and_slope(self):
        """Component i lies in the stratum i, has its energy, and one of the directions that share out the sectors."""
        systems, n = self.STORM.systems, 16
        drawn = build_storm(self.STORM, systems, depth=DEPTH, gravity=G, levels=[0.0], seas=[(5, 0), (5, 7), (8, 0)])
        for number, system in enumerate(systems):
            omega, S = band("jonswap", system.peak_period, system.gamma, 20.0, DEPTH, G)
            parts = [S, wavenumber(omega, DEPTH, G) ** 2 * S]
            energy, slope = (np.cumsum(np.append(0, (part[1:] + part[:-1]) / 2)) for part in parts)
            weight = energy / energy[-1] / 2 + slope / slope[-1] / 2
            edges = np.interp(np.arange(n + 1) / n, weight, omega)
            share = np.diff(np.interp(edges, omega, energy / energy[-1]))
            own = slice(number * n, (number + 1) * n)
            for sea in range(3):
                a, direction, phase = drawn.amplitude[sea, own], drawn.direction[sea, own], drawn.phase[sea, own]
                np.testing.assert_allclose(a**2 / 2, (system.significant_height / 4) ** 2 * share, rtol=1e-3)
                assert (edges[:-1] - 1e-6 <= drawn.omega[sea, own]).all()
                assert (drawn.omega[sea, own] <= edges[1:] + 1e-6).all()
                theta, probability = storm.spread(system.spreading)
                sector = np.interp(direction - system.direction, theta, probability) * n
                np.testing.assert_array_equal(np.sort(np.floor(sector)), np.arange(n))
                assert not np.array_equal(np.floor(sector), np.arange(n))
                assert (phase >= 0).all()
                assert np.ptp(phase) > math.pi > phase.max() / 2

    def test_elevation_is_the_sum_of_cosines(self):
        drawn = build_storm(self.STORM, self.STORM.systems, depth=DEPTH, gravity=G, levels=[0.0], seas=[(5, 0), (5, 7)])
        drawn.set_time(321.0)
        x, y = np.array([3.0, 70.0, 201.0, 14.0]), np.array([90.0, 5.0, 33.0])
        X, Y = np.meshgrid(x, y)
        expected = sum(
            a * np.cos(k * math.cos(d) * X + k * math.sin(d) * Y - o * 321.0 + p)
            for a, k, d, o, p in zip(
                *(part[1] for part in (drawn.amplitude, drawn.k, drawn.direction, drawn.omega, drawn.phase)),
                strict=True,
            )
        )
        np.testing.assert_allclose(drawn.elevation(1, x, y), expected, atol=1e-4)


def with_waves(*partitions: Partition, spectrum: WaveSpectrum | None = None, mean_depth: float = DEPTH, **given):
    """A site with waves of a file; `given` of the section `storm`."""
    waves = Waves("waves.nc", "", spectrum, partitions, None)
    return SimpleNamespace(scenario=scenario(storm=given), waves=waves, mean_depth=mean_depth)


def part(height: float, period: float, spread: float | None = 0.5, mean_period: bool = False) -> Partition:
    return Partition(height, period, 1.0, spread, mean_period, True)


class TestFiles:
    def test_energy_of_waves_that_are_too_short_goes_to_the_others(self):
        """Those with twice the peak's frequency above the cut-off; parts of less than a hundredth do not count."""
        systems = wave_systems(with_waves(part(4, 12), part(2, 9), part(0.9, 3), part(0.04, 12), part(0.02, 3)))
        scale = math.hypot(4, 2, 0.9) / math.hypot(4, 2)
        assert [each.significant_height for each in systems] == pytest.approx([4 * scale, 2 * scale])
        assert total_height(systems) == pytest.approx(math.hypot(4, 2, 0.9))
        assert len(wave_systems(with_waves(part(4, 12), part(0.0401, 12)))) == 2

    @pytest.mark.parametrize("period", [6.9, 7.3])
    def test_too_short_is_less_than_twice_the_frequency_of_the_peak(self, period):
        """At 20 m in 40 m of water: 2π/Tp ≤ ω/2, Tp ≥ 7.16 s."""
        systems = wave_systems(with_waves(part(4, 14), part(0.5, period)))
        assert len(systems) == (2 if period > 4 * math.pi / cut_off(20.0, DEPTH, G) else 1)

    @pytest.mark.parametrize(("height", "refused"), [(1.3, False), (1.36, True)])
    def test_a_tenth_of_the_energy_at_most_is_left_out(self, height, refused):
        """1.3² is 9.6 % of 4² + 1.3², 1.36² is 10.4 %."""
        site = with_waves(part(4, 12), part(height, 3))
        if refused:
            with pytest.raises(ScenarioError, match="shortest_wave = 20: leaves out 10% of the energy of waves"):
                wave_systems(site)
        else:
            assert total_height(wave_systems(site)) == pytest.approx(math.hypot(4, height))

    @pytest.mark.parametrize("mean_depth", [DEPTH, 10.0])
    def test_of_a_spectrum_too(self, mean_depth):
        """An even one from 0.05 to 0.2 Hz; waves of 60 m are slower in shallow water, which counts."""
        f = np.linspace(0.05, 0.2, 7)
        density = np.full((7, 8), 0.05)
        even = WaveSpectrum(f, np.arange(8) * math.pi / 4, density)
        highest = math.sqrt(G * 2 * math.pi / 60 * math.tanh(2 * math.pi / 60 * mean_depth)) / (2 * math.pi)
        left_out = (0.2 - highest) / 0.15
        with pytest.raises(ScenarioError, match=f"shortest_wave = 60: leaves out {left_out:.0%} of the energy"):
            wave_systems(with_waves(spectrum=even, mean_depth=mean_depth, shortest_wave=60))
        assert wave_systems(with_waves(spectrum=even, shortest_wave=20)) == (even,)
        omega, S = storm.density(even, 60.0, mean_depth, G)
        assert (omega[0], omega[-1]) == pytest.approx((2 * math.pi * 0.05, 2 * math.pi * highest))
        np.testing.assert_allclose(S, 8 * 0.05 * math.pi / 4)
        assert storm.density(even, 5.0, mean_depth, G)[0][-1] == pytest.approx(2 * math.pi * 0.2)

    def test_a_part_as_a_system_of_a_scenario(self):
        """Mean periods T₋₁,₀ of Pierson and Moskowitz are Γ(5/4)/1.25^¼ of the peak's; √(2/(s + 1)) is the spread."""
        pm = scenario(storm={"spectrum": "pm", "spreading": 7.0, "swells": [SWELL]}).storm
        found = _as_storm(part(3, 8, 0.5, mean_period=True), pm)
        assert found.peak_period == pytest.approx(8 * 1.25**0.25 / math.gamma(1.25), rel=1e-4)
        assert found.spreading == pytest.approx(2 / 0.5**2 - 1)
        assert (found.spectrum, found.significant_height, found.direction, found.swells) == ("pm", 3, 1.0, ())
        assert _as_storm(part(3, 8, None), pm).spreading == 7.0
        assert _as_storm(part(3, 8, 0.0), pm).spreading == storm.NARROWEST
        assert _as_storm(part(3, 8), pm).peak_period == 8
        assert _as_storm(part(3, 8), scenario().storm).spectrum == "jonswap"
        assert moment(found) == pytest.approx(7 / 8 * complex(math.cos(1), math.sin(1)))


class TestResponse:
    """The steady response to a boundary wave, by complex closed forms, on 7 × 5 cells."""

    @pytest.mark.parametrize("edge", ["west", "east", "south", "north"])
    @pytest.mark.parametrize(
        ("lets_out", "forcing", "drag"),
        [(False, "elevation", 0.0), (False, "elevation", 0.02), (False, "incident", 0.01), (True, "elevation", 0.01)],
    )
    def test_elevation_and_velocities(self, edge, lets_out, forcing, drag):
        opposite = {"west": "east", "east": "west", "south": "north", "north": "south"}[edge]
        open_edges = [opposite] if lets_out else []
        place = scenario(forced_edge=edge, radiating_edges=open_edges, forcing=forcing, drag=drag)
        wave = BoundaryWave(np.array([0.3, 0.2]), np.array([47.0, 31.0]), np.array([0.4, -1.0]))
        eta, u, v = np.ones((5, 7)), np.ones((5, 8)), np.ones((6, 7))
        add_response(place, wave, DEPTH, eta, u, v)
        along_x = edge in ("west", "east")
        n, length = (7, 210.0) if along_x else (5, 100.0)
        forwards = edge in ("east", "north")
        elevation, speed = np.zeros(n), np.zeros(n + 1)
        for a, T, phase in zip(*wave, strict=True):
            omega, Z = 2 * math.pi / T, a * np.exp(1j * phase)
            k = np.sqrt((omega**2 - 1j * omega * drag) / (G * DEPTH))
            for target, places in ((elevation, np.arange(n) + 0.5), (speed, np.arange(n + 1))):
                s = places * length / n if forwards else length - places * length / n
                if lets_out:
                    height, slope = Z * np.exp(1j * k * (s - length)), 1j * k * Z * np.exp(1j * k * (s - length))
                else:
                    scale = 2 * Z * np.exp(-1j * k * length) if forcing == "incident" else Z / np.cos(k * length)
                    height, slope = scale * np.cos(k * s), -scale * k * np.sin(k * s)
                if target is elevation:
                    target += height.real
                else:
                    target += (-G * slope / (1j * omega + drag)).real * (1 if forwards else -1)
        moving, still = (u, v) if along_x else (v, u)
        shape = (lambda field: field) if along_x else (lambda field: field[:, None])
        np.testing.assert_allclose(eta, 1 + np.broadcast_to(shape(elevation), eta.shape), rtol=1e-9)
        np.testing.assert_allclose(moving, 1 + np.broadcast_to(shape(speed), moving.shape), rtol=1e-9)
        assert (still == 1).all()

    @pytest.mark.parametrize(("cosine", "rests"), [(0.099, True), (0.101, False)])
    def test_a_component_near_resonance_starts_from_rest(self, cosine, rests):
        """Where 1/cos kL is above ten; the other one does not."""
        periods = 2 * math.pi * 210 / math.sqrt(G * DEPTH) / np.array([math.acos(cosine), 0.5])
        found = []
        for amplitude in ([0.3, 0.2], [0.0, 0.2]):
            eta, u, v = np.zeros((5, 7)), np.zeros((5, 8)), np.zeros((6, 7))
            add_response(
                scenario(forced_edge="east"), BoundaryWave(np.array(amplitude), periods, np.zeros(2)), DEPTH, eta, u, v
            )
            found.append(eta)
        assert np.array_equal(*found) == rests
        assert found[1].any()


class TestStart:
    @pytest.mark.parametrize("edge", ["none", "west", "east", "south", "north"])
    def test_modes_of_equal_variance(self, edge):
        """cos nπs between walls, cos (n + ½)πs from the wall to the forced edge, on 7 × 5 cells; no constant."""
        given, forced_x, forced_y = 0.7, edge in ("west", "east"), edge in ("south", "north")
        place = scenario(forced_edge=edge, start_rms=given, start_modes=3)
        found = start_elevation(place, np.random.default_rng(4), 7, 5)
        x, y = np.meshgrid((np.arange(7) + 0.5) / 7, (np.arange(5) + 0.5) / 5)
        x, y = 1 - x if edge == "west" else x, 1 - y if edge == "south" else y
        numbers = [np.arange(3) + 0.5 if forced else np.arange(4) for forced in (forced_y, forced_x)]
        weight = np.random.default_rng(4).standard_normal([len(each) for each in numbers])
        if edge == "none":
            weight[0, 0] = 0
        expected = np.zeros((5, 7))
        for (i, m), (j, n) in product(*map(enumerate, numbers)):
            mean_square = (1.0 if m == 0 else 0.5) * (1.0 if n == 0 else 0.5)
            expected += weight[i, j] * np.cos(m * math.pi * y) * np.cos(n * math.pi * x) / math.sqrt(mean_square)
        np.testing.assert_allclose(found, given * expected / np.linalg.norm(weight), atol=1e-12)

    def test_seas_have_their_own_waves_at_the_edge(self):
        place = scenario(forced_edge="west", irregular_rms=0.3, regular_amplitude=0.2, irregular_components=5)
        seas = [(2, 0), (2, 1), (7, 0)]
        for name, stacked in build.stacked_forcing(place, seas)._asdict().items():
            assert stacked.shape == (3, 6)
            for row, sea in zip(stacked, seas, strict=True):
                np.testing.assert_array_equal(row, getattr(boundary_wave(place, *sea), name))
        phases = build.stacked_forcing(place, seas).phase
        assert len({tuple(row) for row in phases}) == 3


class TestCosts:
    def test_three_cells_at_least(self):
        assert build.coarse_cells(scenario(cell_size=25)) == (8, 4)  # no larger cells are allowed
        assert build.fine_cells(scenario(4000.0, 100.0, fine_cells=16)) == (16, 3)
        assert build.fine_cells(scenario(100.0, 4000.0, fine_cells=16)) == (3, 16)

    @pytest.mark.parametrize(("cells", "interval"), [((7, 5), 10.0), ((70, 20), 3.0)])
    def test_substeps_are_those_of_the_solver(self, cells, interval):
        place = scenario(update_interval=interval)
        assert build.build_sea(Site(place), [(0, 0)], cells).substeps == math.ceil(build.substeps(place, cells))
        assert build.substeps(scenario(update_interval=0.01), cells) == 1.0

    def test_most_substeps(self, monkeypatch):
        place, nonlinear = (scenario(update_interval=9.0, equations=name) for name in ("linear", "nonlinear"))
        steps = build.substeps(place, (7, 5))
        monkeypatch.setattr(build, "MOST_SUBSTEPS", steps)
        build.check_sea(place, (7, 5), 1)
        monkeypatch.setattr(build, "MOST_SUBSTEPS", steps * 0.999)
        with pytest.raises(ScenarioError, match=r"^sea.update_interval = 9: takes .* substeps on 7 × 5 cells over 40"):
            build.check_sea(place, (7, 5), 1)
        build.check_sea(nonlinear, (7, 5), 1)

    @pytest.mark.parametrize("count", [1, 3])
    def test_what_is_asked_for_is_said(self, monkeypatch, count):
        asked = []
        monkeypatch.setattr(build, "require", lambda *given: asked.append(given[:2]))
        build.check_sea(scenario(), (7, 5), count, 1e6)
        seas = "3 seas of " if count > 1 else ""
        what = f"sea.cell_size, sea.fine_cells or --resolution: {seas}7 × 5 cells"
        assert asked == [(build.sea_bytes(scenario(), (7, 5), count) + 1e6, what)]

    @pytest.mark.parametrize(("num_seas", "cells"), [(1, (330, 210)), (3, (150, 90)), (18, (150, 90))])
    def test_memory_is_that_of_the_arrays(self, num_seas, cells):
        """Packed state and coefficients, fields drawn in double precision, twice, and the forcing of an interval."""
        place = scenario(forced_edge="west", irregular_rms=0.1, irregular_components=7, update_interval=20.0)
        solver = build.build_sea(Site(place), [(0, sea) for sea in range(num_seas)], cells)
        packed = solver._packing.columns * LANES * 4 * (cells[1] + 1)
        drawn = 2 * 3 * 8 * num_seas * cells[0] * cells[1]
        angles = solver.substeps * num_seas * (7 + 1) * 8
        expected = packed * (3 * solver._packing.blocks + 2) + drawn
        expected += angles + solver._rotation.nbytes * num_seas // solver._rotation.shape[0] + solver._prescribed.nbytes
        assert build.sea_bytes(place, cells, num_seas) == pytest.approx(expected, rel=0.02)

    def test_nonlinear_memory_grows_with_its_seas(self):
        """Each has its own fields; packed ones are made for sixteen at a time."""
        place = scenario(equations="nonlinear")
        sizes = [build.sea_bytes(place, (40, 30), n) for n in (2, 3, 16, 17)]
        assert sizes[1] - sizes[0] == pytest.approx((sizes[2] - sizes[0]) / 14)
        assert sizes[3] - sizes[2] == pytest.approx(sizes[1] - sizes[0] + 3 * 4 * LANES * 40 * 30)


def test_kinds_of_boundaries():
    edges = {"forced_edge": "south", "radiating_edges": ["west"], "sponge_edges": ["north"]}
    expected = {"south": "forced", "west": "radiating", "north": "sponge"}
    assert build.boundaries(scenario(**edges)) == expected
    assert build.boundaries(scenario(**edges, forcing="incident")) == {**expected, "south": "incident"}
    assert build.boundaries(scenario()) == {}


def test_levels_of_the_storm_are_the_surface_and_the_auvs_or_the_bed(monkeypatch):
    asked = []
    monkeypatch.setattr(build, "build_storm", lambda *given, **named: asked.append(named))
    for depth in (35.0, 25.0):
        build.build_short_waves(SimpleNamespace(scenario=scenario(), mean_depth=depth, waves=None), [(0, 0)])
    assert [(each["levels"], each["depth"]) for each in asked] == [((0.0, -30.0), 35.0), ((0.0, -25.0), 25.0)]


def test_transports_of_nonlinear_seas_are_means_of_the_cells_beside_a_face():
    """At the ends those of the cell; of three seas on 7 × 5 cells."""
    place = scenario(equations="nonlinear", start_rms=0.5, forced_edge="west", irregular_rms=0.3, update_interval=4.0)
    seas = build.build_sea(Site(place), [(2, 0), (2, 1), (3, 0)], (7, 5))
    seas.advance()
    packing, eta, (u, v) = Packing(3, 7, 5), seas.elevation(), seas.velocity()
    np.testing.assert_array_equal(packing.unpack(seas.eta, 0, 5)[..., :-1], eta)
    U, V = packing.unpack(seas.transports[0], 0, 5), packing.unpack(seas.transports[1], 0, 6)[..., :-1]
    for found, speed, axis in ((U, u, 2), (V, v, 1)):
        flow = np.moveaxis((DEPTH + eta) * speed, axis, 0)
        expected = np.concatenate([flow[:1], (flow[1:] + flow[:-1]) / 2, flow[-1:]])
        np.testing.assert_allclose(np.moveaxis(found, axis, 0), expected, rtol=1e-4, atol=1e-4)
        assert np.abs(expected).max() > 0.1
    assert (seas.time, seas.nx, seas.ny, seas.dx, seas.dy) == (4.0, 7, 5, 30.0, 20.0)


def test_each_nonlinear_sea_has_its_own_forcing():
    """And the one that fails is named."""
    place = Site(scenario(equations="nonlinear", forced_edge="west", update_interval=4.0))
    waves = np.array([[0.3], [0.5]]), np.array([[30.0], [40.0]]), np.array([[0.2], [1.0]])
    both, alone = build.build_sea(place, [(2, 0), (2, 1)], (7, 5)), build.build_sea(place, [(2, 1)], (7, 5))
    both.set_forcing(*waves)
    alone.set_forcing(*(part[1:] for part in waves))
    for seas in (both, alone):
        seas.advance()
    np.testing.assert_array_equal(both.elevation()[1], alone.elevation()[0])
    assert np.abs(both.elevation()[0] - both.elevation()[1]).max() > 1e-3
    both._solvers[1].set_state(0.0, u=np.full((5, 7), 1e30))
    with pytest.raises(FloatingPointError) as raised:
        both.advance()
    assert raised.value.args[0] == 1
    assert "infinitely fast" in raised.value.args[1]


class TestWatch:
    def sea(self, value: float, units: tuple[float, float]) -> SimpleNamespace:
        field = torch.full((5, 7), value)
        about = {"fields": [field], "elevation": lambda: field[None].numpy(), "advance": lambda: None}
        return SimpleNamespace(**about, units=units, time=6.0, nx=7, ny=5)

    @pytest.mark.cpu("a look that sees at once")
    @pytest.mark.parametrize(("units", "limit"), [((1.0, 1.0), 1e4), ((2.0, 1.0), 8.0)])
    def test_elevations_up_to_the_limit(self, units, limit):
        """The depth of a linear sea, and on land more than any bed."""
        for sign in (-1, 1):
            SeaWatch(self.sea(sign * limit, units), 8.0).advance()
            too_much = f"{1.01 * sign * limit:g} m at 6 s: must be within {limit:g} m"
            with pytest.raises(DivergenceError, match=f"^the sea: the elevation is {too_much}$"):
                SeaWatch(self.sea(1.01 * sign * limit, units), 8.0).advance()

    def test_what_a_solver_says(self):
        def fails() -> None:
            raise FloatingPointError(3, "too fast")

        sea = self.sea(0.0, (1.0, 1.0))
        sea.advance = fails
        with pytest.raises(DivergenceError, match=r"^sea 3: too fast$"):
            SeaWatch(sea, 8.0, lambda index: f"sea {index}").advance()


def test_the_first_elevation_out_of_bounds_is_named():
    elevation = np.zeros((3, 5, 7), np.float32)
    elevation[0, 4, 6], elevation[1, 3, 2], elevation[2, 0, 0] = 5.0, -7.0, math.nan
    watch = SimpleNamespace(_sea=SimpleNamespace(elevation=lambda: elevation, nx=7, ny=5), _limit=5.0)
    assert SeaWatch._worst(watch) == (1, -7.0)
    elevation[1] = 0
    index, value = SeaWatch._worst(watch)
    assert (index, math.isnan(value)) == (2, True)


class TestUnevenBed:
    def site(self, *shallow: float, storm: dict | None = None, bathymetry: str = "bed.nc"):
        """Half of it land, with cells of some depths in else deep water."""
        given = scenario(300.0, 150.0, storm=storm or {"spectrum": "pm"})
        given = given.model_copy(update={"water": given.water.model_copy(update={"bathymetry": bathymetry})})
        asked = []

        def still_depth(cells):
            asked.append(cells)
            depth = torch.full((100, 20), 500.0).numpy()
            depth[:50] = -1.0
            depth[-1, : len(shallow)] = shallow
            return depth

        return SimpleNamespace(scenario=given, waves=None, mean_depth=500.0, still_depth=still_depth, asked=asked)

    def test_says_where_and_how_much(self):
        limit = storm.shallowest_valid_depth(self.site())
        site = self.site(*[limit - 1] * 20, *[])
        said = storm.uneven_bed_warning(site)
        assert site.asked == [(128, 64)]
        assert "mean depth, 500 m, everywhere; in water shallower than" in said
        assert f"{limit:.0f} m, 2% of this one" in said
        assert "1% of this one" in storm.uneven_bed_warning(self.site(limit - 1))  # of a thousand cells one
        assert storm.uneven_bed_warning(self.site(limit)) == ""
        assert storm.uneven_bed_warning(self.site(5.0, bathymetry="")) == ""
        assert storm.uneven_bed_warning(self.site(5.0, storm={"spectrum": "none"})) == ""

    def test_limit(self):
        """Where a tenth is lost or gained by c_g H², or where the sea is higher than 0.6 of the depth."""
        limit = storm.shallowest_valid_depth(self.site(storm={"spectrum": "pm", **LONG}))
        change = [
            math.sqrt(storm.group_speed(20.0, 500.0, G) / storm.group_speed(20.0, depth, G)) - 1
            for depth in (limit + 1.3, limit)
        ]
        assert 500 / storm.BED_DEPTHS < 1.3
        assert abs(change[0]) < 0.1 < abs(change[1]) < 0.12
        assert storm.shallowest_valid_depth(self.site()) == 6.5 / 0.6
        steep = self.site(storm={"spectrum": "pm", "significant_height": 6.5, "swells": [[20.0, 16.0, 1, 0, 9]]})
        assert storm.shallowest_valid_depth(steep) >= math.hypot(6.5, 20) / 0.6
