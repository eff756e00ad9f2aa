"""NetCDF files as xarray datasets whose values are read by another process, see `usvauv.env.netcdf.remote`.

Fill values and packing are decoded as the CF conventions define them (https://cfconventions.org), times are not.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from xarray.backends import BackendArray
from xarray.backends.common import AbstractDataStore
from xarray.core import indexing

from usvauv.env.netcdf.remote import NetcdfError, RemoteFile, RemoteVariable, open_remote


class _RemoteArray(BackendArray):
    """A remote variable as xarray asks for it."""

    def __init__(self, variable: RemoteVariable) -> None:
        self.shape, self.dtype, self._variable = variable.shape, variable.dtype, variable

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        support = indexing.IndexingSupport.OUTER_1VECTOR
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._variable.read)


class _Store(AbstractDataStore):
    """The variables and attributes of a file, undecoded."""

    def __init__(self, path: Path, file: RemoteFile) -> None:
        self._path, self._file = path, file

    def get_variables(self) -> dict[str, xarray.Variable]:
        """Variables by name, their values unread."""
        variables = {}
        for name, remote in self._file.variables.items():
            if len(set(remote.dimensions)) < len(remote.dimensions):
                raise NetcdfError(f"{self._path}: {name}: has a dimension twice")
            if remote.dimensions == (name,):  # a coordinate; all of it becomes an index of the dataset
                remote.check_size(remote.dtype.itemsize * math.prod(remote.shape))
            array = indexing.LazilyIndexedArray(_RemoteArray(remote))
            variables[name] = xarray.Variable(remote.dimensions, array, remote.attributes)
        return variables

    def get_attrs(self) -> dict[str, Any]:
        """Attributes of the file."""
        return self._file.attributes

    def get_dimensions(self) -> dict[str, int]:
        """Not known apart from the variables."""
        return {}

    def get_encoding(self) -> dict[str, Any]:
        """Nothing that reading needs."""
        return {}


@contextmanager
def open_file(path: str | Path) -> Iterator[xarray.Dataset]:
    """A NetCDF file, its values unread, fill values and packing to be decoded, times not decoded.

    Raises:
        NetcdfError: as `open_remote`, or it cannot be decoded.
    """
    path = Path(path)
    with open_remote(path) as file:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # two different fill values: both are masked; overflows: values are checked
            try:
                dataset = xarray.decode_cf(_Store(path, file), decode_times=False)
            except NetcdfError:
                raise
            except Exception as error:  # the libraries' own, of any kind, for attributes that make no sense
                raise NetcdfError(f"{path}: cannot be decoded: {first_line(error)}") from None
        yield dataset


def values(array: xarray.DataArray, where: str) -> np.ndarray:
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
