"""What the process answers that reads a NetCDF file: here in this process, and beside the library itself."""

import io
import json
from types import SimpleNamespace

import h5netcdf
import h5py
import numpy as np
import pytest
import scipy.io
from scipy.io import netcdf_file

from usvauv.env.netcdf import child
from usvauv.env.netcdf.remote import NetcdfError, open_remote

VALUES = np.arange(60, dtype="<f4").reshape(3, 4, 5) / 7


@pytest.fixture
def packed(tmp_path):
    """A NetCDF-4 file with numbers in chunks, texts, an empty variable, a single number and a type of no interest."""
    path = tmp_path / "packed.nc"
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"time": 3, "lat": 4, "lon": 5, "none": None}
        file.attrs["title"] = "a cut"
        speed = file.create_variable("speed", ("time", "lat", "lon"), "<f4", data=VALUES, chunks=(1, 4, 2))
        speed.attrs["units"] = "m s-1"
        speed.attrs["valid_range"] = np.array([-3, 4], "<i2")
        speed.attrs["scale"] = np.float64(0.5)
        speed.attrs["wide"] = np.array([1.5, -2.5], np.longdouble)
        speed.attrs["long"] = "x" * (child.LARGEST_TEXT + 1)
        names = file.create_variable("names", ("lat",), h5py.string_dtype())
        names[...] = np.array(["north", "süd", "", "west"], object)
        file.create_variable("nothing", ("none",), "<f8")
        file.create_variable("depth", (), "<f8", data=12.5)
    with h5py.File(path, "a") as file:
        pair = np.zeros(4, [("u", "<f4"), ("v", "<f4")])
        file.create_dataset("pair", data=pair).dims[0].attach_scale(file["lat"])
    return path


def answers(path, engine, monkeypatch, *requests):
    """What `main` writes to these requests, as (answer, its bytes)."""
    out = SimpleNamespace(buffer=io.BytesIO())
    monkeypatch.setattr(child, "limit_resources", lambda: None)
    given = SimpleNamespace(buffer=[json.dumps(request).encode() + b"\n" for request in requests])
    monkeypatch.setattr(child, "sys", SimpleNamespace(stdin=given, stdout=out))
    child.main(str(path), engine)
    out.buffer.seek(0)
    found = []
    while line := out.buffer.readline():
        about = json.loads(line)
        found.append((about, out.buffer.read(about.pop("bytes"))))
    return found


def test_variables_are_described(packed, monkeypatch):
    ((about, data),) = answers(packed, "h5netcdf", monkeypatch)
    assert data == b""
    assert about["attributes"]["title"] == "a cut"
    assert about["variables"]["pair"] is None
    speed = about["variables"]["speed"]
    assert {name: speed[name] for name in ("dimensions", "shape", "dtype", "chunks")} == {
        "dimensions": ["time", "lat", "lon"],
        "shape": [3, 4, 5],
        "dtype": "<f4",
        "chunks": [1, 4, 2],
    }
    assert speed["attributes"] == {
        "units": "m s-1",
        "valid_range": {"dtype": "<i2", "shape": [2], "values": [-3, 4]},
        "scale": {"dtype": "<f8", "shape": [], "values": 0.5},
        "wide": {"dtype": "<f8", "shape": [2], "values": [1.5, -2.5]},
    }
    assert about["variables"]["names"]["dtype"] == "|O"
    assert about["variables"]["names"]["chunks"] == [1]
    assert about["variables"]["depth"]["shape"] == about["variables"]["depth"]["chunks"] == []


def test_parts_are_those_of_the_file(packed, monkeypatch):
    parts = [
        ([[0, 3, 1], [0, 4, 1], [0, 5, 1]], VALUES),
        ([[1, 3, 1], [0, 4, 2], [2, 3, 1]], VALUES[1:3, 0:4:2, 2:3]),
        ([[2, 3, 1], [0, 2, 1], {"at": [0, 3, 4]}], VALUES[2:3, 0:2][:, :, [0, 3, 4]]),
    ]
    requests = [{"variable": "speed", "part": part} for part, _ in parts]
    found = answers(packed, "h5netcdf", monkeypatch, *requests)[1:]
    for (about, data), (_, wanted) in zip(found, parts, strict=True):
        assert about == {"dtype": "<f4", "shape": list(wanted.shape)}
        assert data == wanted.tobytes()


