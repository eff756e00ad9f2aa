"""Rows in a file: they are what was appended, take no memory, and refuse in one line what the disk lacks."""

import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest

from tests.usvauv_env.test_memory import GROWTH
from usvauv.env.files import OutputError
from usvauv.env.record import rows_on_disk
from usvauv.env.record.rows_on_disk import RowsOnDisk, extremes

READING = """
import numpy as np
from usvauv.env.record.rows_on_disk import RowsOnDisk, extremes
def through():
    with RowsOnDisk(2000, (128, 128), "rows") as rows:
        for n in range(2000):
            rows.append(np.full((1, 128, 128), n, np.float32))
        array = rows.array()
    assert extremes(array) == (0.0, 1999.0)
    assert [float(row[5, 5]) for row in array] == list(range(2000))
print(growth(through) / 2**20)
"""


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


@pytest.mark.parametrize(("rows", "expected"), [([[2, 3], [4, 1]], (0, 4)), ([[-2, -3], [-1, -4]], (-4, 0))])
def test_the_calm_surface_is_among_the_extremes(rows, expected):
    assert extremes(np.array(rows)) == expected


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="the peak of the memory cannot be reset")
def test_memory_does_not_grow_with_them():
    """125 MiB are written and read twice."""
    done = subprocess.run([sys.executable, "-c", GROWTH + READING], capture_output=True, text=True, check=True)
    assert float(done.stdout.splitlines()[-1]) < 10


def test_a_disk_without_room_is_refused_before(monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    usage = namedtuple("usage", "free")(2**20)
    monkeypatch.setattr(rows_on_disk.shutil, "disk_usage", lambda folder: usage)
    with RowsOnDisk(256, (8, 128), "just fits"):
        pass
    with pytest.raises(OutputError, match=r"^a record: takes 1.05 MiB of disk; 1 MiB are free in .* \(TMPDIR names"):
        RowsOnDisk(275, (10, 100), "a record")


@pytest.mark.parametrize(("variable", "there", "expected"), [("a", True, "a"), ("", True, "b"), ("", False, "c")])
def test_where_the_file_lies(monkeypatch, tmp_path, variable, there, expected):
    """In the folder that TMPDIR names, else in one that is never in memory, else where the system has its own."""
    monkeypatch.setenv("TMPDIR", variable and str(tmp_path / variable))
    monkeypatch.setattr(rows_on_disk, "PLACE", str(tmp_path / "b"))
    monkeypatch.setattr(rows_on_disk.tempfile, "tempdir", str(tmp_path / "c"))
    for name in ("a", "b", "c") if there else ("a", "c"):
        (tmp_path / name).mkdir()
    asked = []
    usage = rows_on_disk.shutil.disk_usage
    monkeypatch.setattr(rows_on_disk.shutil, "disk_usage", lambda folder: asked.append(folder) or usage(folder))
    with RowsOnDisk(1, (2,), "rows"):
        assert asked == [str(tmp_path / expected)]


@pytest.mark.parametrize("side", [64, 36])  # 16 KiB are written at once, 5 KiB when they are asked for
def test_a_disk_that_fills_up_is_one_line(monkeypatch, size_limit, tmp_path, side):
    """Here the limit of a file's size."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    refused = pytest.raises(OutputError, match=f"^{tmp_path}: cannot be written: File too large")
    with RowsOnDisk(1, (side, side), "rows") as rows, size_limit(), refused:
        (rows.append(np.zeros((1, side, side), np.float32)), rows.array())


def test_a_folder_that_is_not_there(monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "none"))
    with pytest.raises(OutputError, match="none: cannot be written: No such file"):
        RowsOnDisk(5, (3, 4), "rows")
