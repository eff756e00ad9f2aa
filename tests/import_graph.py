"""Which modules import which, read from the source.

A room is a folder directly under a package, or a module that stands directly in it. Imports inside functions and those
for type checkers count like the others. Importing `usvauv.kernels.flow.airy` does not count as importing
`usvauv.kernels`.
"""

import ast
import functools
from collections.abc import Mapping, Set
from glob import glob
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("usvauv.kernels", "usvauv.env", "usvauv.policies", "usvauv.cli")  # from the lowest to the highest

Graph = Mapping[str, Set[str]]  # name → names that it imports


def sources() -> dict[str, Path]:
    """File of each module, by its dotted name."""
    found = {}
    for name in sorted(glob("usvauv/**/*.py", root_dir=ROOT / "src", recursive=True)):  # follows links
        parts = Path(name).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = ROOT / "src" / name
    return found


@functools.cache
def imported(path: Path) -> tuple[str, ...]:
    """Dotted names that a file imports; for `from a import b` it is `a.b`, whatever `b` is.

    Raises:
        ValueError: an import is relative.
    """
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            if node.level or node.module is None:
                raise ValueError(f"{path}:{node.lineno}: relative import")
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return tuple(found)


@functools.cache
def module_graph() -> Graph:
    """Modules of the four packages and the modules of these that each one imports."""
    files = sources()
    return {
        name: frozenset(
            target if target in files else target.rpartition(".")[0]
            for target in imported(path)
            if target.partition(".")[0] == "usvauv"
        )
        for name, path in files.items()
    }


def room(module: str) -> str:
    return ".".join(module.split(".")[:3])


def room_graph(modules: Graph) -> Graph:
    """Rooms and the other rooms that each one imports. A package's `__init__` is a room under the package's name."""
    rooms: dict[str, set[str]] = {}
    for module, targets in modules.items():
        rooms.setdefault(room(module), set()).update(map(room, targets))
    return {name: frozenset(targets - {name}) for name, targets in rooms.items()}


def circle(graph: Graph) -> list[str]:
    """Names of which each imports the next and the last the first, or nothing if the graph has no circle."""
    done: set[str] = set()

    def search(name: str, path: list[str]) -> list[str]:
        if name in path:
            return path[path.index(name) :]
        if name in done:
            return []
        for target in sorted(graph[name]):
            if found := search(target, [*path, name]):
                return found
        done.add(name)
        return []

    for name in graph:
        if found := search(name, []):
            return found
    return []
