"""Docstrings are plain text with code in single backticks; here they become reStructuredText for Sphinx."""

import re
import sys
from itertools import groupby
from operator import itemgetter
from typing import Any

from astroid.manager import AstroidManager
from sphinx.application import Sphinx

from tests.import_graph import imported, sources

OURS = re.compile(r"usvauv(?:\.\w+)+")
FACES = ("usvauv.env", "usvauv.policies")  # packages whose `__init__` says what is meant for others
SECTION = re.compile(r"(Args|Attributes|Raises|Returns):")


def convert(lines: list[str]) -> list[str]:
    """The same as reStructuredText: sections are lists, indented blocks literal, names of ours links."""
    kinds, kind = [], "text"
    for before, line in zip(["", *lines], lines, strict=False):
        if SECTION.fullmatch(line):
            kind = "section"
        elif line.strip() and not line.startswith("    "):
            kind = "text"
        elif kind == "text" and line.strip() and not before.strip():
            kind = "literal"
        kinds.append(kind)
    converted: list[str] = []
    for kind, group in groupby(zip(kinds, lines, strict=True), key=itemgetter(0)):
        part = [line for _, line in group]
        if kind == "literal":
            converted += ["::", "", *part]
        else:
            converted += _marked_up(_listed(part) if kind == "section" else part)
    return converted


def _listed(lines: list[str]) -> list[str]:
    """Sections, each as its name and a list of its entries; what an entry begins with up to a colon is code."""
    listed, entries = [], True
    for line in lines:
        section = SECTION.fullmatch(line)
        head, colon, text = line[4:].partition(": ")
        if section:
            entries = section[1] != "Returns"
            listed += ["", f".. rubric:: {section[1].replace('Args', 'Arguments')}", ""]
        elif entries and line[4:5].strip():
            listed.append(f"- `{head}`: {text}" if colon and "`" not in head else f"- {line[4:]}")
        else:
            listed.append(f"  {line.strip()}" if entries else line.strip())
    return listed


def _marked_up(lines: list[str]) -> list[str]:
    """Code in backticks as code or as a link; what else would be markup is escaped."""
    return re.sub(r"`[^`]*`|\*\*[^*]+\*\*|[*|_\\]", _markup, "\n".join(lines), flags=re.MULTILINE).split("\n")


def _markup(found: re.Match[str]) -> str:
    text = found[0]
    if text[0] != "`":
        return text if len(text) > 1 else f"\\{text}"  # bold stays
    return text if OURS.fullmatch(text[1:-1]) else f"`{text}`"


def _process(_app: Sphinx, _what: str, _name: str, _obj: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = convert(lines)


def _skip(_app: Sphinx, _what: str, name: str, obj: Any, _skip: bool, _options: Any) -> bool | None:
    """Whether to leave a member out; None is as usual."""
    return True if obj.imported and name.rpartition(".")[0] not in FACES else None


def _stay_at_home() -> None:
    """Keep astroid, which reads the source, out of other libraries: following imports there takes most of its time."""
    for path in sources().values():
        for name in imported(path):
            parts = name.split(".")
            if parts[0] not in ("usvauv", *sys.stdlib_module_names):
                AstroidManager().module_denylist.update(".".join(parts[:i]) for i in range(1, len(parts) + 1))


def setup(app: Sphinx) -> dict[str, bool]:
    _stay_at_home()
    app.connect("autodoc-process-docstring", _process)
    app.connect("autoapi-skip-member", _skip)
    return {"parallel_read_safe": True}
