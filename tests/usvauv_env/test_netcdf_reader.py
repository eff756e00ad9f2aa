"""Files that would hang, crash or fill a reader end with its process and one line."""

import contextlib
import json
import os
import signal
import subprocess
import time

import h5netcdf
import h5py
import numpy as np
import pytest

from tests.usvauv_env.ocean_files import cmems, write
from usvauv.env.netcdf import remote
from usvauv.env.netcdf.reader import load, open_file
from usvauv.env.netcdf.remote import NetcdfError


@pytest.fixture
def child_of(monkeypatch, tmp_path):
    """Function that puts a program in the place of the child's, and the list of the processes started."""
    started = []
    begin = subprocess.Popen

    def put(program):
        script = tmp_path / "child.py"
        script.write_text(program)

        def start(command, **options):
            started.append(begin([command[0], str(script), *command[3:]], **options))
            return started[-1]

        monkeypatch.setattr(remote.subprocess, "Popen", start)
        return started

    return put


@pytest.mark.parametrize(
    ("program", "match"),
    [
        ("while True: pass", "damaged: reading it takes more than 1 s"),
        ("import os; os.abort()", "damaged: reading it ends the process"),
        ("print('{}')", "damaged: reading it ends the process"),
        ("print('not JSON')", "damaged: reading it ends the process"),
    ],
)
def test_a_reader_that_does_not_answer_is_ended(child_of, tmp_path, monkeypatch, program, match):
    path = write(cmems(), tmp_path / "currents.nc")
    monkeypatch.setattr(remote, "PATIENCE", 1.0)
    started = child_of(program)
    with pytest.raises(NetcdfError, match=match), open_file(path):
        pytest.fail("opened")
    (process,) = started
    assert process.returncode is not None  # ended and reaped
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)


def test_a_crash_in_the_middle_is_an_error_of_the_file(child_of, tmp_path):
    path = write(cmems(), tmp_path / "currents.nc")
    about = {"dimensions": ["x"], "shape": [3], "dtype": "<f8", "chunks": [1], "attributes": {}}
    described = json.dumps({"variables": {"v": about}, "attributes": {}, "bytes": 0})
    child_of(f"import sys; print({described!r}, flush=True); sys.stdin.readline()")
    with open_file(path) as dataset, pytest.raises(NetcdfError, match="damaged: reading it ends the process"):
        load(dataset["v"], "v")


def test_values_are_those_of_the_file_by_any_index(tmp_path):
    """Beside the library itself in this process: slices, falling and repeated orders, one index, all of it."""
    path = write(cmems(), tmp_path / "currents.nc", uo={"zlib": True, "chunksizes": (1, 2, 3, 10)})
    with h5netcdf.File(path) as file:
        expected = file["uo"][...]
    with open_file(path) as dataset:
        uo = dataset["uo"]
        for index in (
            {},
            {"time": 1},
            {"time": [3, 1], "longitude": slice(7, 2, -2)},
            {"longitude": [8, 9, 0, 1], "latitude": [5, 4], "depth": [2]},
            {"time": slice(2, 2)},
        ):
            part = tuple(index.get(name, slice(None)) for name in ("time", "depth", "latitude", "longitude"))
            one = expected
            for axis in reversed(range(4)):
                one = one[(slice(None),) * axis + (part[axis],)]
            assert np.array_equal(load(uo.isel(index), "uo"), one)


def test_no_more_is_read_than_the_file_can_hold(tmp_path):
    """10¹² numbers declared and none stored; and as a coordinate, which is read on opening."""
    path = tmp_path / "vast.nc"
    with h5py.File(path, "w") as file:
        file.create_dataset("elevation", (10**6, 10**6), "f8", chunks=(1000, 1000), compression="gzip")
    with open_file(path) as dataset:
        assert load(dataset["elevation"][:100, :100], "elevation").shape == (100, 100)
        with pytest.raises(NetcdfError, match=r"elevation: 8,000,000,000,000 bytes are asked for; at most"):
            load(dataset["elevation"], "elevation")
    with h5py.File(path, "w") as file:
        file.create_dataset("time", (10**12,), "f8", chunks=(1000,)).make_scale("time")
    with pytest.raises(NetcdfError, match=r"time: 8,000,000,000,000 bytes are asked for"), open_file(path):
        pytest.fail("opened")


@pytest.mark.parametrize("seed", range(6))
def test_bytes_changed_anywhere_give_the_dataset_or_one_line(tmp_path, seed, monkeypatch):
    monkeypatch.setattr(remote, "PATIENCE", 5.0)
    whole = write(cmems(), tmp_path / "currents.nc").read_bytes()
    random = np.random.default_rng(seed)
    path = tmp_path / "changed.nc"
    content = np.frombuffer(whole, np.uint8).copy()
    places = random.integers(0, len(whole), 20)
    content[places] = random.integers(0, 256, 20)
    content[:8] = list(whole[:8])
    path.write_bytes(content.tobytes())
    with contextlib.suppress(NetcdfError), open_file(path) as dataset:
        for name in dataset.variables:
            load(dataset[name], str(name))


@pytest.mark.parametrize("name", ["x" * 300 + ".nc", "a\0b.nc", "a\nb.nc", "\udcff.nc"])
def test_names_that_no_file_has_are_not_found(tmp_path, name):
    with pytest.raises(NetcdfError, match="cannot be read: No such file or directory"), open_file(tmp_path / name):
        pytest.fail("opened")


def test_a_pipe_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "pipe.nc")
    with pytest.raises(NetcdfError, match="cannot be read: Invalid"), open_file(tmp_path / "pipe.nc"):
        pytest.fail("opened")


def test_ctrl_c_ends_the_child(child_of, tmp_path):
    path = write(cmems(), tmp_path / "currents.nc")
    started = child_of("import os, signal, sys, time; os.kill(os.getppid(), signal.SIGINT); time.sleep(100)")
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt), open_file(path):
        pytest.fail("opened")
    assert time.monotonic() - begun < 10
    assert started[0].returncode == -signal.SIGKILL
