"""Packed grids: the same sea in every packing and for any number of threads, and sampling between cells."""

import hashlib
import itertools
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import taichi as ti
import torch

from tests.cases.case import order
from tests.cases.plain import centres, many, rough_bed
from usvauv.kernels.flow.current import long_wave_surface
from usvauv.kernels.shallow_water import linear, wavefront
from usvauv.kernels.shallow_water.cellwise import CellwiseBackend
from usvauv.kernels.shallow_water.discretisation import LANES, Packing
from usvauv.kernels.shallow_water.linear import ShallowWater
from usvauv.kernels.shallow_water.wavefront import BandTable, Extent

THREADS = """
import sys
from usvauv.kernels import runtime
from usvauv.kernels.shallow_water import wavefront
runtime.start("cpu", threads=int(sys.argv[1]))
wavefront.CACHE, wavefront.WAKE, wavefront.COPY = int(sys.argv[2]), 1e-12, float(sys.argv[3])
from tests.kernels.shallow_water.test_packing import CLOSED, OPEN, fingerprint, storm
print(*(fingerprint(n, boundaries) for n in (1, 5, 40) for boundaries in (CLOSED, OPEN)))
backend = storm(5, OPEN)._backend
print(len(backend._bands), backend._copy_serially)
"""
CLOSED = {"north": "forced"}
OPEN = {"west": "radiating", "east": "incident", "south": "sponge", "north": "forced"}


def storm(num_seas: int, boundaries: dict[str, str]) -> ShallowWater:
    """Forced, rough, over a rough bed; sea s is the same for any number of seas."""
    nx, ny = 61, 200
    solver = ShallowWater(
        size=(122, 400),
        cells=(nx, ny),
        depth=rough_bed(nx, ny),
        interval=1.5,
        boundaries=boundaries,
        sponge_width=80.0 if "sponge" in boundaries.values() else None,
        drag=0.01,
        num_seas=num_seas,
    )
    seas = [np.random.default_rng(s) for s in range(num_seas)]
    solver.set_forcing(*(np.stack([r.uniform(1, 9, 4) for r in seas]) for _ in range(3)))
    solver.set_state(np.stack([r.normal(size=(ny, nx)) for r in seas]))
    for _ in range(2):
        solver.advance()
    return solver


def fingerprint(num_seas: int, boundaries: dict[str, str]) -> str:
    solver = storm(num_seas, boundaries)
    return hashlib.sha256(solver.elevation().tobytes() + np.stack(solver.velocity()).tobytes()).hexdigest()


class TestSameSea:
    @pytest.mark.parametrize("boundaries", [CLOSED, OPEN], ids=["closed", "open"])
    def test_strips_and_pool_agree_bit_for_bit(self, boundaries):
        alone, few, many_seas = (storm(num_seas, boundaries) for num_seas in (1, 5, 40))
        assert alone.eta.shape[0] == few.eta.shape[0] == 1
        assert alone.eta.shape[2] < few.eta.shape[2]  # strips of one sea, against one sea a lane
        np.testing.assert_array_equal(alone.elevation()[0], few.elevation()[0])
        np.testing.assert_array_equal(few.elevation(), many_seas.elevation()[:5])
        np.testing.assert_array_equal(few.velocity(), np.stack(many_seas.velocity())[:, :5])

    @pytest.mark.cpu("number of threads")
    @pytest.mark.parametrize(
        ("threads", "cache", "copy", "serially"),
        [(1, 2**20, 1.0, True), pytest.param(7, 1, 1.0, False, marks=pytest.mark.slow), (7, 1, 0.0, True)],
    )
    def test_any_number_of_threads_gives_the_same_bits(self, threads, cache, copy, serially):
        """Threads decide into how many bands the rows are cut, here one or seven, most with neighbours on both sides,
        the cache how many substeps are taken at once, here all or two, and the cost of a copy who makes the copies.
        """
        here = " ".join(fingerprint(n, boundaries) for n in (1, 5, 40) for boundaries in (CLOSED, OPEN))
        command = [sys.executable, "-c", THREADS, str(threads), str(cache), str(copy)]
        there = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[3])
        assert there.stdout.splitlines()[-2:] == [here, f"{threads} {serially}"], there.stderr

    @pytest.mark.cpu("bands")
    @pytest.mark.parametrize("boundaries", [CLOSED, OPEN], ids=["closed", "open"])
    @pytest.mark.parametrize("num_seas", [1, 5, pytest.param(40, marks=pytest.mark.slow)])
    def test_gpu_backend_gives_the_same_bits(self, monkeypatch, num_seas, boundaries):
        """The GPU backend, here on the CPU."""
        bands = fingerprint(num_seas, boundaries)
        monkeypatch.setattr(linear, "WavefrontBackend", lambda *arguments: CellwiseBackend(*arguments[:2]))
        launched = storm(num_seas, boundaries)
        assert len(launched._launches) == 2 * launched.substeps
        assert fingerprint(num_seas, boundaries) == bands
        water = np.abs(launched.elevation()).max()
        for _ in range(20):
            launched.advance()
            water = max(water, np.abs(launched.elevation()).max())
        assert launched.eta.abs().max() <= water  # nothing grows in the cells outside

    @pytest.mark.cpu("bands")
    @pytest.mark.parametrize("num_seas", [1, 5])
    def test_a_state_goes_on_in_another_backend(self, monkeypatch, num_seas):
        bands = storm(num_seas, OPEN)
        monkeypatch.setattr(linear, "WavefrontBackend", lambda *arguments: CellwiseBackend(*arguments[:2]))
        launched = storm(num_seas, OPEN)
        assert bands.eta.shape[1] > launched.eta.shape[1]  # a row outside, and copies
        for one, other in ((bands, launched), (launched, bands)):
            one.advance()
            other.load_state(*one.state())
            for solver in (one, other):
                solver.advance()
            np.testing.assert_array_equal(one.elevation(), other.elevation())


