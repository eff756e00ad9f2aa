"""Record of a run as plain arrays: the only source of metrics, tables, videos and figures.

T mission steps, W worlds (episodes), K AUVs, B boats, M nodes, V vortices, R reward terms. Everything is in SI units,
except data, which is in Mbit and Mbit/s. Index t of a time series is the state after mission step t.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import xarray
from xarray.backends import H5NetCDFStore

from kernels.errors import UserError
from kernels.interruption import deferred
from usvauv_env import text_files
from usvauv_env.files import hdf5_file
from usvauv_env.netcdf import reader
from usvauv_env.scenario import Scenario, ScenarioError

# Dimensions of each array field; also the order of axes in the file.
DIMENSIONS: dict[str, tuple[str, ...]] = {
    "node_position": ("world", "node", "axis"),
    "node_rate": ("world", "node"),
    "time": ("time",),
    "auv_position": ("time", "world", "auv", "axis"),
    "auv_velocity": ("time", "world", "auv", "axis"),
    "fix": ("time", "world", "auv", "axis"),
    "heard_position": ("time", "world", "auv", "axis"),
    "fix_covariance": ("time", "world", "auv", "component"),
    "fix_flags": ("time", "world", "auv"),
    "fix_boat": ("time", "world", "auv"),
    "served_by": ("time", "world", "auv"),
    "estimate": ("time", "world", "auv", "axis"),
    "own_position": ("time", "world", "auv", "axis"),
    "foreseen_position": ("time", "world", "auv", "axis"),
    "estimate_covariance": ("time", "world", "auv", "component"),
    "target": ("time", "world", "auv"),
    "hovering": ("time", "world", "auv"),
    "power": ("time", "world", "auv"),
    "service_rate": ("time", "world", "auv"),
    "delivered": ("time", "world", "auv"),
    "border": ("time", "world", "auv"),
    "reward_terms": ("time", "world", "auv", "reward_term"),
    "boat_position": ("time", "world", "boat", "axis"),
    "boat_goal": ("time", "world", "boat", "axis"),
    "boat_surface": ("time", "world", "boat", "surface_component"),
    "backlog": ("time", "world", "node"),
    "overflowing": ("time", "world"),
    "collisions": ("time", "world"),
    "packets_created": ("time", "world"),
    "packets_lost": ("time", "world"),
    "packets_delivered": ("time", "world", "auv"),
    "vortex": ("time", "world", "vortex", "vortex_parameter"),
    "stream": ("stream_y", "stream_x", "axis"),
    "surface": ("time", "y", "x"),
}
OPTIONAL = {"stream": (0, 0, 2), "surface": (0, 0, 0)}  # fields that may be empty, and their shape then

INTEGERS = (
    *("fix_flags", "fix_boat", "served_by", "target", "hovering", "border", "overflowing", "collisions"),
    *("packets_created", "packets_lost", "packets_delivered"),
)
LARGEST = 1e12  # of any number in a trace


class TraceError(UserError, ValueError):
    """A trace file cannot be read."""


@dataclass(frozen=True)
class Trace:
    """One recorded run of W paired episodes.

    Attributes:
        scenario, policy, usv, seed: what was run; world w of seed s is episode w.
        reward_names: names of the R reward terms.
        node_position: (W, M, 2) m. node_rate: (W, M) arrivals λ, packets/s.
        time: (T,) s, at the end of each step.
        auv_position: (T, W, K, 2) true, m. auv_velocity: (T, W, K, 2) through the water, m/s, 0 while hovering.
        fix: (T, W, K, 2) measured position, m; NaN where nothing was detected. fix_covariance: (T, W, K, 3) predicted
            xx, xy, yy of its error, m². fix_flags: (T, W, K) bits of `kernels.positioning.usbl`; good where it equals
            DETECTED; the receiver drops a detected one that has a bit of UNUSABLE. heard_position: (T, W, K, 2) where
            the AUV was when the signal of its last fix left it, m. fix_boat: (T, W, K) index of the boat that made it.
        served_by: (T, W, K) index of the boat that serves the AUV, see `kernels.mission.serving`.
        estimate: (T, W, K, 2) where the boat takes the AUV to be: the last usable fix, or the tracker's, m.
            estimate_covariance: (T, W, K, 3) likewise. own_position: (T, W, K, 2) where the AUV takes itself to be, m;
            the estimate if it does not reckon. foreseen_position: (T, W, K, 2) where the boat foresees it, m; the
            estimate where its strategy does not.
        target: (T, W, K) index of the node headed for. hovering: (T, W, K) serving its node during this step.
        power: (T, W, K) W. service_rate: (T, W, K) data rate of a service completed in this step, else 0, Mbit/s.
        delivered: (T, W, K) data of that service, Mbit. border: (T, W, K) a move was refused at the border.
        reward_terms: (T, W, K, R) weighted terms; their sum over R is the reward.
        boat_position, boat_goal: (T, W, B, 2) m. boat_surface: (T, W, B, 3) η m and its slopes η_x, η_y.
        backlog: (T, W, M) packets. overflowing: (T, W) nodes that lost packets in this step.
        collisions: (T, W) pairs of AUVs closer than the collision distance.
        packets_created, packets_lost: (T, W) in this step at all nodes and at full buffers. packets_delivered:
            (T, W, K) by a service completed in this step. In every step the backlogs of a world grow by what is created
            less what is lost and delivered, to the packet.
        vortex: (T, W, V, 4) x0 m, y0 m, Γ m²/s, δ m.
        stream: (rows, columns, 2) real current at cruise depth at the start (see `kernels.flow.regular_grid`), m/s;
            empty when there is none.
        surface: (T, Y, X) elevation of world 0's sea over the area, row 0 in the south, m; empty when not recorded.
    """

    scenario: Scenario
    policy: str
    usv: str
    seed: int
    reward_names: tuple[str, ...]
    node_position: np.ndarray
    node_rate: np.ndarray
    time: np.ndarray
    auv_position: np.ndarray
    auv_velocity: np.ndarray
    fix: np.ndarray
    heard_position: np.ndarray
    fix_covariance: np.ndarray
    fix_flags: np.ndarray
    fix_boat: np.ndarray
    served_by: np.ndarray
    estimate: np.ndarray
    estimate_covariance: np.ndarray
    own_position: np.ndarray
    foreseen_position: np.ndarray
    target: np.ndarray
    hovering: np.ndarray
    power: np.ndarray
    service_rate: np.ndarray
    delivered: np.ndarray
    border: np.ndarray
    reward_terms: np.ndarray
    boat_position: np.ndarray
    boat_goal: np.ndarray
    boat_surface: np.ndarray
    backlog: np.ndarray
    overflowing: np.ndarray
    collisions: np.ndarray
    packets_created: np.ndarray
    packets_lost: np.ndarray
    packets_delivered: np.ndarray
    vortex: np.ndarray
    stream: np.ndarray
    surface: np.ndarray

    def save(self, path: str | Path) -> None:
        """Write NetCDF-4; the file appears only when it is complete.

        Raises:
            OutputError: the file cannot be written.
        """
        dataset = xarray.Dataset(
            {name: (dimensions, getattr(self, name)) for name, dimensions in DIMENSIONS.items() if self._has(name)},
            attrs={
                "title": "usvauv trace",
                "scenario": json.dumps(self.scenario.to_dict()),
                "policy": self.policy,
                "usv": self.usv,
                "seed": self.seed,
                "reward_names": ",".join(self.reward_names),
            },
        )
        encoding = {name: {"zlib": True, "complevel": 1} for name in dataset.data_vars if dataset[name].ndim > 1}
        with hdf5_file(Path(path)) as file, deferred(), h5netcdf.File(file, "w") as written:
            dataset.dump_to_store(H5NetCDFStore(written), encoding=encoding)

    @classmethod
    def load(cls, path: str | Path) -> Trace:
        """Read what `save` wrote.

        Raises:
            TraceError: not such a file: a missing field, another type or size, a number that is not finite or beyond
                `LARGEST`.
        """
        try:
            with reader.open_file(path) as dataset:
                attributes = dataset.attrs
                arrays = {name: _read(dataset, name) for name in DIMENSIONS if name in dataset or name not in OPTIONAL}
            for name, shape in OPTIONAL.items():
                arrays.setdefault(name, np.zeros(shape, np.float32))
            texts = {name: _text(attributes, name) for name in ("scenario", "policy", "usv", "reward_names")}
            scenario = Scenario.from_dict(text_files.parse(texts["scenario"], "JSON"), "its scenario")
            names = tuple(texts["reward_names"].split(","))
            _check_sizes(arrays, scenario, names)
            seed = attributes.get("seed")
            if not isinstance(seed, int | np.integer):
                raise TraceError("its attribute seed is not a whole number")
        except reader.NetcdfError as error:
            raise TraceError(str(error)) from None
        except (TraceError, ScenarioError, text_files.TextFileError) as error:
            raise TraceError(f"{path}: not a usvauv trace: {error}") from None
        return cls(
            scenario=scenario,
            policy=texts["policy"],
            usv=texts["usv"],
            seed=int(seed),
            reward_names=names,
            **arrays,
        )

    def _has(self, name: str) -> bool:
        return name not in OPTIONAL or getattr(self, name).size > 0

    def episode(self, world: int) -> Trace:
        """The same trace for one world only (the world axis stays, with length 1)."""
        picked = {}
        for field in fields(self):
            value = getattr(self, field.name)
            axes = DIMENSIONS.get(field.name, ())
            picked[field.name] = value.take([world], axis=axes.index("world")) if "world" in axes else value
        return Trace(**picked)


def _read(dataset: xarray.Dataset, name: str) -> np.ndarray:
    """A field of a trace's file, its values checked one by one."""
    if name not in dataset:
        raise TraceError(f"has no {name}")
    variable = dataset[name]
    if variable.dims != DIMENSIONS[name]:
        raise TraceError(f"{name} has dimensions {variable.dims}; expected {DIMENSIONS[name]}")
    kinds = "iu" if name in INTEGERS else "f"
    if variable.dtype.kind not in kinds:
        raise TraceError(f"{name} is of type {variable.dtype}; expected {'whole' if kinds == 'iu' else 'real'} numbers")
    values = reader.load(variable, name)
    for row in values:  # one by one: the surface is most of a trace
        within = abs(row.astype(np.float64)) <= LARGEST
        if name == "fix":
            within |= np.isnan(row)
        if not within.all():
            raise TraceError(f"{name} holds {row[~within][0]}; expected finite numbers up to {LARGEST:g}")
    if name == "time" and not (np.diff(values) > 0).all():
        raise TraceError("time does not rise")
    return values


