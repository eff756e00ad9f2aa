"""Reading NetCDF files: NetCDF-4 with h5netcdf, NetCDF-3 with SciPy where it is installed.

The libraries' messages about a file that they cannot read become one line. A file that refers to other files, or runs
other programs, is refused before any of it is read.
"""

from __future__ import annotations

import errno
import importlib.util
import math
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from usvauv.kernels.errors import UserError

if TYPE_CHECKING:  # most runs read no NetCDF
    import h5netcdf
    import xarray

LARGEST_PART = 2**31  # bytes that are read at once
FILTERS = (1, 2, 3, 4, 5, 6, 32000)  # that are HDF5's and h5py's own; for others HDF5 runs libraries that it finds
TEXTS = ("standard_name", "units", "positive", "axis", "calendar")  # attributes that are read as text


class OceanError(UserError, ValueError):
    """A file of bathymetry, currents or waves cannot be used; one line names file, variable, and what is allowed."""


class NetcdfError(OceanError):
    """A NetCDF file cannot be read; one line names the file and the problem."""


@contextmanager
def open_plain(path: str | Path) -> Iterator[h5netcdf.File]:
    """A NetCDF-4 file as it is, its values unread; `values` reads them. For blocks that do nothing but read.

    Raises:
        NetcdfError: no such file, not NetCDF-4, or damaged.
    """
    import h5netcdf

    path = Path(path)
    with reading(path):
        if _engine(path) != "h5netcdf":
            raise NetcdfError(f"{path}: not a NetCDF-4 file")
        check_whole(path)
        with h5netcdf.File(path, "r", phony_dims="access") as file:
            yield file


@contextmanager
def open_decoded(path: str | Path) -> Iterator[xarray.Dataset]:
    """A NetCDF file, its values unread, fill values and packing to be decoded, times not decoded.

    Raises:
        NetcdfError: no such file, not NetCDF, damaged, or its attributes make no sense.
    """
    import xarray

    path = Path(path)
    with reading(path):
        options: dict[str, Any] = {"engine": _engine(path)}
        if options["engine"] == "h5netcdf":
            check_whole(path)
            options["phony_dims"] = "access"
        dataset = xarray.open_dataset(path, decode_times=False, cache=False, **options)
    with dataset:
        for name, variable in dataset.variables.items():
            if len(set(variable.dims)) < len(variable.dims):
                raise NetcdfError(f"{path}: {name}: has a dimension twice")
            for key in {*TEXTS} & {*variable.attrs}:
                variable.attrs[key] = str(variable.attrs[key])
        yield dataset


def values(array: xarray.DataArray | h5netcdf.Variable, where: str | Path, part: Any = ...) -> np.ndarray:
    """Values of a variable of an open file, or of a part of it; `where` names them in an error message.

    Raises:
        NetcdfError: they cannot be read, or take more than `LARGEST_PART`.
    """
    if part is ... and (size := array.dtype.itemsize * math.prod(array.shape)) > LARGEST_PART:
        raise NetcdfError(f"{where}: {size:,} bytes are asked for; at most {LARGEST_PART:,} are read at once")
    with reading(where):
        return np.asarray(array[part])


@contextmanager
def reading(where: str | Path) -> Iterator[None]:
    """Turn what the libraries raise, which can be of any kind where a file is damaged, into one line.

    Raises:
        NetcdfError: anything was raised.
    """
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # two different fill values: both are masked; overflows: values are checked
        try:
            yield
        except UserError:
            raise
        except Exception as error:
            reason = getattr(error, "strerror", None) or (str(error).splitlines() or [repr(error)])[0]
            raise NetcdfError(f"{where}: cannot be read: {reason}") from None


def check_whole(path: Path) -> None:
    """Refuse a file of HDF5 that has others read in its place, or other programs run.

    Raises:
        NetcdfError: it is such a file, or has a coordinate larger than `LARGEST_PART`, which opening it would read.
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
            if each.ndim == 1 and each.nbytes > LARGEST_PART:
                return f"{name}: has {each.nbytes:,} bytes; at most {LARGEST_PART:,} are read at once"
        return None

    with h5py.File(path, "r") as file:
        if found := file.visititems_links(problem):  # what the function raises would be lost
            raise NetcdfError(f"{path}: {found}")


def _engine(path: Path) -> str:
    """The library that reads a file, by its first bytes."""
    if not os.path.isfile(path):  # false, unlike an error, for paths that no system allows
        reason = errno.EISDIR if os.path.isdir(path) else errno.EINVAL if os.path.exists(path) else errno.ENOENT
        raise NetcdfError(f"{path}: cannot be read: {os.strerror(reason)}")
    with path.open("rb") as file:
        magic = file.read(8)
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
