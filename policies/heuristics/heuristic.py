"""What every heuristic is: a policy made for one world, with an optional argument in its name."""

from __future__ import annotations

from typing import Any

from policies.policy import Policy
from usvauv_env.scenario import Scenario
from usvauv_env.world.world import World


class Heuristic(Policy):
    """A policy without learning.

    Args:
        name: what it is called in tables, such as "crab:1.4".
        world: the world it acts in; it may read everything there.
        argument: what `parse` made of the text after the colon in `name`.
    """

    def __init__(self, name: str, world: World, argument: Any):
        super().__init__(name, world.scenario)
        self.world = world
        self.argument = argument

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> Any:
        """The argument from the text after the colon in the name; None where the name has no colon.

        Raises:
            ValueError: not allowed in this scenario; the message says what is.
        """
        if text is not None:
            raise ValueError("takes no parameter")


def number(text: str, expected: str) -> float:
    """Read a number; `expected` describes it.

    Raises:
        ValueError: not a number.
    """
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{text!r} is not {expected}") from None
