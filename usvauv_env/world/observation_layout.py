"""The layout of an AUV's observation in a scenario, which decides which terms it has, and the numbers of its action."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.kernels.errors import choices
from usvauv.kernels.mission.observation import observation_terms, quantities


class Quantity(NamedTuple):
    """One number of a vector.

    Attributes:
        index: position in the vector.
        quantity: its meaning; x points east, y north.
        unit: the quantity that 1 stands for.
        low, high: bounds in the spaces of the Gymnasium, PettingZoo and TorchRL environments.
    """

    index: int
    quantity: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class ObservationLayout:
    """Indices of a scenario's terms in an AUV's observation (..., O): `observation[..., layout.slice("target")]`.

    Attributes:
        num_auvs: number K of AUVs.
        num_nodes: number M of nodes, stations or targets.
        terms: names of the terms, in order.
    """

    num_auvs: int
    num_nodes: int
    terms: tuple[str, ...]

    @classmethod
    def of(cls, scenario: Scenario) -> ObservationLayout:
        """The layout of a scenario.

        Raises:
            ScenarioError: an unknown term in `observation.extra` or of the task.
        """
        extra = {*scenario.observation.extra, *scenario.task_definition.observation}
        for name in extra:
            if name not in observation_terms:
                raise ScenarioError(f"observation.extra: {name!r}: {choices(name, observation_terms)}")
        present = []
        for name, term in observation_terms.items():
            with observation_terms.calling(name):
                if term.present(scenario) if term.present else name in extra:
                    present.append(name)
        return cls(scenario.auv.count, scenario.targets, tuple(present))

    def __contains__(self, name: str) -> bool:
        return name in self.terms

    def __iter__(self) -> Iterator[tuple[str, slice]]:
        """Names and indices of the terms."""
        last = 0
        for name in self.terms:
            first, last = last, last + len(quantities(name, self.num_auvs, self.num_nodes))
            yield name, slice(first, last)

    @property
    def size(self) -> int:
        """Length O of one AUV's observation."""
        return max(place.stop for _, place in self)

    def slice(self, name: str) -> slice:
        """Indices of a term.

        Raises:
            KeyError: the term is not present.
        """
        return dict(self)[name]


def commanded(scenario: Scenario) -> list[Quantity]:
    """The action of one AUV, number by number."""
    auv = scenario.auv
    if auv.action == "fins":
        names = [(f"{name}, a share of its limit", "1") for name in ("rudder to starboard", "stern plane, diving")]
        names.append(("propeller, a share of its fastest revolutions", "1"))
    else:
        clamped = f"the velocity's norm is clamped into {auv.speed_min:g} .. {auv.speed_max:g} m/s"
        names = [(f"velocity through the water, {axis}; {clamped}", f"{auv.speed_max:g} m/s") for axis in "xy"]
        if auv.action == "vector-depth":
            names.append((f"depth: {auv.depth_min:g} m at -1, {auv.depth_max:g} m at 1, linear between", "1"))
    return [Quantity(index, text, unit, -1.0, 1.0) for index, (text, unit) in enumerate(names)]
