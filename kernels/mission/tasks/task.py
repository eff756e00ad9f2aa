"""Definition of tasks: the Taichi functions that a mission calls, and the numbers they need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from usvauv.kernels.registry import Registry

Function = Callable[..., Any]  # a Taichi function


@dataclass(frozen=True)
class RewardTerm:
    """One named term of an AUV's reward.

    Attributes:
        name: column name of the term.
        function: (worlds, w, k, weight) → weight × the quantity that is rewarded or punished.
        weight: default of the weight, which the scenario may set in `task_parameters`; None where the scenario's
            section `reward` has it under the term's name.
    """

    name: str
    function: Annotated[Function, "worlds, w, k, weight"]
    weight: float | None


@dataclass(frozen=True)
class Task:
    """A task of the AUVs. W worlds; `worlds` is a `usvauv.kernels.mission.worlds.Worlds`.

    In a reset are called: `place`, then for each AUV, once it is deployed and located, `assign`. In a step: `move` for
    each AUV, then the boat moves and locates the AUVs, `update`, the reward terms, `finish`, the observation.

    Attributes:
        place: (worlds, w), put the nodes of a new episode in their places.
        assign: (worlds, w, k), give AUV k its first target.
        move: (worlds, w, k, a0, a1), one step of AUV k with its action in [−1, 1].
        update: (worlds, w), what happens to the nodes in a step.
        finish: (worlds, w), after the rewards: complete services, give new targets.
        reward_terms: terms of the reward, in the order of their columns.
        targets: number of nodes: "nodes" for `nodes.count`, "auvs" for one an AUV.
        parameters: names and defaults of the task's own numbers, `worlds.task_parameters` in this order; the scenario
            may set them in `task_parameters`.
        observation: names of observation terms that the task adds, see `usvauv.kernels.mission.observation`.
        heuristic: name of the heuristic that is taken where no policy is named, and that a learned one has to beat.
    """

    place: Annotated[Function, "worlds, w"]
    assign: Annotated[Function, "worlds, w, k"]
    move: Annotated[Function, "worlds, w, k, a0, a1"]
    update: Annotated[Function, "worlds, w"]
    finish: Annotated[Function, "worlds, w"]
    reward_terms: tuple[RewardTerm, ...]
    targets: Literal["nodes", "auvs"] = "nodes"
    parameters: tuple[tuple[str, float], ...] = ()
    observation: tuple[str, ...] = ()
    heuristic: str = "clear"

    @property
    def declared(self) -> tuple[str, ...]:
        """Names that the scenario's `task_parameters` may have."""
        return (*(name for name, _ in self.parameters), *(t.name for t in self.reward_terms if t.weight is not None))

    @property
    def reward_names(self) -> tuple[str, ...]:
        """Names of the reward terms, in order."""
        return tuple(term.name for term in self.reward_terms)


HERE = "usvauv.kernels.mission.tasks"
tasks: Registry[Task] = Registry(
    "task",
    form=Task,
    shipped={"data-collection": f"{HERE}.data_collection", "station-keeping": f"{HERE}.station_keeping"},
)
