"""The list of all pages that stands beside each: rendered once; Sphinx does it anew for each page."""

from __future__ import annotations

from functools import cache
from typing import Any

from bs4 import BeautifulSoup, Tag
from sphinx.application import Sphinx
from sphinx.environment.adapters.toctree import global_toctree_for_doc
from sphinx.util.osutil import relative_uri


@cache
def _on_the_first_page(app: Sphinx, **options: Any) -> tuple[BeautifulSoup, list[tuple[Tag, str]]]:
    """The list as it stands on the first page, without marks, and its links with their addresses from there."""
    tree = global_toctree_for_doc(app.env, app.config.root_doc, app.builder, tags=app.tags, **options)
    soup = BeautifulSoup(app.builder.render_partial(tree)["fragment"], "html.parser")
    return soup, [(link, link["href"]) for link in soup.find_all("a", class_="internal")]


def render(app: Sphinx, page: str, **options: Any) -> str:
    """The list for a page: links from there, and the way to the page's own entry `current`."""
    soup, links = _on_the_first_page(app, **options)
    own = app.builder.get_target_uri(page)
    way: list[Tag] = []
    for link, address in links:
        link["href"] = relative_uri(own, address)
        if address == own:
            link["href"] = "#"
            way += [link, *(tag for tag in link.parents if tag.name in ("li", "ul"))]
    plain = [tag.attrs for tag in way]
    for tag in way:
        tag.attrs = {**tag.attrs, "class": [*tag.get("class", []), "current"]}
    text = str(soup)
    for tag, attributes in zip(way, plain, strict=True):
        tag.attrs = attributes
    return text


def _replace(app: Sphinx, page: str, _template: str, context: dict[str, Any], _doctree: Any) -> None:
    context["toctree"] = lambda **options: render(app, page, **options)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("html-page-context", _replace, priority=400)  # before the theme's, which calls it
    return {"parallel_read_safe": True}
