"""Boat strategies by name, as in `--usv`: where the boat goes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from usvauv.env.scenario import Scenario, ScenarioError
from usvauv.env.site.place import SIDED, position
from usvauv.kernels.errors import choices
from usvauv.kernels.mission.boats import boat_strategies as kernel
from usvauv.kernels.mission.worlds import Strategy
from usvauv.kernels.registry import Registry

AGENT = "agent"  # the strategy of boats that are agents
RETIRED = ("fim-horizon", "learned")  # since 0.3


@dataclass(frozen=True)
class BoatStrategy:
    """A strategy of the boat.

    Attributes:
        functions: its Taichi functions.
        arguments: names of the numbers after its name, as in "hold:X,Y"; the functions read the numbers from
            `worlds.strategy_arguments`. X and Y, m, can be given as latitude and longitude, see `site.positions`.
        refuse: (scenario, numbers) → why they cannot be used together, or an empty text.
        repeats: the numbers can also be given for each boat, one boat after the other.
        units: one unit for all arguments.
        about: one sentence about what it does; default: the docstring of `functions.goal`.
    """

    functions: Strategy
    arguments: tuple[str, ...] = ()
    refuse: Callable[[Scenario, Sequence[float]], str] = lambda scenario, numbers: ""
    repeats: bool = False
    units: str = ""
    about: str = ""


boat_strategies: Registry[BoatStrategy] = Registry(
    "usv", ScenarioError, BoatStrategy, lambda strategy: strategy.functions.goal
)


@dataclass(frozen=True)
class StrategyChoice:
    """A boat strategy with its numbers.

    Attributes:
        name: as shown in tables, with the numbers.
        strategy: the strategy.
        numbers: its arguments.
    """

    name: str
    strategy: BoatStrategy
    numbers: tuple[float, ...] = ()

    @classmethod
    def parse(cls, given: str | None, scenario: Scenario) -> StrategyChoice:
        """Read a strategy by name; the default is the scenario's.

        Raises:
            ScenarioError: unknown strategy, wrong numbers, or one that cannot be used in the scenario.
        """
        text = scenario.boat.strategy if given is None else given
        field = "boat.strategy" if given is None else "usv"
        if not isinstance(text, str):
            raise ScenarioError(f"{field} = {text!r}: must be text")
        name, colon, _ = text.partition(":")
        strategy = boat_strategies.get(name)
        if strategy is None and name in RETIRED:
            raise ScenarioError(f"{field}: {text!r}: was removed in 0.3")
        if strategy is None or (colon and not strategy.arguments):
            raise ScenarioError(f"{field}: {text!r}: {choices(text, map(usage, boat_strategies))}")
        numbers = _numbers_of(field, text, scenario)
        with boat_strategies.calling(name):
            problem = strategy.refuse(scenario, numbers)
        if not isinstance(problem, str):
            raise boat_strategies.refuse(name, problem, "a text, empty where nothing is wrong")
        if problem:
            raise ScenarioError(f"{field}: {text!r}{problem}")
        shown = f"{name}:{','.join(f'{number:g}' for number in numbers)}" if numbers else name
        return cls(shown, strategy, numbers)


def _numbers_of(field: str, text: str, scenario: Scenario) -> tuple[float, ...]:
    """The numbers in the text of a registered strategy."""
    name, _, rest = text.partition(":")
    strategy = boat_strategies[name]
    parts = rest.split(",")
    if strategy.arguments == ("X", "Y") and any(map(SIDED.search, parts)):  # points in degrees
        points = (",".join(parts[first : first + 2]) for first in range(0, len(parts), 2))
        rest = ",".join(str(side) for point in points for side in position(field, point, "X,Y", scenario))
    try:
        numbers = tuple(float(part) for part in rest.split(",")) if strategy.arguments else ()
    except ValueError:
        numbers = None
    counts = {len(strategy.arguments)}
    if strategy.repeats:
        counts.add(scenario.boat.count * len(strategy.arguments))
    if numbers is None or len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        examples = " or ".join(f"{name}:{','.join(['100'] * count)}" for count in sorted(counts))
        raise ScenarioError(f"{field}: {text!r}: expected {usage(name)}, for example {examples}")
    return numbers


def usage(name: str) -> str:
    """A strategy's name followed by its arguments, as a user writes them."""
    arguments = boat_strategies[name].arguments
    return f"{name}:{','.join(arguments)}" if arguments else name


def _needs_reckoning(scenario: Scenario, numbers: Sequence[float]) -> str:
    if scenario.navigation.sensor == "none":
        return " foresees AUVs that reckon where they are and needs navigation.sensor to be ground or water"
    return ""


def _in_area(scenario: Scenario, numbers: Sequence[float]) -> str:
    if all(0 <= x <= scenario.area.width for x in numbers[::2]) and all(
        0 <= y <= scenario.area.length for y in numbers[1::2]
    ):
        return ""
    return f": the point must lie in the area [0, {scenario.area.width:g}] × [0, {scenario.area.length:g}]"


boat_strategies.register("fim", BoatStrategy(kernel.FIM))
boat_strategies.register("fim-greedy", BoatStrategy(kernel.FIM_GREEDY))
boat_strategies.register("centroid", BoatStrategy(kernel.CENTROID))
boat_strategies.register("visit", BoatStrategy(kernel.VISIT, refuse=_needs_reckoning))
boat_strategies.register("belief", BoatStrategy(kernel.BELIEF, refuse=_needs_reckoning))
boat_strategies.register(AGENT, BoatStrategy(kernel.AGENT, refuse=_needs_reckoning))
boat_strategies.register("hold", BoatStrategy(kernel.HOLD, ("X", "Y"), _in_area, repeats=True, units="m"))
