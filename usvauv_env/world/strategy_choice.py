"""The boat strategy of a scenario or of the option `--usv`, with its numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.site.positions import SIDED, position
from usvauv.kernels.errors import choices
from usvauv.kernels.mission.boats.boat_strategies import BoatStrategy, boat_strategies, usage

RETIRED = ("fim-horizon", "learned")  # since 0.3


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
