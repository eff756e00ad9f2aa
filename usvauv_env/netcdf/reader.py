"""NetCDF files as xarray datasets whose values are read by another process, within limits of time and memory.

NetCDF-4 is read with h5netcdf, NetCDF-3 with SciPy where it is installed. Fill values and packing are decoded as the
CF conventions define them (https://cfconventions.org), times are not.
"""

from __future__ import annotations

import errno
import importlib.util
import json
import math
import os
import subprocess
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from xarray.backends import BackendArray
from xarray.backends.common import AbstractDataStore
from xarray.core import indexing

from kernels.errors import UserError

PATIENCE = 30.0  # s to open a file, or to begin to read from it
SLOWEST = 5e6  # bytes/s of a part and the chunks that it cuts through
LARGEST_PART = 2**31  # bytes
PACKING = 1032  # the most by which deflate packs; what is much larger than the file is not in it
SMALL = 2**20  # bytes that may be read whatever the size of the file
TEXTS = ("standard_name", "units", "positive", "axis", "calendar", "coordinates")  # attributes that must be text


class NetcdfError(UserError, ValueError):
    """A NetCDF file cannot be read; one line names the file and the problem."""


class _Child:
    """The process that reads a file, see `usvauv_env.netcdf.child`."""

    def __init__(self, path: Path, engine: str) -> None:
        self.path = path
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-P", str(Path(__file__).with_name("child.py")), str(path.absolute()), engine]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env=environment, start_new_session=True
        )

    def answer(self, seconds: float, request: Mapping[str, Any] | None = None) -> tuple[dict[str, Any], bytes]:
        """The next answer, to a request if there is one.

        Raises:
            NetcdfError: there is none, within so many seconds.
        """
        late = threading.Event()

        def stop() -> None:
            late.set()
            self._process.kill()

        timer = threading.Timer(seconds, stop)
        timer.start()
        try:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            if request is not None:
                self._process.stdin.write(json.dumps(request).encode() + b"\n")
                self._process.stdin.flush()
            about = json.loads(self._process.stdout.readline())
            data = self._process.stdout.read(about["bytes"])
            if len(data) < about["bytes"]:
                raise EOFError
        except (OSError, ValueError, KeyError, EOFError):
            what = f"takes more than {seconds:.0f} s" if late.is_set() else "ends the process that does it"
            raise NetcdfError(f"{self.path}: damaged: reading it {what}") from None
        finally:
            timer.cancel()
        if "error" in about:
            problem = "cannot be read" if request is None else "damaged"
            raise NetcdfError(f"{self.path}: {problem}: {about['error']}")
        return about, data

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):  # what cannot be written to a process that has ended
                    pipe.close()
        self._process.wait()


