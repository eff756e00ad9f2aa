"""Boat strategies by name, known without Taichi; `usvauv.kernels.mission.boats.goals` has the functions of those that
ship.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from usvauv.kernels.registry import Registry

AGENT = "agent"  # the strategy of boats that are agents


class Strategy(NamedTuple):
    """Taichi functions of a boat strategy.

    Attributes:
        start: (worlds, w, b) → vec2, initial position of boat b, m; estimated positions are then the true ones.
        goal: (worlds, w, b) → vec2, its next goal, m.
        foresees: the AUVs are predicted before each goal, see `usvauv.kernels.mission.boats.foresight`.
        weigh: (worlds, w, b, n), writes the loss of goal n of K + 2 if `goal` will compare them; None: `goal` does all.
    """

    start: Annotated[Callable[..., Any], "worlds, w, b"]
    goal: Annotated[Callable[..., Any], "worlds, w, b"]
    foresees: bool = False
    weigh: Annotated[Callable[..., Any], "worlds, w, b, n"] | None = None


@dataclass(frozen=True)
class BoatStrategy:
    """A strategy of the boat.

    Attributes:
        functions: its Taichi functions.
        arguments: names of the numbers after its name, as in "hold:X,Y"; the functions read the numbers from
            `worlds.strategy_arguments`. X and Y, m, can be given as latitude and longitude.
        refuse: (scenario, numbers) → why they cannot be used together, or an empty text.
        repeats: the numbers can also be given for each boat, one boat after the other.
        units: one unit for all arguments.
    """

    functions: Strategy
    arguments: tuple[str, ...] = ()
    refuse: Annotated[Callable[[Any, Sequence[float]], str], "scenario, numbers"] = lambda scenario, numbers: ""
    repeats: bool = False
    units: str = ""


class Numbers(NamedTuple):
    """`arguments` and `units` of a `BoatStrategy`."""

    arguments: tuple[str, ...] = ()
    units: str = ""


HOLD = Numbers(("X", "Y"), "m")
SHIPPED = "fim", "fim-greedy", "centroid", "visit", "belief", AGENT, "hold"
boat_strategies: Registry[BoatStrategy] = Registry(
    "usv",
    form=BoatStrategy,
    documented=lambda strategy: strategy.functions.goal,
    shipped={name: f"usvauv.kernels.mission.boats.goals:{name.replace('-', '_')}" for name in SHIPPED},
)


def numbers_of(name: str) -> Numbers | BoatStrategy:
    """What a strategy's numbers are; of one that ships without Taichi."""
    if name in SHIPPED:
        return HOLD if name == "hold" else Numbers()
    return boat_strategies[name]


def usage(name: str) -> str:
    """A strategy's name followed by its arguments, as a user writes them."""
    arguments = numbers_of(name).arguments
    return f"{name}:{','.join(arguments)}" if arguments else name
