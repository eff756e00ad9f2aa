"""Record of a run as plain arrays: the only source of metrics, tables, videos and figures.

T mission steps, W worlds (episodes), K AUVs, B boats, M nodes, V vortices, R reward terms. Everything is in SI units,
except data, which is in Mbit and Mbit/s. Index t of a time series is the state after mission step t.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from usvauv.env.record.headings import directions, headings
from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.site import place
from usvauv.env.site.cf import parse_time
from usvauv.env.site.ocean import at_time
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.site import Site
from usvauv.env.storage import netcdf
from usvauv.env.storage.files import TextFileError, hdf5_file, parse_text
from usvauv.env.storage.memory import RowsOnDisk, require, words
from usvauv.env.storage.netcdf import OceanError
from usvauv.kernels.errors import UserError
from usvauv.kernels.interruption import deferred

if TYPE_CHECKING:  # most runs neither read nor write NetCDF
    import h5netcdf


class Variable(NamedTuple):
    """An array of a trace: its dimensions, its unit (None if its parts have different ones), its description."""

    dimensions: tuple[str, ...]
    units: str | None
    long_name: str


class Stored(NamedTuple):
    """An array of a trace's file: its dimensions, values and attributes."""

    dimensions: tuple[str, ...]
    values: np.ndarray
    attributes: Mapping[str, str]


_AUV, _BOAT, _WORLD = ("time", "world", "auv"), ("time", "world", "boat"), ("time", "world")
_NODE = ("time", "world", "node")
_AUV_XY, _BOAT_XY, _COVARIANCE = (*_AUV, "axis"), (*_BOAT, "axis"), (*_AUV, "component")

OPTIONAL = (  # may be empty
    *("auv_depth", "auv_attitude", "auv_fins", "auv_touched", "auv_charge", "boat_power"),
    *("node_way", "node_estimate", "node_covariance", "node_range", "boat_range"),
    *("stream_time", "stream", "surface", "storm"),
)
DERIVED = "boat_heading"  # missing in files of earlier versions
PLACED = ("node", "auv", "boat")  # whose `…_position` is also in longitude and latitude if the area has a place

PARTS = {  # names along the dimensions of fixed length
    "axis": ("x", "y"),
    "component": ("xx", "xy", "yy"),
    "angle": ("heading", "pitch", "roll"),
    "actuator": ("rudder", "stern", "propeller"),
    "surface_component": ("elevation", "slope_x", "slope_y"),
    "vortex_parameter": ("x", "y", "circulation", "radius"),
    "wave_parameter": ("a", "kx", "ky", "omega", "phase"),
}
INTEGERS = (
    *("fix_flags", "fix_boat", "served_by", "target", "hovering", "border", "overflowing", "collisions"),
    *("packets_created", "packets_lost", "packets_delivered", "auv_touched"),
)
LARGEST = 1e12  # of any number in a trace
DENSEST = 1032  # bytes that one of a file compressed by DEFLATE can stand for
TOGETHER = 64  # steps of the surface that are read together


def _empty(dimensions: tuple[str, ...]) -> np.ndarray:
    """An empty array of `OPTIONAL`: dimensions in `PARTS` keep their length, all others are 0."""
    return np.zeros([len(PARTS.get(dimension, ())) for dimension in dimensions], np.float32)


def _array(dimensions: tuple[str, ...], units: str | None, long_name: str, optional: bool = False) -> Any:
    """A field that is a variable of a trace's file; an `optional` one is empty by default."""
    about = {"variable": Variable(dimensions, units, long_name)}
    return field(default_factory=partial(_empty, dimensions), metadata=about) if optional else field(metadata=about)


class TraceError(UserError, ValueError):
    """A trace file cannot be read."""


