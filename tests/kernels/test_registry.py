"""Names of plugins, and messages, which are one line that can be read, whatever they quote."""

import inspect

import pytest

from usvauv.kernels.errors import LONGEST, UserError
from usvauv.kernels.mission.boats.boat_strategies import boat_strategies
from usvauv.kernels.mission.boats.boat_strategies import numbers_of as of_boats
from usvauv.kernels.mission.choices import numbers_of as of_rules
from usvauv.kernels.mission.choices import schedules, target_rules
from usvauv.kernels.mission.tasks.task import tasks
from usvauv.kernels.positioning.laws import absorption_laws, ambient_noise_laws, rate_laws
from usvauv.kernels.registry import Registry
from usvauv.kernels.vehicles.definition import vehicles
from usvauv.policies.heuristics import heuristics


class Wrong(UserError):
    pass


class Form:
    pass


class Item(Form):
    pass


@pytest.mark.parametrize(
    ("name", "item", "problem"),
    [
        ("a", Item, "is registered already"),
        ("", Item, "the name must be text"),
        (3, Item, "the name must be text"),
        ("b", int, "must be a Form"),
        ("b", 3, "must be a Form"),
    ],
)
def test_refusals(name, item, problem):
    registry: Registry = Registry("law", Wrong, Form)
    registry.register("a", Item)
    with pytest.raises(Wrong, match=rf"^law {name!r}: .*{problem}$"):
        registry.register(name, item)
    assert dict(registry) == {"a": Item}


def test_an_item_from_elsewhere_is_named_with_its_file():
    registry: Registry = Registry("law", Wrong)
    registry.register("a", len)
    assert registry.described("a") == f"law 'a' of {__file__}"
    assert str(registry.refuse("a", 1, "more")) == f"law 'a' of {__file__}: returned 1: must be more"
    where = r"in .*test_registry\.py, line \d+ \(set USVAUV_TRACEBACK=1"
    with pytest.raises(Wrong, match=f"^law 'a' of .*: raised ValueError: odd, {where}"), registry.calling("a"):
        raise ValueError("odd")


def test_an_item_of_the_packages_raises_as_it_does():
    name = next(iter(absorption_laws))
    assert absorption_laws.described(name) == absorption_laws.described("none of them") == ""
    assert str(absorption_laws.refuse(name, 1, "2")) == f"absorption law {name!r}: returned 1: must be 2"
    with pytest.raises(ValueError, match=r"^odd$"), absorption_laws.calling(name):
        raise ValueError("odd")


@pytest.mark.parametrize("excess", [-1, 0, 1, 5000])
def test_the_middle_of_a_long_message_is_left_out(excess):
    message = "".join(chr(ord("a") + n % 26) for n in range(LONGEST + excess))
    shown = str(UserError(message))
    if excess <= 0:
        assert shown == message
    else:
        begin, end = shown.split(" … ")
        assert len(begin) == len(end) == LONGEST // 2
        assert message.startswith(begin)
        assert message.endswith(end)


def test_what_cannot_be_printed_is_written_as_python_does():
    assert str(UserError("a\nb\x1b[2Jc ä\u202e'\"")) == "a\\nb\\x1b[2Jc ä\\u202e'\""


@pytest.mark.parametrize(
    "registry",
    [
        absorption_laws,
        ambient_noise_laws,
        boat_strategies,
        heuristics,
        rate_laws,
        schedules,
        target_rules,
        tasks,
        vehicles,
    ],
)
def test_the_names_that_ship_are_those_that_their_modules_register(registry):
    """Else a name is refused before its module is imported, or is known without an item."""
    assert all(registry[name] is registry.get(name) for name in registry)
    assert {*registry._shipped} == {name for name in registry._items if not registry.file(name)}


@pytest.mark.parametrize(
    ("registry", "attributes"), [(boat_strategies, ()), (heuristics, ("parameter", "reference")), (target_rules, ())]
)
def test_what_lists_say_without_an_import_is_what_is_imported(registry, attributes):
    for name, item in registry.items():
        documented = registry._documented(item)
        assert inspect.getdoc(documented) == registry.attribute(name, "__doc__")
        for attribute in attributes:
            assert registry.attribute(name, attribute) == getattr(documented, attribute, None), name


@pytest.mark.parametrize(
    ("registry", "numbers_of"),
    [(boat_strategies, of_boats), (target_rules, of_rules)],
)
def test_numbers_that_lists_show_are_those_of_the_items(registry, numbers_of):
    for name, item in registry.items():
        numbers = numbers_of(name)
        assert (numbers.arguments, numbers.units) == (item.arguments, item.units)


def test_a_plugin_takes_no_name_that_ships():
    with pytest.raises(UserError, match="is registered already"):
        target_rules.register("greedy", target_rules["tour"])