def _text(attributes: Mapping[str, Any], name: str) -> str:
    value = attributes.get(name)
    if not isinstance(value, str):
        raise TraceError(f"its attribute {name} is not text")
    return value


def _check_sizes(arrays: Mapping[str, np.ndarray], scenario: Scenario, reward_names: Sequence[str]) -> None:
    """Refuse sizes that are not those of the scenario, and indices beyond them."""
    expected = {
        "axis": 2,
        "component": 3,
        "surface_component": 3,
        "vortex_parameter": 4,
        "auv": scenario.auv.count,
        "boat": scenario.boat.count,
        "node": scenario.targets,
        "vortex": scenario.current.vortices,
        "reward_term": len(reward_names),
    }
    for name, values in arrays.items():
        if name in OPTIONAL and values.size == 0:
            continue
        for dimension, size in zip(DIMENSIONS[name], values.shape, strict=True):
            if size != expected.get(dimension, size) or (size == 0 and dimension in ("time", "world")):
                wanted = expected.get(dimension, "at least 1")
                raise TraceError(f"{name} has {size} along {dimension}; expected {wanted}")
    boats = scenario.boat.count
    for name, count in (("target", scenario.targets), ("fix_boat", boats), ("served_by", boats)):
        index = arrays[name]
        if not ((index >= 0) & (index < count)).all():
            raise TraceError(f"{name} is from {index.min()} to {index.max()}; expected 0 to {count - 1}")
