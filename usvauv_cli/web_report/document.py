"""What all pages have: a template filled in, figures in it and as PDF beside it, and how it was made."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping, Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, FunctionLoader, StrictUndefined, Template
from markupsafe import Markup

from usvauv.cli.web_report import figure_style
from usvauv.env.render.plain_matplotlib import Figure
from usvauv.env.storage.files import atomic_write
from usvauv.kernels import runtime
from usvauv.policies.checkpoint import provenance

PACKAGES = ("usvauv", "taichi", "torch", "numpy")
NOTHING_EXTERNAL = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'"


class Picture(NamedTuple):
    """A figure of a page."""

    name: str
    title: str
    svg: Markup
    caption: str


def pictures(folder: Path, made: Sequence[tuple[str, Figure, str, str]]) -> list[Picture]:
    """Figures for the page in a folder: name, figure, title, caption; their PDFs are written there.

    Raises:
        OutputError: a PDF cannot be written.
    """
    for name, figure, *_ in made:
        figure_style.save_pdf(figure, name, folder)
    return [
        Picture(name, title, Markup(figure_style.svg(figure, name, title, caption)), caption)
        for name, figure, title, caption in made
    ]


def write(folder: Path, template: str, title: str, file: Mapping[str, str], arch: str, **fields: Any) -> Path:
    """Fill a template of this package, such as web_report/page.html, which extends base.html; returns the page.

    Args:
        folder: of the page, which is there.
        template: its path in the package.
        title: of the page.
        file: "summary" and "text" of the file from which it was made.
        arch: where the kernels ran.
        fields: of the template.

    Raises:
        OutputError: the page cannot be written.
    """
    html = filled(
        template,
        policy=NOTHING_EXTERNAL,
        style=style(),
        title=title,
        made=_made(arch),
        file=file,
        **fields,
    )
    page = folder / "index.html"
    with atomic_write(page) as partial:
        partial.write_text(html, encoding="utf-8", errors="backslashreplace")
    return page


def filled(template: str, **fields: Any) -> str:
    """A template of this package, filled in."""
    return _template(template).render(fields)


def block(template: str, name: str, **fields: Any) -> Markup:
    """One block of a template of this package, filled in."""
    found = _template(template)
    return Markup("".join(found.blocks[name](found.new_context(fields))))


def _template(name: str) -> Template:
    return Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(text),
    ).get_template(name)


def style() -> Markup:
    """The style of all pages."""
    return Markup(_variables() + text("web_report/style.css"))


def json_for_script(data: Any) -> Markup:
    """JSON that does not end the script element it stands in."""
    return Markup(json.dumps(data, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c"))


def text(name: str) -> str:
    """A file of this package."""
    return resources.files("usvauv.cli").joinpath(name).read_text(encoding="utf-8")


def _variables() -> str:
    """Colours of the light and of the dark page."""
    light, dark = (
        ";".join(f"--{role}:{code}" for role, code in colours.items())
        for colours in (figure_style.LIGHT, figure_style.DARK)
    )
    return f":root{{{light}}}\n@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}\n"


def _made(arch: str) -> dict[str, str]:
    """How the page was made: name → text."""
    of_run = provenance({})
    versions = [f"Python {platform.python_version()}", *(f"{name} {metadata.version(name)}" for name in PACKAGES)]
    return {
        "command": of_run["command"],
        "commit": of_run["commit"],
        "versions": ", ".join(versions),
        "platform": f"{platform.platform()}, {runtime.available_cores()} cores, kernels on {arch}",
        **({"plugins": ", ".join(of_run["plugins"])} if "plugins" in of_run else {}),
    }
