"""Named items of one kind, such as boat strategies, to which plugins add."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from typing import Any, Generic, TypeVar

from usvauv.kernels.errors import UserError, blaming, choices, text_of, wrong_return

T = TypeVar("T")


class Registry(Mapping[str, T], Generic[T]):
    """A mapping from names to items that can only grow; names keep the order of their registration.

    Args:
        kind: what an item is, in the singular, for error messages, e.g. "boat strategy".
        error: the class of the error for an unknown name.
        form: what an item is an instance of, or a subclass.
        documented: item → the function or class whose docstring says what it is; default: the item.

    Raises:
        error: an unknown name; the message lists the known ones.
    """

    def __init__(
        self,
        kind: str,
        error: Callable[[str], UserError] = UserError,
        form: Any = Callable,
        documented: Callable[[T], Any] = lambda item: item,
    ) -> None:
        self.kind = kind
        self._error = error
        self._form = form
        self._documented = documented
        self._items: dict[str, T] = {}
        self._files: dict[str, str] = {}  # of items that plugins registered
        self._taichi: dict[str, object] = {}  # the state of Taichi whose fields these items may read

    def register(self, name: str, item: T) -> T:
        """Add an item under a name that is not taken yet; returns the item.

        Raises:
            error: the name is taken or is no text, or the item is of another form.
        """
        if name in self._items:
            raise self._error(f"{self.kind} {name!r}: is registered already")
        if not isinstance(name, str) or not name:
            raise self._error(f"{self.kind} {name!r}: the name must be text")
        if not (issubclass(item, self._form) if isinstance(item, type) else isinstance(item, self._form)):
            raise self._error(f"{self.kind} {name!r}: is {text_of(item, repr)}: must be a {self._form.__name__}")
        self._items[name] = item
        caller = sys._getframe(1)
        if caller.f_globals["__name__"].partition(".")[0] != "usvauv":
            self._files[name] = caller.f_code.co_filename
            self.check_fields(name)
        return item

    def described(self, name: str) -> str:
        """An item of a plugin in words, with the file that registered it; empty for one of the packages."""
        return f"{self.kind} {name!r} of {self._files[name]}" if name in self._files else ""

    def meaning(self, name: str) -> str:
        """What an item is, in a sentence: its own text `about` where it has one, else the first of its docstring."""
        item = self[name]
        text = getattr(item, "about", "") or inspect.getdoc(self._documented(item)) or ""
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
        if name not in self._items:
            raise self._error(f"{self.kind} {name!r}: {choices(name, self._items)}")
        return self._items[name]

    def __contains__(self, name: object) -> bool:
        return name in self._items

    def get(self, name: str, default: T | None = None) -> T | None:  # type: ignore[override]
        """The item, or `default` for an unknown name."""
        return self._items.get(name, default)

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)
