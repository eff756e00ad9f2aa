"""A policy: heads for a point upstream of the target, by the drift of some seconds.

usvauv eval extreme --plugin examples/plugins/policy.py --policy lead:20 --policy straight
"""

from torch import Tensor

from usvauv import Scenario
from usvauv.extend.policy import Heuristic, command, heuristics, unit


class Lead(Heuristic):
    """Leads its target by the drift of `argument` seconds, at the best speed of `straight`."""

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> float:
        return 10.0 if text is None else float(text)

    def act(self, observation: Tensor) -> Tensor:
        offset = self.scenario.area.diagonal * self.target(observation) - self.argument * self.world.current()
        return command(unit(offset), self.scenario.reference.straight_speed, self.scenario)


heuristics.register("lead", Lead)
