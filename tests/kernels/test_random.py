"""Counter-based random numbers: the published vectors, the distributions, and that a draw knows only its address."""

import ast
import collections

import numpy as np
import taichi as ti
import torch
from scipy import stats

from tests.import_graph import sources
from usvauv.kernels import random
from usvauv.kernels.mission.columns import Draw


@ti.kernel
def _philox(
    counter: ti.types.ndarray(dtype=ti.i64, ndim=2),
    key: ti.types.ndarray(dtype=ti.i64, ndim=2),
    out: ti.types.ndarray(dtype=ti.i64, ndim=2),
):
    for i in range(counter.shape[0]):
        address = random.uint4(0)
        for j in ti.static(range(4)):
            address[j] = ti.cast(counter[i, j], ti.u32)
        word = random.philox(address, random.uint2(ti.cast(key[i, 0], ti.u32), ti.cast(key[i, 1], ti.u32)))
        for j in ti.static(range(4)):
            out[i, j] = ti.cast(word[j], ti.i64)


@ti.kernel
def _draw(out: ti.types.ndarray(dtype=ti.f32, ndim=2), first: ti.u32, seed: ti.u32, normal: ti.i32):
    for i in range(out.shape[0]):
        address = random.uint4(first + ti.cast(i, ti.u32), ti.u32(0), ti.u32(0), ti.u32(0))
        key = random.uint2(seed, ti.u32(0))
        draw = random.uniforms(address, key)
        if normal != 0:
            draw = random.normals(address, key)
        for j in ti.static(range(4)):
            out[i, j] = draw[j]


@ti.kernel
def _unit(word: ti.types.ndarray(dtype=ti.i64, ndim=1), out: ti.types.ndarray(dtype=ti.f32, ndim=1)):
    for i in range(word.shape[0]):
        out[i] = random.unit(ti.cast(word[i], ti.u32))


def draw(device, n, normal=False, first=0, seed=1):
    out = torch.empty((n, 4), dtype=torch.float32, device=device)
    _draw(out, first, seed, int(normal))
    return out.cpu().numpy()


def test_published_vectors(device):
    """Known answers of philox4x32-10 in the Random123 distribution (kat_vectors)."""
    ones = 0xFFFFFFFF
    pi = (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344)
    counter = torch.tensor([[0] * 4, [ones] * 4, pi], dtype=torch.int64, device=device)
    key = torch.tensor([[0, 0], [ones, ones], [0xA4093822, 0x299F31D0]], dtype=torch.int64, device=device)
    out = torch.empty_like(counter)
    _philox(counter, key, out)
    assert [[f"{word & ones:08x}" for word in row] for row in out.tolist()] == [
        ["6627e8d5", "e169c58d", "bc57ac4c", "9b00dbd8"],
        ["408f276d", "41c83b0e", "a20bc7c6", "6d5451fd"],
        ["d16cfe09", "94fdcceb", "5001e420", "24126ea1"],
    ]


def test_unit_is_open(device):
    """The logarithm of Box–Muller never meets 0, nor does 1 occur."""
    out = torch.empty(2, dtype=torch.float32, device=device)
    _unit(torch.tensor([0, 0xFFFFFFFF], dtype=torch.int64, device=device), out)
    assert 0 < out[0].item() == 2**-24
    assert out[1].item() == 1 - 2**-24


class TestDistribution:
    n = 100_000

    def test_uniform(self, device):
        u = draw(device, self.n)
        for j in range(4):
            assert stats.kstest(u[:, j], "uniform").pvalue > 1e-3

    def test_normal(self, device):
        z = draw(device, self.n, normal=True)
        for j in range(4):
            assert stats.kstest(z[:, j], "norm").pvalue > 1e-3

    def test_four_numbers_are_uncorrelated(self, device):
        z = draw(device, self.n, normal=True)
        correlation = np.corrcoef(np.concatenate([z, z**2], axis=1).T)
        assert np.abs(correlation - np.eye(8)).max() < 5 / np.sqrt(self.n)

    def test_neighbouring_addresses_are_uncorrelated(self, device):
        z = draw(device, self.n, normal=True).ravel()
        for lag in (1, 2, 4, 8):
            assert abs(np.mean(z[lag:] * z[:-lag])) < 5 / np.sqrt(z.size)


class TestAddress:
    def test_a_draw_does_not_depend_on_its_batch(self, device):
        assert np.array_equal(draw(device, 1000)[700:], draw(device, 300, first=700))

    def test_another_seed_is_another_sequence(self, device):
        assert not np.any(draw(device, 1000, seed=1) == draw(device, 1000, seed=2))


def test_each_purpose_of_a_draw_is_one_functions():
    """Two that drew the same numbers would err alike; those that share a purpose never draw in the same step."""
    drawing = collections.defaultdict(set)
    texts = {name: path.read_text(encoding="utf-8") for name, path in sources().items()}
    for name, text in texts.items():
        for function in ast.walk(ast.parse(text)) if "Draw." in text else ():
            for node in ast.walk(function) if isinstance(function, ast.FunctionDef) else ():
                if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "Draw":
                    drawing[node.attr].add(f"{name.rpartition('.')[2]}.{function.name}")
    shared = {
        "node": {"data_collection.place_nodes", "station_keeping.place_stations"},  # of two tasks
        "loss": {"fixes.is_lost", "fixes.take_fix"},  # of two schedules
        "navigation": {"motion.begin_reckoning", "motion.reckon"},  # at the start and later
        "attitude": {"reception.array_pose", "reception_in_lanes.fix_each"},  # of a fix, and of several side by side
        "fix": {"reception.make_fix", "reception_in_lanes.fix_each"},
        "residual": {"reception.make_fix", "reception_in_lanes.fix_each"},
    }
    assert set(drawing) == set(Draw.names) - {"decision"}  # which keeps the places of those after it
    assert {name: users for name, users in drawing.items() if len(users) > 1} == shared
