"""In what a scenario may change while worlds of it run."""

from __future__ import annotations

from collections.abc import Collection

from usvauv.env.scenario import Scenario, ScenarioError

# Fields that only numbers of the kernels' tables, the storm and the forcing of the sea depend on.
ADJUSTABLE = (
    "current.circulation_min",
    "current.circulation_max",
    "storm.significant_height",
    "sea.irregular_rms",
    "acoustics.source_level",
    "channel.interval",
)
DECISIONS = ("boat.strategy", "nodes.target_rule")


def check_adjustable(before: Scenario, after: Scenario) -> None:
    """Refuse a scenario that worlds of another one cannot go on under.

    Raises:
        ScenarioError: they differ in a field that is not `ADJUSTABLE`.
    """
    _check(before, after, ADJUSTABLE, "cannot change while worlds run")


def check_continues(before: Scenario, after: Scenario) -> None:
    """Refuse a scenario whose worlds cannot go on where one of another scenario is.

    Raises:
        ScenarioError: they differ in a field that is none of `DECISIONS`.
    """
    _check(before, after, DECISIONS, "must be as in the world that is continued")


def _check(before: Scenario, after: Scenario, allowed: Collection[str], problem: str) -> None:
    old, new = _fields(before), _fields(after)
    for name in (*old, *new):
        if name not in allowed and old.get(name) != new.get(name):
            raise ScenarioError(f"{name} = {new.get(name)!r}: {problem}; what may differ is {', '.join(allowed)}")


def _fields(scenario: Scenario) -> dict[str, object]:
    """All values of a scenario by "section.field"."""
    fields: dict[str, object] = {}
    for name, value in scenario.to_dict().items():
        if isinstance(value, dict):
            fields |= {f"{name}.{field}": number for field, number in value.items()}
        else:
            fields[name] = value
    return fields
