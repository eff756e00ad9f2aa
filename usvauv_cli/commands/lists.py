"""`usvauv policies`, `boats` and `targets`: what options take by name, each in a sentence of its own docstring."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from usvauv.cli.commands.options import Plugins

if TYPE_CHECKING:
    from usvauv.env import Scenario
    from usvauv.kernels.registry import Registry

SHIPPED = "Shipped with usvauv:"
Item = tuple[str, str]  # as it is written, and what it is


def policies(plugins: Plugins = None) -> None:
    """List the policies, which steer the AUVs: names for `--policy`, their arguments, and what each does.

    **Examples:**

    `usvauv policies`

    `usvauv policies --plugin mine.py`
    """
    from usvauv import policies
    from usvauv.policies.heuristics import HEURISTICS

    def written(name: str) -> Item:
        argument, unit = HEURISTICS[name].parameter
        field = getattr(HEURISTICS[name], "reference", "")
        default = f"; default: the scenario's reference.{field}" if field else ""
        return (f"{name}[:{argument}]", f"{argument} in {unit}{default}") if argument else (name, "")

    _show_registered(HEURISTICS, written, policies.default, "Not learned, shipped with usvauv:")
    users = _users(policies.default)
    learned = [(name, f"{policies.about(name)}. {users.get(name, '')}".rstrip()) for name in policies.trained()]
    show("Learned, shipped with usvauv:", learned)
    run = "Checkpoint, or folder of a run of `usvauv train`, of which the best is taken."
    show("Your own:", [("PATH", run), ("MODULE:CLASS", "Class of a Python file in this folder, or of a module.")])


def boats(plugins: Plugins = None) -> None:
    """List the boat strategies, which say where the boat goes: names for `--usv`, arguments, and what each does.

    **Example:**

    `usvauv boats`
    """
    from usvauv.env.world.boat_strategies import boat_strategies, usage

    def written(name: str) -> Item:
        strategy = boat_strategies[name]
        return usage(name), f"{', '.join(strategy.arguments)} in {strategy.units}" if strategy.units else ""

    _show_registered(boat_strategies, written, lambda scenario: scenario.boat.strategy)


def targets(plugins: Plugins = None) -> None:
    """List the target rules, which say what node an AUV heads for next: names for `--targets`, arguments, and what each
    does.

    **Example:**

    `usvauv targets`
    """
    from usvauv.kernels.mission.target_rules import target_rules, usage

    def written(name: str) -> Item:
        rule = target_rules[name]
        about = (
            f"{argument}{unit and f' in {unit}'}, default {default:g}"
            for (argument, default), unit in zip_longest(rule.arguments, rule.units, fillvalue="")
        )
        return usage(name), "; ".join(about)

    def default(scenario: Scenario) -> str:
        return scenario.nodes.target_rule if scenario.task_definition.targets == "nodes" else ""

    _show_registered(target_rules, written, default)


def _users(default: Callable[[Scenario], str]) -> dict[str, str]:
    """In which shipped scenarios an item is the default, a sentence for each that is."""
    from usvauv.env import Scenario

    users: dict[str, list[str]] = {}
    for name in Scenario.shipped():
        users.setdefault(default(Scenario.load(name)).partition(":")[0], []).append(name)
    return {item: f"Default in {', '.join(names)}." for item, names in users.items()}


def _show_registered(
    registry: Registry[Any],
    written: Callable[[str], Item],
    default: Callable[[Scenario], str],
    title: str = SHIPPED,
) -> None:
    """Print what is registered: the package's own, then by plugin.

    Args:
        registry: of the items.
        written: name → how an item is written with its arguments, and what these are.
        default: scenario → name of the item that it has by default.
        title: over the package's own.
    """
    users = _users(default)
    groups: dict[str, list[Item]] = {}
    for name in registry:
        form, arguments = written(name)
        sentences = [f"{part}. " for part in (registry.meaning(name), arguments) if part]
        groups.setdefault(registry.file(name), []).append((form, "".join(sentences) + users.get(name, "")))
    for file, items in groups.items():
        show(f"Of the plugin {Path(file).name}:" if file else title, items)


def show(title: str, items: Iterable[Item]) -> None:
    """Print a title and below it a paragraph for each item."""
    from usvauv.cli import tables

    typer.echo(title)
    for form, about in items:
        typer.echo(tables.wrapped(f"  {form:<21} {about}", 24))
