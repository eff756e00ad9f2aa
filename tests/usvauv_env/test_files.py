"""Files that appear when they are complete."""

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from usvauv.env.files import THIS_HOST, HDF5File, OutputError, atomic_write, check_place, hdf5_file, sync, writing


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


def test_asking_for_a_place_leaves_it_as_it_is(tmp_path):
    (tmp_path / "a.txt").write_text("older")
    check_place(tmp_path / "a.txt")
    check_place(tmp_path / "b.txt")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["older"]
    with pytest.raises(OutputError, match="cannot be written: Is a directory"):
        check_place(tmp_path)


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(28, "full"), "No space left on device"),
        (OSError("the first\nthe second"), "the first"),
        (OSError(), "OSError"),
        (RuntimeError("write failed (errno = 27, in x)"), "File too large"),
        (ValueError("I/O error: os error 13"), "Permission denied"),
        (ValueError("no such number"), None),
        (OutputError("x: said already, code: 28"), None),
    ],
)
def test_the_systems_words_whoever_reports_them(error, reason):
    with pytest.raises(type(error) if reason is None else OutputError) as caught, writing(Path("a")):
        raise error
    assert caught.value is error if reason is None else str(caught.value) == f"a: cannot be written: {reason}"


@pytest.mark.parametrize(("number", "left"), [(1, True), (10**30, True), (2**22 + 1, False)])
def test_what_may_be_of_a_living_process_stays(tmp_path, number, left):
    """Process 1, which may be another user's, and a number beyond the system's; 2²² is the last that Linux gives."""
    path = tmp_path / f"a.txt.{THIS_HOST}-{number}.partial"
    path.touch()
    with atomic_write(tmp_path / "a.txt"):
        pass
    assert path.exists() is left


def test_a_file_is_on_the_disk_before_it_has_its_name(monkeypatch, tmp_path):
    """Nothing stays open for that."""
    done, numbers, replace = [], [], os.replace

    def fsync(number):
        numbers.append(number)
        done.append(os.fstat(number).st_ino)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(os, "replace", lambda *paths: done.append("renamed") or replace(*paths))
    with atomic_write(tmp_path / "a.txt"):
        pass
    sync(tmp_path)
    assert done == [(tmp_path / "a.txt").stat().st_ino, "renamed", tmp_path.stat().st_ino]
    for number in numbers:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(number)


class TestSizeLimit:
    """The system refuses to write more than so many bytes; every library says it in another way."""

    @pytest.fixture
    def refused(self, size_limit, tmp_path):
        """Function that writes a file in place of an older one and is refused."""

        def check(write):
            path = tmp_path / "a"
            path.write_text("older")
            with size_limit(), pytest.raises(OutputError) as caught, atomic_write(path) as partial:
                write(partial)
            assert str(caught.value) == f"{path}: cannot be written: File too large"
            assert path.read_text() == "older"
            assert list(tmp_path.iterdir()) == [path]

        return check

    def test_python(self, refused):
        refused(lambda path: path.write_bytes(bytes(5000)))

    def test_safetensors(self, refused):
        refused(lambda path: save_file({"a": torch.zeros(5000)}, path))

    def test_hdf5(self, size_limit, tmp_path):
        path = tmp_path / "a"
        path.write_text("older")
        refused = pytest.raises(OutputError, match="a: cannot be written: File too large")
        with size_limit(), refused, hdf5_file(path) as disk, h5py.File(disk, "w") as file:
            file["x"] = np.zeros(5000)
        assert path.read_text() == "older"
        assert list(tmp_path.iterdir()) == [path]

    def test_hdf5_is_told_that_all_went_well(self, size_limit, tmp_path):
        """The first error is kept until it is asked for; what comes after it is not written."""
        with size_limit(), HDF5File(tmp_path / "a") as file:
            file.check()
            assert file.write(np.arange(500.0)) == 4000
            assert file.truncate(5000) == 5000
            assert file.truncate() == 4000
            file.seek(0)
            assert file.write(b"later") == 5
            with pytest.raises(OSError, match="File too large"):
                file.check()
        assert (tmp_path / "a").read_bytes() == np.arange(500.0).tobytes()
