"""NetCDF files read by another process, within limits of time and memory, as they are: nothing is decoded.

NetCDF-4 is read with h5netcdf, NetCDF-3 with SciPy where it is installed. `usvauv.env.netcdf.reader` decodes.
"""

from __future__ import annotations

import errno
import importlib.util
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from usvauv.kernels.errors import UserError

PATIENCE = 30.0  # s to open a file, or to begin to read from it
SLOWEST = 5e6  # bytes/s of a part and the chunks that it cuts through
LARGEST_PART = 2**31  # bytes
PACKING = 1032  # the most by which deflate packs; what is much larger than the file is not in it
SMALL = 2**20  # bytes that may be read whatever the size of the file
TEXTS = ("standard_name", "units", "positive", "axis", "calendar", "coordinates")  # attributes that must be text


class NetcdfError(UserError, ValueError):
    """A NetCDF file cannot be read; one line names the file and the problem."""


class _Child:
    """The process that reads a file, see `usvauv.env.netcdf.child`."""

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


class RemoteVariable:
    """A variable whose values the child reads when they are asked for.

    Attributes:
        dimensions, shape, dtype, attributes: as in the file.
    """

    def __init__(self, child: _Child, name: str, about: Mapping[str, Any], largest: int) -> None:
        self.dimensions = tuple(about["dimensions"])
        self.shape = tuple(about["shape"])
        self.dtype = np.dtype(about["dtype"])
        self.attributes = _attributes(about["attributes"])
        self._child, self._name, self._largest = child, name, largest
        self._chunks = about["chunks"]

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

    def read(self, key: tuple[Any, ...]) -> np.ndarray:
        """A part by slices and indices, and at most one rising list of indices; not to be written to.

        Raises:
            NetcdfError: it is more than can be in the file, or cannot be read.
        """
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


class RemoteFile(NamedTuple):
    """Variables, but for those that are neither numbers nor texts, and attributes."""

    variables: dict[str, RemoteVariable]
    attributes: dict[str, Any]


@contextmanager
def open_remote(path: str | Path) -> Iterator[RemoteFile]:
    """A NetCDF file, its values unread.

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
        about = child.answer(PATIENCE)[0]
        described = {name: each for name, each in about["variables"].items() if each is not None}
        variables = {name: RemoteVariable(child, name, each, largest) for name, each in described.items()}
        yield RemoteFile(variables, _attributes(about["attributes"]))
    finally:
        child.close()


def _attributes(described: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes as they were in the file; those that have to be text are."""
    attributes = {}
    for name, value in described.items():
        if not isinstance(value, str):
            value = np.array(value["values"], value["dtype"]).reshape(value["shape"])
            value = value.reshape(-1)[0] if value.size == 1 else value
        attributes[name] = str(value) if name in TEXTS else value
    return attributes


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
