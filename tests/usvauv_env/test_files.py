"""Files that appear when they are complete."""

import os
import subprocess
import sys

import h5py
import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from usvauv_env.files import THIS_HOST, OutputError, atomic_write, hdf5_file


def test_the_file_appears_when_the_block_ends(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("older")
    with atomic_write(path) as partial:
        partial.write_text("newer")
        assert path.read_text() == "older"
    assert path.read_text() == "newer"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("ending", [KeyboardInterrupt, RuntimeError, OSError])
def test_an_older_file_outlives_what_is_cut_short(tmp_path, ending):
    path = tmp_path / "a.txt"
    path.write_text("older")

    def write() -> None:
        with atomic_write(path) as partial:
            partial.write_text("half")
            raise ending

    with pytest.raises(OutputError if ending is OSError else ending):
        write()
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("place", ["missing/a.txt", "file/a.txt", "folder"])
def test_a_place_that_takes_no_file_is_named_before_work_begins(tmp_path, place):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError) as caught, atomic_write(tmp_path / place):
        pytest.fail("the block ran")
    assert str(caught.value).startswith(f"{tmp_path / place}: cannot be written: ")
    assert "\n" not in str(caught.value)


def test_what_a_dead_process_left_is_removed_and_what_a_living_one_writes_is_not(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    dead, living = (tmp_path / f"a.txt.{THIS_HOST}-{number}.partial" for number in (ended.pid, os.getppid()))
    others = tmp_path / f"b.txt.{THIS_HOST}-{ended.pid}.partial"
    for path in (dead, living, others):
        path.touch()
    with atomic_write(tmp_path / "a.txt") as partial:
        partial.write_text("whole")
    assert sorted(tmp_path.iterdir()) == sorted([tmp_path / "a.txt", living, others])


def test_a_link_stays_a_link_and_a_device_a_device(tmp_path):
    (tmp_path / "link").symlink_to("file")
    with atomic_write(tmp_path / "link") as partial:
        partial.write_text("whole")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text() == "whole"
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="pipe: cannot be written"), atomic_write(tmp_path / "pipe"):
        pytest.fail("the block ran")


class TestSizeLimit:
    """The system refuses to write more than so many bytes; every library says it in another way."""

    @pytest.fixture(autouse=True)
    def limit(self):
        resource = pytest.importorskip("resource")
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
        yield
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

    def refused(self, path, write):
        path.write_text("older")
        with pytest.raises(OutputError) as caught, atomic_write(path) as partial:
            write(partial)
        assert str(caught.value) == f"{path}: cannot be written: File too large"
        assert path.read_text() == "older"
        assert list(path.parent.iterdir()) == [path]

    def test_python(self, tmp_path):
        self.refused(tmp_path / "a", lambda path: path.write_bytes(bytes(5000)))

    def test_safetensors(self, tmp_path):
        self.refused(tmp_path / "a", lambda path: save_file({"a": torch.zeros(5000)}, path))

    def test_hdf5(self, tmp_path):
        path = tmp_path / "a"
        path.write_text("older")
        refused = pytest.raises(OutputError, match="a: cannot be written: File too large")
        with refused, hdf5_file(path) as disk, h5py.File(disk, "w") as file:
            file["x"] = np.zeros(5000)
        assert path.read_text() == "older"
        assert list(tmp_path.iterdir()) == [path]
