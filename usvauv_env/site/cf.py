"""Fields on longitude and latitude lines in CF-NetCDF files: variable, axes, units, and reading a part of them.

Variables and coordinates are recognised by their attributes of the CF conventions, never by their position in the file.
Only the requested part is read. Source: https://cfconventions.org.
"""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from usvauv.env.storage import netcdf
from usvauv.env.storage.netcdf import OceanError

if TYPE_CHECKING:  # loading it takes a second and 50 MB; most runs read no NetCDF
    import xarray

AXES = ("time", "depth", "latitude", "longitude")
VERTICAL_NAMES = ("depth", "depth_below_geoid", "height", "height_above_mean_sea_level", "altitude")
DEGREES = {
    "latitude": ("degrees_north", "degree_north", "degrees_n", "degree_n", "degreesn", "degreen"),
    "longitude": ("degrees_east", "degree_east", "degrees_e", "degree_e", "degreese", "degreee"),
}
MOST_VALUES = {"time": 10**7, "depth": 1000, "latitude": 10**7, "longitude": 10**7}  # of a coordinate
CLOSEST = 1e-7  # degrees between points; 1 cm
TOLERANCE = 1e-3  # s by which rounded times may miss the mission
DEEPEST = 12000.0  # m; larger values are fill values or in other units
FIRST_YEAR, LAST_YEAR = 1678, 2262  # before the second: what datetime64[ns] can hold
CALENDARS = ("standard", "gregorian", "proleptic_gregorian")
METRES = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("km", "kilometer", "kilometers", "kilometre", "kilometres"), 1000.0),
}
METRES_PER_SECOND = {
    **dict.fromkeys(("m s-1", "m/s", "m.s-1", "m s^-1", "m s**-1", "m/sec", "meter/sec", "meters/sec"), 1.0),
    **dict.fromkeys(("meter second-1", "meters second-1", "metre second-1", "meters/second", "metres/second"), 1.0),
    **dict.fromkeys(("cm s-1", "cm/s", "cm.s-1", "cm/sec"), 0.01),
    **dict.fromkeys(("knot", "knots", "kt", "kn"), 1852 / 3600),
}


@dataclass(frozen=True)
class Axis:
    """One coordinate of a variable.

    Attributes:
        name, dimension: of the coordinate and its dimension in the file; a single number has the dimension "".
        values: (N,) rising; degrees, m below the surface, or datetime64.
        order: (N,) index in the file of each value.
    """

    name: str
    dimension: str
    values: np.ndarray
    order: np.ndarray

    def part(self, positions: np.ndarray) -> Axis:
        """The axis at some of its positions."""
        return Axis(self.name, self.dimension, self.values[positions], self.order[positions])

    def unwrapped(self, centre: float) -> Axis:
        """Longitudes within 180° of `centre`; of a point that the file holds twice, 360° apart, one remains."""
        values = self.values - 360 * np.round((self.values - centre) / 360)
        rank = np.argsort(values)
        apart = np.diff(values[rank], prepend=-np.inf) > 1e-3 * np.diff(self.values).min()
        rank = rank[apart]
        return Axis(self.name, self.dimension, values[rank], self.order[rank])


@dataclass(frozen=True)
class Field:
    """A variable of an open file with its axes by kind, as in `AXES`; `factor` converts it to SI units."""

    path: str
    name: str
    array: xarray.DataArray
    factor: float
    axes: dict[str, Axis]

    def read(self, axes: dict[str, Axis]) -> np.ndarray:
        """Values at parts of its axes: (time, depth, latitude, longitude) float64, NaN where there are none."""
        kinds = [kind for kind in AXES if kind in self.axes and self.axes[kind].dimension]
        window = self.array.isel({axes[kind].dimension: axes[kind].order for kind in kinds})
        window = window.transpose(*(axes[kind].dimension for kind in kinds))
        values = netcdf.values(window, f"{self.path}: {self.name}").astype(np.float64) * self.factor
        return np.expand_dims(values, tuple(i for i, kind in enumerate(AXES) if kind not in kinds))


def find(dataset: xarray.Dataset, path: str | Path, standard_names: Sequence[str]) -> str | None:
    """Name of the one variable with one of some standard names; None where there is none."""
    found = [
        name for name, variable in dataset.data_vars.items() if variable.attrs.get("standard_name") in standard_names
    ]
    if len(found) > 1:
        one_of = " or ".join(sorted({dataset[name].attrs["standard_name"] for name in found}))
        raise OceanError(f"{path}: {' and '.join(map(str, found))} both are {one_of}; the file must hold one of them")
    return str(found[0]) if found else None


