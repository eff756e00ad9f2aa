"""Pages made from the program while the site is built: options of the commands, fields of a scenario and of a trace."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.cli import get_docs_for_click

from usvauv.cli.app import parser
from usvauv.env import Scenario
from usvauv.env.record.trace import VARIABLES

if TYPE_CHECKING:
    from sphinx.application import Sphinx

# In a description the unit stands after a comma, at the end or before further remarks.
UNIT = re.compile(
    r", (m|s|m/s|m/s²|m²/s|mm/h|rad|Hz|1/s|1/m|1/W|1/Mbit|dB|dB re 1 µPa at 1 m|dB re 1 µPa²/Hz|°C|W|Mbit|packets/s"
    r"|bit/s|whole packets|carrier periods|degrees east|degrees north|s/m\^\(1/3\))(?=$|[;:,]| \()"
)
COLUMNS = re.compile(r"\[\[(.*?)\]")  # of a list of points


def command_line() -> str:
    """Usage, arguments and options of each command."""
    group: Any = typer.main.get_command(parser())
    context = typer.Context(group)
    commands = (
        get_docs_for_click(obj=command, ctx=context, indent=1, call_prefix="usvauv")
        for command in group.commands.values()
    )
    return "\n".join(["# Command line", "", group.help, "", *commands])


def unit(field: dict[str, Any]) -> str:
    """Unit of a field of the schema, by its description; nothing for what is no quantity."""
    found = UNIT.search(field["description"])
    if found is None and field.get("type") == "array":
        found = COLUMNS.search(field["description"])
    return found[1] if found else ""


def kind(field: dict[str, Any]) -> tuple[str, str]:
    """Type of a field of the schema, and what is allowed."""
    if choices := field.get("anyOf", field.get("oneOf")):
        kinds, bounds = zip(*map(kind, choices), strict=True)
        return " or ".join(kinds), " or ".join(filter(None, bounds))
    if "const" in field or "enum" in field:
        return "text", ", ".join(f"`{name}`" for name in field.get("enum", [field.get("const")]))
    if field["type"] == "array":
        inner, bounds = kind(field["items"] if "items" in field else field["prefixItems"][0])
        inner = inner.replace("list", "lists", 1) if inner.startswith("list") else f"{inner}s"
        least, most = field.get("minItems", 0), field.get("maxItems")
        if most == least:
            return f"list of {most} {inner}", bounds
        return f"list of {inner}", f"{least} to {most} of {bounds}" if most else bounds
    name = {"number": "number", "integer": "whole number", "boolean": "true or false", "string": "text"}[field["type"]]
    low, high = field.get("minimum"), field.get("maximum")
    if low is None:
        return name, ""
    limit = f"{high:g}" if high is not None else f"below {field['exclusiveMaximum']:g}"
    return name, f"{low:g} to {limit}"


def scenario_fields() -> str:
    """Every field of a scenario: type, unit, what is allowed, default, meaning."""
    schema = Scenario.model_json_schema()
    top = {name: field for name, field in schema["properties"].items() if "$ref" not in field}
    lines = [
        "# Fields of a scenario",
        "",
        "`usvauv scenarios extreme` prints a scenario with all of them. Defaults are those of a scenario file that does"
        " not name the field; [`own-scenario.md`](../own-scenario.md) says how to write one.",
        "",
        *_table(top),
    ]
    for name, field in schema["properties"].items():
        if "$ref" in field:
            section = schema["$defs"][field["$ref"].rpartition("/")[2]]
            prose = section.get("description", "").rstrip(".")
            lines += ["", f"## `{name}`", "", _sentence(field["description"])]
            lines += ["", *_table(section["properties"], f"{name}.")] if section["properties"] else ["", f"{prose}."]
    return "\n".join(lines) + "\n"


def trace_variables() -> str:
    """Every variable of a trace: dimensions, unit, meaning."""
    rows = (
        f"| `{name}` | {', '.join(about.dimensions)} | {about.units or '–'} | {about.long_name} |"
        for name, about in VARIABLES.items()
    )
    head = ["# Variables of a trace", "", "| variable | dimensions | unit | meaning |", "| --- | --- | --- | --- |"]
    return "\n".join([*head, *rows]) + "\n"


def _table(fields: dict[str, dict[str, Any]], prefix: str = "") -> Iterator[str]:
    yield "| field | type | unit | allowed | default | meaning |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for name, field in fields.items():
        type_name, allowed = kind(field)
        default = json.dumps(field["default"], ensure_ascii=False)
        cells = f"`{prefix}{name}`", type_name, unit(field), allowed, f"`{default}`", UNIT.sub("", field["description"])
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "reference"
    folder.mkdir(exist_ok=True)
    pages = {"command-line": command_line(), "scenario": scenario_fields(), "trace": trace_variables()}
    for name, text in pages.items():
        (folder / f"{name}.md").write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True}
