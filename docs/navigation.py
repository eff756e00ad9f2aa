"""The list of all pages that stands beside each: rendered once; Sphinx and the theme do it anew for each page."""

from __future__ import annotations

from functools import cache
from typing import Any

from bs4 import BeautifulSoup, Tag
from furo.navigation import get_navigation_tree
from sphinx.application import Sphinx
from sphinx.environment.adapters.toctree import global_toctree_for_doc
from sphinx.util.osutil import relative_uri

WHOLE = {"collapse": False, "titles_only": True, "maxdepth": -1, "includehidden": True}


@cache
def _on_the_first_page(app: Sphinx) -> tuple[BeautifulSoup, list[tuple[Tag, str]]]:
    """The theme's list as it stands on the first page, without marks, and its links with their addresses from there."""
    tree = global_toctree_for_doc(app.env, app.config.root_doc, app.builder, tags=app.tags, **WHOLE)
    soup = BeautifulSoup(get_navigation_tree(app.builder.render_partial(tree)["fragment"]), "html.parser")
    return soup, [(link, link["href"]) for link in soup.find_all("a", class_="internal")]


def render(app: Sphinx, page: str) -> str:
    """The list for a page: links from there, and the way to the page's own entry `current` and unfolded."""
    soup, links = _on_the_first_page(app)
    own = app.builder.get_target_uri(page)
    way: list[Tag] = []
    entry: Tag | None = None
    for link, address in links:
        link["href"] = relative_uri(own, address)
        if address == own:
            link["href"] = "#"
            way += [link, *(tag for tag in link.parents if tag.name in ("li", "ul"))]
            entry = link.find_parent("li")
    folds = [fold for tag in way if tag.name == "li" for fold in tag.find_all("input", recursive=False)]
    plain = [(tag, tag.attrs) for tag in (*way, *folds)]
    for tag in way:
        tag.attrs = {**tag.attrs, "class": [*tag.get("class", []), "current"]}
    for tag in folds:
        tag.attrs = {**tag.attrs, "checked": ""}
    if entry:
        entry["class"].append("current-page")
    text = str(soup)
    for tag, attributes in plain:
        tag.attrs = attributes
    return text


def _leave_out(_app: Sphinx, _page: str, _template: str, context: dict[str, Any], _doctree: Any) -> None:
    context["toctree"] = lambda **_options: ""


def _put_in(app: Sphinx, page: str, _template: str, context: dict[str, Any], _doctree: Any) -> None:
    context["furo_navigation_tree"] = render(app, page)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("html-page-context", _leave_out, priority=400)  # before the theme's, which calls it
    app.connect("html-page-context", _put_in, priority=600)
    return {"parallel_read_safe": True}
