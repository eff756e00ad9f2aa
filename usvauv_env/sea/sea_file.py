"""Simulated sea as CF-NetCDF, written step by step."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np

from usvauv.env.sea.simulation import SeaSimulation
from usvauv.env.site import place
from usvauv.env.storage.files import hdf5_file
from usvauv.kernels.interruption import deferred

CHUNK = 512  # largest side in cells of a chunk of the file
ELEVATION = "sea_surface_height_above_mean_sea_level"
WAYS = "eastward", "northward"  # along x and y


class SeaFile:
    """A CF-1.11 NetCDF-4 file of a sea, one record a step; memory does not grow with the number of records.

    A context manager: the file appears at its path when the context ends, and not at all after an error.

    Variables: `elevation`, `u` and `v` of the long waves, (time, y, x); `current_x` and `current_y`, (y, x) where they
    are steady, else (time, y, x); `depth` (y, x). x points east, y north. Where the scenario has a place on Earth also
    `longitude` and `latitude` (y, x) and the grid mapping `crs`; where it has a date, `time` counts from it.
    """

    def __init__(self, path: Path, sea: SeaSimulation) -> None:
        self._records, self._frame = 0, sea.site.frame
        with deferred(), ExitStack() as stack:
            self._disk = stack.enter_context(hdf5_file(path))
            self._file = h5netcdf.File(self._disk, "w")
            stack.callback(self._file.close)
            self._describe(sea)
            self._lay_out(sea)
            self._file.flush()
            self._disk.check()
            self._stack = stack.pop_all()

    def add(self, sea: SeaSimulation) -> None:
        """Append a record of the present state of a sea."""
        n, (u, v) = self._records, sea.velocity()
        fields = {"elevation": sea.surface().elevation, "u": u, "v": v}
        if not sea.steady:
            fields["current_x"], fields["current_y"] = np.moveaxis(sea.current(), -1, 0)
        with deferred():
            self._file.resize_dimension("time", n + 1)
            self._file.variables["time"][n] = sea.time
            for name, field in fields.items():
                self._file.variables[name][n] = field
        self._disk.check()
        self._records = n + 1

    def __enter__(self) -> SeaFile:
        return self

    def __exit__(self, *problem: Any) -> None:
        with deferred():
            self._stack.__exit__(*problem)

    def _describe(self, sea: SeaSimulation) -> None:
        """Global attributes."""
        scenario, version = sea.scenario, metadata.version("usvauv")
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        _label(
            self._file,
            Conventions="CF-1.11",
            title=f"Sea surface and current of the scenario {scenario.name}",
            source=f"usvauv {version}: shallow-water long waves, directional Airy storm, Lamb–Oseen vortices",
            history=f"{now}: usvauv {version} sea, scenario {scenario.name}, seed {sea.seed}",
            references="Xu, Xie, Wang, Ding, Zhang: USV–AUV Collaboration Framework for Underwater Tasks under Extreme"
            " Sea Conditions, ICASSP 2025",
            comment="Simulated. x points east and y north at the area's south-west corner.",
            seed=str(sea.seed),
            scenario=scenario.to_toml(),
        )

    def _lay_out(self, sea: SeaSimulation) -> None:
        """Dimensions, coordinates with their bounds, and the variables.

        x and y have no attribute `axis`: ParaView takes that for longitude and latitude and wraps the sea round a
        globe. Their standard names say the same to all who read CF.
        """
        file = self._file
        file.dimensions = {"time": None, "y": len(sea.y), "x": len(sea.x), "side": 2}
        time = file.create_variable("time", ("time",), np.float64, chunks=(1024,))
        _label(time, **place.time_attributes(sea.site.start, "the start of the simulation"))
        for name, centres, spacing in zip("xy", (sea.x, sea.y), sea.spacing, strict=True):
            axis = file.create_variable(name, (name,), np.float64, data=centres)
            _label(axis, **(place.X_AXIS if name == "x" else place.Y_AXIS), bounds=f"{name}_bounds")
            sides = np.add.outer(centres, (-spacing / 2, spacing / 2))
            file.create_variable(f"{name}_bounds", (name, "side"), np.float64, data=sides)
        if self._frame:
            places = self._frame.to_geographic(*np.meshgrid(sea.x, sea.y))
            for about, degrees in zip((place.LONGITUDE, place.LATITUDE), places, strict=True):
                _label(file.create_variable(about["long_name"], ("y", "x"), np.float64, data=degrees), **about)
            mapping = file.create_variable(place.CRS, (), np.int32, data=0)
            _label(mapping, **place.grid_mapping(self._frame))
        self._add_field("elevation", ELEVATION, "sea surface: long waves and storm", "m")
        for name, axis, way in zip("uv", "xy", WAYS, strict=True):
            about = f"{way} velocity of the long waves, mean over depth"
            self._add_field(name, f"barotropic_sea_water_{axis}_velocity", about, "m s-1")
        about = "depth of still water; on land at most zero"
        self._add_field("depth", "sea_floor_depth_below_mean_sea_level", about, "m", sea.depth)
        for axis, way, field in zip("xy", WAYS, np.moveaxis(sea.current(), -1, 0), strict=True):
            about = f"{way} current at the surface, without waves"
            constant = field if sea.steady else None
            self._add_field(f"current_{axis}", f"sea_water_{axis}_velocity", about, "m s-1", constant)

    def _add_field(
        self, name: str, standard_name: str, long_name: str, units: str, constant: np.ndarray | None = None
    ) -> None:
        """A variable on the grid: constant, or with an instantaneous field for each time."""
        part = tuple(min(self._file.dimensions[side].size, CHUNK) for side in "yx")
        packed: dict[str, Any] = {"compression": "gzip", "shuffle": True, "compression_opts": 1}
        if constant is None:
            dimensions = ("time", "y", "x")
            variable = self._file.create_variable(name, dimensions, np.float32, chunks=(1, *part), **packed)
            _label(variable, cell_methods="time: point")
        else:
            variable = self._file.create_variable(name, ("y", "x"), np.float32, data=constant, chunks=part, **packed)
        _label(variable, standard_name=standard_name, long_name=long_name, units=units)
        if self._frame:
            _label(variable, grid_mapping=place.CRS, coordinates="longitude latitude")


def _label(target: h5netcdf.File | h5netcdf.Variable, **attributes: str | float) -> None:
    """Set attributes, texts as strings of fixed length; ParaView does not read strings of variable length."""
    for name, value in attributes.items():
        if isinstance(value, str):
            encoded = value.encode("utf-8")
            target.attrs[name] = np.array(encoded, h5py.string_dtype("utf-8", len(encoded)))
        else:
            target.attrs[name] = np.float64(value)
