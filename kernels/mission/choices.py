"""What a scenario chooses by name in a mission: the rule for the next node, and whose turn an interrogation is."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from usvauv.kernels.errors import choices
from usvauv.kernels.registry import Registry

LARGEST = 1e6  # of a rule's numbers
RETIRED = ("learned",)  # since 0.4


class Numbers(NamedTuple):
    """`arguments` and `units` of a `TargetRule`."""

    arguments: tuple[tuple[str, float], ...] = ()
    units: tuple[str, ...] = ()


RULE_NUMBERS = {  # of the rules that ship
    "greedy": Numbers((("ALPHA", 0.015),), ("1/(m s)",)),
    "nearest": Numbers((("PACKETS", 1000.0),), ("",)),
    "rate": Numbers((("SECONDS", 10.0),), ("s",)),
    "rollout": Numbers((("HORIZON", 90.0),), ("s",)),
    "tour": Numbers(),
    "sectors": Numbers(),
    "demonstration": Numbers((("ALPHA", 0.05),), ("1/(m s)",)),
}
HERE = "usvauv.kernels.mission.target_rules"

Urgency = Annotated[Callable[..., float], "worlds, w, b, k"]
schedules: Registry[Urgency] = Registry(
    "schedule", form=Urgency, shipped={"turns": "usvauv.kernels.mission.link.channel"}
)


def no_workspace(num_nodes: int, num_auvs: int) -> int:
    """No workspace."""
    return 0


@dataclass(frozen=True)
class TargetRule:
    """Choice of an AUV's next node. `worlds` is a `usvauv.kernels.mission.worlds.Worlds`.

    Attributes:
        choose: a Taichi function (worlds, w, k) → index of a node; it is called for each AUV at the start of an episode
            and after each of its services. In mission step 0 it chooses first targets.
        prepare: a Taichi function (worlds, w), called as an episode starts, when nodes and AUVs are in place, or None.
        arguments: names and defaults of the numbers that may follow the name, as in "greedy:0.1"; the functions read
            them from `worlds.rule_numbers`.
        workspace: (number of nodes, number of AUVs) → length of the rule's workspace in each world,
            `worlds.workspace[w, :]`, which is not kept between two calls.
        foreseen: a Taichi function (worlds, w, i) → an AUV's predicted target after node i; node i, or None, if it
            cannot be predicted.
        units: of the arguments, one each; "" for a number.
    """

    choose: Annotated[Callable[..., Any], "worlds, w, k"]
    prepare: Annotated[Callable[..., Any], "worlds, w"] | None = None
    arguments: tuple[tuple[str, float], ...] = ()
    workspace: Annotated[Callable[[int, int], int], "num_nodes, num_auvs"] = no_workspace
    foreseen: Annotated[Callable[..., Any], "worlds, w, i"] | None = None
    units: tuple[str, ...] = ()


target_rules: Registry[TargetRule] = Registry(
    "target rule",
    form=TargetRule,
    documented=lambda rule: rule.choose,
    shipped={
        **{name: f"{HERE}.rule:{name}" for name in ("greedy", "nearest", "rate")},
        "rollout": f"{HERE}.rollout:rollout",
        **{name: f"{HERE}.tour:{name}" for name in ("tour", "sectors")},
        "demonstration": f"{HERE}.rule:demonstration",
    },
)


def numbers_of(name: str) -> Numbers | TargetRule:
    """What a rule's numbers are; of one that ships without Taichi."""
    return RULE_NUMBERS[name] if name in RULE_NUMBERS else target_rules[name]


def usage(name: str) -> str:
    """A rule's name, followed by its optional numbers in brackets."""
    arguments = ",".join(argument for argument, _ in numbers_of(name).arguments)
    return f"{name}[:{arguments}]" if arguments else name


def rule_and_numbers(text: str) -> tuple[str, tuple[float, ...]]:
    """A rule's name and its numbers from "name", "name:number" or "name:number,number".

    Raises:
        ValueError: unknown or retired rule, or numbers that it does not have; the message says what is allowed.
    """
    name, colon, rest = text.partition(":")
    if name not in target_rules and name in RETIRED:
        raise ValueError(f"{text!r}: was removed in 0.4")
    if name not in target_rules:
        raise ValueError(f"{text!r}: {choices(text, map(usage, target_rules))}")
    try:
        given = [float(part) for part in rest.split(",")] if colon else []
    except ValueError:
        given = [math.nan]
    defaults = [default for _, default in numbers_of(name).arguments]
    if len(given) > len(defaults) or not all(0 <= number <= LARGEST for number in given):
        raise ValueError(f"{text!r}: expected {usage(name)} with numbers from 0 to {LARGEST:g}")
    return name, (*given, *defaults[len(given) :])
