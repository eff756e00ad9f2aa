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
from scipy.io import netcdf_file

from tests.usvauv_env.ocean_files import cmems, write
from usvauv.env.netcdf import child, remote
from usvauv.env.netcdf.reader import open_file, values
from usvauv.env.netcdf.remote import NetcdfError, open_remote

VALUES = np.arange(60, dtype="<f4").reshape(3, 4, 5) / 7


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
        values(dataset["v"], "v")


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
            assert np.array_equal(values(uo.isel(index), "uo"), one)


def test_types_of_no_interest_and_long_texts_are_passed_over(tmp_path):
    with h5netcdf.File(tmp_path / "a.nc", "w") as file:
        file.dimensions = {"lat": 4}
        names = file.create_variable("names", ("lat",), h5py.string_dtype())
        names[...] = np.array(["north", "süd", "", "west"], object)
        names.attrs["long"] = "x" * (child.LARGEST_TEXT + 1)
    with h5py.File(tmp_path / "a.nc", "a") as file:
        pair = np.zeros(4, [("u", "<f4"), ("v", "<f4")])
        file.create_dataset("pair", data=pair).dims[0].attach_scale(file["lat"])
    with open_remote(tmp_path / "a.nc") as file:
        assert "pair" not in file.variables
        assert file.variables["names"].read((slice(1, 3),)).tolist() == ["süd", ""]
        assert "long" not in file.variables["names"].attributes


def test_a_classic_file(tmp_path):
    with netcdf_file(tmp_path / "classic.nc", "w") as file:
        file.title = b"s\xc3\xbcd"
        file.createDimension("x", 6)
        variable = file.createVariable("h", "i2", ("x",))
        variable.units = "m"
        variable.scale_factor = np.float32(0.25)
        variable[:] = np.arange(6) * 3
    with open_file(tmp_path / "classic.nc") as dataset:
        assert dataset.attrs["title"] == "süd"
        assert dataset["h"].attrs["units"] == "m"
        assert values(dataset["h"][1:6:2], "h").tolist() == [0.75, 2.25, 3.75]


@pytest.mark.parametrize("content", [b"", b"\x89HDF\r\n\x1a\n"])
def test_a_file_that_cannot_be_opened_is_one_line(tmp_path, content):
    (tmp_path / "empty.nc").write_bytes(content)
    with (
        pytest.raises(NetcdfError, match=r"empty\.nc: (not a NetCDF file|cannot be read: )") as caught,
        open_file(tmp_path / "empty.nc"),
    ):
        pytest.fail("opened")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["storage", "virtual", "soft", "external", "filter"])
def test_what_leads_out_of_a_file_is_refused_before_it_is_read(tmp_path, kind):
    (tmp_path / "secret").write_bytes(VALUES.tobytes())
    with h5py.File(tmp_path / "other.nc", "w") as other:
        other["x"] = VALUES
    with h5py.File(tmp_path / "trace.nc", "w") as file:
        group = file.require_group("inner")
        group["of_its_own"] = VALUES
        if kind == "storage":
            group.create_dataset("x", (60,), "<f4", external=[(str(tmp_path / "secret"), 0, 240)])
        elif kind == "virtual":
            layout = h5py.VirtualLayout(VALUES.shape, "<f4")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.nc"), "x", VALUES.shape)
            group.create_virtual_dataset("x", layout)
        elif kind == "filter":
            about = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            about.set_chunk((10,))
            about.set_filter(32015, h5py.h5z.FLAG_OPTIONAL)
            h5py.h5d.create(group.id, b"x", h5py.h5t.IEEE_F32LE, h5py.h5s.create_simple((10,)), about)
        else:
            group["x"] = h5py.SoftLink("/x") if kind == "soft" else h5py.ExternalLink("other.nc", "x")
    with pytest.raises(NetcdfError, match=r"trace\.nc: cannot be read: inner/x: "), open_remote(tmp_path / "trace.nc"):
        pytest.fail("opened")


def test_no_more_is_read_than_the_file_can_hold(tmp_path):
    """10¹² numbers declared and none stored; and as a coordinate, which is read on opening."""
    path = tmp_path / "vast.nc"
    with h5py.File(path, "w") as file:
        file.create_dataset("elevation", (10**6, 10**6), "f8", chunks=(1000, 1000), compression="gzip")
    with open_file(path) as dataset:
        assert values(dataset["elevation"][:100, :100], "elevation").shape == (100, 100)
        with pytest.raises(NetcdfError, match=r"elevation: 8,000,000,000,000 bytes are asked for; at most"):
            values(dataset["elevation"], "elevation")
    with h5py.File(path, "w") as file:
        file.create_dataset("time", (10**12,), "f8", chunks=(1000,)).make_scale("time")
    with pytest.raises(NetcdfError, match=r"time: 8,000,000,000,000 bytes are asked for"), open_file(path):
        pytest.fail("opened")


@pytest.mark.parametrize("seed", range(4))
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
            values(dataset[name], str(name))


def test_ctrl_c_ends_the_child(child_of, tmp_path):
    path = write(cmems(), tmp_path / "currents.nc")
    started = child_of("import os, signal, sys, time; os.kill(os.getppid(), signal.SIGINT); time.sleep(100)")
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt), open_file(path):
        pytest.fail("opened")
    assert time.monotonic() - begun < 10
    assert started[0].returncode == -signal.SIGKILL
