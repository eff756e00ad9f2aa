"""The process that reads one NetCDF file for `usvauv.env.netcdf.reader`.

A damaged file can make the HDF5 library run for ever, crash, or ask for any amount of memory. Run by its path, this
program imports nothing of the package and starts in a quarter of a second.

It answers with one line of JSON, followed by as many raw bytes as its "bytes" says: first with the file's variables,
then to each line of JSON on standard input with a part of one of them. A part is a list with one entry per dimension,
[start, stop, step] or {"at": indices}. An answer with "error" says why there is none.
"""

import json
import math
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

MEMORY = 6 * 2**30  # bytes of address space: twice the largest part that the reader asks for, and the libraries
PROCESSOR_TIME = 600  # s; ends this process where its parent was killed while the library hangs
LARGEST_TEXT = 2**20  # bytes of an attribute
MOST_VARIABLES = 10_000
FILTERS = (1, 2, 3, 4, 5, 6, 32000)  # that are HDF5's and h5py's own; for others HDF5 runs libraries that it finds


def limit_resources() -> None:
    """Limit memory and processor time where the system can."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for kind, most in ((resource.RLIMIT_AS, MEMORY), (resource.RLIMIT_CPU, PROCESSOR_TIME)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def open_variables(path: str, engine: str) -> tuple[Mapping, Mapping]:
    """Variables by name and attributes of the file."""
    if engine == "h5netcdf":
        import h5netcdf

        check_whole(path)
        file = h5netcdf.File(path, "r", phony_dims="access")
        return file.variables, file.attrs
    from scipy.io import netcdf_file

    file = netcdf_file(path, "r", mmap=True)
    return file.variables, file._attributes


def check_whole(path: str) -> None:
    """Refuse a file of HDF5 that has others read in its place, or other programs run.

    Raises:
        ValueError: it is such a file.
    """
    import h5py

    def problem(name: str, link: object) -> str | None:
        if not isinstance(link, h5py.HardLink):
            return f"{name}: is an HDF5 {type(link).__name__}, which leads elsewhere"
        if isinstance(each := file[name], h5py.Dataset):
            about = each.id.get_create_plist()
            if about.get_layout() == h5py.h5d.VIRTUAL or about.get_external_count():
                return f"{name}: has its values in other files"
            for number in (about.get_filter(i)[0] for i in range(about.get_nfilters())):
                if number not in FILTERS:
                    return f"{name}: is packed by filter {number}, not one of HDF5's own; `nccopy -d 4` packs it anew"
        return None

    with h5py.File(path, "r") as file:
        if found := file.visititems_links(problem):  # what the function raises would be lost
            raise ValueError(found)


def plain_attributes(attributes: Mapping) -> dict[str, Any]:
    """Attributes as JSON: text, or numbers with their type; other kinds are left out."""
    plain = {}
    for name in attributes:
        value = attributes[name]
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        elif not isinstance(value, str):
            array = np.asarray(value)
            if array.dtype.kind not in "biuf":
                continue
            value = {"dtype": array.dtype.str, "shape": array.shape, "values": array.tolist()}
            if array.dtype.itemsize > 8:
                value |= {"dtype": "<f8", "values": array.astype("<f8").tolist()}
        if len(str(value)) <= LARGEST_TEXT:
            plain[str(name)] = value
    return plain


def describe(variable: Any) -> dict[str, Any] | None:
    """Dimensions, shape, type, chunks and attributes of a variable; None for a type that is neither number nor text."""
    of_values = variable.dtype if hasattr(variable, "dtype") else variable.data.dtype  # the second is SciPy's
    dtype = np.dtype("O") if of_values is str else np.dtype(of_values)
    if dtype.kind not in "biufcSO":
        return None
    shape = [int(size) for size in variable.shape]
    return {
        "dimensions": [str(name) for name in variable.dimensions],
        "shape": shape,
        "dtype": dtype.str,
        "chunks": list(getattr(variable, "chunks", None) or (1,) * len(shape)),
        "attributes": plain_attributes(getattr(variable, "_attributes", None) or variable.attrs),
    }


def read(variable: Any, part: list) -> tuple[dict[str, Any], bytes]:
    """A part of a variable, as an answer and its bytes."""
    if math.prod(variable.shape) == 0 or not variable.shape:
        array = np.asarray(variable[...])
    else:
        array = np.asarray(variable[tuple(axis["at"] if isinstance(axis, dict) else slice(*axis) for axis in part)])
    answer = {"dtype": array.dtype.str, "shape": array.shape}
    if array.dtype.kind == "O":
        texts = [text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text) for text in array.flat]
        return answer | {"texts": texts}, b""
    return answer, array.tobytes()


def send(answer: dict[str, Any], data: bytes = b"") -> None:
    """Write an answer."""
    out = sys.stdout.buffer
    out.write(json.dumps(answer | {"bytes": len(data)}).encode() + b"\n")
    out.write(data)
    out.flush()


def main(path: str, engine: str) -> None:
    """Answer requests until standard input ends."""
    limit_resources()
    try:
        variables, attributes = open_variables(path, engine)
        if len(variables) > MOST_VARIABLES:
            raise ValueError(f"has {len(variables)} variables; at most {MOST_VARIABLES} are read")
        described = {str(name): describe(variables[name]) for name in variables}
        send({"variables": described, "attributes": plain_attributes(attributes)})
    except Exception as error:
        send({"error": explain(error)})
        return
    for line in sys.stdin.buffer:
        request = json.loads(line)
        try:
            answer, data = read(variables[request["variable"]], request["part"])
        except Exception as error:
            answer, data = {"error": explain(error)}, b""
        send(answer, data)


def explain(error: Exception) -> str:
    """The first line of what a library says."""
    return "needs too much memory" if isinstance(error, MemoryError) else (str(error).splitlines() or [repr(error)])[0]


if __name__ == "__main__":
    main(*sys.argv[1:])
