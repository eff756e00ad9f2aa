"""Kinds of files, recognised by their names, and which command takes each."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from usvauv.kernels.errors import UserError


class Kind(NamedTuple):
    """A kind of file; `found` is what a name says of one, `taken` which command takes one, {} being its name."""

    name: str
    found: str
    taken: str


KINDS = {  # by the option that takes one, where there is one
    "scenario": Kind("a scenario", "a scenario", "usvauv simulate {} runs it"),
    "study": Kind("a study", "a study", "usvauv sweep {} runs it"),
    "trace": Kind("a trace", "a NetCDF file", "usvauv replay {} draws a trace"),
    "policy": Kind("a trained policy", "a trained policy", "usvauv simulate --policy {} runs it"),
    "log": Kind("a log of fixes", "a CSV file", "usvauv plan --log {} reads a log of fixes"),
    "plugin": Kind("a plugin", "a Python file", "--plugin {} loads a plugin"),
    "result": Kind("a result", "a picture, a video or an export", "no command of usvauv reads it"),
}
ENDINGS = {
    ".nc": "trace",
    ".safetensors": "policy",
    ".csv": "log",
    ".py": "plugin",
    **dict.fromkeys((".mp4", ".webm", ".gif", ".webp", ".png", ".pdf", ".svg"), "result"),
    **dict.fromkeys((".json", ".geojson", ".onnx", ".mcap", ".rrd", ".parquet", ".html"), "result"),
}


def kind_of(name: str | Path) -> str:
    """The kind of a file or folder, a key of `KINDS`; empty where it is not there or of no known kind."""
    path = Path(name)
    if os.path.isdir(path):
        return "policy" if any(next(path.glob(f"{place}*.safetensors"), None) for place in ("", "seed-*/")) else ""
    if not os.path.isfile(path):
        return ""
    ending = path.suffix.lower()
    return _of_toml(path) if ending == ".toml" else ENDINGS.get(ending, "")


def _of_toml(path: Path) -> str:
    from usvauv.env import Scenario
    from usvauv.env.scenario.fields import BASE
    from usvauv.env.storage.files import TextFileError, read_text

    try:
        names = read_text(path, "TOML").keys()
    except (OSError, TextFileError):
        return ""
    return "study" if "runs" in names else "scenario" if names <= {BASE, *Scenario.model_fields} else ""


def expect(kind: str, name: str | Path) -> None:
    """Refuse a file of another kind, naming the command that takes it.

    Raises:
        UserError: the name says that it is of another kind.
    """
    found = kind_of(name)
    if found not in ("", kind):
        raise UserError(f"{name}: is {KINDS[found].found}, not {KINDS[kind].name}; {KINDS[found].taken.format(name)}")
