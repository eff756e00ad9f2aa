"""Currents and bathymetry of an area on the Earth, read from CF-NetCDF files onto the local plane.

Between the points of a file fields are linear in longitude, latitude, depth and time. Points without a value are land
or bed: velocity and depth are 0 there. `docs/real-water.md` has an example.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from usvauv.env.site.cf import (
    DEEPEST,
    METRES,
    METRES_PER_SECOND,
    Axis,
    Field,
    bracket,
    field,
    find,
    iso,
    mission_times,
)
from usvauv.env.site.place import EQUATOR, LocalFrame
from usvauv.env.storage.netcdf import OceanError, open_decoded

if TYPE_CHECKING:
    import xarray

DEPTH_NAMES = (
    "sea_floor_depth_below_sea_surface",
    "sea_floor_depth_below_geoid",
    "sea_floor_depth_below_mean_sea_level",
    "sea_floor_depth",
    "model_sea_floor_depth_below_geoid",
)
HEIGHT_NAMES = (
    "height_above_mean_sea_level",
    "height_above_geopotential_datum",
    "height_above_reference_ellipsoid",  # GEBCO's name for its elevation, which is relative to the sea level
    "altitude",
)
# GEBCO, ETOPO, SRTM15+, ERDDAP; only where no variable has one of the names above
WELL_KNOWN_HEIGHTS = ("elevation", "z", "topo", "altitude")
CURRENT_NAMES = (
    ("eastward_sea_water_velocity", "northward_sea_water_velocity"),
    ("sea_water_x_velocity", "sea_water_y_velocity"),  # east and north too, since `field` refuses any other grid
)
WELL_KNOWN_CURRENTS = (  # east and north; only where no variable has one of the names above
    ("uo", "vo"),  # CMEMS
    ("water_u", "water_v"),  # HYCOM
    ("vozocrtx", "vomecrty"),  # NEMO
    ("u", "v"),
)
HIGHEST, FASTEST = 9000.0, 20.0  # m and m/s; larger values are fill values or in other units
SURFACE_LAYER = 15.0  # m; a file whose first depth is at most this serves up to the surface
MAX_NODES = 129
BLOCK = 2**21  # values interpolated at a time
SLACK = 1e-5  # degrees by which rounded coordinates may miss the area


@dataclass(frozen=True)
class Flow:
    """Currents over an area on a uniform grid whose corner nodes are the area's corners.

    Attributes:
        width, length: extent of the area in x and y, m.
        levels: (L,) depths, m.
        times: (T,) s since the start of the mission; a single one for a steady flow.
        velocity: (T, L, ny, nx, 2) float32, x and y component, m/s; row 0 in the south.
        start: time of the file at which the mission starts, ISO 8601, UTC; "" where the file has no time.
    """

    width: float
    length: float
    levels: tuple[float, ...]
    times: np.ndarray
    velocity: np.ndarray
    start: str

    def at(self, t: float) -> np.ndarray:
        """Velocity (L, ny, nx, 2) at t seconds since the start, as `at_time`."""
        return at_time(self.times, self.velocity, t)


def read_bathymetry(
    path: str | Path, frame: LocalFrame, width: float, length: float, cells: tuple[int, int]
) -> np.ndarray:
    """Depth h at the cells of an area, (ny, nx) float64, m, row 0 in the south.

    On land h is at most 0: minus the height, or 0 where the file has no value. The bed is bilinear between the file's
    points; cells wider than its spacing take the mean over enough points.

    Args:
        path: NetCDF file with a depth (positive down) or an elevation (positive up) of the bed.
        frame: where the area is.
        width, length: its extent in x and y, m.
        cells: (nx, ny).

    Raises:
        OceanError: the file does not serve; the message says why.
    """
    with open_decoded(path) as dataset:
        source, sign = _bed(dataset, path)
        for kind in ("time", "depth"):
            if kind in source.axes and len(source.axes[kind].values) > 1:
                raise OceanError(f"{path}: {source.name}: changes with {source.axes[kind].name}; the bed must not")
        axes = source.axes | _window(source, frame, width, length)
        values = sign * source.read(axes)[0, 0]
    if not (known := np.isfinite(values)).any():
        raise OceanError(f"{path}: {source.name}: has no values in the area: all of it is land")
    deepest, highest = values[known].max(), -values[known].min()
    for extreme, limit, way in ((deepest, DEEPEST, "deep"), (highest, HIGHEST, "high")):
        if extreme > limit:
            allowed = f"allowed: up to {limit:g} m: see its units and fill"
            raise OceanError(f"{path}: {source.name}: {extreme:g} m {way}; {allowed}")
    depth = cell_means(np.where(known, values, 0.0), axes, frame, width, length, cells)
    if not (depth > 0).any():
        raise OceanError(f"{path}: {source.name}: no water in the area: depths from {-highest:g} to {deepest:g} m")
    return depth


def read_flow(
    path: str | Path,
    frame: LocalFrame,
    width: float,
    length: float,
    levels: Sequence[float],
    start: str | None = None,
    duration: float = 0.0,
) -> Flow:
    """Currents over an area at some depths while a mission lasts.

    Args:
        path: NetCDF file with eastward and northward velocities.
        frame: where the area is.
        width, length: its extent in x and y, m.
        levels: depths, m, positive down.
        start: time at which the mission starts, ISO 8601, UTC unless it says otherwise; None or "": the file's first.
        duration: of the mission, s. A file with one time is a steady flow, whatever the duration.

    Raises:
        OceanError: the file does not serve; the message says why.
    """
    with open_decoded(path) as dataset:
        east, north = (field(dataset, path, name, METRES_PER_SECOND) for name in _current_names(dataset, path))
        picked, times, begin = mission_times(east, path, start, duration)
        clocks = [part.axes["time"].values if "time" in part.axes else [] for part in (east, north)]
        if not np.array_equal(clocks[0], clocks[1]):
            raise OceanError(f"{path}: {east.name} and {north.name} are given at different times")
        windows = [
            part.axes | _window(part, frame, width, length) | _layers(part, path, levels) for part in (east, north)
        ]
        lon, lat = frame.to_geographic(*_nodes(windows, width, length))
        velocity = np.empty((len(times), len(levels), *lon.shape, 2), np.float32)
        size = math.prod(len(axis.values) for kind, axis in windows[0].items() if kind != "time")
        step = max(1, BLOCK // max(size, lon.size * len(levels)))
        for first in range(0, len(times), step):
            block = slice(first, first + step)
            for part, axes in zip((east, north), windows, strict=True):
                if "time" in axes:
                    axes["time"] = part.axes["time"].part(picked[block])
            components = [
                bilinear(_at_levels(part, axes, levels), axes["longitude"].values, axes["latitude"].values, lon, lat)
                for part, axes in zip((east, north), windows, strict=True)
            ]
            velocity[block] = np.stack(frame.to_plane(lon, lat, *components), axis=-1)
    return Flow(width, length, tuple(map(float, levels)), times, velocity, begin)


def _bed(dataset: xarray.Dataset, path: str | Path) -> tuple[Field, float]:
    """The variable with the bed and the sign that makes it a depth."""
    name = find(dataset, path, (*DEPTH_NAMES, *HEIGHT_NAMES))
    if name is None:
        name = next((known for known in WELL_KNOWN_HEIGHTS if known in dataset.data_vars), None)
    if name is None:
        raise OceanError(
            f"{path}: no variable with the standard_name of a bathymetry: {', '.join((*DEPTH_NAMES, *HEIGHT_NAMES))}"
        )
    return field(dataset, path, name, METRES), 1 if dataset[name].attrs.get("standard_name") in DEPTH_NAMES else -1


def _current_names(dataset: xarray.Dataset, path: str | Path) -> tuple[str, str]:
    for pair in CURRENT_NAMES:
        east, north = (find(dataset, path, (standard_name,)) for standard_name in pair)
        if east and north:
            return east, north
        if east or north:
            missing = pair[1 if east else 0]
            raise OceanError(f"{path}: has {east or north} but no variable with standard_name {missing}")
    for pair in WELL_KNOWN_CURRENTS:
        if all(name in dataset.data_vars and "standard_name" not in dataset[name].attrs for name in pair):
            return pair
    allowed, known = (
        " or ".join(" with ".join(pair) for pair in pairs) for pairs in (CURRENT_NAMES, WELL_KNOWN_CURRENTS)
    )
    raise OceanError(
        f"{path}: no variables with the standard_name of a current: {allowed}; nor, without any, the names {known}"
    )


def _window(source: Field, frame: LocalFrame, width: float, length: float) -> dict[str, Axis]:
    """Parts of a field's latitude and longitude that just enclose the area."""
    corners = frame.to_geographic(*np.meshgrid([0.0, width], [0.0, length]))
    west_east, south_north = ((degrees.min(), degrees.max()) for degrees in corners)
    longitude, latitude = source.axes["longitude"].unwrapped(sum(west_east) / 2), source.axes["latitude"]
    return {
        "latitude": _enclose(source, latitude, "latitude", south_north),
        "longitude": _enclose(source, longitude, "longitude", west_east),
    }


