"""Which modules import which, read from the source; `python -m tests.import_graph` prints the graph between rooms.

A room is a folder directly under a package, or a module that stands directly in it. Imports inside functions and those
for type checkers count like the others. Importing `kernels.flow.airy` does not count as importing `kernels`.
"""

import ast
from collections.abc import Iterator, Mapping, Set
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("kernels", "usvauv_env", "policies", "usvauv_cli")  # from the lowest to the highest

Graph = Mapping[str, Set[str]]  # name → names that it imports


def sources() -> dict[str, Path]:
    """File of each module, by its dotted name."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(path: Path) -> Iterator[str]:
    """Dotted names that a file imports; for `from a import b` it is `a.b`, whatever `b` is.

    Raises:
        ValueError: an import is relative.
    """
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level or node.module is None:
                raise ValueError(f"{path}:{node.lineno}: relative import")
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def module_graph() -> Graph:
    """Modules of the four packages and the modules of these that each one imports."""
    files = sources()
    return {
        name: frozenset(
            target if target in files else target.rpartition(".")[0]
            for target in imported(path)
            if target.partition(".")[0] in PACKAGES
        )
        for name, path in files.items()
    }


def room(module: str) -> str:
    return ".".join(module.split(".")[:2])


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


def reachable(graph: Graph, name: str) -> set[str]:
    """Everything that `name` imports, itself or through others."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        new = graph[waiting.pop()] - found
        found |= new
        waiting.extend(new)
    return found


def reduced(graph: Graph) -> Graph:
    """The imports of a graph without circles that do not follow from the others."""
    return {
        name: frozenset(t for t in targets if not any(t in reachable(graph, other) for other in targets - {t}))
        for name, targets in graph.items()
    }


def mermaid(graph: Graph) -> str:
    """The reduced graph as a Mermaid flow chart: arrows from a room to the rooms that it imports."""
    edges = {name: targets for name, targets in sorted(reduced(graph).items()) if targets}
    drawn = sorted(edges.keys() | {target for targets in edges.values() for target in targets})
    lines = ["flowchart TB"]
    for package in reversed(PACKAGES):
        nodes = [f"{node(name)}[{name.rpartition('.')[2]}]" for name in drawn if name.partition(".")[0] == package]
        lines += [f"    subgraph {package}", f"        {'; '.join(nodes)}", "    end"]
    lines += [f"    {node(name)} --> {' & '.join(map(node, sorted(targets)))}" for name, targets in edges.items()]
    return "\n".join(lines)


def node(name: str) -> str:
    """Mermaid's name of a room; a package's own must not be that of the box around its rooms."""
    return name if "." in name else f"{name}.__init__"


if __name__ == "__main__":
    print(mermaid(room_graph(module_graph())))
