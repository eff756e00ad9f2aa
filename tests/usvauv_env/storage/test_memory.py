"""Memory: refused before it is taken, by estimates that are near what is measured; rows on the disk."""

import os
import resource
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.policies.toy import ToyWorld, scenario
from usvauv.env import Scenario, World
from usvauv.env.record.recorder import record
from usvauv.env.render.video import video_file
from usvauv.env.sea.simulation import SeaSimulation
from usvauv.env.storage import memory
from usvauv.env.storage.files import OutputError
from usvauv.env.storage.memory import MemoryNeeded, RowsOnDisk, available, extremes, require
from usvauv.policies import TrainingConfig, TrainingRun
from usvauv.policies.training.replay import Replay

GIB = 2**30
GROWTH = """
import ctypes, gc, tempfile
from pathlib import Path

def status(key):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(key))

def growth(make):
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")
    before = status("VmRSS:")
    make()
    return status("VmHWM:") - before
"""
SEA = """
from usvauv.env import Scenario
from usvauv.env.sea.long_waves import build_sea, sea_bytes
from usvauv.env.site.site import Site
quick = Scenario.load("extreme", ["sea.update_interval=0.02"])
build_sea(Site(quick), [(0, 0)]).advance()
print(sea_bytes(quick, (1600, 1600), 1) / growth(lambda: build_sea(Site(quick), [(0, 0)], (1600, 1600)).advance()))
"""
VIDEO = """
import numpy as np
from usvauv.env.render.video import video_bytes, video_file
picture = np.zeros((1080, 1920, 3), np.uint8)
def video():
    with tempfile.TemporaryDirectory() as folder, video_file(Path(folder) / "v.mp4", 1920, 1080, 30) as append:
        for frame in range(30):
            picture[30 * frame :: 7] += 40
            append(picture)
print(video_bytes(1920, 1080) / growth(video))
"""


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="the peak of the memory cannot be reset")
@pytest.mark.parametrize("what", [SEA, VIDEO], ids=["sea", "video"])
def test_an_estimate_is_near_what_is_taken(what):
    """Within a factor of 2 of the growth of the resident memory's peak."""
    done = subprocess.run([sys.executable, "-c", GROWTH + what], capture_output=True, text=True, check=True)
    assert 1 / 2 < float(done.stdout.splitlines()[-1]) < 2


def test_what_does_not_fit_is_refused_with_the_numbers(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda device=None: 10 * GIB)
    require(8 * GIB, "just fits")
    with pytest.raises(MemoryNeeded, match=r"^a: takes about 9 GiB of memory; allowed are 8 GiB, 80% of the 10 GiB"):
        require(9 * GIB, "a")


def test_the_least_of_what_limits(monkeypatch, tmp_path):
    """The machine's free memory, what the control group leaves, and what a limit of the address space leaves."""
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    assert 2**20 < available() < 2**50
    (tmp_path / "memory.current").write_text("3000\n")
    for most, left in (("5000", 2000), ("2000", 0)):
        (tmp_path / "memory.max").write_text(f"{most}\n")
        assert available() == left
    (tmp_path / "memory.max").write_text("max\n")
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    monkeypatch.setattr(resource, "getrlimit", lambda which: (taken + GIB // 8, resource.RLIM_INFINITY))
    assert available() == pytest.approx(GIB // 8, abs=GIB / 32)


def learn(**changes):
    config = TrainingConfig(num_worlds=8, shared=True, **{"replay": 8000, **changes})
    TrainingRun(ToyWorld(scenario(), 8, 1), config)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: World(Scenario.load("extreme", ["sea.cell_size=0.1"]), 16, 0), r"^sea\.cell_size, .*16 seas of 2000"),
        (lambda: World(Scenario.load("extreme", ["sea.fine_cells=8192"]), 1, 0, fine_sea=True), "8192 × 8192 cells"),
        (lambda: World(Scenario.load("extreme"), 1 << 22, 0), r"^num_worlds = 4194304 of 2 AUVs"),
        (lambda: SeaSimulation(Scenario.load("extreme"), 0, (8192, 8192), 1.0), "8192 × 8192 cells"),
        (
            lambda: record(World(Scenario.load("extreme"), 64), None, "x", steps=10**6),
            "a record of 1000000 steps of 64",
        ),
        (lambda: video_file(Path("x.mp4"), 7680, 7680, 30).__enter__(), "^x.mp4: frames of 7680x7680"),
        (lambda: learn(hidden=(8192,) * 16), "^training: hidden, batch or n_step"),
        (lambda: learn(batch=1 << 20, n_step=1000, replay=10**6), "^training: hidden, batch or n_step"),
        (lambda: Replay(10**7, (8, 2, 60, 2), torch.device("cpu"), False), "^training: replay = 80000000"),
    ],
)
def test_who_asks_before_taking(monkeypatch, make, match):
    monkeypatch.setattr(memory, "available", lambda device=None: 2 * GIB)
    with pytest.raises(MemoryNeeded, match=match):
        make()


@pytest.fixture
def numbers():
    return np.random.default_rng(0).standard_normal((5, 3, 4)).astype(np.float32)


def test_rows_are_those_appended(numbers, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with RowsOnDisk(5, (3, 4), "rows") as rows:
        rows.append(numbers[:2])
        rows.append(numbers[2:])
        array = rows.array()
        assert list(tmp_path.iterdir()) == []  # it has no name
    assert array.shape == (5, 3, 4)
    for key in (0, -1, slice(1, 4, 2), (2, slice(None), 3), slice(None)):
        np.testing.assert_array_equal(array[key], numbers[key])
    assert extremes(array) == (numbers.min(), numbers.max())
    with pytest.raises(ValueError, match="read-only"):
        array[0][:] = 0.0


@pytest.mark.parametrize("shape", [(3, 4), (0, 4)])
def test_no_rows(shape):
    with RowsOnDisk(5, shape, "rows") as rows:
        array = rows.array()
    assert array.shape == (0, *shape)
    assert extremes(array) == (0.0, 0.0)


def test_a_disk_without_room_is_refused_before(monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    usage = namedtuple("usage", "free")(2**20)
    monkeypatch.setattr(memory.shutil, "disk_usage", lambda folder: usage)
    with RowsOnDisk(256, (8, 128), "just fits"):
        pass
    with pytest.raises(OutputError, match=r"^a record: takes 1.05 MiB of disk; 1 MiB are free in .* \(TMPDIR names"):
        RowsOnDisk(275, (10, 100), "a record")


@pytest.mark.parametrize("side", [64, 36])  # 16 KiB are written at once, 5 KiB when they are asked for
def test_a_disk_that_fills_up_is_one_line(monkeypatch, size_limit, tmp_path, side):
    """Here the limit of a file's size."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    refused = pytest.raises(OutputError, match=f"^rows: cannot be kept in {tmp_path} meanwhile: File too large")
    with RowsOnDisk(1, (side, side), "rows") as rows, size_limit(), refused:
        (rows.append(np.zeros((1, side, side), np.float32)), rows.array())