def _enclose(source: Field, axis: Axis, kind: str, span: tuple[float, float]) -> Axis:
    """The points of an axis from the last at or below `span` to the first at or above it."""
    raw = source.axes[kind].values
    first = np.searchsorted(axis.values, span[0] + SLACK, "right") - 1
    last = max(np.searchsorted(axis.values, span[1] - SLACK, "left"), first + 1)
    # Beside the ends of the file there is its other end, 360° away, if it goes round the Earth.
    inside = first >= 0 and last < len(axis.values)
    if not inside or np.diff(axis.values[first : last + 1]).max() > 1.5 * np.diff(raw).max():
        shift = 360 * round((raw.mean() - sum(span) / 2) / 360) if kind == "longitude" else 0
        raise OceanError(
            f"{source.path}: {axis.name}: the area spans {span[0] + shift:.5f} to {span[1] + shift:.5f} degrees and "
            f"the file {raw[0]:.5f} to {raw[-1]:.5f}; its points must enclose the area"
        )
    return axis.part(np.arange(first, last + 1))


def _layers(source: Field, path: str | Path, levels: Sequence[float]) -> dict[str, Axis]:
    """The part of a field's depths that is needed for `levels`."""
    if "depth" not in source.axes:
        raise OceanError(f"{path}: {source.name}: has no depth coordinate; it must say how deep its currents are")
    axis = source.axes["depth"]
    depths = axis.values
    bottom = depths[-1] + (depths[-1] - depths[-2]) / 2 if len(depths) > 1 else depths[-1]
    top = 0.0 if depths[0] <= SURFACE_LAYER else depths[0]
    for level in levels:
        if not top <= level <= bottom:
            raise OceanError(
                f"{path}: {axis.name}: currents are needed at {level:g} m and the file's depths are {depths[0]:g} to "
                f"{depths[-1]:g} m; they serve from {top:g} to {bottom:g} m"
            )
    needed = np.flatnonzero(depth_weights(depths, levels).any(axis=0))
    return {"depth": axis.part(needed)}


