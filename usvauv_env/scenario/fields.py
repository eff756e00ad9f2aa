"""What sections are made of: kinds of numbers with their bounds, and how a wrong one is said."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from itertools import chain
from typing import Annotated, Any, TypeVar, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from usvauv.kernels.errors import choices

LARGEST = 1e6  # of a weight or a price; sums of a step's terms keep three digits beside it in single precision
LOWEST_TONE, HIGHEST_TONE = 100.0, 2e5  # Hz; below and above the laws of absorption and noise mean nothing
FARTHEST = 1e5  # m, of a place from the area's corner, east and north

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Price = Annotated[float, Field(ge=0, le=LARGEST)]
Place = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
Distance = Annotated[float, Field(ge=0, le=20000)]  # the longest side of an area
Carrier = Annotated[float, Field(ge=LOWEST_TONE, le=HIGHEST_TONE)]
Bandwidth = Annotated[float, Field(ge=1, le=1e6)]


def one_of(*names: Collection[str]) -> AfterValidator:
    """Of a text that must be one of some names, to which plugins may add."""

    def check(name: str) -> str:
        allowed = [*chain(*names)]
        if name not in allowed:
            raise ValueError(f"{name!r}: {choices(name, allowed)}")
        return name

    return AfterValidator(check)


class Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)


def one_line(error: ValidationError, source: str, model: type[Section]) -> str:
    """The first problem of a validation as one line: file, field, what is wrong, the value given."""
    problem = error.errors()[0]
    field = ".".join(str(part) for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "extra_forbidden":
        section: Any = model
        for part in problem["loc"][:-1]:
            section = section.model_fields[part].annotation
        names = list(section.model_fields)
        if len(problem["loc"]) == 1:  # the section may be what was left out
            names += [f"{name}.{inner}" for name, info in model.model_fields.items() for inner in _fields(info)]
        guess = choices(problem["loc"][-1], names).partition("; ")[2]
        found = f"unknown field; allowed here: {', '.join(section.model_fields)}"
        return f"{source}: {field}: {found}{guess and f'; {guess}'}"
    if problem["type"] == "literal_error":
        names = re.findall(r"'([^']*)'", problem.get("ctx", {})["expected"])
        return f"{source}: {field} = {problem['input']!r}: {choices(problem['input'], names)}"
    if problem["type"] == "value_error":
        return f"{source}: {field}: {message}" if field else f"{source}: {message}"
    return f"{source}: {field} = {problem['input']!r}: {message[0].lower()}{message[1:]}"


def _fields(info: FieldInfo) -> Collection[str]:
    """Names of the fields of a field that is a section."""
    kind = info.annotation
    return kind.model_fields if isinstance(kind, type) and issubclass(kind, BaseModel) else ()


S = TypeVar("S", bound=Section)


def section(kind: type[S], description: str) -> S:
    """A field that is a section, by default with the defaults of its fields."""
    return Field(default_factory=cast(Callable[[], S], kind), description=description)