def field(dataset: xarray.Dataset, path: str | Path, name: str, units: dict[str, float]) -> Field:
    """A variable with its axes; `units` are those allowed, each with its factor to SI.

    Raises:
        OceanError: wrong units, a missing, unordered or unknown coordinate, a curvilinear grid.
    """
    array = dataset[name]
    require_numbers(array, f"{path}: {name}")
    factor = factor_of(array, f"{path}: {name}", units)
    coordinates: list[tuple[str, str, str]] = []  # kind, name, dimension
    for dimension in array.dims:
        along = coordinates_along(dataset, array, dimension)
        if along:
            coordinates += along
        elif array.sizes[dimension] == 1:
            array = array.isel({dimension: 0}, drop=True)
        else:
            refuse_dimension(dataset, f"{path}: {name}", dimension)
    # A file cut at one depth or time may keep it as a single number.
    known = {kind for kind, _, _ in coordinates}
    single = ((kind_of(variable), str(other)) for other, variable in array.coords.items() if variable.ndim == 0)
    coordinates += [(kind, other, "") for kind, other in single if kind and kind not in known]
    axes: dict[str, Axis] = {}
    for kind, coordinate, dimension in coordinates:
        for other in axes.values():
            if (other.dimension and other.dimension == dimension) or axes.get(kind) is other:
                both = f"{other.name} and {coordinate}"
                raise OceanError(f"{path}: {name}: {both} are both coordinates of one dimension; one is allowed")
        axes[kind] = read_axis(dataset[coordinate], path, kind, dimension)
    for kind in ("latitude", "longitude"):
        if kind not in axes:
            raise OceanError(
                f"{path}: {name}: has no {kind} coordinate; "
                f"it must have one with standard_name {kind!r} or units {DEGREES[kind][0]!r}"
            )
        if len(axes[kind].values) < 2:
            raise OceanError(
                f"{path}: {axes[kind].name}: has one value, {axes[kind].values[0]:g}; at least two are needed"
            )
    return Field(str(path), name, array, factor, axes)


def factor_of(array: xarray.DataArray, where: str, units: dict[str, float]) -> float:
    """Factor to SI of a variable by its units.

    Raises:
        OceanError: no units, or others than those allowed.
    """
    given = array.attrs.get("units")
    if given is None:
        raise OceanError(f"{where}: has no units; allowed: {', '.join(units)}")
    factor = units.get(" ".join(str(given).lower().split()))
    if factor is None:
        raise OceanError(f"{where}: units {given!r}; allowed: {', '.join(units)}")
    return factor


def kind_of(variable: xarray.DataArray) -> str | None:
    """Kind of a coordinate, one of `AXES`, by its standard_name, units, positive and axis, or its name depth."""
    attributes = variable.attrs
    standard_name, axis = attributes.get("standard_name"), attributes.get("axis")
    units = str(attributes.get("units", "")).lower()
    if standard_name in ("longitude", "latitude", "time"):
        return standard_name
    if standard_name in VERTICAL_NAMES:
        return "depth"
    for kind, names in DEGREES.items():
        if units in names:
            return kind
    if standard_name is not None:  # anything else is a quantity of its own, such as grid_longitude
        return None
    if " since " in units or axis == "T":
        return "time"
    if str(attributes.get("positive")).lower() in ("up", "down") or axis == "Z" or variable.name == "depth":
        return "depth"
    if units in ("degrees", "degree") and axis in ("X", "Y"):
        return "longitude" if axis == "X" else "latitude"
    return None


def coordinates_along(
    dataset: xarray.Dataset, array: xarray.DataArray, dimension: Hashable
) -> list[tuple[str, str, str]]:
    """Coordinates of one dimension as (kind, name, dimension): its own, or else others that lie on it alone."""
    if dimension in dataset.variables and (kind := kind_of(dataset[dimension])):
        return [(kind, str(dimension), str(dimension))]
    on_it = [dataset[name] for name, variable in dataset.variables.items() if variable.dims == (dimension,)]
    return [(kind, str(other.name), str(dimension)) for other in on_it if (kind := kind_of(other))]


