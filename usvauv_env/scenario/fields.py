"""Parts of a scenario: types of numbers with their bounds, files and overrides, and messages for wrong values."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache, reduce
from importlib import resources
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from usvauv.env.storage.files import DEEPEST, TextFileError, parse_text, read_text
from usvauv.kernels.errors import UserError, choices

LARGEST = 1e6  # of a weight or a price; in single precision sums of a step's terms keep three digits with it
LOWEST_TONE, HIGHEST_TONE = 100.0, 2e5  # Hz; the laws of absorption and noise do not hold below and above
FARTHEST = 1e5  # m, of a place from the area's corner, east and north


def no_boolean(value: Any) -> Any:
    """A field's value, unless it is or holds true or false, of which pydantic would make the numbers 1 and 0."""
    if isinstance(value, bool):
        raise PydanticCustomError("boolean", "must not be true or false")
    return [no_boolean(each) for each in value] if isinstance(value, list | tuple) else value


Number = Annotated[float, BeforeValidator(no_boolean), Field(ge=-LARGEST, le=LARGEST)]
Price = Annotated[float, Field(ge=0, le=LARGEST)]
Place = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
Distance = Annotated[float, Field(ge=0, le=20000)]  # the longest side of an area
Carrier = Annotated[float, Field(ge=LOWEST_TONE, le=HIGHEST_TONE)]
FILE = "file"  # mark of a field with the name of a file of data
FileName = Annotated[str, FILE]
Bandwidth = Annotated[float, Field(ge=1, le=1e6)]
ONE_MODEL = "0.4: fixes are drawn from their distribution, without reflections"
# Retired fields: what removed them, and the values that earlier versions wrote into every file. A file may have these
# values, which now change nothing; a stored scenario may have any.
RETIRED: dict[str, tuple[str, tuple[object, ...]]] = {
    "planner.horizon": ("0.3", (10,)),
    "auv.refused_power": ("0.4", ("travelling", "hovering")),
    "usbl.refraction": ("0.4: with a profile of the speed of sound fixes follow the bent ray", ("corrected",)),
    "usbl.model": (ONE_MODEL, ("statistical",)),
    "acoustics.multipath": (ONE_MODEL, (False,)),
    "acoustics.sediment": (ONE_MODEL, ("sand",)),
    "sea.start_rms": ("0.4", (0.0,)),
    "sea.start_modes": ("0.4", (4,)),
    "sea.sponge_edges": ("0.4: sea.radiating_edges let waves leave", ([],)),
    "sea.sponge_width": ("0.4", (40.0,)),
    "channel.data_ratio": ("0.4: channel.bit_rate decides the energy of data", (0.0,)),
    "tracker.enabled": ("0.4: with navigation.sensor boats have filters", (False,)),
    "tracker.current_reading": ("0.4", (0.0,)),
    "usbl.latency": ("0.4", (0.0,)),
    "reference.zermelo_speed": ("0.4: with the policy zermelo", (1.1, 1.2, 1.3, 1.5, 1.6, 1.7, 1.8)),
}
CLASSES = {"boat": "vessel", "auv": "vehicle"}  # a section, and its field with the name of a class
BASE = "base"  # key of a file with the name of the scenario that it differs from
# Retired values of existing fields: what removed them, and what stored scenarios have in their place.
GONE: dict[str, dict[str, tuple[str, str]]] = {
    "planner.objective": {"e": ("0.3", "d")},
    "auv.action": {"polar": ("0.4: an action is a velocity, `vector`", "vector")},
    "channel.schedule": {"round-robin": ("0.4: its name is turns", "turns"), "by-need": ("0.4", "turns")},
}


def one_of(*names: Collection[str]) -> AfterValidator:
    """A validator for text that must be one of some names, to which plugins may add."""

    def check(name: str) -> str:
        allowed = [*chain(*names)]
        if name not in allowed:
            raise ValueError(f"{name!r}: {choices(name, allowed)}")
        return name

    return AfterValidator(check)


class Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_boolean(cls, value: Any, info: Any) -> Any:
        field = cls.model_fields[info.field_name]
        kinds = field.annotation, *get_args(field.annotation)
        return value if bool in kinds or _fields(field) else no_boolean(value)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if problems := "\n".join(self._problems()):
            raise ValueError(problems)
        return self

    def _problems(self) -> Iterator[str]:
        """What is wrong with fields that are right by themselves, each with field, value and what is allowed."""
        yield from ()