@dataclass(frozen=True, repr=False)
class Trace:
    """One recorded run of W paired episodes.

    Attributes:
        scenario, policy, usv, seed: the run; world w of seed s is episode w.
        reward_names: names of the R reward terms.
        start: date and time at which the mission begins, ISO 8601, UTC; "" if the scenario has none.
        all others: arrays, see `VARIABLES`; those in `OPTIONAL` may be empty. In every step a world's backlogs
            grow by the packets created minus those lost and delivered, exactly.
    """

    scenario: Scenario
    policy: str
    usv: str
    seed: int
    reward_names: tuple[str, ...]
    start: str
    node_position: np.ndarray = _array(("world", "node", "axis"), "m", "position of the nodes")
    node_rate: np.ndarray = _array(("world", "node"), "s-1", "arrival rate λ of a node's packets")
    time: np.ndarray = _array(("time",), "s", "time since the start of the mission, at the end of each step")
    auv_position: np.ndarray = _array(_AUV_XY, "m", "true position")
    auv_velocity: np.ndarray = _array(_AUV_XY, "m s-1", "velocity through the water, 0 while hovering")
    fix: np.ndarray = _array(_AUV_XY, "m", "measured position; NaN if nothing was detected")
    heard_position: np.ndarray = _array(_AUV_XY, "m", "position of the AUV when the signal of its last fix left it")
    fix_covariance: np.ndarray = _array(_COVARIANCE, "m2", "predicted covariance of the error of a fix")
    fix_flags: np.ndarray = _array(_AUV, "1", "bits of kernels.positioning.usbl; good if only DETECTED is set")
    fix_boat: np.ndarray = _array(_AUV, "1", "index of the boat that made the fix")
    served_by: np.ndarray = _array(_AUV, "1", "index of the boat that serves the AUV")
    estimate: np.ndarray = _array(
        _AUV_XY, "m", "boat's estimate of the AUV's position: its last usable fix, or a filter's"
    )
    own_position: np.ndarray = _array(
        _AUV_XY, "m", "AUV's estimate of its own position; without one the boat's estimate"
    )
    foreseen_position: np.ndarray = _array(
        _AUV_XY, "m", "AUV's position predicted by the boat; the estimate if its strategy predicts none"
    )
    estimate_covariance: np.ndarray = _array(_COVARIANCE, "m2", "covariance of the boat's estimate")
    target: np.ndarray = _array(_AUV, "1", "index of the node or station headed for")
    hovering: np.ndarray = _array(_AUV, "1", "1 while the AUV serves its node")
    power: np.ndarray = _array(_AUV, "W", "power of the AUV in this step")
    service_rate: np.ndarray = _array(_AUV, "Mbit s-1", "data rate of a service completed in this step, else 0")
    delivered: np.ndarray = _array(
        _AUV, "Mbit", "data collected in this step; of a hovering AUV those of a whole service, in its last step"
    )
    border: np.ndarray = _array(_AUV, "1", "1 where a move was refused at the border")
    reward_terms: np.ndarray = _array((*_AUV, "reward_term"), "1", "weighted terms of the reward, which is their sum")
    boat_position: np.ndarray = _array(_BOAT_XY, "m", "position of the boat")
    boat_heading: np.ndarray = _array(
        _BOAT, "rad", "direction of its bow, anticlockwise from east, not reduced to one turn"
    )
    boat_goal: np.ndarray = _array(_BOAT_XY, "m", "goal of the boat")
    boat_surface: np.ndarray = _array(
        (*_BOAT, "surface_component"), None, "elevation under the boat, m, and its two slopes"
    )
    backlog: np.ndarray = _array(("time", "world", "node"), "1", "packets in the node's buffer")
    overflowing: np.ndarray = _array(_WORLD, "1", "nodes that lost packets in this step")
    collisions: np.ndarray = _array(_WORLD, "1", "pairs of AUVs closer than the collision distance")
    packets_created: np.ndarray = _array(_WORLD, "1", "packets created in this step at all nodes")
    packets_lost: np.ndarray = _array(_WORLD, "1", "packets lost in this step at full buffers")
    packets_delivered: np.ndarray = _array(_AUV, "1", "packets collected in this step, those of `delivered`")
    vortex: np.ndarray = _array(
        ("time", "world", "vortex", "vortex_parameter"), None, "centre x0 and y0, m, circulation Γ, m2 s-1, radius δ, m"
    )
    stream_time: np.ndarray = _array(("stream_time",), "s", "time since the start of the mission, of the real current")
    stream: np.ndarray = _array(
        ("stream_time", "stream_y", "stream_x", "axis"),
        "m s-1",
        "uniform and real current at cruise depth on a grid over the area; linear in time",
    )
    surface: np.ndarray = _array(
        ("time", "y", "x"), "m", "elevation of world 0's sea over the area, row 0 in the south"
    )
    storm: np.ndarray = _array(
        ("wave", "wave_parameter"),
        None,
        "short waves of that sea: a, m, kx and ky, rad m-1, ω, rad s-1, φ: Σ a cos(kx x + ky y − ω t + φ)",
    )
    auv_depth: np.ndarray = _array(_AUV, "m", "depth of a vehicle with dynamics below the mean surface", optional=True)
    auv_attitude: np.ndarray = _array(
        (*_AUV, "angle"),
        "rad",
        "its heading, anticlockwise from east, pitch, nose up, and roll, starboard down",
        optional=True,
    )
    auv_fins: np.ndarray = _array(
        (*_AUV, "actuator"),
        None,
        "its rudder, rad, to starboard, stern plane, rad, diving, and propeller, s-1",
        optional=True,
    )
    auv_touched: np.ndarray = _array(
        _AUV, "1", "1 where it came to the surface in this step, 2 where it touched the bed, 3 both", optional=True
    )
    auv_charge: np.ndarray = _array(
        _AUV, "W h", "energy left in a battery that ends; at 0 the AUV moves by itself no more", optional=True
    )
    boat_power: np.ndarray = _array(_BOAT, "W", "power of the boat in this step, where it is counted", optional=True)
    node_way: np.ndarray = _array((*_NODE, "axis"), "m", "position of nodes that move", optional=True)
    node_estimate: np.ndarray = _array(
        (*_NODE, "axis"), "m", "the AUVs' estimate of it; where they are while they know nothing", optional=True
    )
    node_covariance: np.ndarray = _array(
        (*_NODE, "component"), "m2", "covariance of that; 0 while they know nothing", optional=True
    )
    node_range: np.ndarray = _array(
        (*_AUV, "node"), "m", "slant range to it that an AUV measured in this step, else 0", optional=True
    )
    boat_range: np.ndarray = _array(
        (*_BOAT, "node"), "m", "slant range to it that a boat measured in this step, else 0", optional=True
    )

    def __repr__(self) -> str:
        """Number of missions and steps, seed, policy and boat strategy, and the scenario."""
        steps, worlds = self.collisions.shape
        lines = [
            f"Trace of {worlds} mission{'s' * (worlds > 1)} of {steps} steps, seed {self.seed}",
            f"policy {self.policy}, boat {self.usv}",
            *repr(self.scenario).splitlines(),
        ]
        return "\n  ".join(lines)

    def save(self, path: str | Path) -> None:
        """Write NetCDF-4; the file appears only when it is complete.

        Raises:
            OutputError: the file cannot be written.
        """
        import h5netcdf

        with hdf5_file(Path(path)) as file, deferred(), h5netcdf.File(file, "w") as written:
            about: dict[str, Any] = {"Conventions": "CF-1.11", "title": "usvauv trace"}
            about |= {"scenario": json.dumps(self.scenario.to_dict()), "policy": self.policy, "usv": self.usv}
            about |= {"seed": np.int64(self.seed), "reward_names": ",".join(self.reward_names)}
            written.attrs.update(about)
            self._write(written, Site(self.scenario).frame)

    @classmethod
    def load(cls, path: str | Path) -> Trace:
        """Read a file that `save` wrote.

        Raises:
            TraceError: not such a file: a missing field, another type or size, a number that is not finite or beyond
                `LARGEST`.
        """
        try:
            with netcdf.open_plain(path) as file:
                about = _about(dict(file.attrs))
                scenario = about["scenario"]
                stored = [name for name in VARIABLES if name in file.variables or name not in (*OPTIONAL, DERIVED)]
                variables = {name: _variable(file, name) for name in stored}
                _check_sizes({name: each.shape for name, each in variables.items()}, scenario, about["reward_names"])
                _check_room(variables, Path(path))
                arrays = {name: _read(each, name, path) for name, each in variables.items()}
                units = str(file.variables["time"].attrs.get("units", ""))
            _check_indices(arrays, scenario)
            start = units.partition(" since ")[2].replace(" ", "T")  # as given to `place.time_attributes`
            if start:
                parse_time(start)
            for name in OPTIONAL:
                arrays.setdefault(name, _empty(VARIABLES[name].dimensions))
            if DERIVED not in arrays:
                way = np.diff(arrays["boat_position"], axis=0, prepend=arrays["boat_position"][:1])
                arrays[DERIVED] = headings(way / scenario.mission.step, scenario.mission.step)
        except netcdf.NetcdfError as error:
            raise TraceError(str(error)) from None
        except (TraceError, ScenarioError, OceanError) as error:
            raise TraceError(f"{path}: not a usvauv trace: {error.args[0]}") from None
        about |= arrays
        return cls(**about, start=start)

    def _has(self, name: str) -> bool:
        return name not in OPTIONAL or getattr(self, name).size > 0

    def _attributes(self, name: str, placed: bool) -> dict[str, str]:
        """Attributes of a variable of the file; `placed`: with a grid mapping."""
        about = VARIABLES[name]
        attributes = {"long_name": about.long_name} | ({"units": about.units} if about.units else {})
        if name in ("time", "stream_time"):
            attributes |= place.time_attributes(self.start, "") | {"long_name": about.long_name}
        if name == "surface":
            attributes["standard_name"] = "sea_surface_height_above_mean_sea_level"
            if placed:
                attributes["grid_mapping"] = place.CRS
        return attributes

    def _coordinates(self, frame: LocalFrame | None) -> dict[str, Stored]:
        """Coordinates of the grids, and longitudes and latitudes of grids and positions if the area has a place."""
        area = self.scenario.area
        coordinates: dict[str, Stored] = {}

        def add(prefix: str, dimensions: tuple[str, ...], x: np.ndarray, y: np.ndarray) -> None:
            if frame:
                degrees = zip((place.LONGITUDE, place.LATITUDE), frame.to_geographic(x, y), strict=True)
                for about, at in degrees:
                    coordinates[f"{prefix}{about['long_name']}"] = Stored(dimensions, at, about)

        if self._has("surface"):
            x, y = area.middles(*self.surface.shape[:0:-1])
            coordinates |= {"x": Stored(("x",), x, place.X_AXIS), "y": Stored(("y",), y, place.Y_AXIS)}
            add("", ("y", "x"), *np.meshgrid(x, y))
        if self._has("stream"):  # a grid mapping has one pair of coordinates, which are those of the surface
            rows, columns = self.stream.shape[1:3]
            x, y = np.linspace(0, area.width, columns), np.linspace(0, area.length, rows)
            for name, values, about in (("stream_x", x, place.X_AXIS), ("stream_y", y, place.Y_AXIS)):
                coordinates[name] = Stored((name,), values, {key: about[key] for key in ("long_name", "units")})
            add("stream_", ("stream_y", "stream_x"), *np.meshgrid(x, y))
        for name in PLACED:
            position = f"{name}_position"
            x, y = np.moveaxis(getattr(self, position).astype(np.float64), -1, 0)
            add(f"{name}_", VARIABLES[position].dimensions[:-1], x, y)
        return coordinates

    def _write(self, file: h5netcdf.File, frame: LocalFrame | None) -> None:
        """Dimensions, variables, and coordinates with the variables that have them."""
        coordinates = self._coordinates(frame)
        stored = {
            name: Stored(about.dimensions, getattr(self, name), self._attributes(name, frame is not None))
            for name, about in VARIABLES.items()
            if self._has(name)
        }
        every = (*stored.values(), *coordinates.values())
        file.dimensions = {d: n for axes, values, _ in every for d, n in zip(axes, values.shape, strict=True)}
        places = {name: set(about.dimensions) for name, about in coordinates.items() if about.dimensions != (name,)}
        for name, (dimensions, values, attributes) in (stored | coordinates).items():
            packed = {"compression": "gzip", "compression_opts": 1} if values.ndim > 1 else {}
            if name == "surface":
                packed["chunks"] = (1, *values.shape[1:])
            fill = np.float32(np.nan) if name == "fix" else None
            variable = file.create_variable(name, dimensions, values.dtype, fillvalue=fill, **packed)
            for key, value in attributes.items():
                variable.attrs[key] = value
            own = [place for place, axes in places.items() if name not in coordinates and axes <= set(dimensions)]
            if own:
                variable.attrs["coordinates"] = " ".join(own)
            if name == "surface":
                for t, row in enumerate(values):
                    variable[t] = row
            else:
                variable[...] = values
        if frame and self._has("surface"):
            mapping = file.create_variable(place.CRS, (), np.int32, data=0)
            for key, value in place.grid_mapping(frame).items():
                mapping.attrs[key] = value

    @property
    def depth(self) -> np.ndarray:
        """Depth of the AUVs below the mean surface, (T, W, K), m; for points the cruise depth."""
        return self.auv_depth if self.auv_depth.size else np.full(self.power.shape, self.scenario.auv.depth)

    @property
    def attitude(self) -> np.ndarray:
        """Heading (anticlockwise from east, continuous), pitch and roll of the AUVs, (T, W, K, 3), rad.

        A point is level, and its heading is the direction of its velocity through the water.
        """
        if not self.auv_attitude.size:
            heading = directions(self.auv_velocity)[..., None]
            return np.concatenate([heading, np.zeros((*self.power.shape, 2))], axis=-1)
        heading, rest = np.split(self.auv_attitude, [1], axis=-1)
        return np.concatenate([np.unwrap(heading, axis=0), rest], axis=-1)

    @property
    def node_places(self) -> np.ndarray:
        """Positions of the nodes at each step, (T, W, M, 2), m."""
        if self.node_way.size:
            return self.node_way
        return np.broadcast_to(self.node_position, (len(self.time), *self.node_position.shape))

    def stream_at(self, t: float) -> np.ndarray:
        """Real current at cruise depth at a time (s), (rows, columns, 2), m/s; empty without one."""
        return at_time(self.stream_time, self.stream, t) if len(self.stream) else self.stream.reshape(0, 0, 2)

    def episode(self, world: int) -> Trace:
        """This trace of one world only (the world axis is kept, with length 1)."""
        picked = {
            name: getattr(self, name).take([world], axis=about.dimensions.index("world"))
            for name, about in VARIABLES.items()
            if "world" in about.dimensions and self._has(name)
        }
        return replace(self, **picked)


