"""A trace as tables: a row for each time, world and object, for each fix and for each completed service."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from usvauv.env.record.metrics import served
from usvauv.env.record.trace import PARTS, VARIABLES, Trace
from usvauv.env.storage.files import atomic_write

Table = dict[str, np.ndarray]

INDICES = ("fix_boat", "served_by", "target")  # of boats and nodes
# A variable that has a value, or several, in each row.
NUMBERED = ("auv", "boat", "node")  # from 1, as in videos
ROWS = {"auvs": "power", "boats": "boat_heading", "nodes": "backlog", "vortices": "vortex", "worlds": "collisions"}


def tables(trace: Trace) -> dict[str, Table]:
    """Columns (N,) of the tables of `ROWS`, of "fixes" and of "services"; all worlds of the trace.

    A column is named after its variable of `usvauv.env.record.trace.VARIABLES`, with the part of it behind: "fix_x".
    AUVs, boats and nodes are numbered from 1, worlds from 0. What does not change with time is repeated. "fixes" has a
    row for each detected reply, "services" one for each completed service, "ranges" and "boat_ranges" one for each
    range to a target that moves.
    """
    found = {name: _table(trace, variable) for name, variable in ROWS.items()}
    ranges = {"ranges": _ranges(trace, "auv", "node_range")} if trace.node_range.size else {}
    if trace.boat_range.any():
        ranges["boat_ranges"] = _ranges(trace, "boat", "boat_range")
    return found | {"fixes": _fixes(trace), "services": _services(trace)} | ranges


def write(trace: Trace, folder: Path, form: str) -> None:
    """Write each table as a file NAME.csv or NAME.parquet; missing values, such as a fix not made, are empty.

    Raises:
        OutputError: a file cannot be written.
    """
    import pandas as pd

    for name, table in tables(trace).items():
        frame = pd.DataFrame(table)
        with atomic_write(folder / f"{name}.{form}") as partial:
            if form == "csv":
                frame.to_csv(partial, index=False)
            else:
                frame.to_parquet(partial, engine="pyarrow", index=False)


def _table(trace: Trace, variable: str) -> Table:
    """Every variable whose last dimension, parts apart, is the last one of the index, which is that of a variable."""
    index, shape = VARIABLES[variable].dimensions[:3], getattr(trace, variable).shape[:3]
    places = np.indices(shape).reshape(len(shape), -1)
    table = {"time": trace.time[places[0]]} | {
        name: places[i] + (name in NUMBERED) for i, name in enumerate(index) if i
    }
    parts = {**PARTS, "reward_term": trace.reward_names}
    for name, about in VARIABLES.items():
        *own, last = about.dimensions
        values = getattr(trace, name)
        if last in parts:
            columns = {f"{name}_{part}": values[..., i] for i, part in enumerate(parts[last])}
        else:
            own, columns = [*own, last], {name: values}
        if name in INDICES:
            columns = {name: values + 1}
        if values.size and len(own) <= len(index) and own != ["time"] and own[-1] == index[-1]:
            missing = (None,) * (len(index) - len(own))
            table |= {column: np.broadcast_to(part[missing], shape).ravel() for column, part in columns.items()}
    return table


def _fixes(trace: Trace) -> Table:
    """Output of the boats' USBL, ordered by time."""
    step, world, auv = np.nonzero(np.isfinite(trace.fix).all(-1))
    (x, y), (xx, xy, yy) = trace.fix[step, world, auv].T, trace.fix_covariance[step, world, auv].T
    covariance = {"covariance_xx": xx, "covariance_xy": xy, "covariance_yy": yy}
    depth = trace.depth[step, world, auv]
    boat, flags = trace.fix_boat[step, world, auv] + 1, trace.fix_flags[step, world, auv]
    return _rows(trace, step, world, auv) | {"x": x, "y": y, "depth": depth, **covariance, "boat": boat, "flags": flags}


def _services(trace: Trace) -> Table:
    """The completed services in the order of time."""
    step, world, auv, node = served(trace)
    amounts = ("service_rate", "delivered", "packets_delivered")
    values = {name: getattr(trace, name)[step, world, auv] for name in amounts}
    return _rows(trace, step, world, auv) | {"node": node + 1} | values


def _ranges(trace: Trace, observer: str, variable: str) -> Table:
    """Slant ranges that AUVs or boats measured, ordered by time."""
    values = getattr(trace, variable)
    step, world, each, node = np.nonzero(values)
    measured = {"node": node + 1, variable: values[step, world, each, node]}
    return {"time": trace.time[step], "world": world, observer: each + 1} | measured


def _rows(trace: Trace, step: np.ndarray, world: np.ndarray, auv: np.ndarray) -> Table:
    return {"time": trace.time[step], "world": world, "auv": auv + 1}