def test_the_reader_asks_for_what_its_key_says(packed):
    keys = [
        ((slice(None), slice(None), slice(None)), VALUES),
        ((1, slice(1, 4, 2), -1), VALUES[1, 1:4:2, -1]),
        ((slice(-2, None), -2, [0, 1, 4]), VALUES[-2:, -2, [0, 1, 4]]),
        ((np.int64(2), 3, np.array([2])), VALUES[2, 3, [2]]),
        ((slice(2, 2), 0, slice(None)), VALUES[2:2, 0]),
        ((0, 0, 0), VALUES[0, 0, 0]),
    ]
    with open_remote(packed) as file:
        assert set(file.variables) >= {"speed", "names", "nothing", "depth"}
        speed = file.variables["speed"]
        for key, wanted in keys:
            np.testing.assert_array_equal(speed.read(key), wanted)
            assert speed.read(key).dtype == "<f4"
        assert file.variables["names"].read((slice(1, 3),)).tolist() == ["süd", ""]
        assert file.variables["depth"].read(()) == 12.5
        allowed = 1032 * packed.stat().st_size + 2**20  # deflate packs no closer
        speed.check_size(allowed)
        with pytest.raises(NetcdfError, match=f"speed: {allowed + 1:,} bytes are asked for; at most {allowed:,}"):
            speed.check_size(allowed + 1)


def test_what_has_no_parts_is_given_whole(packed, monkeypatch):
    requests = [{"variable": "nothing", "part": [[0, 0, 1]]}, {"variable": "depth", "part": []}]
    _, (nothing, no_data), (depth, data) = answers(packed, "h5netcdf", monkeypatch, *requests)
    assert (nothing, no_data) == ({"dtype": "<f8", "shape": [0]}, b"")
    assert depth["shape"] == []
    assert np.frombuffer(data, depth["dtype"]).tolist() == [12.5]


def test_texts_and_mistakes(packed, monkeypatch):
    requests = [
        {"variable": "names", "part": [[1, 4, 1]]},
        {"variable": "speed", "part": [[0, 1, 1]] * 4},
        {"variable": "none such", "part": []},
        {"variable": "depth", "part": []},
    ]
    _, (names, data), (many, _), (missing, _), (depth, _) = answers(packed, "h5netcdf", monkeypatch, *requests)
    assert names == {"dtype": "|O", "shape": [3], "texts": ["süd", "", "west"]}
    assert data == b""
    assert list(many) == list(missing) == ["error"]
    assert "none such" in missing["error"]
    assert "error" not in depth


def test_a_classic_file(tmp_path, monkeypatch):
    opened = []  # to be closed, which the process leaves to its end
    monkeypatch.setattr(
        scipy.io, "netcdf_file", lambda *given, **how: opened.append(netcdf_file(*given, **how)) or opened[-1]
    )
    with netcdf_file(tmp_path / "classic.nc", "w") as file:
        file.title = b"s\xc3\xbcd"
        file.createDimension("x", 6)
        variable = file.createVariable("h", "i2", ("x",))
        variable.units = "m"
        variable.scale_factor = np.float32(0.25)
        variable[:] = np.arange(6) * 3
    request = {"variable": "h", "part": [[1, 6, 2]]}
    (about, _), (part, data) = answers(tmp_path / "classic.nc", "scipy", monkeypatch, request)
    opened[0].fp.close()
    assert about["attributes"] == {"title": "süd"}
    described = about["variables"]["h"]
    assert (described["dimensions"], described["shape"], described["chunks"]) == (["x"], [6], [1])
    assert np.dtype(described["dtype"]) == ">i2"
    assert described["attributes"]["units"] == "m"
    assert described["attributes"]["scale_factor"]["values"] == 0.25
    assert np.frombuffer(data, part["dtype"]).tolist() == [3, 9, 15]


def test_a_file_that_cannot_be_opened_is_one_answer(tmp_path, packed, monkeypatch):
    (tmp_path / "empty.nc").write_bytes(b"")
    ((about, _),) = answers(tmp_path / "empty.nc", "h5netcdf", monkeypatch, {"variable": "speed", "part": []})
    assert list(about) == ["error"]
    assert "\n" not in about["error"]
    count = len(answers(packed, "h5netcdf", monkeypatch)[0][0]["variables"])
    for most, key in ((count, "variables"), (count - 1, "error")):
        monkeypatch.setattr(child, "MOST_VARIABLES", most)
        assert key in answers(packed, "h5netcdf", monkeypatch)[0][0]


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError("first\nsecond"), "first"),
        (MemoryError("of no use"), "needs too much memory"),
        (KeyError(), "KeyError()"),
    ],
)
def test_errors_in_one_line(error, said):
    assert child.explain(error) == said


def test_limits_are_never_above_those_of_the_system(monkeypatch):
    resource = pytest.importorskip("resource")
    hard = {resource.RLIMIT_AS: resource.RLIM_INFINITY, resource.RLIMIT_CPU: 20}
    chosen = {}
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (1, hard[kind]))
    monkeypatch.setattr(resource, "setrlimit", lambda kind, limits: chosen.update({kind: limits}))
    child.limit_resources()
    assert chosen == {resource.RLIMIT_AS: (child.MEMORY, hard[resource.RLIMIT_AS]), resource.RLIMIT_CPU: (20, 20)}
    hard[resource.RLIMIT_CPU] = 10**6
    child.limit_resources()
    assert chosen[resource.RLIMIT_CPU] == (child.PROCESSOR_TIME, 10**6)