# Every array field, in the order of the file. Units are spelled as in UDUNITS, except Mbit.
VARIABLES: dict[str, Variable] = {
    each.name: each.metadata["variable"] for each in fields(Trace) if "variable" in each.metadata
}


def _about(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a trace that are no arrays, from the attributes of its file."""
    about: dict[str, Any] = {name: attributes.get(name) for name in ("scenario", "policy", "usv", "reward_names")}
    for name, text in about.items():
        if not isinstance(text, str):
            raise TraceError(f"its attribute {name} is not text")
    seed = attributes.get("seed")
    if not isinstance(seed, int | np.integer):
        raise TraceError("its attribute seed is not a whole number")
    try:
        scenario = Scenario.from_dict(parse_text(about["scenario"], "JSON"), "its scenario", stored=True)
    except TextFileError as error:
        raise TraceError(str(error)) from None
    return about | {"scenario": scenario, "reward_names": tuple(about["reward_names"].split(",")), "seed": int(seed)}


def _variable(file: h5netcdf.File, name: str) -> h5netcdf.Variable:
    """A field of a trace's file, of which nothing but its values is unchecked."""
    if name not in file.variables:
        raise TraceError(f"has no {name}")
    variable = file.variables[name]
    expected = VARIABLES[name].dimensions
    if variable.dimensions != expected:
        raise TraceError(f"{name} has dimensions {variable.dimensions}; expected {expected}")
    kinds = "iu" if name in INTEGERS else "f"
    if variable.dtype.kind not in kinds:
        raise TraceError(f"{name} is of type {variable.dtype}; expected {'whole' if kinds == 'iu' else 'real'} numbers")
    return variable


def _check_room(variables: Mapping[str, h5netcdf.Variable], path: Path) -> None:
    """Refuse arrays that the file cannot hold, or that do not fit into memory together; the surface goes to the disk.

    Raises:
        MemoryNeeded: they do not fit.
    """
    sizes = {name: each.dtype.itemsize * math.prod(each.shape) for name, each in variables.items()}
    if (total := sum(sizes.values())) > DENSEST * (there := path.stat().st_size):
        raise TraceError(f"its arrays take {words(total)}, which a file of {words(there)} cannot hold")
    require(total - sizes.get("surface", 0), str(path))


def _read(variable: h5netcdf.Variable, name: str, path: str | Path) -> np.ndarray:
    """The values of a field, checked."""
    if name == "surface":  # most of a trace
        return _surface(variable, f"{path}: {name}")
    values = netcdf.values(variable, f"{path}: {name}")
    _check_numbers(values, name)
    if name in ("time", "stream_time") and not (np.diff(values) > 0).all():
        raise TraceError(f"{name} does not rise")
    return values


def _surface(variable: h5netcdf.Variable, where: str) -> np.ndarray:
    """The surface, read a few steps at a time into a file on the disk."""
    count, *shape = variable.shape
    with RowsOnDisk(count, tuple(shape), where) as rows:
        for first in range(0, count, TOGETHER):
            some = netcdf.values(variable, where, slice(first, first + TOGETHER))
            _check_numbers(some, "surface")
            rows.append(some)
        return rows.array()


def _check_numbers(values: np.ndarray, name: str) -> None:
    for row in values:  # one by one, because each is converted to a wider type
        within = abs(row.astype(np.float64)) <= LARGEST
        if name == "fix":
            within |= np.isnan(row)
        if not within.all():
            raise TraceError(f"{name} holds {row[~within][0]}; expected finite numbers up to {LARGEST:g}")


def _check_sizes(shapes: Mapping[str, tuple[int, ...]], scenario: Scenario, reward_names: Sequence[str]) -> None:
    """Refuse sizes that differ from the scenario's or from one another."""
    expected = {name: len(parts) for name, parts in PARTS.items()} | {
        "auv": scenario.auv.count,
        "boat": scenario.boat.count,
        "node": scenario.targets,
        "vortex": scenario.current.vortices,
        "reward_term": len(reward_names),
    }
    for name, shape in shapes.items():
        if name in OPTIONAL and 0 in shape:
            continue
        for dimension, size in zip(VARIABLES[name].dimensions, shape, strict=True):
            wanted = expected.setdefault(dimension, size)
            if size != wanted or (size == 0 and dimension in ("time", "world")):
                raise TraceError(f"{name} has {size} along {dimension}; expected {wanted or 'at least 1'}")
    if shapes.get("stream", (0,))[0] != shapes.get("stream_time", (0,))[0]:
        raise TraceError("stream and stream_time differ in length")


def _check_indices(arrays: Mapping[str, np.ndarray], scenario: Scenario) -> None:
    """Refuse indices beyond the scenario's numbers of things."""
    boats = scenario.boat.count
    for name, count in (("target", scenario.targets), ("fix_boat", boats), ("served_by", boats)):
        index = arrays[name]
        if not ((index >= 0) & (index < count)).all():
            raise TraceError(f"{name} is from {index.min()} to {index.max()}; expected 0 to {count - 1}")