class Layer(NamedTuple):
    """Values that a file, a keyword or an option gives to a scenario.

    Attributes:
        data: nested sections.
        source: its name in messages.
        section: of a keyword; messages name its fields without it.
    """

    data: Mapping[str, Any]
    source: str
    section: str = ""


def merged(layers: Iterable[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Values of all layers: tables are merged key by key, anything else is replaced by that of a later layer."""

    def over(below: Any, above: Any) -> Any:
        if not isinstance(below, Mapping) or not isinstance(above, Mapping):
            return above
        return {**below, **{key: over(below[key], value) if key in below else value for key, value in above.items()}}

    return reduce(over, layers)


def problems_of(error: ValidationError, layers: Sequence[Layer], model: type[Section]) -> list[str]:
    """The problems of a validation, a line for each field: the layer where the value stands, field, problem, value."""
    fields: dict[tuple[int | str, ...], list[ErrorDetails]] = {}
    for problem in error.errors():
        fields.setdefault(problem["loc"][:2], []).append(problem)
    return [line for problems in fields.values() for line in _lines(problems, layers, model)]


def _lines(problems: Sequence[ErrorDetails], layers: Sequence[Layer], model: type[Section]) -> Iterator[str]:
    """What is wrong with a field: its first problem, or all of a value that is of none of several types; a line for
    each problem of a section's fields together.
    """
    problem = problems[0]
    place = problem["loc"]
    plain = {"tuple_type": "must be a list", "model_type": "must be a section with fields"}  # not Python's words
    messages = [plain.get(each["type"], each["msg"]).removeprefix("Value error, ") for each in problems]
    messages = [f"{each[0].lower()}{each[1:]}" for each in messages]
    if len(place) == 3 and isinstance(place[2], str):  # a type's name
        place, messages[0] = place[:2], ", or ".join(dict.fromkeys(messages))
    message, field = messages[0], ".".join(str(part) for part in place)
    if problem["type"] == "value_error":
        for each in message.split("\n"):
            named = [(*place, *name.split(".")) for name in re.findall(r"[a-z]\w*(?:\.\w+)*", each)]
            yield _in_layer(f"{field}: {each}" if field else each, [name for name in named if len(name) > 1], layers)
        return
    line = f"{field} = {problem['input']!r}: {message}"
    if problem["type"] == "extra_forbidden":
        section: Any = model
        for part in place[:-1]:
            section = section.model_fields[part].annotation
        names = list(section.model_fields)
        if len(place) == 1:  # the section may be what was left out
            names += [f"{name}.{inner}" for name, info in model.model_fields.items() for inner in _fields(info)]
        guess = choices(place[-1], names).partition("; ")[2]
        found = f"unknown field; allowed here: {', '.join(section.model_fields)}"
        line = f"{field}: {found}{guess and f'; {guess}'}"
    elif problem["type"] == "literal_error" and len(problems) == 1:
        names = re.findall(r"'([^']*)'", problem.get("ctx", {})["expected"])
        line = f"{field} = {problem['input']!r}: {choices(problem['input'], names)}"
    yield _in_layer(line, [place], layers)


def _in_layer(line: str, places: Sequence[Sequence[int | str]], layers: Sequence[Layer]) -> str:
    """A line after the name of the last of the layers that has one of some fields."""
    of_any = (each for each in reversed(layers) if any(_holds(each.data, place) for place in places))
    layer = next(of_any, layers[-1])
    return f"{layer.source}: {line.removeprefix(f'{layer.section}.')}"


def _holds(data: Any, place: Sequence[int | str]) -> bool:
    """Whether a field stands in nested sections."""
    for part in place:
        if not isinstance(data, Mapping):  # within a field
            return True
        if part not in data:
            return False
        data = data[part]
    return True


def _fields(info: FieldInfo) -> Collection[str]:
    """Field names of a section."""
    kind = info.annotation
    return kind.model_fields if isinstance(kind, type) and issubclass(kind, BaseModel) else ()


def section(description: str) -> Any:
    """A field that is a section; by default its fields have their defaults."""
    return Field({}, validate_default=True, description=description)


class ScenarioError(UserError, ValueError):
    """A scenario cannot be used; a line for each problem names the file, the field, its value and what is allowed."""


def shipped() -> list[str]:
    """Names of the scenarios inside the package."""
    folder = resources.files("usvauv.env") / "scenarios"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def layers_of(name_or_path: str | Path, above: tuple[str, ...] = ()) -> list[Layer]:
    """A scenario's file, and before it those whose values it takes over by `base`, the farthest first.

    Args:
        name_or_path: a shipped name, or a path.
        above: the files that are based on it, the nearest last; a base's path is relative to the file that names it.

    Raises:
        ScenarioError: a file is missing, unreadable or empty, or is based on itself.
    """
    name = str(name_or_path)
    chain = " → ".join([*above, name])
    try:
        if name in shipped():
            text = (resources.files("usvauv.env") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8")
            data = parse_text(text, "TOML")
        else:
            data = read_text(name_or_path, "TOML")
    except FileNotFoundError:
        known = choices(name, shipped(), ", or the path of a TOML file")
        if name.endswith(".toml"):
            known = "there is no such file"
        what = f"{' → '.join(above)}: base =" if above else "scenario"
        raise ScenarioError(f"{what} {name!r}: {known}") from None
    except TextFileError as error:
        raise ScenarioError(f"{chain}: {error}") from None
    if not data:
        raise ScenarioError(f"{chain}: has no field, so it is no scenario; `usvauv scenarios extreme` prints one")
    if os.path.realpath(name) in map(os.path.realpath, above):
        raise ScenarioError(f"{chain}: base: a scenario cannot be based on itself")
    if BASE not in data:
        return [Layer(data, name)]
    base = data.pop(BASE)
    if not isinstance(base, str):
        raise ScenarioError(f"{chain}: base = {base!r}: must be a shipped name or the path of a TOML file")
    place = base if base in shipped() else str(Path(name).parent / base)
    return [*layers_of(place, (*above, name)), Layer(data, name)]


@cache
def classes_of(section: str) -> Mapping[str, Mapping[str, Any]]:
    """Classes of boats (`boat`) or AUVs (`auv`) inside the package: name → the numbers of one, in nested sections."""
    files = sorted((resources.files("usvauv.env") / "classes").iterdir(), key=lambda file: file.name)
    found = {file.name.removesuffix(".toml"): parse_text(file.read_text(encoding="utf-8"), "TOML") for file in files}
    return {name: data for name, data in found.items() if section in data}


def layers_of_classes(data: Mapping[str, Any]) -> list[Layer]:
    """The numbers of the classes that a scenario's data name, which lie under all others."""
    named = []
    for section, field in CLASSES.items():
        content = data.get(section) if isinstance(data, Mapping) else None
        name = content.get(field) if isinstance(content, Mapping) else None
        if isinstance(name, str) and name in classes_of(section):
            named.append(Layer(classes_of(section)[name], f"{section}.{field} = {name}"))
    return named


def class_name(section: str) -> AfterValidator:
    """A validator for the name of a class, or none."""
    return one_of(("none",), classes_of(section))


def parse_override(override: str) -> Mapping[str, Any]:
    """Nested data of one `section.field=value`; the value is TOML, or a bare word taken as text.

    Raises:
        ScenarioError: it is of another form.
    """
    key, separator, text = override.partition("=")
    parts = key.strip().split(".")
    if not separator or not all(parts):
        raise ScenarioError(f"--set {override!r}: expected section.field=value, for example auv.count=3")
    if len(parts) > DEEPEST:
        raise ScenarioError(f"--set {override!r}: nested too deep")
    data: Any = text.strip()
    with suppress(TextFileError):
        data = parse_text(f"value = {text}", "TOML")["value"]
    for part in reversed(parts):
        data = {part: data}
    return data


def without_retired(layer: Layer, stored: bool, problems: list[str]) -> Mapping[str, Any]:
    """Data of a layer without the fields and values in `RETIRED` and `GONE`.

    `problems` gets a line for each retired field with a value that only stored scenarios may have.
    """
    data = layer.data
    for name in (*RETIRED, *GONE):
        section, _, field = name.partition(".")
        content = data.get(section) if isinstance(data, Mapping) else None
        if not isinstance(content, Mapping) or field not in content:
            continue
        value, content = content[field], {other: inner for other, inner in content.items() if other != field}
        if name in RETIRED:
            removed_in, harmless = RETIRED[name]
        elif value in [*GONE[name]]:
            removed_in, content[field] = GONE[name][value]
            harmless = ()
        else:
            continue
        if not stored and value not in harmless:
            problems.append(f"{layer.source}: {name} = {value!r}: was removed in {removed_in}")
        data = {name: inner for name, inner in {**data, section: content}.items() if name != section or content}
    return data


def as_toml(value: Any) -> str:
    """A field's value as TOML."""
    if isinstance(value, tuple):
        return "[" + ", ".join(as_toml(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False)
