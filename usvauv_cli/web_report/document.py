"""Common parts of all pages: a filled template, its provenance, and figures in the page and as PDF, with their style.

A figure is drawn in the colours of `LIGHT`, with the width of a paper's column. In the page's SVG each of them is
replaced by a variable of the page's style, which has another value if the page is dark. Each colour therefore has only
one meaning.
"""

from __future__ import annotations

import io
import json
import math
import platform
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from html import escape
from importlib import metadata, resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined, Template
from markupsafe import Markup

from usvauv.env.render.figures import Axes, Figure, Line2D, plain
from usvauv.env.render.style import CATEGORICAL, CATEGORICAL_ON_WHITE, MARKERS, ON_DARK
from usvauv.env.storage.files import atomic_write
from usvauv.kernels import runtime
from usvauv.policies.checkpoint import provenance

COLUMN = 3.4  # width, inches
LIGHT = {
    "ink": "#17222d",
    "muted": "#566675",
    "line": "#d5dde5",
    "sea": "#edf4f9",
    "node": "#7d8c99",
    **{f"series{i}": light for i, light in enumerate(CATEGORICAL_ON_WHITE)},
}
DARK = {
    "ink": ON_DARK.text,
    "muted": ON_DARK.muted,
    "line": ON_DARK.line,
    "sea": "#0f2a40",
    "node": "#8496a6",
    **{f"series{i}": dark for i, dark in enumerate(CATEGORICAL)},
}
INK, MUTED, LINE, SEA, NODE = (LIGHT[name] for name in ("ink", "muted", "line", "sea", "node"))
DASHES: tuple[str | tuple[int, tuple[float, ...]], ...] = (
    *("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5))),
    *((0, (8, 2)), (0, (3, 1, 1, 1, 1, 1))),
)
SETTINGS: dict[Any, Any] = {  # matplotlib's own names
    "font.size": 7.5,
    "font.family": "DejaVu Sans",
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.6,
    "axes.titlesize": 7.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "lines.linewidth": 1.2,
    "path.simplify": False,
}

PACKAGES = ("usvauv", "taichi", "torch", "numpy")
NOTHING_EXTERNAL = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'"


def colour(i: int) -> str:
    """Colour of combination or AUV number `i`."""
    return CATEGORICAL_ON_WHITE[i % len(CATEGORICAL_ON_WHITE)]


def marker(i: int) -> str:
    """Marker of combination number `i`."""
    return MARKERS[(i + i // len(CATEGORICAL)) % len(MARKERS)]  # another one when colours repeat


def dash(i: int) -> str | tuple[int, tuple[float, ...]]:
    """Dashes of the lines of combination number `i`."""
    return DASHES[i % len(DASHES)]


def drawing(name: str) -> AbstractContextManager[None]:
    """Fonts and line widths of the figures; ids in the SVG are those of its name."""
    return plain({**SETTINGS, "svg.hashsalt": name})


def svg(figure: Figure, name: str, title: str, about: str) -> str:
    """The figure as an element of a page: colours as variables, ids that begin with its name, title and description."""
    text = io.StringIO()
    figure.savefig(text, format="svg", transparent=True, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    drawn = text.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    drawn = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", drawn)
    for role, code in LIGHT.items():
        drawn = drawn.replace(code, f"var(--{role})")
    # Hundredths of a point are enough, and equal marks have one style together.
    drawn = re.sub(r'\b[dxy]="[^"]*"', lambda found: re.sub(r"(\.\d\d)\d+", r"\1", found[0]), drawn)
    drawn = re.sub(r'(<g\b[^>]*)>((?:\s*<use [^>]* style="([^"]*)"/>)(?:\s*<use [^>]* style="\3"/>)+)', _share, drawn)
    size = re.search(r'viewBox="[^"]*"', drawn)
    assert size
    head = (
        f'<svg {size[0]} role="img" aria-labelledby="{name}-title {name}-about" '
        'xmlns:xlink="http://www.w3.org/1999/xlink">'
        f'<title id="{name}-title">{escape(title, False)}</title><desc id="{name}-about">{escape(about, False)}</desc>'
    )
    return head + drawn[drawn.index(">") + 1 :].strip()


def _share(found: re.Match[str]) -> str:
    """A group of marks with their common style."""
    start, marks, style = found.groups()
    return f'{start} style="{style}">' + marks.replace(f' style="{style}"', "").replace("\n", "")


def truncated(name: str, most: int) -> str:
    """A name of at most so many letters."""
    return name if len(name) <= most else f"{name[: most - 1]}…"


def new(height: float, handles: Sequence[Line2D] = ()) -> Figure:
    """An empty figure of one column, in inches as high as given and as a legend of handles takes below it."""
    if not handles:
        return Figure(figsize=(COLUMN, height), layout="constrained")
    longest = max(len(str(handle.get_label())) for handle in handles)
    columns = max(1, min(len(handles), 62 // (longest + 8)))  # a row for two short names or one long one
    below = 0.16 * math.ceil(len(handles) / columns) + 0.05
    figure = Figure(figsize=(COLUMN, height + below), layout="constrained")
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    return figure


def style_axes(axes: Axes, grid: bool = True) -> None:
    """Muted numbers, and a grid behind the plot."""
    axes.set_axisbelow(True)
    if grid:
        axes.grid(color=LINE, lw=0.5)
    axes.tick_params(which="both", colors=MUTED, length=2, width=0.6)


def name_axes(axes: Axes, name: str, columns: int) -> None:
    """The name of a combination over one of the plots side by side."""
    axes.set_title(truncated(name, 60 // columns), loc="left", pad=3, fontsize=6.5 if columns > 1 else 7.5)


def points(names: Iterable[str], size: float = 4.5) -> list[Line2D]:
    """Marks of combinations for a legend."""
    looks = {"ls": "none", "ms": size, "mec": INK, "mew": 0.6}
    return [Line2D([], [], marker=marker(i), color=colour(i), label=name, **looks) for i, name in enumerate(names)]


def lines(names: Iterable[str]) -> list[Line2D]:
    """Lines of combinations for a legend."""
    return [Line2D([], [], color=colour(i), ls=dash(i), label=name) for i, name in enumerate(names)]


Drawn = tuple[str, Callable[[], Figure], str, str]  # name of a figure, what draws it, title, caption


def pictures(folder: Path, wanted: Iterable[Drawn]) -> list[dict[str, str]]:
    """Figures for the page in a folder; each is written there as NAME.pdf too, with its fonts and without a date."""
    made = []
    for name, draw, title, caption in wanted:
        with drawing(name):
            figure = draw()
            with atomic_write(folder / f"{name}.pdf") as partial:
                figure.savefig(partial, format="pdf", transparent=True, metadata={"CreationDate": None})
            drawn = Markup(svg(figure, name, title, caption))
            made.append({"name": name, "title": title, "svg": drawn, "caption": caption})
    return made


def write(folder: Path, template: str, title: str, file: Mapping[str, str], arch: str, **fields: Any) -> Path:
    """Fill a template of this package, such as web_report/page.html, which extends base.html; returns the page.

    `file` has "summary" and "text" of the file from which it was made, `arch` says where the kernels ran.
    """
    shared = {"policy": NOTHING_EXTERNAL, "style": style(), "title": title, "made": _made(arch), "file": file}
    html = filled(template, **shared, **fields)
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
    """The style of all pages; colours are variables, which have other values where the page is dark."""
    light, dark = (";".join(f"--{role}:{code}" for role, code in colours.items()) for colours in (LIGHT, DARK))
    variables = f":root{{{light}}}\n@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}\n"
    return Markup(variables + text("web_report/style.css"))


def json_for_script(data: Any) -> Markup:
    """JSON that does not end the script element it stands in."""
    return Markup(json.dumps(data, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c"))


def text(name: str) -> str:
    """A file of this package."""
    return resources.files("usvauv.cli").joinpath(name).read_text(encoding="utf-8")


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
