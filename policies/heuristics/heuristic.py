"""Base of the heuristics: a policy bound to one world, with an optional argument in its name."""

from __future__ import annotations

from typing import Any, ClassVar

from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.env.world.world import World
from usvauv.policies.policy import Policy


class Heuristic(Policy):
    """A policy without learning.

    Args:
        name: its name in tables, such as "crab:1.4".
        world: the world it acts in, whose true state it may read.
        argument: value that `parse` gave for the text after the colon in `name`.

    Attributes:
        parameter: name of that argument and its unit, as lists show them; empty without one.
    """

    parameter: ClassVar[tuple[str, str]] = ("", "")

    def __init__(self, name: str, world: World, argument: Any) -> None:
        super().__init__(name, world.scenario)
        self.world = world
        self.argument = argument
        self.layout = ObservationLayout.of(world.scenario)
        self._target, self._position = self.layout.slice("target"), self.layout.slice("position")

    def target(self, observation: Tensor) -> Tensor:
        """Offset of the target from the measured position, (W, K, 2), over the area's diagonal."""
        return observation[..., self._target]

    def position(self, observation: Tensor) -> Tensor:
        """Measured position, (W, K, 2), over the area's diagonal."""
        return observation[..., self._position]

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> Any:
        """The argument from the text after the colon in the name; `text` is None if the name has no colon.

        Raises:
            ValueError: not allowed in this scenario; the message has what is.
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
