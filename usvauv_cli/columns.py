"""Columns of tables in the terminal and on pages: figures of merit, their names and units, and which way is better."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple


class Column(NamedTuple):
    """A figure of merit: name of its column in the CSV, heading, what it is, and "more", "less" or "" for better."""

    name: str
    heading: str
    about: str
    better: str = ""


WORK = (
    Column("arps", "ARPS", "reward per step, summed over the AUVs", "more"),
    Column("energy_wh", "energy, Wh", "energy of all AUVs", "less"),
    Column("ec", "EC, W", "mean power of an AUV without its time of hovering", "less"),
    Column("collisions", "collisions", "steps of two AUVs closer than the collision distance", "less"),
    Column("border", "refused moves", "moves refused at the border of the area", "less"),
)
OF_STATIONS = (Column("target_distance", "off station, m", "mean distance of the AUVs to their targets", "less"),)
OF_NODES = (
    Column("delivered_mbit", "data, Mbit", "data collected from the nodes", "more"),
    Column("services", "services", "completed services of nodes", "more"),
    Column("sdr", "SDR, Mbit/s", "sum over the services of their data rates", "more"),
)
OF_TASK = {
    column.name: column
    for column in (
        Column("lost_mbit", "lost, Mbit", "data that full buffers lost", "less"),
        Column("aoi_mean", "age, s", "age of the data, mean over nodes and time", "less"),
        Column("aoi_peak", "peak age, s", "age just before a service, mean over services", "less"),
        Column("aoi_largest", "largest age, s", "largest age of any node at any time", "less"),
        Column("jain", "Jain's index", "how even data come in from the nodes: 1 if all bring the same", "more"),
        Column("joule_per_mbit", "J/Mbit", "energy over data collected", "less"),
    )
}
POSITIONS = (
    Column("position_error_median", "median, m", "error of the boat's estimates of the AUVs' positions", "less"),
    Column("position_error_rms", "rms, m", "the same, root mean square", "less"),
    Column("position_error_p95", "95 %, m", "the same, 95th percentile", "less"),
    Column("own_error_rms", "own rms, m", "error of where an AUV takes itself to be", "less"),
    Column("fix_error_rms", "fix rms, m", "error of a fix, against where its signal left the AUV", "less"),
    Column("fix_availability", "fixes", "share of steps and AUVs with a usable fix", "more"),
    Column("fix_wrapped", "wrapped", "share of usable fixes that are wrong by whole turns of a phase", "less"),
    Column("fix_dropped", "dropped", "share of detected fixes that the receiver does not use", "less"),
    Column("outage_longest", "outage, s", "longest time of an AUV without a usable fix", "less"),
)
HEADINGS = {column.name: column.heading for column in (*WORK, *OF_STATIONS, *OF_NODES, *OF_TASK.values(), *POSITIONS)}


def tables(nodes: bool, of_task: Collection[str]) -> dict[str, list[Column]]:
    """Columns of each table by its title.

    Args:
        nodes: whether the task's targets are nodes with data.
        of_task: names of the task's own figures.
    """
    own = [OF_TASK.get(name, Column(name, name, "a figure of a plugin")) for name in of_task]
    return {
        "Work": [*WORK[:1], *(OF_NODES if nodes else OF_STATIONS), *WORK[1:]],
        "Age, losses and cost of data" if nodes else "Of the task": own,
        "Positions and fixes": list(POSITIONS),
    }
