"""The linear solver's backends: the same sea to the bit in every packing, for any number of threads, on a GPU."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cases.plain import rough_bed
from usvauv.kernels.shallow_water import linear
from usvauv.kernels.shallow_water.cellwise import CellwiseBackend
from usvauv.kernels.shallow_water.linear import ShallowWater

THREADS = """
from tests.kernels.shallow_water.test_backends import OPEN, fingerprints, storm
from usvauv.kernels import runtime
from usvauv.kernels.shallow_water import wavefront
wavefront.WAKE = 1e-12
for threads, wavefront.CACHE, wavefront.COPY in ((1, 2**20, 1.0), (7, 1, 1.0), (7, 1, 0.0)):
    runtime.start("cpu", threads=threads)
    backend = storm(5, OPEN)._backend
    print(len(backend._bands), backend._copy_serially, *fingerprints())
    runtime.stop()
"""
CLOSED = {"north": "forced"}
OPEN = {"west": "radiating", "east": "incident", "south": "radiating", "north": "forced"}


def storm(num_seas: int, boundaries: dict[str, str]) -> ShallowWater:
    """Forced, rough, over a rough bed; sea s is the same for any number of seas."""
    nx, ny = 61, 200
    solver = ShallowWater(
        size=(122, 400),
        cells=(nx, ny),
        depth=rough_bed(nx, ny),
        interval=1.5,
        boundaries=boundaries,
        drag=0.01,
        num_seas=num_seas,
    )
    seas = [np.random.default_rng(s) for s in range(num_seas)]
    solver.set_forcing(*(np.stack([r.uniform(1, 9, 4) for r in seas]) for _ in range(3)))
    solver.set_state(np.stack([r.normal(size=(ny, nx)) for r in seas]))
    for _ in range(2):
        solver.advance()
    return solver


def fingerprint(solver: ShallowWater) -> str:
    return hashlib.sha256(solver.elevation().tobytes() + np.stack(solver.velocity()).tobytes()).hexdigest()


def fingerprints() -> list[str]:
    return [fingerprint(storm(*sea)) for sea in ((1, OPEN), (5, CLOSED), (40, OPEN))]


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
    def test_any_number_of_threads_gives_the_same_bits(self):
        """Threads decide into how many bands the rows are cut, here one or seven, most with neighbours on both sides,
        the cache how many substeps are taken at once, here all or two, and the cost of a copy who makes the copies.
        """
        command = [sys.executable, "-c", THREADS]
        there = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[3])
        here = " ".join(fingerprints())
        assert there.stdout.splitlines()[-3:] == [f"1 True {here}", f"7 False {here}", f"7 True {here}"], there.stderr

    @pytest.mark.cpu("bands")
    @pytest.mark.parametrize(("num_seas", "boundaries"), [(1, CLOSED), (1, OPEN), (5, OPEN)])
    def test_gpu_backend_gives_the_same_bits(self, monkeypatch, num_seas, boundaries):
        """The GPU backend, here on the CPU."""
        bands = fingerprint(storm(num_seas, boundaries))
        monkeypatch.setattr(linear, "WavefrontBackend", lambda *arguments: CellwiseBackend(*arguments[:4]))
        launched = storm(num_seas, boundaries)
        assert len(launched._launches) == 1 + 2 * launched.substeps
        assert fingerprint(launched) == bands
        water = np.abs(launched.elevation()).max()
        for _ in range(8):
            launched.advance()
            water = max(water, np.abs(launched.elevation()).max())
        assert launched.eta.abs().max() <= water  # nothing grows in the cells outside

    @pytest.mark.cpu("bands")
    @pytest.mark.parametrize("num_seas", [1, 5])
    def test_a_state_goes_on_in_another_backend(self, monkeypatch, num_seas):
        bands = storm(num_seas, OPEN)
        monkeypatch.setattr(linear, "WavefrontBackend", lambda *arguments: CellwiseBackend(*arguments[:4]))
        launched = storm(num_seas, OPEN)
        assert bands.eta.shape[1] > launched.eta.shape[1]  # a row outside, and copies
        for one, other in ((bands, launched), (launched, bands)):
            one.advance()
            other.load_state(*one.state())
            for solver in (one, other):
                solver.advance()
            np.testing.assert_array_equal(one.elevation(), other.elevation())