def refuse_dimension(dataset: xarray.Dataset, where: str, dimension: Hashable) -> None:
    """Raise the error for a dimension without a known coordinate."""
    for name, variable in dataset.variables.items():
        if variable.ndim == 2 and dimension in variable.dims and kind_of(dataset[name]) in ("latitude", "longitude"):
            raise OceanError(
                f"{where}: lies on a curvilinear grid ({name} has dimensions {', '.join(map(str, variable.dims))}); "
                "allowed: a grid of longitude and latitude lines, as `cdo remapbil,GRID in.nc out.nc` or xESMF makes, "
                "velocities turned to east and north"
            )
    raise OceanError(
        f"{where}: dimension {dimension!r} has no coordinate that is a longitude, latitude, depth or time "
        "by its standard_name, units or axis"
    )


def require_numbers(array: xarray.DataArray, where: str) -> None:
    """Refuse a variable of text or other things."""
    if array.dtype.kind not in "iuf":
        raise OceanError(f"{where}: is not numeric but {array.dtype}")


def read_axis(variable: xarray.DataArray, path: str | Path, kind: str, dimension: str) -> Axis:
    """A coordinate of a kind of `AXES`, read and checked.

    Raises:
        OceanError: values that are missing, not in order or out of range; wrong units.
    """
    where = f"{path}: {variable.name}"
    require_numbers(variable, where)
    if not 1 <= variable.size <= MOST_VALUES[kind]:
        raise OceanError(f"{where}: has {variable.size} values; allowed: 1 to {MOST_VALUES[kind]}")
    raw = np.atleast_1d(netcdf.values(variable, where).astype(np.float64))
    if not np.isfinite(raw).all():
        raise OceanError(f"{where}: value {int(np.flatnonzero(~np.isfinite(raw))[0])} is missing; all must be given")
    if kind == "time":
        values = _decode_time(raw, variable.attrs, where)
    elif kind == "depth":
        values = _decode_depth(raw, variable, where)
    else:
        values = _decode_degrees(raw, variable, where, kind)
    steps = np.diff(values).astype(np.float64)
    falling = len(steps) > 0 and steps[0] < 0
    wrong = np.flatnonzero(steps >= 0 if falling else steps <= 0)
    if len(wrong):
        before, after = values[wrong[0]], values[wrong[0] + 1]
        order = "is repeated" if before == after else f"follows {before}"
        raise OceanError(f"{where}: is not in order: {after} {order}; values must rise or fall throughout")
    order = np.arange(len(values))[:: -1 if falling else 1]
    return Axis(str(variable.name), dimension, values[order], order)


def _decode_degrees(raw: np.ndarray, variable: xarray.DataArray, where: str, kind: str) -> np.ndarray:
    allowed = (*DEGREES[kind], "degrees", "degree")
    units = variable.attrs.get("units")
    if str(units).lower() not in allowed:
        raise OceanError(f"{where}: units {units!r}; allowed: {', '.join(allowed)}")
    limit = 90 if kind == "latitude" else 540
    if abs(raw).max() > limit:
        raise OceanError(f"{where}: {raw[abs(raw).argmax()]:g} degrees; allowed: -{limit} to {limit}")
    if len(raw) > 1 and 0 < (closest := abs(np.diff(raw)).min()) < CLOSEST:
        raise OceanError(f"{where}: has points {closest:g} degrees apart; allowed: at least {CLOSEST:g}")
    steps = np.diff(raw)
    if kind == "longitude" and abs(steps).max(initial=0) > 180 and steps.min() < 0:  # about a seam: 179.5, 180, -179.5
        return np.unwrap(raw, period=360)
    return raw


def _decode_depth(raw: np.ndarray, variable: xarray.DataArray, where: str) -> np.ndarray:
    positive = variable.attrs.get("positive")
    if positive is None:
        standard_name = variable.attrs.get("standard_name", "depth" if variable.name == "depth" else "")
        positive = {"depth": "down", "depth_below_geoid": "down", "": "missing"}.get(standard_name, "up")
    if (positive := str(positive).lower()) not in ("up", "down"):
        raise OceanError(f"{where}: its attribute positive is {positive!r}; allowed: 'up', 'down'")
    values = raw * factor_of(variable, where, METRES) * (1 if positive == "down" else -1)
    if values.min() < 0:
        raise OceanError(f"{where}: {raw[values.argmin()]:g} with positive {positive!r} is above the surface")
    if values.max() > DEEPEST:
        raise OceanError(f"{where}: {values.max():g} m; allowed: up to {DEEPEST:g} m")
    return values


