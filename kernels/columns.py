"""Numbered columns of arrays."""

from typing import Annotated, Any, ClassVar, get_origin


class Columns:
    """Numbers the columns of an array's last axis: a subclass's annotations of type int, in their order, from 0.

    An annotation can be `Annotated[int, …]`.

    Attributes:
        names: of the columns.
    """

    names: ClassVar[tuple[str, ...]]

    def __init_subclass__(cls) -> None:
        kinds = cls.__annotations__.items()
        cls.names = tuple(name for name, kind in kinds if kind is int or get_origin(kind) is Annotated)
        for number, name in enumerate(cls.names):
            setattr(cls, name, number)

    @classmethod
    def span(cls, first: str, last: str) -> slice:
        """Columns `first` to `last`, both included."""
        return slice(cls.names.index(first), cls.names.index(last) + 1)


def columns(*names: str) -> Any:
    """`Columns` of the given names, for a table that one file alone uses."""
    return type("Columns", (Columns,), {"__annotations__": dict.fromkeys(names, int)})
