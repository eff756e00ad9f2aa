"""What a scenario is made of before it is validated: shipped and other files, overrides, fields of earlier versions."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from usvauv.env.storage import text_files
from usvauv.kernels.errors import UserError, choices

# Fields that are gone, and values that earlier versions printed into every file: a file is read with those, which now
# change nothing, and a stored scenario with any.
RETIRED: dict[str, tuple[object, ...]] = {
    "planner.horizon": (10,),
    "auv.refused_power": ("travelling", "hovering"),
    "usbl.refraction": ("corrected",),
    "sea.start_rms": (0.0,),
    "sea.start_modes": (4,),
}
GONE = ("planner.objective", "e")  # a value of a field that is still there


class ScenarioError(UserError, ValueError):
    """A scenario cannot be used; the message is one line naming the file, the field, its value and what is allowed."""


def shipped() -> list[str]:
    """Names of the scenarios inside the package."""
    folder = resources.files("usvauv.env") / "scenarios"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def read(name_or_path: str | Path) -> tuple[dict[str, Any], str]:
    """Content of a scenario's file and how to call it in messages."""
    name = str(name_or_path)
    if name in shipped():
        text = (resources.files("usvauv.env") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8")
        return text_files.parse(text, "TOML"), name
    try:
        return text_files.read(name_or_path, "TOML"), name
    except FileNotFoundError:
        known = choices(name, shipped(), ", or the path of a TOML file")
        raise ScenarioError(f"scenario {name!r}: {known}") from None
    except text_files.TextFileError as error:
        raise ScenarioError(f"{name}: {error}") from None


def override_field(data: dict[str, Any], override: str) -> None:
    """Set one `section.field=value` in nested data; the value is TOML, or a bare word taken as text."""
    key, separator, text = override.partition("=")
    parts = key.strip().split(".")
    if not separator or not all(parts):
        raise ScenarioError(f"--set {override!r}: expected section.field=value, for example auv.count=3")
    if len(parts) > text_files.DEEPEST:
        raise ScenarioError(f"--set {override!r}: nested too deep")
    try:
        value = text_files.parse(f"value = {text}", "TOML")["value"]
    except text_files.TextFileError:
        value = text.strip()
    place = data
    for part in parts[:-1]:
        place = place.setdefault(part, {})
        if not isinstance(place, dict):
            raise ScenarioError(f"--set {override!r}: {part} is not a section")
    place[parts[-1]] = value


def without_retired(data: Mapping[str, Any], source: str, stored: bool) -> Mapping[str, Any]:
    """Data without what `RETIRED` and `GONE` list.

    Raises:
        ScenarioError: a field has a value with which only a stored scenario is read.
    """
    for name in (*RETIRED, GONE[0]):
        section, _, field = name.partition(".")
        content = data.get(section) if isinstance(data, Mapping) else None
        if not isinstance(content, Mapping) or field not in content:
            continue
        value = content[field]
        if name == GONE[0] and value != GONE[1]:
            continue
        if not stored and value not in RETIRED.get(name, ()):
            raise ScenarioError(f"{source}: {name} = {value!r}: no longer there")
        data = {**data, section: {other: inner for other, inner in content.items() if other != field}}
    return data


def as_toml(value: Any) -> str:
    """A value of a field."""
    if isinstance(value, tuple):
        return "[" + ", ".join(as_toml(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False)
