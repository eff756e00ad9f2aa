"""Mutants of the packages: small changes of the source, one at a time, each of which a test should notice.

A mutant replaces one expression or statement and leaves the rest of its file as it is, because Taichi reads kernels
from their files. Operators:

- arithmetic: + ↔ −, * ↔ /, // and % and ** → *, += ↔ −=, *= ↔ /=
- comparison: < ↔ ≤, > ↔ ≥, < ↔ >, == ↔ !=
- logic: and ↔ or, `if c` and `while c` → the contrary
- constant: an integer is raised by one, True ↔ False, another number is multiplied by 1.5 (0.0 becomes 1.0)
- sign: −x → x
- index: `a[i]` → `a[i + 1]` below the last known place; for a column of `kernels.mission.columns` the next column
- function: min ↔ max, sin ↔ cos, floor ↔ ceil
- return: in a Taichi function the value's sign, elsewhere None
- deletion: of an assignment to an element or attribute, of a += and its like, of a call whose value is not used

Strings, annotations, decorators and raised errors are left alone, and so are the bounds of a scenario's fields, which a
test could only repeat.
"""

from __future__ import annotations

import ast
import copy
import hashlib
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.import_graph import ROOT, sources

ARITHMETIC = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
}
COMPARISON = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt,),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt,),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
}
BOUNDS = ("ge", "gt", "le", "lt")  # arguments of `pydantic.Field`
FUNCTION = {"min": "max", "max": "min", "sin": "cos", "cos": "sin", "floor": "ceil", "ceil": "floor"}


@dataclass(frozen=True)
class Mutant:
    """One change of one file.

    Attributes:
        file: relative to the repository.
        line: where the change begins, from 1.
        operator: of the list above.
        start, end: offsets in the file's text that `new` replaces.
        old, new: source text.
        column: where the change begins in its line.
        context: text of that line, and how many equal ones stand above it.
    """

    file: str
    line: int
    operator: str
    start: int
    end: int
    old: str
    new: str
    column: int
    context: str

    @property
    def key(self) -> str:
        """Identity of the mutant for as long as the text of its line stays the same."""
        parts = (self.file, str(self.column), self.context, self.old, self.new)
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:12]

    def applied(self, text: str) -> str:
        """The file's text with the change.

        Raises:
            ValueError: the text is not the one that the mutant was made of.
        """
        if text[self.start : self.end] != self.old:
            raise ValueError(f"{self.file}:{self.line}: is not {self.old!r} any more")
        return text[: self.start] + self.new + text[self.end :]


def column_names() -> dict[str, list[str]]:
    """Names of the columns of each class of `kernels.mission.columns`, in order."""
    tree = ast.parse((ROOT / "kernels/mission/columns.py").read_text(encoding="utf-8"))
    return {
        node.name: [item.target.id for item in node.body if isinstance(item, ast.AnnAssign)]
        for node in tree.body
        if isinstance(node, ast.ClassDef)
    }