class _RemoteArray(BackendArray):
    """A variable whose values the child reads when they are asked for."""

    def __init__(self, child: _Child, name: str, about: Mapping[str, Any], largest: int) -> None:
        self.shape = tuple(about["shape"])
        self.dtype = np.dtype(about["dtype"])
        self._child, self._name, self._largest = child, name, largest
        self._chunks = about["chunks"]

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        support = indexing.IndexingSupport.OUTER_1VECTOR
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._read)

    def check_size(self, size: int) -> None:
        """Refuse to read more bytes than can be in the file.

        Raises:
            NetcdfError: it is more.
        """
        if size > self._largest:
            raise NetcdfError(
                f"{self._child.path}: {self._name}: {size:,} bytes are asked for; "
                f"at most {self._largest:,} can be in this file"
            )

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        """A part by one slice, index or list of indices per dimension."""
        part: list[Any] = []
        drop = []
        touched = size = self.dtype.itemsize
        for axis, (index, length, chunk) in enumerate(zip(key, self.shape, self._chunks, strict=True)):
            if isinstance(index, slice):
                first, last, step = index.indices(length)
                part.append([first, last, step])
                positions = range(first, last, step)
            elif np.ndim(index):
                positions = [int(i) for i in index]
                part.append({"at": positions})
            else:
                drop.append(axis)
                positions = range(int(index) % max(length, 1), int(index) % max(length, 1) + 1)
                part.append([positions[0], positions[0] + 1, 1])
            size *= len(positions)
            touched *= (max(positions) // chunk - min(positions) // chunk + 1) * chunk if len(positions) else 0
        self.check_size(size)
        request = {"variable": self._name, "part": part}
        about, data = self._child.answer(PATIENCE + touched / SLOWEST, request)
        if "texts" in about:
            values = np.array(about["texts"], object).reshape(about["shape"])
        else:
            values = np.frombuffer(data, about["dtype"]).reshape(about["shape"])
        return values.squeeze(tuple(drop))


class _Store(AbstractDataStore):
    """The variables and attributes of a file, undecoded."""

    def __init__(self, child: _Child, largest: int) -> None:
        self._child, self._largest = child, largest
        self._about = child.answer(PATIENCE)[0]

    def get_variables(self) -> dict[str, xarray.Variable]:
        """Variables by name, their values unread."""
        variables = {}
        for name, about in self._about["variables"].items():
            if about is None:
                continue
            if len(set(about["dimensions"])) < len(about["dimensions"]):
                raise NetcdfError(f"{self._child.path}: {name}: has a dimension twice")
            remote = _RemoteArray(self._child, name, about, self._largest)
            if about["dimensions"] == [name]:  # a coordinate; all of it becomes an index of the dataset
                remote.check_size(remote.dtype.itemsize * math.prod(remote.shape))
            array = indexing.LazilyIndexedArray(remote)
            variables[name] = xarray.Variable(about["dimensions"], array, _attributes(about["attributes"]))
        return variables

    def get_attrs(self) -> dict[str, Any]:
        """Attributes of the file."""
        return _attributes(self._about["attributes"])

    def get_dimensions(self) -> dict[str, int]:
        """Not known apart from the variables."""
        return {}

    def get_encoding(self) -> dict[str, Any]:
        """Nothing that reading needs."""
        return {}


def _attributes(described: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes as they were in the file; those that have to be text are."""
    attributes = {}
    for name, value in described.items():
        if not isinstance(value, str):
            value = np.array(value["values"], value["dtype"]).reshape(value["shape"])
            value = value.reshape(-1)[0] if value.size == 1 else value
        attributes[name] = str(value) if name in TEXTS else value
    return attributes


@contextmanager
def open_file(path: str | Path) -> Iterator[xarray.Dataset]:
    """A NetCDF file, its values unread, fill values and packing to be decoded, times not decoded.

    A part of a variable is refused that is larger than `LARGEST_PART`, or than the file can hold even if it is packed
    as closely as deflate packs.

    Raises:
        NetcdfError: no such file, not NetCDF, or damaged; opening takes longer than `PATIENCE`.
    """
    path = Path(path)
    engine = _engine(path)
    largest = min(LARGEST_PART, PACKING * path.stat().st_size + SMALL)
    child = _Child(path, engine)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # two different fill values: both are masked; overflows: values are checked
            try:
                dataset = xarray.decode_cf(_Store(child, largest), decode_times=False)
            except NetcdfError:
                raise
            except Exception as error:  # the libraries' own, of any kind, for attributes that make no sense
                raise NetcdfError(f"{path}: cannot be decoded: {first_line(error)}") from None
        yield dataset
    finally:
        child.close()


def load(array: xarray.DataArray, where: str) -> np.ndarray:
    """Values of a variable of an open file, or of a part of it; `where` names file and variable in an error message.

    Raises:
        NetcdfError: they cannot be read, or decoded.
    """
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            return np.asarray(array.values)
    except NetcdfError:
        raise
    except Exception as error:  # as above
        raise NetcdfError(f"{where}: cannot be decoded: {first_line(error)}") from None


def first_line(error: Exception) -> str:
    """The first line of what a library says."""
    return (str(error).splitlines() or [repr(error)])[0]


def _engine(path: Path) -> str:
    """The library that reads a file, by its first bytes."""
    if not os.path.isfile(path):  # false, unlike an error, for paths that no system allows
        reason = errno.EISDIR if os.path.isdir(path) else errno.EINVAL if os.path.exists(path) else errno.ENOENT
        raise NetcdfError(f"{path}: cannot be read: {os.strerror(reason)}")
    try:
        with path.open("rb") as file:
            magic = file.read(8)
    except OSError as error:
        raise NetcdfError(f"{path}: cannot be read: {error.strerror}") from None
    if magic == b"\x89HDF\r\n\x1a\n":
        return "h5netcdf"
    if magic[:4] in (b"CDF\x01", b"CDF\x02", b"CDF\x05"):
        if magic[3] != 5 and importlib.util.find_spec("scipy"):
            return "scipy"
        remedy = "converting with `nccopy -k nc4`"
        if magic[3] != 5:
            remedy = f"SciPy (pip install scipy) or {remedy}"
        raise NetcdfError(f"{path}: a NetCDF-3 file, which needs {remedy}")
    raise NetcdfError(f"{path}: not a NetCDF file")
