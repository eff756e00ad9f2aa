"""What a target rule is, and how its name is read."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import taichi as ti

from usvauv.kernels.registry import Registry

LARGEST = 1e6  # of a rule's numbers


@ti.func
def nothing(worlds: ti.template(), w):
    """No preparation."""


@ti.func
def unknown(worlds: ti.template(), w, i):
    """The node itself: which one comes next is not known before."""
    return i


def no_workspace(num_nodes: int, num_auvs: int) -> int:
    """No numbers of its own."""
    return 0


@dataclass(frozen=True)
class TargetRule:
    """Which node an AUV heads for next. `worlds` is a `usvauv.kernels.mission.worlds.Worlds`.

    Attributes:
        choose: a Taichi function (worlds, w, k) → index of a node; it is called for each AUV at the start of an episode
            and after each of its services. In the mission step 0 it gives first targets.
        prepare: a Taichi function (worlds, w), called at the start of an episode when nodes and AUVs are in place.
        arguments: names and defaults of the numbers that may follow the name, as in "greedy:0.1"; the functions read
            them from `worlds.rule_numbers`.
        workspace: (number of nodes, number of AUVs) → how many numbers of its own the rule needs in each world,
            `worlds.workspace[w, :]`; what is in them is lost between two calls.
        foreseen: a Taichi function (worlds, w, i) → the node that an AUV heads for after node i, as far as others can
            know; node i where they cannot.
        read: for a rule whose numbers are in a file: what follows the name → the numbers; raises ValueError.
    """

    choose: Callable[..., Any]
    prepare: Callable[..., Any] = nothing
    arguments: tuple[tuple[str, float], ...] = ()
    workspace: Callable[[int, int], int] = no_workspace
    foreseen: Callable[..., Any] = unknown
    read: Callable[[str], tuple[float, ...]] | None = None


target_rules: Registry[TargetRule] = Registry("target rule", form=TargetRule)


def usage(name: str) -> str:
    """How a rule is written: its name, and in brackets the numbers that may follow."""
    if target_rules[name].read is not None:
        return f"{name}:FILE"
    arguments = ",".join(argument for argument, _ in target_rules[name].arguments)
    return f"{name}[:{arguments}]" if arguments else name


def parse(text: str) -> tuple[TargetRule, tuple[float, ...]]:
    """A rule and its numbers from "name", "name:number" or "name:number,number".

    Raises:
        ValueError: unknown rule, or numbers that it does not have; the message says what is allowed.
    """
    name, colon, rest = text.partition(":")
    if name not in target_rules:
        raise ValueError(f"{text!r}: allowed are {', '.join(map(usage, target_rules))}")
    rule = target_rules[name]
    if rule.read is not None:
        return rule, rule.read(rest)
    try:
        given = [float(part) for part in rest.split(",")] if colon else []
    except ValueError:
        given = [math.nan]
    defaults = [default for _, default in rule.arguments]
    if len(given) > len(defaults) or not all(0 <= number <= LARGEST for number in given):
        raise ValueError(f"{text!r}: expected {usage(name)} with numbers from 0 to {LARGEST:g}")
    return rule, (*given, *defaults[len(given) :])