class _Finder(ast.NodeVisitor):
    """Collects the changed nodes of a module: `found` has (node, operator, replacement)."""

    def __init__(self, columns: dict[str, list[str]]) -> None:
        self.found: list[tuple[ast.AST, str, ast.AST | None]] = []
        self._columns = columns
        self._taichi = False

    def _add(self, node: ast.AST, operator: str, replacement: ast.AST | None) -> None:
        self.found.append((node, operator, replacement))

    def _changed(self, node: ast.AST, operator: str, **fields: object) -> None:
        new = copy.copy(node)
        for name, value in fields.items():
            setattr(new, name, value)
        self._add(node, operator, new)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for statement in node.body:
            self.visit(statement)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        outer = self._taichi
        self._taichi = any(ast.unparse(each) in ("ti.func", "ti.kernel", "ti.pyfunc") for each in node.decorator_list)
        for default in (*node.args.defaults, *node.args.kw_defaults):
            if default is not None:
                self.visit(default)
        for statement in node.body:
            self.visit(statement)
        self._taichi = outer

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_Raise(self, node: ast.Raise) -> None:
        pass

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        pass

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if type(node.op) in ARITHMETIC and not any(
            isinstance(side, ast.Constant | ast.JoinedStr) and not _is_number(side) for side in (node.left, node.right)
        ):
            self._changed(node, "arithmetic", op=ARITHMETIC[type(node.op)]())
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        if type(node.op) in ARITHMETIC:
            self._changed(node, "arithmetic", op=ARITHMETIC[type(node.op)]())
        self._add(node, "deletion", ast.Pass())
        self.visit(node.value)

    def visit_Compare(self, node: ast.Compare) -> None:
        for position, operator in enumerate(node.ops):
            for other in COMPARISON.get(type(operator), ()):
                ops = [*node.ops[:position], other(), *node.ops[position + 1 :]]
                self._changed(node, "comparison", ops=ops)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        self._changed(node, "logic", op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
        self.generic_visit(node)

    def _condition(self, node: ast.If | ast.While | ast.IfExp) -> None:
        if "TYPE_CHECKING" not in ast.unparse(node.test):
            self._add(node.test, "logic", ast.UnaryOp(ast.Not(), node.test))
        self.generic_visit(node)

    visit_If = visit_While = visit_IfExp = _condition

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool):
            self._changed(node, "constant", value=not node.value)
        elif isinstance(node.value, int):
            self._changed(node, "constant", value=node.value + 1)
        elif isinstance(node.value, float):
            self._changed(node, "constant", value=1.5 * node.value or 1.0)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub):
            self._add(node, "sign", node.operand)
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        names = self._columns.get(node.value.id, []) if isinstance(node.value, ast.Name) else []
        if node.attr in names:
            self._changed(node, "index", attr=names[(names.index(node.attr) + 1) % len(names)])
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        for part in parts:
            if isinstance(part, ast.Constant) and type(part.value) is int:
                self._changed(part, "index", value=1 if part.value == 0 else part.value - 1)
            else:
                self.visit(part)

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in FUNCTION:
            func = copy.copy(node.func)
            setattr(func, "attr" if isinstance(func, ast.Attribute) else "id", FUNCTION[name])
            self._changed(node, "function", func=func)
        for part in (node.func, *node.args, *(each.value for each in node.keywords if each.arg not in BOUNDS)):
            self.visit(part)

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is not None:
            value = ast.UnaryOp(ast.USub(), node.value) if self._taichi else ast.Constant(None)
            if ast.unparse(value) != ast.unparse(node.value):
                self._changed(node, "return", value=value)
            self.visit(node.value)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self._add(node, "deletion", ast.Pass())
            self.visit(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        if all(isinstance(target, ast.Subscript | ast.Attribute) for target in node.targets):
            self._add(node, "deletion", ast.Pass())
        self.generic_visit(node)


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)


def mutants_of(path: Path, columns: dict[str, list[str]]) -> Iterator[Mutant]:
    """All mutants of a file."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    begins = [0]
    for line in lines:
        begins.append(begins[-1] + len(line))

    def offset(line: int, column: int) -> int:
        """Of a place as `ast` counts it, in bytes of the line."""
        return begins[line - 1] + len(lines[line - 1].encode()[:column].decode())

    finder = _Finder(columns)
    finder.visit(ast.parse(text))
    file = str(path.relative_to(ROOT))
    for node, operator, replacement in finder.found:
        start = offset(node.lineno, node.col_offset)
        end = offset(node.end_lineno, node.end_col_offset)
        new = ast.unparse(ast.fix_missing_locations(replacement))
        line = lines[node.lineno - 1]
        context = f"{lines[: node.lineno].count(line)}: {line.strip()}"
        yield Mutant(
            file,
            node.lineno,
            operator,
            start,
            end,
            text[start:end],
            new if isinstance(node, ast.stmt) else f"({new})",
            node.col_offset,
            context,
        )


def drawn(seed: int, count: int, rooms: Sequence[str]) -> list[Mutant]:
    """A random sample of mutants: lines that have any are drawn uniformly without repetition, then one of each.

    A line's place in the order depends on its text alone: changes of other lines leave the sample almost as it is.

    Args:
        rooms: only modules whose dotted names begin with one of these.
    """
    columns = column_names()
    by_line: dict[str, list[Mutant]] = {}
    for module, path in sources().items():
        if any(module == room or module.startswith(f"{room}.") for room in rooms):
            for mutant in mutants_of(path, columns):
                by_line.setdefault(f"{seed}\n{mutant.file}\n{mutant.context}", []).append(mutant)
    generators = {line: random.Random(line) for line in by_line}
    order = sorted(by_line, key=lambda line: generators[line].random())
    return [generators[line].choice(by_line[line]) for line in order[:count]]
