"""Size and shape of the code of a checkout: `python -m benchmarks.structure [FOLDER]`.

Printed are files per folder; the longest argument lists of Taichi kernels, Taichi functions and Python functions; the
public functions and methods of which an argument or the result has no annotation, and those without a docstring; class
names that a package has twice; files of less than 60 lines that one other file imports; passages that stand more than
once; and lines of files, of imports and of code, which are those with a token that is neither a comment nor part of a
docstring.
"""

from __future__ import annotations

import ast
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("kernels", "usvauv_env", "policies", "usvauv_cli")
OTHERS = ("tests", "benchmarks", "examples")
PASSAGE = 6  # lines
SMALL = 60  # lines
SHOWN = 5  # longest argument lists of each kind
LAYOUT = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.COMMENT, tokenize.ENCODING}


@dataclass(frozen=True)
class Function:
    """A function or method as written.

    Attributes:
        where: file and name.
        kind: "kernel", "func" or "Python".
        arguments: how many it takes, `self` and `cls` not counted.
        public: whether neither it nor what it stands in is private or inside a function.
        typed: whether each argument and the result has an annotation; `__init__` needs none for the result.
        documented: whether it has a docstring.
    """

    where: str
    kind: str
    arguments: int
    public: bool
    typed: bool
    documented: bool


def functions(tree: ast.AST, where: str, public: bool = True, method: bool = False) -> Iterator[Function]:
    """All functions below a node of the syntax tree, outer ones first."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
            kind = next((name for name in ("kernel", "func") if name in decorators), "Python")
            taken = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            taken = taken[1:] if method and "staticmethod" not in decorators else taken
            extra = [argument for argument in (node.args.vararg, node.args.kwarg) if argument]
            special = node.name.startswith("__") and node.name.endswith("__")
            shown = public and (special or not node.name.startswith("_"))
            typed = all(argument.annotation for argument in (*taken, *extra))
            typed = typed and (node.returns is not None or node.name == "__init__")
            documented = ast.get_docstring(node) is not None
            yield Function(f"{where}:{node.name}", kind, len(taken) + len(extra), shown, typed, documented)
            yield from functions(node, where, public=False)
        elif isinstance(node, ast.ClassDef):
            yield from functions(node, f"{where}:{node.name}", public and not node.name.startswith("_"), method=True)
        else:
            yield from functions(node, where, public, method)


def code_lines(path: Path, tree: ast.AST) -> list[str]:
    """Lines with a token that is neither layout, a comment nor part of a docstring; without indentation."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    prose: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, documented) and ast.get_docstring(node, clean=False) is not None:
            prose.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    lines: set[int] = set()
    with tokenize.open(path) as file:
        for token in tokenize.generate_tokens(file.readline):
            if token.type not in LAYOUT:
                lines.update(range(token.start[0], token.end[0] + 1))
    text = ["", *path.read_text(encoding="utf-8").splitlines(), ""]
    return [text[line].strip() for line in sorted(lines - prose) if text[line].strip()]


def repeated(files: Iterable[list[str]]) -> int:
    """How many passages of `PASSAGE` lines of code or more stand a second time, imports not counted."""
    seen: set[tuple[str, ...]] = set()
    count = 0
    for lines in files:
        lines = [line for line in lines if not line.startswith(("import ", "from "))]
        inside = False
        for start in range(len(lines) - PASSAGE + 1):
            passage = tuple(lines[start : start + PASSAGE])
            count += passage in seen and not inside
            inside = passage in seen
            seen.add(passage)
    return count


def module_name(path: Path) -> str:
    """The name under which a file of the repository is imported."""
    folder, *inner = path.with_suffix("").parts
    package = {"usvauv_env": "usvauv.env", "usvauv_cli": "usvauv.cli"}.get(folder, f"usvauv.{folder}")
    return ".".join([package, *inner]).removesuffix(".__init__")


def importers(trees: Mapping[Path, ast.Module]) -> Counter[str]:
    """How many of the files import each module of the packages."""
    count: Counter[str] = Counter()
    for tree in trees.values():
        names: set[str] = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                names.update([node.module, *(f"{node.module}.{alias.name}" for alias in node.names)])
            elif isinstance(node, ast.Import):
                names.update(alias.name for alias in node.names)
        count.update(names)
    return count


def import_lines(tree: ast.Module) -> int:
    """Lines of a file that are import statements."""
    found = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    return sum((node.end_lineno or node.lineno) - node.lineno + 1 for node in found)


def show(root: Path) -> None:
    found: list[Function] = []
    files: Counter[str] = Counter()
    lines: Counter[str] = Counter()
    code: dict[str, list[list[str]]] = {top: [] for top in (*PACKAGES, *OTHERS)}
    trees: dict[Path, ast.Module] = {}
    classes: Counter[tuple[str, str]] = Counter()
    imports: Counter[str] = Counter()
    for top in (*PACKAGES, *OTHERS):
        for path in sorted((root / top).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            tree = ast.parse(text)
            place = path.relative_to(root)
            files[str(place.parent)] += 1
            lines[top] += len(text.splitlines())
            code[top].append(code_lines(path, tree))
            imports[top] += import_lines(tree)
            if top in PACKAGES:
                trees[place] = tree
                found += functions(tree, str(place))
                classes.update((top, node.name) for node in tree.body if isinstance(node, ast.ClassDef))
    print("files per folder")
    for folder, count in sorted(files.items()):
        print(f"  {count:4}  {folder}")
    for kind in ("kernel", "func", "Python"):
        print(f"longest argument lists: {kind}")
        for function in sorted((f for f in found if f.kind == kind), key=lambda f: -f.arguments)[:SHOWN]:
            print(f"  {function.arguments:4}  {function.where}")
    print("public Python functions without full annotations")
    untyped = [f for f in found if f.kind == "Python" and f.public and not f.typed]
    for top in PACKAGES:
        print(f"  {sum(f.where.startswith(top) for f in untyped):4}  {top}")
    print("public Python functions and methods without a docstring")
    for top in PACKAGES:
        public = [f for f in found if f.kind == "Python" and f.public and f.where.startswith(top)]
        print(f"  {sum(not f.documented for f in public):4}  of {len(public):4}  {top}")
    print("class names that a package has twice")
    print(f"  {', '.join(f'{top}: {name}' for (top, name), count in classes.items() if count > 1) or 'none'}")
    counted = importers(trees)
    small = [
        str(path)
        for path in trees
        if path.name != "__init__.py"
        and counted[module_name(path)] == 1
        and len((root / path).read_text(encoding="utf-8").splitlines()) < SMALL
    ]
    print(f"files of less than {SMALL} lines with one importer")
    print(f"  {len(small):4}  {', '.join(small)}")
    print(f"passages of {PASSAGE} or more lines of code that stand a second time")
    print(f"  {repeated(file for top in PACKAGES for file in code[top]):4}  the four packages")
    print("files, lines, of which imports and code")
    count = {top: sum(map(len, code[top])) for top in code}
    for top in code:
        print(f"  {len(code[top]):4}  {lines[top]:6}  {imports[top]:6}  {count[top]:6}  {top}")
    whole = [sum(table[top] for top in PACKAGES) for table in (lines, imports, count)]
    print(f"  {len(trees):4}  {whole[0]:6}  {whole[1]:6}  {whole[2]:6}  the four packages")


if __name__ == "__main__":
    show(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1])
