"""Named items of one kind, such as boat strategies, to which plugins add."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from importlib import import_module
from itertools import cycle
from pathlib import Path
from pkgutil import resolve_name
from types import UnionType
from typing import Annotated, Any, Generic, TypeVar, Union, get_args, get_origin, get_type_hints

from usvauv.kernels.errors import UserError, blaming, choices, text_of, wrong_return

T = TypeVar("T")
SOURCE = Path(__file__).parents[1]  # of the packages


@cache
def _parsed(module: str) -> ast.Module:
    """The source of a module of the packages."""
    return ast.parse(SOURCE.joinpath(*module.split(".")[1:]).with_suffix(".py").read_text(encoding="utf-8"))


def declared(place: str) -> dict[str, Any]:
    """What the source of a function or class of the packages says, without importing its module.

    Args:
        place: "module:name".

    Returns:
        its docstring as "__doc__", and of a class the attributes with a literal value, also those of its bases.
    """
    module, _, name = place.partition(":")
    body = _parsed(module).body
    item = next(node for node in body if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == name)
    found: dict[str, Any] = {}
    if isinstance(item, ast.ClassDef):
        modules = {each.name: node.module for node in body if isinstance(node, ast.ImportFrom) for each in node.names}
        for base in map(ast.unparse, item.bases):
            found |= declared(f"{modules.get(base, module)}:{base}")
        for node in item.body:
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value:
                with suppress(ValueError):  # no literal
                    target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
                    found[ast.unparse(target)] = ast.literal_eval(node.value)
    return found | {"__doc__": ast.get_docstring(item)}


def _arguments(function: Callable[..., Any]) -> str:
    return ", ".join(name for name in inspect.signature(function).parameters if name != "self")


def _takes(function: Callable[..., Any], count: int) -> bool:
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    except ValueError:  # a function of C without a signature
        return True
    return True


@cache
def _fields(form: Any) -> Mapping[str, Any]:
    """Types of the fields of a dataclass or named tuple, by name; empty for anything else."""
    names = getattr(form, "__dataclass_fields__", getattr(form, "_fields", ()))
    hints = get_type_hints(form, include_extras=True) if names else {}
    return {name: hints[name] for name in names}


def _misfit(given: Any, form: Any, place: str = "") -> str:
    """Why something is not of a form, in words; empty if it is.

    Args:
        given: an item, a part of one, or a class.
        form: a class; a function, as `Annotated[Callable, "worlds, w"]` with its arguments; a tuple of one of these; or
            one of these or None. Of a class's fields, those of these forms are checked, and of a subclass the methods.
        place: names of the fields that lead to a part.
    """
    kind, begin = get_origin(form), f"{place} is".lstrip()
    if kind is Annotated:
        arguments = form.__metadata__[0]
        if not callable(given):
            return f"{begin} {text_of(given, repr)}: must be a function ({arguments})"
        if not _takes(given, arguments.count(",") + 1):
            return f"{begin} a function ({_arguments(given)}): must take ({arguments})"
    elif kind is tuple:
        parts = get_args(form)
        many = parts[-1] is ...
        if not isinstance(given, tuple) or (not many and len(given) != len(parts)):
            return (
                f"{begin} {text_of(given, repr)}: must be a tuple ({'…,' if many else ', '.join('…' for _ in parts)})"
            )
        forms = cycle(parts[:1]) if many else parts
        return next(filter(None, (_misfit(each, of, place) for each, of in zip(given, forms, strict=False))), "")
    elif kind in (Union, UnionType):
        return "" if given is None else _misfit(given, get_args(form)[0], place)
    elif not place or _fields(form):
        if not (issubclass(given, form) if isinstance(given, type) else isinstance(given, form)):
            return f"{begin} {text_of(given, repr)}: must be a {form.__name__}"
        if isinstance(given, type):
            return _misfit_of_methods(given, form)
        for name, part in _fields(form).items():
            if problem := _misfit(getattr(given, name), part, f"{place}.{name}".lstrip(".")):
                return problem
    return ""


def _misfit_of_methods(given: type, base: type) -> str:
    """Which method of the base class a subclass lacks or defines for other arguments, in words; empty: none."""
    for name, method in inspect.getmembers(base, inspect.isroutine):
        if (name.startswith("_") and name != "__init__") or not str(getattr(method, "__module__", "")).startswith(
            "usvauv."
        ):
            continue
        own, parameters = getattr(given, name), inspect.signature(method).parameters.values()
        if getattr(own, "__isabstractmethod__", False):
            return f"has no method {name}({_arguments(method)})"
        if not _takes(own, sum(p.default is p.empty and p.kind is p.POSITIONAL_OR_KEYWORD for p in parameters)):
            return f"its method is {name}({_arguments(own)}): must be {name}({_arguments(method)})"
    return ""


class Registry(Mapping[str, T], Generic[T]):
    """A mapping from names to items that can only grow; names keep the order of their registration.

    Args:
        kind: what an item is, in the singular, for error messages, e.g. "boat strategy".
        error: the class of the error for an unknown name.
        form: what an item is: a class of which it is an instance or a subclass, or a function, see `_misfit`; or such a
            class as "module:name", imported when an item is registered.
        documented: item → the function or class whose docstring says what it is; default: the item.
        shipped: names of items of the packages → module that registers each, which is imported when an item is first
            used, so that names are known without Taichi; as "module:name" with what `documented` returns, so that
            lists are, too.

    Raises:
        error: an unknown name; the message lists the known ones.
    """

    def __init__(
        self,
        kind: str,
        error: Callable[[str], UserError] = UserError,
        form: Any = Callable,
        documented: Callable[[T], Any] = lambda item: item,
        shipped: Mapping[str, str] | None = None,
    ) -> None:
        self.kind = kind
        self._error = error
        self._form = form
        self._documented = documented
        self._shipped = shipped or {}
        self._items: dict[str, T] = {}
        self._files: dict[str, str] = {}  # of items that plugins registered
        self._taichi: dict[str, object] = {}  # the state of Taichi whose fields these items may read

    def register(self, name: str, item: T) -> T:
        """Add an item under a name that is not taken yet; returns the item.

        Raises:
            error: the name is taken or is no text, the item is of another form, or one of its functions takes other
                arguments or is missing.
        """
        caller = sys._getframe(1)
        own = caller.f_globals["__name__"].partition(".")[0] == "usvauv"
        if name in (self._items if own else self):
            raise self._error(f"{self.kind} {name!r}: is registered already")
        if not isinstance(name, str) or not name:
            raise self._error(f"{self.kind} {name!r}: the name must be text")
        if problem := _misfit(item, resolve_name(self._form) if isinstance(self._form, str) else self._form):
            raise self._error(f"{self.kind} {name!r}: {problem}")
        self._items[name] = item
        if not own:
            self._files[name] = caller.f_code.co_filename
            self.check_fields(name)
        return item

    def described(self, name: str) -> str:
        """An item of a plugin in words, with the file that registered it; empty for one of the packages."""
        return f"{self.kind} {name!r} of {self._files[name]}" if name in self._files else ""

    def attribute(self, name: str, attribute: str) -> Any:
        """An attribute of what documents an item, None without it; of a shipped item by `declared`."""
        if name in self._shipped:
            return declared(self._shipped[name]).get(attribute)
        return getattr(self._documented(self[name]), attribute, None)

    def meaning(self, name: str) -> str:
        """What an item is, the first sentence of its docstring."""
        text = inspect.cleandoc(self.attribute(name, "__doc__") or "")
        return " ".join(text.partition("\n\n")[0].split()).partition(". ")[0].removesuffix(".").replace("`", "")

    def file(self, name: str) -> str:
        """The plugin that registered an item; empty for one of the packages."""
        return self._files.get(name, "")

    def check_fields(self, name: str) -> None:
        """Refuse a plugin's item that may read fields of Taichi which another `ti.init` has ended.

        Raises:
            error: there were fields when the item was registered or used, and Taichi was started anew since.
        """
        if name in self._files:
            from usvauv.kernels import runtime  # imports Taichi

            state, now = self._taichi.get(name), runtime.state_with_fields()
            if state is not None and not runtime.is_present(state):
                raise self._error(
                    f"{self.described(name)}: Taichi's fields that it may read are gone, because `ti.init` or "
                    "`ti.reset` was called after they were made: call `ti.init` once, before all fields"
                )
            self._taichi[name] = now

    @contextmanager
    def calling(self, name: str) -> Iterator[None]:
        """A context in which a plugin's item runs: what it raises becomes one line that names the item and its file.

        Raises:
            error: instead of what a plugin raises; what belongs to the packages raises as it does.
        """
        item = self.described(name)
        with blaming(item, self._error) if item else nullcontext():
            yield

    def refuse(self, name: str, returned: object, allowed: str) -> UserError:
        """The error for an item that returned something that is not allowed."""
        item = self.described(name) or f"{self.kind} {name!r}"
        return self._error(wrong_return(item, returned, allowed))

    def __getitem__(self, name: str) -> T:
        if name not in self:
            raise self._error(f"{self.kind} {name!r}: {choices(name, self)}")
        if name not in self._items:
            import_module(self._shipped[name].partition(":")[0])
        return self._items[name]

    def __contains__(self, name: object) -> bool:
        return name in self._items or name in self._shipped

    def get(self, name: str, default: T | None = None) -> T | None:  # type: ignore[override]
        """The item, or `default` for an unknown name."""
        return self[name] if name in self else default

    def __iter__(self) -> Iterator[str]:
        return iter({**self._shipped, **self._items})

    def __len__(self) -> int:
        return len({*self._shipped, *self._items})
