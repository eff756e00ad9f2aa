"""Named items of one kind, such as boat strategies, to which a plugin adds its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Generic, TypeVar

from kernels.errors import UserError

T = TypeVar("T")


class Registry(Mapping[str, T], Generic[T]):
    """A mapping from names to items that can only grow; names keep the order of their registration.

    Args:
        kind: what an item is, in the singular, for error messages, e.g. "boat strategy".
        error: the class of the error for an unknown name.

    Raises:
        error: an unknown name; the message lists the known ones.
    """

    def __init__(self, kind: str, error: Callable[[str], UserError] = UserError) -> None:
        self.kind = kind
        self._error = error
        self._items: dict[str, T] = {}

    def register(self, name: str, item: T) -> T:
        """Add an item under a name that is not taken yet; returns the item.

        Raises:
            error: the name is taken.
        """
        if name in self._items:
            raise self._error(f"{self.kind} {name!r}: is registered already")
        self._items[name] = item
        return item

    def __getitem__(self, name: str) -> T:
        if name not in self._items:
            raise self._error(f"{self.kind} {name!r}: allowed are {', '.join(self._items)}")
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
