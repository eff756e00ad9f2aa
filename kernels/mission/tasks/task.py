"""Definition of tasks: the Taichi functions that a mission calls, and the numbers they need."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

from usvauv.kernels.columns import Columns
from usvauv.kernels.limits import Quantity
from usvauv.kernels.mission.tasks import tracking_numbers
from usvauv.kernels.registry import Registry

Function = Callable[..., Any]  # a Taichi function
Targets = Literal["nodes", "auvs", "moving"]
HEAVIEST = 1e6  # weight of a term of the reward


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
        targets: what AUVs head for: "nodes", `nodes.count` of them, chosen by the target rule; "auvs" for one place an
            AUV; "moving" for `nodes.count` nodes that move, so that a trace has their way.
        parameters: the task's own numbers by name, which a scenario may set in `task_parameters`; in functions
            `worlds.task_parameters.name`.
        observation: names of observation terms that the task adds, see `usvauv.kernels.mission.observation`.
        heuristic: name of the heuristic that is taken where no policy is named, and that a learned one has to beat.
        auv_columns, node_columns, pair_columns, boat_columns: columns of the task's own memory of each AUV,
            `worlds.task_auv[w, k]`, of each node, `worlds.task_node[w, i]`, of each AUV and node,
            `worlds.task_pair[w, k, i]`, and of each boat and node, `worlds.task_boat[w, b, i]`; None for no such
            memory. They are part of the worlds' state, and zero before the first episode.
        room: vectors of `LANES` numbers in `worlds.room[w, :]` that `update` needs, which are not kept; on a CPU
            `worlds.room[w // WORLDS_PER_BLOCK, :]` where worlds take a step side by side.
        way: (worlds, w, k) → vec2, what AUV k takes the way to its target to be, m, which its observation has; None:
            from where it takes itself to be to the node.
        known_place: (worlds, w, i) → vec2, where boats take node i to be, m; None: where it is.
    """

    place: Annotated[Function, "worlds, w"]
    assign: Annotated[Function, "worlds, w, k"]
    move: Annotated[Function, "worlds, w, k, a0, a1"]
    update: Annotated[Function, "worlds, w"]
    finish: Annotated[Function, "worlds, w"]
    reward_terms: tuple[RewardTerm, ...]
    targets: Targets = "nodes"
    parameters: tuple[tuple[str, Quantity], ...] = ()
    observation: tuple[str, ...] = ()
    heuristic: str = "clear"
    auv_columns: type[Columns] | None = None
    node_columns: type[Columns] | None = None
    pair_columns: type[Columns] | None = None
    boat_columns: type[Columns] | None = None
    room: int = 1
    way: Annotated[Function, "worlds, w, k"] | None = None
    known_place: Annotated[Function, "worlds, w, i"] | None = None

    @property
    def numbers(self) -> dict[str, Quantity]:
        """What the scenario's `task_parameters` may set: the parameters, and weights of terms of the reward."""
        weights = {term.name: term.weight for term in self.reward_terms if term.weight is not None}
        return {**dict(self.parameters), **weights_of(weights)}

    @property
    def reward_names(self) -> tuple[str, ...]:
        """Names of the reward terms, in order."""
        return tuple(term.name for term in self.reward_terms)


def weights_of(weights: Mapping[str, float]) -> dict[str, Quantity]:
    """Weights of terms of the reward, by name, as numbers that a scenario may set."""
    return {
        name: Quantity(weight, -HEAVIEST, HEAVIEST, f"weight of the reward's term {name}")
        for name, weight in weights.items()
    }


class Outline(NamedTuple):
    """What is known of a task that ships without Taichi, as in `Task`."""

    numbers: Mapping[str, Quantity] = MappingProxyType({})
    targets: Targets = "nodes"
    heuristic: str = "clear"


OF_TRACKING = weights_of(tracking_numbers.WEIGHTS)
SHIPPED = {
    "data-collection": Outline(),
    "station-keeping": Outline(targets="auvs", heuristic="keep"),
    "tracking": Outline({**dict(tracking_numbers.PARAMETERS), **OF_TRACKING}, "moving", "circle"),
    "tracking-plain": Outline({**dict(tracking_numbers.PLAIN), **OF_TRACKING}, "moving", "circle"),
}


def outline(task: str) -> Outline | Task:
    """The outline of a task by name, or a task of a plugin, which has the same attributes."""
    return SHIPPED[task] if task in SHIPPED else tasks[task]


HERE = "usvauv.kernels.mission.tasks"
tasks: Registry[Task] = Registry(
    "task",
    form=Task,
    shipped={
        "data-collection": f"{HERE}.data_collection",
        "station-keeping": f"{HERE}.station_keeping",
        "tracking": f"{HERE}.tracking",
        "tracking-plain": f"{HERE}.tracking_plain",
    },
)