def _decode_time(raw: np.ndarray, attributes: dict, where: str) -> np.ndarray:
    import xarray

    units, calendar = attributes.get("units"), str(attributes.get("calendar", "standard")).lower()
    if calendar not in CALENDARS:
        raise OceanError(f"{where}: calendar {calendar!r}; allowed: {', '.join(CALENDARS)}")
    coded = xarray.Dataset({"time": ("time", raw, {"units": units, "calendar": calendar})})
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            values = xarray.decode_cf(coded)["time"].values
    except Exception:  # the library's own, of any kind, for units and numbers that are no times
        values = raw
    if not np.issubdtype(values.dtype, np.datetime64):
        # Without cftime xarray supports no date before FIRST_YEAR, not even as reference date of present times.
        old = " since " in str(units) and not importlib.util.find_spec("cftime")
        raise OceanError(
            f"{where}: units {units!r}; allowed: such as 'hours since 2000-01-01 00:00:00', "
            f"with values that are times of the years {FIRST_YEAR} to {LAST_YEAR - 1}"
            f"{'; a date before that in the units needs cftime (pip install cftime)' * old}"
        )
    return to_nanoseconds(values, where)


def to_nanoseconds(times: np.ndarray, where: str) -> np.ndarray:
    """Times as datetime64[ns]; `where` names them in an error message.

    Raises:
        OceanError: a time that this type cannot hold.
    """
    years = times.astype("datetime64[Y]").astype(int) + 1970
    wrong = times[~((years >= FIRST_YEAR) & (years < LAST_YEAR))]
    if wrong.size:
        raise OceanError(f"{where}: {wrong[0]}; allowed: the years {FIRST_YEAR} to {LAST_YEAR - 1}")
    return times.astype("datetime64[ns]")


def mission_times(
    source: Field, path: str | Path, start: str | None, duration: float
) -> tuple[np.ndarray, np.ndarray, str]:
    """Positions on the time axis that enclose the mission, their seconds since its start, and that start."""
    if "time" not in source.axes:
        if start:
            raise OceanError(f"{path}: {source.name}: has no time coordinate; start = {start!r} must be left empty")
        return np.zeros(1, int), np.zeros(1), ""
    values = source.axes["time"].values
    begin = parse_time(start) if start else values[0]
    seconds = (values - begin) / np.timedelta64(1, "ns") * 1e-9
    if len(values) == 1:
        if abs(seconds[0]) > TOLERANCE:
            raise OceanError(f"{path}: has one time, {iso(values[0])}; start = {start!r} must be that or left empty")
        return np.zeros(1, int), np.zeros(1), iso(begin)
    if seconds[0] > TOLERANCE or duration > seconds[-1] + TOLERANCE:
        end = begin + np.timedelta64(round(duration * 1e9), "ns")
        raise OceanError(
            f"{path}: {source.axes['time'].name}: the mission lasts from {iso(begin)} to {iso(end)} "
            f"and the file from {iso(values[0])} to {iso(values[-1])}; it must enclose the mission"
        )
    first = np.searchsorted(seconds, TOLERANCE, "right") - 1
    last = max(np.searchsorted(seconds, duration - TOLERANCE, "left"), first + 1)
    picked = np.arange(first, min(last, len(values) - 1) + 1)
    return picked, seconds[picked], iso(begin)


def parse_time(start: str) -> np.datetime64:
    """A time in ISO 8601, UTC unless it says otherwise, as datetime64[ns].

    Raises:
        OceanError: it is none.
    """
    try:
        moment = datetime.fromisoformat(start)
        if moment.tzinfo:
            moment = moment.astimezone(UTC).replace(tzinfo=None)
    except (ValueError, OverflowError):
        raise OceanError(f"start = {start!r}; allowed: ISO 8601, such as 2026-01-31T06:00:00") from None
    return to_nanoseconds(np.array([moment], "datetime64[us]"), f"start = {start!r}")[0]


def iso(moment: Any) -> str:
    """A datetime64 as text, to the microsecond."""
    return str(moment.astype("datetime64[us]")).removesuffix(".000000")


def bracket(values: np.ndarray, targets: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Index of the value at or below each target and the weight, 0 to 1, of the next."""
    index = np.clip(np.searchsorted(values, targets, "right") - 1, 0, len(values) - 2)
    return index, np.clip((targets - values[index]) / (values[index + 1] - values[index]), 0, 1)
