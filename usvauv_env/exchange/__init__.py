"""Export of a recorded run for other tools: tables (CSV, Parquet), ROS 2 messages (MCAP), a Rerun recording, GeoJSON.

`export_trace` writes all but the last; `trace_tables` has the columns of the tables, `geojson` the features of a map.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from usvauv.env.record.trace import Trace
from usvauv.kernels.errors import UserError

FOLDERS = ("csv", "parquet")  # formats with a file for each table
WRITERS = {
    "csv": "trace_tables",
    "parquet": "trace_tables",
    "mcap": "ros2",
    "rrd": "rerun_recording",
}  # modules by format
NEEDED = {"parquet": ("export", "pyarrow"), "mcap": ("export", "rosbags", "mcap"), "rrd": ("rerun", "rerun")}


def export_trace(trace: Trace, form: str, path: Path, world: int = 0) -> None:
    """Write a trace in a format of `WRITERS`.

    Args:
        path: the file, of `FOLDERS` an existing folder.
        world: the episode to write; tables have all.

    Raises:
        UserError: a library is missing.
        OutputError: a file cannot be written.
    """
    extra, *libraries = NEEDED.get(form, ("",))
    for library in libraries:
        try:
            import_module(library)
        except ModuleNotFoundError as error:
            raise UserError(
                f'--to {form}: needs the extra {extra} ({error.name} is missing): pip install "usvauv[{extra}]"'
            ) from None
    writer = import_module(f"usvauv.env.exchange.{WRITERS[form]}")
    if form in FOLDERS:
        writer.write(trace, path, form)
    else:
        writer.write(trace.episode(world), path)