def _nodes(windows: Sequence[dict[str, Axis]], width: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """x and y, (ny, nx), of nodes at most half the files' spacing apart, as far as `MAX_NODES` go."""
    steps = np.min([spacing(axes) for axes in windows], axis=0)
    nx, ny = (
        min(max(math.ceil(2 * extent / size) + 1, 2), MAX_NODES)
        for extent, size in zip((width, length), steps, strict=True)
    )
    x, y = np.meshgrid(np.linspace(0, width, nx), np.linspace(0, length, ny))
    return x, y


def _at_levels(source: Field, axes: dict[str, Axis], levels: Sequence[float]) -> np.ndarray:
    """Velocity component (T, L, latitude, longitude), m/s, in a window of a file; 0 where it has no value."""
    values = source.read(axes)
    known = np.isfinite(values)
    values[~known] = 0.0
    if (fastest := abs(values).max()) > FASTEST:
        raise OceanError(
            f"{source.path}: {source.name}: {fastest:g} m/s; allowed: up to {FASTEST:g} m/s: see its units and fill"
        )
    weights = depth_weights(axes["depth"].values, levels)
    wet = np.asarray(known.any(axis=(2, 3)))
    dry = ~(wet[:, None] & (weights > 0)).any(axis=2)
    if dry.any():
        t, level = np.argwhere(dry)[0]
        when = f" at {iso(axes['time'].values[t])}" if "time" in axes else ""
        raise OceanError(
            f"{source.path}: {source.name}: has no values in the area at a depth of {levels[level]:g} m{when}: "
            "all of it is land or below the bed, or the data have a gap"
        )
    return np.einsum("ld,tdyx->tlyx", weights, values)


def depth_weights(depths: np.ndarray, levels: Sequence[float]) -> np.ndarray:
    """Weight of each depth of a file in each level, (L, D): linear between depths, nearest depth beyond them."""
    return np.stack([np.interp(levels, depths, unit) for unit in np.eye(len(depths))], axis=1)


def cell_means(
    values: np.ndarray,
    axes: dict[str, Axis],
    frame: LocalFrame,
    width: float,
    length: float,
    cells: tuple[int, int],
) -> np.ndarray:
    """Means over cells, (ny, nx), of the bilinear field through `values` (latitude, longitude)."""
    nx, ny = cells
    across, along = (
        # Points unevenly spaced do not need as many everywhere as where they are closest.
        min(max(1, math.ceil(size / step)), 4 * math.ceil(len(axes[kind].values) / count))
        for size, count, step, kind in zip(
            (width / nx, length / ny), cells, spacing(axes), ("longitude", "latitude"), strict=True
        )
    )
    x = (np.arange(nx * across) + 0.5) * (width / (nx * across))
    means = np.empty((ny, nx))
    step = max(1, BLOCK // (len(x) * along))
    for first in range(0, ny, step):
        rows = np.arange(first * along, min(first + step, ny) * along)
        lon, lat = frame.to_geographic(*np.meshgrid(x, (rows + 0.5) * (length / (ny * along))))
        fine = bilinear(values, axes["longitude"].values, axes["latitude"].values, lon, lat)
        means[first : first + step] = fine.reshape(-1, along, nx, across).mean(axis=(1, 3))
    return means


def spacing(axes: dict[str, Axis]) -> tuple[float, float]:
    """Smallest distance between points of a window in x and y, m."""
    degrees = {kind: np.radians(np.diff(axes[kind].values).min()) for kind in ("longitude", "latitude")}
    parallel = math.cos(math.radians(abs(axes["latitude"].values).max()))
    return EQUATOR * parallel * degrees["longitude"], EQUATOR * degrees["latitude"]


def bilinear(values: np.ndarray, columns: np.ndarray, rows: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A field (…, rows, columns) at points x and y inside it; `columns` and `rows` are the places of its own points."""
    i, right = bracket(columns, x)
    j, up = bracket(rows, y)
    south = (1 - right) * values[..., j, i] + right * values[..., j, i + 1]
    north = (1 - right) * values[..., j + 1, i] + right * values[..., j + 1, i + 1]
    return (1 - up) * south + up * north


def at_time(times: np.ndarray, values: np.ndarray, t: float) -> np.ndarray:
    """Values (T, …) float32 at rising times (T,) s, linear between them; beyond them those of the nearest time."""
    if len(times) == 1:
        return values[0]
    index, weight = bracket(times, t)
    weight = np.float32(weight)
    return (1 - weight) * values[index] + weight * values[index + 1]
