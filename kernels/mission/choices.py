"""What a scenario chooses by name in a mission: the rule for the next node, and whose turn an interrogation is."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

from usvauv.kernels.errors import choices
from usvauv.kernels.registry import Registry

LARGEST = 1e6  # of a rule's numbers
RETIRED = ("learned",)  # since 0.4
ARGUMENTS: dict[str, tuple[tuple[str, float], ...]] = {  # of the rules that ship, see `TargetRule.arguments`
    "greedy": (("ALPHA", 0.015),),
    "nearest": (("PACKETS", 1000.0),),
    "rate": (("SECONDS", 10.0),),
    "rollout": (("HORIZON", 90.0),),
    "tour": (),
    "sectors": (),
    "demonstration": (("ALPHA", 0.05),),
}

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
        about: one sentence about what it does; default: the docstring of `choose`.
    """

    choose: Annotated[Callable[..., Any], "worlds, w, k"]
    prepare: Annotated[Callable[..., Any], "worlds, w"] | None = None
    arguments: tuple[tuple[str, float], ...] = ()
    workspace: Annotated[Callable[[int, int], int], "num_nodes, num_auvs"] = no_workspace
    foreseen: Annotated[Callable[..., Any], "worlds, w, i"] | None = None
    units: tuple[str, ...] = ()
    about: str = ""


target_rules: Registry[TargetRule] = Registry(
    "target rule",
    form=TargetRule,
    documented=lambda rule: rule.choose,
    shipped=dict.fromkeys(ARGUMENTS, "usvauv.kernels.mission.target_rules"),
)


def arguments_of(name: str) -> tuple[tuple[str, float], ...]:
    """Names and defaults of a rule's numbers."""
    return ARGUMENTS[name] if name in ARGUMENTS else target_rules[name].arguments


def usage(name: str) -> str:
    """A rule's name, followed by its optional numbers in brackets."""
    arguments = ",".join(argument for argument, _ in arguments_of(name))
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
    defaults = [default for _, default in arguments_of(name)]
    if len(given) > len(defaults) or not all(0 <= number <= LARGEST for number in given):
        raise ValueError(f"{text!r}: expected {usage(name)} with numbers from 0 to {LARGEST:g}")
    return name, (*given, *defaults[len(given) :])