class TestLayout:
    @pytest.mark.parametrize(
        ("num_seas", "nx", "outer"),
        [(1, 37, 1), (1, 37, 2), (1, 16, 1), (1, 15, 2), (3, 37, 1), (33, 5, 2), (16, 4, 1)],
    )
    def test_numbers_lie_where_the_docstring_says(self, num_seas, nx, outer):
        """Lane l of block b is sea 16 b + l, or holds the columns from l W on; what is filled up is 0."""
        ny, first = 4, 2
        made = Packing(num_seas, nx, ny, outer)
        field = np.random.default_rng(0).uniform(1, 2, (num_seas, ny, nx + 1)).astype(np.float32)
        packed = torch.full((made.blocks, ny + 5, made.columns, LANES), -1.0)
        made.pack(field, packed, first)
        np.testing.assert_array_equal(made.unpack(packed, first, first + ny), field)
        np.testing.assert_array_equal(made.unpack(packed, first + 1, first + 3), field[:, 1:3])
        assert (packed[:, :first] == -1).all()
        assert (packed[:, first + ny :] == -1).all()
        assert made.strips == (num_seas == 1 and nx >= LANES)
        width = nx + outer
        assert made.columns == (-(-width // LANES) if made.strips else width)
        common = made.spread(field[0, :, : nx - 1])
        assert common.shape == (ny, made.columns, LANES)
        for lane in range(LANES):
            for j in range(made.columns):
                sea, column = (0, lane * made.columns + j) if made.strips else (lane, j)
                there = sea < num_seas and column <= nx
                inside = packed[0, first : first + ny, j, lane]
                if made.strips or column <= nx:
                    assert torch.equal(inside, torch.tensor(field[sea, :, column]) if there else torch.zeros(ny))
                expected = field[0, :, column] if column < nx - 1 else np.zeros(ny)
                np.testing.assert_array_equal(common[:, j, lane], expected)
        if num_seas > LANES:
            np.testing.assert_array_equal(packed[2, first : first + ny, : nx + 1, 0], field[32])
            assert not packed[2, first : first + ny, : nx + 1, 1:].any()


class TestBands:
    @pytest.mark.parametrize(
        ("ny", "columns", "blocks", "substeps", "threads", "bands"),
        [
            (255, 17, 1, 1, 8, 1),  # shorter than waking threads takes
            (4095, 257, 1, 1, 8, 8),
            (4095, 257, 1, 64, 2, 2),
            (200, 51, 9, 35, 8, 1),  # blocks enough for all threads
        ],
    )
    def test_number_of_bands(self, ny, columns, blocks, substeps, threads, bands):
        tile, table, rows = wavefront.plan_bands(ny, columns, blocks, substeps, threads)
        assert len(table) == bands
        assert 1 <= tile <= substeps
        assert tile * columns * LANES * 3 * 4 <= 2 * wavefront.CACHE
        held = [band[:2, : band[BandTable.extent, Extent.rows]].T for band in table]
        own = [[packed for packed, source in pairs if packed == source and packed <= ny] for pairs in held]
        assert sorted(itertools.chain(*own)) == list(range(ny + 1))
        assert max(map(len, own)) - min(map(len, own)) <= 1
        assert table[:, BandTable.packed].max() == rows - 1

    @pytest.mark.parametrize("threads", [1, 3, 8])
    def test_the_cut_is_the_cheapest(self, threads):
        """Of all that fit into the cache: waking, fetching and marching rows, half of the copied ones, and copying."""
        wake, fetch, march, copy = wavefront.WAKE, wavefront.FETCH, wavefront.CELL, wavefront.COPY
        for ny, columns, blocks, substeps in itertools.product(
            (7, 63, 1023, 8191), (5, 65, 513, 2049), (1, 2, 5), (1, 40)
        ):
            cells = LANES * columns
            fits = [tile for tile in range(1, substeps + 1) if tile <= 2 or 12 * cells * tile <= wavefront.CACHE]

            def seconds(bands: int, tile: int, rest=(ny, blocks, substeps, cells)) -> float:
                ny, blocks, substeps, cells = rest
                neighbours = (0, 1, 2)[min(bands, 3) - 1]
                rounds, rows = math.ceil(blocks * bands / threads), (ny + 1) / bands + neighbours * tile / 2
                marching = rounds * rows * cells * (fetch + march * tile)
                copying = min(wake, copy * cells * blocks * 2 * (bands - 1) * tile)
                return math.ceil(substeps / tile) * (marching + copying + wake * (blocks * bands > 1))

            tile, table, _ = wavefront.plan_bands(ny, columns, blocks, substeps, threads)
            cuts = itertools.product(range(1, math.ceil(threads / blocks) + 1), fits)
            assert tile in fits
            assert seconds(len(table), tile) == pytest.approx(min(seconds(*cut) for cut in cuts), rel=1e-12)

    def test_large_grids_take_several_substeps_a_launch(self):
        tile, _, _ = wavefront.plan_bands(8191, 513, 1, 64, 1)
        assert tile >= 4


@ti.kernel
def sample_all(
    eta: ti.types.ndarray(dtype=ti.f32, ndim=4),
    points: ti.types.ndarray(dtype=ti.f32, ndim=2),
    found: ti.types.ndarray(dtype=ti.f32, ndim=3),
    dx: ti.f32,
    dy: ti.f32,
    nx: ti.i32,
    ny: ti.i32,
):
    for sea, p in ti.ndrange(found.shape[0], found.shape[1]):
        surface = long_wave_surface(eta, sea, points[p, 0], points[p, 1], dx, dy, nx, ny)
        for column in ti.static(range(3)):
            found[sea, p, column] = surface[column]


class TestSample:
    X, Y = 120.0, 90.0

    def sampled(self, surface, cells, num_seas, points):
        nx, ny = cells
        solver = ShallowWater(size=(self.X, self.Y), cells=cells, depth=10, interval=1, num_seas=num_seas)
        solver.set_state(many(surface(centres(nx, self.X), centres(ny, self.Y)[:, None]), num_seas))
        found = np.zeros((num_seas, len(points), 3), np.float32)
        sample_all(solver.eta, points.astype(np.float32), found, solver.dx, solver.dy, nx, ny)
        return found

    @pytest.mark.parametrize(("cells", "num_seas"), [((40, 30), 1), ((9, 12), 1), ((3, 3), 2), ((20, 15), 18)])
    def test_plane_is_exact_up_to_the_boundary(self, cells, num_seas):
        points = np.random.default_rng(3).uniform(0, 1, (300, 2)) * (self.X, self.Y)
        points[:3] = (0, 0), (self.X, self.Y), (0, self.Y)
        found = self.sampled(lambda x, y: 0.5 + 0.02 * x - 0.03 * y, cells, num_seas, points)
        x, y = points.T
        plane = np.stack([0.5 + 0.02 * x - 0.03 * y, 0.02 + 0 * x, -0.03 + 0 * x], axis=1)
        scale = np.arange(1, num_seas + 1)[:, None, None]
        np.testing.assert_allclose(found / scale, np.broadcast_to(plane, found.shape), atol=2e-6)

    def test_elevation_and_slopes_are_second_order(self):
        k, m = 2 * math.pi / self.X, 1.5 * math.pi / self.Y
        points = np.random.default_rng(4).uniform(0, 1, (2000, 2)) * (self.X, self.Y)
        x, y = points.T
        exact = [np.cos(k * x) * np.cos(m * y), -k * np.sin(k * x) * np.cos(m * y), -m * np.cos(k * x) * np.sin(m * y)]
        errors = []
        for n in (40, 80):
            found = self.sampled(lambda x, y: np.cos(k * x) * np.cos(m * y), (n, n), 1, points)[0]
            errors.append(np.sqrt(np.mean((found - np.stack(exact, axis=1)) ** 2, axis=0)))
        for series in zip(*errors, strict=True):
            assert 1.8 < order(series) < 2.4

    def test_slopes_are_continuous(self):
        """Across cell borders and centres no step is larger than the surface's curvature allows."""
        surface = lambda x, y: np.cos(0.1 * x) * np.cos(0.15 * y)  # noqa: E731
        line = np.linspace(0, 1, 4001)[:, None] * (self.X, self.Y)
        found = self.sampled(surface, (24, 18), 1, line)[0]
        step = math.hypot(self.X, self.Y) / 4000
        assert np.abs(np.diff(found, axis=0)).max() < 3 * step * 0.15

    def test_outside_is_clamped(self):
        inside, outside = np.array([[0.0, 40.0], [self.X, self.Y]]), np.array([[-30.0, 40.0], [1e6, 1e6]])
        surface = lambda x, y: 0.1 * x + 0.2 * y  # noqa: E731
        np.testing.assert_array_equal(
            self.sampled(surface, (20, 15), 1, inside), self.sampled(surface, (20, 15), 1, outside)
        )
