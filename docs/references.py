"""References to objects: what no object is called is not looked for among all of them, as Sphinx does each time.

Annotations name many classes of other libraries, and a search goes through thousands of names.
"""

from __future__ import annotations

from typing import Any

from sphinx.application import Sphinx
from sphinx.domains.python import ObjectEntry, PythonDomain


class Domain(PythonDomain):
    """Python's, with the last parts of all names at hand."""

    _known: tuple[int, frozenset[str]] = 0, frozenset()

    def find_obj(self, env: Any, modname: str, classname: str, name: str, *how: Any) -> list[tuple[str, ObjectEntry]]:
        """Objects of a name, as of `PythonDomain`."""
        if self._known[0] != len(self.objects):
            self._known = len(self.objects), frozenset(each.rpartition(".")[2] for each in self.objects)
        if name.removesuffix("()").rpartition(".")[2] not in self._known[1]:
            return []
        return super().find_obj(env, modname, classname, name, *how)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_domain(Domain, override=True)
    return {"parallel_read_safe": True}
