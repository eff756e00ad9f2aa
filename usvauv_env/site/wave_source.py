"""Location of a place and a time in a wave file: its stations or grid, and its times."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from usvauv.env.site.cf import (
    Axis,
    Field,
    bracket,
    coordinates_along,
    kind_of,
    mission_times,
    read_axis,
    refuse_dimension,
    require_numbers,
)
from usvauv.env.site.place import EQUATOR
from usvauv.env.storage import netcdf
from usvauv.env.storage.netcdf import OceanError

if TYPE_CHECKING:
    import xarray

FREQUENCIES, DIRECTIONS = (
    ("frequency", "freq", "frequencyNumber", "sea_surface_wave_frequency", "wave_frequency"),
    ("direction", "dir", "directionNumber", "sea_surface_wave_to_direction", "sea_surface_wave_from_direction"),
)
VERSIONS = "expver"  # dimension of ERA5's final and first results, of which a time has one
FARTHEST = 50e3  # m from a station to the middle of the area


class Sample(NamedTuple):
    """A time and a point of a file by their index in each dimension, and their weight."""

    index: dict[str, int]
    weight: float


@dataclass(frozen=True)
class Source:
    """A variable, and where in it the place and the time of a mission are.

    Attributes:
        where: file and variable.
        spectral: dimensions of frequency and direction by these names, where it has them.
        samples: highest weight first.
        start: as of `Waves`.
    """

    where: str
    array: xarray.DataArray
    spectral: dict[str, str]
    samples: list[Sample]
    start: str

    @classmethod
    def of(cls, dataset: xarray.Dataset, path: str | Path, name: str, place: tuple[float, float], start: str) -> Source:
        """The variable of a name at (longitude, latitude) and a start."""
        array, where = dataset[name], f"{path}: {name}"
        require_numbers(array, where)
        known: dict[str, tuple[str, str]] = {}  # coordinate and dimension of a kind
        spectral, stations = {}, None
        for dimension in array.dims:
            kind = _spectral_kind(dataset, str(dimension))
            along = coordinates_along(dataset, array, dimension)
            if kind:
                spectral[kind] = str(dimension)
            elif len(along) == 1 and along[0][0] in ("time", "latitude", "longitude"):
                known[along[0][0]] = along[0][1:]
            elif dimension == VERSIONS:
                continue
            elif found := _stations(dataset, str(dimension)):
                stations = found
            elif array.sizes[dimension] == 1:
                array = array.isel({dimension: 0}, drop=True)
            else:
                refuse_dimension(dataset, where, dimension)
        for coordinate, variable in dataset.variables.items():  # a file cut at a point may keep it as a single number
            kind = kind_of(dataset[coordinate])
            if variable.size == 1 and kind and kind not in known:
                known[kind] = str(coordinate), ""
        axes, times, clock = {}, [(0, 1.0)], ""
        if "time" in known:
            axes["time"] = read_axis(dataset[known["time"][0]].squeeze(), path, "time", known["time"][1])
        picked, seconds, begin = mission_times(Field(str(path), name, array, 1.0, axes), path, start, 0.0)
        if axes:
            clock = axes["time"].dimension
            times = [(int(axes["time"].order[picked[i]]), weight) for i, weight in _between(seconds, 0.0)]
        nearest = max(times, key=lambda time: time[1])[0]
        points = (
            _nearest_station(dataset, path, stations, place, nearest)
            if stations
            else _grid_points(dataset, path, known, place)
        )
        samples = [
            Sample({**point, clock: t} if clock else point, weight * share)
            for (t, weight), (point, share) in product(times, points)
            if weight * share > 0
        ]
        return cls(where, array, spectral, sorted(samples, key=lambda sample: -sample.weight), begin)

    def values(self, sample: Sample) -> np.ndarray:
        """Values of the variable at a time and point, by frequency and direction where it has them."""
        window = self.array.isel({name: i for name, i in sample.index.items() if name in self.array.dims})
        order = [self.spectral[kind] for kind in ("frequency", "direction") if kind in self.spectral]
        others = set(window.dims) - {*order, VERSIONS}
        if others:
            raise OceanError(f"{self.where}: has a dimension {others.pop()!r} beside those of its place and time")
        values = netcdf.values(window.transpose(..., *order), self.where).astype(np.float64)
        if VERSIONS not in window.dims:
            return values
        return next((version for version in values if not np.isnan(version).all()), values[0])


def _spectral_kind(dataset: xarray.Dataset, dimension: str) -> str | None:
    """ "frequency" or "direction", by the name of a dimension or the standard_name of its coordinate."""
    name = dataset[dimension].attrs.get("standard_name") if dimension in dataset.variables else None
    for kind, names in (("frequency", FREQUENCIES), ("direction", DIRECTIONS)):
        if dimension in names or name in names:
            return kind
    return None


def _stations(dataset: xarray.Dataset, dimension: str) -> tuple[str, str, str] | None:
    """Longitude and latitude of points along one dimension, which may change with time, and that dimension."""
    found = {}
    for name, variable in dataset.variables.items():
        kind = kind_of(dataset[name])
        others = [other for other in variable.dims if other != dimension]
        times = all(other in dataset.variables and kind_of(dataset[other]) == "time" for other in others)
        if dimension in variable.dims and times and kind in ("longitude", "latitude"):
            found[kind] = str(name)
    return (found["longitude"], found["latitude"], dimension) if len(found) == 2 else None


def _between(values: np.ndarray, target: float) -> list[tuple[int, float]]:
    """Indices of rising values about a target and their weights."""
    if len(values) == 1:
        return [(0, 1.0)]
    i, weight = (float(part) for part in bracket(values, target))
    return [(int(i), 1 - weight), (int(i) + 1, weight)]


def _nearest_station(
    dataset: xarray.Dataset, path: str | Path, stations: tuple[str, str, str], place: tuple[float, float], time: int
) -> list[tuple[dict[str, int], float]]:
    """The index of the station nearest to a place (longitude, latitude), and the weight 1."""
    dimension, there = stations[2], []
    for name in stations[:2]:
        others = [other for other in dataset[name].dims if other != dimension]
        there.append(netcdf.values(dataset[name].isel(dict.fromkeys(others, time)), f"{path}: {name}"))
    longitude, latitude = there
    away = _distance(longitude, latitude, place)
    if not np.isfinite(away).any():
        raise OceanError(f"{path}: {stations[0]}, {stations[1]}: no station has a position")
    nearest = int(np.nanargmin(away))
    _require_near(f"{path}: {dimension} {nearest}", float(longitude[nearest]), float(latitude[nearest]), place)
    return [({dimension: nearest}, 1.0)]


def _grid_points(
    dataset: xarray.Dataset, path: str | Path, known: dict[str, tuple[str, str]], place: tuple[float, float]
) -> list[tuple[dict[str, int], float]]:
    """Indices of the points of a grid about a place (longitude, latitude), or of the only one, and their weights."""
    parts = []
    axes: list[Axis] = []
    for kind, at in zip(("longitude", "latitude"), place, strict=True):
        if kind not in known:
            raise OceanError(
                f"{path}: has no {kind}; stations, or a grid of longitude and latitude lines, must have it"
            )
        axis = read_axis(dataset[known[kind][0]].squeeze(), path, kind, known[kind][1])
        if kind == "longitude" and len(axis.values) > 1:
            axis = axis.unwrapped(at)
        if len(axis.values) > 1 and not axis.values[0] <= at <= axis.values[-1]:
            raise OceanError(
                f"{path}: {axis.name}: the middle of the area is at {at:.5f} degrees and the file spans"
                f" {axis.values[0]:.5f} to {axis.values[-1]:.5f}; it must lie between its points"
            )
        axes.append(axis)
        parts.append(_between(axis.values, at))
    if min(len(axis.values) for axis in axes) == 1:
        nearest = (float(axis.values[abs(axis.values - at).argmin()]) for axis, at in zip(axes, place, strict=True))
        longitude, latitude = nearest
        _require_near(f"{path}: its point", longitude, latitude, place)
    points = []
    for indices in product(*parts):
        along = zip(axes, indices, strict=True)
        index = {axis.dimension: int(axis.order[i]) for axis, (i, _) in along if axis.dimension}
        points.append((index, math.prod(weight for _, weight in indices)))
    return points


def _distance(longitude: np.ndarray, latitude: np.ndarray, place: tuple[float, float]) -> np.ndarray:
    """Distances of points from a place (longitude, latitude), degrees, on a sphere, m."""
    phi, phi0 = np.radians(latitude), math.radians(place[1])
    half = np.radians(np.subtract(longitude, place[0])) / 2
    chord = np.sin((phi - phi0) / 2) ** 2 + np.cos(phi) * math.cos(phi0) * np.sin(half) ** 2
    return 2 * EQUATOR * np.arcsin(np.sqrt(np.clip(chord, 0, 1)))


def _require_near(where: str, longitude: float, latitude: float, place: tuple[float, float]) -> None:
    away = float(_distance(np.array(longitude), np.array(latitude), place))
    if away > FARTHEST:
        raise OceanError(
            f"{where} at {longitude:.3f}, {latitude:.3f} degrees is {away / 1000:.0f} km from the area, at"
            f" {place[0]:.3f}, {place[1]:.3f}; allowed: up to {FARTHEST / 1000:g} km"
        )
